"""Makes tests/fixtures/depth: one 8 x 6 depth image in the formats that people have, by the tools they
have it from. Needs numpy, tifffile, imagecodecs, opencv-python-headless and OpenEXR."""

import os
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import tifffile

FOLDER = Path(__file__).parent.parent / "tests/fixtures/depth"
FOLDER.mkdir(exist_ok=True)
os.chdir(FOLDER)

rows, columns = np.mgrid[0:6, 0:8]
mm = (1000 + 10 * columns + 100 * rows).astype(np.uint16)
mm[0, :4] = 0
metres = mm / 1000.0
metres[0, :4] = [0.0, np.nan, -1.0, np.inf]
f32 = metres.astype(np.float32)

cv2.imwrite("u16.png", mm)
cv2.imwrite("tum.png", (mm * 5).astype(np.uint16))
cv2.imwrite("grey8.png", (mm // 10).astype(np.uint8))
cv2.imwrite("colour16.png", np.dstack([mm] * 3))

for name in ["uint16", "int16", "int32", "uint32"]:
    np.save(f"{name}.npy", mm.astype(name))
for name in ["float16", "float32", "float64"]:
    np.save(f"{name}.npy", metres.astype(name))
np.save("big_endian.npy", mm.astype(">u2"))
np.save("big_endian_float.npy", f32.astype(">f4"))
np.save("fortran.npy", np.asfortranarray(f32))
np.save("axis_behind.npy", f32[:, :, None])
np.save("axis_before.npy", f32[None])
np.save("float_mm.npy", (1000 * metres).astype(np.float32))
np.save("uint8.npy", (mm // 10).astype(np.uint8))
np.save("colour.npy", np.dstack([mm] * 3))
np.savez("only.npz", frame=f32)
np.savez_compressed("called_depth.npz", rgb=np.zeros((6, 8, 3), np.uint8), depth=mm)
np.savez("several.npz", left=f32, right=f32)

tifffile.imwrite("float32.tif", f32)
tifffile.imwrite("uint16.tiff", mm, compression="zlib", predictor=True)
tifffile.imwrite("big_endian.tif", mm, byteorder=">")
tifffile.imwrite("float64.tif", metres, compression="lzw")
tifffile.imwrite("float16.tif", metres.astype(np.float16))
tifffile.imwrite("tiled.tif", f32, tile=(16, 16), compression="zlib")
tifffile.imwrite("colour.tif", np.dstack([mm] * 3), photometric="rgb")
cv2.imwrite("opencv.tiff", f32)  # LZW with a predictor

def exr(name, channels, compression):
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(name)

exr("z.exr", {"Z": f32}, OpenEXR.ZIP_COMPRESSION)
exr("half.exr", {"Y": metres.astype(np.float16)}, OpenEXR.PIZ_COMPRESSION)
exr("rgb_and_depth.exr", {"R": f32 * 3, "G": f32, "B": f32, "depth.V": f32}, OpenEXR.RLE_COMPRESSION)
exr("colour.exr", {"R": f32 * 3, "G": f32, "B": f32}, OpenEXR.NO_COMPRESSION)
exr("grey.exr", {"R": f32, "G": f32, "B": f32}, OpenEXR.ZIPS_COMPRESSION)

cv2.imwrite("u16.pgm", mm)
cv2.imwrite("grey8.pgm", (mm // 10).astype(np.uint8))
cv2.imwrite("opencv.pfm", f32)
# As the format's page describes it: big-endian, and the bottom row first.
Path("big_endian.pfm").write_bytes(b"Pf\n8 6\n1.0\n" + np.flipud(f32).astype(">f4").tobytes())
