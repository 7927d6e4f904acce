"""Plan of the library of a mechanism's inverse dynamics, rigid or with beams, from what a caller states of its start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.export.flexible.flexible_plan import MarchSettings, plan_flexible_library
from flexinv.export.library_plan import LibraryPlan
from flexinv.export.names import LIBRARY_PREFIX, make_word
from flexinv.export.rigid.rigid_plan import plan_rigid_library
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import check_finite_array, check_seconds


@dataclass(frozen=True)
class StartRequest:
    """Steps and start as a caller states them, not yet checked: see `flexible_plan.MarchSettings`; None where nothing is said."""

    step: float | None = None
    start: ArrayLike | None = None
    initial: str = "static"
    spectral_radius: float = 0.8
    payloads: tuple[str, ...] = ()


def make_library_name(mechanism: Mechanism) -> str:
    """Return the word that all names of a mechanism's library begin with [-]."""
    return LIBRARY_PREFIX + make_word(mechanism.name).lower()


def plan_inverse_library(mechanism: Mechanism, prefix: str, stated: StartRequest) -> LibraryPlan:
    """Return the library [N m], [N] of a mechanism, whose names begin with ``prefix``; InputError for what cannot be."""
    beginning = check_start_position(mechanism, stated.start)
    if mechanism.is_rigid:
        _check_stateless(mechanism, stated)
        return plan_rigid_library(mechanism, prefix, None if stated.start is None else beginning)
    time = check_march_step(mechanism, stated.step)
    settings = MarchSettings(time, beginning, stated.initial, stated.spectral_radius, stated.payloads)
    return plan_flexible_library(mechanism, prefix, settings)


def _check_stateless(mechanism: Mechanism, stated: StartRequest) -> None:
    """Refuse what is said of time of a rigid mechanism, and of a start where it has no loops to close."""
    if stated.payloads:
        raise InputError(f"export: mechanism {mechanism.name!r} is rigid: any link takes a payload; leave out payloads")
    if stated.step is not None or (stated.start is not None and not mechanism.closures):
        raise InputError(f"export: mechanism {mechanism.name!r} is rigid and has no state; leave out step and start")


def check_march_step(mechanism: Mechanism, step: float | None) -> float:
    """Return the time between two calls [s]; InputError where none is stated or none can be."""
    if step is None:
        raise InputError(
            f"export: mechanism {mechanism.name!r} is marched, and its motion carried on from call to call; write step = "
            "the time between two calls in seconds, for example step=5e-4 (--step 5e-4)"
        )
    return check_seconds("step", step, "the time between two calls in seconds, for example step=5e-4")


def check_start_position(mechanism: Mechanism, start: ArrayLike | None) -> Array:
    """Return the position (nq,) in which a mechanism begins [rad], [m], the neutral one where nothing is said."""
    if start is None:
        return mechanism.neutral
    return np.array(check_finite_array("start", start, (mechanism.nq,), "rad, m"))
