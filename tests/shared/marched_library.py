"""Steps of an exported library with beams, and of `Controller`, through one smooth motion from rest."""

from __future__ import annotations

import numpy as np
from c_library import Block

import flexinv
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

STEP = 2e-3  # [s]
Rows = list[tuple[Array, Array, Array]]


def swing(mechanism: Mechanism, start: Array, way: float = 0.15, steps: int = 50) -> Rows:
    """Driven joints turn by twice the way and come back, smoothly, from rest."""
    t = np.arange(1, steps + 1)[:, None] * STEP
    w = 2 * np.pi / (steps * STEP)
    moved = way * mechanism.actuated
    parts = start + moved * (1 - np.cos(w * t)), moved * w * np.sin(w * t), moved * w * w * np.cos(w * t)
    return [tuple(np.ascontiguousarray(part[k]) for part in parts) for k in range(steps)]  # type: ignore[misc]


def stepped(block: Block, rows: Rows) -> Array:
    tau = np.zeros((len(rows), len(rows[0][1])))
    for now, out in zip(rows, tau, strict=True):
        assert block.call("step", *now, out) == "OK"
    return tau


def controlled(mechanism: Mechanism, start: Array, rows: Rows) -> Array:
    controller = flexinv.Controller.of(mechanism, step=STEP)
    still = np.zeros(mechanism.nv)
    controller.start(start, still, still, initial="static")
    return np.array([controller.step(*now).copy() for now in rows])
