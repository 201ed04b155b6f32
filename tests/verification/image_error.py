#!/usr/bin/python3
"""Check of the two stated errors of forces when the image's grid moves: one body segmented on four grids.

    image_error.py PROGRAM DATA calibration > results/image_error_calibration.csv
    image_error.py PROGRAM DATA proof > results/image_error_proof.csv
    image_error.py table results/image_error_*.csv

DATA: the folder with the label images. Needs numpy and scipy. 40 scenes calibrate apps/run/image_error.cpp, 20 of another seed are
the proof. Each body is known exactly (an organ: the level zero of its label's smoothed signed distance) and each scene draws a body,
a tool and a voxel; each is run on four grids whose origins are moved at random, along the approach direction by about a quarter of a voxel each,
and in the proof once more with voxels a third as long. A row is a run; `table` prints the coverage. Some ten minutes of one core for each set.
"""
import collections
import csv
import functools
import gzip
import json
import os
import random
import subprocess
import sys
import tempfile

import numpy as np
from scipy import ndimage

SEEDS = {"calibration": (1, 40), "proof": (2, 20)}
GRIDS = 4
FINER = 3.0  # times as fine: reference of the forces
DEPTH_MM = 2.0
TOOLS = {"circle": ["--indenter-diameter", "10mm"], "sphere 5": ["--tool", "sphere:5mm"], "sphere 20": ["--tool", "sphere:20mm"],
         "punch 8": ["--tool", "punch:8mm,edge=2mm"]}
ORGANS = {"heart": ("heart_ct_1.5mm.nii.gz", None, "anterior", "posterior"), "liver": ("abdomen_mr_3mm.nii.gz", 5, "anterior", "posterior"),
          "spleen": ("abdomen_mr_3mm.nii.gz", 1, "left", "right"), "stomach": ("abdomen_mr_3mm.nii.gz", 6, "anterior", "posterior"),
          "brain": ("human_brain_mri_2mm.nrrd", None, "superior", "inferior")}
IN_SET = {"calibration": ["heart", "liver", "spleen"], "proof": ["stomach", "brain", "heart", "liver"]}


# ---------------------------------------------------------------------------------------------- bodies
# A body is f(x, y, z) <= 0 [mm] within a box, pressed from above at `at`.

def inside_all(*parts):
    return functools.reduce(np.maximum, parts)


def dome(r):
    return lambda x, y, z: np.maximum(np.sqrt(x * x + y * y + z * z) - r, -z), ((-r, -r, 0), (r, r, r))


def ellipsoid(a, b, c):
    return lambda x, y, z: np.maximum((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2 - 1, -z), ((-a, -b, 0), (a, b, c))


def block(height, slope=0.0):
    top = lambda x: height + slope * x
    return (lambda x, y, z: inside_all(abs(x) - 28, abs(y) - 28, -z, z - top(x)),
            ((-28, -28, 0), (28, 28, height + 28 * slope)))


def hills(height, wave):
    top = lambda x, y: height + 2 * np.cos(x / wave) * np.cos(y / wave)
    return lambda x, y, z: inside_all(abs(x) - 28, abs(y) - 28, -z, z - top(x, y)), ((-28, -28, 0), (28, 28, height + 2))


def read_nifti(file):
    raw = gzip.open(file).read()
    shape = np.frombuffer(raw, "<i2", 3, 42)
    kind = {2: "u1", 4: "<i2", 8: "<i4", 16: "<f4", 512: "<u2", 256: "i1", 768: "<u4"}[int(np.frombuffer(raw, "<i2", 1, 70)[0])]
    spacing, offset = np.frombuffer(raw, "<f4", 3, 80), int(np.frombuffer(raw, "<f4", 1, 108)[0])
    labels = np.frombuffer(raw, kind, int(np.prod(shape.astype(int))), offset).reshape(shape, order="F")
    ras = np.frombuffer(raw, "<f4", 12, 280).reshape(3, 4)[:, :3] / spacing
    lps = np.diag([-1, -1, 1]) @ ras
    return along_lps(labels, spacing, lps)


def read_nrrd(file):
    head, raw = open(file, "rb").read().split(b"\n\n", 1)
    fields = dict(line.split(": ", 1) for line in head.decode().splitlines() if ": " in line)
    raw = gzip.decompress(raw) if fields["encoding"] == "gzip" else raw
    shape = [int(n) for n in fields["sizes"].split()]
    axes = np.array([[float(x) for x in axis.strip("()").split(",")] for axis in fields["space directions"].split()]).T
    kind = {"uint8": "u1", "unsigned char": "u1", "uchar": "u1", "short": "<i2", "int16": "<i2", "unsigned short": "<u2", "uint16": "<u2"}
    labels = np.frombuffer(raw, kind[fields["type"]]).reshape(shape, order="F")
    spacing = np.linalg.norm(axes, axis=0)
    lps = axes / spacing
    return along_lps(labels, spacing, lps if "left-posterior" in fields["space"] else np.diag([-1, -1, 1]) @ lps)


def along_lps(labels, spacing, axes):
    """The body with its axes along left, posterior, superior, as nearly as possible."""
    order = [int(np.argmax(abs(axes[row]))) for row in range(3)]
    labels = labels.transpose(order)
    for row in range(3):
        if axes[row, order[row]] < 0:
            labels = np.flip(labels, row)
    return labels, np.array(spacing)[order]


def organ(data, name):
    file, label, *_ = ORGANS[name]
    labels, spacing = (read_nifti if file.endswith("gz") else read_nrrd)(os.path.join(data, file))
    inside = labels == label if label else labels != 0
    where = ndimage.find_objects(inside)[0]
    inside = np.pad(inside[where], 4)
    inside = ndimage.label(inside)[0]
    inside = inside == np.argmax(np.bincount(inside.ravel())[1:]) + 1
    signed = ndimage.distance_transform_edt(~inside, sampling=spacing) - ndimage.distance_transform_edt(inside, sampling=spacing)
    signed = ndimage.gaussian_filter(signed, 1.0)
    size = (np.array(inside.shape) - 1) * spacing

    def f(x, y, z):
        where = [c / h for c, h in zip(np.broadcast_arrays(x, y, z), spacing)]
        return ndimage.map_coordinates(signed, where, order=3, mode="nearest")

    return f, (np.zeros(3) + 2 * spacing, size - 2 * spacing)


def scenes(which, data):
    """Scenes: name, f, box, tool, voxel, options of the place."""
    seed, count = SEEDS[which]
    draw = random.Random(seed)
    above = ["--base", "inferior", "--indent-at"]
    for number in range(count):
        tool, size = draw.choice(sorted(TOOLS)), draw.choice(["fine", "middle", "coarse"])
        kind = draw.choice(["dome", "dome", "ellipsoid", "block", "plate", "slope", "hills", "organ", "organ"] if which == "calibration"
                           else ["dome", "ellipsoid", "organ", "organ"])
        if kind == "organ":
            name = draw.choice(IN_SET[which])
            yield (name, *organ(data, name), tool, {"fine": 1.5, "middle": 2.2, "coarse": 3.0}[size], ORGANS[name])
            continue
        at = f"{draw.uniform(-4, 4):.1f},{draw.uniform(-4, 4):.1f},top"
        if kind == "dome":
            r = round(draw.uniform(14, 36), 1)
            name, body = f"dome {r}", dome(r)
        elif kind == "ellipsoid":
            a, b, c = (round(draw.uniform(*range_), 1) for range_ in ((18, 36), (18, 36), (10, 24)))
            name, body = f"ellipsoid {a} {b} {c}", ellipsoid(a, b, c)
        elif kind == "hills":
            wave = round(draw.uniform(6, 14), 1)
            name, body = f"hills {wave}", hills(18, wave)
        else:
            h = round(draw.uniform(*{"block": (15, 30), "plate": (6, 12), "slope": (12, 20)}[kind]), 1)
            name, body = f"{kind} {h}", block(h, round(draw.uniform(0.05, 0.3), 2) if kind == "slope" else 0.0)
        yield name, *body, tool, {"fine": 1.0, "middle": 1.5, "coarse": 2.2}[size], [*above, at]


# ------------------------------------------------------------------------------------------------ runs

def write_image(file, f, box, voxel, moved):
    """Writes a label image whose voxel centres are moved by a part of a voxel."""
    low = np.array(box[0], float) - voxel * (2 + np.array(moved))
    count = [int(np.ceil((h - l) / voxel)) + 3 for l, h in zip(low, box[1])]
    x, y, z = (l + voxel * np.arange(n) for l, n in zip(low, count))
    labels = (f(x[:, None, None], y[None, :, None], z[None, None, :]) <= 0).astype("u1")
    with open(file, "wb") as out:
        out.write((f"NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {count[0]} {count[1]} {count[2]}\n"
                   f"space directions: ({voxel},0,0) (0,{voxel},0) (0,0,{voxel})\nkinds: domain domain domain\nendian: little\n"
                   f"encoding: raw\nspace origin: ({low[0]},{low[1]},{low[2]})\n\n").encode() + labels.tobytes(order="F"))


def run(program, image, folder, options):
    words = [program, "run", image, "-o", folder, "--force", "--frames", "1", "--write", "force", "-q", "--depth", f"{DEPTH_MM}mm",
             *options]
    done = subprocess.run(words, timeout=600, capture_output=True, text=True)
    if done.returncode:
        print(" ".join(words), done.stderr, file=sys.stderr)
        return None
    with open(os.path.join(folder, "summary.json")) as file:
        return json.load(file)


def at_place_of(program, f, box, voxel, sides, folder):
    """Options that fix tool and base where the program finds them on one grid, for use on all grids."""
    image = os.path.join(folder, "o.nrrd")
    write_image(image, f, box, voxel, (0, 0, 0))
    base, at = sides[3], sides[2]
    found = run(program, image, os.path.join(folder, "p"), ["--nodes", "1500", "--band", "off", "--base", base, "--indent-at", at])
    x, push = found["counts"]["circle_centre_mm"], found["counts"]["push"]
    return ["--base", base, "--indent-at", ",".join(f"{c:.3f}" for c in x), "--direction", ",".join(f"{c:.4f}" for c in push)]


def main(program, data, which):
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(["scene", "body", "tool", "voxel_mm", "moved_x", "moved_y", "moved_z", "force_N", "discretisation_N", "image_N",
                  "shape_N", "thickness_N", "warned"])
    draw = random.Random(100 + SEEDS[which][0])
    for number, (body, f, box, tool, voxel, place) in enumerate(scenes(which, data)):
        with tempfile.TemporaryDirectory() as folder:
            if body in ORGANS:
                place = at_place_of(program, f, box, voxel, place, folder)
            turn = [draw.random() for _ in range(3)]
            grids = [(voxel, [(turn[0] + k / GRIDS) % 1, (turn[1] + 0.5 * k + draw.uniform(0, 0.5)) % 1, (turn[2] + k / GRIDS) % 1])
                     for k in range(GRIDS)] + [(voxel / FINER, turn)] * (which == "proof")
            for size, moved in grids:
                image = os.path.join(folder, "i.nrrd")
                write_image(image, f, box, size, moved)
                band = "on" if size == voxel else "off"
                s = run(program, image, os.path.join(folder, "r"), ["--nodes", "1500", "--band", band, *TOOLS[tool], *place])
                row = [number, body, tool, f"{size:.4g}", *(f"{m:.3f}" for m in moved)]
                if s:
                    error = s.get("image_error", {})
                    row += [f"{s['force_N']:.6g}", *(f"{x:.4g}" if x is not None else "" for x in (
                        s["band"].get("half_N"), error.get("half_N"), error.get("shape_N"), error.get("thickness_N"))),
                        "yes" if any("[image-resolution]" in w for w in s["warnings"]) else "no"]
                out.writerow(row)
                sys.stdout.flush()


# ----------------------------------------------------------------------------------------------- table

def table(files):
    """Table by set: number of forces within the two stated errors, and width of these compared with the scatter."""
    print("| set | scenes | forces | within both errors of the mean | within both of the finer image | "
          "mean scatter | mean image error | mean error of the discretisation | warned |")
    print("|---|---|---|---|---|---|---|---|---|")
    for file in files:
        by_scene = collections.defaultdict(list)
        for row in csv.DictReader(open(file)):
            by_scene[row["scene"]].append(row)
        off_mean, off_finer, scatter, image, nodes, warned = [], [], [], [], [], 0
        for rows in by_scene.values():
            rows = [r for r in rows if r["force_N"]]
            coarsest = max(float(r["voxel_mm"]) for r in rows)
            grids = [r for r in rows if float(r["voxel_mm"]) == coarsest]
            finer = [float(r["force_N"]) for r in rows if float(r["voxel_mm"]) < coarsest]
            mean = sum(float(r["force_N"]) for r in grids) / len(grids)
            for r in grids:
                force, of_nodes, of_image = float(r["force_N"]), float(r["discretisation_N"] or 0), float(r["image_N"] or 0)
                off_mean.append(abs(force - mean) <= of_nodes + of_image)
                if finer:
                    off_finer.append(abs(force - finer[0]) <= of_nodes + of_image)
                if of_nodes:
                    nodes.append(of_nodes / force)
                image.append(of_image / force)
                warned += r["warned"] == "yes"
            scatter.append(max(abs(float(r["force_N"]) / mean - 1) for r in grids))
        share = lambda hits: f"{sum(hits)} of {len(hits)}, {100 * sum(hits) / max(len(hits), 1):.0f} %"
        mean_of = lambda x: f"{100 * sum(x) / max(len(x), 1):.2f} %"
        name = os.path.basename(file).removeprefix("image_error_").removesuffix(".csv")
        print(f"| {name} | {len(by_scene)} | {len(off_mean)} | {share(off_mean)} | {share(off_finer) if off_finer else '-'} | {mean_of(scatter)} | "
              f"{mean_of(image)} | {mean_of(nodes)} | {warned} |")


if __name__ == "__main__":
    if len(sys.argv) > 2 and sys.argv[1] == "table":
        table(sys.argv[2:])
    elif len(sys.argv) == 4 and sys.argv[3] in SEEDS:
        main(*sys.argv[1:])
    else:
        sys.exit(__doc__)
