"""Which law does brain tissue follow? 686 indentations of mouse brain slices, fitted by three laws from one scene.

    /usr/bin/python3 tests/validation/brain_slices.py PROGRAM CURVES.csv.gz OUT [PEER.txt]

CURVES has the columns sample, indentation_um and force_nN: a rigid sphere of radius 25 um is pressed 15 um into slices
of 1 x 1 x 1 mm (data_mouse_brain of the public repository PatrickGio/Nanoindentation). PEER is that repository's
data_mouse_brain_MaterialParameters.txt: modulus [Pa], limit Jm and RMSE [N] of Gent's law by a network trained with
FEBio, a row for each sample. The phantom brain of Horton et al. (2007) is then indented with the median of each law,
scaled to 210 Pa. Writes OUT/brain_slices.csv, .png and prints the table. Five minutes with two threads.
"""

import csv
import gzip
import json
import pathlib
import subprocess
import sys

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402

import numpy as np  # noqa: E402

SCENE = ("--tool", "sphere:0.025mm", "--nu", "0.499", "--nodes", "2000")
LAWS = (  # --of, name, column in addition to mu, its option, colour
    ("mu", "neo-Hookean", None, None, "#1b3a6b"),
    ("mu,touch", "neo-Hookean, first contact sought", "touch_mm", None, "#7a5195"),
    ("mu,alpha", "Ogden", "alpha", "material.ogden_alpha", "#d55e00"),
    ("mu,limit", "Gent", "limit", "material.gent_limit", "#1e9e77"),
)
PAPER = {"left hemisphere": 0.181, "right hemisphere": 0.125, "their simulation": 0.131}  # [N] at 8 mm


def run(program, folder, *words):
    over = [] if words[0] == "phantom" else ["--force"]
    subprocess.run([program, *map(str, words), *over, "-q"], cwd=folder, check=True)


def table_of(file):
    with open(file) as rows:
        rows = list(csv.DictReader(rows))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def exponent(depth, force, low, high):
    """Of force ~ depth^n, by least squares of logarithms between two depths."""
    inside = (depth >= low * 0.999) & (depth <= high * 1.001) & (force > 0)
    return np.polyfit(np.log(depth[inside]), np.log(force[inside]), 1)[0]


def curves_in(packed, folder):
    with gzip.open(packed, "rt") as file:
        text = file.read()
    (folder / "curves.csv").write_text(text)
    return table_of(folder / "curves.csv")


def indent_slice(program, folder, name, options):
    run(program, folder, "run", "slice.nrrd", "-o", name, "--depth", "0.015mm", "--write", "force", "--frames", 40, "--band", "off", *SCENE, *options)
    made = table_of(folder / name / "force.csv")
    return 1e3 * made["indentation_mm"], 1e9 * made["force_N"]


def indent_brain(program, folder, name, options):
    """Depths [mm] and forces [N], up to where the run ended: stiffening tissue may pass a limit point."""
    try:
        run(program, folder, "run", "brain.nrrd", "-o", name, "--write", "force", "--band", "off", *options)
    except subprocess.CalledProcessError as ended:
        if ended.returncode != 5:  # no solution
            raise
    made = table_of(folder / name / "force.csv")
    return made["indentation_mm"], made["force_N"]


def options_of(law, number, mu):
    """Options of a law by its median number."""
    if law == "Ogden":
        return ["--set", f"material.ogden_mu_Pa={mu:g}", "--set", f"material.ogden_alpha={number:.6g}"]
    return ["--mu", f"{mu:g}Pa", *(["--set", f"material.gent_limit={number:.6g}"] if law == "Gent" else [])]


def main(program, packed, out, peer=None):
    out = pathlib.Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    program = str(pathlib.Path(program).resolve())
    measured = curves_in(packed, out)
    samples = np.unique(measured["sample"])
    grid = np.linspace(0.25, 15.0, 60)
    mean = np.mean([np.interp(grid, measured["indentation_um"][measured["sample"] == s], measured["force_nN"][measured["sample"] == s]) for s in samples], axis=0)
    run(program, out, "phantom", "slice.nrrd", "--shape", "block", "--size", "1,1,1", "--spacing", "0.05")
    run(program, out, "phantom", "brain.nrrd")
    rows, drawn = [], []
    for of, law, number, _, hue in LAWS:
        folder = "fit_" + of.replace(",", "_")
        run(program, out, "fit", "slice.nrrd", "-o", folder, "--curve", "curves.csv", "--of", of, *SCENE)
        fits, summary = table_of(out / folder / "fits.csv"), json.loads((out / folder / "summary.json").read_text())
        further = float(np.nanmedian(fits[number])) if number else float("nan")
        depth, force = indent_slice(program, out, folder.replace("fit", "slice"), options_of(law, further, summary["mu_Pa"]["median"]))
        at, brain = indent_brain(program, out, folder.replace("fit", "brain"), options_of(law, further, 210))
        mu = summary["mu_Pa"]
        rows.append({
            "law": law, "samples": len(samples), "fitted": int(np.isfinite(fits["mu_Pa"]).sum()),
            "mu_Pa": mu["median"], "mu_quarter_Pa": mu["quarter"], "mu_three_quarters_Pa": mu["three_quarters"],
            "number": further, "rms_percent": 100 * summary["rms_of_largest_force"]["median"],
            "exponent_2_6um": exponent(depth, force, 2, 6), "exponent_6_10um": exponent(depth, force, 6, 10),
            "exponent_10_15um": exponent(depth, force, 10, 15),
            "brain_N": float(np.interp(8.0, at, brain, right=float("nan"))), "brain_to_mm": float(at[-1]), "brain_exponent_2_4mm": exponent(at, brain, 2, 4),
        })
        drawn.append((law, hue, fits, depth, force, at, brain))
    rows.append({"law": "measured", "samples": len(samples), **{f"exponent_{a}_{b}um": exponent(grid, mean, a, b) for a, b in ((2, 6), (6, 10), (10, 15))}})
    if peer:
        theirs = np.loadtxt(peer)
        ours = drawn[-1][2]
        count = min(len(theirs), len(ours["mu_Pa"]))
        ratio = ours["mu_Pa"][:count] / theirs[:count, 0]
        rows.append({"law": "Gent by the peer", "samples": len(theirs), "mu_Pa": float(np.median(theirs[:, 0])), "number": float(np.median(theirs[:, 1]))})
        print(f"ours / theirs, {count} samples: modulus {np.nanmedian(ratio):.3f}, limit {np.nanmedian(ours['limit'][:count] / theirs[:count, 1]):.3f}")
    names = list(dict.fromkeys(name for row in rows for name in row))
    with open(out / "brain_slices.csv", "w") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows({name: f"{value:.6g}" if isinstance(value, float) else value for name, value in row.items()} for row in rows)
    print((out / "brain_slices.csv").read_text())
    draw(out / "brain_slices.png", grid, mean, drawn)


def draw(file, grid, mean, drawn):
    plt.rcParams.update({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False})
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 6.4), constrained_layout=True)
    axes[0, 0].plot(grid, mean, "k.", markersize=3, label="mean of 686 curves")
    for law, hue, fits, depth, force, at, brain in drawn:
        scale = np.interp(15.0, grid, mean) / np.interp(15.0, depth, force)
        axes[0, 0].plot(depth, scale * force, color=hue, label=f"{law}, scaled to its end")
        axes[0, 1].hist(fits["mu_Pa"][np.isfinite(fits["mu_Pa"])], bins=np.linspace(0, 2500, 51), histtype="step", color=hue, label=law)
        axes[1, 0].hist(100 * fits["rms_of_largest_force"], bins=np.linspace(0, 10, 51), histtype="step", color=hue, label=law)
        axes[1, 1].plot(at, brain, color=hue, label=law)
    for (name, force), up in zip(PAPER.items(), (0, -6, 4)):
        axes[1, 1].plot([8.0], [force], "s", markersize=4, color="#5a6068")
        axes[1, 1].annotate(f"{name}, {force} N", (8.0, force), (-6, up), textcoords="offset points", ha="right", va="center", fontsize=7)
    axes[1, 1].set_ylim(0, 0.3)
    for axis, title, x, y in zip(axes.flat, ("mean curve of the slices", "shear modulus", "residual", "phantom brain, 210 Pa"),
                                 ("indentation [um]", "mu [Pa]", "rms [% of the largest force]", "indentation [mm]"),
                                 ("force [nN]", "samples", "samples", "force [N]")):
        axis.set(title=title, xlabel=x, ylabel=y)
        axis.legend(frameon=False, fontsize=7, loc="upper left" if axis in (axes[0, 0], axes[1, 1]) else "upper right")
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    if not 4 <= len(sys.argv) <= 5:
        sys.exit(__doc__)
    main(*sys.argv[1:])
