"""solve_in_parts: a march of any length in the memory of a part of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.evaluation import evaluate, rigid_trajectory
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import check_asked, joint_histories, settings_of, time_grid
from flexinv.analysis.trajectory import Progress, flexible_parts
from flexinv.dynamics.generalized_alpha import EXACT, generalized_alpha
from flexinv.dynamics.solver import Trajectory
from flexinv.errors import InputError
from flexinv.inverse.applied_forces import applied_forces
from flexinv.kinematics.joint_motion import JointHistory, scalar_coordinate
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.rigid_motion import rigid_motion
from flexinv.kinematics.unactuated import fill_passive
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array
from flexinv.validation import whole


def solve_in_parts(
    mechanism: Mechanism,
    motion: Motion,
    step: float,
    part: int = 10_000,
    end: float | None = None,
    spectral_radius: float = 0.8,
    initial: str = "consistent",
    start: Mapping[str, ArrayLike] | None = None,
    start_rate: Mapping[str, ArrayLike] | None = None,
    progress: Progress | None = None,
    every: int = 1,
    tolerance: float = EXACT,
) -> Iterator[Solution]:
    """Return the Solution of `solve` in consecutive parts, an iterator: a long one can go to disk while it is computed.

    part : kept samples [-] by which the parts advance; each begins with the sample [s] with which that before ended, and sums
        its work from there.  All else are arguments of `solve`, and the series are its own, up to rounding
    What is given is looked at by the call; a step is marched when its part is asked for, and its errors come with that part.

    Raises InputError as `solve` does, and for closures, which are solved as a whole; ConvergenceError.
    """
    every = check_asked(mechanism, motion, initial, every, progress)
    part = whole("part", part, 1, "the number of samples of a part, 1 or more")
    if mechanism.closures:
        raise InputError(
            f"solve_in_parts: mechanism '{mechanism.name}' has closures, whose motion is found as a whole; write flexinv.solve"
        )
    time, mesh = time_grid(motion, step, end, every), build(mechanism)
    passive = {joint.name for joint in mechanism.joints if joint.nv} - set(motion.joints(mechanism))
    before, after = joint_histories(mechanism, motion, passive, start, start_rate, step, np.empty(0))
    settings = settings_of(step, spectral_radius, tolerance, initial)
    scheme = generalized_alpha(float(step), spectral_radius, float(tolerance))
    rigid = mechanism.is_rigid and not passive
    trajectories = flexible_parts(
        mesh, before, after, time, scheme, passive, motion.jumps, initial, progress, every=every, part=part
    )
    return _parts(mesh, after, time[::every], part, passive, settings, None if rigid else trajectories)


def _parts(
    mesh: Mesh, after: JointHistory, kept: Array, part: int, passive: set[str], settings: dict[str, float | int | str | bool],
    trajectories: Iterator[Trajectory] | None,
) -> Iterator[Solution]:  # fmt: skip
    """Yield the solutions of the ``kept`` samples; without trajectories that of a rigid mechanism whose joints are all moved."""
    mechanism = mesh.mechanism
    last: Array | None = None
    wound: dict[str, float] = {}
    for first in range(0, max(len(kept) - 1, 1), part):
        own = kept[first : first + part + 1]
        q, qd, qdd = (a.copy() for a in after(own))
        if last is not None:
            _go_on(mechanism, passive, q, last)
        if trajectories is None:
            nodes = rigid_motion(mesh, q, qd, qdd)
            applied = applied_forces(mesh, nodes, own)
            trajectory: Trajectory = rigid_trajectory(mesh, nodes, applied)
        else:
            trajectory = next(trajectories)
            applied = applied_forces(mesh, trajectory.motion, own)
            fill_passive(mesh, trajectory.motion, passive, q, qd, qdd)
        yield _wind_on(evaluate(mesh, trajectory, own, q, qd, qdd, passive, settings, applied, part=True), wound)
        last = q[-1]


def _go_on(mechanism: Mechanism, passive: set[str], q: Array, last: Array) -> None:
    """Let passive joints begin where they ended: turns are counted from there."""
    for joint in mechanism.joints:
        if joint.name in passive:
            q[:, mechanism.q_slices[joint.name]] = last[mechanism.q_slices[joint.name]]


def _wind_on(solution: Solution, wound: dict[str, float]) -> Solution:
    """Let springs of joints that turn without end go on from the angles [rad] to which they were wound, and keep these."""
    mechanism = solution.mechanism
    more = np.zeros(mechanism.nv)
    for joint in mechanism.joints:
        if KINDS[joint.kind].circle and joint.stiffness:
            angle = scalar_coordinate(joint, solution.q[:, mechanism.q_slices[joint.name]])
            turns = 2 * np.pi * np.round((wound.get(joint.name, angle[0]) - angle[0]) / (2 * np.pi))
            wound[joint.name] = angle[-1] + turns
            more[mechanism.v_slices[joint.name].start] = joint.stiffness * turns
    return replace(solution, torque_all=solution.torque_all + more, reaction=solution.reaction + more)
