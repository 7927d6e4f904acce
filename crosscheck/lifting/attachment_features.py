"""Springs between points and given forces as features: efforts feel them, and the comparison of trees does not know them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from crosscheck.lifting.reader_dynamics import Feature, Parameter


def list_force_features(springs: Any, forces: Any) -> Iterator[Feature]:
    """Yield the features of springs [N/m], [m], [N s/m] and forces [N], [N m], of a mechanism or of a case kit."""
    for spring in springs:
        numbers: dict[str, Parameter] = {
            "stiffness": float(spring.stiffness), "rest": float(spring.rest), "damping": float(spring.damping),
            **_end("first", spring.first), **_end("second", spring.second),
        }  # fmt: skip
        if spring.law is not None:
            numbers |= {f"law {key}": _convert_to_tuple(value) for key, value in _list_law_numbers(spring.law)}
        yield Feature("spring", f"spring {spring.name}", numbers, felt=False)
    for force in forces:
        numbers = {
            "time": _convert_to_tuple(force.time),
            "wrench": _convert_to_tuple(force.wrench),
            "follower": float(force.follower),
        }
        yield Feature("force", f"force {force.name}", numbers | _end("at", force.at), felt=False)


def _list_law_numbers(law: Any) -> Iterator[tuple[str, Any]]:
    """Numbers of a law that is not linear; a kit says its kind beside, and leaves out what it has not."""
    named = law if isinstance(law, dict) else vars(law)
    for key, value in named.items():
        if not isinstance(value, str | type(None)):
            yield key, value


def _end(name: str, end: Any) -> dict[str, Parameter]:
    placement = end.placement if hasattr(end, "placement") else end.frame
    numbers: dict[str, Parameter] = {
        f"{name} link": str(end.link),
        f"{name} point": _convert_to_tuple(placement.position),
    }
    numbers[f"{name} axes"] = _convert_to_tuple(placement.rotation)
    if end.station is not None:
        numbers[f"{name} station"] = float(end.station)
    return numbers


def _convert_to_tuple(values: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in np.ravel(values))
