#!/usr/bin/env python3
"""A soft sphere under its weight in a rigid spherical shell, without friction: by GetFEM, and for small strain
by a series of Legendre polynomials, with which the elements are compared first.

    sphere_in_shell.py    writes sphere_in_shell.csv, sphere_in_shell_runs.csv and sphere_in_shell_closed_forms.csv

Run it in this folder, with numpy and GetFEM's Python module (python3-getfem on Debian). A few minutes on one core.

Finite elements: axisymmetric, neo-Hookean, W = mu/2 (J^(-2/3) I1 - 3) + bulk/2 (J - 1)^2, at any strain; the
section of the sphere in 9-node quadrilaterals with curved sides, a continuous bilinear pressure, and a bilinear contact
pressure on the outside by an augmented Lagrangian, so that nothing is penalised. The sphere is in the middle of the shell at
first, on springs under every part of it that are then removed: in the end contact alone carries it.
Lengths in mm, stress in Pa; forces are divided by the weight.
"""
import csv
import math

import numpy as np

RADIUS, MU, DENSITY, GRAVITY = 20.0, 1000.0, 1000.0, 9.81
WEIGHT = DENSITY * GRAVITY * 1e-3  # of a volume [Pa / mm]
SCENES = [(0.45, 0.5), (0.49, 0.5), (0.45, 1.0), (0.49, 1.0)]  # nu, gap
MESHES = [8, 12, 18]       # elements on an eighth of the circumference
ANGLES = [15, 30, 45, 60]  # from the lowest point, about the shell's middle: limits of the carried fraction


def bulk_of(nu):
    return MU * 2.0 * nu / (1.0 - 2.0 * nu) + 2.0 / 3.0 * MU


# ---- small strain

def series(nu, gap, weight, rings=600, terms=3000):
    """Sinking of the sphere's middle, the contact's angle [degrees] from the lowest point, and the total force. Its own weight under the
    pressure -weight z stretches it by a z, a = weight (1 - 2 nu) / E: radially by a R^2 cos / 2. Each other polynomial of the pressure
    moves the surface by itself (Lur'e 1964)."""
    young = 2.0 * MU * (1.0 + nu)
    edges = np.linspace(0.0, math.pi, rings + 1)  # from the top
    angle = 0.5 * (edges[1:] + edges[:-1])
    x, share = np.cos(angle), np.cos(edges[:-1]) - np.cos(edges[1:])  # of the area: / 2
    # Rings of uniform pressure, and the mean displacement of each: P_n by its integral over a ring.
    gives = RADIUS * (1.0 - 2.0 * nu) / young * np.outer(np.ones(rings), 0.5 * share)
    low, mid = np.ones(rings + 1), np.cos(edges)
    for n in range(1, terms):
        high = ((2 * n + 1) * np.cos(edges) * mid - n * low) / (n + 1)
        if n > 1:
            of_ring = np.diff(low - high) / (2 * n + 1)
            c = RADIUS * (n * (n * n + 2 * n - 1 + 2 * nu) / (n - 1) - (n + 1) * (n - 2 + 4 * nu)) / (
                4.0 * MU * (n * n + (1 + 2 * nu) * n + 1 + nu))
            gives += c * 0.5 * (2 * n + 1) * np.outer(of_ring / share, of_ring)
        low, mid = mid, high
    x = 0.5 * (np.cos(edges[1:]) + np.cos(edges[:-1]))
    own = 0.5 * weight * (1.0 - 2.0 * nu) / young * RADIUS ** 2 * x
    touches = angle > 0.6 * math.pi
    for _ in range(200):
        k = np.flatnonzero(touches)  # gives p - x sinks = own - gap there, and all of p is the weight
        A = np.block([[gives[np.ix_(k, k)], -x[k, None]], [0.5 * (x * share)[None, k], np.zeros((1, 1))]])
        all_ = np.linalg.solve(A, np.append(own[k] - gap, -weight * RADIUS / 3.0))
        p, sinks = np.zeros(rings), -all_[-1]
        p[k] = all_[:-1]
        open_ = gap - own + sinks * x + gives @ p
        now_touches = np.where(touches, p > 0.0, open_ < 0.0)
        if (now_touches == touches).all():
            pressed = 0.5 * (p @ share) * 3.0 / (weight * RADIUS)
            return sinks, 180.0 - math.degrees(edges[np.flatnonzero(touches)[0]]), pressed
        touches = now_touches
    raise RuntimeError("no contact was found")


# ---- finite elements

def section(n):
    """Half of a disc as quadrilaterals of nine points [2 x 9]: a rectangle between three blocks, n by n of each 45 degrees."""
    a = 0.5 * RADIUS

    def block(f, g, count):  # from the inner line f to the outer angle g [degrees], both of s in 0 .. 1
        def at(s, t):
            angle = math.radians(g(s))
            return (1 - t) * np.array(f(s)) + t * RADIUS * np.array([math.cos(angle), math.sin(angle)])
        return at, count, n

    blocks = [block(lambda s: (a * s, -a), lambda s: -90 + 45 * s, n), block(lambda s: (a, -a + 2 * a * s), lambda s: -45 + 90 * s, 2 * n),
              block(lambda s: (a - a * s, a), lambda s: 45 + 45 * s, n), (lambda s, t: np.array([a * t, a - 2 * a * s]), 2 * n, n)]
    for at, along, across in blocks:
        for i in range(along):
            for j in range(across):
                # The last index goes outwards; x fastest.
                yield np.round(np.array([at((i + 0.5 * u) / along, (j + 0.5 * v) / across) for v in range(3) for u in range(3)]).T, 9)


class Sphere:
    def __init__(self, nu, gap, weight, n):
        import getfem as gf
        gf.util_trace_level(0)
        self.gf, self.gap, self.weight = gf, gap, weight
        mesh = gf.Mesh("empty", 2)
        for points in section(n):
            mesh.add_convex(gf.GeoTrans("GT_QK(2,2)"), points)
        outer, axis = [], []
        for face in mesh.outer_faces().T:
            x = mesh.pts(mesh.pid_in_faces(face[:, None]))
            (axis if np.abs(x[0]).max() < 1e-6 else outer).append(face)
        mesh.set_region(1, np.array(outer).T)
        mesh.set_region(2, np.array(axis).T)
        self.mim = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(2,6)"))
        quadratic, linear = gf.MeshFem(mesh, 1), gf.MeshFem(mesh, 1)
        quadratic.set_fem(gf.Fem("FEM_QK(2,2)"))
        linear.set_fem(gf.Fem("FEM_QK(2,1)"))
        self.mesh, self.quadratic = mesh, quadratic
        md = self.md = gf.Model("real")
        md.add_fem_variable("r", quadratic)  # displacements
        md.add_fem_variable("z", quadratic)
        md.add_fem_variable("p", linear)
        md.add_filtered_fem_variable("touch", linear, 1)
        for name, value in (("mu", MU), ("bulk", bulk_of(nu)), ("weight", weight), ("shell", RADIUS + gap), ("spring", 0.0),
                            ("pushes", MU / RADIUS)):
            md.add_initialized_data(name, [value])
        around = "(1+r/X(1))"
        md.add_macro("J", f"((1+Grad_r(1))*(1+Grad_z(2))-Grad_r(2)*Grad_z(1))*{around}")
        md.add_macro("I1", f"(sqr(1+Grad_r(1))+sqr(Grad_r(2))+sqr(Grad_z(1))+sqr(1+Grad_z(2))+sqr({around}))")
        md.add_macro("far", "sqrt(sqr(X(1)+r)+sqr(X(2)+z))")
        md.add_nonlinear_term(self.mim, "2*pi*X(1)*(mu/2*(pow(J,-2/3)*I1-3)+p*(J-1)-sqr(p)/(2*bulk)+weight*z+spring/2*sqr(z))")
        md.add_nonlinear_term(self.mim, "2*pi*X(1)/pushes*(half_sqr_pos_part(touch-pushes*(shell-far))-0.5*sqr(touch))", 1)
        md.add_Dirichlet_condition_with_simplification("r", 2)

    def rest(self):
        first = self.weight / (1.2 * self.gap)  # by which it would sink a little beyond first contact
        for share in (1.0, 0.5, 0.3, 0.2, 0.1, 0.05, 0.02, 0.0):
            self.md.set_variable("spring", [share * first])
            found = self.md.solve("max_res", 1e-9 * self.weight * RADIUS ** 3, "max_iter", 60, "lsearch", "simplest")
            if not found[1]:
                raise RuntimeError(f"no equilibrium at a spring of {share}")
        return self

    def sum(self, what, region=-1):
        return float(self.gf.asm_generic(self.mim, 0, "2*pi*X(1)*" + what, region, self.md))

    def profile(self, count=1441):
        """Profile of the outside, from the lowest point: angles about the shell's middle [degrees] when deformed, the pressure there [Pa],
        the area up to there [mm^2], and the fraction of the weight carried up to there."""
        at = np.linspace(0.0, math.pi, count)[1:-1]
        points = RADIUS * (1 - 1e-9) * np.array([np.sin(at), -np.cos(at)])
        of = lambda what: np.asarray(self.md.interpolation(what, points, self.mesh, -1, 1)).ravel()
        r, z, nominal = points[0] + of("r"), points[1] + of("z"), of("touch")
        angle, at_rest = np.arctan2(r, -z), RADIUS ** 2 * np.sin(at)  # the latter: of the area, by 2 pi and angle
        area = np.concatenate([[0.0], np.cumsum(math.pi * (r[1:] + r[:-1]) * np.hypot(np.diff(r), np.diff(z)))])
        carried = np.cumsum(nominal * np.cos(angle) * at_rest) * 2.0 * math.pi * (at[1] - at[0])
        pressure = nominal * at_rest / (r * np.hypot(np.gradient(r, at), np.gradient(z, at)))
        return np.degrees(angle), pressure, area, carried / (self.weight * self.sum("1"))

    def found(self):
        volume = self.sum("1")
        nodes, r, z = self.quadratic.basic_dof_nodes(), self.md.variable("r"), self.md.variable("z")
        sinks = lambda y: -z[int(np.argmin(nodes[0] ** 2 + (nodes[1] - y) ** 2))]
        angle, pressure, area, carried = self.profile()
        last = np.flatnonzero(pressure > 1e-3 * pressure.max())[-1]
        row = {"centre_mm": sinks(0), "mean_mm": -self.sum("z") / volume, "lowest_mm": sinks(-RADIUS),
               "highest_mm": sinks(RADIUS), "wider_mm": (nodes[0] + r).max() - RADIUS,
               "pressed_over_weight": self.sum("touch", 1) / (self.weight * volume), "touches_to_degrees": angle[last],
               "area_mm2": area[last],
               "lowest_Pa": pressure[0]}
        for at in ANGLES:
            row[f"carried_within_{at}"] = float(np.interp(at, angle, carried))
        up = -self.sum("touch*(X(2)+z)/far", 1) / (self.weight * volume)
        assert abs(up - 1.0) < 1e-6, up
        return row


def written(name, rows):
    with open(name, "w") as file:
        out = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        out.writeheader()
        out.writerows({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


def closed_forms():
    """Closed forms at a thousandth of gap and weight: strains are small there, and all displacements are a thousandth."""
    for nu, gap in SCENES:
        sinks, angle, pressed = series(nu, gap, WEIGHT)
        found = Sphere(nu, 1e-3 * gap, 1e-3 * WEIGHT, MESHES[-1]).rest().found()
        yield {"nu": nu, "gap_mm": gap, "sinks_mm": sinks, "sinks_by_elements_mm": 1e3 * found["centre_mm"],
               "off_percent_of_sag": 100 * (1e3 * found["centre_mm"] - sinks) / (sinks - gap), "pressed_over_weight": pressed,
               "pressed_by_elements": found["pressed_over_weight"], "touches_to_degrees": angle,
               "touches_by_elements": found["touches_to_degrees"]}


def main():
    written("sphere_in_shell_closed_forms.csv", list(closed_forms()))
    runs = [{"nu": nu, "gap_mm": gap, "elements": n, **Sphere(nu, gap, WEIGHT, n).rest().found()} for nu, gap in SCENES for n in MESHES]
    written("sphere_in_shell_runs.csv", runs)
    best = []
    for nu, gap in SCENES:
        of = [r for r in runs if (r["nu"], r["gap_mm"]) == (nu, gap)]
        doubt = max(abs(r[k] - of[-1][k]) for r in of for k in ("centre_mm", "mean_mm", "highest_mm"))
        best.append({**{k: v for k, v in of[-1].items() if k != "elements"}, "known_to_mm": doubt})
    written("sphere_in_shell.csv", best)


if __name__ == "__main__":
    main()
