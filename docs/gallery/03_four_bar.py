"""
A four-bar linkage whose coupler bends
======================================

A closed loop goes through the same call as an open chain. Here the coupler is a beam; its rigid twin is solved beside
it.
"""

# %%
import matplotlib.pyplot as plt
import numpy as np

import flexinv

folder = "models/four_bar_flexible"
bars = flexinv.load_mechanism(folder)
case = next(iter(flexinv.load_cases(folder, bars).values()))
solution = flexinv.solve(
    bars, case.motion, step=1e-3, initial=case.initial, start=case.start
)

figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
axes[0].plot(solution.time, solution.torque)
axes[0].set(
    xlabel="time [s]", ylabel="torque [N m]", title="what the crank's drive gives"
)
x, parent = solution.nodes.x, np.asarray(solution.mesh.parent)
shown = range(0, len(solution.time), max(1, len(solution.time) // 12))
for k in shown:
    for node, before in enumerate(parent):
        ends = (
            x[k, [before, node]] if before >= 0 else np.stack([np.zeros(3), x[k, node]])
        )
        if before >= 0:
            axes[1].plot(
                ends[:, 0],
                ends[:, 1],
                color="C0",
                alpha=0.2 + 0.8 * k / len(solution.time),
            )
axes[1].set(
    aspect="equal", xlabel="x [m]", ylabel="y [m]", title="the linkage in motion"
)

# %%
# The drawing above is made by hand. A mechanism, a motion, a solution and modes also show themselves: at the end of a cell
# as a table with pictures, in a terminal as some ten lines.

solution

# %%
# ``solution.plot()`` gives the curves as a figure of matplotlib, ``solution.animate()`` a moving picture;
# ``.save("four_bar.html")`` keeps it.

solution.animate()

# %%
# Every solution carries its balance of power: what the drive gives is what the linkage gains.

drive = solution.torque * solution.qd[:, : solution.torque.shape[1]]  # [W]
error = abs(solution.power_residual).max() / abs(drive).max()
print(f"largest error of the power balance: {error:.1e} of the drive's power")
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(solution.time, drive, label="the drive gives")
axes.plot(solution.time, solution.power_residual, "--", label="what the balance leaves")
axes.set(xlabel="time [s]", ylabel="power [W]", title="nothing gets lost")
axes.legend(frameon=False)
