"""Derivatives of the start of a march: differences of starts whose mechanism or motion lies beside the present one.

An equilibrium is found by iteration, and its places are known to rounding.  Over a change of a parameter, and times the stiffness
of a beam along its axis, that is much of a force: the widest change is taken at which the start is still a polynomial.  Loops are
closed to the last digit; near singular positions their start depends on a number in a narrow curve, and a small change is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from flexinv.errors import ConvergenceError, InputError
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.sensitivity.march_start import MarchStart, compute_start_offsets
from flexinv.sensitivity.march_states import FreeSystem
from flexinv.sensitivity.parameters import TWO_SIDED, Parameter, ParameterVariation, VariedSetup, build_differences
from flexinv.typing import Array, Indices, Mask

WIDE_CHANGE = 10.0  # of the usual change of a number
NARROW_CHANGE = 0.2
CURVED = 3e-9  # of a start's derivative: what differs by more is a curve, not rounding
SAME_START = 1e-12  # of what a parameter does to the joints at the start: what others do not make up
LAST_DIGITS = 10.0  # times the last digit of a length over the change of a number: so far a place is known


class StartSlopes:
    """Derivatives of a start by parameters.

    begin : setup -> start; base : the present start; given : (nv,) mask of joints with a motion
    static, closed : whether it is an equilibrium, and whether it closes loops
    """

    def __init__(
        self,
        begin: Callable[[VariedSetup], MarchStart],
        base: MarchStart,
        system: FreeSystem,
        given: Mask,
        static: bool,
        closed: bool,
    ) -> None:
        """Record where the start stands."""
        self.begin = begin
        self.base = base
        self.system = system
        self.given = given
        self.static = static
        self.closed = closed

    def differentiate(self, parameter: Parameter, mechanism: Mechanism, motion: Motion) -> tuple[Array, Array]:
        """Return the derivatives (4, unknowns) of the start, and (joints,) of its efforts of joints with a motion [any unit].

        Rows: pose, rate, acceleration, and the integrator's own one.
        Raises InputError where a small change of the parameter makes a start sudden, or not.
        """
        usual = build_differences(parameter, mechanism, motion)
        starts = [self.begin(setup) for setup in usual.setups]
        found = self._join_starts(parameter, usual, starts)
        if self.static:
            wider = self._compute_wider(parameter, mechanism, motion)
            if wider is not None and _compute_distance(wider, found) <= self._compute_rounding(usual):
                return wider
        if self.closed:
            rough = self._join_starts(parameter, usual.take_lower_order(), starts)
            if _compute_distance(found, rough) > CURVED * np.abs(found[0][0]).max(initial=0.0):
                return self._compute(parameter, build_differences(parameter, mechanism, motion, NARROW_CHANGE))
        return found

    def find_linear_slopes(self, parameter: Parameter, mechanism: Mechanism, motion: Motion) -> tuple[Array, Array]:
        """Return the same derivatives [any unit] by a parameter of the accelerations at the start alone.

        Poses and rates stay, and accelerations and forces are linear in what is given: two starts tell all of it.
        """
        return self._compute(parameter, build_differences(parameter, mechanism, motion, central=TWO_SIDED))

    def _compute_wider(self, parameter: Parameter, mechanism: Mechanism, motion: Motion) -> tuple[Array, Array] | None:
        """The derivatives by a wide change; None where a number cannot be so far away, or the start is of another kind there."""
        try:
            return self._compute(parameter, build_differences(parameter, mechanism, motion, WIDE_CHANGE))
        except (InputError, ConvergenceError):
            return None

    def _compute(self, parameter: Parameter, variation: ParameterVariation) -> tuple[Array, Array]:
        """The derivatives by differences of starts."""
        return self._join_starts(parameter, variation, [self.begin(setup) for setup in variation.setups])

    def _join_starts(
        self, parameter: Parameter, variation: ParameterVariation, starts: Sequence[MarchStart]
    ) -> tuple[Array, Array]:
        """The derivatives from starts at the setups of a variation."""
        if any(start.sudden != self.base.sudden for start in starts):
            raise InputError(
                f"differentiate: by {parameter.name!r}: a small change makes the start of the march sudden, so that "
                "its first steps are others; write another step, or initial = 'static'"
            )
        found = variation.join_results(compute_start_offsets(start, self.base, self.system) for start in starts)
        return found, variation.join_results(start.effort[self.given] for start in starts)

    def _compute_rounding(self, variation: ParameterVariation) -> float:
        """By how much derivatives of places may be off by rounding alone [m per unit]."""
        change = min(abs(offset) for offset in variation.offsets if offset)
        return LAST_DIGITS * float(np.finfo(float).eps) * self.system.mesh.length / change


def _compute_distance(one: tuple[Array, Array], other: tuple[Array, Array]) -> float:
    """By how much the poses of two derivatives differ [m], [rad] per unit."""
    return float(np.abs(one[0][0] - other[0][0]).max(initial=0.0))


def find_start_basis(given: Array) -> tuple[Indices, Array]:
    """Return the parameters of a motion of which all others are sums at the start: columns, and shares (basis, parameters) [-].

    given : (3, joints, parameters) derivatives of the joints with a motion at the start, their rates and accelerations
    The start is a function of these alone, so that its derivative by any parameter is a sum of derivatives by a few.
    """
    table = given.reshape(given.shape[0] * given.shape[1], given.shape[2])
    largest = np.abs(table).max(axis=1, initial=0.0)
    table = table[largest > 0.0] / largest[largest > 0.0, None]
    left = table.copy()
    basis = list[int]()
    while (size := np.sqrt((left**2).sum(axis=0))).max(initial=0.0) > SAME_START:
        basis.append(int(size.argmax()))
        direction = left[:, basis[-1]] / size.max()
        left -= np.outer(direction, direction @ left)
    columns = np.array(basis, dtype=np.int64)
    shares = np.linalg.lstsq(table[:, columns], table)[0] if basis else np.zeros((0, table.shape[1]))
    return columns, shares
