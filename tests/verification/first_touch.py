#!/usr/bin/env python3
"""Whether tools find their first touch of organs, whatever the cloud: to 0.8 radii, or as deep as is asked.

    first_touch.py PROGRAM DATA [DEPTH_IN_RADII [IMAGE...]] > results/first_touch.csv  (many minutes)

DATA: the folder with the label images. Tools stand where the program puts them by itself.
"""
import csv
import json
import os
import subprocess
import sys
import tempfile

IMAGES = {"heart": ["heart_ct_1.5mm.nii.gz"], "liver": ["abdomen_mr_3mm.nii.gz", "--label", "5"],
          "lung": ["lung_ct_aniso.mha"], "brain": ["human_brain_mri_2mm.nrrd"], "chest": ["chest_ct_10mm.seg.nrrd"]}
TOOLS = {"sphere:2mm": 2, "sphere:5mm": 5, "sphere:10mm": 10, "punch:5mm,edge=1mm": 5, "capsule:2mm,length=20mm": 2}
CLOUDS = [(750, 1), (750, 2), (1500, 1), (1500, 2), (4000, 1)]


def main(program, data, radii=0.8, *images):
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(["image", "tool", "nodes", "seed", "exit_code", "code", "depth_mm", "force_N"])
    for image, files in IMAGES.items():
        if images and image not in images:
            continue
        for tool, radius in TOOLS.items():
            for nodes, seed in CLOUDS:
                with tempfile.TemporaryDirectory() as folder:
                    done = subprocess.run(
                        [program, "run", os.path.join(data, files[0]), *files[1:], "--tool", tool, "-o", folder + "/a", "--write", "force",
                         "-q", "--nodes", str(nodes), "--depth", f"{float(radii) * radius}mm", "--set", f"cloud.seed={seed}",
                         "--set", "accuracy.band=off"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                    summary, rows = {}, []
                    if os.path.exists(folder + "/a/summary.json"):
                        summary = json.load(open(folder + "/a/summary.json"))
                    if os.path.exists(folder + "/a/force.csv"):
                        rows = list(csv.DictReader(open(folder + "/a/force.csv")))
                last = rows[-1] if rows else {"indentation_mm": "", "force_N": ""}
                out.writerow([image, tool, nodes, seed, done.returncode, summary.get("failure", {}).get("code", "finished"),
                              last["indentation_mm"], last["force_N"]])
                sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
