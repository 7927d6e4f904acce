"""differentiate_modes: derivatives of natural frequencies by numbers of a mechanism.

A mode is a zero of  K phi - omega^2 M phi - G^T mu,  G phi = 0.  Multiplied by phi, what its shape changes by drops out:

    d(omega^2)/dp = phi^T (dK/dp - omega^2 dM/dp) phi - 2 mu^T dG/dp phi,      phi^T M phi = 1

K, M and G beside the present mechanism are those at its own rest position; their derivatives are differences of sixth order.
Source: Fox and Kapoor, Rates of change of eigenvalues and eigenvectors, AIAA Journal 6 (1968) 2426.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from flexinv.dynamics.solver import Solver
from flexinv.errors import InputError
from flexinv.linearized.closed_motions import count_constraints, find_allowed_motions
from flexinv.linearized.eigenvalues import is_symmetric
from flexinv.linearized.modal_damping import resolve_damping_ratio
from flexinv.linearized.modes import Modes, compute_modes, find_free_modes, resolve_setup
from flexinv.linearized.rest_position import compute_rest_matrices, find_rest_position
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.sensitivity.parameters import Parameter, build_differences, resolve_parameters
from flexinv.typing import Array, Sparse
from flexinv.validation import check_kind

if TYPE_CHECKING:
    import pandas as pd

DOUBLE = 1e-6  # of omega^2: modes that are nearer have no shapes of their own


@dataclass(frozen=True, eq=False, repr=False)
class ModeSlopes(ByValue):
    """Derivatives of natural frequencies by parameters.

    modes : where they are taken; parameters : names; values : (parameters,) where they stand
    squared : (modes, parameters) of omega^2 [1/s^2] per unit
    """

    modes: Modes
    parameters: tuple[str, ...]
    values: Array
    squared: Array

    @property
    def frequency(self) -> Array:
        """(modes, parameters) derivatives of the frequencies [Hz] per unit; nan of modes that do not swing."""
        swings = self.modes.squared.real > 0.0
        rate = np.sqrt(np.where(swings, self.modes.squared.real, np.nan))
        return np.asarray(self.squared / (4.0 * np.pi * rate)[:, None])

    def frame(self) -> pd.DataFrame:
        """Return the derivatives of the frequencies [Hz] per unit, a row for each mode, a column for each parameter."""
        import pandas

        index = pandas.Index(self.modes.frequency, name="frequency [Hz]")
        return pandas.DataFrame(self.frequency, index=index, columns=list(self.parameters))

    def __repr__(self) -> str:
        """Return modes and parameters in a line."""
        return f"ModeSlopes({len(self.squared)} modes by {', '.join(self.parameters)})"


def differentiate_modes(
    mechanism: Mechanism, by: str | Parameter | Iterable[str | Parameter], q: ArrayLike | None = None,
    free: Collection[str] | None = None, count: int | None = None,
) -> ModeSlopes:  # fmt: skip
    """Return the derivatives of the natural frequencies [Hz] of a mechanism by its numbers, rest positions included.

    by : as of `differentiate`, numbers of the mechanism; q, free, count : as of `natural_modes`
    Raises InputError and ConvergenceError as `natural_modes`, and InputError for parameters that are none, for modes at one
    frequency, and where loads turn along with a link, so that K is not symmetric.
    """
    check_kind("mechanism", mechanism, Mechanism)
    still = Motion.point_to_point({}, {}, duration=1.0)
    for name in [by] if isinstance(by, str) else by if isinstance(by, Iterable) else ():
        if isinstance(name, str) and name.startswith("motion."):
            raise InputError(f"by: {name!r}: expected a number of the mechanism, for example 'links.NAME.beam.length'")
    parameters = resolve_parameters(by, mechanism, still)
    setup = resolve_setup(resolve_damping_ratio(mechanism), q, free, count)
    modes = compute_modes(*setup, count)
    squared = modes.squared.real
    here = _collect_matrices(mechanism, q, free, count)
    _check_modes(mechanism, here, squared)
    shapes = find_free_modes(here.stiffness, here.mass, find_allowed_motions(here.solver), count)[1][:, : len(squared)]
    left = here.stiffness @ shapes - (here.mass @ shapes) * squared
    scale = here.solver.topology.scale[:, None]
    multiplier = np.linalg.lstsq((here.gradient.T * scale), left * scale)[0]
    columns = []
    for parameter in parameters:
        variation = build_differences(parameter, mechanism, still)
        beside = (_collect_matrices(one, q, free, count) for one, _ in variation.setups)
        columns.append(variation.join_results(_compute_products(one, shapes, squared, multiplier) for one in beside))
    names = tuple(parameter.name for parameter in parameters)
    values = np.array([parameter.value for parameter in parameters], dtype=float)
    return ModeSlopes(modes, names, values, np.stack(columns, axis=1))


@dataclass(frozen=True)
class _RestMatrices:
    """K [N/m], M [kg] and G [-] of a mechanism at rest."""

    solver: Solver
    stiffness: Sparse
    mass: Sparse
    gradient: Array


def _collect_matrices(
    mechanism: Mechanism, q: ArrayLike | None, free: Collection[str] | None, count: int | None
) -> _RestMatrices:
    mesh, at, moving = resolve_setup(resolve_damping_ratio(mechanism), q, free, count)
    solver = Solver.build_for(mesh, set(moving))
    mass, _, stiffness = compute_rest_matrices(solver, find_rest_position(solver, at)[0])
    rows = count_constraints(solver)
    return _RestMatrices(solver, stiffness, mass, -solver.border.ties.sides[:rows].copy())


def _compute_products(beside: _RestMatrices, shapes: Array, squared: Array, multiplier: Array) -> Array:
    """phi^T (K - omega^2 M) phi - 2 mu^T G phi of each mode (modes,)."""
    left = beside.stiffness @ shapes - (beside.mass @ shapes) * squared
    closed = np.einsum("rm,rm->m", multiplier, beside.gradient @ shapes)
    return np.asarray(np.einsum("um,um->m", shapes, left) - 2.0 * closed)


def _check_modes(mechanism: Mechanism, here: _RestMatrices, squared: Array) -> None:
    """Raise InputError for modes at one frequency, and a K that is not symmetric."""
    if not is_symmetric(here.stiffness):
        raise InputError(
            f"differentiate_modes: loads on '{mechanism.name}' turn along with a link, so that its stiffness is not symmetric; "
            "take differences of flexinv.natural_modes"
        )
    gaps = np.diff(squared)
    near = np.flatnonzero(gaps <= DOUBLE * np.abs(squared[1:]))
    if len(near):
        first = int(near[0]) + 1
        raise InputError(
            f"differentiate_modes: modes {first} and {first + 1} of '{mechanism.name}' have one frequency, so that their shapes "
            "are not told; write a smaller count, or a section whose two bending stiffnesses differ"
        )
