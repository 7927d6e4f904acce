"""Statements of a file on its links and on what carries them, whatever its format."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.model.mechanism import Inertia, Placement


@dataclass(frozen=True)
class LinkStatements:
    """Statements of a file on one link: inertia along its axes; moves: a joint with a freedom carries it; written: it has one."""

    name: str
    inertia: Inertia
    moves: bool
    written: bool = True


@dataclass(frozen=True)
class Mounting:
    """State of a link's mounting by a joint: the child's frame in the parent's, where the joint is at zero [m]."""

    parent: str
    child: str
    placement: Placement


def describe_moments(body: Inertia) -> str:
    """Return the principal moments of a body in words [kg m^2]."""
    moments = np.linalg.eigvalsh((body.tensor + body.tensor.T) / 2)
    return "principal moments " + " ".join(f"{p:.4g}" for p in moments) + " kg m^2"
