"""The damped element: what it dissipates is Rayleigh's, rigid motions cost nothing, and its linearisation is exact."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from element_example import EPS, Example, couplings, evaluated, example
from kernels import DIFFERENCE, damped_element, derivative

from flexinv.elements.beam import Rates, Scratch
from flexinv.kernels.so3 import exp_so3
from flexinv.kinematics.tree import Variation
from flexinv.typing import Array

ORDERS = (1, 2, 4)


@dataclass(frozen=True)
class MovingElement:
    """An element in motion: poses, velocities (world) and angular velocities (own frames)."""

    at: Example
    v: Array
    w: Array


@dataclass(frozen=True)
class DampedForces:
    """Nodal forces (6 count,), their derivatives by poses and velocities, energy and dissipated power."""

    forces: Array
    by_pose: Array
    by_velocity: Array
    energy: float
    power: float


def moving(order: int, damping: float = 1.0, coupled: bool = False) -> MovingElement:
    case, rng = example(order, coupled), np.random.default_rng(order + 10)
    coefficients = damping * rng.uniform(0.5, 2.0, size=(1, order, 6))
    arrays = case.arrays._replace(damping=coefficients)
    if coupled:
        arrays = arrays._replace(damping_coupling=damping * couplings(order, order + 20))
    return MovingElement(replace(case, arrays=arrays), *rng.normal(size=(2, order + 1, 3)))


def seen(case: MovingElement) -> DampedForces:
    count = len(case.v)
    z, y, tangent = Scratch.build_for(count), Rates.build_for(count), np.zeros((6 * count, 6 * count + 6))
    z.x[:], z.r[:], y.v[:], y.w[:] = case.at.x, case.at.r, case.v, case.w
    at_rest = Variation(*(np.zeros((count, 6, 3)) for _ in range(6)))  # velocities do not follow the poses
    stored, gone = damped_element(
        0, count, case.at.arrays, z, y, np.arange(count), at_rest, np.zeros((count, 6)), tangent
    )
    return DampedForces(z.forces.ravel().copy(), tangent[:, : 6 * count], y.by_velocity, stored, gone)


def shifted(case: MovingElement, freedom: int, h: float) -> MovingElement:
    """The same velocities, one node moved (world) or turned (own frame)."""
    node, axis = divmod(freedom, 6)
    x, r = case.at.x.copy(), case.at.r.copy()
    if axis < 3:
        x[node, axis] += h
    else:
        r[node] = r[node] @ exp_so3(h * np.eye(3)[axis - 3])
    return replace(case, at=replace(case.at, x=x, r=r))


def hurried(case: MovingElement, freedom: int, h: float) -> MovingElement:
    node, axis = divmod(freedom, 6)
    v, w = case.v.copy(), case.w.copy()
    (v if axis < 3 else w)[node, axis % 3] += h
    return replace(case, v=v, w=w)


def rigid(case: MovingElement, turn: Array, slide: Array) -> MovingElement:
    """The same element with a rigid motion added to its velocities."""
    world = np.cross(turn, case.at.x) + slide
    return replace(case, v=case.v + world, w=case.w + np.einsum("nji,j->ni", case.at.r, turn))


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_forces_by_poses_and_velocities_are_exact(order: int, coupled: bool) -> None:
    case = moving(order, coupled=coupled)
    result = seen(case)
    for freedom in range(6 * order + 6):
        by_pose = derivative(lambda h, f=freedom: seen(shifted(case, f, h)).forces)  # type: ignore[misc]
        by_velocity = derivative(lambda h, f=freedom: seen(hurried(case, f, h)).forces)  # type: ignore[misc]
        # fifth derivatives grow with the slopes of the interpolation, up to order^2 / 2
        bar = DIFFERENCE * (1 + order**2) * np.abs(result.by_pose).max()
        np.testing.assert_allclose(result.by_pose[:, freedom], by_pose, rtol=0, atol=bar)
        np.testing.assert_allclose(result.by_velocity[:, freedom], by_velocity, rtol=0, atol=bar)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_power_of_the_forces_is_elastic_and_dissipated(order: int, coupled: bool) -> None:
    """P . v + Q . w = dE/dt + dissipation, the rate of the energy by a central difference along the motion."""
    case = moving(order, coupled=coupled)
    result, count = seen(case), order + 1
    given = result.forces @ np.concatenate([case.v, case.w], axis=1).ravel()

    def energy(h: float) -> Array:
        moved = replace(case.at, x=case.at.x + h * case.v, r=case.at.r @ exp_so3(h * case.w))
        return np.array(evaluated(moved)[0])

    bar = DIFFERENCE * (1 + order**2) * np.abs(result.by_pose).max() * count
    assert result.power > 0.1  # there is something to see
    assert given - result.power == pytest.approx(float(derivative(energy)), abs=bar)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_a_rigid_motion_of_a_bent_element_dissipates_nothing(order: int, coupled: bool) -> None:
    case = moving(order, coupled=coupled)
    turn, slide = np.array([3.0, -5.0, 4.0]), np.array([2.0, 1.0, -1.0])
    still = replace(case, v=np.zeros_like(case.v), w=np.zeros_like(case.w))
    turning, here = seen(rigid(still, turn, slide)), seen(still)
    # rates of strain are differences of velocities of size 20 by slopes of order^2 / 2; forces are those at rest
    rounding = 50 * EPS * 20 * (1 + order**2) * np.abs(here.by_pose).max()
    assert turning.power < rounding**2 * 10
    np.testing.assert_allclose(turning.forces, here.forces, rtol=0, atol=rounding)
    both, alone = seen(rigid(case, turn, slide)), seen(case)
    assert both.power == pytest.approx(alone.power, abs=rounding)
    np.testing.assert_allclose(both.forces, alone.forces, rtol=0, atol=rounding)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_forces_balance_and_velocities_act_symmetrically(order: int, coupled: bool) -> None:
    case = moving(order, coupled=coupled)
    result, rounding = seen(case), 100 * EPS * (1 + order**2)
    forces = result.forces.reshape(-1, 6)
    moments = np.einsum("nij,nj->ni", case.at.r, forces[:, 3:]) + np.cross(case.at.x, forces[:, :3])
    size = np.abs(forces).max()
    np.testing.assert_allclose(forces[:, :3].sum(axis=0), 0.0, atol=rounding * size)
    np.testing.assert_allclose(moments.sum(axis=0), 0.0, atol=rounding * size * 3)  # arms up to 3 m
    drag = result.by_velocity
    np.testing.assert_allclose(drag, drag.T, rtol=0, atol=rounding * np.abs(drag).max())
    assert np.linalg.eigvalsh(0.5 * (drag + drag.T)).min() > -rounding * np.abs(drag).max()


@pytest.mark.parametrize("order", ORDERS)
def test_without_coefficients_it_is_the_undamped_element(order: int) -> None:
    case = moving(order, damping=0.0)
    energy, forces, tangent = evaluated(case.at)
    result, rounding = seen(case), 100 * EPS * np.abs(tangent).max()
    assert (result.power, result.energy) == (0.0, pytest.approx(energy, rel=10 * EPS))
    np.testing.assert_allclose(result.forces, forces, rtol=0, atol=rounding)
    np.testing.assert_allclose(result.by_pose, tangent, rtol=0, atol=rounding)
    np.testing.assert_array_equal(result.by_velocity, 0.0)
