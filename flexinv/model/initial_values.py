"""Initial values of joints without a motion: the arguments ``start`` and ``start_rate`` of a call."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.splines import unit_quaternions
from flexinv.typing import Array
from flexinv.validation import shown, table


def start_coordinates(
    mechanism: Mechanism,
    passive: set[str],
    start: Mapping[str, ArrayLike] | None,
    rate: Mapping[str, ArrayLike] | None = None,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return initial coordinates (nq,) [rad], [m] and rates (nv,) [1/s] by joint; of a continuous joint an angle is enough.

    Raises InputError for a joint that is not ``passive`` and for numbers that are none or too many.
    """
    start = table("start", start, "a table of joints and their coordinates", 'start={"joint": 0.1}')
    rate = table("start_rate", rate, "a table of joints and their rates", 'start_rate={"joint": 0.1}')
    for label, given in (("start", start), ("start_rate", rate)):
        for name in given:
            if name not in passive:
                raise InputError(
                    f"{label}: joint {name!r} is not passive here (passive: {', '.join(sorted(passive)) or 'none'}); "
                    "only unactuated joints that the motion leaves out take a start"
                )
    places = {name: _start_place(mechanism.joint_of[name], value) for name, value in start.items()}
    rates = {name: _numbers("start_rate", name, value, (mechanism.joint_of[name].nv,)) for name, value in rate.items()}
    return places, rates


def _start_place(joint: Joint, value: ArrayLike) -> Array:
    """Coordinates (nq,) at which a passive joint starts; of a continuous joint an angle is enough."""
    where = f"start: joint {joint.name!r}"
    if KINDS[joint.kind].circle:
        place = _numbers("start", joint.name, value, (1, 2))
        return np.array([np.cos(place[0]), np.sin(place[0])]) if place.size == 1 else place
    place = _numbers("start", joint.name, value, (joint.nq,))
    if KINDS[joint.kind].has_quaternion:
        place[-4:] = unit_quaternions(place[-4:], where)
    return place


def _numbers(label: str, name: str, value: ArrayLike, counts: tuple[int, ...]) -> Array:
    try:
        numbers = np.atleast_1d(np.array(value, dtype=float))
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.ndim != 1 or numbers.size not in counts or not np.isfinite(numbers).all():
        wanted = " or ".join(map(str, counts))
        raise InputError(
            f"{label}: joint {name!r} takes {wanted} finite number{'s' * (counts != (1,))}, got {shown(value)}"
        )
    return numbers
