#!/usr/bin/env python3
"""Tools drawn at random on five organs, and how each scene ends: with an answer, with a reason, or not.

    random_tools.py PROGRAM DATA [FIRST-LAST] [--show] > results/random_tools.csv  (1-300: some hours)
    random_tools.py --again results/random_tools.csv

DATA: the folder with the label images. Scene N follows from N alone, so that any of them can be run again: `17-17
--show` prints its command and what it says. Each has 60 s of wall time. `--again` counts a table's classes.
"""
import collections
import csv
import json
import math
import os
import random
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time

ORGANS = {"heart": ["heart_ct_1.5mm.nii.gz"], "liver": ["abdomen_mr_3mm.nii.gz", "--label", "5"],
          "lung": ["lung_ct_aniso.mha"], "brain": ["human_brain_mri_2mm.nrrd"],
          "chest": ["chest_ct_10mm.seg.nrrd"]}
LEAST_RADIUS = {"liver": 1.5, "lung": 1.25, "chest": 5.0}  # mm, of half a voxel: smaller tools are refused; others: 1
SIDES = {"superior": (0, 0, 1), "inferior": (0, 0, -1), "anterior": (0, -1, 0), "posterior": (0, 1, 0),
         "left": (1, 0, 0), "right": (-1, 0, 0)}
SECONDS = 60.0
COLUMNS = ["scene", "organ", "options", "exit_code", "status", "code", "guards", "retries", "seconds", "cpu_s",
           "reached", "force_N", "largest_N", "least_N", "energy_off_percent", "jump_percent", "penetration_mm", "ends"]


def ball(path, radius):
    """A ball as a file of triangles, drawn by latitudes and longitudes; its lowest point is at the origin."""
    rows, columns = 24, 48

    def at(i, j):
        up, round_ = math.pi * i / rows, 2 * math.pi * j / columns
        return (radius * math.sin(up) * math.cos(round_), radius * math.sin(up) * math.sin(round_),
                radius - radius * math.cos(up))

    with open(path, "w") as file:
        file.write("solid ball\n")
        for i in range(rows):
            for j in range(columns):
                a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, (j + 1) % columns), at(i, (j + 1) % columns)
                for corners in ([a, c, b] if i < rows - 1 else None, [a, d, c] if i > 0 else None):
                    if corners:
                        points = "".join(f"vertex {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in corners)
                        file.write(f"facet normal 0 0 0\nouter loop\n{points}endloop\nendfacet\n")
        file.write("endsolid ball\n")


def unit(v):
    size = math.sqrt(sum(x * x for x in v))
    return tuple(x / size for x in v)


def across(v):
    """A direction across v."""
    least = min(range(3), key=lambda k: abs(v[k]))
    return unit(tuple((1.0 if k == least else 0.0) - v[least] * v[k] for k in range(3)))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def tilted(v, angle, round_):
    e = across(v)
    g = cross(v, e)
    return unit(tuple(v[k] + math.tan(angle) * (math.cos(round_) * e[k] + math.sin(round_) * g[k]) for k in range(3)))


def words(v):
    return ",".join(f"{x:.4g}" if abs(x) < 1 else f"{x:.1f}" for x in v)


def scene(number):
    """All that is drawn, in a fixed order, so that a change of one part leaves the others."""
    draw = random.Random(f"random tools {number}")
    organ = draw.choice(sorted(ORGANS))
    radius = round(math.exp(draw.uniform(math.log(LEAST_RADIUS.get(organ, 1.0)), math.log(12.0))), 2)
    edge, length = draw.uniform(0.1, 1.0), draw.uniform(2.0, 5.0)
    kind = draw.choices(["sphere", "punch", "capsule", "ball.stl"], [40, 25, 20, 15])[0]
    tool = {"sphere": f"sphere:{radius}mm", "punch": f"punch:{radius}mm,edge={edge * radius:.3f}mm",
            "capsule": f"capsule:{radius}mm,length={length * radius:.1f}mm", "ball.stl": "ball.stl"}[kind]
    friction = draw.choices(["", f"{draw.uniform(0.1, 0.6):.2f}", "stick"], [50, 35, 15])[0]
    depth = round(radius * draw.uniform(0.1, 0.8), 3)
    slide, along, steps = draw.uniform(-10.0, 10.0), draw.choice("xy"), draw.random() < 0.35
    place, side = draw.choices(["side", "list", "any"], [50, 15, 35])[0], draw.choice(sorted(SIDES))
    comes_from = unit([draw.gauss(0.0, 1.0) for _ in range(3)])
    if abs((comes_from if place == "any" else SIDES[side])["xy".index(along)]) > 0.7:
        along = "y" if along == "x" else "x"  # across the push
    options = ["--nu", f"{draw.uniform(0.45, 0.499):.4f}", "--nodes", draw.choice(["1000", "1500"])]
    options += ["--band", draw.choices(["off", "on"], [85, 15])[0], "--threads", draw.choice(["1", "2"])]
    if friction:
        options += ["--friction", friction]
    if steps:
        way = (slide, 0, 0) if along == "x" else (0, slide, 0)
        options += ["--set", f"step.1press.move={depth}mm", "--set", f"step.2slide.move={words(way)}",
                    "--set", f"step.3lift.move={-depth - abs(slide) - 1.0:.3f}mm"]
    else:
        options += ["--depth", f"{depth}mm"]
    return {"organ": organ, "kind": kind, "tool": tool, "radius": radius, "options": options,
            "tilt": math.radians(draw.choice([0.0, draw.uniform(0.0, 20.0)])), "round": draw.uniform(0.0, 2 * math.pi),
            "place": place, "side": side, "one_of": draw.random(), "from": comes_from,
            "cut": draw.random() < 0.08, "cut_beside": draw.uniform(0.0, 1.5), "cut_wide": draw.uniform(8.0, 20.0),
            "self_contact": draw.random() < 0.08, "steps": steps}


def said(program, *arguments):
    return subprocess.run([program, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def place_of(program, files, drawn):
    """Where the tool stands, as options, and the place if it is known: of a side, of `dimple places`, or anywhere."""
    if drawn["place"] == "list":
        found = json.loads(said(program, "places", *files, "--json", "-q").stdout)
        good = [p for part in found.values() if isinstance(part, list) for p in part
                if isinstance(p, dict) and p.get("verdict") == "good"
                and (p["from"] == drawn["side"] or not drawn["steps"])]
        if good:
            one = good[int(drawn["one_of"] * len(good))]
            return ["--indent-at", words(one["centre_mm"])], one["centre_mm"], tuple(one["push"])
    if drawn["place"] == "any":
        labels = json.loads(said(program, "info", files[0], "--json", "-q").stdout)["labels"]
        if len(files) > 2:
            labels = [one for one in labels if str(one["value"]) == files[2]]
        middle = max(labels, key=lambda one: one["voxels"])["centre_mm"]
        push = tuple(-x for x in drawn["from"])
        far = tuple(m + 400.0 * x for m, x in zip(middle, drawn["from"]))
        # Such a place is refused, with the place that a line along the push meets first, or else the nearest.
        told = said(program, "run", *files, "--indent-at", words(far), "--direction", words(push), "-o", "probe",
                    "--tool", "sphere:2mm", "-q").stderr
        met = re.search(r"touches the organ at \(([^)]*)\)", told) or re.search(r"of its surface, \(([^)]*)\)", told)
        if met:
            place = [float(x) for x in met.group(1).split(",")]
            return ["--indent-at", words(place), "--base", words(push)], place, push
    return ["--indent-at", drawn["side"]], None, tuple(-x for x in SIDES[drawn["side"]])


def options_of(program, files, drawn, knows_self_contact):
    at, place, push = place_of(program, files, drawn)
    options = ["--tool", drawn["tool"], *at]
    if place or drawn["tilt"] > 0.0:
        push = tilted(push, drawn["tilt"], drawn["round"])
        options += ["--direction", words(push)]
    if drawn["cut"] and place:
        aside = across(push)
        beside = [p + drawn["cut_beside"] * drawn["radius"] * a for p, a in zip(place, aside)]
        options += ["--cut", f"plane:{words(beside)},{words(aside)},radius={drawn['cut_wide']:.1f}mm"]
    if drawn["self_contact"] and knows_self_contact:
        options += ["--self-contact", "on"]
    return options + drawn["options"]


def run(program, arguments, show):
    """Exit code (None: it was ended after its time), seconds, seconds of all threads."""
    begun = time.monotonic()
    with open("said", "w") as told:
        child = subprocess.Popen([program, *arguments], stdout=subprocess.DEVNULL, stderr=None if show else told)
    while True:
        pid, status, used = os.wait4(child.pid, os.WNOHANG)
        seconds = time.monotonic() - begun
        if pid:
            return os.waitstatus_to_exitcode(status), seconds, used.ru_utime + used.ru_stime
        if seconds > SECONDS:
            os.kill(child.pid, signal.SIGKILL)
            used = os.wait4(child.pid, 0)[2]
            return None, seconds, used.ru_utime + used.ru_stime
        time.sleep(0.05)


def rows_of(path):
    if not os.path.exists(path):
        return []
    return [{k: float(v) for k, v in row.items() if v} for row in csv.DictReader(open(path))]


def jump(rows, largest):
    """By how much one piece of the curve differs from both its neighbours' slopes [% of the largest force]."""
    def where(r):
        return [r["indentation_mm"]] + [r.get(f"aside_{k}_mm", 0.0) for k in "xyz"]
    ways = [math.dist(where(a), where(b)) for a, b in zip(rows, rows[1:])]
    pieces = [(w, b["force_N"] - a["force_N"]) for w, a, b in zip(ways, rows, rows[1:]) if w > 1e-9]
    worst = 0.0
    for k, (way, change) in enumerate(pieces):
        others = [pieces[n] for n in (k - 1, k + 1) if 0 <= n < len(pieces)]
        if len(others) == 2:
            worst = max(worst, min(abs(change - c / w * way) for w, c in others))
    return 100.0 * worst / largest if largest > 0.0 else 0.0


def judged(row, drawn):
    """How it ends: an answer, a reason, or what is wrong."""
    code, guards = row["exit_code"], row["guards"].split()
    if code == "":
        return "fails: no end within 60 s"
    if code < 0 or code == 1:
        return f"fails: exit {code}"
    if code != 0:
        return f"reason: {row['code']}" if row["code"] else "fails: no reason"
    doubts = []
    if row["least_N"] < -0.02 * row["largest_N"] and not (drawn["steps"] and "--friction" in drawn["options"]):
        doubts.append("negative force")
    if row["jump_percent"] > 20.0 and not {"limit-point", "tool-left", "jagged"} & set(guards):
        doubts.append("jump")
    if row["energy_off_percent"] > 10.0 and "energy" not in guards:
        doubts.append("energy")
    if drawn["steps"] and abs(row["force_N"]) > 0.02 * row["largest_N"]:
        doubts.append("lifted and not free")
    return "doubtful: " + ", ".join(doubts) if doubts else "answer, warned" if guards else "answer"


def result_of(folder, drawn, ended):
    code, seconds, cpu = ended
    row = {"exit_code": "" if code is None else code, "seconds": f"{seconds:.1f}", "cpu_s": f"{cpu:.1f}"}
    summary = {}
    if os.path.exists(folder + "/summary.json"):
        summary = json.load(open(folder + "/summary.json"))
    forces, energies = rows_of(folder + "/force.csv"), rows_of(folder + "/energy.csv")
    values = [r["force_N"] for r in forces] or [0.0]
    largest = max(abs(v) for v in values)
    work = max([abs(r["external_work_J"]) for r in energies] or [0.0])
    off = max([abs(r["error_J"]) for r in energies] or [0.0])
    coded = re.findall(r"^  code:  (\S+)", open("said").read(), re.MULTILINE)
    row.update(status=summary.get("status", ""), code=summary.get("failure", {}).get("code", coded[0] if coded else ""),
               guards=" ".join(g["code"] for g in summary.get("guards", [])),
               retries=len(summary.get("retries", [])), force_N=values[-1], largest_N=largest, least_N=min(values),
               reached=f"{forces[-1]['time_s']:.3f}" if forces else "",
               energy_off_percent=100.0 * off / work if work > 0.0 else 0.0, jump_percent=jump(forces, largest),
               penetration_mm=summary.get("tool", {}).get("largest_penetration_mm", 0.0))
    row["ends"] = judged(row, drawn)
    for key in ("force_N", "largest_N", "least_N", "energy_off_percent", "jump_percent", "penetration_mm"):
        row[key] = f"{row[key]:.4g}"
    return row


def one(program, data, number, show):
    drawn = scene(number)
    organ = ORGANS[drawn["organ"]]
    files = [os.path.join(data, organ[0]), *organ[1:]]
    knows = "--self-contact" in said(program, "run", "--help-all").stdout
    home = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            if drawn["kind"] == "ball.stl":
                ball("ball.stl", drawn["radius"])
            options = options_of(program, files, drawn, knows)
            if show:
                print(shlex.join([program, "run", *files, *options, "-o", "out"]), file=sys.stderr)
            ended = run(program, ["run", *files, *options, "-o", "out", "--write", "force"] + ([] if show else ["-q"]),
                        show)
            row = result_of("out", drawn, ended)
        finally:
            os.chdir(home)
    organ_words = drawn["organ"] + (f" R={drawn['radius']}mm" if drawn["kind"] == "ball.stl" else "")
    return {"scene": number, "organ": organ_words, "options": shlex.join(options), **row}


def again(path):
    rows = list(csv.DictReader(open(path)))
    kinds = collections.Counter(r["ends"].split(":")[0].split(",")[0] for r in rows)
    print(f"{len(rows)} scenes: " + ", ".join(f"{n} {kind}" for kind, n in kinds.most_common()))
    for ends, n in collections.Counter(r["ends"] for r in rows).most_common():
        print(f"{n:5} {ends:45} {' '.join(r['scene'] for r in rows if r['ends'] == ends)[:120]}")
    seconds = sorted(float(r["seconds"]) for r in rows)
    print(f"seconds: median {seconds[len(rows) // 2]:.1f}, nine of ten below {seconds[len(rows) * 9 // 10]:.1f}, "
          f"longest {seconds[-1]:.1f}")


def main(program, data, scenes="1-300", *more):
    if program == "--again":
        return again(data)
    first, last = (int(x) for x in scenes.split("-"))
    out = csv.DictWriter(sys.stdout, COLUMNS, lineterminator="\n")
    out.writeheader()
    for number in range(first, last + 1):
        out.writerow(one(os.path.abspath(program), os.path.abspath(data), number, "--show" in more))
        sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
