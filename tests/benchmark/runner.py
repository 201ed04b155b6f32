"""What all runners share: they read SCENE/scene.json and print one row for each depth as CSV."""

import json
import os
import sys


class CannotRun(Exception):
    """The code or its runner does not have what the scene needs."""


def main(code, usage, run):
    """Calls `run(folder, scene, nodes)`, which returns the version, the number of nodes and the forces [N]."""
    if len(sys.argv) != 3:
        sys.exit(usage)
    folder, nodes = sys.argv[1], int(sys.argv[2])
    with open(os.path.join(folder, "scene.json")) as file:
        scene = json.load(file)
    try:
        version, used, forces = run(folder, scene, nodes)
    except (CannotRun, ImportError, OSError) as reason:
        sys.exit(str(reason))
    print("code,version,nodes,depth_mm,force_N")
    for depth, force in zip(scene["depths_mm"], forces):
        print(f"{code},{version},{used},{depth:g},{force:.6g}")
