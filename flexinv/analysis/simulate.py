"""simulate: torques become a motion, by the same model and the same march with every joint free."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.evaluation import solution_after
from flexinv.analysis.settings import checked
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import MOST_SAMPLES, Progress, Task, still
from flexinv.analysis.trajectory import SAME_TIME, first_step
from flexinv.constraints.closures import constraint_rows
from flexinv.constraints.loop_starts import FAR, SAGGED, Stated, begin, check_settled, stated_of
from flexinv.constraints.phases import acting
from flexinv.dynamics.generalized_alpha import EXACT
from flexinv.dynamics.solver import Efforts
from flexinv.errors import InputError
from flexinv.kinematics.mesh import build
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
    table = _table(mechanism, time, torque)
    moves = {j.name for j in mechanism.joints if j.nv}
    count = round((table[0][-1] - table[0][0]) / step) if step > 0 else 0
    settings = checked(step, spectral_radius, EXACT, initial)
    if count < 1:
        raise InputError(
            f"step = {step:g} s is longer than the torque's {table[0][-1] - table[0][0]:g} s: write a smaller step"
        )
    if count > MOST_SAMPLES:
        raise InputError(f"step = {step:g} s gives {count} samples, more than {MOST_SAMPLES}: write a larger step")
    grid = table[0][0] + step * np.arange(count + 1)
    mesh = build(mechanism)
    settles = bool(mechanism.closures) and initial == "static" and not mechanism.is_rigid
    stated = _stated(mechanism, start_coordinates(mechanism, moves, start, start_rate), settles)
    began = stated.q, stated.qd, stated.qdd
    if mechanism.closures:
        began = begin(mesh, stated, constraint_rows(mesh).of(acting(mechanism, float(grid[0]))), float(grid[0]))
    history, efforts, jumps = still(*began), _efforts(mechanism, table, step), tuple(_jumps(table[0]))
    task = Task(mesh, grid, history, history, moves, settings, jumps, efforts=efforts, progress=progress)
    (first,) = first_step(task)
    solution = solution_after(mesh, first, settings)
    if settles:
        check_settled(mesh, stated, *began[:2], solution.q[0], solution.qd[0], float(grid[0]))
    return solution


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
