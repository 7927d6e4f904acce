"""Figure of a motion that was found beside the given one: joints, torques with their limits, and what swings on afterwards."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexinv.analysis.solution import Solution, list_effort_units
from flexinv.analysis.solve import solve
from flexinv.display.figures import Band, Panel, draw_panels
from flexinv.linearized.residual_vibration import compute_rest_places
from flexinv.model.motion import Motion
from flexinv.optimal_motion.motion_problem import EQUILIBRIUM, find_last_move
from flexinv.typing import Array

if TYPE_CHECKING:
    from flexinv.display.figures import Figure
    from flexinv.optimal_motion.optimized_motion import OptimizedMotion

SHOWN_LONGER = 2.0  # times the longer of both motions: what swings on is seen
DRAWN_STEPS = 800


def draw_optimized_motion(found: OptimizedMotion) -> Figure:
    """Return a matplotlib Figure of the first mechanism: joints [rad], [m], torques [N m], [N], distance of a tip from rest [m].

    Both motions are solved on beyond their ends.  Raises ConvergenceError where one cannot be marched as far.
    """
    mechanism = found.mechanisms[0]
    end = SHOWN_LONGER * max(find_last_move(found.given), found.duration)
    given, best = (_solve_on(found, motion, end) for motion in (found.given, found.motion))
    time = given.time
    panels = []
    for joint, unit in _list_moved(given):
        column = mechanism.velocity_names.index(joint)
        panels.append(
            Panel(f"{joint} [{unit}]", time, [Band("given", given.q[:, column]), Band("found", best.q[:, column])])
        )
    limits = found.limits.efforts
    for number, name in enumerate(given.torque_names):
        bands = [Band("given", given.torque[:, number]), Band("found", best.torque[:, number])]
        if name in limits:
            edge = np.full(len(time), limits[name])
            bands += [Band("limit", edge), Band("limit in the other direction", -edge)]
        unit = list_effort_units(mechanism)[mechanism.velocity_names.index(name)]
        panels.append(Panel(f"effort {name} [{unit}]", time, bands))
    if not mechanism.is_rigid:
        link = mechanism.joints[-1].child
        distances = [Band(word, _compute_distance(one, link)) for word, one in (("given", given), ("found", best))]
        panels.append(Panel(f"{link}: tip from rest [m]", time, distances))
    return draw_panels(panels, f"{mechanism.name}: {find_last_move(found.given):.4g} s, {found.duration:.4g} s")


def _solve_on(found: OptimizedMotion, motion: Motion, end: float) -> Solution:
    step = end / DRAWN_STEPS
    return solve(found.mechanisms[0], motion, step=step, end=end, initial=EQUILIBRIUM)


def _list_moved(solution: Solution) -> list[tuple[str, str]]:
    """Joints that move and their units."""
    mechanism = solution.mechanism
    moved = np.ptp(solution.q, axis=0) > 0.0
    return [
        (joint.name, "m" if joint.kind == "prismatic" else "rad")
        for joint in mechanism.joints
        if joint.nv == 1 and moved[mechanism.q_slices[joint.name]].any()
    ]


def _compute_distance(solution: Solution, link: str) -> Array:
    """Distance of a link's tip from where it comes to rest (samples,) [m]."""
    rest = compute_rest_places(solution.find_residual_vibration().modes)
    return np.asarray(np.linalg.norm(solution.tip[link] - rest[link], axis=1))
