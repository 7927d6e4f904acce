"""simulate: torques become a motion, by the same model and the same march with every joint free."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.evaluation import evaluate
from flexinv.analysis.flexible_loops import evaluated
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import MOST_SAMPLES
from flexinv.analysis.switching import Switching
from flexinv.analysis.trajectory import SAME_TIME, Progress, flexible_motion
from flexinv.constraints.closures import constraint_rows
from flexinv.constraints.loop_starts import FAR, SAGGED, Stated, begin, check_settled, stated_of
from flexinv.constraints.phases import acting, phases
from flexinv.dynamics.generalized_alpha import generalized_alpha
from flexinv.dynamics.solver import Efforts
from flexinv.errors import InputError
from flexinv.inverse.applied_forces import applied_forces
from flexinv.kinematics.joint_motion import JointHistory
from flexinv.kinematics.mesh import build
from flexinv.kinematics.unactuated import fill_passive
from flexinv.model.initial_values import start_coordinates
from flexinv.model.joint_kinds import KINDS, POSE
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import floats, function, number, of_kind, shown


def simulate(
    mechanism: Mechanism,
    time: ArrayLike,
    torque: ArrayLike,
    step: float,
    spectral_radius: float = 0.8,
    initial: str = "consistent",
    start: Mapping[str, ArrayLike] | None = None,
    start_rate: Mapping[str, ArrayLike] | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Return the motion that torques of the drives give a mechanism, rigid, flexible or mixed, open or closed.

    M a + f_elastic + f_velocity - m g = S tau(t), from ``time[0]`` to ``time[-1]``: `solve` with nothing prescribed, so that
    ``simulate`` with the torque of `solve` gives its motion back, up to the time error of both (second order).

    time : (n,) [s], increasing; torque : (n, actuated) [N m], [N], columns as in ``Solution.torque_names``, linear between; a
        time given twice is a jump: the first of the two rows ends what is before it, the second begins what follows
    step : time step and spacing of the samples [s]; spectral_radius, initial : as in `solve` ("static": in equilibrium with the
        driven joints held where they start)
    start, start_rate : initial coordinates and rates of joints [rad], [m], [1/s], zero unless given; in loops what is given is
        kept, up to a hundredth (rad, of the length, of the largest rate), and the other joints are moved onto the closures
    progress : called with the number of samples done since its last call

    Raises InputError for input that cannot be, a drive of a free joint or a start that closures contradict among it,
    ConvergenceError (time, increment, advice) if Newton fails.
    """
    of_kind("mechanism", mechanism, Mechanism)
    if not isinstance(initial, str) or initial not in ("consistent", "static"):
        raise InputError(
            f"simulate: initial = {shown(initial)}, expected 'consistent' (starts undeformed) or 'static' (in equilibrium)"
        )
    function("progress", progress, "a function of the number of samples done since its last call")
    step = number("step", step, "a positive number of seconds, for example step=1e-3")
    radius = number("spectral_radius", spectral_radius, "0 (strong) to 1 (no numerical damping), for example 0.8")
    table = _table(mechanism, time, torque)
    moves = {j.name for j in mechanism.joints if j.nv}
    count = round((table[0][-1] - table[0][0]) / step) if step > 0 else 0
    scheme = generalized_alpha(step, radius)
    if count < 1:
        raise InputError(
            f"step = {step:g} s is longer than the torque's {table[0][-1] - table[0][0]:g} s: write a smaller step"
        )
    if count > MOST_SAMPLES:
        raise InputError(f"step = {step:g} s gives {count} samples, more than {MOST_SAMPLES}: write a larger step")
    grid = table[0][0] + step * np.arange(count + 1)
    settings: dict[str, float | int | str | bool] = {
        "step": step, "spectral_radius": radius, "initial": initial, "incremental": False,
    }  # fmt: skip
    mesh = build(mechanism)
    settles = bool(mechanism.closures) and initial == "static" and not mechanism.is_rigid
    stated = _stated(mechanism, start_coordinates(mechanism, moves, start, start_rate), settles)
    began = stated.q, stated.qd, stated.qdd
    if mechanism.closures:
        began = begin(mesh, stated, constraint_rows(mesh).of(acting(mechanism, float(grid[0]))), float(grid[0]))
    history = _standing(began)
    efforts = _efforts(mechanism, table, step)
    switching = Switching(phases(mechanism, grid)) if mechanism.closures else None
    trajectory = flexible_motion(
        mesh,
        history,
        history,
        grid,
        scheme,
        moves,
        tuple(_jumps(table[0])),
        initial,
        progress,
        switching,
        efforts=efforts,
    )
    q, qd, qdd = history(grid)
    if switching is not None:
        solution = evaluated(mesh, trajectory, grid, (q, qd, qdd), moves, settings, switching)
        if settles:
            check_settled(mesh, stated, *began[:2], solution.q[0], solution.qd[0], float(grid[0]))
        return solution
    fill_passive(mesh, trajectory.motion, moves, q, qd, qdd)
    applied = applied_forces(mesh, trajectory.motion, grid)
    return evaluate(mesh, trajectory, grid, q, qd, qdd, moves, settings, applied)


def _table(mechanism: Mechanism, time: ArrayLike, torque: ArrayLike) -> tuple[Array, Array]:
    at, values = floats("simulate: time", time), floats("simulate: torque", torque)
    names = [n for n, driven in zip(mechanism.velocity_names, mechanism.actuated, strict=True) if driven]
    if at.ndim != 1 or len(at) < 2 or not np.isfinite(at).all() or not _in_order(at):
        raise InputError(
            f"simulate: time has shape {at.shape}, expected two or more times that increase [s]; between the first and the last "
            "a time may be given twice, where the torque jumps"
        )
    if values.shape != (len(at), len(names)) or not np.isfinite(values).all():
        raise InputError(
            f"simulate: torque has shape {values.shape}, expected finite numbers ({len(at)}, {len(names)}), a row for each time "
            f"and a column for each drive of '{mechanism.name}': {', '.join(names) or 'none'}"
        )
    for joint in mechanism.joints:
        if KINDS[joint.kind].layout == POSE and joint.actuated:
            raise InputError(
                f"simulate: free joint '{joint.name}' of '{mechanism.name}' has a drive, whose force would turn with what it "
                "moves; write actuated=False and a force with follower=True on its link"
            )
    return at, values


def _in_order(time: Array) -> bool:
    gaps = np.diff(time)
    return bool((gaps >= 0).all() and gaps[0] > 0 and gaps[-1] > 0 and (time[2:] > time[:-2]).all())


def _jumps(time: Array) -> Array:
    """Times that are given twice."""
    return np.asarray(time[1:][np.diff(time) == 0.0])


def _efforts(mechanism: Mechanism, table: tuple[Array, Array], step: float) -> Efforts:
    time, torque = table
    jumps = np.append(_jumps(time), np.inf)

    def efforts(at: Array, before: bool) -> Array:
        after = np.minimum(np.searchsorted(jumps, at - SAME_TIME * step), len(jumps) - 1)
        met = np.where(np.abs(jumps[after] - at) < SAME_TIME * step, jumps[after], at)
        out = np.zeros((len(at), mechanism.nv))
        # of two rows at one time np.interp takes the second, seen backwards the first
        line = (-met[::-1], -time[::-1], torque[::-1]) if before else (met, time, torque)
        found = [np.interp(line[0], line[1], column) for column in line[2].T]
        out[:, mechanism.actuated] = np.reshape(found, (-1, len(at))).T[:: -1 if before else 1]
        return out

    return efforts


def _stated(mechanism: Mechanism, given: tuple[dict[str, Array], dict[str, Array]], settles: bool) -> Stated:
    """Return the known values of the start.

    settles : passive joints may be stated where beams are bent, and the loops are closed unbent first
    """
    m, (places, rates) = mechanism, given
    q, qd = m.neutral, np.zeros(m.nv)
    for name, value in places.items():
        q[m.q_slices[name]] = value
    for name, value in rates.items():
        qd[m.v_slices[name]] = value
    passive = stated_of(m, {j.name for j in m.joints if not j.actuated})
    bars = {"place": FAR, "rate": SAGGED} if settles else {}
    return Stated(q, qd, np.zeros(m.nv), stated_of(m, places), stated_of(m, rates), passive, **bars)


def _standing(state: tuple[Array, Array, Array]) -> JointHistory:
    """A state of the joints (q, qd, qdd) at all times."""

    def still(time: Array) -> tuple[Array, Array, Array]:
        return np.tile(state[0], (len(time), 1)), np.tile(state[1], (len(time), 1)), np.tile(state[2], (len(time), 1))

    return still
