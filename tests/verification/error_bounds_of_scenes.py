#!/usr/bin/env python3
"""Error bounds on random scenes: bodies, tools, friction, membranes, walls, loads, depths, nodes and voxel sizes.

    error_bounds_of_scenes.py PROGRAM TABLE.csv SEED COUNT [FIRST] [FEATURES]

FEATURES: `loads` (the first proof), or `further`: steps, further tools, pressures, body forces, thin membranes.
A seed draws the scenes. Each is computed with its nodes, and as truth with 16 times the nodes on voxels half as large.
Bounds hold if each force of the curve differs from the truth by at most the half-width of the bounds and the error by the
image's resolution. `used` is the largest such difference as a part of that sum. `change_percent` compares with half
the nodes. A scene that TABLE has is not computed again, so an interrupted table continues.
The proof's seed is the hash of the commit that froze the bounds, and each scene of it is run once.
"""

import csv
import json
import os
import pathlib
import random
import subprocess
import sys
import tempfile

COLUMNS = ("scene", "seed", "body", "size_mm", "voxel_mm", "tool", "feature", "nu", "depth_mm", "nodes", "force_N", "half_percent",
           "image_percent", "change_percent", "truth_N", "off_percent", "used", "holds", "note", "options")
FINER = 16
FEATURES = {"loads": ("", "", "", "membrane", "gravity", "sliding base", "wall beside"),
            "further": ("steps", "steps", "further tool", "pressure", "body force", "thin membrane")}


def drawn(seed, number, features="loads"):
    """Options of a scene, its body and a word for what is special."""
    draw = random.Random(f"{seed} {number}")
    between = lambda low, high: round(draw.uniform(low, high), 2)  # noqa: E731
    feature = draw.choice(FEATURES[features])
    body = draw.choice(("block", "cylinder", "cut-ellipsoid", "brain"))
    if feature in ("sliding base", "wall beside"):
        body = "block"
    height, width = 28.5 if body == "brain" else between(25, 45), between(55, 90)
    size = (width, between(55, 90), height) if body == "block" else (width, width, height) if body == "cylinder" else \
        (between(70, 100), between(60, 75), height) if body == "cut-ellipsoid" else (62.5, 92.5, 28.5)
    voxel = draw.choice((1.0, 1.5, 2.0))
    size = tuple(voxel * round(length / voxel) for length in size) if body != "brain" else size
    options = ["--base", "inferior", "--nu", f"{draw.choice((0.45, 0.49, 0.499))}"]
    contacting = feature != "sliding base" and draw.random() < 0.5
    if contacting:
        radius = between(5, min(9, height / 4))
        depth = round(draw.uniform(0.3, 0.7) * radius, 2)
        tool = f"sphere:{radius}mm"
        options += ["--tool", tool]
        friction = draw.choice(("0", "0", "0.3", "stick"))
        if friction != "0":
            options += ["--friction", friction]
            tool += f", friction {friction}"
    else:
        diameter = between(9, min(18, height / 1.5))
        depth = round(draw.uniform(0.3, 1.0) * 0.5 * diameter, 2)
        tool = f"patch of {diameter} mm"
        options += ["--indenter-diameter", f"{diameter}mm"]
    x, y = between(-8, 8), between(-8, 8)
    if body == "brain":
        x += 14.0  # beside the fissure
    options += ["--indent-at", f"{x},{y},top"]
    if feature != "steps":
        options += ["--depth", f"{depth}mm"]
    if feature == "membrane":
        film = f"{draw.choice((0.05, 0.1, 0.2))}mm:{draw.choice((20, 60, 200))}kPa"
        options += ["--membrane", film]
        feature += " " + film
    elif feature == "gravity":
        side = draw.choice(("inferior", "superior", "left"))
        options += ["--gravity", side, "--mu", "1kPa"]
        feature += " " + side
    elif feature == "sliding base":
        options += ["--base-hold", "none", "--wall", "plane:0,0,0,0,0,1"]
    elif feature == "wall beside":
        gap = draw.choice((0.05, 0.2))
        options += ["--wall", f"plane:{0.5 * size[0] + gap},0,0,-1,0,0"]
        feature += f" at {gap} mm"
    elif features == "further":
        radius = radius if contacting else 0.5 * diameter
        feature, more = further(feature, draw, between, size, radius, depth, (x, y))
        options += more
    nodes = draw.choice((1500, 2000)) if contacting else draw.choice((1000, 1500, 2000))
    return {"body": body, "size": size, "voxel": voxel, "tool": tool, "feature": feature, "depth": depth, "nodes": nodes,
            "nu": options[3], "options": options}


def further(feature, draw, between, size, radius, depth, place):
    """The feature in numbers, and its options."""
    if feature == "thin membrane":  # its stiffness over that of the tissue under the tool
        film = 210e-6 * radius * 10 ** draw.uniform(-0.5, 1)  # N/mm
        film = f"0.1mm:{1e4 * film:.3g}kPa"
        return f"{feature} {film}", ["--membrane", film]
    if feature == "steps":
        aside, lift = round(between(0.1, 0.5) * radius, 2), round(between(0.2, 0.8) * depth, 2)
        aside = f"{aside},0,0" if draw.random() < 0.5 else f"0,{-aside},0"
        steps = {"press": f"{depth}mm", "aside": aside, "lift": f"{-lift}mm"}
        return f"steps {depth}; {aside.replace(',', ' ')}; {-lift} mm", [f"--set step.{name}.move={move}" for name, move in steps.items()]
    if feature == "further tool":
        away = round(between(2.2, 3.0) * radius, 2) * (1 if place[1] < 0 else -1)
        move = round(between(0.2, 0.6) * radius, 2)
        at = f"{place[0]},{place[1] + away:.2f},{size[2]}"
        return f"{feature}, {away} mm beside, {move} mm", [f"--set tool.other.{key}={value}" for key, value in (
            ("shape", f"sphere:{radius:.2f}mm"), ("at", at), ("move", f"{move}mm"))]
    side = draw.choice(("left", "right"))
    if feature == "pressure":
        pressure = round(between(5, 30))
        return f"{feature} {pressure} Pa {side}", [f"--set load.pressure.p.on={side}", f"--set load.pressure.p.pressure={pressure}Pa"]
    force = f"{round(between(-800, 800))},{round(between(-800, 800))},{round(between(-800, 800))}"
    return f"{feature} {force.replace(',', ' ')} N/m3", [f"--set load.body_force.b.force={force}"]


def image_of(program, folder, scene, voxel):
    file = folder / f"body_{voxel:g}.nrrd"
    size = [] if scene["body"] == "brain" else ["--size", ",".join(f"{length:g}" for length in scene["size"])]
    subprocess.run([program, "phantom", file, "--shape", scene["body"], *size, "--spacing", f"{voxel:g}", "-q"], check=True)
    return file


def run(program, folder, image, nodes, options):
    """Force curve with its columns as numbers, the summary, and the reason if the run failed."""
    made = subprocess.run([program, "run", image, "-o", folder, "--force", "--write", "force", "-q", "--nodes", str(nodes),
                           *" ".join(options).split()], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, timeout=3600)
    if made.returncode:
        return {}, {}, (made.stderr.splitlines() or [f"exit code {made.returncode}"])[0].removeprefix("dimple: ")
    with open(folder / "force.csv") as rows:
        curve = [{name: float(value) if value else 0.0 for name, value in row.items()} for row in csv.DictReader(rows)]
    return {round(row["time_s"], 4): row for row in curve if row["time_s"] > 0}, json.loads((folder / "summary.json").read_text()), ""


def percent(part, whole):
    return f"{100 * part / whole:.2f}" if whole else ""  # a tool that has left the body


def compare(program, seed, number, features):
    scene = drawn(seed, number, features)
    row = {"scene": number, "seed": seed, "body": scene["body"], "size_mm": "x".join(f"{v:g}" for v in scene["size"]), "voxel_mm": scene["voxel"],
           "tool": scene["tool"], "feature": scene["feature"], "nu": scene["nu"], "depth_mm": scene["depth"], "nodes": scene["nodes"],
           "options": " ".join(scene["options"])}
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        image, finer = (image_of(program, folder, scene, voxel) for voxel in (scene["voxel"], 0.5 * scene["voxel"]))
        ours, told, failed = run(program, folder / "ours", image, scene["nodes"], scene["options"])
        if failed:
            return {**row, "note": failed}
        alone = [*scene["options"], "--band", "off"]
        coarse, _, failed = run(program, folder / "coarse", image, scene["nodes"] // 2, alone)
        truth, _, no_truth = run(program, folder / "truth", finer, FINER * scene["nodes"], alone)
        if no_truth:
            return {**row, "note": "no truth: " + no_truth}
    last, known = (list(curve.values())[-1] for curve in (ours, truth))
    row |= {"force_N": last["force_N"], "truth_N": known["force_N"], "off_percent": percent(last["force_N"] - known["force_N"], known["force_N"]),
            "image_percent": percent(last.get("image_half_N", 0.0), last["force_N"])}
    changes = [abs(ours[at]["force_N"] / coarse[at]["force_N"] - 1) for at in ours.keys() & coarse.keys() if coarse[at]["force_N"]]
    row["change_percent"] = f"{100 * max(changes):.2f}" if changes else ""
    if "low_N" not in last:
        return {**row, "note": "no bounds: " + str(told.get("band", {}).get("unknown", told.get("band")))}
    used, deepest = 0.0, 0.0
    for at, r in ours.items():
        deepest = max(deepest, r["indentation_mm"])
        if at in truth and deepest > 0.2 * scene["depth"]:
            off = truth[at]["force_N"] - r["force_N"]
            half = (r["high_N"] - r["force_N"] if off > 0 else r["force_N"] - r["low_N"]) + r.get("image_half_N", 0.0)
            used = max(used, abs(off) / half if off else 0.0)
    half = last["high_N"] - last["force_N"]  # the lower bound may end at zero
    return {**row, "half_percent": percent(half, last["force_N"]), "used": f"{used:.3f}", "holds": "yes" if used <= 1 else "no"}


def main(program, table, seed, count, first="1", features="loads"):
    program, table = os.path.abspath(program), pathlib.Path(table)
    if not table.exists():
        with open(table, "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerow(COLUMNS)
    with open(table) as file:
        done = {int(row["scene"]) for row in csv.DictReader(file) if row["seed"] == seed}
    for number in range(int(first), int(first) + int(count)):
        if number in done:
            continue
        row = compare(program, seed, number, features)
        with open(table, "a", newline="") as file:
            csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(row)
        print(*(row.get(name, "") for name in COLUMNS[:-1]), flush=True)


if __name__ == "__main__":
    if not 5 <= len(sys.argv) <= 7:
        sys.exit(__doc__)
    main(*sys.argv[1:])
