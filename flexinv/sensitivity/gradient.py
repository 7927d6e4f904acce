"""Gradient: derivatives of one number by parameters, as `find_gradient` returns them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexinv.analysis.solution import Solution
from flexinv.model.by_value import ByValue
from flexinv.typing import Array

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class Gradient(ByValue):
    """Derivatives of one number by parameters.

    solution : where they are taken; parameters : names; values : (parameters,) where they stand
    gradient : (parameters,) in the unit of the number over that of each parameter
    """

    solution: Solution
    parameters: tuple[str, ...]
    values: Array
    gradient: Array

    def frame(self) -> pd.DataFrame:
        """Return the derivatives [any unit], a row for each parameter."""
        import pandas

        index = pandas.Index(self.parameters, name="by")
        return pandas.DataFrame({"value": self.values, "gradient": self.gradient}, index=index)

    def __repr__(self) -> str:
        """Return the largest derivatives in a line."""
        order = np.argsort(-np.abs(self.gradient))[:3]
        largest = ", ".join(f"{self.parameters[k]} {self.gradient[k]:.4g}" for k in order)
        return f"Gradient({len(self.parameters)} parameters; largest: {largest})"
