"""Graded quadratic hexahedra of the benchmark's bodies, and the rigid tool as a surface of revolution. Lengths in mm."""

import numpy as np

GROWTH = 0.5        # of the edges outside the refined part, from one to the next
REFINED = 1.3       # radius of the refined part in radii of a contacting tool
STEEPEST = 75       # degrees: largest slope of a sphere that may be in contact
# Places of the nodes in a grid of 3 x 3 x 3 in the order of C3D20: corners, then middles of the edges.
C3D20 = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2), (1, 0, 0), (2, 1, 0), (1, 2, 0),
         (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2), (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]


def refined_radius(scene):
    return scene["tool"]["radius_mm"] * (1 if scene["tool"]["shape"] == "disc" else REFINED)


def graded(first, end):
    """Places from 0 to `end` whose steps begin with about `first` and grow."""
    steps = [first]
    while sum(steps) + steps[-1] < end:
        steps.append(steps[-1] * (1 + GROWTH))
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return places * end / places[-1]


def divisions(edge, scene):
    """Half the squares along the core, rings around it up to the refined radius, radii beyond it, and depths of the layers."""
    inner, body = refined_radius(scene), scene["body"]
    core = max(1, round(0.5 * inner / edge))
    return core, core, graded(edge, 0.5 * body["width_mm"] - inner), graded(edge, body["height_mm"])


def count(edge, scene, serendipity):
    """Number of nodes, without a mesh."""
    core, rings, beyond, depths = divisions(edge, scene)
    rings, layers = rings + len(beyond) - 1, len(depths) - 1
    corners, faces = (2 * core + 1) ** 2 + 8 * core * rings, 4 * core ** 2 + 8 * core * rings
    edges = corners + faces - 1
    return (corners + edges) * (layers + 1) + corners * layers if serendipity else (corners + edges + faces) * (2 * layers + 1)


def edge_for(nodes, scene, serendipity):
    """Edge length whose mesh has about so many nodes."""
    return min(8.0 * 0.96 ** np.arange(100), key=lambda edge: abs(np.log(count(edge, scene, serendipity) / nodes)))


def faces_of_top(edge, scene):
    """Nine points [3 x 3 x 2] of each quadrangle: a square core, rings to a circle, and rings to the outline."""
    inner, half = refined_radius(scene), 0.5 * scene["body"]["width_mm"]
    core, rings, beyond, _ = divisions(edge, scene)
    return quadrangles(core, inner, np.linspace(0, 1, rings + 1), beyond / beyond[-1], scene["body"]["shape"], (half, half))


def quadrangles(core, inner, within, beyond, shape, half, middle=(0.0, 0.0)):
    """Those of a top with these half lengths, about a circle of radius `inner`. Rings at parts of the way, from 0 to 1: `within`, from the
    core to the circle, and `beyond`, from the circle to the outline. The middle of the outline is at -`middle`."""
    c = 0.5 * inner
    at = np.linspace(-c, c, 4 * core + 1)
    grid = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1)
    faces = [grid[2 * i:2 * i + 3, 2 * j:2 * j + 3] for i in range(2 * core) for j in range(2 * core)]
    side = at[:-1]
    border = np.array([(x, -c) for x in side] + [(c, y) for y in side] + [(-x, c) for x in side] + [(-c, -y) for y in side])
    circle = inner * border / np.linalg.norm(border, axis=1)[:, None]
    outline = np.array(half) * (border / c if shape == "block" else circle / inner) - np.array(middle)
    lines = [border + s * (circle - border) for s in within[:-1]]
    lines += [circle + s * (outline - circle) for s in beyond]
    for low, high in zip(lines, lines[1:]):
        strip = np.stack([low, 0.5 * (low + high), high])
        faces += [strip[:, np.arange(k, k + 3) % len(border)] for k in range(0, len(border), 2)]
    return faces


def mesh(edge, scene):
    """Elements as points [3 x 3 x 3 x 3], the uppermost layer first, and the number of faces of the top."""
    faces = faces_of_top(edge, scene)
    return layers(faces, scene["body"]["height_mm"] - divisions(edge, scene)[3]), len(faces)


def layers(faces, z):
    """Elements below each of the faces, between heights z that fall."""
    elements = []
    for top, low in zip(z, z[1:]):
        levels = np.array([low, 0.5 * (low + top), top])
        for face in faces:
            points = np.empty((3, 3, 3, 3))
            points[..., :2], points[..., 2] = face[:, :, None], levels
            elements.append(points)
    return elements


def profile(tool, steps):
    """Points (r, z) from the tip outwards, and normals. Facets are as often outside the rounding as inside."""
    edge = tool.get("edge_mm", tool["radius_mm"])
    flat = tool["radius_mm"] - edge
    inside = steps // 4 if flat else 0
    bend = np.radians(np.linspace(0, 89 if flat else STEEPEST, steps - inside + 1))
    wider = edge * (1 + bend[1] ** 2 / 12)
    arc = np.stack([flat + wider * np.sin(bend), edge - wider * np.cos(bend)], axis=1)
    normal = np.stack([np.sin(bend), -np.cos(bend)], axis=1)
    arc[0, 1] *= flat == 0
    level = np.stack([np.linspace(0, flat, inside + 1)[:-1], np.zeros(inside)], axis=1)
    return np.concatenate([level, arc]), np.concatenate([np.tile([0.0, -1.0], (inside, 1)), normal])


def tool_surface(tool, steps=8, thick=0.3):
    """The rigid tool, tip at the origin, as one layer of hexahedra: places of both sides, and corners by numbers from 0."""
    line, normal = profile(tool, steps)
    n = len(line) - 1
    place = []
    for points in (line, line - thick * normal):
        for i in range(-n, n + 1):
            for j in range(-n, n + 1):
                k = max(abs(i), abs(j))
                # Concentric squares become concentric circles.
                angle = 0.0 if k == 0 else (0.25 * np.pi * j / i + (np.pi if i < 0 else 0)) if abs(i) == k else (
                    0.5 * np.pi - 0.25 * np.pi * i / j + (np.pi if j < 0 else 0))
                place.append((points[k, 0] * np.cos(angle), points[k, 0] * np.sin(angle), points[k, 1]))
    across = 2 * n + 1
    side = lambda i, j, layer: [layer * across ** 2 + a * across + b for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))]
    return np.array(place), [side(i, j, 0) + side(i, j, 1) for i in range(2 * n) for j in range(2 * n)]
