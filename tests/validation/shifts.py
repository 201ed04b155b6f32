"""Brain shift in whole heads, and its error bounds.

    python3 tests/validation/shifts.py build/release/dimple HEADS TABLE.csv 03 04 05

HEADS is the folder data/training_label_maps of SynthSeg (github.com/BBillot/SynthSeg, Apache-2.0): training_seg_01.nii.gz
to training_seg_20.nii.gz, label images of whole heads, 1 mm. Brain is every label below 200 but 24 (fluid), skull the labels
515 and 516. Each head is opened at three places, which are then uppermost, and loses 60 % of the fluid.

A row is a run with 4000 nodes (`seed`): its largest shift at the opening, its error bounds, the change by half as
many nodes (largest of the shift and the displacements along the line into the brain), and the difference from 16,000
nodes. Needs numpy.
"""

import csv
import gzip
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

import numpy

OPENINGS = {  # from the brain's middle, LPS; up
    "frontal": ((0.55, -0.55, 0.63), "anterior"),
    "temporal": ((0.95, -0.10, 0.30), "left"),
    "occipital": ((0.30, 0.85, 0.30), "posterior"),
}
RADIUS_MM, NODES, REFERENCE, SEEDS, FLUID = 25, 4000, 16000, (1, 2), 24


def labels_and_places(image):
    data = gzip.open(image).read()
    nx, ny, nz = struct.unpack("<3h", data[42:48])
    kind = {4: "<i2", 8: "<i4", 16: "<f4", 512: "<u2"}[struct.unpack("<h", data[70:72])[0]]
    first = int(struct.unpack("<f", data[108:112])[0])
    label = numpy.frombuffer(data, kind, nx * ny * nz, first).reshape(nz, ny, nx).astype(int)
    to_ras = numpy.array(struct.unpack("<12f", data[280:328])).reshape(3, 4)
    return label, to_ras * numpy.array([[-1], [-1], [1]])


def scenes_of(image):
    label, to_lps = labels_and_places(image)
    brain = (label > 0) & (label < 200) & (label != FLUID)
    k, j, i = numpy.where(brain)
    place = to_lps[:, :3] @ numpy.vstack([i, j, k]) + to_lps[:, 3:4]
    middle = place.mean(axis=1)
    names = ",".join(str(v) for v in numpy.unique(label[brain]))
    for name, (way, up) in OPENINGS.items():
        way = numpy.array(way) / numpy.linalg.norm(way)
        along = way @ (place - middle[:, None])
        beside = numpy.linalg.norm(place - middle[:, None] - numpy.outer(way, along), axis=0)
        at = middle + along[beside < 3].max() * way
        yield name, up, names, ",".join(f"{x:.1f}" for x in (*at, RADIUS_MM))


def shift(program, image, brain, opening, up, nodes, seed, band):
    """Largest shift at the opening, displacements along the line [n x 3] and half-width of the error bounds; mm."""
    with tempfile.TemporaryDirectory() as folder:
        words = [program, "shift", image, "-o", folder + "/out", "-q", "--tables", "--brain", brain, "--skull", "515,516",
                 "--opening=" + opening, "--up", up, "--nodes", str(nodes), "--set", f"cloud.seed={seed}", "--set", "accuracy.band=" + band]
        if subprocess.run(words, capture_output=True).returncode != 0:
            return None
        told = json.loads(pathlib.Path(folder, "out", "summary.json").read_text())["shift"]
    return told["largest_at_opening_mm"], numpy.array([p["components_mm"] for p in told["profile"]]), told["band_mm"]


def apart(a, b):
    return max(abs(a[0] - b[0]), numpy.linalg.norm(a[1] - b[1], axis=1).max())


def rows_of(program, image, opening, up, brain, at):
    fine = shift(program, image, brain, at, up, REFERENCE, 1, "off")
    for seed in SEEDS:
        here, coarse = (shift(program, image, brain, at, up, n, seed, band) for n, band in ((NODES, "on"), (NODES // 2, "off")))
        row = {"image": image.name.split(".")[0], "opening": opening, "at_mm": at.replace(",", " "), "up": up, "seed": seed}
        if here:
            row |= {"largest_at_opening_mm": here[0], "band_mm": here[2] if here[2] else "unknown"}
        if here and coarse:
            row["change_mm"] = apart(here, coarse)
        if here and fine:
            row |= {"error_mm": apart(here, fine), "inside": "" if here[2] is None else int(apart(here, fine) <= here[2])}
        if fine:
            row["reference_mm"] = fine[0]
        yield {key: round(value, 3) if isinstance(value, float) else value for key, value in row.items()}


def main(program, heads, table, *which):
    header = ["image", "opening", "at_mm", "up", "seed", "largest_at_opening_mm", "band_mm", "change_mm", "error_mm", "reference_mm",
              "inside"]
    with open(table, "w", newline="") as file:
        writer = csv.DictWriter(file, header, restval="", lineterminator="\n")
        writer.writeheader()
        for head in which:
            image = pathlib.Path(heads, f"training_seg_{head}.nii.gz").resolve()
            for opening, up, brain, at in scenes_of(image):
                for row in rows_of(program, image, opening, up, brain, at):
                    writer.writerow(row)
                    file.flush()
                    print(row, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
