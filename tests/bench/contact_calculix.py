"""The scene of contact_peer.py for CalculiX: twenty-node hexahedra with reduced integration, which hardly lock at nu = 0.499, and a
rigid ball that touches them face to face. It has no pressures as unknowns and no contact without a penalty: the penalty's stiffness
is chosen so high that more changes the force by less than the mesh does."""

import os
import subprocess

import numpy as np

CORE = 4.0  # mm: half the edge of the square in the middle of the cylinder's top, around which rings lie
STIFFNESS = 2000  # of the penalty, mu / edge
WIDE = np.tan(0.3 * np.pi)  # of the ball's part that may touch, about 54 degrees to each side


def graded(first, growth, end):
    """Places from 0 to `end` whose steps begin with `first` and grow by that share."""
    steps = [first]
    while sum(steps) + steps[-1] < end:
        steps.append(steps[-1] * (1 + growth))
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return places * end / places[-1]


def quadrangles(edge, growth, radius):
    """Of the top, corners of each in turn: a square, and rings from its border to the circle."""
    count = 2 * max(1, round(CORE / edge))
    at = np.linspace(-CORE, CORE, count + 1)
    faces = [np.array([(at[i], at[j]), (at[i + 1], at[j]), (at[i + 1], at[j + 1]), (at[i], at[j + 1])])
             for i in range(count) for j in range(count)]
    side = at[:-1]
    border = np.array([(x, -CORE) for x in side] + [(CORE, y) for y in side] + [(-x, CORE) for x in side] + [(-CORE, -y) for y in side])
    share = graded(edge, growth, radius - CORE) / (radius - CORE)
    out = border / np.linalg.norm(border, axis=1)[:, None] * radius
    rings = [border + s * (out - border) for s in share]
    for inner, outer in zip(rings, rings[1:]):
        for k in range(len(border)):
            last = (k + 1) % len(border)
            faces.append(np.array([inner[k], outer[k], outer[last], inner[last]]))
    return faces


class Mesh:
    """Nodes, numbered from 1 as they come, and elements."""

    def __init__(self):
        self.place, self.number, self.element = [], {}, []

    def node(self, x):
        key = tuple(np.round(x, 6))
        if key not in self.number:
            self.number[key] = len(self.place) + 1
            self.place.append(key)
        return self.number[key]

    def add_hexahedron(self, low, top):
        corner = [*low, *top]
        edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
        self.element.append([self.node(x) for x in corner] + [self.node(0.5 * (corner[a] + corner[b])) for a, b in edges])


def cylinder(edge, growth, radius, height, touches):
    """The mesh, and the numbers of the elements whose upper face may be touched."""
    mesh, touched = Mesh(), []
    faces, levels = quadrangles(edge, growth, radius), height - graded(edge, growth, height)
    for top, low in zip(levels, levels[1:]):
        for face in faces:
            mesh.add_hexahedron([np.append(x, low) for x in face], [np.append(x, top) for x in face])
            if top == levels[0] and np.hypot(*face.mean(axis=0)) < touches:
                touched.append(len(mesh.element))
    return mesh, touched


def ball(edge, radius):
    """The part around its lowest place, one layer of hexahedra: places, and their corners by the places' numbers from 0."""
    count = max(12, int(np.ceil(2.4 * radius / edge)))
    at = np.tan(np.linspace(-1, 1, count + 1) * np.arctan(WIDE))
    place = []
    for r in (radius, 0.9 * radius):
        for x in at:
            for y in at:
                place.append(r * np.array([x, y, -1.0]) / np.linalg.norm([x, y, 1.0]))
    n = count + 1
    one = lambda i, j, layer: layer * n * n + i * n + j
    face = lambda i, j, layer: [one(i, j, layer), one(i + 1, j, layer), one(i + 1, j + 1, layer), one(i, j + 1, layer)]
    return place, [face(i, j, 0) + face(i, j, 1) for i in range(count) for j in range(count)]


def lines(name, values):
    return f"{name}\n" + "".join(f"{v}\n" for v in values)


def write(file, edge, growth, scene):
    """Writes the input; returns the number of unknowns."""
    radius, height, sphere, depths, mu, bulk = scene
    mesh, touched = cylinder(edge, growth, radius, height, 1.3 * sphere)
    place, of_ball = ball(edge, sphere)
    first, last = len(mesh.place) + 1, len(mesh.element)
    middle = np.array([0, 0, height + sphere])
    holds = first + len(place)
    text = lines("*NODE", [f"{k + 1},{x:.9g},{y:.9g},{z:.9g}" for k, (x, y, z) in enumerate(mesh.place)])
    text += lines("*NODE, NSET=BALL", ["{},{:.9g},{:.9g},{:.9g}".format(first + k, *(middle + x)) for k, x in enumerate(place)])
    text += lines("*NODE", ["{},{:g},{:g},{:g}".format(n, *middle) for n in (holds, holds + 1)])
    text += lines("*ELEMENT, TYPE=C3D20R, ELSET=TISSUE",
                  [",".join(map(str, [k + 1, *nodes[:10]])) + ",\n" + ",".join(map(str, nodes[10:]))
                   for k, nodes in enumerate(mesh.element)])
    text += lines("*ELEMENT, TYPE=C3D8, ELSET=TOOL",
                  [",".join(map(str, [last + k + 1, *(first + n for n in nodes)])) for k, nodes in enumerate(of_ball)])
    text += lines("*NSET, NSET=BASE", [f"{k + 1}," for k, x in enumerate(mesh.place) if x[2] < 1e-6])
    text += lines("*SURFACE, NAME=TOUCHED, TYPE=ELEMENT", [f"{e},S2" for e in touched])
    text += lines("*SURFACE, NAME=OF_BALL, TYPE=ELEMENT", [f"{last + k + 1},S1" for k in range(len(of_ball))])
    text += (f"*RIGID BODY, NSET=BALL, REF NODE={holds}, ROT NODE={holds + 1}\n"
             f"*MATERIAL, NAME=TISSUE\n*HYPERELASTIC, NEO HOOKE\n{mu / 2:.9g},{2 / bulk:.9g}\n*MATERIAL, NAME=TOOL\n*ELASTIC\n1,0.3\n"
             "*SOLID SECTION, ELSET=TISSUE, MATERIAL=TISSUE\n*SOLID SECTION, ELSET=TOOL, MATERIAL=TOOL\n"
             f"*SURFACE INTERACTION, NAME=CONTACT\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n{STIFFNESS * mu / edge:.9g},0\n"
             "*CONTACT PAIR, INTERACTION=CONTACT, TYPE=SURFACE TO SURFACE\nTOUCHED,OF_BALL\n"
             f"*BOUNDARY\nBASE,1,3\n{holds},1,2\n{holds + 1},1,3\n")
    for depth in depths:
        text += (f"*STEP, NLGEOM, INC=60\n*STATIC\n1,1,1e-3,1\n*BOUNDARY\n{holds},3,3,{-depth:.9g}\n"
                 "*NODE PRINT, NSET=BASE, TOTALS=ONLY, FREQUENCY=100\nRF\n*END STEP\n")
    with open(file, "w") as out:
        out.write(text)
    return 3 * len(mesh.place)


def forces(edge, growth, scene, folder, longest_s=200):
    """Unknowns, and the forces at the depths; nothing where it does not converge."""
    name = os.path.join(folder, "scene")
    unknowns = write(name + ".inp", edge, growth, scene)
    try:
        subprocess.run(["ccx", "-i", name], check=True, timeout=longest_s, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                       env=dict(os.environ, OMP_NUM_THREADS=str(os.cpu_count())), cwd=folder)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
        return unknowns, []
    with open(name + ".dat") as said:
        return unknowns, [float(line.split()[-1]) for line in said if len(line.split()) == 3]
