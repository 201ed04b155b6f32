"""Dimple and a finite-element code that does not lock, from a label image to the force at 1, 2, 3 and 4 mm.

    python3 tests/bench/fair_peer.py IMAGES build/release OUT      IMAGES: heart_ct_1.5mm.nii.gz, abdomen_mr_3mm.nii.gz,
                                                                   human_brain_mri_2mm.nrrd; the block is made
    python3 tests/bench/fair_peer.py --draw OUT                    the picture and the table again, from OUT/fair_peer.csv

Writes fair_peer.csv, fair_peer.svg, and prints the ratio of their times at several errors. The other code is
tests/verification/reference/tetrahedra.cpp: Taylor-Hood tetrahedra (quadratic displacement, linear pressure), CGAL's mesh of the
body's surface, Newton, MUMPS; Dimple's library finds surface, base and patch for both. Both run in turn; the machine must be
otherwise idle. Each row is one run: of Dimple three node sets of each size, of the other each grading of the mesh.
"""

import csv
import os
import subprocess
import sys
import tempfile
import time

REFERENCE = os.path.join(os.path.dirname(__file__), "..", "verification", "reference")
SCENES = {  # image, label, place of the patch and other settings of the references, see their README
    "block": ("block.nrrd", None, None, []),
    "heart": ("heart_ct_1.5mm.nii.gz", None, "26.308587,-165.268872,714.798895", []),
    "liver": ("abdomen_mr_3mm.nii.gz", 5, "-95.399296,-33.354610,27.513709", []),
    "brain": ("human_brain_mri_2mm.nrrd", None, None, ["manifold=0"]),
}
NODES = [250, 300, 400, 500, 600, 800, 1000, 1500, 2000, 3000, 4000]
SEEDS = [1, 2, 3]
FINEST_NODES = 16000
# edge at the patch and largest edge [mm], growth, and largest distance of the mesh from the surface, as `near` and `farthest`
MESHES = [(rim, growth, far, near, farthest)
          for near, farthest in [(0.3, 3), (0.15, 1)]
          for rim in [0.8, 1.2, 1.6, 2, 2.5, 3]
          for growth, far in [(0.6, 12), (1, 20)]]
FINEST_MESH, FINEST_OF_FOLDS = (0.5, 0.4, 10, 0.1, 1), (0.8, 0.5, 16, 0.2, 0.8)
DEPTHS = [1, 2, 3, 4]
LEVELS = [1, 2, 3, 5, 10]  # % of error
LONGEST = 600  # s
COLUMNS = ["scene", "program", "setting", "unknowns", "wall_s", "force_1mm_N", "force_2mm_N", "force_3mm_N", "force_4mm_N",
           "error_percent", "off_own_finest_percent"]


def timed(words):
    begun = time.time()
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return LONGEST, None
    return time.time() - begun, done


def read_rows(path):
    with open(path) as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def run_to_depths(build, image, options, depths, nodes, seed, folder):
    """Forces of Dimple at equal depths to 4 mm, and its time; None if the run ends without them."""
    out = os.path.join(folder, "out")
    wall, done = timed([os.path.join(build, "dimple"), "run", image, "-o", out, "--force", "-q", "--write", "force", "--band", "off",
                        "--depth", "4mm", "--frames", str(len(depths)), "--nodes", str(nodes), "--set", f"cloud.seed={seed}", *options])
    if done is None or done.returncode:
        return None
    at = {round(float(row["indentation_mm"]), 6): float(row["force_N"]) for row in read_rows(os.path.join(out, "force.csv"))}
    return {"program": "Dimple", "setting": f"{nodes} nodes, seed {seed}", "unknowns": 3 * nodes, "wall_s": wall,
            "force": [at[float(d)] for d in depths]}


def ours(build, image, scene, nodes, seed, folder):
    _, label, at, _ = SCENES[scene]
    options = ["--base", "organ", *(["--label", str(label)] if label else []), *([f"--indent-at={at}"] if at else [])]
    return run_to_depths(build, image, options, DEPTHS, nodes, seed, folder)


def other(build, image, scene, mesh, folder):
    _, label, at, more = SCENES[scene]
    rim, growth, far, near, farthest = mesh
    wall, done = timed([os.path.join(build, "dimple_reference_tetrahedra"), image, str(rim), "4", "4", f"growth={growth}", f"far={far}",
                        f"near={near}", f"farthest={farthest}", "first_depth=0", *more, *([f"label={label}"] if label else []),
                        *([f"{axis}={x}" for axis, x in zip("xyz", at.split(","))] if at else [])])
    rows = [line.split(",") for line in (done.stdout if done else "").splitlines() if line.count(",") == 10][1:]
    if len(rows) < len(DEPTHS):
        return None
    return {"program": "P2/P1 tetrahedra", "setting": f"rim {rim} growth {growth} far {far} near {near} farthest {farthest}",
            "unknowns": int(rows[-1][5]), "wall_s": wall, "force": [float(row[7]) for row in rows]}


def largest(force, known):
    return 100 * max(abs(f / k - 1) for f, k in zip(force, known))


def measure(images, build, out):
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        block = os.path.join(folder, "block.nrrd")
        subprocess.run([os.path.join(build, "dimple"), "phantom", block, "--shape", "block", "--size", "60,60,30", "-q"], check=True)
        for scene, (image, _, _, more) in SCENES.items():
            image = block if scene == "block" else os.path.join(images, image)
            known = [float(row["force_N"]) for row in read_rows(os.path.join(REFERENCE, scene + ".csv"))][: len(DEPTHS)]
            finest = {run["program"]: run for run in (ours(build, image, scene, FINEST_NODES, 1, folder),
                                                      other(build, image, scene, FINEST_OF_FOLDS if more else FINEST_MESH, folder)) if run}
            clouds = [(nodes, seed) for nodes in NODES for seed in SEEDS]
            for k in range(max(len(clouds), len(MESHES))):
                runs = [ours(build, image, scene, *clouds[k], folder)] if k < len(clouds) else []
                runs += [other(build, image, scene, MESHES[k], folder)] if k < len(MESHES) else []
                for run in runs + (list(finest.values()) if k == 0 else []):
                    if not run:
                        continue
                    own = finest.get(run["program"])
                    rows.append([scene, run["program"], run["setting"], run["unknowns"], f"{run['wall_s']:.2f}",
                                 *(f"{f:.6g}" for f in run["force"]), f"{largest(run['force'], known):.2f}",
                                 f"{largest(run['force'], own['force']):.2f}" if own else ""])
            print(scene, "done", file=sys.stderr, flush=True)
    with open(os.path.join(out, "fair_peer.csv"), "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS] + rows)


def fastest(rows, scene, program, column, level):
    """Shortest time of a run, and of a setting whose runs are all as accurate: Dimple has three node sets, the other each mesh alone."""
    of = [row for row in rows if row["scene"] == scene and row["program"] == program and row[column] and float(row[column]) > 0]
    alone = [float(row["wall_s"]) for row in of if float(row[column]) <= level]
    sizes = {}
    for row in of:
        sizes.setdefault(row["unknowns"] if program == "Dimple" else row["setting"], []).append(row)
    every = [sorted(float(r["wall_s"]) for r in group)[len(group) // 2] for group in sizes.values()
             if len(group) == (len(SEEDS) if program == "Dimple" else 1) and max(float(r[column]) for r in group) <= level]
    return min(alone, default=None), min(every, default=None)


def table(rows):
    print("error is against,scene,error_percent,ours_s,ours_worst_of_three_s,other_s,times_faster,times_faster_worst_of_three")
    for column, against in [("error_percent", "reference"), ("off_own_finest_percent", "own finest run")]:
        for scene in SCENES:
            for level in LEVELS:
                one, every = fastest(rows, scene, "Dimple", column, level)
                peer, _ = fastest(rows, scene, "P2/P1 tetrahedra", column, level)
                said = lambda x: "" if x is None else f"{x:.2f}"
                ratio = lambda x: f"{peer / x:.1f}" if peer and x else ""
                print(f"{against},{scene},{level},{said(one)},{said(every)},{said(peer)},{ratio(one)},{ratio(every)}")


def pyplot():
    """matplotlib.pyplot with reproducible output."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot as plt

    plt.rcParams.update({"svg.hashsalt": "dimple", "svg.fonttype": "none", "font.size": 9})
    return plt


def draw(out):
    plt, rows = pyplot(), read_rows(os.path.join(out, "fair_peer.csv"))
    figure, panels = plt.subplots(2, 4, figsize=(12, 6), sharex=True, sharey="row", constrained_layout=True)
    for line, (column, against) in enumerate([("error_percent", "largest error against the reference, %"),
                                              ("off_own_finest_percent", "off its own finest run, %")]):
        panels[line][0].set_ylabel(against)
        for panel, scene in zip(panels[line], SCENES):
            for program, colour, marker in [("Dimple", "C0", "o"), ("P2/P1 tetrahedra", "C1", "^")]:
                at = sorted((float(r["wall_s"]), float(r[column])) for r in rows
                            if r["scene"] == scene and r["program"] == program and r[column] and float(r[column]) > 0)
                panel.plot([t for t, _ in at], [e for _, e in at], marker, color=colour, ms=3.5, alpha=0.6, label=program)
                front, best = [], float("inf")
                for t, e in at:
                    if e < best:
                        best = e
                        front.append((t, e))
                panel.step([t for t, _ in front], [e for _, e in front], where="post", color=colour, lw=1)
            panel.set_xscale("log")
            panel.set_yscale("log")
            panel.set_title(scene if line == 0 else "")
            panel.grid(True, which="both", alpha=0.2)
    for panel in panels[1]:
        panel.set_xlabel("from the image to the force, s")
    panels[0][0].legend(loc="lower left")
    figure.savefig(os.path.join(out, "fair_peer.svg"), metadata={"Date": None})
    table(rows)


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] == "--draw":
        draw(sys.argv[2])
    elif len(sys.argv) == 4:
        measure(*sys.argv[1:])
        draw(sys.argv[3])
    else:
        sys.exit(__doc__)
