"""Writes the scenes of the benchmark: of each the body as body.stl and as label image body.nrrd, and scene.json.

    python3 tests/benchmark/make_scenes.py OUT [SCENE ...]

The body's axis is z. Its base is at z = 0, the middle of its top at (0, 0, height_mm), from where the tool moves along -z.
"""

import gzip
import json
import math
import os
import struct
import sys

SCENES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "scenes.json")
SIDES = 240      # of the polygon that approximates a cylinder in the STL file
VOXELS = 1.0     # mm: edge length
MARGIN = 2       # voxels of background around the body


def outline(body):
    """Corners of the body's section, counterclockwise [mm]."""
    half = 0.5 * body["width_mm"]
    if body["shape"] == "block":
        return [(-half, -half), (half, -half), (half, half), (-half, half)]
    angles = [2 * math.pi * k / SIDES for k in range(SIDES)]
    return [(half * math.cos(a), half * math.sin(a)) for a in angles]


def write_stl(path, body):
    corners, top = outline(body), body["height_mm"]
    triangles = []
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1]):
        a, b, c, d = (ax, ay, 0), (bx, by, 0), (bx, by, top), (ax, ay, top)
        triangles += [(a, b, c), (a, c, d), (d, c, (0, 0, top)), (b, a, (0, 0, 0))]
    with open(path, "wb") as file:
        file.write(b"body [mm]".ljust(80) + struct.pack("<I", len(triangles)))
        for corner in triangles:
            file.write(struct.pack("<12fH", 0, 0, 0, *(x for point in corner for x in point), 0))


def write_image(path, body):
    """Label 1 where a voxel's centre is in the body."""
    half, height = 0.5 * body["width_mm"], body["height_mm"]
    across, up = (round(length / VOXELS) + 2 * MARGIN for length in (2 * half, height))
    at = [(k + 0.5 - MARGIN) * VOXELS for k in range(max(across, up))]
    inside = (lambda x, y: max(abs(x), abs(y)) < half) if body["shape"] == "block" else (lambda x, y: math.hypot(x, y) < half)
    slice_ = bytes(inside(at[i] - half, at[j] - half) for j in range(across) for i in range(across))
    voxels = b"".join(slice_ if 0 < at[k] < height else bytes(len(slice_)) for k in range(up))
    header = (f"NRRD0004\ntype: unsigned char\ndimension: 3\nspace: left-posterior-superior\nsizes: {across} {across} {up}\n"
              f"space directions: ({VOXELS},0,0) (0,{VOXELS},0) (0,0,{VOXELS})\nkinds: domain domain domain\nencoding: gzip\n"
              f"space origin: ({at[0] - half},{at[0] - half},{at[0]})\n\n")
    with open(path, "wb") as file:
        file.write(header.encode() + gzip.compress(voxels, mtime=0))


def make_scenes(out, names=()):
    """Writes the scenes and returns them."""
    with open(SCENES) as file:
        scenes = [scene for scene in json.load(file) if not names or scene["name"] in names]
    for scene in scenes:
        folder = os.path.join(out, scene["name"])
        os.makedirs(folder, exist_ok=True)
        write_stl(os.path.join(folder, "body.stl"), scene["body"])
        write_image(os.path.join(folder, "body.nrrd"), scene["body"])
        with open(os.path.join(folder, "scene.json"), "w") as file:
            json.dump(scene, file, indent=1)
    return scenes


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    make_scenes(sys.argv[1], sys.argv[2:])
