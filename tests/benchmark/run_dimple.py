"""Computes a scene with Dimple from the label image and prints the forces.

    python3 tests/benchmark/run_dimple.py SCENE NODES     (DIMPLE: the program, by default build/release/dimple; DIMPLE_SEED)
"""

import csv
import os
import subprocess
import tempfile

from runner import CannotRun, main

DIMPLE = os.environ.get("DIMPLE", "build/release/dimple")
SPACING_OF_FRAMES = 0.5  # mm


def options(scene):
    tool = scene["tool"]
    words = {"disc": ["--indenter-diameter", f"{2 * tool['radius_mm']}mm"], "sphere": ["--tool", f"sphere:{tool['radius_mm']}mm"],
             "punch": ["--tool", f"punch:{tool['radius_mm']}mm,edge={tool.get('edge_mm')}mm"]}[tool["shape"]]
    words += ["--mu", f"{scene['mu_Pa']}Pa", "--nu", str(scene["nu"]), "--density", str(scene["density_kg_per_m3"])]
    words += ["--friction", str(scene["friction"])] if scene["friction"] else []
    words += ["--gravity", f"0,0,-{scene['gravity_m_per_s2']}"] if scene["gravity_m_per_s2"] else []
    if scene["film_N_per_m"]:
        film = {"thickness_mm": 0.1, "mu_Pa": 1e4 * scene["film_N_per_m"], "on": "superior", "wrinkles": "no"}
        words += [word for key, value in film.items() for word in ("--set", f"membrane.film.{key}={value}")]
    return words


def run(folder, scene, nodes):
    version = subprocess.run([DIMPLE, "--version"], capture_output=True, text=True).stdout.split()[-1]
    depth = scene["depths_mm"][-1]
    with tempfile.TemporaryDirectory() as out:
        done = subprocess.run([DIMPLE, "run", os.path.join(folder, "body.nrrd"), "-o", out, "--force", "-q", "--threads", "1",
                               "--write", "force", "--band", "off", "--base", "inferior", "--indent-at", "0,0,top",
                               "--nodes", str(nodes), "--seed", os.environ.get("DIMPLE_SEED", "1"), "--depth", f"{depth}mm",
                               "--frames", str(round(depth / SPACING_OF_FRAMES)), *options(scene)], capture_output=True, text=True)
        if done.returncode:
            raise CannotRun(done.stderr.strip().replace("\n", " ") or f"exit code {done.returncode}")
        with open(os.path.join(out, "force.csv")) as file:
            at = {round(float(row["indentation_mm"]), 6): float(row["force_N"]) for row in csv.DictReader(file)}
    return version, nodes, [at[float(depth)] for depth in scene["depths_mm"]]


if __name__ == "__main__":
    main("Dimple", __doc__, run)
