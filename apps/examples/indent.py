# Force curve of an array of labels with its error bounds, and a picture. Cells begin with # %%: editors run them one by
# one, and `python3 indent.py [PICTURE.png]` runs all of them.

# %% A body as an array: half an ellipsoid of the size of a swine's brain, in voxels of 2 mm, on a flat face
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import pydimple

voxel_mm = 2.0
i, j, k = np.indices((54, 42, 24))
labels = (((i - 26.5) / 23) ** 2 + ((j - 20.5) / 16) ** 2 + ((k - 2) / 17) ** 2 < 1) & (k >= 2)
affine = np.diag([voxel_mm, voxel_mm, voxel_mm, 1.0])  # as nibabel gives it: RAS

# %% The force and its error bounds
result = pydimple.run(labels, affine=affine, space="RAS", nodes=1000, depth_mm=5, mu_Pa=210, nu=0.499)
print(result)

# %% The same body under a tool moved by hand
session = pydimple.Session(result.model, mu_Pa=210, nu=0.499)
for depth_mm in (0.2, 0.4, 0.2):
    session.equilibrate(depth_mm=depth_mm)
    print(f"{depth_mm} mm  {session.force_N:.5f} N")


# %% A section through the tool's axis, at rest and deformed
def section(vertices_mm, triangles, origin, normal):
    """Intersections of triangles with a plane, (segments, 2, 3)."""
    side = (vertices_mm - origin) @ normal
    segments = []
    for corners in triangles:
        ends = []
        for a, b in zip(corners, np.roll(corners, 1)):
            if (side[a] < 0) != (side[b] < 0):
                share = side[a] / (side[a] - side[b])
                ends.append(vertices_mm[a] + share * (vertices_mm[b] - vertices_mm[a]))
        if ends:
            segments.append(ends)
    return np.array(segments)


model = result.model
u_mm = 1e3 * result.displacement_m[-1]
centre_mm, radius_mm = 1e3 * model.circle_centre_m, 1e3 * model.circle_radius_m
moved_mm = model.surface_mm + model.at_surface(u_mm)
normal = np.array([0.0, 1.0, 0.0])  # the section is seen from the front

# %% The picture
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
left.plot(1e3 * result.depth_m, result.force_N, "o-", color="tab:blue", label="force")
if result.band_low_N is not None:
    left.fill_between(1e3 * result.depth_m, result.band_low_N, result.band_high_N, alpha=0.25, label="error bounds (discretisation)")
left.set(xlabel="indentation [mm]", ylabel="force [N]", title=str(result)[len("<pydimple.Result: ") : -1])
left.legend()

for vertices, colour, name in ((model.surface_mm, "0.7", "at rest"), (moved_mm, "tab:red", "deformed")):
    lines = section(vertices, model.triangles, centre_mm, normal)
    right.plot(lines[:, :, 0].T, lines[:, :, 2].T, color=colour, lw=1.5)
    right.plot([], [], color=colour, label=name)
near = np.abs((1e3 * model.positions_m - centre_mm) @ normal) < 2.5
nodes_mm = (1e3 * model.positions_m + u_mm)[near]
dots = right.scatter(nodes_mm[:, 0], nodes_mm[:, 2], c=np.linalg.norm(u_mm[near], axis=1), s=12, cmap="viridis")
tip_mm = centre_mm + 1e3 * result.depth_m[-1] * model.push
right.add_patch(
    plt.Rectangle((tip_mm[0] - radius_mm, tip_mm[2]), 2 * radius_mm, 12, facecolor="0.85", edgecolor="0.3", label="tool")
)
figure.colorbar(dots, ax=right, label="displacement of the nodes [mm]")
right.set(xlabel="left [mm]", ylabel="up [mm]", title="section through the tool's axis", aspect="equal")
right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=3)  # off the body
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "indentation.png", dpi=110)
