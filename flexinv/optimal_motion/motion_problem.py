"""Motion that is looked for, as a problem: what a choice of its rows and its duration does to torques, joints and vibration.

Every joint follows a spline of fifth degree through its rows at equal times, at rest at both ends; the first and the last row are
given, those between are what is chosen.  Values come with their slopes by these rows (`sensitivity.differentiate`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.analysis.task import Start
from flexinv.errors import InputError
from flexinv.linearized.residual_vibration import ResidualVibration, compute_reach_by_mode
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.optimal_motion.limited_results import LimitedResult, list_needed_results
from flexinv.optimal_motion.motion_limits import MotionLimits
from flexinv.sensitivity.differentiate import differentiate
from flexinv.sensitivity.sensitivities import Sensitivities
from flexinv.typing import Array, Triple

USUAL_STEPS = 200  # of the motion, where none is stated
FEWEST_STEPS = 10
EQUILIBRIUM = "static"  # from rest to rest: a mechanism that bends begins in equilibrium
AFTER = 2  # steps for which the joints rest at the end, where the vibration is taken that is left
PLACES_PER_KNOT = 16  # at which rates, accelerations and jerks of a joint are looked at
RESTING = 1e-6  # of its largest: a rate that is smaller is none
SMALLEST_SPAN = 0.2  # of the longest way: joints that stay or nearly stay are moved by parts of it


@dataclass(frozen=True)
class MotionTrial:
    """Values of a motion, each with its slopes by the variables in a last axis.

    bounded : (rows,) values over their limits, whose size is at most 1
    effort : (efforts,) all torques over the largest one of their drive in the given motion
    amplitude : (amplitudes,) of the modes that go on: how far each moves the tip that it moves most [m]
    reach : (tips, amplitudes) parts of that by which it moves each tip [-]
    rms, work : torques' root mean square over those of the given motion; positive work of the drives [J]
    """

    bounded: Array
    bounded_slope: Array
    effort: Array
    effort_slope: Array
    amplitude: Array
    amplitude_slope: Array
    reach: Array
    rms: float
    rms_slope: Array
    work: float
    work_slope: Array

    @property
    def residual(self) -> float:
        """Largest distance of a tip from its rest place after the end, all modes at their largest together [m]."""
        return float((self.reach @ np.abs(self.amplitude)).max(initial=0.0))


class MotionProblem:
    """Choice of a motion between given ends, and the limits it is held against.

    joints : that move; span : (joints,) by which a variable of 1 moves a row [rad], [m]; place : (rows,) times of the rows,
    of the duration; steps : of a march; begin : coordinates of joints without a motion at the start [rad], [m]
    limited : results of solutions that have a limit, beside torques
    """

    limited: tuple[LimitedResult, ...] = ()

    def __init__(
        self, mechanisms: Sequence[Mechanism], motion: Motion, limits: MotionLimits, knots: int, step: float | None,
        begin: Start = None,
    ) -> None:  # fmt: skip
        """Prepare the problem; raises InputError for joints of more than one coordinate and motions without rest."""
        self.mechanisms = tuple(mechanisms)
        self.limits = limits
        self.begin = begin
        self.duration = find_last_move(motion)
        self.steps = USUAL_STEPS if step is None else max(int(np.ceil(self.duration / step - 1e-9)), FEWEST_STEPS)
        self.place = np.linspace(0.0, 1.0, knots + 2)
        first = self.mechanisms[0]
        self.joints = _list_moving_joints(first, motion)
        self.rows = _sample_rows(first, motion, self.joints, self.place * self.duration)
        way = np.abs(self.rows[-1] - self.rows[0])
        if not way.max(initial=0.0) > 0.0:
            raise InputError("motion: no joint moves from its start to its end; expected one that does")
        self.span = np.maximum(way, SMALLEST_SPAN * way.max())
        self.names = [f"motion.{joint}[{row}]" for row in range(1, knots + 1) for joint in self.joints]
        self.unit = np.tile(self.span, knots)

    @property
    def start(self) -> Array:
        """(variables,) of the given motion [-]."""
        return np.asarray((self.rows[1:-1] / self.span).ravel())

    def make_motion(self, variables: Array, duration: float) -> Motion:
        """Return the motion of some variables (variables,) [-] that takes a time [s]."""
        columns = dict(zip(self.joints, self._fill_rows(variables).T, strict=True))
        return Motion.from_samples(self.place * duration, columns, rest=True)

    def _fill_rows(self, variables: Array) -> Array:
        """Places (rows, joints) [rad], [m]: given ends, and what is chosen between."""
        rows = self.rows.copy()
        rows[1:-1] = variables.reshape(-1, len(self.joints)) * self.span
        return rows

    def evaluate(self, variables: Array, duration: float, given: MotionSizes) -> MotionTrial:
        """Return values and slopes of the motion of some variables (variables,) [-] and of a duration [s].

        Raises ConvergenceError where it cannot be marched.
        """
        motion = self.make_motion(variables, duration)
        step = duration / self.steps
        found = [
            differentiate(
                mechanism,
                motion,
                self.names,
                step=step,
                end=(self.steps + AFTER) * step,
                initial=EQUILIBRIUM,
                start=self.begin,
                of=list_needed_results(self.limited),
                order=2,
            )
            for mechanism in self.mechanisms
        ]
        effort = np.concatenate([one.solution.torque / given.peak for one in found])
        effort_slope = np.concatenate([one.torque * self.unit / given.peak[:, None] for one in found])
        bounded, bounded_slope = self._collect_bounded(variables, duration, found, given)
        amplitude, amplitude_slope, reach = self._collect_residual(found)
        rms = float(np.sqrt((effort**2).sum(axis=1).mean()))
        works = [self._compute_work(one) for one in found]
        worst = int(np.argmax([work for work, _ in works]))
        return MotionTrial(
            bounded=bounded,
            bounded_slope=bounded_slope,
            effort=effort.ravel(),
            effort_slope=effort_slope.reshape(-1, len(variables)),
            amplitude=amplitude + given.correction,
            amplitude_slope=amplitude_slope,
            reach=reach,
            rms=rms,
            rms_slope=np.einsum("kd,kdv->v", effort, effort_slope) / (len(effort) * max(rms, 1e-300)),
            work=works[worst][0],
            work_slope=works[worst][1],
        )

    def _collect_bounded(
        self, variables: Array, duration: float, found: Sequence[Sensitivities], given: MotionSizes
    ) -> tuple[Array, Array]:
        """Values over their limits, with slopes: torques, results of solutions, and what joints do."""
        rows = [
            *self._list_bounded_torques(found, given),
            *self._list_bounded_results(found),
            *self._list_bounded_joints(variables, duration),
        ]
        if not rows:
            return np.zeros(0), np.zeros((0, len(variables)))
        return np.concatenate([values for values, _ in rows]), np.concatenate([slopes for _, slopes in rows])

    def _list_bounded_torques(
        self, found: Sequence[Sensitivities], given: MotionSizes
    ) -> Iterator[tuple[Array, Array]]:
        for column, joint in enumerate(given.drives):
            limit = self.limits.efforts.get(joint)
            if limit is not None:
                for one in found:
                    yield one.solution.torque[:, column] / limit, one.torque[:, column] * self.unit / limit

    def _list_bounded_results(self, found: Sequence[Sensitivities]) -> Iterator[tuple[Array, Array]]:
        for result in self.limited:
            limit = self.limits.find_limit(result.kind, result.name)
            for one in found:
                yield result.compute_values(one.solution) / limit, result.compute_slopes(one) * self.unit / limit

    def _list_bounded_joints(self, variables: Array, duration: float) -> Iterator[tuple[Array, Array]]:
        """Rates, accelerations and jerks of joints, which follow from the rows of the motion alone."""
        rows = self._fill_rows(variables)
        for order, name in enumerate(("rate", "acceleration", "jerk"), start=1):
            for column, joint in enumerate(self.joints):
                limit = getattr(self.limits, name).get(joint)
                if limit is None:
                    continue
                shape = self._shapes[order - 1] / (limit * duration**order)
                slopes = np.zeros((len(shape), len(self.place) - 2, len(self.joints)))
                slopes[:, :, column] = shape[:, 1:-1] * self.span[column]
                yield shape @ rows[:, column], slopes.reshape(len(shape), -1)

    @cached_property
    def _shapes(self) -> Triple:
        """Derivatives (places, rows) of the spline by its parts, at equal places, for a duration of 1."""
        count = PLACES_PER_KNOT * (len(self.place) - 1) + 1
        at = np.linspace(0.0, 1.0, count)
        ends = [(order, np.zeros(len(self.place))) for order in (1, 2)]
        spline = scipy.interpolate.make_interp_spline(self.place, np.eye(len(self.place)), k=5, bc_type=(ends, ends))
        return spline(at, 1), spline(at, 2), spline(at, 3)

    def _collect_residual(self, found: Sequence[Sensitivities]) -> Triple:
        """Amplitudes of all modes of all mechanisms, their slopes, and how far each moves each tip [m]."""
        bending = [one.differentiate_residual_vibration() for one in found if not one.solution.mechanism.is_rigid]
        if not bending:
            return np.zeros(0), np.zeros((0, len(self.unit))), np.zeros((0, 0))
        amplitude, reach, most = collect_amplitudes([one.vibration for one in bending])
        slope = np.concatenate([part for one in bending for part in (one.cosine, one.sine)])
        return amplitude, most[:, None] * slope * self.unit, reach

    def _compute_work(self, one: Sensitivities) -> tuple[float, Array]:
        """Work that the drives put in [J], without what they take out, and its slopes."""
        solution = one.solution
        columns = np.flatnonzero(solution.mechanism.actuated)
        rate = solution.qd[:, columns]
        power = solution.torque * rate
        positive = (power > 0.0)[:, :, None]
        slope = np.where(positive, one.torque * rate[:, :, None], 0.0) * self.unit
        # Of rates: differences between samples, enough for where to go next; the work itself is exact.
        rates = np.stack([np.gradient(one.q[:, column], solution.time, axis=0) for column in columns], axis=1)
        slope += np.where(positive, rates * solution.torque[:, :, None], 0.0) * self.unit
        work = np.trapezoid(np.maximum(power, 0.0).sum(axis=1), solution.time)
        return float(work), np.trapezoid(slope.sum(axis=1), solution.time, axis=0)


@dataclass(frozen=True)
class MotionSizes:
    """Sizes of the given motion, against which others are measured.

    drives : joints with a drive; peak : (drives,) largest torques [N m], [N]; residual : [m]; rms : [-]; work : [J]
    correction : (amplitudes,) of the modes that go on [m]: what finer marches of a motion near by add to those of the search
    """

    drives: tuple[str, ...]
    peak: Array
    residual: float = 0.0
    rms: float = 1.0
    work: float = 0.0
    correction: Array | float = 0.0


def collect_amplitudes(vibrations: Sequence[ResidualVibration]) -> Triple:
    """Return amplitudes of all modes, cosine and sine apart (amplitudes,) [m], their parts at each tip (tips, amplitudes) [-],
    and how far one of 1 m kg^0.5 moves the tip that it moves most (amplitudes,) [m], with the sign of its mode.

    A mode and its opposite are the same: each is taken with the sign that one direction gives it, as in motions near by.
    """
    shapes = [np.tile(compute_reach_by_mode(one), 2) for one in vibrations]
    most = np.concatenate([shape.max(axis=0) for shape in shapes])
    signed = most * np.concatenate([np.tile(_find_signs(one), 2) for one in vibrations])
    amplitude = signed * np.concatenate([part for one in vibrations for part in (one.cosine, one.sine)])
    reach = np.asarray(scipy.linalg.block_diag(*shapes))
    return amplitude, reach / np.maximum(most, np.finfo(float).tiny), signed


def _find_signs(vibration: ResidualVibration) -> Array:
    """Sign (modes,) of each mode's shape along a direction that no mode is normal to by its symmetry."""
    shape = vibration.modes.displacement.real.reshape(len(vibration.cosine), -1)
    along = shape @ np.cos(np.arange(1, shape.shape[1] + 1))
    return np.where(along < 0.0, -1.0, 1.0)


def find_last_move(motion: Motion) -> float:
    """Return the time at which the last joint comes to rest [s]."""
    shaped = (track.shaper.duration if track.shaper is not None else 0.0 for track in motion.tracks)
    return max(track.delay + track.move + later for track, later in zip(motion.tracks, shaped, strict=True))


def _list_moving_joints(mechanism: Mechanism, motion: Motion) -> tuple[str, ...]:
    """Joints with a motion; InputError for those with more than one coordinate."""
    joints = motion.joints(mechanism)
    for name in joints:
        if not KINDS[mechanism.joint_of[name].kind].scalar or KINDS[mechanism.joint_of[name].kind].circle:
            raise InputError(
                f"optimize_motion: joint '{name}' is {mechanism.joint_of[name].kind}; expected joints with one coordinate "
                "(revolute, prismatic)"
            )
    return joints


def _sample_rows(mechanism: Mechanism, motion: Motion, joints: Sequence[str], time: Array) -> Array:
    """Places (rows, joints) [rad], [m] at some times; InputError unless they are at rest at both ends."""
    q, qd, _ = motion.evaluate(mechanism, time)
    for name in joints:
        size = np.abs(qd[:, mechanism.v_slices[name]]).max(axis=1)
        if max(size[0], size[-1]) > RESTING * size.max(initial=0.0):
            where = "start" if size[0] > size[-1] else "end"
            raise InputError(
                f"optimize_motion: joint '{name}' moves at the {where} of the motion; expected one from rest to rest"
            )
    return np.stack([q[:, mechanism.q_slices[name]][:, 0] for name in joints], axis=1)
