#!/usr/bin/env python3
"""Forces of contacting tools, by axisymmetric_contact.cpp: runs its scenes on three meshes and writes the results.

    contact.py run PROGRAM    all scenes and closed forms into contact_runs.csv (about an hour on one core)
    contact.py friction PROGRAM  only the scenes with friction, and closed forms of friction into
                                 friction_closed_forms.csv
    contact.py again PROGRAM WORD  only the scenes that have WORD among their options: layer=, film=, weight=
    contact.py small PROGRAM  spheres of small contacts into small_contacts.csv (about an hour on one core)
    contact.py                contact.csv from contact_runs.csv: force and its error

Run it in this folder.
"""
import csv
import math
import subprocess
import sys

MU = 210e-6  # N/mm^2
# name: options of the program. Bodies are cylinders with a bonded base.
SCENES = {
    "sphere": "tool=sphere radius=5 depth=4 steps=8",
    "sphere_sticks": "tool=sphere radius=5 depth=4 steps=8 touch=stick",
    "sphere_nu_0.49": "tool=sphere radius=5 depth=4 steps=8 nu=0.49",
    "sphere_nu_0.45": "tool=sphere radius=5 depth=4 steps=8 nu=0.45",
    "sphere_layer": "tool=sphere radius=5 depth=4 steps=8 body=40 height=10",
    "sphere_friction_0.3": "tool=sphere radius=5 depth=4 steps=8 touch=coulomb friction=0.3",
    "sphere_layer_sticks": "tool=sphere radius=5 depth=4 steps=8 body=40 height=10 touch=stick",
    "sphere_layer_friction_0.3": "tool=sphere radius=5 depth=4 steps=8 body=40 height=10 touch=coulomb friction=0.3",
    "sphere_on_stiff_layer": "tool=sphere radius=5 depth=4 steps=8 layer=3 layer_mu=840e-6",
    "sphere_on_soft_layer": "tool=sphere radius=5 depth=4 steps=8 layer=3 layer_mu=52.5e-6",
    "sphere_on_film": "tool=sphere radius=5 depth=4 steps=8 film=1e-3",
    "sphere_under_gravity": "tool=sphere radius=5 depth=4 steps=8 weight=9.81e-6",
    "punch": "tool=punch radius=5 edge=1 depth=6 steps=12",
    "punch_sticks": "tool=punch radius=5 edge=1 depth=6 steps=12 touch=stick",
    "punch_nu_0.45": "tool=punch radius=5 edge=1 depth=6 steps=12 nu=0.45",
}
MESHES = {"coarse": "fine=0.5 edge_fine=0.25", "middle": "fine=0.35 edge_fine=0.18 below=3.15",
          "fine": "fine=0.25 edge_fine=0.125"}


def e_star(nu):
    return 2.0 * MU / (1.0 - nu)


def contact_radius(radius, depth):
    """Contact radius by Sneddon 1965 for a true sphere on a half-space."""
    low, high = 0.0, radius * (1.0 - 1e-12)
    for _ in range(200):
        a = 0.5 * (low + high)
        low, high = (a, high) if 0.5 * a * math.log((radius + a) / (radius - a)) < depth else (low, a)
    return a


def sphere(radius, depth, nu):
    """Force [N] by Sneddon 1965 for a true sphere on a half-space."""
    a = contact_radius(radius, depth)
    return e_star(nu) * (0.5 * (a * a + radius * radius) * math.log((radius + a) / (radius - a)) - a * radius)


def on_layer(profile, flat, height, depth, nu, bonded, points=100):
    """An integral equation for a tool of revolution on an elastic layer, frictionless [N]. With lengths in heights:
    phi(t) = E*/pi (depth - profile(t)) + int_0^a K(t, x) phi(x) dx, phi(a) = 0, F = 2 pi int phi, where `profile` is
    the depth at which contact on a half-space extends to t (mm), and zero within `flat`."""
    import numpy as np
    k = 3.0 - 4.0 * nu
    s, ws = np.polynomial.laguerre.laggauss(150)  # 1 - L falls as exp(-2 s)
    s, ws = s[s < 60], ws[s < 60]
    sinh, cosh = np.sinh(2 * s), np.cosh(2 * s)
    low = ((2 * k * sinh - 4 * s) / (2 * k * cosh + 1 + k * k + 4 * s * s)) if bonded else (cosh - 1) / (sinh + 2 * s)
    rest = (1.0 - low) * ws * np.exp(s)
    x0, w0 = np.polynomial.legendre.leggauss(points)

    def between(low, high):
        return low + 0.5 * (high - low) * (x0 + 1.0), 0.5 * (high - low) * w0

    def solve(a):  # a in heights; depth [mm] and force [N] at which it is the contact radius
        inner, outer = between(0.0, flat / height), between(flat / height, a)
        t, w = (np.concatenate(both) for both in zip(inner, outer)) if flat > 0.0 else outer
        at = np.cos(np.outer(s, t))
        kernel = 2.0 / math.pi * (np.cos(np.outer(np.append(t, a), s)) * rest) @ at
        of = np.array([profile(height * x) if height * x > flat else 0.0 for x in t]) / height
        one, shape = np.linalg.solve(np.eye(len(t)) - kernel[:-1] * w, np.stack([np.ones(len(t)), of], axis=1)).T
        d = (profile(height * a) / height + kernel[-1] @ (w * shape)) / (1.0 + kernel[-1] @ (w * one))
        return d * height, 2.0 * e_star(nu) * height * height * (w @ (d * one - shape))

    low_a, high_a = flat / height * (1.0 + 1e-12) + 1e-6, 6.0
    for _ in range(80):
        a = 0.5 * (low_a + high_a)
        low_a, high_a = (a, high_a) if solve(a)[0] < depth else (low_a, a)
    return solve(a)[1]


def paraboloid(radius):
    return lambda t: t * t / radius


def round_edge(flat, edge):
    return lambda t: t / edge * (math.sqrt(t * t - flat * flat) - flat * math.acos(flat / t))


# Closed forms: name, options, force.
def closed_forms():
    far = "body=200 height=200 largest=25 growth=1.25 steps=1"
    layer = "body=100 height=10 steps=1"
    yield ("sphere on a half-space (Sneddon)", f"tool=sphere radius=5 depth=0.0125 fine=0.02 reach=0.4 below=0.4 {far}",
           sphere(5, 0.0125, 0.499))
    touches = "tool=paraboloid radius=500 fine=0.25 reach=12 below=5"
    for base in ("bonded", "loose"):
        for chi in (0.2, 0.3, 0.5, 0.75, 1.0):
            depth = (10 * chi) ** 2 / 500
            yield (f"paraboloid on a {base} layer, chi {chi} (integral equation)",
                   f"{touches} {layer} depth={depth:g} base={base}",
                   on_layer(paraboloid(500), 0, 10, depth, 0.499, base == "bonded"))
    yield ("paraboloid on a bonded layer of nu 0.3, chi 0.5 (integral equation)", f"{touches} {layer} depth=0.05 nu=0.3",
           on_layer(paraboloid(500), 0, 10, 0.05, 0.3, True))
    for depth in (0.001059, 0.005657, 0.012472):
        yield (f"punch with a round edge on a bonded layer, {depth} mm (integral equation)",
               f"tool=punch radius=104 edge=100 fine=0.1 reach=6 below=3 {layer} depth={depth}",
               on_layer(round_edge(4, 100), 4, 10, depth, 0.499, True))


# Effects of friction: name, options of both, touch, ratio of the last load step's stiffness to that without friction.
def closed_forms_of_friction():
    far = "body=200 height=200 largest=25 growth=1.25"
    yield ("sphere on a half-space of nu 0.499 (a normal load moves an incompressible surface nowhere along itself)",
           f"tool=sphere radius=5 depth=0.0125 fine=0.02 reach=0.4 below=0.4 {far} steps=1", "touch=stick", 1.0)
    for nu in (0.0, 0.3):  # Mossakovskii 1954: a bonded disc over one without friction
        yield (f"punch on a half-space of nu {nu} (bonded disc over frictionless disc)",
               f"tool=punch radius=5 edge=0.2 depth=0.004 nu={nu} fine=0.2 edge_fine=0.05 reach=6 below=3 {far} steps=4",
               "touch=stick", (1 - nu) * math.log(3 - 4 * nu) / (1 - 2 * nu))


RUNS = ["scene", "mesh", "options", "nodes", "depth_mm", "force_N", "contact_radius_mm", "J_min", "penetration_between_nodes_mm"]


def friction(program):
    with open("friction_closed_forms.csv", "w") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["what", "options", "touch", "known_ratio", "ratio", "off_percent"])
        for what, options, touch, known in closed_forms_of_friction():
            last = [([0.0] + [float(r["force_N"]) for r in rows(program, f"{options} {of}")])[-2:] for of in ("touch=slip", touch)]
            ratio = (last[1][1] - last[1][0]) / (last[0][1] - last[0][0])
            out.writerow([what, options, touch, f"{known:.5g}", f"{ratio:.5g}", f"{100 * (ratio / known - 1):.2f}"])
            file.flush()
    again(program, "touch=")


def again(program, word):
    """Repeats the scenes that have `word` among their options."""
    kept = [r for r in csv.DictReader(open("contact_runs.csv")) if word not in r["options"]]
    with open("contact_runs.csv", "w") as file:
        out = csv.DictWriter(file, RUNS, extrasaction="ignore", lineterminator="\n")
        out.writeheader()
        out.writerows(kept)
        for mesh, of_mesh in MESHES.items():
            for scene, of_scene in SCENES.items():
                if word in of_scene:
                    options = f"{of_scene} {of_mesh}"
                    out.writerows({"scene": scene, "mesh": mesh, "options": options, **r} for r in rows(program, options))
                    file.flush()


def rows(program, options):
    ran = subprocess.run([program, *options.split()], stdout=subprocess.PIPE, text=True)
    return list(csv.DictReader(ran.stdout.splitlines()))


def run(program):
    with open("contact_closed_forms.csv", "w") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["what", "options", "known_N", "force_N", "off_percent"])
        for what, options, known in closed_forms():
            force = float(rows(program, options)[-1]["force_N"])
            out.writerow([what, options, f"{known:.6g}", f"{force:.6g}", f"{100 * (force / known - 1):.2f}"])
            file.flush()
    again(program, "")


def small(program):
    """A sphere of 5 mm to depth / radius 0.02 to 0.8 in cylinders 4, 10 and 40 radii of its contact high and wide, the
    radius that of Sneddon at the last depth; elements of 1/11 and 1/16 of it."""
    with open("small_contacts.csv", "w") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["depth_share", "thickness_radii", "height_mm", "depth_mm", "force_N", "known_to_percent"])
        for share in (0.02, 0.05, 0.1, 0.2, 0.4, 0.8):
            a = contact_radius(5.0, 5.0 * share)
            for radii in (4, 10, 40):
                h = round(radii * a, 3)
                by = [[float(r["force_N"]) for r in rows(
                    program, f"tool=sphere radius=5 depth={5 * share} steps=8 body={h} height={h} fine={a / n:.5f} "
                             f"reach={1.35 * a:.5f} below={0.65 * a:.5f} growth=1.2 largest={h / 8:.4f}")]
                      for n in (11, 16)]
                for k, (coarse, fine) in enumerate(zip(*by)):
                    out.writerow([share, radii, h, f"{5 * share * (k + 1) / 8:.5g}", fine,
                                  f"{max(100 * abs(coarse / fine - 1), 0.1):.1f}"])
                file.flush()


def derive():
    force = {}
    for r in csv.DictReader(open("contact_runs.csv")):
        force.setdefault((r["scene"], float(r["depth_mm"])), {})[r["mesh"]] = float(r["force_N"])
    with open("contact.csv", "w") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["scene", "depth_mm", "force_N", "known_to_percent"])
        for (scene, depth), by in force.items():
            levels = [by[mesh] for mesh in MESHES if mesh in by]
            if len(levels) < 2:
                continue
            # The error oscillates as the contact's edge passes the borders of elements, so there is no order:
            # the differences of the three meshes are used without extrapolation.
            doubt = 100 * (max(levels) - min(levels)) / levels[-1]
            out.writerow([scene, f"{depth:g}", f"{levels[-1]:.5g}", f"{max(doubt, 0.1):.1f}"])


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] == "run":
        run(sys.argv[2])
    if len(sys.argv) == 3 and sys.argv[1] == "friction":
        friction(sys.argv[2])
    if len(sys.argv) == 4 and sys.argv[1] == "again":
        again(sys.argv[2], sys.argv[3])
    if len(sys.argv) == 3 and sys.argv[1] == "small":
        small(sys.argv[2])
    derive()
