"""A rigid sphere of 5 mm pressed 4 mm into a bonded cylinder, without friction: Dimple and GetFEM, error against time.

    python3 tests/bench/contact_peer.py build/release OUT     (apt install python3-getfem gmsh; a quarter of an hour)
    python3 tests/bench/contact_peer.py --draw OUT            the picture and the table again, from OUT/contact_peer.csv

Writes contact_peer.csv and contact_peer.svg. Dimple computes from a label image of the cylinder (1 mm) the force at eight depths. The others
know the exact cylinder. GetFEM: gmsh's tetrahedra, quadratic displacement and linear pressure, contact by an augmented Lagrangian with a
multiplier on the surface, Newton, MUMPS, from one depth to the next along the line through the last two.
The reference is axisymmetric (tests/verification/reference/contact.csv, known to 0.1 to 0.4 %). Both run in turn; the machine
must be otherwise idle. tests/benchmark compares more scenes.
"""

import csv
import os
import subprocess
import sys
import tempfile

from fair_peer import REFERENCE, largest, pyplot, read_rows, run_to_depths, timed

RADIUS, HEIGHT, SPHERE, DEPTHS = 30.0, 30.0, 5.0, [0.5 * (k + 1) for k in range(8)]  # mm
MU, NU = 210e-6, 0.499  # N/mm2
NODES, SEEDS = [400, 600, 1000, 1500, 2000, 3000, 4000], [1, 2, 3]
MESHES = [(fine, growth, far) for fine in [2.5, 2, 1.5, 1.2, 1] for growth, far in [(0.3, 8), (0.5, 10), (0.8, 15)]]
COLUMNS = ["program", "setting", "unknowns", "wall_s", *(f"force_{d:g}mm_N" for d in DEPTHS), "error_percent", "error_at_4mm_percent"]


def other(mesh, folder):
    wall, done = timed([sys.executable, os.path.abspath(__file__), "--one", *map(str, mesh), folder])
    said = done.stdout.split() if done and not done.returncode else []
    if len(said) != len(DEPTHS) + 1:
        return None
    return {"program": "GetFEM", "setting": "edge {:g} growth {:g} far {:g}".format(*mesh), "unknowns": int(said[0]), "wall_s": wall,
            "force": [float(f) for f in said[1:]]}


def one(fine, growth, far, folder):
    """Runs the other program; prints the number of its unknowns and the forces."""
    import getfem

    sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "benchmark"))
    from run_getfem import Body

    geometry, file = os.path.join(folder, "cylinder.geo"), os.path.join(folder, "cylinder.msh")
    with open(geometry, "w") as text:
        text.write(f'''SetFactory("OpenCASCADE");
Cylinder(1) = {{0, 0, 0, 0, 0, {HEIGHT}, {RADIUS}}};
Point(100) = {{0, 0, {HEIGHT}, {fine}}};
Point{{100}} In Surface{{2}};
Field[1] = Distance; Field[1].PointsList = {{100}};
Field[2] = MathEval; Field[2].F = "Min({far}, {fine} + {growth} * Max(0, F1 - {0.9 * SPHERE}))";
Background Field = 2;
Mesh.MeshSizeExtendFromBoundary = 0; Mesh.MeshSizeFromPoints = 0; Mesh.MshFileVersion = 2.2;
''')
    subprocess.run(["gmsh", "-3", "-v", "0", geometry, "-o", file], check=True)
    scene = {"body": {"height_mm": HEIGHT}, "tool": {"shape": "sphere", "radius_mm": SPHERE}, "mu_Pa": 1e6 * MU, "nu": NU, "film_N_per_m": 0,
             "gravity_m_per_s2": 0, "density_kg_per_m3": 0}
    body = Body(getfem, getfem.Mesh("import", "gmsh", file), scene, fine, 4)
    print(body.model.nbdof(), *(f"{f:.6g}" for f in body.forces(DEPTHS)))


def measure(build, out):
    known = [float(row["force_N"]) for row in read_rows(os.path.join(REFERENCE, "contact.csv")) if row["scene"] == "sphere"]
    with tempfile.TemporaryDirectory() as folder, open(os.path.join(out, "contact_peer.csv"), "w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        image = os.path.join(folder, "cylinder.nrrd")
        subprocess.run([os.path.join(build, "dimple"), "phantom", image, "--shape", "cylinder", "--size",
                        f"{2 * RADIUS},{2 * RADIUS},{HEIGHT}", "-q"], check=True, stdout=subprocess.DEVNULL)
        clouds = [(nodes, seed) for nodes in NODES for seed in SEEDS]
        for k in range(max(len(clouds), len(MESHES))):
            tool = ["--tool", f"sphere:{SPHERE:g}mm"]
            runs = [run_to_depths(build, image, tool, DEPTHS, *clouds[k], folder)] if k < len(clouds) else []
            runs += [other(MESHES[k], folder)] if k < len(MESHES) else []
            for run in filter(None, runs):
                table.writerow([run["program"], run["setting"], run["unknowns"], f"{run['wall_s']:.2f}",
                                *(f"{f:.6g}" for f in run["force"]), f"{largest(run['force'], known):.2f}",
                                f"{largest(run['force'][-1:], known[-1:]):.2f}"])
            file.flush()


def draw(out):
    plt, rows = pyplot(), read_rows(os.path.join(out, "contact_peer.csv"))
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.6), sharey=True, constrained_layout=True)
    for panel, (column, title) in zip(panels, [("error_percent", "largest of eight depths"), ("error_at_4mm_percent", "at 4 mm")]):
        for program, colour, marker in [("Dimple", "C0", "o"), ("GetFEM", "C1", "^")]:
            of = [row for row in rows if row["program"] == program]
            panel.plot([float(r["wall_s"]) for r in of], [float(r[column]) for r in of], marker, color=colour, ms=4, alpha=0.7,
                       label=program)
        panel.set(xscale="log", yscale="log", title=title, xlabel="to the force at eight depths, s")
        panel.grid(True, which="both", alpha=0.2)
    panels[0].set_ylabel("error of the force, %")
    panels[0].legend()
    figure.savefig(os.path.join(out, "contact_peer.svg"), metadata={"Date": None})
    programs = ("Dimple", "GetFEM")
    print("error_of,error_percent", *(f"{program}_s" for program in programs), sep=",")
    for column in ["error_percent", "error_at_4mm_percent"]:
        for level in [1, 2, 3, 5, 10]:
            best = [min((float(r["wall_s"]) for r in rows if r["program"] == program and float(r[column]) <= level), default=None)
                    for program in programs]
            print(column, level, *("" if s is None else f"{s:.2f}" for s in best), sep=",")


if __name__ == "__main__":
    if len(sys.argv) == 6 and sys.argv[1] == "--one":
        one(*map(float, sys.argv[2:5]), sys.argv[5])
    elif len(sys.argv) == 3 and sys.argv[1] == "--draw":
        draw(sys.argv[2])
    elif len(sys.argv) == 3:
        measure(*sys.argv[1:])
        draw(sys.argv[2])
    else:
        sys.exit(__doc__)
