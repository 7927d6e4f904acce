"""One beam element far from its stress-free shape, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from kernels import element

from flexinv.elements.beam import Scratch
from flexinv.elements.beam_element import Elements
from flexinv.elements.quadrature import build_reference
from flexinv.kernels.so3 import exp_so3
from flexinv.typing import Array

EPS = np.finfo(float).eps


@dataclass(frozen=True)
class Example:
    """One element with a curved, twisted stress-free shape, far from it: stretched, bent and sheared in space."""

    arrays: Elements
    x: Array
    r: Array


def couplings(order: int, seed: int) -> Array:
    """Symmetric couplings (1, points, 6, 6) without a diagonal, so small that stiffnesses from 0.5 on stay positive definite."""
    dice = np.random.default_rng(seed).uniform(-1.0, 1.0, size=(1, order, 6, 6))
    return np.asarray(0.04 * (dice + dice.swapaxes(2, 3)) * (1.0 - np.eye(6)))


def example(order: int, coupled: bool = False) -> Example:
    rng, ref, half = np.random.default_rng(order), build_reference(order), 1.0
    count = order + 1
    arrays = Elements(
        order=np.array([order]),
        nodes=np.arange(count)[None],
        shape=ref.shape[None].copy(),
        slope=ref.slope[None] / half,
        weight=ref.point_weights[None] * half,
        stiffness=rng.uniform(1.0, 3.0, size=(1, order, 6)),
        damping=np.zeros((0, order, 6)),
        coupling=couplings(order, order) if coupled else np.zeros((0, order, 6, 6)),
        damping_coupling=np.zeros((1 if coupled else 0, order, 6, 6)),
        gamma0=np.array([1.0, 0.0, 0.0]) + 0.1 * rng.normal(size=(1, order, 3)),
        kappa0=0.3 * rng.normal(size=(1, order, 3)),
        station=np.zeros((1, order)),
        link=np.zeros(1, dtype=np.int64),
    )
    x = np.outer(ref.nodes + 1, [half, 0.0, 0.0]) + 0.2 * rng.normal(size=(count, 3))
    turns = np.cumsum(0.3 * rng.normal(size=(count, 3)), axis=0)
    return Example(arrays, x, exp_so3(np.array([0.4, -0.8, 0.3])) @ exp_so3(turns))


def evaluated(case: Example) -> tuple[float, Array, Array]:
    """Energy, nodal forces (6 count,) and tangent (6 count, 6 count)."""
    count = len(case.x)
    scratch, tangent = Scratch.build_for(count), np.zeros((6 * count, 6 * count))
    scratch.x[:], scratch.r[:] = case.x, case.r
    energy = element(0, count, case.arrays, scratch, np.zeros((count - 1, 6)), tangent)
    return energy, scratch.forces.ravel(), tangent
