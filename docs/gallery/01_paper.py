"""
The paper's four examples
=========================

D. Isobe and co-workers show their scheme on four examples: a rigid arm, the time that it takes, one link that bends,
and two links of different stiffness. Here is each in a few calls.
"""

# %%
# Example 1, rigid: how many steps a second are enough?
# -----------------------------------------------------
#
# The paper finds accelerations from differences of nodal positions. Its error falls with the number of steps.

import time

import matplotlib.pyplot as plt
import numpy as np

import flexinv

arm = flexinv.load_mechanism("models/rigid_3r")
case = flexinv.load_cases("models/rigid_3r", arm)["cycloid"]
exact = flexinv.solve(arm, case.motion, step=1e-3)

figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
axes[0].plot(exact.time, exact.torque, label=exact.torque_names)
axes[0].set(
    xlabel="time [s]",
    ylabel="torque [N m]",
    title="three rigid links in a vertical plane",
)
axes[0].legend()
errors = {}
for steps in (10, 20, 50, 100):
    found = flexinv.solve(arm, case.motion, step=1 / steps, incremental=True)
    same = exact.torque[:: 1000 // steps]
    errors[steps] = abs(found.torque - same).max() / np.ptp(exact.torque)
axes[1].loglog(errors.keys(), errors.values(), "o-")
axes[1].set(
    xlabel="steps a second",
    ylabel="largest error / range",
    title="the paper's incremental form",
)
assert errors[100] < errors[50] < errors[20] < errors[10]

# %%
# Example 2: the time of one step
# -------------------------------

f, out = flexinv.prepare(arm), np.empty(3)
f.sample(exact.q[0], exact.qd[0], exact.qdd[0], out)
begin = time.perf_counter()
for k in range(1000):
    f.sample(exact.q[k], exact.qd[k], exact.qdd[k], out)
print(f"{(time.perf_counter() - begin) * 1e3:.2f} us for the torques of one instant")

# %%
# Example 3: one link that bends
# ------------------------------
#
# A strip of 0.4 m and 22 g turns by 180 degrees in 0.2 s. Then it rings with 0.0998 s, as the theory of a cantilever says.

strip = flexinv.load_mechanism("models/flex_one_link")
half_turn = flexinv.Motion.point_to_point(
    {"hub": 0.0}, {"hub": np.pi}, duration=0.2, hold=0.3
)
bending = flexinv.solve(strip, half_turn, step=5e-4)
rigid = flexinv.solve(
    flexinv.load_mechanism("models/rigid_one_link"), half_turn, step=5e-4
)
period = 1 / flexinv.natural_modes(strip, count=1).frequency[0]
assert abs(period - 0.0998) < 1e-4

figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
axes[0].plot(bending.time, bending.torque, label="flexible")
axes[0].plot(rigid.time, rigid.torque, "--", label="rigid")
axes[0].set(xlabel="time [s]", ylabel="torque [N m]", title="one link")
axes[0].legend()
axes[1].plot(bending.time, 1e3 * bending.deflection["link"][:, 1])
axes[1].set(
    xlabel="time [s]",
    ylabel="deflection of the tip [mm]",
    title=f"period {1e3 * period:.1f} ms",
)

# %%
# Example 4: two links of different stiffness
# -------------------------------------------

two = flexinv.load_mechanism("models/flex_two_link")
both = flexinv.Motion.point_to_point(
    {"joint1": 0.0, "joint2": 0.0},
    {"joint1": 0.5, "joint2": 1.0},
    duration=0.2,
    hold=0.3,
)
solution = flexinv.solve(two, both, step=5e-4)

figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
axes[0].plot(solution.time, solution.torque, label=solution.torque_names)
axes[0].set(xlabel="time [s]", ylabel="torque [N m]", title="two links")
axes[0].legend()
for name, color in (("link1", "C0"), ("link2", "C1")):
    nodes = solution.mesh.section_nodes[name]
    for k in range(0, 401, 50):
        x = solution.nodes.x[k, nodes]
        axes[1].plot(x[:, 0], x[:, 1], color=color, alpha=0.25 + 0.75 * k / 400)
axes[1].set(
    aspect="equal", xlabel="x [m]", ylabel="y [m]", title="every 25 ms until 0.2 s"
)
assert (
    abs(solution.deflection["link2"]).max()
    > 1.2 * abs(solution.deflection["link1"]).max()
)
