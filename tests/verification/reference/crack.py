#!/usr/bin/env python3
"""A crack in a finite linear elastic body compared with one in an infinite body, by P2 elements: writes crack.csv.

    /usr/bin/python3 crack.py     (python3-getfem, gmsh; four minutes on one core)

Bodies are those of crack_test.cpp. Their walls are held as they move in a body without a crack under a tension sigma. The additional
motion by the crack is that under a pressure sigma on the crack, with walls at rest: no large numbers are
subtracted. Lengths are in crack lengths a.

 penny  disc of radius 1 about the middle of a box, 2 x `width` wide and 2 x `height` high; an eighth of it is meshed.
        energy: released energy, over Sneddon's 8 (1 - nu^2) sigma^2 a^3 / (3 E) (1946).
 edge   plane strain, slit of length 1 from a free side into a strip `width` wide and 2 x `height` high; half is meshed.
        opening: over sigma a / E' at so much of the slit's length from its mouth; the mouth of one in a half plane opens by
        5.816 (Wigglesworth 1957; Tada, Paris, Irwin 2000: 4 x 1.454).
        energy: released energy, over thickness x sigma^2 a^2 / E'; in a half plane 1.1215^2 pi / 2 = 1.976.

`front`: length of elements at the crack's front, each half of the one before; 0: the limit, since errors in energy and
opening halve with it (stress grows as distance^-1/2). The last body of each kind is practically infinite, next to the closed
form.
"""
import csv
import os
import subprocess
import tempfile

import getfem
import numpy as np

CRACK, MIRROR, WALLS = 1, 2, 3
PLACES = (0.0, 0.25, 0.5, 0.75)  # from the mouth, in lengths of the slit
GROWTH = 0.2                    # of elements, with the distance from the front

PENNY = """
h = {height}; w = {width};
Point(1) = {{0, 0, 0}}; Point(2) = {{1, 0, 0}}; Point(3) = {{0, 1, 0}};
Point(4) = {{w, 0, 0}}; Point(5) = {{w, w, 0}}; Point(6) = {{0, w, 0}};
Point(7) = {{0, 0, h}}; Point(8) = {{w, 0, h}}; Point(9) = {{w, w, h}}; Point(10) = {{0, w, h}};
Line(1) = {{1, 2}}; Circle(2) = {{2, 1, 3}}; Line(3) = {{3, 1}}; Line(4) = {{2, 4}}; Line(5) = {{4, 5}}; Line(6) = {{5, 6}};
Line(7) = {{6, 3}}; Line(8) = {{7, 8}}; Line(9) = {{8, 9}}; Line(10) = {{9, 10}}; Line(11) = {{10, 7}};
Line(12) = {{1, 7}}; Line(13) = {{4, 8}}; Line(14) = {{5, 9}}; Line(15) = {{6, 10}};
Curve Loop(1) = {{1, 2, 3}}; Curve Loop(2) = {{4, 5, 6, 7, -2}}; Curve Loop(3) = {{8, 9, 10, 11}};
Curve Loop(4) = {{1, 4, 13, -8, -12}}; Curve Loop(5) = {{5, 14, -9, -13}}; Curve Loop(6) = {{6, 15, -10, -14}};
Curve Loop(7) = {{7, 3, 12, -11, -15}};
For i In {{1:7}}
  Plane Surface(i) = {{i}};
EndFor
Surface Loop(1) = {{1, 2, 3, 4, 5, 6, 7}};
Volume(1) = {{1}};
Physical Surface(1) = {{1}}; Physical Surface(2) = {{2, 4, 7}}; Physical Surface(3) = {{3, 5, 6}}; Physical Volume(99) = {{1}};
Field[1] = Distance; Field[1].CurvesList = {{2}}; Field[1].NumPointsPerCurve = 1000;
"""

EDGE = """
h = {height}; w = {width};
Point(1) = {{0, 0, 0}}; Point(2) = {{0, 0.25, 0}}; Point(3) = {{0, 0.5, 0}}; Point(4) = {{0, 0.75, 0}};
Point(5) = {{0, 1, 0}}; Point(6) = {{0, w, 0}}; Point(7) = {{h, w, 0}}; Point(8) = {{h, 0, 0}};
For i In {{1:7}}
  Line(i) = {{i, i + 1}};
EndFor
Line(8) = {{8, 1}};
Curve Loop(1) = {{1:8}}; Plane Surface(1) = {{1}};
Physical Curve(1) = {{1, 2, 3, 4}}; Physical Curve(2) = {{5}}; Physical Curve(3) = {{6, 7}}; Physical Surface(99) = {{1}};
Field[1] = Distance; Field[1].PointsList = {{5}};
"""

SIZES = """
Field[2] = MathEval; Field[2].F = "{front} + {growth} * F1"; Background Field = 2;
Mesh.MeshSizeExtendFromBoundary = 0; Mesh.MeshSizeFromPoints = 0; Mesh.MshFileVersion = 2.2;
"""


def mesh_of(geometry, dimension, front, height, width):
    with tempfile.TemporaryDirectory() as folder:
        geo, msh = os.path.join(folder, "body.geo"), os.path.join(folder, "body.msh")
        with open(geo, "w") as out:
            out.write(geometry.format(height=height, width=width) + SIZES.format(front=front, growth=GROWTH))
        subprocess.run(["gmsh", f"-{dimension}", geo, "-o", msh, "-v", "0"], check=True)
        return getfem.Mesh("import", "gmsh", msh)


def opened(mesh, nu, normal):
    """Solution for E = 1 and a pressure of 1 on the crack: P2 field, its values, and their work on the pressure."""
    field, points = getfem.MeshFem(mesh, mesh.dim()), getfem.MeshIm(mesh, 4)
    field.set_classical_fem(2)
    model = getfem.Model("real")
    model.add_fem_variable("u", field)
    for name, value in {"lambda": nu / ((1 + nu) * (1 - 2 * nu)), "mu": 0.5 / (1 + nu), "pressure": normal}.items():
        model.add_initialized_data(name, value)
    model.add_isotropic_linearized_elasticity_brick(points, "u", "lambda", "mu")
    model.add_source_term_brick(points, "u", "pressure", CRACK)
    model.add_linear_term(points, "1e9*(u.Normal)*(Test_u.Normal)", MIRROR)
    model.add_Dirichlet_condition_with_simplification("u", WALLS)
    model.solve("lsolver", "mumps")
    u = model.variable("u")
    along = normal.index(1.0) + 1
    return field, u, getfem.asm_generic(points, 0, f"u({along})", CRACK, model)


def penny(nu, height, width, front):
    field, _, work = opened(mesh_of(PENNY, 3, front, height, width), nu, [0.0, 0.0, 1.0])
    # Clapeyron: half the work of sigma on the opening, for two faces in four quarters.
    return field.nbdof(), {"energy": 4.0 * work / (8.0 * (1.0 - nu**2) / 3.0)}


def edge(nu, height, width, front):
    field, u, work = opened(mesh_of(EDGE, 2, front, height, width), nu, [1.0, 0.0])
    E = 1.0 / (1.0 - nu**2)  # E'
    place, x = field.basic_dof_nodes()[:, ::2], u[::2]
    opening = {f"opening_{p}": 2.0 * E * x[np.argmin(np.hypot(place[0], place[1] - p))] for p in PLACES}
    return field.nbdof(), {"energy": E * work, **opening}


# Height, width, Poisson's ratio; and the fronts of three meshes.
BODIES = {penny: [(1.6, 1.6, 0.3), (1.6, 1.6, 0.45), (10.0, 10.0, 0.3)],
          edge: [(6.0, 6.0, 0.3), (6.0, 6.0, 0.45), (6.0, 6.0, 0.499), (200.0, 200.0, 0.3)]}
FRONTS = {penny: (0.03, 0.015, 0.0075), edge: (4e-3, 2e-3, 1e-3)}


def main():
    getfem.util_trace_level(0)
    getfem.util_warning_level(0)
    rows = []
    for compute, bodies in BODIES.items():
        for height, width, nu in bodies:
            runs = [(front, *compute(nu, height, width, front)) for front in FRONTS[compute]]
            (_, _, before), (_, _, last) = runs[-2:]
            runs.append((0, "", {what: 2.0 * value - before[what] for what, value in last.items()}))
            for front, unknowns, values in runs:
                for what, value in values.items():
                    rows.append([compute.__name__, height, width, nu, front, unknowns, what, f"{value:.4f}"])
                    print(*rows[-1], flush=True)
    with open("crack.csv", "w", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(
            [["body", "height", "width", "nu", "front", "unknowns", "what", "value"], *rows])


if __name__ == "__main__":
    main()
