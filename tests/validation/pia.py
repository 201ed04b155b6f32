"""Stiffness of a pia that would explain the experiment: the phantom brain's force under films of increasing stiffness.

    tests/validation/pia.py build/release/dimple tests/verification/results/pia

Each film is 0.1 mm thick, wrinkles, and covers all of the organ; the tool is bonded. Writes pia.csv, and starts draw.py,
which makes pia.svg and pia.png (matplotlib). Some ten minutes with two threads.
"""

import csv
import json
import pathlib
import subprocess
import sys
import tempfile

STIFFNESS = (0, 5, 20, 40, 80, 120)  # N/m
NODES = (1500, 4000)
EXPERIMENT = {"left hemisphere": 0.181, "right hemisphere": 0.125}  # N at 8 mm, Horton et al. 2007


def curve(program, folder, nodes, stiffness):
    """Depths and forces as far as the run comes, and its messages."""
    words = [program, "run", "brain.nrrd", "-o", "out", "--force", "--nodes", str(nodes), "--write", "force", "--band", "off", "-q"]
    if stiffness:
        words += ["--membrane", f"0.1mm:{10 * stiffness}kPa"]
    subprocess.run(words + ["--threads", "2"], cwd=folder, check=False)
    summary = json.loads((folder / "out" / "summary.json").read_text())
    if not (folder / "out" / "force.csv").exists():
        return [], summary
    with open(folder / "out" / "force.csv") as file:
        return [(float(row["indentation_mm"]), float(row["force_N"])) for row in csv.DictReader(file)], summary


def panel(curves, nodes):
    series = [
        {"name": f"{stiffness} N/m", "x": [d for d, _ in points], "y": [1e3 * f for _, f in points]}
        for (n, stiffness), points in curves.items()
        if n == nodes
    ]
    for name, force in EXPERIMENT.items():
        series.append({"name": f"experiment, {name}", "x": [8.0], "y": [1e3 * force], "line": False, "markers": True, "colour": 6, "hollow": name[0] == "l"})
    usual = {"colour": -1, "line": True, "dashed": False, "markers": False, "hollow": False}
    return {
        "title": f"Phantom brain under a bonded pia, {nodes} nodes",
        "subtitle": ["mu 210 Pa; the film's thickness x shear modulus is the curve's name"],
        "x_label": "indentation [mm]",
        "y_label": "force [mN]",
        "y_range": [0, 350],
        "log_x": False,
        "log_y": False,
        "lines": [],
        "series": [{**usual, **one, "label": [""] * len(one["x"])} for one in series],
    }


def main(program, file):
    program, curves = str(pathlib.Path(program).resolve()), {}
    with tempfile.TemporaryDirectory() as name, open(file + ".csv", "w", newline="") as table:
        folder = pathlib.Path(name)
        subprocess.run([program, "phantom", "brain.nrrd", "-q"], cwd=folder, check=True)
        rows = csv.writer(table, lineterminator="\n")
        rows.writerow(["nodes", "membrane_N_per_m", "indentation_mm", "force_N", "status"])
        for nodes in NODES:
            for stiffness in STIFFNESS:
                points, summary = curve(program, folder, nodes, stiffness)
                curves[nodes, stiffness] = points
                status = summary["status"] if summary["status"] == "finished" else summary["failure"]["code"]
                for depth, force in points:
                    rows.writerow([nodes, stiffness, f"{depth:.4f}", f"{round(force, 7) + 0.0:.7f}", status])
                table.flush()
                print(nodes, stiffness, status, points[-1:], flush=True)
    draw = pathlib.Path(__file__).parent / "draw.py"
    panels = json.dumps({"columns": len(NODES), "panels": [panel(curves, nodes) for nodes in NODES]})
    subprocess.run([sys.executable, str(draw), file], input=panels, text=True, check=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
