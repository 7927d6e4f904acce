"""Payloads as nodes of their own: bodies without mass, a hair's breadth beside the frames of links, which a library loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexinv.errors import InputError
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism
from flexinv.validation import find_nearest_word

PAYLOAD = "payload of the C library"
NEXT_TO_IT = np.array(
    [1e-300, 0.0, 0.0]
)  # [m]: a place that is another one than the link's, and whose coordinates are zero


def add_payload_bodies(mechanism: Mechanism, links: Sequence[str]) -> Mechanism:
    """Return a mechanism with a body without mass [kg] on each of some links, of a beam at its tip; InputError for others."""
    for name in links:
        if name not in mechanism.link_of:
            write = find_nearest_word(name, mechanism.link_of) or next(iter(mechanism.link_of))
            raise InputError(f"export: payloads: there is no link {name!r}; write payloads=({write!r},)")
        station = None if mechanism.link_of[name].beam is None else 1.0
        mechanism = mechanism.with_body(name, Body(PAYLOAD, Inertia(0.0, NEXT_TO_IT), station))
    return mechanism
