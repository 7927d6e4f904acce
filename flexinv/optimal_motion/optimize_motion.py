"""optimize_motion: the shortest, the quietest or the least demanding motion of an arm that bends, within limits.

For one duration the rows of the motion are found by linear programs in a box that grows while they can be trusted
(`linear_step`); at a fixed duration torques and vibration are nearly linear in them.  The shortest duration is that at which the
smallest use of the limits is 1: a root of a function of one number, found by secants within a bracket.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.analysis.task import Start
from flexinv.errors import ConvergenceError, InputError
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.optimal_motion.limited_results import list_limited_results
from flexinv.optimal_motion.linear_step import AIMS, USE, Aim, find_linear_step
from flexinv.optimal_motion.motion_limits import MotionLimits
from flexinv.optimal_motion.motion_problem import (
    AFTER,
    EQUILIBRIUM,
    MotionProblem,
    MotionSizes,
    MotionTrial,
    collect_amplitudes,
)
from flexinv.optimal_motion.optimized_motion import OptimizedMotion, find_largest_reach
from flexinv.typing import Array
from flexinv.validation import check_kind, check_kinds, check_mapping, check_number, check_seconds, check_whole_number

USUAL_KNOTS = 10
QUIET_PART = 0.01  # of the given motion's residual vibration: the limit where none is stated
QUIET_WAY = 1e-4  # of the way of a tip: the least such limit
FIRST_BOX = 0.1  # of the ways of the joints: the change of a row in the first linear program
LARGEST_BOX = 0.4
SMALLEST_BOX = 1e-4
GOOD_STEP = 0.75  # of what was foretold: the box grows
BAD_STEP = 0.25  # of that: it shrinks
WORST = 10.0  # use of a limit: what is worse says nothing of the next duration
SHRUNK = 0.3  # to this part of it
RISKED = 1  # steps that may make it worse, before the best one is gone back to
FAR_WITHIN = 0.7  # of the limits: a shorter duration is tried at once
WELL_WITHIN = 0.98  # of the limits, within a bracket of durations
LATER = (1.0, 1.005, 1.01, 1.02, 1.04, 1.08)  # durations to which a motion is stretched that a finer march refuses
SETTLED = 1e-3  # of the merit: a linear program that promises less ends the search
PROGRAMS = 40  # for one duration
DURATIONS = 16
LAST_TRIED = 4.0  # times the given duration: the last one that is tried
SHORTEST_KNOWN = 5e-3  # of the duration, to which the shortest one is found
SHORTENED = 0.75  # of a duration at least: the next one that is tried
LENGTHENED = 1.02  # of a duration that breaks limits: the next one at least
SEARCHED_WITHIN = 0.9  # of the limit of vibration, for the search: a finer march has another remainder
CHECKED = 2e-3  # of a limit, by which the finer march may pass it; else limits are drawn in and the search goes on
TOO_COARSE = 1.5  # of the limit of vibration, that the finer march finds: the search goes on at half its steps
TIGHTENED = 5  # times


def optimize_motion(
    mechanism: Mechanism | Iterable[Mechanism],
    motion: Motion,
    limits: MotionLimits | None = None,
    aim: str | Mapping[str, float] = "duration",
    step: float | None = None,
    knots: int = USUAL_KNOTS,
    progress: Callable[[float, float], None] | None = None,
    start: Start = None,
) -> OptimizedMotion:
    """Return the motion between the same ends that is best within limits, at rest at its end, its beams with it.

    It begins in equilibrium under gravity.

    mechanism : one, or several that it has to be good for (payloads, stiffnesses): the worst of them counts
    motion : to start from, from rest to rest; its joints, their ends and, but for "duration", its duration stay
    limits : at every instant; by default the largest torques of the given motion, and a hundredth of what it goes on swinging
        by, or a ten thousandth of a tip's way
    aim : "duration", "residual", "peak torque", "rms torque", "work", or several with weights, in parts of the given motion's
    step : of the search [s], for the given duration, by default a two hundredth of it; the motion that is found is checked at
        half of it, with error bars by a finer mesh
    knots : rows of every joint that are chosen; splines of fifth degree through them, smooth to the jerk, are the motion
    progress : called with the duration [s] and the largest use of a limit [-] of each motion that was found
    start : coordinates of joints without a motion at the start [rad], [m], in a loop the guess from which it closes
    Raises InputError for joints with more than one coordinate, what `differentiate` refuses, limits that cannot be kept, and
    nothing to vary; ConvergenceError where the given motion cannot be marched.
    """
    mechanisms = (
        (mechanism,) if isinstance(mechanism, Mechanism) else tuple(check_kinds("mechanism", mechanism, Mechanism))
    )
    if not mechanisms:
        raise InputError("mechanism: an empty list; expected at least one Mechanism")
    for one in mechanisms:
        if one.velocity_names != mechanisms[0].velocity_names:
            raise InputError(
                f"mechanism: joints {', '.join(one.velocity_names)}; expected those of the first one, "
                f"{', '.join(mechanisms[0].velocity_names)}"
            )
    check_kind("motion", motion, Motion)
    held = MotionLimits() if limits is None else check_kind("limits", limits, MotionLimits)
    held.check_names(mechanisms[0])
    weights = read_aim(aim)
    if step is not None:
        check_seconds("step", step, "a time step [s], for example 1e-3")
    count = check_whole_number("knots", knots, 1, "1 or more rows to be chosen, for example 10")
    if set(weights) == {"duration"} and not held.limits_time:
        raise InputError(
            "limits: nothing keeps the motion from taking no time; write limits=MotionLimits(torque={'joint': 2.0})"
        )
    search = _MotionSearch(MotionProblem(mechanisms, motion, held, count, step, start), motion, progress)
    return search.run(weights)


def read_aim(aim: str | Mapping[str, float]) -> dict[str, float]:
    """Return weights [-] by their aims; raises InputError for what is none."""
    known = ("duration", *AIMS)
    given = (
        {aim: 1.0}
        if isinstance(aim, str)
        else check_mapping("aim", aim, "an aim or weights by aims", "{'duration': 1.0}")
    )
    weights = {
        str(name): check_number(f"aim: weight of {name!r}", weight, "a number above 0")
        for name, weight in given.items()
    }
    for name, weight in weights.items():
        if name not in known:
            raise InputError(f"aim: {name!r}: expected one of {', '.join(map(repr, known))}")
        if not (np.isfinite(weight) and weight > 0.0):
            raise InputError(f"aim: weight of {name!r} is {weight:g}; expected a finite number above 0")
    if not weights:
        raise InputError("aim: nothing is to be small; write an aim, as 'duration'")
    return weights


class _Point:
    """Variables of a motion, what they give, and how good that is."""

    def __init__(self, variables: Array, trial: MotionTrial, aim: Aim) -> None:
        """Take the merit of a trial."""
        self.variables = variables
        self.trial = trial
        self.merit = aim.compute_merit(trial)


class _MotionSearch:
    """Search for one problem: its given motion, its limits as far as they are drawn in, and what is reported."""

    def __init__(
        self, problem: MotionProblem, motion: Motion, progress: Callable[[float, float], None] | None
    ) -> None:  # fmt: skip
        """Solve the given motion; raises as `solve` does."""
        self.problem = problem
        self.motion = motion
        self.progress = progress
        self.before = self._solve_finer(motion, problem.duration, error=False)
        problem.limited = list_limited_results(problem.limits, self.before[0])
        peak = np.maximum.reduce([np.abs(one.torque).max(axis=0) for one in self.before])
        residual = max(find_largest_reach(one) for one in self.before)
        stated = problem.limits.residual
        if stated is not None and not residual:
            raise InputError("limits: residual, but no link goes on swinging after the given motion; leave it out")
        peaks = dict(zip(self.before[0].torque_names, peak.tolist(), strict=True))
        torque = (
            {name: size for name, size in peaks.items() if size}
            if problem.limits.torque is None
            else problem.limits.torque
        )
        self.stated = replace(problem.limits, torque=torque, residual=stated or self._choose_quiet_limit(residual))
        problem.limits = replace(
            self.stated, residual=SEARCHED_WITHIN * self.stated.residual if self.stated.residual else None
        )
        given = MotionSizes(self.before[0].torque_names, np.where(peak > 0.0, peak, 1.0), residual)
        trial = problem.evaluate(problem.start, problem.duration, given)
        self.given = replace(given, rms=trial.rms, work=trial.work)

    def _choose_quiet_limit(self, residual: float) -> float | None:
        """The limit of the vibration [m] where none is stated; None where nothing swings."""
        if not residual:
            return None
        ways = [np.linalg.norm(tip[-1] - tip[0]) for one in self.before for tip in one.tip.values()]
        return max(QUIET_PART * residual, QUIET_WAY * float(max(ways)))

    def run(self, weights: Mapping[str, float]) -> OptimizedMotion:
        """Find the motion, check it, and draw limits in while the check passes them."""
        variables, duration, reason = self._find_best(weights, self.problem.start, self.problem.duration)
        for attempt in range(TIGHTENED + 1):
            motion = self.problem.make_motion(variables, duration)
            solutions = self._solve_finer(motion, duration, error=True)
            found = OptimizedMotion(
                motion, self.motion, self.problem.mechanisms, solutions, self.before, self.stated, reason
            )
            where, part = max(found.used.items(), key=lambda item: item[1], default=("", 0.0))
            if part <= 1.0 + CHECKED:
                return found
            if attempt == TIGHTENED:
                break
            too_coarse = self._apply_check(found, variables)
            if "duration" in weights and not too_coarse:
                variables, duration = self._find_longer(variables, duration)
                continue
            try:
                variables, duration, reason = self._find_best(weights, variables, duration)
            except InputError:  # what it could not keep the last motion shows
                break
        return replace(
            found, reason=f"{reason}; gave up: a finer march passes the limit of {where} by {part - 1.0:.1%}"
        )

    def _apply_check(self, found: OptimizedMotion, variables: Array) -> bool:
        """Draw in the limits that the finer march passes, and correct the amplitudes by its own.

        Return True if the steps were too coarse for what goes on swinging: then they are halved, and nothing else is learned.
        """
        if found.used.get("residual", 0.0) > TOO_COARSE:
            self.problem.steps *= 2
            self.given = replace(self.given, correction=0.0)
            return True
        for name, part in found.used.items():
            kind, _, joint = name.partition(" ")
            if joint and part > 1.0:
                self.problem.limits = self.problem.limits.draw_in(kind, joint, 1.0 / part)
        if self.given.residual:
            trial = self.problem.evaluate(variables, found.duration, replace(self.given, correction=0.0))
            finer, _, _ = collect_amplitudes([one.find_residual_vibration() for one in found.solutions])
            self.given = replace(self.given, correction=finer - trial.amplitude)
        return False

    def _solve_finer(self, motion: Motion, duration: float, error: bool) -> tuple[Solution, ...]:
        """The motion at half the step of the search, until shortly after its end, for every mechanism."""
        step = 0.5 * duration / self.problem.steps
        end = (2 * self.problem.steps + AFTER) * step
        mechanisms = self.problem.mechanisms
        begin = self.problem.begin
        return tuple(
            solve(one, motion, step=step, end=end, error=error, initial=EQUILIBRIUM, start=begin) for one in mechanisms
        )

    def _find_best(
        self, weights: Mapping[str, float], variables: Array, duration: float
    ) -> tuple[Array, float, str]:  # fmt: skip
        """The best variables and the duration [s], and how the search ended."""
        if set(weights) == {"duration"}:
            return self._find_shortest(variables, duration)
        others = {name: weight for name, weight in weights.items() if name != "duration"}
        if "duration" in weights:
            return self._find_best_duration(weights["duration"], others, variables, duration)
        found, _, settled = self._find_at(variables, duration, self._make_aim(others))
        self._check_kept(found, duration)
        return found, duration, "nothing better is near" if settled else f"gave up after {PROGRAMS} linear programs"

    def _make_aim(self, weights: Mapping[str, float]) -> Aim:
        return Aim(weights, self.problem.limits.residual or np.inf, self.given)

    def _check_kept(self, variables: Array, duration: float) -> None:
        """Raise InputError where limits cannot be kept."""
        trial = self.problem.evaluate(variables, duration, self.given)
        use = self._make_aim({USE: 1.0}).compute_use(trial)
        if use > 1.0 + SETTLED:
            raise InputError(
                f"optimize_motion: within {duration:g} s the best motion that was found passes limits by {use - 1.0:.1%}; write "
                "a longer motion, more knots, or wider limits"
            )

    def _find_at(
        self, variables: Array, duration: float, aim: Aim, enough: float = 0.0
    ) -> tuple[Array, float, bool]:  # fmt: skip
        """The best variables for a duration [s], their merit [-], and whether it would not become better, or is ``enough``.

        The merit is inf where nothing can be marched.
        """
        first = self._evaluate_point(variables, duration, aim) or self._evaluate_point(
            self.problem.start, duration, aim
        )
        if first is None:
            return variables, np.inf, False
        best = point = first
        box = FIRST_BOX
        risked = 0
        for _ in range(PROGRAMS):
            change, foretold = find_linear_step(point.trial, aim, box)
            promised = point.merit - foretold
            if best.merit < enough or (point is best and (promised < SETTLED * best.merit or box < SMALLEST_BOX)):
                self._send_progress(duration, aim.compute_use(best.trial))
                return best.variables, best.merit, True
            other = self._evaluate_point(point.variables + change, duration, aim)
            if other is not None and other.merit < best.merit:
                box = _choose_box(box, (point.merit - other.merit) / max(promised, np.finfo(float).tiny))
                best = point = other
                risked = 0
            elif other is not None and risked < RISKED:
                point = other  # from where it is linearised anew: what the curvature has spoiled, the next step mends
                risked += 1
            else:
                point = best
                box *= SHRUNK
                risked = 0
        self._send_progress(duration, aim.compute_use(best.trial))
        return best.variables, best.merit, False

    def _evaluate_point(self, variables: Array, duration: float, aim: Aim) -> _Point | None:
        """The point of some variables; None where it cannot be marched."""
        try:
            return _Point(variables, self.problem.evaluate(variables, duration, self.given), aim)
        except ConvergenceError:
            return None

    def _send_progress(self, duration: float, use: float) -> None:
        if self.progress is not None:
            self.progress(duration, use)

    def _find_shortest(self, variables: Array, duration: float) -> tuple[Array, float, str]:
        """The variables of the shortest motion within limits, and its duration [s]; the use of limits is 1 there."""
        aim = self._make_aim({USE: 1.0})
        longest = LAST_TRIED * self.problem.duration
        kept: tuple[float, float] | None = None
        broken: tuple[float, float] | None = None
        best = variables
        for _ in range(DURATIONS):
            found, use, _ = self._find_at(variables, duration, aim, FAR_WITHIN if broken is None else WELL_WITHIN)
            if use <= 1.0:
                best = variables = found
                kept = duration, use
            else:
                broken = duration, use
            if kept is None and duration >= longest:
                self._check_kept(found, duration)
            if kept is not None and _is_shortest(kept, broken):
                beyond = "" if broken is None else f", and passed in {broken[0]:.4g} s"
                return best, kept[0], f"limits are used to {kept[1]:.1%}{beyond}"
            duration = min(_choose_duration(kept, broken), longest)
        if kept is None:
            raise InputError(
                f"optimize_motion: no motion within limits was found in {DURATIONS} durations; write wider limits"
            )
        return best, kept[0], f"gave up after {DURATIONS} durations: limits are used to {kept[1]:.1%}"

    def _find_longer(self, variables: Array, duration: float) -> tuple[Array, float]:
        """The variables and the first duration [s] from the present one on within limits."""
        for part in LATER:
            variables, use, _ = self._find_at(variables, part * duration, self._make_aim({USE: 1.0}), 1.0)
            if use <= 1.0:
                break
        return variables, part * duration

    def _find_best_duration(
        self, weight: float, others: Mapping[str, float], variables: Array, duration: float
    ) -> tuple[Array, float, str]:
        """The variables and the duration [s] with the smallest weighted sum, a minimum of one number."""
        shortest = 0.3 * duration
        if self.problem.limits.limits_time:
            shortest = self._find_shortest(variables, duration)[1]
        aim = self._make_aim(others)
        found: dict[float, tuple[Array, float]] = {}

        def evaluate_duration(time: float) -> float:
            nearest = min(found, key=lambda other: abs(other - time), default=None)
            begin = variables if nearest is None else found[nearest][0]
            best, merit, _ = self._find_at(begin, time, aim)
            found[time] = best, merit + weight * time / duration
            return found[time][1]

        options = {"xatol": SHORTEST_KNOWN * duration, "maxiter": DURATIONS}
        scipy.optimize.minimize_scalar(
            evaluate_duration,
            bounds=(shortest, duration),
            method="bounded",
            options=options,
        )
        best = min(found, key=lambda time: found[time][1])
        self._check_kept(found[best][0], best)
        return found[best][0], best, f"the smallest weighted sum of {len(found)} durations"


def _choose_box(box: float, part: float) -> float:
    """The next box [-], after a step that gained a part of what was foretold."""
    if part > GOOD_STEP:
        return min(2.0 * box, LARGEST_BOX)
    return SHRUNK * box if part < BAD_STEP else box


def _is_shortest(kept: tuple[float, float], broken: tuple[float, float] | None) -> bool:
    """Return True if a shorter duration [s] is known to break a limit, or one is reached."""
    if broken is not None and kept[0] - broken[0] <= SHORTEST_KNOWN * kept[0]:
        return True
    return kept[1] >= 1.0 - SHORTEST_KNOWN


def _choose_duration(kept: tuple[float, float] | None, broken: tuple[float, float] | None) -> float:
    """The next duration [s]: where a power of the duration through two uses is 1, within the bracket; beyond one without."""
    if broken is None:
        duration, use = kept or (0.0, 0.0)
        return duration * max(float(np.sqrt(use)), SHORTENED)
    if kept is None:
        return broken[0] * min(max(float(np.sqrt(broken[1])), LENGTHENED), 1.0 / SHORTENED)
    duration, use = kept
    width = duration - broken[0]
    power = np.log(min(broken[1], WORST) / use) / np.log(broken[0] / duration)
    guess = duration * np.exp(np.log((1.0 - 0.5 * SETTLED) / use) / power)
    return float(np.clip(guess, broken[0] + 0.1 * width, duration - 0.3 * width))
