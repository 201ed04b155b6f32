"""Error bounds of folded bodies whose folds are in contact: brains as segmented, sulci open.

    python3 tests/validation/folds.py build/release/dimple HEADS TABLE.csv 11 12 13

HEADS is the folder data/training_label_maps of SynthSeg (github.com/BBillot/SynthSeg, Apache-2.0): training_seg_01.nii.gz
to training_seg_20.nii.gz, label images of whole heads, 1 mm. The brain is every label below 200 but 24 (fluid). A bonded patch
of 10 mm presses 8 mm deep, opposite to the base; each of two sides is the base in turn.

A row is a run with the default of 4000 nodes for such a body (`seed`), with its error bounds; `reference_mN` is the mean
of two runs with 16,000 nodes, `doubt_mN` half of their difference, `passing_mN` the force where folds pass through each other
(16,000 nodes). Needs numpy.
"""

import csv
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy

from shifts import FLUID, labels_and_places

HELD = "posterior", "right"  # sides
SEEDS, REFERENCE = (1, 2), 16000


def brain_of(image):
    label, _ = labels_and_places(image)
    return ",".join(str(v) for v in numpy.unique(label[(label > 0) & (label < 200) & (label != FLUID)]))


def press(program, image, names, held, *options):
    with tempfile.TemporaryDirectory() as folder:
        words = [program, "run", image, "-o", folder + "/out", "-q", "--write", "force", "--label", names, "--base", held, *options]
        ran = subprocess.run(words, capture_output=True, text=True)
        if ran.returncode != 0:
            return None, next((line for line in ran.stderr.splitlines() if line.startswith("dimple:")), "")
        return json.loads(pathlib.Path(folder, "out", "summary.json").read_text()), ""


def rows_of(program, image, names, held):
    fine = [press(program, image, names, held, "--nodes", str(REFERENCE), "--band", "off", "--set", f"cloud.seed={s}") for s in SEEDS]
    passing, _ = press(program, image, names, held, "--nodes", str(REFERENCE), "--band", "off", "--self-contact", "off")
    for seed in SEEDS:
        row = {"image": image.name.split(".")[0], "held": held, "seed": seed}
        here, why = press(program, image, names, held, "--set", f"cloud.seed={seed}")
        if here:
            row |= {"force_mN": 1e3 * here["force_N"], "touching": here["self_contact"]["places_that_touch"]}
            why = here["band"].get("unknown", "")
            if not why:
                row |= {"low_mN": 1e3 * here["band"]["low_N"], "high_mN": 1e3 * here["band"]["high_N"]}
        if fine[0][0] and fine[1][0]:
            known = [1e3 * one["force_N"] for one, _ in fine]
            row |= {"reference_mN": sum(known) / 2, "doubt_mN": abs(known[0] - known[1]) / 2}
        if passing:
            row["passing_mN"] = 1e3 * passing["force_N"]
        row["reason"] = why or fine[0][1] or fine[1][1]
        yield {key: round(value, 3) if isinstance(value, float) else value for key, value in row.items()}


def main(program, heads, table, *which):
    header = ["image", "held", "seed", "force_mN", "low_mN", "high_mN", "reference_mN", "doubt_mN", "passing_mN", "touching",
              "reason"]
    with open(table, "w", newline="") as file:
        writer = csv.DictWriter(file, header, restval="", lineterminator="\n")
        writer.writeheader()
        for head in which:
            image = pathlib.Path(heads, f"training_seg_{head}.nii.gz").resolve()
            names = brain_of(image)
            for held in HELD:
                for row in rows_of(program, image, names, held):
                    writer.writerow(row)
                    file.flush()
                    print(row, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
