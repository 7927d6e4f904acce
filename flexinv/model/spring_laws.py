"""Laws of springs between points that are not linear: a gas that is compressed, and a table of force over length.

Both give the pull, positive where the spring draws its ends together, and its slope.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for: reading a mechanism needs none
from numpy.typing import ArrayLike

from flexinv.model.links import Frozen
from flexinv.typing import Array


@dataclass(frozen=True)
class GasLaw:
    """A polytropic gas behind a piston:  pull = force / (1 - (l - rest) / travel)^exponent.

    force : pull at the length ``rest`` of the spring [N]; travel : volume of the gas there over the piston's area [m]
    exponent : [-], 1 isothermal, 1.4 adiabatic (nitrogen); a strut that pushes has force and travel below zero
    """

    force: float
    travel: float
    exponent: float = 1.0

    def pull(self, length: ArrayLike, rest: float) -> Array:
        """Return the pull [N] at lengths [m] (any shape)."""
        left = 1.0 - (np.asarray(length, dtype=np.float64) - rest) / self.travel
        return np.asarray(self.force * left**-self.exponent)

    def slope(self, length: ArrayLike, rest: float) -> Array:
        """Return the derivative of the pull by the length [N/m] at lengths [m] (any shape)."""
        left = 1.0 - (np.asarray(length, dtype=np.float64) - rest) / self.travel
        return np.asarray(self.force * self.exponent / self.travel * left ** (-self.exponent - 1.0))

    def scaled(self, factor: float) -> GasLaw:
        """Return the law with all forces times a factor [-]."""
        return replace(self, force=self.force * factor)


@dataclass(frozen=True)
class TableLaw(Frozen):
    """A table of pull over length, between its rows by monotone cubics (Fritsch and Carlson), beyond its ends straight.

    length : (rows,) [m], increasing; force : (rows,) [N], the pull there
    """

    length: Array
    force: Array

    def pieces(self) -> Array:
        """Return start [m] and coefficients of falling powers of l - start [N/m^3], [N/m^2], [N/m], [N], (rows + 1, 5)."""
        inner = scipy.interpolate.PchipInterpolator(self.length, self.force)
        ends = inner.derivative()(self.length[[0, -1]])
        before = [-np.inf, 0.0, 0.0, ends[0], self.force[0]]
        after = [self.length[-1], 0.0, 0.0, ends[1], self.force[-1]]
        return np.vstack([before, np.column_stack([self.length[:-1], inner.c.T]), after])

    def _piece(self, length: ArrayLike) -> tuple[Array, Array]:
        table, at = self.pieces(), np.asarray(length, dtype=np.float64)
        piece = table[np.clip(np.searchsorted(table[:, 0], at, side="right") - 1, 0, len(table) - 1)]
        start = np.where(np.isfinite(piece[..., 0]), piece[..., 0], self.length[0])
        return piece[..., 1:], at - start

    def pull(self, length: ArrayLike, rest: float) -> Array:
        """Return the pull [N] at lengths [m] (any shape); the table's lengths are whole ones, ``rest`` has no part in it."""
        c, x = self._piece(length)
        return np.asarray(((c[..., 0] * x + c[..., 1]) * x + c[..., 2]) * x + c[..., 3])

    def slope(self, length: ArrayLike, rest: float) -> Array:
        """Return the derivative of the pull by the length [N/m] at lengths [m] (any shape)."""
        c, x = self._piece(length)
        return np.asarray((3.0 * c[..., 0] * x + 2.0 * c[..., 1]) * x + c[..., 2])

    def scaled(self, factor: float) -> TableLaw:
        """Return the law with all forces times a factor [-]."""
        return TableLaw(self.length, self.force * factor)


Law = GasLaw | TableLaw
