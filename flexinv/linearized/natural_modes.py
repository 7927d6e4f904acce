"""Natural frequencies and mode shapes at a configuration, from the march's own tangent and lumped masses (`linearized.modes`)."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import ConvergenceError, InputError
from flexinv.linearized.modal_damping import resolve_damping_ratio
from flexinv.linearized.modes import (
    Modes,
    compute_frequency_rounding,
    compute_modes,
    compute_refined_modes,
    resolve_setup,
)
from flexinv.model.mechanism import Mechanism
from flexinv.validation import check_seconds

# Finer meshes that are tried for an accuracy, and unknowns beyond which none is.
MOST_REFINEMENTS = 8
MOST_UNKNOWNS = 50_000


def natural_modes(
    mechanism: Mechanism,
    q: ArrayLike | None = None,
    free: Collection[str] | None = None,
    count: int | None = None,
    accuracy: float | None = None,
) -> Modes:
    """Return natural frequencies [Hz] and mode shapes at rest under gravity, joints clamped at ``q`` but for the free ones.

    q : (nq,) [rad], [m], zero by default; in a loop drives stay there, and for the other joints it is the guess
    free : names of joints that move freely about ``q``; by default none in a tree, and in a loop those without a drive
    count : number of modes; by default all of up to 1,000 freedoms, the 30 slowest of more (a ModelWarning says so)
    accuracy : largest ``frequency_error`` as a part of each frequency [-]: the mesh is refined until it is kept; needs a count
    Raises InputError for unknown joints and where nothing can move, ConvergenceError where no rest position is found, where
    the accuracy is not reached, or where a mode under loads that turn along is lost.
    """
    if accuracy is not None:
        if count is None:
            raise InputError("natural_modes: accuracy needs a count, as the fastest modes of a mesh are none of a beam")
        limit = check_seconds("accuracy", accuracy, "a part of each frequency above 0 [-], for example 1e-3")
        return _find_accurate_modes(natural_modes(mechanism, q, free, count), limit)
    setup = resolve_setup(resolve_damping_ratio(mechanism), q, free, count)
    return compute_modes(*setup, count)


def _find_accurate_modes(modes: Modes, limit: float) -> Modes:
    """The modes of the first of the finer meshes of which error bars keep a limit, part of each frequency [-].

    Raises ConvergenceError where none does.
    """
    for _ in range(MOST_REFINEMENTS):
        frequency = np.where(
            modes.frequency > 0.0, modes.frequency, np.inf
        )  # of rigid motions and divergence none is asked
        part = modes.frequency_error / frequency
        rounded = compute_frequency_rounding(modes) / frequency
        if not (part > limit).any():
            return modes
        hopeless = bool((rounded > limit).any())
        if hopeless or modes.mesh.mechanism.is_rigid or 6 * modes.mesh.size > MOST_UNKNOWNS:
            break
        modes = compute_refined_modes(modes)
    missed = rounded if hopeless else part
    worst = int(np.nanargmax(missed))
    why = "rounding leaves no more" if hopeless else f"with {modes.mesh.size} nodes"
    raise ConvergenceError(
        f"natural_modes: accuracy {limit:g} is not reached: mode {worst + 1}, {modes.frequency[worst]:.6g} Hz, is known to "
        f"{missed[worst]:.2g} of itself, {why}; write a larger accuracy or a smaller count"
    )
