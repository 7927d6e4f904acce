"""The four-bar with links that bend, and its rigid twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from flexible_examples import STRIP
from four_bar_example import four_bar

from flexinv.model.mechanism import Attachment, Beam, Body, Inertia, Link, Mechanism, Placement


def bending(stiffer: float = 1.0, kind: str = "revolute", elements: int = 1, order: int = 4) -> Mechanism:
    """The four-bar with a strip of 0.5 m as its coupler."""
    section = replace(STRIP, stiffness=stiffer * STRIP.stiffness)
    coupler = Link("coupler", (), Beam(0.5, section, elements, order))
    m = four_bar(kind=kind)
    closure = replace(m.closures[0], first=Attachment("coupler", Placement(), 1.0))
    return replace(m, links=(m.links[0], coupler, m.links[2]), closures=(closure,))


def rigid_twin() -> Mechanism:
    m = four_bar()
    inertia = Inertia(0.028, np.array([0.25, 0, 0]), np.diag([1e-6, 0.028 * 0.25 / 12, 0.028 * 0.25 / 12]))
    return replace(m, links=(m.links[0], Link("coupler", (Body("strip", inertia),)), m.links[2]))
