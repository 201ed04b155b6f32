#!/usr/bin/env python3
"""Writes slits.csv and a file for each organ: the ratio of a body to the plain block on a matching mesh, times block.csv.

Run it in this folder; it reads slit_runs.csv (hexahedra.cpp), tetrahedra.csv (tetrahedra.cpp) and block.csv.
"""
import csv

DEPTHS = (1, 2, 3, 4)
BLOCK = {float(r["indentation_mm"]): float(r["force_N"]) for r in csv.DictReader(open("block.csv"))}


def slits():
    # A mesh is known by its rim and its sectors; of a gap the finest one is taken that has the slit of 1 mm.
    force = {}
    for r in csv.DictReader(open("slit_runs.csv")):
        mesh = (float(r["rim_mm"]), int(r["half_sectors"]))
        width = None if r["filled"] == "1" else float(r["slit_mm"])
        force[mesh, width, float(r["gap_mm"]), float(r["depth_mm"])] = float(r["force_N"])
    rows = []
    for width in (0.5, 1.0, 2.0):
        for gap in (1.0, 3.0, 8.0):
            for depth in DEPTHS:
                mesh = next(m for m in ((0.6, 3), (0.6, 2), (1.2, 2)) if (m, 1.0, gap, depth) in force)
                ratio = force[mesh, 1.0, gap, depth] / force[mesh, None, gap, depth]
                coarse = (1.2, 2)  # has all widths
                ratio *= force[coarse, width, gap, depth] / force[coarse, 1.0, gap, depth]
                rows.append((f"{width:g},{gap:g}", depth, ratio * BLOCK[depth], 1.5 if depth < 4 else 2.0))
    write("slits.csv", rows, "slit_mm,gap_mm,")


def organs():
    # Growth of the edges, from the coarse mesh to the fine ones that differ far away only.
    far_away = {"heart": ("0.35", "0.25"), "brain": ("0.5", "0.3"), "two_labels": ("0.35", "0.25", "0.18"),
                "ellipsoid_15": ("0.35", "0.25", "0.18"), "ellipsoid_25": ("0.35", "0.25", "0.18")}
    force = {}
    for r in csv.DictReader(open("tetrahedra.csv")):
        force[r["body"], r["rim_mm"], r["growth"], float(r["depth_mm"])] = float(r["force_N"])
    bodies = list(dict.fromkeys(k[0] for k in force if k[0] != "block" and not k[0].startswith("slit")))
    for body in bodies:
        rows = []
        for depth in DEPTHS:
            by_rim = {}
            for (name, rim, growth, at), f in force.items():
                if name == body and at == depth and growth not in far_away.get(body, ())[1:]:
                    block = force.get(("block", rim, growth, depth), force["block", rim, "0.35", depth])
                    by_rim[rim] = f / block * BLOCK[depth]
            if not by_rim:
                continue
            take = by_rim.get("0.6", by_rim.get("1.2"))
            # What is not known is taken as the most that was seen in other bodies, or more.
            uncertainty = 1.0 + (100 * abs(by_rim["0.6"] / by_rim["1.2"] - 1) if len(by_rim) > 1 else 1.5)
            if body in far_away:
                meshes = [(body, "1.2", growth, depth) for growth in far_away[body]]
                if meshes[-1] in force:
                    take *= force[meshes[-1]] / force[meshes[0]]
                    uncertainty += 2 * 100 * abs(force[meshes[-1]] / force[meshes[-2]] - 1)
                else:
                    uncertainty += 2.0
            else:
                uncertainty += 0.5
            rows.append((depth, take, max(2.0, uncertainty)))
        write(f"{body}.csv", rows)


def write(name, rows, first_columns=""):
    with open(name, "w") as file:
        file.write(first_columns + "indentation_mm,force_N,uncertainty_percent\n")
        for *first, depth, force, uncertainty in rows:
            file.write("".join(f"{word}," for word in first) + f"{depth:g},{force:.5f},{uncertainty:.1f}\n")


slits()
organs()
