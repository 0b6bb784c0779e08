"""Takes depth images of the very same triangles, armpose and Open3D in turn, on one core.

    pip install -r scripts/requirements.txt
    python scripts/compare_open3d.py > data/comparisons/open3d.csv

The robot of the data sets, its meshes subdivided until it has more than 50,000 triangles, in a furnished
room, at 640 x 480 pixels. Every frame begins anew, as each has another pose. Open3D builds its
acceleration structure, casts a ray through each pixel, and one from what it hits to the projector to
find the shadow: exact depth, but no measuring. armpose poses the robot, draws the camera's and the
projector's view, and simulates the sensor: disparities in eighths of a pixel, their filter and noise.
"""

import argparse
import csv
import os
import pathlib
import statistics
import subprocess
import sys
import time

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
import open3d as o3d

ROOT = pathlib.Path(__file__).resolve().parent.parent
# data/cameras/realistic.toml
WIDTH, HEIGHT, FOCAL, BASELINE = 640, 480, 580.0, 0.075


def armpose(*arguments):
    command = ["cargo", "run", "--quiet", "--example", "compare_frame", "--", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def open3d_frame(vertices, triangles, rays, projector):
    """The milliseconds that Open3D takes; what NumPy does in between does not count."""
    clocks = [time.perf_counter()]
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(vertices, triangles)
    hit = scene.cast_rays(rays, nthreads=1)["t_hit"]
    clocks.append(time.perf_counter())
    hit = hit.numpy()
    seen = np.isfinite(hit)
    points = rays.numpy()[seen, 3:] * hit[seen, None]
    # Ends at the surface; a thousandth of the way is left out, so that no surface shades itself.
    from_projector = np.hstack([np.broadcast_to(projector, points.shape), points - projector])
    shadow_rays = o3d.core.Tensor(from_projector.astype(np.float32))
    clocks.append(time.perf_counter())
    shaded = scene.test_occlusions(shadow_rays, tfar=0.999, nthreads=1)
    clocks.append(time.perf_counter())
    assert seen.mean() > 0.9 and 0 < shaded.numpy().mean() < 0.5
    return 1e3 * (clocks[1] - clocks[0] + clocks[3] - clocks[2])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=9)
    parser.add_argument("--frames", type=int, default=30, help="of armpose in each repetition; their median counts")
    parser.add_argument("--folder", type=pathlib.Path, default=ROOT / "target/compare", help="for the triangles")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    armpose("export", options.folder)
    corners = np.fromfile(options.folder / "triangles.f32", "<f4").reshape(-1, 3)
    vertices = o3d.core.Tensor(corners)
    triangles = o3d.core.Tensor(np.arange(len(corners), dtype=np.uint32).reshape(-1, 3))
    x, y = np.meshgrid(np.arange(WIDTH, dtype=np.float32), np.arange(HEIGHT, dtype=np.float32))
    directions = np.stack([(x - WIDTH / 2) / FOCAL, (y - HEIGHT / 2) / FOCAL, np.ones_like(x)], -1).reshape(-1, 3)
    rays = o3d.core.Tensor(np.hstack([np.zeros_like(directions), directions]))
    projector = np.array([BASELINE, 0.0, 0.0], np.float32)

    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["repetition", "triangles", "armpose_ms", "open3d_ms", "ratio"])
    ratios = []
    open3d_frame(vertices, triangles, rays, projector)
    for repetition in range(options.repetitions):
        ours = statistics.median(map(float, armpose("time", options.frames).split()))
        theirs = open3d_frame(vertices, triangles, rays, projector)
        ratios.append(theirs / ours)
        table.writerow([repetition, len(corners) // 3, f"{ours:.4g}", f"{theirs:.4g}", f"{ratios[-1]:.4g}"])
        sys.stdout.flush()
    print(f"ratio,{statistics.median(ratios):.4g}")


if __name__ == "__main__":
    main()
