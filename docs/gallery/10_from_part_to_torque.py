"""
From a part to a torque
=======================

A forearm is a printed tube with windows. No beam says what it is; its mesh does (``models/meshed_arm/forearm.inp``, as Abaqus and
CalculiX write it). The mechanism file names the mesh, its unit, a material, and the sets of nodes at which it is held and
holds the hand.
"""

# %%
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import flexinv
from flexinv.inverse.part_forces import compute_part_motion

folder = "models/meshed_arm"
arm = flexinv.load_mechanism(folder)
case = flexinv.load_cases(folder, arm)["reach"]
modes = flexinv.natural_modes(arm, count=3)
print(", ".join(f"{f:.2f} Hz" for f in modes.frequency))

# %%
# Torques, and both ways to them
# ------------------------------
#
# The march knows 14 shapes of the forearm. The paper's second step forms P = M (a - g) at each of the 1,380 nodes of the mesh.
# Both give one torque; what is left is rounding.

solution = flexinv.solve(arm, case.motion, step=1e-3, initial="static")
gap = np.abs(solution.balance.meshes).max()
print(f"largest difference of both ways: {gap:.1e} N m")

# %%
# Loads along a link stiffen it
# -----------------------------
#
# The file leaves geometric stiffening out, as Exudyn's floating frame does, with which it is compared. With it the torques change
# by this much:

link = arm.link_of["forearm"]
stiffer = replace(link, part=replace(link.part, stiffening=True))
other = replace(arm, links=tuple(stiffer if one is link else one for one in arm.links))
whole = flexinv.solve(other, case.motion, step=1e-3, initial="static")

figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
for k, joint in enumerate(solution.torque_names):
    axes[0].plot(solution.time, whole.torque[:, k], label=joint)
    axes[1].plot(solution.time, whole.torque[:, k] - solution.torque[:, k], label=joint)
axes[0].set(xlabel="time [s]", ylabel="torque [N m]", title="with stiffening")
axes[1].set(xlabel="time [s]", ylabel="difference [N m]", title="what stiffening does")
axes[0].legend()

# %%
# In motion
# ---------
#
# The mesh as a coarse net, from blue to red by the same stress.

whole.animate()

# %%
# Where the part is stressed most
# -------------------------------
#
# Von Mises's stress at the nodes of the mesh, at the instant at which it is largest. Deflections are drawn ten times as large.

stress = whole.stress["forearm"]
part = compute_part_motion(whole.mesh, whole.nodes, "forearm")
sample = int(stress.largest.argmax())
rest = part.reduced.points
drawn = rest + 10.0 * (part.places[sample] - rest)
print(
    f"{stress.largest[sample] / 1e6:.2f} MPa at t = {whole.time[sample]:.3f} s,"
    f" at {np.round(stress.place[sample], 3)} m of the link"
)

faces = np.vstack([cells.nodes[:, :4] for cells in link.part.cells])  # outer ones
faces = np.searchsorted(part.reduced.used, faces)
shade = stress.compute(sample)[0, faces].mean(axis=1) / 1e6

figure = plt.figure(figsize=(8, 3))
view = figure.add_axes((0.0, -0.2, 0.85, 1.4), projection="3d")
walls = Poly3DCollection(
    drawn[faces], array=shade, cmap="viridis", edgecolor="white", linewidth=0.4
)
view.add_collection3d(walls)
low, high = drawn.min(axis=0), drawn.max(axis=0)
view.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
view.set_box_aspect(np.ptp(drawn, axis=0), zoom=1.2)
view.view_init(elev=22, azim=-62)
view.set_axis_off()
figure.colorbar(
    walls, cax=figure.add_axes((0.88, 0.15, 0.02, 0.7)), label="von Mises stress [MPa]"
)
