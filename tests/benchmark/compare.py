"""Runs all runners on all scenes with several numbers of nodes: error of the force against time.

    python3 tests/benchmark/compare.py OUT                         all of them; OUT/benchmark.csv and OUT/benchmark.svg
    python3 tests/benchmark/compare.py OUT --scenes sphere,punch --codes dimple,getfem --nodes 500,1000
    python3 tests/benchmark/compare.py OUT --draw                  only the picture and the table of errors

Rows that OUT/benchmark.csv already has are kept and not run again. `seconds` is the processor time of the runner, from reading the body or
making the mesh to the last force; all codes use one thread. `force_N` is at the last depth, `error_percent` the largest of all depths.
A run that gives no forces has the reason in `note`.
"""

import argparse
import csv
import json
import os
import resource
import subprocess
import sys
import tempfile

from make_scenes import SCENES, make_scenes

HERE = os.path.dirname(os.path.abspath(__file__))
COLUMNS = ["scene", "code", "version", "nodes", "seconds", "force_N", "error_percent", "requested_nodes", "note"]
LONGEST = 3600  # s
STYLE = {"dimple": ("C0", "o"), "getfem": ("C1", "^"), "calculix": ("C2", "s")}


def runners():
    return sorted(name[4:-3] for name in os.listdir(HERE) if name.startswith("run_") and name.endswith(".py"))


def processor_time():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(folder, scene, code, nodes, longest):
    """One row of the table."""
    row, before = {**dict.fromkeys(COLUMNS, ""), "scene": scene["name"], "code": code, "requested_nodes": nodes}, processor_time()
    runner = subprocess.Popen([sys.executable, os.path.join(HERE, f"run_{code}.py"), os.path.join(folder, scene["name"]), str(nodes)],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        said, reason = runner.communicate(timeout=longest)
    except subprocess.TimeoutExpired:
        os.killpg(runner.pid, 9)
        runner.communicate()
        return {**row, "note": f"not finished after {longest:g} s"}
    row["seconds"] = f"{processor_time() - before:.2f}"
    if runner.returncode:
        return {**row, "note": (reason.strip().splitlines() or [f"exit code {runner.returncode}"])[-1]}
    forces = list(csv.DictReader(said.splitlines()))
    errors = [100 * abs(float(f["force_N"]) / known - 1) for f, known in zip(forces, scene["force_N"])]
    return {**row, "version": forces[-1]["version"], "nodes": forces[-1]["nodes"], "force_N": forces[-1]["force_N"],
            "error_percent": f"{max(errors):.2f}"}


def read(path):
    if not os.path.exists(path):
        return [], []
    with open(path) as file:
        lines = file.readlines()
    return [line for line in lines if line.startswith("#")], list(csv.DictReader(line for line in lines if not line.startswith("#")))


def write(path, comments, rows):
    with open(path, "w", newline="") as file:
        file.writelines(comments)
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def draw(path, rows, scenes):
    sys.path.insert(0, os.path.join(HERE, "..", "bench"))
    from fair_peer import pyplot

    plt = pyplot()
    figure, panels = plt.subplots(2, 4, figsize=(11, 5.6), sharex=True, sharey=True, constrained_layout=True)
    for panel, scene in zip(panels.flat, scenes):
        for code in sorted({row["code"] for row in rows}):
            of = sorted((float(r["seconds"]), float(r["error_percent"])) for r in rows
                        if (r["scene"], r["code"]) == (scene["name"], code) and r["error_percent"])
            colour, marker = STYLE.get(code, (None, "D"))
            panel.plot(*zip(*(of or [(float("nan"),) * 2])), "-" + marker, color=colour, ms=4, lw=0.8, label=code)
        panel.axhline(max(scene["doubt_percent"]), color="grey", ls=":", lw=1)
        panel.set(xscale="log", yscale="log", title=scene["title"])
        panel.title.set_fontsize(9)
        panel.minorticks_off()
        panel.grid(True, alpha=0.2)
    for panel in panels[1]:
        panel.set_xlabel("processor time, s")
    for panel in panels[:, 0]:
        panel.set_ylabel("largest error of the force, %")
    panels[0][0].legend()
    figure.savefig(path, metadata={"Date": None})


def print_errors(rows, scenes):
    for scene in scenes:
        for code in sorted({row["code"] for row in rows}):
            of = [r for r in rows if (r["scene"], r["code"]) == (scene["name"], code)]
            said = [f"{r['nodes']}: {r['error_percent']} %, {r['seconds']} s" if r["error_percent"] else
                    f"{r['requested_nodes']}: {r['note'][:60]}" for r in of]
            print(f"{scene['name']:16} {code:9}", "; ".join(said))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out")
    words = lambda text: text.split(",")
    parser.add_argument("--scenes", type=words, default=[])
    parser.add_argument("--codes", type=words, default=runners())
    parser.add_argument("--nodes", type=words, default=["500", "1000", "2000", "4000"])
    parser.add_argument("--limit", type=float, default=LONGEST, metavar="s")
    parser.add_argument("--comment", default="", help="first line of a new table, for instance the processor")
    parser.add_argument("--draw", action="store_true")
    given = parser.parse_args()
    path = os.path.join(given.out, "benchmark.csv")
    os.makedirs(given.out, exist_ok=True)
    comments, rows = read(path)
    comments = comments or ([f"# {given.comment}\n"] if given.comment else [])
    have = {(r["scene"], r["code"], r["requested_nodes"]) for r in rows}
    with tempfile.TemporaryDirectory() as folder:
        for nodes in [] if given.draw else given.nodes:
            for scene in make_scenes(folder, given.scenes):
                for code in given.codes:
                    if (scene["name"], code, nodes) not in have:
                        rows.append(measure(folder, scene, code, int(nodes), given.limit))
                        write(path, comments, rows)
    with open(SCENES) as file:
        scenes = json.load(file)
    draw(os.path.join(given.out, "benchmark.svg"), rows, scenes)
    print_errors(rows, scenes)


if __name__ == "__main__":
    main()
