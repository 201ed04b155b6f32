"""Computes a scene with CalculiX and prints the forces.

    python3 tests/benchmark/run_calculix.py SCENE NODES     (apt install calculix-ccx python3-numpy)

Twenty-node hexahedra with reduced integration, which hardly lock at nu = 0.499; face-to-face contact with a rigid tool by a penalty.
The penalty's stiffness is so high that a higher one changes the force by less than the mesh does. A film is a layer of elements.
"""

import os
import subprocess
import tempfile

import numpy as np
from hexahedra import C3D20, edge_for, mesh, refined_radius, tool_surface
from runner import CannotRun, main

STIFFNESS = 2000     # of the penalty, mu / edge
FILM = 0.05          # mm: thickness of the layer of elements for a film
CLEARANCE = 1.0      # mm: of the tool before gravity acts
FILM_NU = 0.499


def lines(name, values):
    return f"{name}\n" + "".join(f"{value}\n" for value in values)


def element_lines(name, kind, elements, first):
    return lines(f"*ELEMENT, TYPE={kind}, ELSET={name}",
                 [",".join(map(str, [first + k, *nodes[:10]])) + ("," if nodes[10:] else "") + "\n" * bool(nodes[10:]) +
                  ",".join(map(str, nodes[10:])) for k, nodes in enumerate(elements)])


def material(name, mu, nu, density):
    bulk = 2 * mu * (1 + nu) / (3 * (1 - 2 * nu))
    return (f"*MATERIAL, NAME={name}\n*HYPERELASTIC, NEO HOOKE\n{mu / 2:.9g},{2 / bulk:.9g}\n*DENSITY\n{density:.9g}\n"
            f"*SOLID SECTION, ELSET={name}, MATERIAL={name}\n")


def step(text, sets):
    return (f"*STEP, NLGEOM, INC=100\n*STATIC\n1,1,1e-3,1\n{text}*NODE PRINT, NSET=BASE, TOTALS=ONLY, FREQUENCY=1000\nRF\n"
            f"{sets}*END STEP\n")


class Deck:
    """The body, its contact and its sets; numbers of nodes and elements begin with 1."""

    def __init__(self, scene, edge):
        self.scene, self.edge = scene, edge
        number = {}
        node = lambda x: number.setdefault(tuple(np.round(x, 6)), len(number) + 1)
        elements, on_top = mesh(edge, scene)
        tissue = [[node(points[at]) for at in C3D20] for points in elements]
        top = list(range(1, on_top + 1))
        self.film = []
        if scene["film_N_per_m"]:
            for points in elements[:on_top]:
                layer = points.copy()
                layer[..., 2] = scene["body"]["height_mm"] + 0.5 * FILM * np.arange(3)
                self.film.append([node(layer[at]) for at in C3D20])
            top = list(range(len(tissue) + 1, len(tissue) + on_top + 1))
        self.tissue, self.height = tissue, scene["body"]["height_mm"] + (FILM if self.film else 0)
        self.place = np.array(list(number))
        r = np.hypot(self.place[:, 0], self.place[:, 1])
        highest = self.place[:, 2] > self.height - 1e-6
        mean = [np.hypot(*points[1, 1, 2, :2]) for points in elements[:on_top]]
        self.in_contact = [e for e, away in zip(top, mean) if away < refined_radius(scene)]
        self.base = np.flatnonzero(self.place[:, 2] < 1e-6) + 1
        self.patch = np.flatnonzero(highest & (r < scene["tool"]["radius_mm"] + 1e-4)) + 1
        self.middle = int(np.flatnonzero(highest & (r < 1e-6))[0]) + 1

    def body(self):
        scene = self.scene
        mu, density = 1e-6 * scene["mu_Pa"], 1e-12 * scene["density_kg_per_m3"]  # N/mm2, t/mm3
        text = lines("*NODE", [f"{k + 1},{x:.9g},{y:.9g},{z:.9g}" for k, (x, y, z) in enumerate(self.place)])
        text += element_lines("TISSUE", "C3D20R", self.tissue, 1) + material("TISSUE", mu, scene["nu"], density)
        if self.film:
            text += element_lines("FILM", "C3D20R", self.film, len(self.tissue) + 1)
            text += material("FILM", 1e-3 * scene["film_N_per_m"] / FILM, FILM_NU, 0)
        for name, nodes in (("BASE", self.base), ("PATCH", self.patch), ("MIDDLE", [self.middle])):
            text += lines(f"*NSET, NSET={name}", [f"{n}," for n in nodes])
        return text + "*BOUNDARY\nBASE,1,3\n"

    def tool(self, above):
        """The tool, its tip `above` the top; returns the text and the node that moves it."""
        mu = 1e-6 * self.scene["mu_Pa"]
        place, hexahedra = tool_surface(self.scene["tool"])
        first, last = len(self.place) + 1, len(self.tissue) + len(self.film)
        place = place + [0, 0, self.height + above]
        moves = first + len(place)
        text = lines("*NODE, NSET=TOOL", ["{},{:.9g},{:.9g},{:.9g}".format(first + k, *x) for k, x in enumerate(place)])
        text += lines("*NODE", [f"{n},0,0,{self.height + above:.9g}" for n in (moves, moves + 1)])
        text += element_lines("TOOL", "C3D8", [[first + n for n in nodes] for nodes in hexahedra], last + 1)
        text += "*MATERIAL, NAME=TOOL\n*ELASTIC\n1,0.3\n*DENSITY\n0\n*SOLID SECTION, ELSET=TOOL, MATERIAL=TOOL\n"
        text += lines("*SURFACE, NAME=TOP, TYPE=ELEMENT", [f"{e},S2" for e in self.in_contact])
        text += lines("*SURFACE, NAME=OF_TOOL, TYPE=ELEMENT", [f"{last + k + 1},S1" for k in range(len(hexahedra))])
        stiff = STIFFNESS * mu / self.edge
        text += (f"*RIGID BODY, NSET=TOOL, REF NODE={moves}, ROT NODE={moves + 1}\n*SURFACE INTERACTION, NAME=CONTACT\n"
                 f"*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n{stiff:.9g},0\n")
        text += f"*FRICTION\n{self.scene['friction']},{0.1 * stiff:.9g}\n" if self.scene["friction"] else ""
        return text + ("*CONTACT PAIR, INTERACTION=CONTACT, TYPE=SURFACE TO SURFACE\nTOP,OF_TOOL\n"
                       f"*BOUNDARY\n{moves},1,2\n{moves + 1},1,3\n"), moves


def solve(text, folder):
    """Totals of the base, and the values of further nodes that were printed, in turn."""
    name = os.path.join(folder, "scene")
    with open(name + ".inp", "w") as out:
        out.write(text)
    done = subprocess.run(["ccx", "-i", name], capture_output=True, text=True, cwd=folder, env=dict(os.environ, OMP_NUM_THREADS="1"))
    if done.returncode or "*ERROR" in done.stdout:
        errors = [line.strip() for line in done.stdout.splitlines() if "*ERROR" in line or "diverge" in line]
        raise CannotRun("; ".join(errors[:2]) or f"no equilibrium, exit code {done.returncode}")
    with open(name + ".dat") as said:
        rows = [line.split() for line in said]
    return [float(row[2]) for row in rows if len(row) == 3], [float(row[-1]) for row in rows if len(row) == 4]


def run(_, scene, nodes):
    version = subprocess.run(["ccx", "-v"], capture_output=True, text=True).stdout.split()[-1]
    edge = edge_for(nodes, scene, True)
    deck, depths, gravity = Deck(scene, edge), scene["depths_mm"], scene["gravity_m_per_s2"]
    weight = f"*DLOAD\nTISSUE,GRAV,{1e3 * gravity:.9g},0,0,-1\n"
    with tempfile.TemporaryDirectory() as folder:
        if scene["tool"]["shape"] == "disc":
            text = deck.body() + "".join(step(f"*BOUNDARY\nPATCH,1,2\nPATCH,3,3,{-d:.9g}\n", "") for d in depths)
            forces = solve(text, folder)[0]
        elif gravity:
            sag = -solve(deck.body() + step(weight, "*NODE PRINT, NSET=MIDDLE, FREQUENCY=1000\nU\n"), folder)[1][-1]
            tool, moves = deck.tool(CLEARANCE)
            text = deck.body() + tool
            for depth in [0, *depths]:
                text += step(f"*BOUNDARY\n{moves},3,3,{-CLEARANCE - sag - depth:.9g}\n{weight}", "")
            borne = solve(text, folder)[0]
            forces = [force - borne[0] for force in borne[1:]]
        else:
            tool, moves = deck.tool(0)
            text = deck.body() + tool + "".join(step(f"*BOUNDARY\n{moves},3,3,{-d:.9g}\n", "") for d in depths)
            forces = solve(text, folder)[0]
    if len(forces) < len(depths):
        raise CannotRun(f"no equilibrium beyond {depths[len(forces) - 1] if forces else 0:g} mm")
    return version, len(deck.place), forces


if __name__ == "__main__":
    main("CalculiX", __doc__, run)
