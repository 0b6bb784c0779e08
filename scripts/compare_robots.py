"""Compares how armpose reads robots with how trimesh, pycollada and yourdfpy read them.

    pip install -r scripts/requirements.txt
    python scripts/compare_robots.py FOLDER > robots.csv

Every URDF below FOLDER is read by `armpose robot inspect --json` and by yourdfpy; poses are those with all
joints at 0. Of each link the bounding box of its visuals (or collision shapes, where it has none), their area
and their number of triangles are compared in the link's frame. pycollada reads coordinates without the unit
of the file, so that is applied here; triangles that name one position twice do not count. Boxes, cylinders and
spheres are compared by their boxes only: they are cut into triangles differently.

Differences above a micrometre get a reason where one is known, else "differs". A robot that armpose refuses
is listed with its message.
"""

import argparse
import csv
import json
import pathlib
import re
import subprocess
import sys

import numpy as np
import trimesh
import yourdfpy

ROOT = pathlib.Path(__file__).resolve().parent.parent
TOLERANCE = 1e-6
COLUMNS = ["robot", "links", "meshes", "pose_m", "bounds_m", "area", "triangles", "outcome"]


def find(name, urdf):
    """The file that a mesh's name stands for: as written, or in the package's folder above the URDF."""
    scheme, _, path = name.rpartition("://")
    if scheme not in ("package", "model"):
        return urdf.parent / path
    for above in urdf.parents:
        for candidate in (above / path, above / path.partition("/")[2]):
            if candidate.is_file():
                return candidate
    raise FileNotFoundError(name)


def read_mesh(path):
    """Vertices and triangles, each instance of a scene where its nodes put it."""
    scene = trimesh.load(path, force="scene", process=False)
    unit = 1.0
    if path.suffix.lower() == ".dae":
        found = re.search(r'<unit[^>]*meter="([^"]*)"', path.read_text(errors="replace")[:20000])
        unit = float(found.group(1)) if found else 1.0
    vertices, triangles = [np.zeros((0, 3))], [np.zeros((0, 3), int)]
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        geometry = scene.geometry[geometry]
        if not isinstance(geometry, trimesh.Trimesh):
            continue
        triangles.append(geometry.faces + sum(map(len, vertices)))
        vertices.append(trimesh.transform_points(geometry.vertices, matrix) * unit)
    return np.vstack(vertices), np.vstack(triangles)


def read_shape(shape, urdf):
    """Vertices in the link's frame, triangles, and whether these are those of a file."""
    geometry, pose = shape.geometry, np.eye(4) if shape.origin is None else shape.origin
    is_mesh = geometry.mesh is not None
    if is_mesh:
        vertices, triangles = read_mesh(find(geometry.mesh.filename, urdf))
        scale = 1.0 if geometry.mesh.scale is None else np.asarray(geometry.mesh.scale)
        vertices = vertices * scale
    else:
        if geometry.box is not None:
            solid = trimesh.creation.box(geometry.box.size)
        elif geometry.cylinder is not None:
            solid = trimesh.creation.cylinder(geometry.cylinder.radius, geometry.cylinder.length, sections=48)
        else:
            radius = geometry.sphere.radius
            solid = trimesh.creation.box([2 * radius] * 3)
        vertices, triangles = solid.vertices, solid.faces
    return trimesh.transform_points(vertices, pose), triangles, is_mesh


def cleaned(vertices, triangles):
    """The corners of the triangles that have three different ones, at the precision of a float."""
    corners = vertices.astype(np.float32)[triangles]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    equal = (a == b).all(1) | (b == c).all(1) | (c == a).all(1)
    return vertices[triangles][~equal]


def compare(path, ours, table):
    robot = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    names = {joint.name: 0.0 for joint in robot.robot.joints if joint.name in robot.actuated_joint_names}
    robot.update_cfg(names)
    links = {link["name"]: link for link in ours["links"]}
    worst = {"pose_m": 0.0, "bounds_m": 0.0, "area": 0.0, "triangles": 0}
    reasons, meshes = set(), 0
    root = ours["joints"][0]["parent"] if ours["joints"] else ours["links"][0]["name"]
    followers = any(joint["mimic"] and joint["mimic"]["offset"] for joint in ours["joints"])
    for link in robot.robot.links:
        our = links[link.name]
        pose = robot.get_transform(link.name, root)
        difference = np.abs(pose - np.array(our["pose"])).max()
        worst["pose_m"] = max(worst["pose_m"], difference)
        if difference > TOLERANCE:
            reasons.add("yourdfpy moves mimics by their offset" if followers else "poses differ")
        shapes = link.visuals or link.collisions
        noted = [note for note in ours["notes"] if f'link "{link.name}"' in note]
        if noted:
            reasons.add(f"noted: {noted[0][:150]}")
            continue
        read = [read_shape(shape, path) for shape in shapes]
        meshes += sum(is_mesh for _, _, is_mesh in read)
        empty = [shape for shape, (_, triangles, _) in zip(shapes, read) if not len(triangles)]
        if empty:
            reasons.add(f"trimesh reads no triangles of {pathlib.PurePath(empty[0].geometry.mesh.filename).name}")
            continue
        corners = [cleaned(vertices, triangles) for vertices, triangles, _ in read]
        if not read:
            assert our["bounds"] is None, link.name
            continue
        points = np.vstack([c.reshape(-1, 3) for c in corners])
        bounds = np.abs(np.array([points.min(0), points.max(0)]) - our["bounds"]).max()
        round_ones = any(s.geometry.sphere or s.geometry.cylinder for s in shapes)
        worst["bounds_m"] = max(worst["bounds_m"], bounds)
        if bounds > TOLERANCE:
            reasons.add(f"bounds of {link.name} differ" + (" (round shape)" if round_ones else ""))
        if not all(is_mesh for _, _, is_mesh in read):
            continue
        area = sum(np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum() / 2 for c in corners)
        area_difference = abs(area - our["area"]) / max(area, 1e-12)
        count = abs(sum(map(len, corners)) - our["triangles"])
        worst["area"] = max(worst["area"], area_difference)
        worst["triangles"] = max(worst["triangles"], count)
        if count:
            reasons.add(f"triangles of {link.name} differ ({sum(map(len, corners))} against {our['triangles']})")
        elif area_difference > 1e-5 and area > our["area"]:
            reasons.add("trimesh cuts polygons with hollow corners into triangles that overlap")
        elif area_difference > 1e-5:
            reasons.add(f"area of {link.name} differs")
    outcome = "; ".join(sorted(reasons)) or "same"
    numbers = [f"{worst[column]:.2g}" for column in ("pose_m", "bounds_m", "area", "triangles")]
    table.writerow([path.name, len(links), meshes, *numbers, outcome])
    return "same" if outcome == "same" else "with a reason"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--armpose", default=ROOT / "target/debug/armpose", help="the program")
    options = parser.parse_args()
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(COLUMNS)
    counts = {}
    for path in sorted(options.folder.resolve().rglob("*.urdf")):
        command = [str(options.armpose), "robot", "inspect", "--json", str(path)]
        result = subprocess.run(command, capture_output=True, text=True)
        if result.returncode == 2:
            outcome = "refused"
            table.writerow([path.name, "", "", "", "", "", "", "refused: " + result.stderr.strip()])
        elif result.returncode:
            outcome = "failed"
            table.writerow([path.name, "", "", "", "", "", "", "failed: " + result.stderr.strip()])
        else:
            try:
                outcome = compare(path, json.loads(result.stdout), table)
            except Exception as error:
                outcome = "not comparable"
                reason = f"the other readers fail: {type(error).__name__}: {error}"
                table.writerow([path.name, "", "", "", "", "", "", " ".join(reason.split())])
        counts[outcome] = counts.get(outcome, 0) + 1
        sys.stdout.flush()
    print(f"{sum(counts.values())} URDF files: {counts}", file=sys.stderr)


if __name__ == "__main__":
    main()
