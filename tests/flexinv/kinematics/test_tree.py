"""The walk along the tree: its variation is the derivative of the motion, for prescribed and passive joints of all kinds."""

from __future__ import annotations

import numpy as np
import pytest
from kernels import DIFFERENCE, derivative
from scenes import PASSIVE_KINDS, MovingSolver, branching, hanging, scene

from flexinv.kinematics.tree import Frames
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

MECHANISMS = [*(branching(kind) for kind in PASSIVE_KINDS), *(hanging(kind) for kind in PASSIVE_KINDS)]


def stacked(frames: Frames) -> Array:
    """All parts of the motion, (nodes, 6 parts, 3, 3): vectors in the first column."""
    columns = [part[:, :, None] * [1.0, 0.0, 0.0] for part in (frames.x, frames.v, frames.w, frames.a, frames.al)]
    return np.stack([*columns, frames.r], axis=1)


def by_differences(case: MovingSolver, direction: Array) -> list[Array]:
    """Derivatives of x, t, v, w, a, al, (nodes, 3) each, along one unknown."""
    rotation = case.at(direction, 0.0)[0].r
    slope = derivative(lambda h: stacked(case.at(direction, h)[0]))
    x, v, w, a, al = (slope[:, k, :, 0] for k in range(5))
    spin = np.swapaxes(rotation, 1, 2) @ slope[:, 5]
    return [x, np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1), v, w, a, al]


def worst_error(case: MovingSolver, spoilt: int | None = None) -> float:
    """Largest difference, over all unknowns and nodes, of the variation from differences, relative to the largest entry.

    spoilt : part of the variation (x, t, v, w, a, al) of which one entry is made wrong by 1e-9 of the largest
    """
    t, d = case.solver.topology, case.solver.variation
    none = np.zeros(len(case.d))
    case.at(none, 0.0)
    exact = [part.copy() for part in d]
    size = max(float(np.abs(part).max()) for part in exact)
    if spoilt is not None:
        exact[spoilt][-1, 0, 1] += 1e-9 * size
    worst = 0.0
    for block, (offset, columns) in enumerate(zip(t.offset, t.size, strict=True)):
        for column in range(columns):
            direction = none.copy()
            direction[offset + column] = 1.0
            own = (t.block == block)[:, None]
            for part, slope in zip(exact, by_differences(case, direction), strict=True):
                worst = max(worst, float(np.abs(slope - own * part[:, column]).max()))
    return worst / size


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda m: m.name)
def test_variation_is_the_derivative_of_the_motion(mechanism: Mechanism) -> None:
    assert worst_error(scene(mechanism)) < DIFFERENCE


@pytest.mark.parametrize("part", range(6))
def test_one_wrong_entry_of_the_variation_is_found(part: int) -> None:
    assert worst_error(scene(branching("spherical")), spoilt=part) > DIFFERENCE
