"""Maps of success and failure over two options each, with both schemes side by side.

    python3 tests/studies/atlas.py -o OUT [--map depth-nu,...]                  the maps of a block, or some of them
    python3 tests/studies/atlas.py [IMAGE] -o OUT --x material.nu=0.3,0.499 --y cloud.nodes=500,1000      a map of your own

Per map stress_NAME.csv, .png and .svg with a panel for each scheme, and stress.csv with the number of cells for each outcome. Each run
is a process of `dimple run` on one thread, as many at once as there are threads. Its results go to runs/NAME.json as
soon as it ends, and a later call reuses them if options, image and program are the same. Tables and pictures depend on
these alone: same input, same bytes, however often it was interrupted. A run that was out of time runs again if the limit has
changed.
"""

import base64
import concurrent.futures
import hashlib
import json
import math
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import textwrap
import time
from dataclasses import dataclass, field

import numpy as np

import _study
from _study import Case, refuse

SCHEMES = ["converging", "horton2007"]

# Criteria for a cell in addition to a finished run.
# Largest sudden change of the force curve's slope, relative to its mean slope:
# |F(k+1) - 3 F(k) + 3 F(k-1) - F(k-2)| / (F(k+1) / (k+1)), k counting frames from F(0) = 0. For a smooth curve, even a
# stiffening one, this decreases with the distance of frames; for a bend or a drop it does not.
KINK = 0.25
ENERGY = 0.02  # unbalanced, as a part of the tool's work
# Inverted volume, relative to the half ball under the bonded patch. The strain at its sharp edge is
# unbounded, and no discretisation keeps every point upright.
INVERTED = 0.01
ERROR = 0.05  # of the force against the finest stable run


# ------------------------------------------------------------------------------------------------------------- the maps


@dataclass
class Axis:
    """One side of a map: an option and its values. Two keys are special. load.depth_mm: all depths come from one run to the deepest, so
    they are even steps of it. phantom.height_mm: the height of the block, each an image of its own."""

    key: str
    values: list
    label: str = ""
    ticks: list = field(default_factory=list)

    @property
    def is_depth(self):
        return self.key == "load.depth_mm"

    @property
    def is_height(self):
        return self.key == "phantom.height_mm"

    @property
    def steps(self):
        return 1 if self.is_depth else len(self.values)

    # Two at least for each depth, so that a bend between depths shows. Sixteen in all, so that the work summed over
    # them is that of the curve.
    @property
    def frames_a_depth(self):
        return max(2, (15 + len(self.values)) // len(self.values))


@dataclass
class Map:
    name: str
    title: str
    scene: str
    x: Axis
    y: Axis
    settings: dict
    block_mm: tuple = (60, 60, 30)

    def schemes(self, wanted, given):
        """Those that know the scene: of a contacting tool the default one alone."""
        touches = any(key.startswith("tool.") for key in [self.x.key, self.y.key, *self.settings, *given])
        return [scheme for scheme in wanted if scheme == SCHEMES[0] or not touches]


def _depths(count, deepest_mm):
    """Depths in even steps into a block of 30 mm."""
    depths = [deepest_mm * k / count for k in range(1, count + 1)]
    return Axis(
        "load.depth_mm",
        [_study.text_of(d) for d in depths],
        "indentation [mm], and as a part of the height",
        [f"{_study.text_of(d)} mm, {100 * d / 30:.0f} %" for d in depths],
    )


def _scene(**special):
    # With resolved waves, 2 mm/s is slow, too: the waves of the start stay below a per cent of the force.
    scene = {"boundary.base": "inferior", "boundary.indent_at": "0,0,top", "load.rate_mm_per_s": "2"}
    return scene | {key.replace("__", "."): text for key, text in special.items()}


_CLOUDS = Axis("cloud.nodes", ["250", "500", "1000", "2000"], "nodes")

MAPS = [
    Map(
        "depth-nu",
        "Depth and Poisson's ratio",
        "block 60 x 60 x 30 mm, circle of 10 mm, bonded; 2000 nodes; at most 3000 evaluations an equilibrium",
        Axis("material.nu", ["0.3", "0.45", "0.49", "0.499", "0.4999"], "Poisson's ratio"),
        _depths(14, 21.0),
        _scene(cloud__nodes="2000", solver__evaluations="3000"),
    ),
    Map(
        "support-nodes",
        "Support size and node spacing",
        "block 60 x 60 x 30 mm, circle of 10 mm, bonded, 4 mm deep",
        Axis("support.radius_factor", ["1.2", "1.4", "1.6", "1.8", "2.2", "3"], "support radius, in node spacings"),
        _CLOUDS,
        _scene(load__depth_mm="4", solver__frames="8"),
    ),
    Map(
        "jitter-points",
        "Irregularity of the cloud and integration points per node",
        "block 60 x 60 x 30 mm, circle of 10 mm, bonded, 4 mm deep; 1000 nodes",
        Axis("grid.ratio", ["0.7", "1.5", "2.5", "4", "7", "12"], "integration points per node"),
        Axis("cloud.jitter", ["0", "0.1", "0.2", "0.35", "0.5"], "nodes moved by up to this part of their spacing"),
        _scene(cloud__nodes="1000", load__depth_mm="4", solver__frames="8"),
    ),
    Map(
        "step-depth",
        "Time step and depth, explicit dynamics",
        "block 60 x 60 x 30 mm, circle of 10 mm, bonded, --time explicit --damping 5; 2000 nodes",
        Axis("solver.safety", ["0.6", "0.9", "1", "1.05", "1.2", "2"], "time step, as a part of the stable step that was estimated"),
        _depths(10, 10.0),
        _scene(cloud__nodes="2000", solver__time="explicit", solver__damping_per_s="5", load__rate_mm_per_s="1"),
    ),
    Map(
        "circle-nodes",
        "Size of the indenter and node spacing",
        "block 60 x 60 x 30 mm, bonded, 2 mm deep",
        Axis("boundary.indenter_diameter_mm", ["2", "4", "6", "10", "20", "40"], "diameter of the contact patch [mm]"),
        _CLOUDS,
        _scene(load__depth_mm="2", solver__frames="8"),
    ),
    Map(
        "layer-nodes",
        "Thin layers and node spacing",
        "layer of 40 x 40 mm, held below, circle of 10 mm, bonded, 0.2 mm deep",
        Axis("phantom.height_mm", ["1", "2", "3", "5", "10", "20"], "height of the layer [mm]"),
        _CLOUDS,
        _scene(load__depth_mm="0.2", solver__frames="4", load__rate_mm_per_s="0.2"),
        (40, 40, 20),
    ),
    Map(
        "tool-depth",
        "Tools that touch, and depth",
        "block 60 x 60 x 30 mm, frictionless; 2000 nodes",
        Axis(
            "tool.shape",
            ["sphere:5mm", "sphere:10mm", "capsule:4mm,length=20mm", "punch:5mm,edge=2.5mm", "punch:5mm,edge=1mm"],
            "the tool, its radius",
            ["sphere\n5 mm", "sphere\n10 mm", "rod 4 mm,\n20 long", "punch 5 mm,\nedge 2.5", "punch 5 mm,\nedge 1"],
        ),
        _depths(12, 9.0),
        _scene(cloud__nodes="2000"),
    ),
    Map(
        "friction-depth",
        "Friction and depth",
        "block 60 x 60 x 30 mm, sphere of 5 mm; 2000 nodes",
        Axis("tool.friction", ["0", "0.1", "0.3", "0.6", "stick"], "Coulomb's coefficient"),
        _depths(12, 9.0),
        _scene(cloud__nodes="2000", tool__shape="sphere:5mm"),
    ),
]


def check_axis(axis, flag):
    if len(axis.values) < 2:
        count = f"{len(axis.values)} value{'' if len(axis.values) == 1 else 's'}"
        refuse(f"{flag}: {axis.key} has {count}, and a side of a map at least two")
    if len(set(axis.values)) < len(axis.values):
        refuse(f"{flag}: a value of {axis.key} is given twice")
    if axis.is_height:
        return
    values = [Case("", {axis.key: value}).values().get(axis.key) for value in axis.values]
    if axis.is_depth:
        for k, depth in enumerate(values):
            even = values[-1] * (k + 1) / len(values)
            if abs(depth - even) > 1e-6 * values[-1]:
                refuse(f"{flag}: the depths are not even steps: {axis.values[k]} where {even:.6g} mm is expected")


def axis_of(text, flag):
    """Axis from a text such as "material.nu=0.3,0.45"."""
    key, equals, values = text.partition("=")
    if not equals:
        refuse(f"{flag}: '{text}' is not key=value,value")
    axis = Axis(_study.key_of(key), values.split(","))
    Case("", {} if axis.is_height else {axis.key: axis.values[0]}).values()  # an unknown option, before the number of values
    check_axis(axis, flag)
    return axis


def is_physical(key):
    """True if an option belongs to the physical case; the others say how it is computed."""
    return key.split(".")[0] not in ("scheme", "cloud", "grid", "support", "solver")


def finest_of(case, nodes):
    """The case by the converging scheme with so many nodes; numerical options except frames and evaluations have their defaults."""
    kept = {k: v for k, v in case.given.items() if is_physical(k) or k in ("solver.frames", "solver.evaluations")}
    return Case(case.image, kept | {"cloud.nodes": str(nodes)})


# ------------------------------------------------------------------------------------------------------------ one run


@dataclass
class Frame:
    """A run at one depth. energy_error: largest imbalance so far, relative to the tool's work so far; J_min: at any point; inverted,
    inverted_mm3: inverted points, and their volume at rest."""

    depth_mm: float
    force_N: float
    energy_error: float = 0.0
    J_min: float = 1.0
    inverted: int = 0
    inverted_mm3: float = 0.0


@dataclass
class Run:
    """Record of a run. ended: empty if it finished, otherwise the code of its failure; fact: its words; guards: codes of its warnings."""

    ended: str = ""
    fact: str = ""
    frames: list = field(default_factory=list)
    nodes: int = 0
    points: int = 0
    retries: int = 0
    guards: str = ""


@dataclass
class Verdict:
    code: str = ""
    force_N: float = math.nan
    reference_N: float = math.nan
    reference_nodes: int = 0
    error: float = 0.0  # signed; where all depths count the largest
    kink: float = 0.0
    energy_error: float = 0.0
    J_min: float = 1.0
    inverted: int = 0
    inverted_mm3: float = 0.0


def _kink_at(run, k):
    if k < 2:
        return 0.0
    F = [0.0] + [frame.force_N for frame in run.frames]
    slope = abs(F[k + 1]) / (k + 1)
    return abs(F[k + 1] - 3 * F[k] + 3 * F[k - 1] - F[k - 2]) / max(slope, 1e-300)


def _own_fault(run, last, circle_radius_mm, verdict):
    """Failure of a run apart from the comparison with a finer run; empty: none."""
    if len(run.frames) < last:
        return run.ended or "crashed"
    for n, frame in enumerate(run.frames[:last]):
        if not all(math.isfinite(x) for x in (frame.force_N, frame.energy_error, frame.J_min)):
            return "non-finite"
        verdict.kink = max(verdict.kink, _kink_at(run, n))
    frame = run.frames[last - 1]
    verdict.energy_error, verdict.J_min = frame.energy_error, frame.J_min
    verdict.inverted, verdict.inverted_mm3 = frame.inverted, frame.inverted_mm3
    if verdict.energy_error > ENERGY:
        return "energy"
    if verdict.inverted_mm3 > INVERTED * 2 / 3 * math.pi * circle_radius_mm**3:
        return "inverted"
    return "kinked" if verdict.kink > KINK else ""


def judge(run, finest, last, at_last_only, circle_radius_mm):
    """Judges a run up to its frame number `last`, from 1. `finest` are runs of the case to compare with, the finest
    first; one that is not stable up to a depth is not used there. With `at_last_only` the force counts at that
    frame alone, else at each up to it.

    Codes, the first that applies: the failure of the run before that frame; non-finite; energy; inverted; kinked; unchecked (no finer
    stable run); inaccurate; ok-rim (inverted points at the patch edge only); ok.
    """
    v = Verdict()
    if len(run.frames) >= last:
        v.force_N = run.frames[last - 1].force_N
    reference = next((r for r in finest if not _own_fault(r, last, circle_radius_mm, Verdict())), None)
    if reference:
        v.reference_N = reference.frames[last - 1].force_N
        v.reference_nodes = reference.nodes
        for n in range(last - 1 if at_last_only else 0, min(last, len(run.frames))):
            error = run.frames[n].force_N / reference.frames[n].force_N - 1
            if not abs(error) <= abs(v.error):
                v.error = error
    v.code = _own_fault(run, last, circle_radius_mm, v)
    if not v.code and not reference:
        v.code = "unchecked"
    elif not v.code and not abs(v.error) <= ERROR:
        v.code = "inaccurate"
    elif not v.code:
        v.code = "ok-rim" if v.inverted > 0 else "ok"
    return v


def survived(code):
    return code.startswith("ok")


def _columns(file):
    table = np.genfromtxt(file, delimiter=",", names=True)
    return {name: np.atleast_1d(table[name]) for name in table.dtype.names}


def _unpacked(block):
    """Unpacks a block of LZ4: literal bytes, then a copy of preceding ones, and so on."""
    out, at = bytearray(), 0

    def length(of):
        nonlocal at
        more = 255 if of == 15 else 0
        while more == 255:
            more = block[at]
            of, at = of + more, at + 1
        return of

    while True:
        token = block[at]
        at += 1
        count = length(token >> 4)
        out += block[at : at + count]
        at += count
        if at >= len(block):
            return bytes(out)
        start = len(out) - int.from_bytes(block[at : at + 2], "little")
        at += 2
        count = length(token & 15) + 4
        again = out[start : start + count]  # too short if it overlaps the bytes that it makes
        out += (again * (count // len(again) + 1))[:count]


def _array(text, name):
    """Values for each point of a .vtu file, whose arrays are packed by LZ4 and written in base64."""
    kind, packed = re.search(rf'<DataArray type="(\w+)" Name="{name}"[^>]*>\s*(\S+)', text).groups()
    blocks = int.from_bytes(base64.b64decode(packed[:8])[:4], "little")
    words = 4 * -(-4 * (3 + blocks) // 3)  # of the head: how many blocks, their size, the last one's, and each one's packed
    sizes, data = np.frombuffer(base64.b64decode(packed[:words]), "<u4")[3:], base64.b64decode(packed[words:])
    ends = np.cumsum(sizes)
    whole = b"".join(_unpacked(data[end - size : end]) for end, size in zip(ends, sizes))
    return np.frombuffer(whole, {"Float32": "<f4", "Float64": "<f8"}[kind]).astype(float)


def _frames_of(out):
    """Frames from the files of a run: forces and energies at their depths, and the state of the points there."""
    force, energy = _columns(out / "force.csv"), _columns(out / "energy.csv")
    times = [float(t) for t in re.findall(r'timestep="([^"]+)"', (out / "points.pvd").read_text())]
    frames = []
    for number, t in enumerate(times):
        if number == 0 or t > force["time_s"][-1] * (1 + 1e-9):
            continue
        depth = float(np.interp(t, force["time_s"], force["indentation_mm"]))
        so_far = energy["indentation_mm"] <= depth * (1 + 1e-6)
        work = np.max(np.abs(energy["external_work_J"][so_far]), initial=0.0)
        amiss = np.max(np.abs(energy["error_J"][so_far]), initial=0.0)
        points = (out / "points" / f"points_{number:04d}.vtu").read_text()
        J, volume = (_array(points, name) for name in ("jacobian", "volume_mm3"))
        frames.append(
            Frame(
                depth,
                float(np.interp(depth, force["indentation_mm"], force["force_N"])),
                float(amiss / work) if work > 0 else 0.0,
                float(J.min()),
                int(np.sum(~(J > 0))),
                float(volume[~(J > 0)].sum()),
            )
        )
    return frames


# ------------------------------------------------------------------------------------------------------------ running


class Runner:
    """Runs all jobs not yet done, as many at once as there are threads."""

    def __init__(self, folder, limit_s, threads, say):
        self.program, self.folder, self.limit_s, self.threads, self.say = _study.program(), folder, limit_s, threads, say
        self.program_sha256 = _sha256(self.program)
        self.image_sha256 = {}
        self.runs = {}  # name -> Run
        self.expected, self.now = 0, set()
        self.stop = False

    def __call__(self, jobs):
        """`jobs`: (name, message, case)."""
        left = []
        for name, says, case in jobs:
            self.image_sha256.setdefault(case.image, _sha256(case.image))
            kept = self._kept(name, case)
            if kept:
                self.runs[name] = kept
            else:
                left.append((name, says, case))
        pool = concurrent.futures.ThreadPoolExecutor(self.threads)
        futures = [pool.submit(self._run, *job) for job in left]
        try:
            for future in concurrent.futures.as_completed(futures):
                future.result()
        finally:
            self.stop = True
            pool.shutdown(cancel_futures=True)
            self.stop = False

    def _settings(self, case):
        return {
            "arguments": case.arguments(),
            "image_sha256": self.image_sha256[case.image],
            "program_sha256": self.program_sha256,
        }

    def _kept(self, name, case):
        try:
            kept = json.loads((self.folder / f"{name}.json").read_text())
            if kept.pop("settings") != self._settings(case) or kept.pop("limit_s", self.limit_s) != self.limit_s:
                return None
            frames = [Frame(*(math.nan if x is None else x for x in frame)) for frame in kept.pop("frames")]
            return Run(frames=frames, **kept)
        except (OSError, ValueError, KeyError, TypeError):  # of another version, or damaged: run again
            return None

    def _keep(self, name, case, run):
        def number(x):
            return x if math.isfinite(x) else None

        frames = [[number(x) for x in vars(frame).values()] for frame in run.frames]
        limit = {"limit_s": self.limit_s} if run.ended == "time-out" else {}
        text = json.dumps({"settings": self._settings(case), **limit, **vars(run), "frames": frames}, indent=1)
        _study.write(self.folder / f"{name}.json", text + "\n")

    def _run(self, name, says, case):
        begun = time.monotonic()
        with tempfile.TemporaryDirectory() as scratch:
            run = self._computed(case, pathlib.Path(scratch) / "out")
        if run is None:
            return
        self._keep(name, case, run)
        self.runs[name] = run
        self.now.add(name)
        frames = case.values()["solver.frames"]
        ended = f"{run.ended} after {len(run.frames)} of {frames} frames ({run.fact})" if run.ended else "finished"
        self.say(f"{len(self.runs):>4} of {self.expected}  {says}: {ended}, {time.monotonic() - begun:.1f} s")

    def _computed(self, case, out):
        """Result of a run; None if stopped."""
        command = [self.program, "run", case.image, "-o", str(out), *case.arguments(), "--write", "points,fine", "--band", "off"]
        command += ["--threads", "1", "--time-limit", f"{self.limit_s:g}s", "-q"]
        # The run has its own process group: a Ctrl-C reaches only this process, which then ends it.
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        said = ""
        while not self.stop:
            try:
                said = process.communicate(timeout=0.1)[1]
                break
            except subprocess.TimeoutExpired:
                pass
        else:
            process.send_signal(signal.SIGKILL)
            process.communicate()
            return None
        if process.returncode in (2, 3, 6):
            refuse(said.strip(), process.returncode)  # the user must correct it
        run = Run()
        try:
            summary = json.loads((out / "summary.json").read_text())
        except (OSError, ValueError):
            if process.returncode == 130:  # stopped by the limit before any result
                return Run(ended="time-out", fact="stopped by the limit of time")
            return Run(ended="crashed", fact=said.strip().split("\n")[0])
        if process.returncode == 130:
            run.ended, run.fact = "time-out", "stopped by the limit of time"
        elif process.returncode != 0:
            failure = summary.get("failure", {})
            run.ended, run.fact = failure.get("code") or "crashed", failure.get("fact", "")
            if process.returncode == 4:
                run.ended = "no-model"
        counts = summary.get("counts", {})
        run.nodes, run.points = counts.get("nodes", 0), counts.get("integration_points", 0)
        run.retries = len(summary.get("retries", []))
        run.guards = " ".join(sorted({guard["code"] for guard in summary.get("guards", [])}))
        if (out / "force.csv").exists() and (out / "points.pvd").exists():
            run.frames = _frames_of(out)
        return run


def _sha256(file):
    try:
        return hashlib.sha256(pathlib.Path(file).read_bytes()).hexdigest()
    except OSError as error:
        refuse(f"{file} cannot be read: {error}", 3)


# ---------------------------------------------------------------------------------------------------------- from a map


def _place(of, x, y, physical_only=False):
    """Part of a run's name for these values."""
    parts = [
        f"_{axis.values[k]}"
        for axis, k in ((of.x, x), (of.y, y))
        if not axis.is_depth and (not physical_only or is_physical(axis.key))
    ]
    return "".join(parts)


def _file_name(text):
    return re.sub(r"[^A-Za-z0-9._-]", "-", text)


class Blocks:
    """Images of the block, one for each height, made on first use."""

    def __init__(self, folder):
        self.folder, self.made = folder, set()

    def __call__(self, size_mm):
        file = self.folder / f"block_{'x'.join(_study.text_of(s) for s in size_mm)}.nrrd"
        if file not in self.made:
            spacing = 1.0
            while size_mm[2] / spacing < 8:  # as thin as a phantom may be
                spacing /= 2
            self.folder.mkdir(parents=True, exist_ok=True)
            size = ",".join(_study.text_of(s) for s in size_mm)
            words = ["phantom", str(file), "--shape", "block", "--size", size, "--spacing", _study.text_of(spacing), "-q"]
            subprocess.run([_study.program(), *words], check=True, capture_output=True)
            self.made.add(file)
        return str(file)


def case_at(of, base, scheme, x, y, image):
    settings = {k: v for k, v in of.settings.items() if k not in base.given}  # what was requested is stronger
    settings["scheme.name"] = scheme
    size = list(of.block_mm)
    for axis, k in ((of.x, x), (of.y, y)):
        if axis.is_height:
            size[2] = float(axis.values[k])
        elif axis.is_depth:
            settings |= {axis.key: axis.values[-1], "solver.frames": axis.frames_a_depth * len(axis.values)}
        else:
            settings[axis.key] = axis.values[k]
    return base.having(settings, base.image or image(size))


def _last_frame(of, case, x, y):
    for axis, k in ((of.x, x), (of.y, y)):
        if axis.is_depth:
            return axis.frames_a_depth * (k + 1)
    return case.values()["solver.frames"]


def _steps(of):
    return [(x, y) for y in range(of.y.steps) for x in range(of.x.steps)]


def _cell_job(of, base, scheme, x, y, image):
    place = _place(of, x, y)
    return _file_name(f"{of.name}_{scheme}{place}"), f"{of.name} {scheme}{place}", case_at(of, base, scheme, x, y, image)


def _finest_job(of, case, x, y, nodes):
    place = _place(of, x, y, physical_only=True)
    return _file_name(f"{of.name}_finest{nodes}{place}"), f"{of.name} finest, {nodes} nodes{place}", finest_of(case, nodes)


def _radius_mm(case):
    """Of the circle, or of a contacting tool."""
    values = case.values()
    touches = re.match(r"\w+:([\d.]+)mm", values["tool.shape"])
    return float(touches[1]) if touches else 0.5 * values["boundary.indenter_diameter_mm"]


def _stable(run, case):
    radius = _radius_mm(case)
    return not _own_fault(run, case.values()["solver.frames"], radius, Verdict())


def _run_all(maps, base, options, runner, image):
    """The finest runs first, which take longest; the next finest only for cases where one is not stable."""
    panels = [(of, scheme) for of in maps for scheme in of.schemes(options.schemes, base.given)]
    cells = [_cell_job(of, base, scheme, x, y, image) for of, scheme in panels for x, y in _steps(of)]
    runner.expected = len(cells)
    finest = {}
    for level, nodes in enumerate(options.finest):
        more = {}
        for of in maps:
            for x, y in _steps(of):
                at = case_at(of, base, "converging", x, y, image)
                job = _finest_job(of, at, x, y, nodes)
                if level > 0 and _stable(runner.runs[_finest_job(of, at, x, y, options.finest[level - 1])[0]], at):
                    continue
                more.setdefault(job[0], job)
        finest |= more
        runner.expected += len(more)
        runner(list(more.values()) + (cells if level == 0 else []))


# ---------------------------------------------------------------------------------------------------------- the result

_MEANING = {
    "ok": "survived: finished, smooth, energy balanced, det F > 0, force within 5 % of the finest",
    "ok-rim": "survived, but some points at the rim are inverted: below 1 % of the half ball under the circle",
    "inaccurate": "the force differs by over 5 % from the finest stable run of the same case",
    "inverted": "points are inverted: over 1 % of the half ball under the circle, or the run stopped",
    "kinked": "the force curve bends or drops: its slope changes suddenly by over 25 % of the mean slope",
    "energy": "over 2 % of the tool's work is not accounted for, or the run stopped for it",
    "unchecked": "no finer run is stable here",
    "non-finite": "a number is no longer one",
    "no-equilibrium": "the iteration for an equilibrium or a step did not converge",
    "limit-point": "the tissue passed a limit point, and no equilibrium was found beyond",
    "no-model": "the model could not be built",
    "time-out": "not finished within the time limit",
    "crashed": "the program died",
    "volume": "volume far from that at rest, though nearly incompressible",
    "kinetic": "waves where the answer should be static",
    "jagged": "the force jumps from sample to sample",
    "time-step": "the time step is above the stable one",
    "conditioning": "moment matrices near singular",
    "supports": "points that see too few nodes",
    "circle-nodes": "too few nodes under the circle",
    "hourglass": "deformation that the points do not see",
    "penetration": "the surface came into the tool by over a twentieth of its radius",
    "contact-surface": "the tool came to parts of the surface where contact is not looked for",
    "tool-left": "the tool left the body",
}

# The colours are equal in all maps; those that colour-vision deficiencies can distinguish come first.
_COLOUR = {
    "ok": "#1e9e77", "ok-rim": "#8fcfbb", "": "#e9ecf0",
    "inverted": "#d55e00", "no-equilibrium": "#0072b2", "inaccurate": "#f0c83c", "kinked": "#cc79a7", "unchecked": "#56b4e9",
    "time-step": "#8c6d1f", "no-model": "#4a4e54", "energy": "#9b59b6", "crashed": "#111111", "conditioning": "#f4b183",
    "supports": "#9dc3e6", "circle-nodes": "#ffe699", "hourglass": "#e6b8d0", "limit-point": "#c0c4ca",
    "penetration": "#5b8a8a", "non-finite": "#7f6000", "time-out": "#a5a5a5",
}  # fmt: skip


def _note(v):
    """Most informative number for a verdict."""
    if v.code in ("ok", "inaccurate"):
        return f"{100 * v.error:+.1f} %"
    if v.code == "ok-rim":
        return f"{100 * v.error:+.1f} %, {v.inverted}"
    if v.code == "inverted" and v.inverted > 0:
        return f"{v.inverted} points"
    if v.code == "kinked":
        return f"{100 * v.kink:.0f} %"
    return f"{100 * v.energy_error:.3g} %" if v.code == "energy" and v.energy_error > 0 else ""


def _number(value, digits=6):
    return f"{value:.{digits}g}" if math.isfinite(value) else ""


def _row(of, scheme, x, y, case, run, v):
    reached = math.isfinite(v.force_N)

    def percent(part, known=reached):
        return _number(100 * part, 4) if reached and known else ""

    at = [_study.quoted(value) if "," in value else value for value in (of.x.values[x], of.y.values[y])]
    fields = [scheme, *at, v.code, _number(v.force_N), _number(v.reference_N), v.reference_nodes]
    fields += [percent(v.error, math.isfinite(v.reference_N)), percent(v.kink), percent(v.energy_error)]
    fields += [_number(v.J_min, 4) if reached else "", v.inverted, _number(v.inverted_mm3, 4)]
    fields += [run.points, run.nodes, run.retries, run.guards, len(run.frames), run.ended or "finished"]
    command = f"dimple run {os.path.basename(case.image)} -o out {' '.join(case.arguments())}"
    fields += [f'"{text}"' for text in (run.fact.replace('"', "'"), command.replace('"', "'"))]
    return ",".join(str(text) for text in fields)


def result_of(of, base, options, runs, image):
    """Table of a map, and for each scheme its verdicts, row by row; None where a run is missing."""
    lines = [
        f"scheme,{of.x.key},{of.y.key},code,force_N,reference_N,reference_nodes,error_percent,kink_percent,energy_error_percent,"
        "J_min,inverted_points,inverted_mm3,points,nodes,retries,guards,frames,ended,fact,run"
    ]
    panels = {}
    for scheme in of.schemes(options.schemes, base.given):
        panels[scheme] = []
        for y in range(len(of.y.values)):
            for x in range(len(of.x.values)):
                name, _, case = _cell_job(of, base, scheme, x, y, image)
                if name not in runs:  # interrupted
                    panels[scheme].append(None)
                    continue
                names = [_finest_job(of, case, x, y, nodes)[0] for nodes in options.finest]
                radius = _radius_mm(case)
                has_depth = of.x.is_depth or of.y.is_depth
                finest = [runs[n] for n in names if n in runs]
                v = judge(runs[name], finest, _last_frame(of, case, x, y), has_depth, radius)
                panels[scheme].append(v)
                lines.append(_row(of, scheme, x, y, case, runs[name], v))
    return "\n".join(lines) + "\n", panels


def _counts(verdicts):
    codes = sorted(v.code for v in verdicts if v)
    return {code: codes.count(code) for code in dict.fromkeys(codes)}


def _in_words(counts):
    return "; ".join(f"{code} {count}" for code, count in counts.items())


def draw(plt, folder, of, panels, finest):
    columns, rows = len(of.x.values), len(of.y.values)
    size = (max(5.5, 1.2 + 0.95 * columns) * len(panels), 1.8 + 0.45 * rows)
    figure, all_axes = plt.subplots(1, len(panels), figsize=size, squeeze=False, constrained_layout=True)
    for axes, (scheme, verdicts) in zip(all_axes[0], panels.items()):
        axes.grid(False)
        for n, v in enumerate(verdicts):
            x, y, code = n % columns, n // columns, v.code if v else ""
            colour = _COLOUR.get(code, "#c0c4ca")
            axes.add_patch(plt.Rectangle((x - 0.5, y - 0.5), 1, 1, facecolor=colour, edgecolor="white"))
            dark = sum(w * int(colour[k : k + 2], 16) for w, k in ((0.3, 1), (0.59, 3), (0.11, 5))) < 140
            style = {"ha": "center", "color": "white" if dark else "#1c1f23"}
            note = _note(v) if v else ""
            axes.text(x, y - (0.06 if note else 0), code, va="bottom" if note else "center", fontsize=7, **style)
            axes.text(x, y + 0.06, note, va="top", fontsize=6, **style)
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), xlabel=of.x.label or of.x.key, ylabel=of.y.label or of.y.key)
        axes.set_xticks(range(columns), of.x.ticks or of.x.values)
        axes.set_yticks(range(rows), of.y.ticks or of.y.values)
        counts = _counts(verdicts)
        alive, judged = sum(n for code, n in counts.items() if survived(code)), sum(counts.values())
        fine = ", else ".join(str(nodes) for nodes in finest)
        against = f"{alive} of {judged} cells survive; against the finest stable run of scheme converging ({fine} nodes)"
        _study.headed(axes, f"{of.title}: {scheme}", [of.scene, against])
        meanings = counts | ({"": len(verdicts) - judged} if judged < len(verdicts) else {})
        handles = [
            plt.Rectangle(
                (0, 0), 1, 1, facecolor=_COLOUR.get(code, "#c0c4ca"),
                label=textwrap.fill(f"{code}: {count} of {len(verdicts)} cells; {_MEANING.get(code, 'the run failed')}", 90)
                if code else "not run yet",
            )
            for code, count in meanings.items()
        ]  # fmt: skip
        below = -0.7 / (figure.get_figheight() * 0.6)
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(0, below), borderaxespad=0, fontsize=6)
    _study.save(figure, folder, f"stress_{of.name}")
    plt.close(figure)


# ----------------------------------------------------------------------------------------------------------- before all


def maps_asked_for(case, options):
    if not options.x and not options.y:
        if case.image:
            refuse("an image was given, but no axes --x and --y: the maps with names are about the block")
        _study.known_words(options.map, [of.name for of in MAPS], "--map")
        return [of for of in MAPS if not options.map or of.name in options.map]
    if not options.x or not options.y:
        refuse("a map of one side: it has --x and --y")
    if options.map:
        refuse("both a map's name and axes were given")
    x, y = axis_of(options.x, "--x"), axis_of(options.y, "--y")
    if x.key == y.key:
        refuse(f"both axes are {x.key}")
    if case.image and (x.is_height or y.is_height):
        refuse("the height of an image cannot be swept: phantom.height_mm is about the block")
    scene = os.path.basename(case.image) if case.image else "block 60 x 60 x 30 mm"
    settings = {} if case.image else {"boundary.base": "inferior", "boundary.indent_at": "0,0,top"}
    return [Map("own", f"{x.key} and {y.key}", scene, x, y, settings)]


def study(case, options, say):
    if options.list:
        return "\n".join(f"{of.name:<14} {of.x.key} x {of.y.key}" for of in MAPS)
    _study.known_words(options.schemes, SCHEMES, "--schemes")
    if not options.schemes or not options.finest:
        refuse("a map needs a scheme and a finest run to compare with")
    for nodes in options.finest:
        if nodes < 100:
            refuse(f"--finest: {nodes} nodes are too few, a cloud has at least 100")
    if not options.limit > 0:
        refuse(f"--limit {options.limit:g} is not allowed")
    maps = maps_asked_for(case, options)
    for of in maps:
        if not of.schemes(options.schemes, case.given):
            refuse(f"--schemes: the map {of.name} is of a contacting tool, and the scheme of Horton et al. (2007) knows no contact")
    folder = _study.folder_for(options.out, "stress.csv").absolute()
    plt = _study.pyplot()
    if case.image:
        case.image = os.path.abspath(case.image)
        _sha256(case.image)  # a missing file is refused before the first run
    if not (folder / "stress.csv").exists():
        _study.write(folder / "stress.csv", "map,scheme,cells,survived,codes\n")
    threads = options.threads or len(os.sched_getaffinity(0))
    blocks = Blocks(folder)
    runner = Runner(folder / "runs", options.limit, threads, say)
    stopped = False
    try:
        _run_all(maps, case, options, runner, blocks)
    except KeyboardInterrupt:
        stopped = True
    overview, text = "map,scheme,cells,survived,codes\n", ""
    for of in maps:
        csv, panels = result_of(of, case, options, runner.runs, blocks)
        _study.write(folder / f"stress_{of.name}.csv", csv)
        if not stopped:  # a picture takes longer than the limit for Ctrl-C
            draw(plt, folder, of, panels, options.finest)
        for scheme, verdicts in panels.items():
            counts = _counts(verdicts)
            cells, alive = sum(counts.values()), sum(n for code, n in counts.items() if survived(code))
            overview += f'{of.name},{scheme},{cells},{alive},"{_in_words(counts)}"\n'
            text += f"{of.name:<14} {scheme:<11} {alive:>3} of {cells:>3} survive: {_in_words(counts)}\n"
    _study.write(folder / "stress.csv", overview)
    if stopped:
        raise KeyboardInterrupt("the same command goes on with what is left")
    return f"{text}{runner.expected} runs, {len(runner.now)} of them now"


def main(argv=None):
    of = _study.parser("atlas", "Draw where a scene survives and why not: maps over two options each, both schemes side by side.")
    of.add_argument("--map", type=_study.words, default=[], help="only these, by name; see --list")
    of.add_argument("--list", action="store_true", help="list the maps and stop")
    of.add_argument("--x", default="", metavar="KEY=V1,V2,...", help="a map of your own: an option and its values across")
    of.add_argument("--y", default="", metavar="KEY=V1,V2,...", help="and down; load.depth: all depths from one run")
    of.add_argument("--schemes", type=_study.words, default=SCHEMES, help="converging, horton2007")
    of.add_argument(
        "--finest", type=_study.whole_numbers, default=[3000, 1500],
        help="nodes of the runs to compare with; the next where one is not stable [3000,1500]",
    )  # fmt: skip
    of.add_argument("--limit", type=float, default=300.0, help="for each run [300 s]")
    return _study.main(of, study, argv)


if __name__ == "__main__":
    sys.exit(main())
