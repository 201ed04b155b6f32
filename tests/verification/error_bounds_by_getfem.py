#!/usr/bin/env python3
"""The first scenes of a table of error_bounds_of_scenes.py again, by another code: do its forces lie in Dimple's bounds?

    error_bounds_by_getfem.py TABLE.csv OUT.csv COUNT       (apt install python3-getfem python3-numpy)

Takes the first COUNT scenes with a bonded patch on a block or a cylinder, without a membrane or a wall beside, and with bounds.
GetFEM: hexahedra with quadratic displacement and linear pressure, Newton, MUMPS. A sliding base is a unilateral contact without
friction. Rings and layers of elements halve towards the edge of the patch, where the stress is singular. `truth_N` is the line through
the forces of two meshes to a smallest edge of 0: as at a crack, the error is taken to be proportional to it. `doubt_percent` is half
of the last step. It may be too small where the patch is pressed by 0.6 radii or more: most forces there fall from the first mesh to
the second, all others rise. A scene that OUT has is not computed again.
"""

import csv
import pathlib
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "benchmark"))
from hexahedra import layers, quadrangles  # noqa: E402
from run_getfem import mesh_in  # noqa: E402

LEVELS = (2, 3)  # halvings of the rings inside the patch, of the two meshes
CORE = 1         # half the squares along the core of the patch
FIRST, LONGEST, SHORTEST = 0.1, 0.6, 0.005  # mm: load steps
GROWTH = 1.6     # of edges from one to the next far from the patch
COLUMNS = ("scene", "body", "size_mm", "tool", "feature", "nu", "depth_mm", "nodes", "force_N", "half_percent", "image_percent",
           "coarse_N", "fine_N", "truth_N", "doubt_percent", "off_percent", "used", "holds", "seconds", "note")
BASE, PATCH = 1, 2  # regions
GRAVITY = {"inferior": (0, 0, -1), "superior": (0, 0, 1), "left": (1, 0, 0)}


def growing(first, largest, end):
    """Places from 0 to `end`: steps double from `first` to `largest`, then grow slowly."""
    steps = [first]
    while sum(steps) + steps[-1] < end:
        steps.append(steps[-1] * (2.0 if 2.0 * steps[-1] <= largest else GROWTH))
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return places * end / places[-1]


def mesh_of(getfem, scene, level):
    """The mesh, with the patch's centre at x = y = 0, and its smallest edge."""
    radius, half = scene["radius"], [0.5 * length for length in scene["size"][:2]]
    inward = np.cumsum([0.0] + [2.0 ** k for k in range(level)]) / (2.0 ** level - 1)  # 0 at the edge of the patch, 1 at the core
    edge, largest = 0.5 * radius * inward[1], 0.5 * radius / CORE
    beyond = growing(edge, largest, min(half) - radius)
    faces = quadrangles(CORE, radius, 1.0 - inward[::-1], beyond / beyond[-1], scene["body"], half, scene["at"])
    height = scene["size"][2]
    mesh = mesh_in(getfem, layers(faces, height - growing(edge, largest, height)))
    place, outer = mesh.pts(), mesh.outer_faces()
    corners = [place[:, mesh.pid_in_faces(outer[:, [k]])] for k in range(outer.shape[1])]
    patch = [c[2].min() > height - 1e-6 and np.hypot(c[0], c[1]).max() < radius + 1e-6 for c in corners]
    mesh.set_region(BASE, outer[:, [c[2].max() < 1e-6 for c in corners]])
    mesh.set_region(PATCH, outer[:, patch])
    return mesh, edge


class Body:
    def __init__(self, getfem, scene, level):
        getfem.util_trace_level(0)
        getfem.util_warning_level(0)
        self.getfem, self.scene = getfem, scene
        mesh, self.edge = mesh_of(getfem, scene, level)
        quadratic, linear = getfem.MeshFem(mesh, 3), getfem.MeshFem(mesh, 1)
        quadratic.set_classical_fem(2)
        linear.set_classical_fem(1)
        self.points, model = getfem.MeshIm(mesh, 5), getfem.Model("real")
        self.model = model
        model.add_fem_variable("u", quadratic)
        model.add_fem_variable("p", linear)
        self.names = ["u", "p"]
        mu, nu = 1e-6 * scene["mu_Pa"], scene["nu"]
        for name, value in {"mu": mu, "bulk": 2 * mu * (1 + nu) / (3 * (1 - 2 * nu)), "weight": [0.0, 0.0, 0.0]}.items():
            model.add_initialized_data(name, value)
        model.add_macro("F", "(Id(3)+Grad_u)")
        self.energy = "mu/2*(pow(Det(F),-2/3)*Norm_sqr(F)-3)+p*(Det(F)-1)-sqr(p)/(2*bulk)-weight.u"
        model.add_nonlinear_term(self.points, self.energy)
        if scene["slides"]:
            model.add_filtered_fem_variable("l", linear, BASE)
            model.add_initialized_data("r", 20 * mu / (0.5 * scene["radius"]))
            self.names.append("l")
            model.add_nonlinear_term(self.points, "1/r*(half_sqr_neg_part(l+r*u(3))-sqr(l)/2)", BASE)
        else:
            model.add_Dirichlet_condition_with_simplification("u", BASE)
        self.vertical = np.intersect1d(quadratic.basic_dof_on_region(PATCH), np.arange(2, quadratic.nbdof(), 3))
        self.quadratic = quadratic

    def solve(self):
        """Is there an equilibrium near the present values?"""
        return self.model.solve("max_iter", 12, "max_res", 1e-7, "lsearch", "simplest", "alpha min", 0.3, "lsolver", "mumps")[1]

    def force(self):
        """Sum over the patch of the residual, which the displaced nodes bear."""
        residual = self.getfem.asm_generic(self.points, 1, self.energy, -1, self.model)
        return -float(residual[self.model.interval_of_variable("u")[0] + self.vertical].sum())

    def solve_along(self, end, first, longest, shortest, apply):
        """From 0 to `end`, by steps that double after an equilibrium and halve without one, along the line through the last two."""
        state = lambda: [self.model.variable(name).copy() for name in self.names]
        at, step, states = 0.0, first, [state()]
        while at < end * (1 - 1e-9):
            step = min(step, end - at)
            apply(at + step)
            for k, name in enumerate(self.names):
                last = states[-1][k]
                self.model.set_variable(name, last if len(states) < 2 else last + step / before * (last - states[-2][k]))
            if self.solve():
                at, before, states = at + step, step, [states[-1], state()]
                step = min(2 * step, longest)
            elif step > shortest:
                step *= 0.5
            else:
                raise RuntimeError(f"Newton's iteration finds no equilibrium after {at:.3f} of {end:.3f}")

    def force_at(self, depth):
        model, weight = self.model, np.array(self.scene["weight"])
        if weight.any():
            self.solve_along(1.0, 0.2, 0.4, 0.02, lambda part: model.set_variable("weight", part * weight))
        rest = model.variable("u").copy()
        model.add_initialized_fem_data("move", self.quadratic, rest)
        model.add_Dirichlet_condition_with_simplification("u", PATCH, "move")
        down = np.zeros(len(rest))
        down[2::3] = -1.0
        self.solve_along(depth, FIRST, LONGEST, SHORTEST, lambda at: model.set_variable("move", rest + at * down))
        return self.force()


def scene_of(row):
    """The scene in numbers, or nothing if this script does not have what it needs."""
    words, options = row["tool"].split(), row["options"].split()
    value = lambda name, usual="": options[options.index(name) + 1] if name in options else usual
    feature = row["feature"].split()
    if words[0] != "patch" or row["body"] not in ("block", "cylinder") or feature[:1] in (["membrane"], ["wall"]) or not row["half_percent"]:
        return None
    density = 1e-9 * 1000.0 * 9.81  # N/mm3
    weight = density * np.array(GRAVITY[feature[1]]) if feature[:1] == ["gravity"] else np.zeros(3)
    return {"body": row["body"], "size": [float(v) for v in row["size_mm"].split("x")], "radius": 0.5 * float(words[2]),
            "at": np.array([float(v) for v in value("--indent-at").split(",")[:2]]), "nu": float(row["nu"]),
            "mu_Pa": {"": 210.0, "1kPa": 1000.0}[value("--mu")], "depth": float(row["depth_mm"]), "weight": weight,
            "slides": feature[:1] == ["sliding"]}


def main(table, out, count):
    import getfem

    rows = [row for row in csv.DictReader(open(table)) if scene_of(row)][:int(count)]
    out = pathlib.Path(out)
    if not out.exists():
        out.write_text(",".join(COLUMNS) + "\n")
    done = {row["scene"] for row in csv.DictReader(open(out))}
    for row in rows:
        if row["scene"] in done:
            continue
        scene, begun = scene_of(row), time.process_time()
        found = {name: row[name] for name in COLUMNS if name in row} | {"used": "", "holds": "", "off_percent": "", "note": ""}
        try:
            bodies = [Body(getfem, scene, level) for level in LEVELS]
            coarse, fine = (body.force_at(scene["depth"]) for body in bodies)
            slope = bodies[1].edge / (bodies[0].edge - bodies[1].edge)
            truth = fine + slope * (fine - coarse)
            off = float(row["force_N"]) / truth - 1
            half = 0.01 * (float(row["half_percent"]) + float(row["image_percent"]))
            used = abs(off) / (1 + off) / half
            found |= {"coarse_N": f"{coarse:.6g}", "fine_N": f"{fine:.6g}", "truth_N": f"{truth:.6g}",
                      "doubt_percent": f"{50 * abs(truth / fine - 1):.2f}", "off_percent": f"{100 * off:.2f}", "used": f"{used:.3f}",
                      "holds": "yes" if used <= 1 else "no"}
        except RuntimeError as reason:
            found["note"] = str(reason).splitlines()[0]
        found["seconds"] = f"{time.process_time() - begun:.0f}"
        with open(out, "a", newline="") as file:
            csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(found)
        print(*(found.get(name, "") for name in COLUMNS), flush=True)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
