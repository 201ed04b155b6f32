"""Growth of run time and memory with the number of nodes, on a block of 60 x 60 x 30 mm at 1 mm: whole runs of the program, one
after the other.

    python3 tests/bench/scaling.py build/release/dimple tests/bench/results [NODES ...]

Writes scaling.csv and scaling.svg there. Takes some five minutes on an otherwise idle machine.
"""

import csv
import json
import os
import resource
import subprocess
import sys
import tempfile

import numpy as np
from fair_peer import pyplot

THREADS = 2
COLUMNS = ["nodes", "integration_points", "preprocess_s", "quasi_static_s", "evaluations", "peak_MB", "explicit_step_us", "explicit_s_per_s"]


def summary_of(program, folder, *words):
    out = os.path.join(folder, "out")
    subprocess.run([program, "run", os.path.join(folder, "block.nrrd"), "-o", out, "--force", "-q", "--band", "off",
                    "--threads", str(THREADS), *words], check=True)
    with open(os.path.join(out, "summary.json"), encoding="utf-8") as file:
        return json.load(file)


def measure(program, folder, nodes):
    still = summary_of(program, folder, "--nodes", str(nodes), "--frames", "2", "--depth", "2mm")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024  # the largest so far: sizes grow
    moving = summary_of(program, folder, "--nodes", str(nodes), "--frames", "1", "--depth", "0.16mm", "--time", "explicit",
                        "--scheme", "horton2007")
    build = sum(seconds for stage, seconds in still["preprocess_wall_s"].items() if stage != "read")
    step = moving["time_step_s"]
    return [still["counts"]["nodes"], still["counts"]["integration_points"], build, still["solve_wall_s"], still["force_evaluations"],
            peak, 1e6 * step, 1e-3 * moving["ms_per_step"] / step]


def draw(rows, results):
    plt, of = pyplot(), dict(zip(COLUMNS, np.array(rows, float).T))
    figure, (times, memory) = plt.subplots(1, 2, figsize=(13, 5.5), constrained_layout=True)
    both = of["preprocess_s"] + of["quasi_static_s"]
    lines = [(times, "preprocessing", of["preprocess_s"]), (times, "equilibrium at 1 and 2 mm", of["quasi_static_s"]),
             (times, "both", both), (times, "horton2007, a second of central differences", of["explicit_s_per_s"]),
             (memory, "peak memory of the run", of["peak_MB"])]
    for axes, name, y in lines:
        exponent = np.polyfit(np.log(of["nodes"]), np.log(y), 1)[0]
        axes.loglog(of["nodes"], y, marker="o", label=f"{name}: N^{exponent:.2f}")
    times.set(xlabel="nodes", ylabel="wall time [s]", title=f"block, {THREADS} threads")
    memory.set(xlabel="nodes", ylabel="peak memory [MB]", title="the whole run, converging, quasi-static")
    for axes in (times, memory):
        axes.grid(True, alpha=0.2)
        axes.legend()
    figure.savefig(os.path.join(results, "scaling.svg"), metadata={"Date": None})


def main(program, results, *sizes):
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([program, "phantom", os.path.join(folder, "block.nrrd"), "--shape", "block", "--size", "60,60,30",
                        "--spacing", "1", "-q"], check=True)
        for nodes in map(int, sizes or (2000, 4250, 8500, 17000, 34000, 100000)):
            rows.append(measure(program, folder, nodes))
            print(*rows[-1], sep=", ", flush=True)
    with open(os.path.join(results, "scaling.csv"), "w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
    draw(rows, results)


if __name__ == "__main__":
    main(*sys.argv[1:]) if len(sys.argv) > 2 else sys.exit(__doc__)
