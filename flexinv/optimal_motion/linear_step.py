"""One step towards a better motion: the best one of the linearised problem, within a box in which that can be trusted.

    minimise  cost . d + ...      subject to  |v + J d| <= base + u,   R |a + A d| <= r (base + u),   |d| <= size

is a linear program, as are the largest of some values and sums of sizes in its aim (SciPy's HiGHS solves it).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.optimal_motion.motion_problem import MotionSizes, MotionTrial
from flexinv.typing import Array

PENALTY = 10.0  # of a limit that is passed by all of itself, in parts of the aim at the start
USE = "use"  # the aim of passing limits by least, or of keeping the largest distance from them
AIMS = ("residual", "peak torque", "rms torque", "work")


@dataclass(frozen=True)
class Aim:
    """Sum of what is to be small, each in parts of that of the given motion: aim -> weight [-]; ``USE`` alone for limits.

    residual_limit : of the tips' distance after the end [m], inf without one
    """

    weights: Mapping[str, float]
    residual_limit: float
    given: MotionSizes

    @property
    def keeps_limits(self) -> bool:
        """Return True if limits have to be kept [-]; else the largest use of one has to be small."""
        return USE not in self.weights

    def compute_use(self, trial: MotionTrial) -> float:
        """Return the largest use of a limit, 1 where one is reached [-]."""
        return max(float(np.abs(trial.bounded).max(initial=0.0)), trial.residual / self.residual_limit)

    def compute_merit(self, trial: MotionTrial) -> float:
        """Return the sum that has to be small [-], limits that are passed among it."""
        use = self.compute_use(trial)
        if not self.keeps_limits:
            return use
        values = self._list_values(trial)
        return sum(weight * values[name] for name, weight in self.weights.items()) + PENALTY * max(use - 1.0, 0.0)

    def _list_values(self, trial: MotionTrial) -> dict[str, float]:
        given = self.given
        return {
            "residual": trial.residual / given.residual if given.residual else 0.0,
            "peak torque": float(np.abs(trial.effort).max(initial=0.0)),
            "rms torque": trial.rms / given.rms,
            "work": trial.work / given.work if given.work else 0.0,
        }


def find_linear_step(trial: MotionTrial, aim: Aim, size: float) -> tuple[Array, float]:
    """Return the best change (variables,) of at most ``size`` [-], and the merit that the linearised problem gives it [-]."""
    program = _LinearProgram(trial, aim, size)
    if aim.keeps_limits:
        program.add_aims()
    program.add_limits()
    return program.solve()


class _LinearProgram:
    """A linear program in the changes d, the use u, the sizes of the amplitudes a, the largest torque p and distance r.

    What is bounded has a use of its own, at most u and at most what it is now, or 1: a vibration that is far from its limit
    is no reason for wild motions.
    """

    def __init__(self, trial: MotionTrial, aim: Aim, size: float) -> None:
        """Begin with no rows."""
        self.trial = trial
        self.aim = aim
        self.size = size
        self.changes = trial.bounded_slope.shape[1]
        self.modes = len(trial.amplitude)
        self.use = self.changes
        self.first_mode = self.changes + 1
        self.peak = self.first_mode + self.modes
        self.distance = self.peak + 1
        self.bounded = self.distance + 1
        self.width = self.bounded + 1
        self.scale = aim.residual_limit if np.isfinite(aim.residual_limit) else aim.given.residual or 1.0
        self.cost = np.zeros(self.width)
        self.cost[self.use] = PENALTY if aim.keeps_limits else 1.0
        self.constant = 0.0
        self.rows: list[Array] = []
        self.right: list[Array] = []

    def add_limits(self) -> None:
        """Add rows for what is bounded."""
        base = 1.0 if self.aim.keeps_limits else 0.0
        now = float(np.abs(self.trial.bounded).max(initial=0.0))
        self.largest_bounded = max(1.0, now) - base
        self._add_bounds(self.trial.bounded, self.trial.bounded_slope, self.bounded, base)
        no_more_than_use = np.zeros((1, self.width))
        no_more_than_use[0, [self.bounded, self.use]] = 1.0, -1.0
        self.rows.append(no_more_than_use)
        self.right.append(np.zeros(1))
        self._add_sizes()
        if np.isfinite(self.aim.residual_limit):
            self._add_distances(self.use, base, self.aim.residual_limit)

    def add_aims(self) -> None:
        """Add what is to be small."""
        weights = self.aim.weights
        given = self.aim.given
        trial = self.trial
        if "peak torque" in weights:
            self.cost[self.peak] = weights["peak torque"]
            self._add_bounds(trial.effort, trial.effort_slope, self.peak, 0.0)
        if "residual" in weights and given.residual:
            self.cost[self.distance] = weights["residual"]
            self._add_distances(self.distance, 0.0, given.residual)
        for name, value, slope, scale in (
            ("rms torque", trial.rms, trial.rms_slope, given.rms),
            ("work", trial.work, trial.work_slope, given.work),
        ):
            if name in weights and scale:
                self.cost[: self.changes] += weights[name] * slope / scale
                self.constant += weights[name] * value / scale

    def _add_bounds(self, values: Array, slopes: Array, column: int, base: float) -> None:
        """|v + J d| <= base + the variable of a column; rows that no step can bring there are left out."""
        swing = self.size * np.abs(slopes).sum(axis=1)
        least = max(base, float((np.abs(values) - swing).max(initial=0.0)))
        kept = np.abs(values) + swing >= least
        for sign in (1.0, -1.0):
            rows = np.zeros((int(kept.sum()), self.width))
            rows[:, : self.changes] = sign * slopes[kept]
            rows[:, column] = -1.0
            self.rows.append(rows)
            self.right.append(base - sign * values[kept])

    def _add_sizes(self) -> None:
        """|a + A d| <= the variables of the amplitudes, all in parts of a distance [m]."""
        for sign in (1.0, -1.0):
            rows = np.zeros((self.modes, self.width))
            rows[:, : self.changes] = sign * self.trial.amplitude_slope / self.scale
            rows[:, self.first_mode : self.peak] = -np.eye(self.modes)
            self.rows.append(rows)
            self.right.append(-sign * self.trial.amplitude / self.scale)

    def _add_distances(self, column: int, base: float, scale: float) -> None:
        """Distances of the tips over a scale [m] <= base + the variable of a column."""
        rows = np.zeros((len(self.trial.reach), self.width))
        rows[:, self.first_mode : self.peak] = self.trial.reach * (self.scale / scale)
        rows[:, column] = -1.0
        self.rows.append(rows)
        self.right.append(np.full(len(rows), base))

    def solve(self) -> tuple[Array, float]:
        """Return the changes [-] and the merit that they should give [-]."""
        bounds = [(-self.size, self.size)] * self.changes + [(0.0, None)] * (self.width - self.changes)
        bounds[self.bounded] = (0.0, self.largest_bounded)
        found = scipy.optimize.linprog(
            self.cost, A_ub=np.concatenate(self.rows), b_ub=np.concatenate(self.right), bounds=bounds, method="highs"
        )
        return found.x[: self.changes], float(found.fun) + self.constant
