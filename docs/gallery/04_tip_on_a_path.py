"""
The tip of a flexible arm on a path
===================================

If the joints move as those of a rigid arm, the tip of a flexible one leaves its path. Stable inversion finds the motion
of the joints with which the *bent* arm's tip is on the path; the joints begin to move before the path does.
"""

# %%
import matplotlib.pyplot as plt
import numpy as np

import flexinv

arm = flexinv.load_mechanism("models/flex_two_link")
arc = flexinv.Path.arc([0.3, 0, 0], centre=[0.2, 0, 0], angle=np.pi / 2, duration=0.2)
found = flexinv.follow(
    arm, arc, "link2", step=2e-3, start={"joint1": -0.5, "joint2": 1.0}
)

figure, (plane, joints) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
plane.plot(
    found.wanted[:, 0], found.wanted[:, 1], "k", linewidth=4, alpha=0.25, label="path"
)
for way, solution in (
    ("joints of the rigid arm", found.joint_space),
    ("stable inversion", found.solution),
):
    tip = solution.tip["link2"]
    plane.plot(tip[:, 0], tip[:, 1], label=way)
plane.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
plane.legend(fontsize="small")
ahead = np.degrees(found.solution.q - found.rigid.q)
joints.plot(1e3 * found.time, ahead, label=arm.velocity_names)
joints.axvspan(0, 200, color="0.93", zorder=0)
joints.set(
    xlabel="time [ms]",
    ylabel="joints less those of the rigid arm [deg]",
    title="grey: the tip moves",
)
joints.legend(fontsize="small")
assert (
    found.distance(found.solution).max()
    < 1e-9
    < found.distance(found.joint_space).max()
)
