"""The error bars of closed formulas: no step and no mesh, but rounding, which the shape of the problem enlarges.

The same run with every input moved by a few of its last digits: what that changes is what the last digits decide.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import Adapter, Options, is_repeatable
from crosscheck.measures.budget import Family, add_error_bars
from crosscheck.measures.record import BudgetLine, Record
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion

Array = NDArray[np.float64]
# Of every number that goes in.  A chain of ten links rounds some tens of times on the way; 8 of the last digits at the
# start of it stand for those (measured: the bars of double_pendulum then cover its distance from Pinocchio).
SHAKE = 8 * np.finfo(float).eps
NAME = "rounding"


class PerturbedMotion:
    """A motion whose coordinates, rates and accelerations differ by ``SHAKE`` [-], up and down by turns.

    way : 0, by turns along the samples; 1, 2, ..., by a factor that stays, another one each, without noise: the motion
        and the start are others, by less than anybody could state them
    """

    def __init__(self, motion: Motion, way: int = 0) -> None:
        """Keep the motion itself."""
        self._motion = motion
        self._way = way

    def evaluate(self, mechanism: Mechanism, time: Array, *side: Any) -> tuple[Array, ...]:
        """Return q, qd, qdd as the motion does [rad], [m], [1/s], [1/s^2]."""
        given = self._motion.evaluate(mechanism, time, *side)
        return tuple(part * (1.0 + SHAKE * _build_signs(part, self._way)) for part in given)

    def __getattr__(self, name: str) -> Any:
        """Return everything else from the motion."""
        return getattr(self._motion, name)


def build_perturbed_case(case: Case, way: int = 0) -> Case:
    """Return a case whose motion differs by its last digits, as `PerturbedMotion` moves them [rad], [m]; way : see there [-]."""
    return replace(case, motion=cast(Motion, PerturbedMotion(case.motion, way)))


def add_rounding_bars(adapter: Adapter, record: Record, mechanism: Mechanism, case: Case, options: Options) -> Record:
    """Return the record with error bars of rounding [units of its series] where it has none of its own."""
    if (
        record.status != "ok"
        or not is_repeatable(adapter)
        or any(one.error is not None for one in record.series.values())
    ):
        return record
    other = adapter.run(mechanism, build_perturbed_case(case), record.engine, options)
    if other.status != "ok" or set(other.series) != set(record.series):
        return record
    made, budget = add_error_bars(record.series, [Family(NAME, (other.series, record.series))])
    return replace(record, series=made, budget={k: _update_budget_line(line) for k, line in budget.items()})


def _update_budget_line(line: BudgetLine) -> BudgetLine:
    return {**line, "order": {}, "how": {NAME: "closed formulas: the last digits of the input moved"}}


def _build_signs(values: Array, way: int) -> Array:
    """Return +1 and -1 by turns along the samples, shifted from column to column, in the shape of the values [-].

    way : 1, 2, 3, 4, ...: 1, -1, 1/2, -1/2, ... instead in all samples of the first column, by turns in the others
    """
    rows, columns = np.indices(values.shape)
    turns = (rows if way == 0 else 0) + columns + (way - 1) % 2 * (way > 0)
    return np.where(turns % 2 == 0, 1.0, -1.0) / (1 + (way - 1) // 2 if way else 1)
