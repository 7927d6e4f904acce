"""Result of a search for a motion: what was found beside what was given, and how it was checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexinv.analysis.solution import Solution
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.optimal_motion.limited_results import LimitedResult, list_limited_results
from flexinv.optimal_motion.motion_limits import MotionLimits
from flexinv.optimal_motion.motion_problem import find_last_move
from flexinv.sensitivity.parameters import compute_jerk

if TYPE_CHECKING:
    import pandas as pd

    from flexinv.display.figures import Figure

LAST_LOOK = 2001  # times at which rates, accelerations and jerks are looked at in the end


@dataclass(frozen=True, eq=False, repr=False)
class OptimizedMotion(ByValue):
    """A motion that was found, what it was held against, and how it was checked.

    motion : the one found; given : the one to start from; mechanisms : for which it was found
    solutions, before : of the found and of the given motion, one for each mechanism, the first at half the step of the search and
        with error bars
    limits : that were asked for; reason : how the search ended, in words
    """

    motion: Motion
    given: Motion
    mechanisms: tuple[Mechanism, ...]
    solutions: tuple[Solution, ...]
    before: tuple[Solution, ...]
    limits: MotionLimits
    reason: str

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return self.motion.duration

    @property
    def residual(self) -> float:
        """Largest distance of a tip from its rest place after the end, of all mechanisms [m]."""
        return max(find_largest_reach(solution) for solution in self.solutions)

    def frame(self) -> pd.DataFrame:
        """Return a row for each quantity: before, after, its limit, and the part of it that is used [-].

        Torques [N m], [N] with their error bars; rates, accelerations, jerks, forces [N] and moments [N m] of joints, strains [-]
        and distances of tips from a path [m] that have a limit; residual vibration [m]; duration [s].
        """
        import pandas

        table = pandas.DataFrame.from_dict(self._list_rows(), orient="index", columns=["before", "after", "limit"])
        table["used"] = table["after"] / table["limit"]
        return table

    @property
    def used(self) -> dict[str, float]:
        """Quantity -> the part of its limit that the motion uses [-]."""
        return {name: after / limit for name, (_, after, limit) in self._list_rows().items() if np.isfinite(limit)}

    def _list_rows(self) -> dict[str, tuple[float, float, float]]:
        """Quantity -> before, after, limit, nan where there is none."""
        rows = {}
        for name in self.solutions[0].torque_names:
            before, after = (_find_peak(some, name) for some in (self.before, self.solutions))
            rows[f"torque {name}"] = (before, after, self.limits.efforts.get(name, np.nan))
        for name in ("rate", "acceleration", "jerk"):
            for joint, limit in getattr(self.limits, name).items():
                before, after = (
                    _find_joint_peak(one, self.mechanisms[0], joint, name) for one in (self.given, self.motion)
                )
                rows[f"{name} {joint}"] = (before, after, limit)
        for result in list_limited_results(self.limits, self.before[0]):
            before, after = (_find_largest_value(some, result) for some in (self.before, self.solutions))
            limit = self.limits.find_limit(result.kind, result.name)
            rows[f"{result.kind} {result.name}"] = (before, after, limit)
        if not self.mechanisms[0].is_rigid:
            residual = np.nan if self.limits.residual is None else self.limits.residual
            rows["residual"] = (max(find_largest_reach(one) for one in self.before), self.residual, residual)
        rows["duration"] = (find_last_move(self.given), self.duration, np.nan)
        return rows

    def plot(self) -> Figure:
        """Return a matplotlib Figure of both motions: joints [rad], [m], efforts [N m], [N], distance of a tip from rest [m].

        Raises InputError where matplotlib is not installed.
        """
        from flexinv.display.figures import check_matplotlib
        from flexinv.optimal_motion.motion_figure import draw_optimized_motion

        check_matplotlib("plot()")
        return draw_optimized_motion(self)

    def __repr__(self) -> str:
        """Return the durations [s] and how the search ended in a line."""
        return f"OptimizedMotion({find_last_move(self.given):.4g} s -> {self.duration:.4g} s; {self.reason})"


def find_largest_reach(solution: Solution) -> float:
    """Return the largest distance of a tip from its rest place after the end [m], 0 where no link bends."""
    if solution.mechanism.is_rigid:
        return 0.0
    return max(solution.find_residual_vibration().reach.values())


def _find_peak(solutions: Sequence[Solution], name: str) -> float:
    """Largest torque of a drive [N m], [N]."""
    return max(float(np.abs(one.torque[:, one.torque_names.index(name)]).max()) for one in solutions)


def _find_largest_value(solutions: Sequence[Solution], result: LimitedResult) -> float:
    """Largest size of a result that has a limit [its own unit]."""
    return max(float(np.abs(result.compute_values(one)).max()) for one in solutions)


def _find_joint_peak(motion: Motion, mechanism: Mechanism, joint: str, name: str) -> float:
    """Largest rate, acceleration or jerk of a joint [rad/s], [m/s] and derivatives, at many times."""
    time = np.linspace(0.0, motion.duration, LAST_LOOK)
    column = mechanism.v_slices[joint]
    if name == "jerk":
        values = compute_jerk(motion, mechanism, time)
    else:
        values = motion.evaluate(mechanism, time)[1 if name == "rate" else 2]
    return float(np.abs(values[:, column]).max())
