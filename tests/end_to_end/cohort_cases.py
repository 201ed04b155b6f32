"""Twenty cases for the tests of cohorts, three of them broken, and the comparison of two runs of them.

Used by cohort_slurm and cohort_snakemake. Each prints a sentence that begins with "Skipped:" if a program is not
installed.
"""

import csv
import os
import subprocess
import sys
import time

SLOW = "sub-07"  # marches for seconds, so that it can be killed half-way
BROKEN = {"sub-04": "No such file", "sub-09": "soft", "sub-15": "sub-15.nrrd"}
ROWS = 20
DEPTHS = "2mm,3mm"


def skip_without(*programs):
    for program in programs:
        folders = os.environ["PATH"].split(os.pathsep) + ["/usr/sbin", "/sbin"]
        if not any(os.access(os.path.join(folder, program), os.X_OK) for folder in folders):
            print(f"Skipped: {program} is not installed (Debian: slurm-wlm, munge, snakemake)")
            sys.exit(0)


def run(arguments, folder, limit_s=120, code=0, **how):
    """Runs a program to its end; `code`: required exit code, None: any."""
    done = subprocess.run(arguments, cwd=folder, timeout=limit_s, text=True, capture_output=True, **how)
    if code is not None and done.returncode != code:
        sys.exit(f"{' '.join(arguments)} returned {done.returncode}, not {code}:\n{done.stdout}\n{done.stderr}")
    return done


def wait_for(what, condition, limit_s=60):
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.1)
    sys.exit(f"waited {limit_s} s in vain for {what}")


def make(dimple, folder):
    """Makes images/ and cases.csv in the folder."""
    os.makedirs(os.path.join(folder, "images"))
    run([dimple, "phantom", "images/brain.nrrd", "--spacing", "3", "-q"], folder)
    run([dimple, "phantom", "images/block.nrrd", "--shape", "block", "--size", "60,60,30", "--spacing", "3", "-q"], folder)
    with open(os.path.join(folder, "images", "sub-15.nrrd"), "w", encoding="utf-8") as file:
        file.write("these are words\n")
    with open(os.path.join(folder, "cases.csv"), "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(["id", "image", "mu_Pa", "depth", "nodes", "frames", "write"])
        for n in range(1, ROWS + 1):
            case = f"sub-{n:02}"
            image = {"sub-04": "nowhere", "sub-15": "sub-15"}.get(case, "brain" if n % 2 else "block")
            mu = "soft" if case == "sub-09" else 200 + 10 * n
            table.writerow([case, f"images/{image}.nrrd", mu, "3mm", 400 + 10 * n, 200 if case == SLOW else 4, "force"])


def collected(dimple, folder, out):
    """Table of a folder without the times, by id."""
    text = run([dimple, "collect", out, "--cases", "cases.csv", "--depths", DEPTHS, "-q"], folder).stdout
    rows = {}
    for row in csv.DictReader(text.splitlines()):
        del row["total_s"]
        rows[row["id"]] = row
    return rows


def expect_same(dimple, folder, ours, theirs):
    """Expects equal contents of two folders: 17 results, bit for bit, and 3 errors with their reasons."""
    here, there = collected(dimple, folder, ours), collected(dimple, folder, theirs)
    wrong = [f"{id}: {here.get(id)}\n   {there.get(id)}" for id in sorted({*here, *there}) if here.get(id) != there.get(id)]
    finished = [id for id, row in there.items() if row["status"] == "finished"]
    if len(there) != ROWS or len(finished) != ROWS - len(BROKEN):
        wrong.append(f"{len(there)} cases, {len(finished)} finished")
    for id, words in BROKEN.items():
        if there[id]["status"] != "failed" or words not in there[id]["fact"] or not there[id]["code"]:
            wrong.append(f"{id} does not say '{words}': {there[id]}")
    for id in finished:
        forces = [open(os.path.join(folder, out, id, "force.csv"), "rb").read() for out in (ours, theirs)]
        if forces[0] != forces[1]:
            wrong.append(f"{id}: force.csv differs")
    if wrong:
        sys.exit("the two ways differ:\n" + "\n".join(wrong))
    print(f"{len(finished)} results with the same bits, {len(BROKEN)} errors with the same words")
