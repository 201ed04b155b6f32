"""The phantom brain under the bonded patch of Horton et al. (2007) and under contacting tools: deformed bodies, forces, error bounds.

    /usr/bin/python3 tests/validation/tools.py build/release/dimple sample_data/tools

Each tool is pressed 4 mm into the place that the program finds, with default options. Writes tools.csv and tools.png
(matplotlib). The bodies are those of each run's own picture. Some fifteen seconds with two threads.
"""

import csv
import pathlib
import subprocess
import sys
import tempfile

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402

TOOLS = (  # name, options, colour
    ("bonded circle, radius 5 mm", [], "#1b3a6b"),
    ("sphere, radius 10 mm", ["--tool", "sphere:10mm"], "#1e9e77"),
    ("punch, radius 5 mm, edge 1 mm, friction 0.3", ["--tool", "punch:5mm,edge=1mm", "--friction", "0.3"], "#d55e00"),
    ("sphere, radius 5 mm", ["--tool", "sphere:5mm"], "#7a5195"),
)


def body_of(overview):
    """Deformed surface in the white panel at the lower left; warnings above it take different heights."""
    white = (overview[:, 30, :3] > 0.99).all(axis=1)
    bottom = white.nonzero()[0][-1]
    top = (~white[:bottom]).nonzero()[0][-1]
    panel = overview[top + 75 : bottom - 46, 40:665].copy()  # without its legend and its scale
    panel[-56:, :90] = 1.0  # axes
    return panel


def run(program, folder, options):
    words = [program, "run", "brain.nrrd", "-o", "out", "--force", "--depth", "4mm", "--frames", "16", "-q", *options]
    subprocess.run(words, cwd=folder, check=True)
    with open(folder / "out" / "force.csv") as file:
        rows = list(csv.DictReader(file))
    columns = ("indentation_mm", "force_N", "low_N", "high_N")
    return [[float(row.get(name) or "nan") for name in columns] for row in rows], body_of(plt.imread(folder / "out" / "overview.png"))


def draw(curves, pictures, file):
    plt.rcParams.update({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False})
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 5.6), constrained_layout=True)
    for axis, (name, _, colour) in zip(axes.flat, TOOLS[:3]):
        axis.imshow(pictures[name])
        axis.set_title(name, loc="left", color=colour, fontsize=9, fontweight="bold")
        axis.axis("off")
    axis = axes.flat[3]
    for name, _, colour in TOOLS:
        depth, force, low, high = (list(column) for column in zip(*curves[name]))
        axis.plot(depth, [1e3 * f for f in force], color=colour, linewidth=1.5)
        axis.fill_between(depth, [1e3 * f for f in low], [1e3 * f for f in high], color=colour, alpha=0.2, linewidth=0)
        end = (depth[-1], 1e3 * force[-1])
        axis.annotate(name.replace("punch, radius 5 mm", "punch"), end, (4, 0), textcoords="offset points", va="center", color=colour)
    axis.set(xlabel="indentation [mm]", ylabel="force [mN]", xlim=(0, 6.6), ylim=(0, None), xticks=range(5))
    axis.set_title("force, with the band of its discretisation where one is known", loc="left", fontsize=9)
    figure.savefig(file + ".png", dpi=120, bbox_inches="tight", metadata={"Software": None})


def main(program, file):
    program, curves, pictures = str(pathlib.Path(program).resolve()), {}, {}
    with tempfile.TemporaryDirectory() as name, open(file + ".csv", "w", newline="") as table:
        folder = pathlib.Path(name)
        subprocess.run([program, "phantom", "brain.nrrd", "-q"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        rows = csv.writer(table)
        rows.writerow(["tool", "options", "indentation_mm", "force_N", "low_N", "high_N"])
        for tool, options, _ in TOOLS:
            curves[tool], pictures[tool] = run(program, folder, options)
            rows.writerows([tool, " ".join(options), *(f"{x:.6g}" for x in row)] for row in curves[tool])
    draw(curves, pictures, file)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
