"""find_limits: where joints reach the limits of their drives, at samples and between them, and what was looked at.

What a motion prescribes is a function of time whose extreme values are polynomial roots (`smooth_pieces`); so are the joints that
closures move, and the efforts of rigid mechanisms, as all of them can be computed at any instant.  What is marched (efforts where
links bend, joints that are free) is known at the steps: joints move between them on the quintics through their places, rates and
accelerations, efforts are looked at there alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexinv.analysis.evaluation import add_joint_efforts, run_second_step
from flexinv.analysis.solution import Solution
from flexinv.analysis.task import Settings, Task, build_joint_histories
from flexinv.analysis.trajectory import run_first_step
from flexinv.errors import InputError
from flexinv.kernels.smooth_pieces import Pieces, fit_pieces, join_samples
from flexinv.kinematics.nodal_motion import collect_scalar_places, compute_nearest_difference
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array, Mask
from flexinv.validation import check_kind

EXACTLY = "between samples, exactly"
WITHIN_STEPS = "between samples, within a step"
AT_STEPS = "at samples"
# Of a limit: values that are smaller are measured against this much of it, as rounding of nothing has no size.
SMALL_VALUE = 1e-6
# How far the solution's joints may be from the motion [rad], of the mechanism's length: what rounding leaves.
SAME_MOTION = 1e-9
LIMITED = ("lower", "upper", "velocity", "effort")
# By quantity: the signs with which values are held against the limit.
LIMIT_SIDES = {"lower": (-1.0,), "upper": (1.0,), "velocity": (1.0, -1.0), "effort": (1.0, -1.0)}


@dataclass(frozen=True)
class LimitUse:
    """Use of a limit of a joint by one of its coordinates.

    coordinate : its name; quantity : "lower", "upper" (position), "velocity" or "effort"; limit : [rad], [m], [1/s], [N m], [N]
    peak : the value that comes nearest to the limit or passes it furthest, of velocity and effort without its sign; at : when [s]
    reached : the first time at which the limit is reached, touched or passed [s], None if it never is
    passed : whether the peak lies beyond the limit, by more than rounding
    looked : where it was looked at: "between samples, exactly", "between samples, within a step" or "at samples"
    """

    coordinate: str
    quantity: str
    limit: float
    peak: float
    at: float
    reached: float | None
    passed: bool
    looked: str

    def __str__(self) -> str:
        """Return one line that says what was found."""
        verb = "passes" if self.passed else "reaches" if self.reached is not None else "keeps"
        when = "" if self.reached is None else f" at t = {self.reached:.10g} s"
        peak = f"peak {self.peak:.6g} at t = {self.at:.10g} s"
        return (
            f"{self.coordinate} {verb} its limit {self.quantity} = {self.limit:g}{when} ({peak}; looked {self.looked})"
        )


@dataclass(frozen=True)
class _LimitQuery:
    """A limit of a velocity coordinate, by its number."""

    column: int
    quantity: str
    limit: float

    @property
    def level(self) -> float:
        return -self.limit if self.quantity == "lower" else self.limit

    @property
    def size(self) -> float:
        return SMALL_VALUE * abs(self.limit)

    def take_columns(self, parts: dict[str, Array]) -> Array:
        """Columns (samples, signs) that are held against the level."""
        values = parts["upper" if self.quantity == "lower" else self.quantity][:, self.column]
        return np.asarray(values[:, None] * np.array(LIMIT_SIDES[self.quantity]))


def find_limits(solution: Solution, motion: Motion | None = None) -> tuple[LimitUse, ...]:
    """Return the use of each stated limit of every joint, at samples and between them [rad], [m], [1/s], [N m], [N].

    motion : of the joints, as `solve` took it.  With it instants are exact to 1e-9 s where positions and rates are prescribed or
        follow from closures, and where efforts are those of rigid links; else joints are looked at on the quintics through the
        samples, efforts at samples alone.  Each answer says which of these it is.
    A level that is only touched is reached, too.  Raises InputError where the motion is not the one of the solution.
    """
    check_kind("solution", solution, Solution)
    if motion is not None:
        check_kind("motion", motion, Motion, ("evaluate", "joints", "jumps", "duration"))
    m = solution.mechanism
    asked = _list_queries(m)
    if not asked or len(solution.time) < 2:
        return ()
    exact = np.zeros((len(LIMITED), m.nv), dtype=bool)
    if motion is not None:
        exact = _find_prescribed_columns(solution, motion)
    groups = {EXACTLY: list[_LimitQuery](), WITHIN_STEPS: list[_LimitQuery](), AT_STEPS: list[_LimitQuery]()}
    for one in asked:
        is_exact = bool(exact[LIMITED.index(one.quantity), one.column])
        groups[EXACTLY if is_exact else AT_STEPS if one.quantity == "effort" else WITHIN_STEPS].append(one)
    found: dict[_LimitQuery, LimitUse] = {}
    if motion is not None and groups[EXACTLY]:
        found |= _check_exact_limits(solution, motion, groups[EXACTLY])
    found |= _check_interpolated_limits(solution, groups[WITHIN_STEPS])
    for one in groups[AT_STEPS]:
        values = one.take_columns(_collect_quantities(m, solution.q, solution.qd, solution.torque_all))
        found[one] = _check_sampled_limit(m, one, solution.time, values)
    return tuple(found[one] for one in asked)


def _list_queries(mechanism: Mechanism) -> list[_LimitQuery]:
    """The limits that are stated, by velocity coordinate; places of a joint with several are not limited."""
    return [
        _LimitQuery(column, name, float(getattr(joint.limits, name)))
        for column, joint in enumerate(_list_column_joints(mechanism))
        for name in LIMITED
        if np.isfinite(getattr(joint.limits, name)) and (KINDS[joint.kind].scalar or name in ("velocity", "effort"))
    ]


def _list_column_joints(mechanism: Mechanism) -> list[Joint]:
    return [joint for joint in mechanism.joints for _ in range(joint.nv)]


def _find_prescribed_columns(solution: Solution, motion: Motion) -> Mask:
    """Mask (4, nv) of the quantities that are functions of time, to be evaluated at any instant.

    Raises InputError where the motion is not that of the solution.
    """
    m = solution.mechanism
    given = set(motion.joints(solution.mechanism))
    ends = solution.time[[0, -1]]
    q = motion.evaluate(m, ends, "right")[0]
    prescribed = np.array([joint.name in given for joint in _list_column_joints(m)], dtype=bool)
    for k, found in enumerate(solution.q[[0, -1]]):
        off = np.where(prescribed, np.abs(compute_nearest_difference(m, found, q[k])), 0.0)
        if off.max(initial=0.0) > SAME_MOTION * max(1.0, solution.mesh.length):
            name = m.velocity_names[int(np.argmax(off))]
            raise InputError(
                f"find_limits: at t = {ends[k]:g} s joint {name!r} of the solution is {off.max():.3g} away from the motion; give "
                "the motion that the solution was made from"
            )
    whole = m.is_rigid and (bool(m.closures) or bool(prescribed.all()))
    exact = np.tile(prescribed | whole, (len(LIMITED), 1))
    exact[LIMITED.index("effort")] = whole
    return exact


def _collect_quantities(mechanism: Mechanism, q: Array, qd: Array, tau: Array) -> dict[str, Array]:
    """Positions (samples, nv), nan of joints that have none, rates and efforts, by quantity."""
    return {"upper": collect_scalar_places(mechanism, q), "velocity": qd, "effort": tau}


def _check_exact_limits(solution: Solution, motion: Motion, queries: list[_LimitQuery]) -> dict[_LimitQuery, LimitUse]:
    """Limits of what can be evaluated at any instant."""
    m = solution.mechanism
    time = solution.time
    efforts = any(one.quantity == "effort" for one in queries) or bool(m.closures)
    evaluate = _make_evaluation(solution, motion, efforts)
    marks = {
        *getattr(motion, "knots", motion.jumps),
        *(t for closure in m.closures for span in closure.active for t in span),
    }
    inside = [t for t in marks if time[0] < t < time[-1]]
    if type(motion) is not Motion:  # nothing is known of where it is smooth
        inside += time.tolist()

    def evaluate_columns(times: Array) -> Array:
        parts = evaluate(times)
        return np.hstack([one.take_columns(parts) for one in queries])

    sizes = [one.size for one in queries for _ in LIMIT_SIDES[one.quantity]]
    pieces = fit_pieces(evaluate_columns, [time[0], *inside, time[-1]], sizes)
    return _compare_with_limits(m, pieces, queries, EXACTLY)


def _make_evaluation(solution: Solution, motion: Motion, efforts: bool) -> Callable[[Array], dict[str, Array]]:
    """Times (n,) [s] -> positions, rates and, where wanted, efforts there, (n, nv) each."""
    m = solution.mechanism
    mesh = solution.mesh
    given = motion.joints(solution.mechanism)
    passive = set(m.moving_names) - set(given)
    places = {name: solution.q[0, m.q_slices[name]] for name in passive}
    settings = Settings(float(solution.settings["step"]))

    def evaluate(times: Array) -> dict[str, Array]:
        if not efforts:
            q, qd, _ = motion.evaluate(m, times)
            return _collect_quantities(m, q, qd, np.full_like(qd, np.nan))
        at = np.union1d(solution.time, times)  # closures are followed from the start, and may switch at samples alone
        before, after = build_joint_histories(motion, m, (places, {}), settings, at)
        (first,) = run_first_step(Task(mesh, at, before, after, passive, settings, motion.jumps))
        second = run_second_step(mesh, first)
        tau, _ = add_joint_efforts(m, first, second.tau, second.reaction)
        q, qd, _ = first.joints
        parts = _collect_quantities(m, q, qd, tau)
        rows = np.searchsorted(at, times)
        return {name: part[rows] for name, part in parts.items()}

    return evaluate


def _check_interpolated_limits(solution: Solution, queries: list[_LimitQuery]) -> dict[_LimitQuery, LimitUse]:
    """Limits of joints that move on quintics between samples."""
    if not queries:
        return {}
    m = solution.mechanism
    time = solution.time
    parts = _collect_quantities(m, solution.q, solution.qd, solution.torque_all)
    places = np.nan_to_num(parts["upper"])
    position = join_samples(time, [places, solution.qd, solution.qdd])
    rate = join_samples(time, [solution.qd, solution.qdd])
    result: dict[_LimitQuery, LimitUse] = {}
    for one in queries:
        source = rate if one.quantity == "velocity" else position
        signs = np.array(LIMIT_SIDES[one.quantity])
        coefficients = source.coefficients[:, :, [one.column]] * signs
        scale = np.repeat(source.scale[one.column], len(signs))
        result |= _compare_with_limits(m, Pieces(source.begin, source.end, coefficients, scale), [one], WITHIN_STEPS)
    return result


def _compare_with_limits(
    mechanism: Mechanism, pieces: Pieces, queries: list[_LimitQuery], looked: str
) -> dict[_LimitQuery, LimitUse]:
    """Each limit against its columns of the pieces, which stand in the order of ``queries``."""
    limits: dict[_LimitQuery, LimitUse] = {}
    first = 0
    for one in queries:
        sides = range(first, first + len(LIMIT_SIDES[one.quantity]))
        first = sides.stop
        peak, at = max((pieces.find_largest(column) for column in sides), key=lambda pair: pair[0])
        reached = [time for column in sides if (time := pieces.find_crossing(column, one.level)) is not None]
        passed = any(pieces.has_value_above(column, one.level) for column in sides)
        limits[one] = _make_limit_use(mechanism, one, peak, at, (min(reached, default=None), passed), looked)
    return limits


def _check_sampled_limit(mechanism: Mechanism, one: _LimitQuery, time: Array, values: Array) -> LimitUse:
    """A limit against values (samples, signs) at samples alone."""
    largest = values.max(axis=1)
    over = np.flatnonzero(largest >= one.level)
    at = int(np.argmax(largest))
    reached = float(time[over[0]]) if len(over) else None
    peak = float(largest[at])
    return _make_limit_use(mechanism, one, peak, float(time[at]), (reached, peak > one.level), AT_STEPS)


def _make_limit_use(
    mechanism: Mechanism, one: _LimitQuery, peak: float, at: float, reached: tuple[float | None, bool], looked: str
) -> LimitUse:
    value = -peak if one.quantity == "lower" else peak
    return LimitUse(mechanism.velocity_names[one.column], one.quantity, one.limit, value, at, *reached, looked)
