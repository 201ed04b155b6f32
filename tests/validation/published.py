"""Other people's numbers, computed with the program and put next to theirs.

    /usr/bin/python3 tests/validation/published.py PROGRAM OUT

Five scenes: a rigid ball on four blocks (FEBio), a rubber roller on a plate, a cylinder between plates, a round-tipped
rod pressed deep, and the Truth Cube. Images are written here. Writes OUT/published.csv and OUT/published.svg.
Runs lie in OUT/runs; a finished one with the same options is not repeated. A run takes seconds to half a minute.
Needs numpy, vtk and matplotlib.
"""

import csv
import gzip
import json
import pathlib
import re
import subprocess
import sys

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402

import numpy as np  # noqa: E402
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader  # noqa: E402

FEBIO = "FEBio, github.com/PatrickGio/Nanoindentation, NH_ValPred"
FEBIO_DEPTHS = (0.1, 0.2, 0.3, 0.4, 0.5)  # of the ball's radius
FEBIO_BLOCKS = {  # half width and thickness in radii: F / (mu R^2) at these depths
    (22.6, 13.9): (0.1653, 0.4645, 0.8305, 1.2690, 1.7554),
    (5.9, 8.5): (0.1645, 0.4615, 0.8241, 1.2582, 1.7394),
    (5.3, 17.3): (0.1535, 0.4211, 0.7417, 1.1184, 1.5296),
    (30.2, 5.0): (0.1707, 0.4853, 0.8754, 1.3472, 1.8754),
}
ROLLER = {"force_N": 380.0, "width_mm": 30.0, "pressure_MPa": 0.62}  # github.com/adtzlr/felupe, issue 870
COLUMNS = ("scene", "quantity", "unit", "source", "known_to", "theirs", "ours", "difference_percent")


class Bench:
    """Runs of the program in a folder, and the rows of the table."""

    def __init__(self, program, out):
        self.program, self.runs, self.rows, self.curves = program, out / "runs", [], {}
        self.runs.mkdir(parents=True, exist_ok=True)

    def run(self, name, image, *options):
        words = ["run", image, "-o", name, "--force", "-q", "--threads", "1", "--band", "off", "--base", "inferior",
                 *map(str, options)]
        folder, made = self.runs / name, self.runs / (name + ".json")
        if not made.exists() or json.loads(made.read_text())["words"] != words:
            ended = subprocess.run([self.program, *words], cwd=self.runs, stderr=subprocess.PIPE, text=True)
            made.write_text(json.dumps({"words": words, "code": ended.returncode, "message": ended.stderr}))
        told = json.loads(made.read_text())
        if told["code"] not in (0, 5):  # 5: the curve so far is on disk
            if told["code"] == 130:
                made.unlink()
            raise RuntimeError(f"{name}: {told['message']}")
        print(name, told["code"], told["message"].replace("\n", " ")[:300], flush=True)
        return folder, told

    def pinned(self, name, image, *options):
        """A run on a plane, held sideways by the fewest nodes at the middle of the lower side."""
        radius = 2.0
        while True:
            try:
                return self.run(f"{name}_pin{radius:.3g}mm", image, "--base-hold", "none", "--wall", "plane:0,0,0,0,0,1",
                                "--set", f"support.pin.on=0,0,0,{radius:g}", *options)
            except RuntimeError as error:
                away = re.search(r"nearest node of the surface is ([\d.]+) mm", str(error))
                if not away:
                    raise
                radius = 1.02 * float(away[1])

    def row(self, scene, quantity, unit, source, known_to, theirs, ours):
        apart = "" if theirs == "" or ours == "" else f"{100 * (ours / theirs - 1):.1f}"
        numbers = [n if n == "" else f"{n:.5g}" for n in (theirs, ours)]
        self.rows.append(dict(zip(COLUMNS, (scene, quantity, unit, source, known_to, *numbers, apart))))


def image(file, spacing, inside, low, high):
    """Label image (NRRD) of a box from low to high [mm]; inside(x, y, z) gives the label of voxel centres."""
    n = np.rint((np.array(high) - low) / spacing).astype(int) + 2
    first = np.array(low) - 0.5 * np.array(spacing)
    x, y, z = np.meshgrid(*(first[k] + spacing[k] * np.arange(n[k]) for k in range(3)), indexing="ij")
    box = np.all([(c > l) & (c < h) for c, l, h in zip((x, y, z), low, high)], axis=0)
    label = np.where(box, inside(x, y, z), 0).astype(np.uint8)
    axes = " ".join(f"({','.join(f'{spacing[k] if k == i else 0:.9g}' for k in range(3))})" for i in range(3))
    head = (f"NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {n[0]} {n[1]} {n[2]}\n"
            f"space directions: {axes}\nkinds: domain domain domain\nencoding: raw\n"
            f"space origin: ({','.join(f'{v:.9g}' for v in first)})\n\n")
    file.write_bytes(head.encode() + label.tobytes(order="F"))


def block(file, half, height, spacing):
    """Block on z = 0; its size is exact, its voxels are nearly cubes."""
    size = np.array([2 * half, 2 * half, height])
    image(file, size / np.rint(size / spacing), lambda x, y, z: np.ones_like(x), (-half, -half, 0), (half, half, height))


def under_plate(depth, top):
    """Options of a plate wider than the body, which the program refuses as a tool: a layer of the image (label 2) is moved
    as a rigid body, and a small bonded circle on the cap above it moves along."""
    return ("--indent-at", f"0,0,{top}", "--indenter-diameter", "10mm", "--rim", "1", "--depth", f"{depth}mm",
            "--set", "support.plate.on=label:2", "--set", f"support.plate.move_mm=0,0,-{depth}")


def curve(folder, column="force_N"):
    """Depths [mm] and forces [N] of a run, as far as it came."""
    with open(folder / "force.csv") as file:
        rows = [(float(r["indentation_mm"]), abs(float(r[column]))) for r in csv.DictReader(file)]
    return np.array(rows).T


def frames(folder, name):
    """Depths [mm] (1 mm/s) and files of a series."""
    text = (folder / (name + ".pvd")).read_text()
    times = [float(t) for t in re.findall(r'timestep="([^"]+)"', text)]
    return np.array(times), [folder / f for f in re.findall(r'file="([^"]+)"', text)]


def arrays(file):
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(file))
    reader.Update()
    made = reader.GetOutput()
    fields = made.GetPointData()
    return {"place": vtk_to_numpy(made.GetPoints().GetData()),
            **{fields.GetArrayName(k): vtk_to_numpy(fields.GetArray(k)) for k in range(fields.GetNumberOfArrays())}}


def why(folder, told):
    """Where a run ended, and the program's words for it."""
    depth = curve(folder)[0][-1]
    words = " ".join(line.strip() for line in told["message"].splitlines() if line.startswith("dimple:"))
    return depth, "ended: " + words.removeprefix("dimple: ") if told["code"] else "reached its depth"


def balls(bench):
    for (half, height), theirs in FEBIO_BLOCKS.items():
        name = f"ball_{half}x{height}"
        block(bench.runs / "block.nrrd", 5 * half, 5 * height, 1.0 if half > 10 else 0.5)
        (bench.runs / "block.nrrd").replace(bench.runs / (name + ".nrrd"))
        folder, told = bench.pinned(name, name + ".nrrd", "--tool", "sphere:5mm", "--mu", "1kPa", "--nu", "0.498",
                                    "--depth", "2.5mm", "--frames", 10, "--write", "force")
        depth, force = curve(folder)
        bench.curves[name] = depth / 5, force / (1e3 * 5e-3**2)
        for at, value in zip(FEBIO_DEPTHS, theirs):
            ours = np.interp(5 * at, depth, force) / (1e3 * 5e-3**2) if depth[-1] > 4.999 * at else ""
            bench.row("ball on a block", f"F/(mu R^2) at {at} R, half width {half} R, thickness {height} R", "1", FEBIO,
                      "1.5 %, scatter of its contact", value, ours)


def roller(bench):
    source, known = "measured, github.com/adtzlr/felupe issue 870", "not stated; modulus doubtful by a factor of ten"
    image(bench.runs / "roller.nrrd", (1, 1, 1), lambda x, y, z: (np.hypot(y, z) < 35) * 1 + (np.hypot(y, z) < 17.5),
          (-14, -35, -35), (14, 35, 35))
    for young, depth in ((2.75, 6), (0.275, 12)):
        folder, told = bench.run(  # the core moves onto a plane; the circle on the far side moves along
            f"roller_{young}", "roller.nrrd", "--young", f"{1e6 * young:g}Pa", "--nu", "0.475", "--depth", f"{depth}mm",
            "--indent-at", "0,0,35", "--indenter-diameter", "5mm", "--frames", 4 * depth, "--write", "surface",
            "--base-hold", "none", "--wall", "plane:0,0,-35,0,0,1", "--set", "support.core.on=label:2",
            "--set", f"support.core.move_mm=0,0,-{depth}", "--nodes", "4000", "--rim", "1")
        depths, force = curve(folder, "wall_force_z_N")
        bench.curves[f"roller_{young}"] = depths, force
        times, files = frames(folder, "contact")
        width, peak = [], []
        for file in files:
            fields = arrays(file)
            on = fields["contact"] > 0
            middle = on & (np.abs(fields["place"][:, 0]) < 7)
            width.append(np.ptp(fields["place"][middle, 1]) if middle.any() else 0)
            peak.append(fields["pressure_Pa"][on].max() / 1e6 if on.any() else 0)
        reached = force[-1] >= ROLLER["force_N"]
        at = np.interp(ROLLER["force_N"], force, depths) if reached else ""
        end = f"; run {why(folder, told)[1]} ({depths[-1]:.3g} mm, {force[-1]:.3g} N)"
        label = f" at 380 N, E {young} MPa"
        bench.row("rubber roller", "depth" + label, "mm", "none", "ours only" + end, "", at)
        bench.row("rubber roller", "contact width" + label, "mm", source, known, ROLLER["width_mm"],
                  np.interp(at, times, width) if reached else "")
        bench.row("rubber roller", "largest pressure" + label, "MPa", source, known, ROLLER["pressure_MPa"],
                  np.interp(at, times, peak) if reached else "")


def cylinder(bench):
    radius, height, young, depth = 25.0, 30.0, 10e3, 0.6
    for name, top in (("cylinder", height), ("capped", height + 9)):
        image(bench.runs / (name + ".nrrd"), (1, 1, 1),
              lambda x, y, z: (np.hypot(x, y) < radius) * (1 + ((z > height) & (z < height + 3))), (-25, -25, 0), (25, 25, top))
    common = ("--young", f"{young:g}Pa", "--nu", "0.499", "--write", "force", "--nodes", "4000")
    shape, stretch = radius / (2 * height), 1 - depth / height
    slid = bench.pinned("cylinder_frictionless", "cylinder.nrrd", *common, "--indent-at", "0,0,30", "--indenter-diameter", "45mm",
                        "--contact", "frictionless", "--depth", f"{depth}mm")
    stuck = bench.run("cylinder_no-slip", "capped.nrrd", *common, *under_plate(depth, height + 9))
    for name, made, column, theirs, source, known in (
        ("frictionless (patch of 45 mm)", slid, "force_N", 1.0, "uniform compression", "exact for a plate"),
        ("no-slip", stuck, "base_force_N", 1 + 2 * shape**2, "Gent and Lindley 1959: 1 + 2 S^2", "approximate at S 0.4"),
    ):
        depths, force = curve(made[0], column)
        modulus = force[-1] / (np.pi * (radius / 1e3) ** 2) * 3 / (stretch**-2 - stretch)
        bench.row("cylinder between plates", f"apparent modulus / modulus at 2 %, {name}", "1", source, known, theirs,
                  modulus / young if depths[-1] > 0.999 * depth else "")


def rod(bench):
    radius, young = 0.5, 10e3
    block(bench.runs / "rod.nrrd", 20, 20, 0.5)
    folder, told = bench.run("rod", "rod.nrrd", "--tool", "capsule:0.5mm,length=20mm", "--young", f"{young:g}Pa", "--nu", "0.499",
                             "--depth", f"{10 * radius}mm", "--write", "force", "--frames", 20, "--nodes", "4000")
    depth, force = curve(folder)
    end, reason = why(folder, told)
    on = depth > 0
    bench.curves["rod"] = depth[on] / radius, force[on] / (young * (depth[on] / 1e3) ** 2)
    bench.row("round-tipped rod", "deepest D/R of the 10 requested", "1", "none", reason, "", end / radius)
    for at in (0.2, 0.5, 1, 2, 3, 4, 6, 8, 10):
        if at * radius <= end * 1.001:
            hertz = 16 / 9 * at**-0.5
            theirs = hertz * (1 - 0.15 * at) if at <= 1 else ""
            known = "fit of finite elements up to 1 R; coefficient not checked at the source" if at <= 1 else "ours only"
            bench.row("round-tipped rod", f"F/(E D^2) at D/R {at}", "1", "Zhang 2014" if at <= 1 else "none", known, theirs,
                      np.interp(at * radius, depth, force) / (young * (at * radius / 1e3) ** 2))


def field(file):
    """Displacement of voxels [3 x i x j x k], first voxel's centre and voxel edges [mm]."""
    head, data = file.read_bytes().split(b"\n\n", 1)
    words = dict(line.split(": ", 1) for line in head.decode().splitlines() if ": " in line)
    if words["encoding"] in ("gzip", "gz"):
        data = gzip.decompress(data)
    kind = {"float": "<f4", "double": "<f8"}[words["type"]]
    numbers = [float(v) for v in re.findall(r"-?[\d.]+(?:e-?\d+)?", words["space directions"].replace("none", ""))]
    first = np.array([float(v) for v in re.findall(r"-?[\d.]+(?:e-?\d+)?", words["space origin"])])
    return np.frombuffer(data, kind).reshape([int(n) for n in words["sizes"].split()], order="F"), first, np.array(numbers)[[0, 4, 8]]


def displacement(file, places):
    """Trilinear displacements [mm] at places [n x 3]."""
    u, first, edge = field(file)
    at = (places - first) / edge
    low = np.floor(at).astype(int)
    part, total = at - low, 0
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, part, 1 - part), axis=1)
        total = total + weight * u[(slice(None), *(low + corner).T)]
    return total.T


def truth_cube(bench):
    for file, top in (("cube.nrrd", 80), ("capped_cube.nrrd", 92)):
        image(bench.runs / file, (2, 2, 2), lambda x, y, z: 1 + ((z > 80) & (z < 86)), (-40, -40, 0), (40, 40, top))
    beads = np.array([(x, 0.0, z) for z in (70, 50, 30) for x in (0, 10, 30)])
    source, known = "Kerdok 2003, biorobotics.harvard.edu/truthcube (table to be read there)", "1 mm, CT voxel"
    scenes = (("plate", "capped_cube.nrrd", under_plate(14.6, 92), (4, 10, 14.6)),
              ("ball", "cube.nrrd", ("--tool", "sphere:12.7mm", "--indent-at", "0,0,80", "--depth", "17.6mm"), (17.6,)))
    for name, body, options, depths in scenes:
        folder, told = bench.run("cube_" + name, body, *options, "--young", "15kPa", "--nu", "0.499", "--nodes", "4000",
                                 "--frames", 20, "--write", "surface,images", "--write-frames", "all")
        times, files = frames(folder, "surface")
        shifts = [displacement(f, beads) for f in sorted((folder / "images").glob("displacement_mm*.nrrd"))]
        if len(shifts) == len(times) - 1:  # none at rest
            shifts.insert(0, np.zeros_like(beads))
        shifts = np.array(shifts)
        end, reason = why(folder, told)
        bench.row("Truth Cube", f"{name}: depth reached of {depths[-1]} requested", "mm", "none", reason, "", end)
        for depth in [d for d in depths if d <= end * 1.001] or [times[-1]]:
            for k, bead in enumerate(beads):
                for axis in (0, 2):
                    ours = np.interp(depth, times, shifts[:, k, axis])
                    bench.row("Truth Cube", f"{name} {depth:.4g} mm: u_{'xyz'[axis]} of the bead at x {bead[0]:g} y 0 z {bead[2]:g}",
                              "mm", source, known, "", ours)


def draw(bench, file):
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "dimple", "axes.grid": True, "grid.color": "#e4e7eb", "font.size": 8})
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.8), constrained_layout=True)
    hues = ["#0072b2", "#d55e00", "#009e73", "#b5588f"]
    for hue, ((half, height), theirs) in zip(hues, FEBIO_BLOCKS.items()):
        if f"ball_{half}x{height}" in bench.curves:
            axes[0].plot(*bench.curves[f"ball_{half}x{height}"], color=hue, label=f"half width {half} R, thickness {height} R")
        axes[0].plot(FEBIO_DEPTHS, theirs, "o", color=hue, markersize=4)
    axes[0].set(title="Ball on a block: lines Dimple, dots FEBio", xlabel="depth / R", ylabel="F / (mu R$^2$)")
    for hue, name in zip(hues, ("roller_2.75", "roller_0.275")):
        if name in bench.curves:
            axes[1].plot(*bench.curves[name], color=hue, label=f"E {name[7:]} MPa")
    axes[1].axhline(ROLLER["force_N"], color="#5a6068", linestyle="--")
    axes[1].set(title="Roller on a plate: force of the experiment dashed", xlabel="depth [mm]", ylabel="force [N]")
    if "rod" in bench.curves:
        axes[2].loglog(*bench.curves["rod"], color=hues[0], label="Dimple")
    ratio = np.geomspace(0.05, 10)
    axes[2].loglog(ratio, 16 / 9 * ratio**-0.5, "--", color="#5a6068", label="Hertz")
    axes[2].loglog(ratio[ratio <= 1], (16 / 9 * ratio**-0.5 * (1 - 0.15 * ratio))[ratio <= 1], color=hues[1], label="Zhang 2014")
    axes[2].set(title="Round-tipped rod", xlabel="D / R", ylabel="F / (E D$^2$)")
    for one in (one for one in axes if one.get_legend_handles_labels()[0]):
        one.legend(fontsize=7, frameon=False)
    figure.savefig(file, metadata={"Date": None})


def main(program, out):
    out = pathlib.Path(out).resolve()
    bench = Bench(str(pathlib.Path(program).resolve()), out)
    for scene in (balls, roller, cylinder, rod, truth_cube):
        try:
            scene(bench)
        except (RuntimeError, OSError) as error:
            text = str(error).replace("\n", " ")
            print(text, flush=True)
            bench.row(scene.__name__, "no result", "", "none", text[:200], "", "")
        with open(out / "published.csv", "w", newline="") as file:
            table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            table.writeheader()
            table.writerows(bench.rows)
        draw(bench, out / "published.svg")


if __name__ == "__main__":
    main(*sys.argv[1:])
