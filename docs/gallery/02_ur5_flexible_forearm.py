"""
A UR5 with a flexible forearm
=============================

The robot comes from its URDF. Its forearm is replaced by a slender tube, laid over the URDF in a few lines of TOML
(``models/ur5_flexible_forearm/mechanism.toml``). What does that do to the torques?
"""

# %%
import matplotlib.pyplot as plt
import numpy as np
import plotly.graph_objects as go

import flexinv

folder = "models/ur5_flexible_forearm"
robot = flexinv.load_mechanism(folder)
case = flexinv.load_cases(folder, robot)["reach"]
solution = flexinv.solve(robot, case.motion, step=1e-3, initial="static")
stiff = flexinv.joint_torques(
    flexinv.load_mechanism("models/ur5"), solution.q, solution.qd, solution.qdd
)

figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
for k, joint in enumerate(solution.torque_names[:3]):
    axes[0].plot(
        solution.time,
        solution.torque[:, k],
        color=f"C{k}",
        label=joint.removesuffix("_joint"),
    )
    axes[0].plot(solution.time, stiff[:, k], "--", color=f"C{k}", linewidth=0.8)
axes[0].set(
    xlabel="time [s]",
    ylabel="torque [N m]",
    title="dashed: the UR5 as it is, with its own forearm",
)
axes[0].legend(fontsize="small")
axes[1].plot(solution.time, 1e3 * solution.deflection["forearm_link"][:, 1:])
axes[1].set(
    xlabel="time [s]", ylabel="deflection [mm]", title="end of the forearm, across it"
)
axes[1].legend(["y", "z"])

# %%
# The motion in space
# -------------------
#
# Turn the view with the mouse; the slider is time. Deflections are drawn as they are.

x, parent = solution.nodes.x, np.asarray(solution.mesh.parent)
start = np.where(parent >= 0, parent, 0)
frames = []
for k in range(0, len(solution.time), 40):
    ends = np.stack([x[k, start], x[k], np.full_like(x[k], np.nan)], axis=1).reshape(
        -1, 3
    )
    line = go.Scatter3d(
        x=ends[:, 0],
        y=ends[:, 1],
        z=ends[:, 2],
        mode="lines",
        line={"width": 8, "color": "#1f5fa8"},
    )
    frames.append(go.Frame(data=[line], name=f"{solution.time[k]:.2f}"))
slider = {
    "steps": [
        {
            "method": "animate",
            "label": f.name,
            "args": [[f.name], {"mode": "immediate"}],
        }
        for f in frames
    ]
}
box = {
    axis: {"range": [low, high]}
    for axis, low, high in (("xaxis", -1, 1), ("yaxis", -1, 1), ("zaxis", -0.2, 1.2))
}
view = go.Figure(frames[0].data, frames=frames)
view.update_layout(
    scene={**box, "aspectmode": "cube"},
    sliders=[slider],
    showlegend=False,
    height=480,
    margin={"t": 10},
)
