"""Convergence of a scene's force over numbers of nodes, densities of points and seeds.

    python3 tests/studies/converge.py IMAGE -o OUT [--sizes 1000,2000,4000] [--reference known.csv] [--depth 5mm ...]

convergence.csv holds every run, convergence.md the conclusions, convergence.png and .svg show both. Per depth and
number of nodes: the mean force over the seeds, their scatter (largest - smallest), the change by doubling the points, the
difference from the reference, or without one from the finest discretisation, and the largest kink: second difference of the curve
over its last force.
"""

import itertools
import sys

import numpy as np

import _study
from _study import in_words, refuse, shortest

_HEADER = [
    "nodes", "points", "density", "seed", "spacing_mm", "rim_spacing_mm", "indentation_mm", "force_N", "evaluations", "wall_s",
]  # fmt: skip
_POINTS_PER_NODE = {"converging": 7.0, "horton2007": 1.499}  # default of grid.ratio


def measured(case, depths):
    """Force curve of a run and its cost. Raises the exceptions of a run."""
    result = case.run()
    summary = result.summary
    model = summary["model"]
    return {
        "nodes": summary["counts"]["nodes"],
        "points": summary["counts"]["integration_points"],
        "spacing_mm": model["node_spacing_mm"],
        "rim_spacing_mm": model["rim_spacing_mm"],
        "evaluations": summary["force_evaluations"],
        "wall_s": model["image_read_s"] + model["model_build_s"] + summary["prepare_wall_s"] + summary["solve_wall_s"],
        "force": np.array(_study.forces_at(1e3 * result.depth_m, result.force_N, depths)),
        "warnings": list(result.warnings),
    }


def kink(force):
    """Kink of forces at even depths, the first of them one step from rest."""
    force = np.concatenate([[0.0], force])
    return np.max(np.abs(np.diff(force, 2)), initial=0.0) / abs(force[-1])


def grouped(runs):
    """Groups of runs over the seeds, by number of nodes and density."""
    groups = []
    for (nodes, density), of_group in itertools.groupby(runs, key=lambda run: (run["of_nodes"], run["density"])):
        members = list(of_group)
        forces = np.array([run["force"] for run in members])
        mean = forces.mean(axis=0)
        group = {name: np.mean([run[name] for run in members]) for name in ("points", "spacing_mm", "rim_spacing_mm", "evaluations", "wall_s")}
        group |= {"nodes": nodes, "density": density, "mean": mean, "scatter": np.ptp(forces, axis=0) / mean}
        group["kink"] = max(kink(run["force"]) for run in members)
        groups.append(group)
    return groups


def doubled(group, groups):
    return next((g for g in groups if g["nodes"] == group["nodes"] and abs(g["density"] - 2 * group["density"]) < 1e-9), None)


def table(groups, depths, reference):
    against = groups[-1]["mean"] if reference is None else reference
    text = (
        f"| nodes | points | spacing far / rim mm | difference from {'the finest' if reference is None else 'the reference'} at "
        f"{', '.join(shortest(d) for d in depths)} mm, % | seeds scatter %, at most | doubling the points, %, at most | "
        "kink %, at most | evaluations | s |\n|---|---|---|---|---|---|---|---|---|\n"
    )
    for g in groups:
        twice = doubled(g, groups)
        doubling = "" if twice is None else f"{np.max(np.abs(100 * (twice['mean'] / g['mean'] - 1))):.2f}"
        errors = " ".join(f"{100 * e:+.2f}" for e in g["mean"] / against - 1)
        text += (
            f"| {g['nodes']} | {g['points']:.0f} | {g['spacing_mm']:.2f} / {g['rim_spacing_mm']:.2f} | {errors} | "
            f"{100 * g['scatter'].max():.2f} | {doubling} | {100 * g['kink']:.2f} | {g['evaluations']:.0f} | {g['wall_s']:.1f} |\n"
        )
    return text


def draw(plt, folder, title, groups, depths, reference, ratio, seeds):
    against = groups[-1]["mean"] if reference is None else reference
    densities = list(dict.fromkeys(g["density"] for g in groups))
    figure, (errors, curves) = plt.subplots(2, 1, figsize=(9, 11.5), constrained_layout=True)
    of = "the finest cloud" if reference is None else "the reference"
    _study.headed(errors, f"{title}: convergence", [f"force against {of}, mean of {seeds} seeds"])
    chosen = sorted({0, max(len(depths) // 2 - 1, 0), len(depths) - 1})
    for colour, k in enumerate(chosen):
        for density in densities:
            some = [g for g in groups if g["density"] == density]
            errors.plot(
                [g["nodes"] for g in some],
                [100 * (g["mean"][k] / against[k] - 1) for g in some],
                color=_study.HUES[colour],
                marker="o",
                linestyle="-" if density == densities[0] else "--",
                markerfacecolor=None if density == densities[0] else "white",
                label=f"{depths[k]:.3g} mm, {density * ratio:.3g} points per node",
            )
    for at in (-2, 2):
        errors.axhline(at, color="#8a919b", linewidth=0.8)
    errors.set(xscale="log", xlabel="nodes", ylabel="difference in force [%]")
    sizes = sorted({g["nodes"] for g in groups})
    errors.set_xticks(sizes, sizes)
    errors.set_xticks([], minor=True)
    _study.headed(curves, "force curves")
    for g in (g for g in groups if g["density"] == densities[0]):
        curves.plot(depths, g["mean"], marker="o", label=f"{g['nodes']} nodes")
    if reference is not None:
        curves.plot(depths, reference, "kD", label="reference")
    curves.set(xlabel="indentation [mm]", ylabel="force [N]")
    for axes in (errors, curves):
        axes.legend()
    _study.save(figure, folder, "convergence")
    plt.close(figure)


def study(case, options, say):
    if len(options.sizes) < 2 or not options.densities or options.seeds < 1:
        refuse("a study needs at least two cloud sizes, one density and one seed")
    if not case.image:
        refuse("no label image was given")
    values = case.values()
    frames, deepest = values["solver.frames"], values["load.depth_mm"]
    depths = [deepest * (k + 1) / frames for k in range(frames)]
    reference = np.array(_study.reference_at(options.reference, depths)) if options.reference else None
    ratio = values["grid.ratio"] or _POINTS_PER_NODE[values["scheme.name"]]
    plt = _study.pyplot()
    folder = _study.folder_for(options.out, "convergence.csv")
    rows, runs = [_HEADER + (["reference_N"] if options.reference else [])], []
    case = case.having({"accuracy.band": "off", "cloud.spacing_mm": 0, "grid.points": 0})
    try:
        for nodes, density, number in itertools.product(options.sizes, options.densities, range(options.seeds)):
            seed = values["cloud.seed"] + number
            own = case.having({"cloud.nodes": nodes, "cloud.seed": seed, "grid.ratio": ratio * density})
            run = measured(own, depths)
            runs.append({**run, "of_nodes": nodes, "density": density})
            for k, (depth, force) in enumerate(zip(depths, run["force"])):
                row = [run["nodes"], run["points"], density, seed, run["spacing_mm"], run["rim_spacing_mm"], depth, force]
                row += [run["evaluations"], run["wall_s"]] + ([reference[k]] if options.reference else [])
                rows.append([shortest(value) for value in row])
            # Results are written after every run: a long study may be interrupted.
            _study.write(folder / "convergence.csv", "\n".join(",".join(row) for row in rows) + "\n")
            say(
                f"{run['nodes']:>6} nodes, {run['points']:>7} points, seed {seed}: {in_words(run['force'][-1])} at "
                f"{depths[-1]:.3g} mm, {run['wall_s']:.1f} s"
            )
    except KeyboardInterrupt:
        if not runs:
            raise
        raise KeyboardInterrupt(f"convergence.csv has the {len(runs)} runs until then") from None
    # Most runs have the same warnings.
    for warning in dict.fromkeys(warning for run in runs for warning in run["warnings"]):
        say(f"warning: {warning}")
    groups = grouped(runs)
    text = table(groups, depths, reference)
    _study.write(folder / "convergence.md", text)
    draw(plt, folder, case.image.rsplit("/", 1)[-1], groups, depths, reference, ratio, options.seeds)
    coarsest = 100 * abs(groups[0]["mean"][-1] / groups[-1]["mean"][-1] - 1)
    return (
        f"{text}finest {in_words(groups[-1]['mean'][-1])} at {depths[-1]:.3g} mm; coarsest differs by {coarsest:.2f} %, seeds by "
        f"at most {100 * max(g['scatter'].max() for g in groups):.2f} %"
    )


def main(argv=None):
    of = _study.parser("converge", "Run one scene with several clouds: how far its force can be trusted.", flags=True)
    of.add_argument("--sizes", type=_study.whole_numbers, default=[1000, 2000, 4250, 8500], help="numbers of nodes")
    of.add_argument(
        "--densities",
        type=lambda text: [float(word) for word in _study.words(text)],
        default=[1.0, 2.0],
        help="of points, as multiples of the usual",
    )
    of.add_argument("--seeds", type=int, default=3, help="clouds of each size")
    of.add_argument("--reference", help="CSV with indentation_mm and force_N to compare with")
    return _study.main(of, study, argv)


if __name__ == "__main__":
    sys.exit(main())
