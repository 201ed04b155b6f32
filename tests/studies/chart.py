"""Error of the force against wall time: schemes, numbers of nodes, requested accuracies.

    python3 tests/studies/chart.py -o OUT                                   two scenes with a known force
    python3 tests/studies/chart.py IMAGE -o OUT [--reference known.csv]     and an image of yours; --set is its

chart.csv, chart.png and chart.svg. Scenes A and B are made here as 1 mm images, left in the folder. An image without a
reference is shown by the difference from its finest run, without a front. Times are total,
from the image to the force. A run that fails is a row without an error. A lower panel shows the error estimates of the runs,
with the time of these included. Other programs are compared by fair_peer.py and contact_peer.py of tests/bench.
"""

import math
import os
import re
import statistics
import subprocess
import sys
from dataclasses import dataclass, field

import pydimple

import _study
from _study import Case, in_words, refuse

MOST_DEPTHS = 8  # 1, 2, ... mm
SCHEMES, TIMES = ["converging", "horton2007"], ["quasi-static", "explicit"]

# Horton, Wittek, Miller, MICCAI 2007, section 5: 0.131 N computed; 0.181 and 0.125 N measured at the two hemispheres of a swine
# brain, 0.153 N in the mean; 55 s on a 3 GHz Pentium 4.
PAPER_S, PAPER_ERROR = 55.0, 1 - 0.131 / (0.5 * (0.181 + 0.125))
PAPER = (
    "Horton et al. 2007, as reported for another body, a swine brain: 0.131 N computed, 0.181 and 0.125 N measured; 3 GHz Pentium 4"
)

# Forces [N] at 1, 2, ... 8 mm of a bonded patch of 5 mm radius: tests/verification/reference, which a test compares.
SCENES = {
    "a": {
        "title": "Scene A: block 60 x 60 x 30 mm",
        "phantom": "--shape block --size 60,60,30",
        "force_N": [0.00975, 0.0193, 0.0288, 0.0383, 0.0480, 0.0576, 0.0672, 0.0769],
        "known_to_percent": [0.4, 0.7, 1.1, 2.7, 3.0, 3.0, 4.0, 4.0],
        "source": "P2/P1 tetrahedra, rim 0.3 mm, code not here",
    },
    "b": {
        "title": "Scene B: cut ellipsoid 92.5 x 62.5 x 28.5 mm",
        "phantom": "--shape cut-ellipsoid --size 92.5,62.5,28.5",
        "force_N": [0.00972, 0.01923, 0.02867, 0.03807, 0.04764, 0.05708, 0.06639, 0.0759],
        "known_to_percent": [0.7, 0.9, 1.3, 2.9, 3.4, 3.3, 5.0, 4.5],
        "source": "block's x ratio of both by hexahedra.cpp",
    },
}


@dataclass
class Subject:
    """One scene, with one second for each millimetre. reference [N] at the depths; empty: the finest own run."""

    name: str
    title: str
    case: Case
    subtitle: list = field(default_factory=list)
    reference: list = field(default_factory=list)
    reference_name: str = ""
    depths: int = MOST_DEPTHS

    @property
    def known(self):
        return bool(self.reference)

    @property
    def at_mm(self):
        return [float(k + 1) for k in range(self.depths)]


@dataclass
class Point:
    """Results and costs of one run. runs: forces [N] of each discretisation, as far as it came; error: largest |force / reference - 1|;
    stated: half-width of the error bounds at the last depth, relative to the force; band_s: time of these bounds."""

    scene: str
    scheme: str
    time: str
    depths: int
    nodes: int = 0
    points: int = 0
    build_s: float = 0.0
    solve_s: float = 0.0
    runs: list = field(default_factory=list)
    status: str = "ok"
    error: float = 0.0
    error_last: float = 0.0
    on_front: bool = False
    stated: float = math.nan
    band_s: float = 0.0
    on_stated_front: bool = False

    @property
    def wall_s(self):
        return self.build_s + self.solve_s

    @property
    def complete(self):
        """True for a complete run; the picture has no others."""
        return self.status == "ok" and bool(self.runs) and len(self.runs[0]) == self.depths and self.error > 0

    @property
    def states_its_error(self):
        return self.status == "ok" and math.isfinite(self.stated)

    @property
    def is_dial(self):
        """An accuracy was requested and no number of nodes."""
        return self.scheme.startswith("accuracy")


def _larger(a, b):
    return b if math.isnan(a) else a if math.isnan(b) else max(a, b)


# -------------------------------------------------------------------------------------------------------------- our runs


def _stated(result):
    """Half-width of the error bounds at the last depth, relative to the force there; not a number if there are none."""
    if result.band_high_N is None:
        return math.nan
    return float((result.band_high_N[-1] - result.force_N[-1]) / abs(result.force_N[-1]))


def _run_all_seeds(point, subject, case, repeat, take):
    """Runs with several seeds: a single discretisation may be right by chance."""
    seed = case.values()["cloud.seed"]
    try:
        for number in range(repeat):
            result = case.having({"cloud.seed": seed + number}).run()
            point.nodes = max(point.nodes, result.summary["counts"]["nodes"])
            point.points = max(point.points, result.summary["counts"]["integration_points"])
            point.stated = _larger(point.stated, _stated(result))
            point.runs.append(_study.forces_at(1e3 * result.depth_m, result.force_N, subject.at_mm))
            take(result)
    except pydimple.Error as error:
        point.status = error.fact
    return point


def own_point(subject, scheme, of_time, nodes, repeat):
    with_band = scheme == "converging" and of_time == "quasi-static"
    settings = {"scheme.name": scheme, "solver.time": of_time, "cloud.nodes": nodes, "cloud.spacing_mm": 0}
    case = subject.case.having(settings | {"accuracy.band": "on" if with_band else "off"})
    point = Point(subject.name, scheme, of_time, subject.depths)
    build, solve, band = [], [], []

    def take(result):
        s = result.summary
        build.append(s["model"]["image_read_s"] + s["model"]["model_build_s"] + s["prepare_wall_s"])
        solve.append(s["solve_wall_s"])
        band.append(s["band_wall_s"])

    _run_all_seeds(point, subject, case, repeat, take)
    point.nodes = nodes
    if point.status == "ok":
        point.build_s, point.solve_s, point.band_s = (statistics.median(x) for x in (build, solve, band))
    return point


def dial_point(subject, goal, repeat):
    """Point for a requested accuracy: all discretisations of its refinement together."""
    point = Point(subject.name, f"accuracy {goal}", "quasi-static", subject.depths)
    solve = []

    def take(result):
        solve.append(result.summary["total_wall_s"])
        half = _stated(result)
        if point.status == "ok" and not half <= 0.01 * float(goal.rstrip("%")):
            point.status = f"not reached: half the band is {100 * half:.1f} %"

    case = Case(subject.case.image, {k: v for k, v in subject.case.given.items() if k not in ("cloud.nodes", "cloud.spacing_mm")})
    _run_all_seeds(point, subject, case.having({"accuracy.goal": goal}), repeat, take)
    if solve:
        point.solve_s = statistics.median(solve)
    return point


# ----------------------------------------------------------------------------------------------------------- errors, table


def set_errors(points, subject, reference):
    for p in points:
        if p.scene != subject.name:
            continue
        p.error = p.error_last = math.nan
        for force in p.runs if len(reference) else ():
            errors = [abs(f / r - 1) for f, r in zip(force, reference)]
            for error in errors:
                p.error = _larger(p.error, error)
            if len(errors) == len(reference):
                p.error_last = _larger(p.error_last, errors[-1])


def pareto_front(cost, error):
    """Points for which no other one is as cheap and as accurate and better in one of both, in order of cost. Points that are not finite are
    on no front."""
    finite = [k for k in range(len(cost)) if math.isfinite(cost[k]) and math.isfinite(error[k])]
    front = []
    for k in sorted(finite, key=lambda k: (cost[k], error[k], k)):
        equal = front and error[k] == error[front[-1]] and cost[k] == cost[front[-1]]
        if not front or error[k] < error[front[-1]] or equal:
            front.append(k)
    return front


def mark_front(points, subject):
    """Marks the points of the front. Differences between our own runs do not show which is right: without a reference there is no front."""
    here = [p.scene == subject.name for p in points]
    for p, is_here in zip(points, here):
        if is_here:
            p.on_front = p.on_stated_front = False
    cost = [p.wall_s if h and subject.known and p.complete else math.nan for p, h in zip(points, here)]
    for k in pareto_front(cost, [p.error for p in points]):
        points[k].on_front = True
    cost = [p.wall_s + p.band_s if h and p.states_its_error else math.nan for p, h in zip(points, here)]
    for k in pareto_front(cost, [p.stated for p in points]):
        points[k].on_stated_front = True


def table(points, subjects):
    lines = [
        "scene,program,scheme,time,nodes,points,build_s,solve_s,wall_s,largest_error,error_at_the_end,on_front,band_s,stated_error,"
        "on_stated_front,compared_with,status" + "".join(f",force_{k + 1}_mm_N" for k in range(MOST_DEPTHS))  # of the first discretisation
    ]

    def number(value):
        return f"{value:.6g}" if math.isfinite(value) else ""

    of = {subject.name: subject for subject in subjects}
    for p in points:
        row = [p.scene, "dimple", p.scheme, p.time, p.nodes, p.points, *(f"{s:.4g}" for s in (p.build_s, p.solve_s, p.wall_s))]
        row += [number(p.error), number(p.error_last), int(p.on_front), f"{p.band_s:.4g}", number(p.stated), int(p.on_stated_front)]
        row += [_study.quoted(of[p.scene].reference_name), _study.quoted(p.status)]
        force = p.runs[0] if p.runs else []
        row += [number(force[k]) if k < len(force) else "" for k in range(MOST_DEPTHS)]
        lines.append(",".join(str(cell) for cell in row))
    return "\n".join(lines) + "\n"


# ------------------------------------------------------------------------------------------------------------- pictures

# Channels: scheme, time, legend, place next to points, hue. Lines that belong together look alike in every panel.
_FAMILIES = [
    ("converging", "quasi-static", "converging, quasi-static", "converging", 0),
    ("accuracy", "quasi-static", "an accuracy asked for: all clouds of its ladder", "", 2),
    ("horton2007", "explicit", "horton2007, explicit", "horton2007", 1),
]


def _front(axes, points):
    if points:
        x, y = zip(*sorted(points))  # steps: no better than the last one for this time
        axes.step(x, y, where="post", color="#000000", linestyle="--", linewidth=0.9, label="Pareto front")


def _labelled(axes, x, y, labels, name, hue, filled=True, line="-"):
    colour = _study.HUES[hue]
    axes.plot(x, y, line, color=colour, marker="o", markersize=5, markerfacecolor=colour if filled else "white", label=name)
    for at in zip(x, y, labels):
        axes.annotate(at[2], at[:2], (4, 4), textcoords="offset points", fontsize=6, color="#333840")


def _error_panel(axes, subject, points):
    here = [p for p in points if p.scene == subject.name]
    what = "error of the force" if subject.known else "difference from that run"
    lines = subject.subtitle + [f"No point for {p.scheme} with {p.nodes} nodes: {p.status}" for p in here if p.status != "ok"]
    _study.headed(axes, subject.title, lines)
    _front(axes, [(p.wall_s, 100 * p.error) for p in here if p.on_front])
    for scheme, of_time, name, short, hue in _FAMILIES:
        of_family = [p for p in here if p.time == of_time and p.complete and (p.is_dial if scheme == "accuracy" else p.scheme == scheme)]
        if of_family:
            labels = [p.scheme if p.is_dial else f"{short} {p.nodes}" for p in of_family]
            _labelled(axes, [p.wall_s for p in of_family], [100 * p.error for p in of_family], labels, name, hue)
    _study.logarithmic(axes)
    axes.set_xlabel("wall time, from the image to the force curve [s]")
    axes.set_ylabel(f"largest {what} at 1, 2, ... {subject.depths} mm [%]")
    axes.axvline(subject.depths, color="#8a919b", linewidth=0.8)
    axes.annotate(f"real time, {subject.depths} s", (subject.depths, 0.02), xycoords=("data", "axes fraction"), fontsize=6, rotation=90)
    if subject.known:
        if subject.name != "image":
            name = "Horton et al. 2007, as reported"
            _labelled(axes, [PAPER_S], [100 * PAPER_ERROR], [f"{name}: 55 s"], name, 7, False, "")
        axes.axhline(2, color="#8a919b", linewidth=0.8)
        axes.annotate("2 %", (0.005, 2), xycoords=("axes fraction", "data"), fontsize=6, va="bottom")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=7)


def _stated_panel(axes, subject, points):
    """Draws the error estimates of the runs."""
    here = [p for p in points if p.scene == subject.name and p.states_its_error]
    note = f"half the band of the force at {subject.depths} mm; the time includes all clouds that it takes"
    _study.headed(axes, subject.title.rsplit(": ", 1)[0] + ": stated error against wall time", [note])
    _front(axes, [(p.wall_s + p.band_s, 100 * p.stated) for p in here if p.on_stated_front])
    for dial, name, hue in ((False, "a number of nodes asked for", 0), (True, "an accuracy asked for", 2)):
        some = [p for p in here if p.is_dial == dial]
        if some:
            labels = [p.scheme if dial else f"{p.nodes} nodes" for p in some]
            _labelled(axes, [p.wall_s + p.band_s for p in some], [100 * p.stated for p in some], labels, name, hue)
    _study.logarithmic(axes)
    axes.set_xlabel("wall time, from the image to the force curve with its band [s]")
    axes.set_ylabel("half the band's width [% of the force]")
    axes.legend(fontsize=7)


def draw(plt, folder, points, subjects):
    panels = []
    for subject in subjects:
        panels.append((_error_panel, subject))
        if any(p.scene == subject.name and p.states_its_error for p in points):
            panels.append((_stated_panel, subject))
    figure, all_axes = plt.subplots(len(panels), 1, figsize=(9.5, 6 * len(panels)), squeeze=False, constrained_layout=True)
    for axes, (panel, subject) in zip(all_axes[:, 0], panels):
        panel(axes, subject, points)
    _study.save(figure, folder, "chart")
    plt.close(figure)


# ----------------------------------------------------------------------------------------------------------- before all


def _check(case, options):
    _study.known_words(options.only, ["a", "b", "image"], "--only")
    _study.known_words(options.schemes, SCHEMES, "--schemes")
    _study.known_words(options.time, TIMES, "--time")
    for nodes in options.nodes + options.explicit_nodes:
        if nodes < 100:
            refuse(f"{nodes} nodes are too few: a cloud has at least 100")
    for goal in options.goals:
        if not re.fullmatch(r"\d+(\.\d+)?%", goal) or not float(goal[:-1]) > 0:
            refuse(f"accuracy.goal = {goal} is not allowed: for instance --goals 5%,3%")
    if not options.nodes or options.repeat < 1:
        refuse("a chart needs at least one cloud size and one run of it")
    if not case.image and "image" in options.only:
        refuse("no label image was given, and --only image takes one")
    if not case.image and options.reference:
        refuse("a reference was given, but no label image that it is of: the two scenes have references of their own")


def _how(options, threads):
    clouds = f"{options.repeat} clouds each: median time, worst error" if options.repeat > 1 else "one run each"
    return f"circle of 10 mm, bonded, 8 mm deep in 8 s; {threads} threads, {clouds}"


def _scenes(options, folder, threads):
    settings = {"boundary.base": "inferior", "boundary.indent_at": "0,0,top", "solver.frames": MOST_DEPTHS, "load.depth_mm": MOST_DEPTHS}
    for name, scene in SCENES.items():
        if options.only and name not in options.only:
            continue
        file = folder / f"scene_{name}.nrrd"
        subprocess.run([_study.program(), "phantom", str(file), *scene["phantom"].split(), "--spacing", "1", "-q"], check=True)
        known = scene["known_to_percent"]
        yield Subject(
            name,
            scene["title"] + ": error against wall time",
            Case(file, settings),
            ["against mixed finite elements; " + _how(options, threads), PAPER],
            scene["force_N"],
            f"{scene['source']}; known to {known[0]:.2g} %, to +-{known[-1]:.2g} % at 8 mm",
        )


def _of_image(case, options, known, threads):
    name = os.path.basename(case.image)
    subject = Subject("image", f"{name}: difference against wall time", case)
    if known:
        of = os.path.basename(options.reference)
        diameter = _study.text_of(case.values()["boundary.indenter_diameter_mm"])
        subject.title = f"{name}: error against wall time"
        subject.subtitle = [f"against {of}; circle of {diameter} mm, bonded, {len(known)} mm deep; {threads} threads"]
        subject.reference, subject.reference_name, subject.depths = known, of, len(known)
    settings = {"load.depth_mm": subject.depths, "load.rate_mm_per_s": 1, "solver.frames": subject.depths}
    subject.case = case.having(settings, os.path.abspath(case.image))
    return subject


class Notes:
    """Records each point as it is computed, and then errors, fronts and the table, since a long chart may be interrupted."""

    def __init__(self, folder, subjects, how, say):
        self.folder, self.subjects, self.how, self.say, self.points = folder, subjects, how, say, []

    def _finest(self, subject):
        own = [
            p
            for p in self.points
            if p.scene == subject.name and p.scheme == "converging" and p.status == "ok" and len(p.runs[0]) == p.depths
        ]
        return max(own, key=lambda p: p.nodes, default=None)

    def __call__(self, subject, point):
        self.points.append(point)
        reference, finest = subject.reference, None if subject.known else self._finest(subject)
        if finest:
            reference = finest.runs[0]
            subject.reference_name = f"difference from {finest.nodes} nodes"
            subject.subtitle = [
                f"difference from our own finest run, {finest.nodes} nodes (converging, {finest.time}: {reference[-1]:.4f} N at 8 mm), "
                f"whose cloud has no point; {self.how}",
                "That run is no reference: how far it is itself from the converged force is not known.",
            ]
        set_errors(self.points, subject, reference)
        # Points with the reference's own discretisation have no error.
        for p in self.points if finest else ():
            if p.scene == subject.name and p.scheme == finest.scheme and p.nodes == finest.nodes:
                p.error = p.error_last = math.nan
        mark_front(self.points, subject)
        _study.write(self.folder / "chart.csv", table(self.points, self.subjects))
        words = point.status
        if point.status == "ok" and math.isnan(point.error):
            words = f"{point.wall_s:.2f} s, {in_words(point.runs[0][-1])} at the end"
        elif point.status == "ok":
            what = "difference" if finest else "error"
            words = f"{point.wall_s:.2f} s, {what} {100 * point.error:.2f} % at most, {100 * point.error_last:.2f} % at the end"
        self.say(f"{point.scene:<5} {point.scheme:<10} {point.time:<12} {point.nodes:>6} nodes: {words}")


def _run_all(subject, options, note):
    nodes = sorted(options.nodes)
    explicit = sorted(options.explicit_nodes) or [n for n in nodes if n <= 4250]
    for scheme, of_time, *_ in _FAMILIES:
        if scheme in options.schemes and of_time in options.time:
            for count in explicit if of_time == "explicit" else nodes:
                note(subject, own_point(subject, scheme, of_time, count, options.repeat))
    for goal in options.goals:
        note(subject, dial_point(subject, goal, options.repeat))


def study(case, options, say):
    options.goals = [goal for goal in options.goals if goal != "none"]
    _check(case, options)
    folder = _study.folder_for(options.out, "chart.csv").absolute()
    plt = _study.pyplot()
    known = _study.reference_at(options.reference) if options.reference else []
    threads = options.threads or len(os.sched_getaffinity(0))
    with_image = bool(case.image) and (not options.only or "image" in options.only)
    if with_image:
        pydimple.usable_places(case.image)  # an image that cannot be read is refused before the first run
    _study.write(folder / "chart.csv", table([], []))  # the folder is ours from here on
    subjects = list(_scenes(options, folder, threads)) + ([_of_image(case, options, known, threads)] if with_image else [])
    if not options.explicit_nodes and "explicit" in options.time and max(options.nodes) > 4250:
        say("explicit runs: up to 4250 nodes (--explicit-nodes: others)")
    note = Notes(folder, subjects, _how(options, threads), say)
    stopped = False
    try:
        for subject in subjects:
            _run_all(subject, options, note)
    except KeyboardInterrupt:
        stopped = True
    if stopped:  # a picture takes longer than the limit for Ctrl-C
        raise KeyboardInterrupt(f"chart.csv has the {len(note.points)} runs until then")
    draw(plt, folder, note.points, subjects)
    drawn = sum(p.complete for p in note.points)
    return f"{drawn} of {len(note.points)} runs in the chart"


def main(argv=None):
    of = _study.parser("chart", "Draw error against wall time: two scenes whose force is known, and an image of yours.")
    words, numbers = _study.words, _study.whole_numbers
    of.add_argument("--only", type=words, default=[], help="scenes: a, b, image [all]")
    of.add_argument("--reference", help="CSV with columns indentation_mm, force_N of the image: its depths are run")
    of.add_argument("--nodes", type=numbers, default=[600, 1000, 2000, 3000, 4250, 8500], help="numbers of nodes")
    of.add_argument("--goals", type=words, default=["10%", "5%", "3%"], help="accuracies to ask for, or none")
    of.add_argument("--schemes", type=words, default=SCHEMES, help="converging (quasi-static), horton2007 (explicit)")
    of.add_argument("--time", type=words, default=TIMES, help="quasi-static, explicit")
    of.add_argument("--explicit-nodes", type=numbers, default=[], help="of explicit runs [those of --nodes up to 4250]")
    of.add_argument("--repeat", type=int, default=1, help="clouds of each size: times are medians, errors the largest")
    return _study.main(of, study, argv)


if __name__ == "__main__":
    sys.exit(main())
