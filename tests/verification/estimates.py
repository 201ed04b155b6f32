#!/usr/bin/env python3
"""Which default runs have both error estimates: images of folders and bodies drawn at random, with each tool.

    estimates.py PROGRAM IMAGE_OR_FOLDER... [--random COUNT] [--tools circle,sphere:5mm] > results/estimates.csv

A row is a run without options but the tool: its force, the half-width of its error estimate or the reason why it has
none, and the half-width of the error by the image's resolution. A random body is a lump of three ellipsoids, 30 to
300 mm long and some of them flat; body N follows from N alone.
"""
import argparse
import csv
import json
import math
import os
import random
import subprocess
import sys
import tempfile
import time

READABLE = (".nrrd", ".nii.gz", ".mha", ".nii")


def random_body(path, number):
    """Writes body `number` as an NRRD label image."""
    draw = random.Random(number)
    length = 30.0 * 10.0 ** draw.uniform(0.0, 1.0)
    flat = draw.uniform(0.25, 1.0)
    voxel = length * draw.uniform(0.012, 0.04)
    half = [[length * draw.uniform(0.2, 0.35) * (flat if axis == 2 else 1.0) for axis in range(3)] for _ in range(3)]
    centre = [[length * draw.uniform(-0.15, 0.15) * (flat if axis == 2 else 1.0) for axis in range(3)] for _ in range(3)]
    count = [int(2.0 * max(abs(c[axis]) + h[axis] for c, h in zip(centre, half)) / voxel) + 5 for axis in range(3)]
    places = [[(i - 0.5 * (n - 1)) * voxel for i in range(n)] for n in count]
    voxels = bytearray()
    for z in places[2]:
        for y in places[1]:
            row = bytearray(count[0])
            for c, h in zip(centre, half):
                left = 1.0 - ((y - c[1]) / h[1]) ** 2 - ((z - c[2]) / h[2]) ** 2
                reach = h[0] * math.sqrt(left) if left > 0.0 else -1.0
                for i, x in enumerate(places[0]):
                    row[i] |= abs(x - c[0]) < reach
            voxels += row
    header = ("NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\n"
              f"sizes: {count[0]} {count[1]} {count[2]}\n"
              f"space directions: ({voxel},0,0) (0,{voxel},0) (0,0,{voxel})\nkinds: domain domain domain\n"
              "encoding: raw\nspace origin: (0,0,0)\n\n")
    with open(path, "wb") as file:
        file.write(header.encode() + voxels)


def images_of(places):
    for place in places:
        if os.path.isfile(place):
            yield place
        else:
            yield from (os.path.join(place, name) for name in sorted(os.listdir(place)) if name.endswith(READABLE))


def run(program, image, tool, folder):
    more = [] if tool == "circle" else ["--tool", tool]
    begin = time.time()
    done = subprocess.run([program, "run", image, "-o", folder, "--force", "--write", "force", "-q", *more],
                          capture_output=True, text=True, check=False)
    seconds = time.time() - begin
    try:
        with open(os.path.join(folder, "summary.json"), encoding="utf-8") as file:
            summary = json.load(file)
    except FileNotFoundError:
        return [done.returncode, "", "", "", "", done.stderr.strip().split("\n")[0], f"{seconds:.0f}"]
    band, force = summary.get("band", {}), summary.get("force_N", 0.0)
    known, image_half = "half_N" in band, summary.get("image_error", {}).get("half_N")
    return [done.returncode, summary.get("counts", {}).get("nodes", ""), force,
            f"{100.0 * band['half_N'] / force:.1f}" if known and force else "",
            f"{100.0 * image_half / force:.1f}" if image_half is not None and force else "", band.get("unknown", ""), f"{seconds:.0f}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("program")
    parser.add_argument("places", nargs="*")
    parser.add_argument("--random", type=int, default=0)
    parser.add_argument("--tools", default="circle,sphere:5mm")
    given = parser.parse_args()
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(["image", "tool", "exit_code", "nodes", "force_N", "half_width_percent", "image_half_width_percent",
                  "no_estimate", "seconds"])
    with tempfile.TemporaryDirectory() as folder:
        images = list(images_of(given.places))
        for number in range(1, given.random + 1):
            images.append(os.path.join(folder, f"random_{number:02d}.nrrd"))
            random_body(images[-1], number)
        for tool in given.tools.split(","):
            for image in images:
                out.writerow([os.path.basename(image), tool, *run(given.program, image, tool, os.path.join(folder, "out"))])
                sys.stdout.flush()


if __name__ == "__main__":
    main()
