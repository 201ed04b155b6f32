#!/usr/bin/env python3
"""Random minutes of a live tool against runs at the requested poses.

    python3 live_minutes.py PROGRAM IMAGE OUT.csv [--minutes 20] [--nodes 500] [--seed 1] [options of dimple ...]

A sphere is moved in all directions: in and out, aside by less and by more than a quarter of its radius, to and fro, and
off the organ. Of each minute some frames are taken at random. The reference is a run of `dimple run` at the place below
the tip that was requested, with as many nodes, its force taken at the depth of that tip.
OUT.csv has a row for each such frame; the last lines printed count the forces outside of their stated error by status.
"""
import argparse
import csv
import json
import pathlib
import random
import subprocess
import sys
import tempfile

WORDS = ("there", "lags", "stopped", "elsewhere", "beyond")
RADIUS_MM = 5.0
OFF_MM = 100.0  # sideways from first contact: off the organ
FPS = 10


def dimple(program, *words):
    return subprocess.run([program, *map(str, words)], capture_output=True, text=True, check=False)


def rows_of(file):
    with open(file, newline="") as lines:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]


def random_way(hand, touch, push, across):
    """Tips [mm] ten times a second for a minute: pieces of half a second to two, straight or at rest."""
    tip, way = [t - 3 * p for t, p in zip(touch, push)], []
    while len(way) < 60 * FPS:
        kind = hand.random()
        aside = [0.0, 0.0]
        if kind < 0.3:
            far = 0.25 * RADIUS_MM
            aside = [hand.uniform(-far, far) for _ in range(2)]
        elif kind < 0.6:
            aside = [hand.uniform(-8, 8) for _ in range(2)]
        elif kind < 0.65:
            aside = [2 * OFF_MM, 0.0]
        deep = hand.uniform(-2, 3.5)
        to = [t + aside[0] * a + aside[1] * b + deep * p for t, a, b, p in zip(touch, *across, push)]
        if hand.random() < 0.25:
            to = tip
        steps = hand.randint(5, 2 * FPS)
        way += [[(1 - k / steps) * a + k / steps * b for a, b in zip(tip, to)] for k in range(1, steps + 1)]
        tip = to
    return way[: 60 * FPS]


def reference(program, image, folder, tip, push, nodes, options, known):
    """Force [N] at a tip [mm], by a run at the place below it. None if no run is possible there."""
    key = tuple(round(t - sum(a * b for a, b in zip(tip, push)) * p, 3) for t, p in zip(tip, push))
    if key not in known:
        ran = dimple(program, "run", image, "-o", folder, "--force", "-q", "--write", "force", "--band", "off",
                     "--tool", f"sphere:{RADIUS_MM}mm", "--depth", "4mm", "--nodes", nodes,
                     "--indent-at=" + ",".join(f"{x:.6f}" for x in tip), *options)
        known[key] = None
        if ran.returncode in (0, 5) and (pathlib.Path(folder) / "force.csv").exists():
            tool = json.loads((pathlib.Path(folder) / "summary.json").read_text())["tool"]
            known[key] = (tool["first_touch_mm"], rows_of(pathlib.Path(folder) / "force.csv"))
    if known[key] is None:
        return None
    touched, curve = known[key]
    depth = sum((a - b) * p for a, b, p in zip(tip, touched, push))
    if depth <= 0:
        return 0.0
    for a, b in zip(curve, curve[1:]):
        if b["indentation_mm"] >= depth:
            part = (depth - a["indentation_mm"]) / (b["indentation_mm"] - a["indentation_mm"])
            return a["force_N"] + part * (b["force_N"] - a["force_N"])
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("image")
    parser.add_argument("out")
    parser.add_argument("--minutes", type=int, default=20)
    parser.add_argument("--nodes", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--frames", type=int, default=8, help="that are checked of each minute")
    args, options = parser.parse_known_args()
    program, image = str(pathlib.Path(args.program).resolve()), str(pathlib.Path(args.image).resolve())
    found, known = [], {}
    with tempfile.TemporaryDirectory() as work:
        first = dimple(program, "run", image, "-o", f"{work}/first", "-q", "--write", "force", "--band", "off", "--nodes",
                       args.nodes, "--tool", f"sphere:{RADIUS_MM}mm", "--depth", "1mm", *options)
        if first.returncode != 0:
            sys.exit(first.stderr)
        summary = json.loads(pathlib.Path(f"{work}/first/summary.json").read_text())
        touch, push = summary["tool"]["first_touch_mm"], summary["counts"]["push"]
        least = min(range(3), key=lambda k: abs(push[k]))
        e = [float(k == least) for k in range(3)]
        e = [a - push[least] * p for a, p in zip(e, push)]
        long = sum(a * a for a in e) ** 0.5
        e = [a / long for a in e]
        g = [push[1] * e[2] - push[2] * e[1], push[2] * e[0] - push[0] * e[2], push[0] * e[1] - push[1] * e[0]]
        for minute in range(args.minutes):
            hand = random.Random(args.seed + minute)
            way = random_way(hand, touch, push, (e, g))
            with open(f"{work}/way.csv", "w") as file:
                file.write("time_s,x_mm,y_mm,z_mm\n")
                file.writelines(f"{k / FPS},{x:.6f},{y:.6f},{z:.6f}\n" for k, (x, y, z) in enumerate(way))
            ran = dimple(program, "poke", image, "--script", f"{work}/way.csv", "--record", f"{work}/felt", "--force", "-q",
                         "--fps", FPS, "--evaluations", 8, "--nodes", args.nodes, "--tool", f"sphere:{RADIUS_MM}mm",
                         *options)
            if ran.returncode != 0:
                sys.exit(ran.stderr)
            frames = rows_of(f"{work}/felt/forces.csv")
            for k in sorted(hand.sample(range(len(frames)), args.frames)):
                frame = frames[k]
                tip = [frame[f"asked_{c}_mm"] for c in "xyz"]
                off = [t - c for t, c in zip(tip, touch)]
                aside = [o - sum(a * b for a, b in zip(off, push)) * p for o, p in zip(off, push)]
                truth = 0.0 if sum(a * a for a in aside) > OFF_MM**2 else reference(
                    program, image, f"{work}/run", tip, push, args.nodes, options, known)
                found.append({"minute": args.seed + minute, "time_s": frame["time_s"], "status": WORDS[int(frame["tool"])],
                              "force_N": frame["force_N"], "error_N": frame["error_N"],
                              "reference_N": "" if truth is None else truth})
            with open(args.out, "w", newline="") as file:
                table = csv.DictWriter(file, found[0].keys())
                table.writeheader()
                table.writerows(found)
    most = max(row["reference_N"] or 0.0 for row in found)
    for word in WORDS:
        rows = [r for r in found if r["status"] == word and r["reference_N"] != ""]
        told = [r for r in rows if r["error_N"] < float("inf")]
        off = [abs(r["force_N"] - r["reference_N"]) - r["error_N"] for r in told]
        print(f"{word}: {len(rows)} frames, of {len(told)} the error is known; beyond it by more than 1, 3, 10 % of the "
              f"largest force: {', '.join(str(sum(o > s * most for o in off)) for s in (0.01, 0.03, 0.1))}")


if __name__ == "__main__":
    main()
