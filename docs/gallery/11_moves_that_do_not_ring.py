"""
Moves that do not ring
======================

A strip of spring steel is turned by half a radian. The plain move leaves it swinging. A shaper splits the move into parts
that cancel the vibration, and takes longer for it. The shortest motion within the same torque is quicker than both.
"""

# %%
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import flexinv

STEP = 5e-4
arm = flexinv.load_mechanism("models/flex_one_link")
plain = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 0.5}, duration=0.15)
motions = {"plain": plain}
for kind in ("ZV", "ZVD", "EI"):
    motions[kind] = flexinv.make_shaped_motion(arm, plain, kind).motion
motions["best"] = flexinv.optimize_motion(arm, plain, knots=8).motion

# %%
# What each of them leaves at the tip, of the arm as it is drawn, and at worst where the strip is a fifth stiffer or softer
# or carries a tenth of its mass more at its end:


def leave(mechanism, motion):
    """How far the tip goes on swinging [mm], and the largest torque [N m]."""
    solution = flexinv.solve(mechanism, motion, STEP, end=motion.duration + STEP)
    reach = solution.find_residual_vibration().reach["link"]
    return 1e3 * reach, np.abs(solution.torque).max()


(link,) = arm.beams
mass = link.beam.length * link.beam.section.mass_per_length[0]


def change(stiffness=1.0, load=0.0):
    """The arm with a strip of another stiffness, and a load at its end [kg]."""
    section = link.beam.section
    stiffer = replace(section, stiffness=stiffness * section.stiffness)
    strip = replace(link, beam=replace(link.beam, section=stiffer))
    other = replace(
        arm, links=tuple(strip if one is link else one for one in arm.links)
    )
    if not load:
        return other
    payload = flexinv.Body("payload", flexinv.Inertia(load), station=1.0)
    return other.with_body(link.name, payload)


others = [change(0.8), change(1.2), change(load=0.1 * mass)]
rows = {
    name: {
        "duration [s]": motion.duration,
        "largest torque [N m]": leave(arm, motion)[1],
        "left [mm]": leave(arm, motion)[0],
        "left at worst [mm]": max(leave(one, motion)[0] for one in others),
    }
    for name, motion in motions.items()
}
table = pd.DataFrame(rows).T.round(4)
assert table.loc["best", "duration [s]"] < 0.7 * table.loc["plain", "duration [s]"]
assert table.loc["best", "left [mm]"] < 0.02 * table.loc["plain", "left [mm]"]
table

# %%
# Side by side, ten times as slow: plain on the left, best on the right.
solutions = {
    name: flexinv.solve(arm, motions[name], STEP, end=0.3)
    for name in ("plain", "ZV", "best")
}


class Beside:
    def _repr_html_(self):
        pictures = [
            solutions[name].animate(seconds=3.0)._repr_html_()
            for name in ("plain", "best")
        ]
        return f'<div style="display:flex;gap:8px">{"".join(pictures)}</div>'


Beside()

# %%
# A shaper made for one frequency stands a wrong one better than the shortest motion, which is made for this arm alone. A list
# of mechanisms in place of one makes a motion for all of them (see the page on the shortest motion).
figure, (torques, tips) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
for name, solution in solutions.items():
    torques.plot(1e3 * solution.time, solution.torque[:, 0], label=name)
    tips.plot(
        1e3 * solution.time, 1e3 * solution.deflection[link.name][:, 1], label=name
    )
torques.set(xlabel="time [ms]", ylabel="torque of the hub [N m]")
tips.set(xlabel="time [ms]", ylabel="tip beside the straight strip [mm]")
torques.legend(fontsize="small")
