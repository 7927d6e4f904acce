"""Frames of a mechanism: placements of one frame in another, and attachment points on links."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from flexinv.model.frozen import Frozen
from flexinv.typing import Array

WORLD = "world"


@dataclass(frozen=True)
class Placement(Frozen):
    """A frame B in a frame A: ``x_A = position + rotation @ x_B``.

    position : (3,) [m]; rotation : (3, 3) [-], R_AB
    """

    position: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Attachment:
    """A frame on a link (or on the world): ``placement`` in the link frame, or in a beam's section at ``station``."""

    link: str
    placement: Placement = field(default_factory=Placement)
    station: float | None = None
