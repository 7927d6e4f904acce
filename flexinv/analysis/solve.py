"""solve: a task becomes a flexible trajectory, nodal forces and joint torques; the whole scheme in one call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import maximum_filter1d

from flexinv.analysis.evaluation import evaluate, rigid_trajectory
from flexinv.analysis.flexible_loops import flexible_closed_solution
from flexinv.analysis.rigid_loops import closed_solution
from flexinv.analysis.solution import Solution
from flexinv.analysis.trajectory import Progress, flexible_motion
from flexinv.constraints.loop_starts import ROUNDED, SAGGED, check_branch, check_rates, picked_start, stated_of
from flexinv.dynamics.generalized_alpha import EXACT, generalized_alpha
from flexinv.errors import InputError
from flexinv.inverse.applied_forces import applied_forces
from flexinv.kinematics.finite_differences import check_samples
from flexinv.kinematics.joint_motion import JointHistory
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.rigid_motion import rigid_motion
from flexinv.kinematics.unactuated import fill_passive
from flexinv.model.initial_values import start_coordinates
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion, motion_table
from flexinv.typing import Array
from flexinv.validation import choice, flag, function, number, of_kind, whole

# A sampling grid longer than this is a mistake in `step` far more often than a wish.
MOST_SAMPLES = 5_000_000


def solve(
    mechanism: Mechanism,
    motion: Motion,
    step: float,
    error: bool = False,
    end: float | None = None,
    spectral_radius: float = 0.8,
    initial: str = "consistent",
    incremental: bool = False,
    start: Mapping[str, ArrayLike] | None = None,
    start_rate: Mapping[str, ArrayLike] | None = None,
    progress: Progress | None = None,
    every: int = 1,
    tolerance: float = EXACT,
) -> Solution:
    """Return the torques that make a mechanism, rigid, flexible or mixed, follow a motion of its joints.

    Two steps, one program:  task -> flexible trajectory (M, C, K act) -> P = M (a - g) -> tau = L T P.

    step : time step and spacing of the samples [s]; end : last time [s], the motion's duration by default
    error : also march with half the step and on a refined mesh: ``torque_error``, ``tip_error``
    spectral_radius : numerical damping of the march, 0 strong, 1 none [-]
    initial : "consistent" (starts undeformed) or "static" (starts in equilibrium under gravity)
    incremental : the paper's incremental mode, accelerations from differences of nodal positions (`finite_differences`)
    start, start_rate : initial coordinates and rates of passive joints (unactuated, not in the motion) [rad], [m], [1/s]
    progress : called with the number of steps done since its last call
    every : of so many steps one is kept in the solution [-], from the start on: a long march at a small step fits in memory
        (turns of passive joints are counted, and work is summed, over the samples that are kept)
    tolerance : what Newton may leave of positions, over the mechanism's length [-]; by default less than rounding.  1e-9 saves a
        third of the time of a beam in a plane; accelerations are then known to some tolerance x length / step^2 at worst

    Raises InputError for input that cannot be, ConvergenceError (time, increment, advice) if Newton fails.
    """
    every = check_asked(mechanism, motion, initial, every, progress)
    error, incremental = flag("error", error), flag("incremental", incremental)
    steps = time_grid(motion, step, end, every)
    _check_every(mechanism, every, incremental)
    time = steps if every == 1 else steps[::every]
    if incremental:
        check_samples(len(time), step)
    settings = settings_of(step, spectral_radius, tolerance, initial, incremental)
    given = set(motion.joints(mechanism))
    passive = {joint.name for joint in mechanism.joints if joint.nv and joint.name not in given}
    history, right = joint_histories(mechanism, motion, passive, start, start_rate, float(step), time)
    mesh, told, names = build(mechanism), right(time[:1]), set(start or ())
    if mechanism.closures and start and passive:
        start = _on_branch(mesh, right, float(time[0]), passive, start)
        history, right = joint_histories(mechanism, motion, passive, start, start_rate, float(step), time)
    scheme = generalized_alpha(float(step), spectral_radius, float(tolerance))
    if every == 1 and not motion.jumps and not (mechanism.closures and mechanism.is_rigid):
        history = right = _looked_up(time, right)
    if mechanism.closures and mechanism.is_rigid:
        solution = closed_solution(mesh, right, time, passive, settings)
    elif mechanism.closures:
        solution = flexible_closed_solution(
            mesh, history, right, time, scheme, passive, settings, motion.jumps, progress, start_rate or ()
        )
    else:
        q, qd, qdd = (part.copy() for part in right(time))
        if mechanism.is_rigid and not passive:
            nodes = rigid_motion(mesh, q, qd, qdd)
            applied = applied_forces(mesh, nodes, time)
            trajectory = rigid_trajectory(mesh, nodes, applied)
        else:
            trajectory = flexible_motion(
                mesh, history, right, steps, scheme, passive, motion.jumps, initial, progress, every=every
            )
            applied = applied_forces(mesh, trajectory.motion, time)
            fill_passive(mesh, trajectory.motion, passive, q, qd, qdd)
        solution = evaluate(mesh, trajectory, time, q, qd, qdd, passive, settings, applied)
    if mechanism.closures and (start or start_rate):
        _check_start(mesh, names, set(start_rate or ()), told, solution)
    if not error:
        return solution
    options = {
        "end": end, "spectral_radius": spectral_radius, "initial": initial, "start": start, "start_rate": start_rate,
        "tolerance": tolerance,
    }  # fmt: skip
    return _with_error(solution, mechanism, motion, step, incremental, every, progress, options)


def _on_branch(
    mesh: Mesh, history: JointHistory, time: float, passive: set[str], start: Mapping[str, ArrayLike]
) -> Mapping[str, ArrayLike]:
    """The start from which the loops close where it says, or nearest to that."""
    m = mesh.mechanism
    q = picked_start(mesh, history, time, stated_of(m, passive), stated_of(m, start))
    return start if q is None else {name: q[m.q_slices[name]] for name in passive}


def _check_start(
    mesh: Mesh, places: set[str], rates: set[str], told: tuple[Array, Array, Array], solution: Solution
) -> None:
    """Raise an error where closures contradict what was told of the first instant."""
    check_branch(mesh, places, told[0][0], solution.q[0])
    settled = solution.settings["initial"] == "static" and not mesh.mechanism.is_rigid
    stated = stated_of(mesh.mechanism, rates)
    check_rates(mesh, stated, told[1][0], solution.qd[0], float(solution.time[0]), SAGGED if settled else ROUNDED)


INITIAL = {"consistent": "starts undeformed", "static": "in equilibrium"}


def check_asked(mechanism: Mechanism, motion: Motion, initial: str, every: int, progress: Progress | None) -> int:
    """Return ``every`` [-]; raises InputError for a mechanism, a motion, a start or a progress that is none."""
    of_kind("mechanism", mechanism, Mechanism)
    of_kind("motion", motion, Motion, ("evaluate", "joints", "jumps", "duration"))
    choice("initial", initial, INITIAL)
    function("progress", progress, "a function of the number of steps done since its last call")
    return whole("every", every, 1, "1 to keep all steps, or more to keep one of so many")


def _check_every(mechanism: Mechanism, every: int, incremental: bool) -> None:
    if every > 1 and incremental:
        raise InputError(f"every = {every}: the incremental mode takes differences from step to step; write every=1")
    if every > 1 and mechanism.closures and not mechanism.is_rigid:
        raise InputError(
            f"every = {every}: mechanism '{mechanism.name}' has closures and beams, of which every step is kept; write every=1"
        )


def settings_of(
    step: float, spectral_radius: float, tolerance: float, initial: str = "consistent", incremental: bool = False
) -> dict[str, float | int | str | bool]:
    """Return the settings of the solver that a Solution records; step [s]."""
    radius = number("spectral_radius", spectral_radius, "0 (strong) to 1 (no numerical damping), for example 0.8")
    left = number("tolerance", tolerance, "a part of the mechanism's length, for example 1e-9")
    return {
        "step": float(step), "spectral_radius": radius, "initial": initial, "incremental": incremental, "tolerance": left,
    }  # fmt: skip


def time_grid(motion: Motion, step: float, end: float | None, every: int) -> Array:
    """Return the times of all steps, the start included (steps + 1,) [s]; raises InputError for a step or end that cannot be."""
    step = number("step", step, "a positive number of seconds, for example step=1e-3")
    last = motion.duration if end is None else number("end", end, "a positive time, or None for the motion's duration")
    if not (np.isfinite(step) and step > 0.0):
        raise InputError(f"step = {step} s: expected a positive number of seconds, for example step=1e-3")
    if not (np.isfinite(last) and last > 0.0):
        raise InputError(f"end = {last} s: expected a positive time, or None for the motion's duration")
    if step > last:
        raise InputError(
            f"step = {step:g} s is longer than the motion ({last:g} s): write a smaller step, say {last / 200:g}"
        )
    count = int(np.floor(last / step * (1 + 1e-9)))  # the last sample is the end when step divides it, up to rounding
    if count >= MOST_SAMPLES * max(every, 1):
        raise InputError(
            f"step = {step:g} s gives {count} samples in {last:g} s, more than {MOST_SAMPLES * max(every, 1)}: "
            "write a larger step, or every=10 to keep one step of ten"
        )
    return np.asarray(step * np.arange(count + 1))


def joint_histories(
    mechanism: Mechanism,
    motion: Motion,
    passive: set[str],
    start: Mapping[str, ArrayLike] | None,
    rate: Mapping[str, ArrayLike] | None,
    step: float,
    grid: Array,
) -> tuple[JointHistory, JointHistory]:
    """Return joint motion [rad or m, s] with the passive joints at their start: left-hand limits at jumps, and right-hand ones.

    grid : the times of which a table may be kept, an empty one for none
    """
    places, rates = start_coordinates(mechanism, passive, start, rate)

    def joint_motion(time: Array, side: str) -> tuple[Array, Array, Array]:
        if time is grid and side == "right" and len(grid) > 1 and grid[1] == step:
            q, qd, qdd = (part.copy() for part in motion_table(motion, mechanism, step, len(grid)))
        else:
            q, qd, qdd = motion.evaluate(mechanism, time, side)  # type: ignore[arg-type]
        for name, value in places.items():
            q[:, mechanism.q_slices[name]] = value
        for name, value in rates.items():
            qd[:, mechanism.v_slices[name]] = value
        return q, qd, qdd

    return (lambda time: joint_motion(time, "left")), (lambda time: joint_motion(time, "right"))


def _looked_up(time: Array, history: JointHistory) -> JointHistory:
    """The same history at samples of a grid, taken from one evaluation."""
    table = history(time)
    for part in table:
        part.flags.writeable = False

    def samples(at: Array) -> tuple[Array, Array, Array]:
        first = int(np.searchsorted(time, at[0]))
        last = first + len(at)  # both are parts of one grid where their ends are
        if last > len(time) or time[first] != at[0] or time[last - 1] != at[-1]:
            return history(at)
        return table[0][first:last], table[1][first:last], table[2][first:last]

    return samples


# ------------------------------------------------------------------------------------------------- error bars


def _with_error(
    solution: Solution, mechanism: Mechanism, motion: Motion, step: float, incremental: bool, every: int,
    progress: Progress | None, options: Mapping[str, object],
) -> Solution:  # fmt: skip
    """Error bars from refinement: 4/3 |s_h - s_(h/2)| (second order in time) + |s - s on the refined mesh|."""
    twice = (
        1 if incremental or mechanism.closures else 2
    )  # of the half steps every second is compared, and all differenced
    half = solve(
        mechanism,
        motion,
        step / 2,
        incremental=incremental,
        progress=progress,
        every=twice * every,
        **options,  # type: ignore[arg-type]
    )
    bars = [scaled_difference(solution, half, 2 // twice, 4 / 3)]
    if not mechanism.is_rigid:
        for finer, factor in finer_meshes(mechanism):
            other = solve(finer, motion, step, incremental=incremental, progress=progress, every=every, **options)  # type: ignore[arg-type]
            bars.append(scaled_difference(solution, other, 1, factor))
    torque = np.asarray(sum(bar[0] for bar in bars))
    tip = {name: np.asarray(sum(bar[1][name] for bar in bars)) for name in solution.tip}
    return replace(solution, torque_error=torque, tip_error=tip)


def finer_meshes(mechanism: Mechanism) -> list[tuple[Mechanism, float]]:
    """Return refined meshes and the factor on the difference [-]: doubled for order 1 (second order), two orders higher else."""
    linear = max(link.beam.order for link in mechanism.beams if link.beam is not None) == 1
    return [(mechanism.refined(elements=2), 4 / 3)] if linear else [(mechanism.refined(order=2), 1.0)]


# Pointwise differences cross zero; a bar is their largest value within this part of the run on either side.
WINDOW = 0.02


def scaled_difference(
    solution: Solution, finer: Solution, stride: int, factor: float
) -> tuple[Array, dict[str, Array]]:
    """Return ``factor`` times the largest differences near each sample: of torque [N m], [N], and of every link's tip [m]."""
    width = 2 * int(np.ceil(WINDOW * len(solution.time))) + 1
    torque = np.abs(solution.torque - finer.torque[::stride][: len(solution.time)])
    tip = {k: np.linalg.norm(v - finer.tip[k][::stride][: len(v)], axis=1) for k, v in solution.tip.items()}
    return (
        factor * maximum_filter1d(torque, width, axis=0),
        {k: factor * maximum_filter1d(v, width) for k, v in tip.items()},
    )
