"""The element: forces are the gradient of its energy, the tangent is their derivative, rigid motions change nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from element_example import EPS, Example, evaluated, example
from kernels import DIFFERENCE, derivative

from flexinv.elements.quadrature import build_reference
from flexinv.kernels.so3 import exp_so3
from flexinv.typing import Array

ORDERS = (1, 2, 4)


def moved(case: Example, freedom: int, h: float) -> Example:
    """The element with one node moved along a world axis, or turned about one of its own axes."""
    node, axis = divmod(freedom, 6)
    x, r = case.x.copy(), case.r.copy()
    if axis < 3:
        x[node, axis] += h
    else:
        r[node] = r[node] @ exp_so3(h * np.eye(3)[axis - 3])
    return replace(case, x=x, r=r)


def gradient_error(case: Example, forces: Array) -> float:
    slopes = [derivative(lambda h, k=k: np.array(evaluated(moved(case, k, h))[0])) for k in range(len(forces))]
    return float(np.abs(np.array(slopes) - forces).max())


def tangent_error(case: Example, tangent: Array) -> float:
    columns = [derivative(lambda h, k=k: evaluated(moved(case, k, h))[1]) for k in range(len(tangent))]
    return float(np.abs(np.array(columns).T - tangent).max())


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_forces_are_the_gradient_of_the_energy(order: int, coupled: bool) -> None:
    case = example(order, coupled)
    energy, forces, _ = evaluated(case)
    assert gradient_error(case, forces) < DIFFERENCE * max(energy, np.abs(forces).max())


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_tangent_is_the_derivative_of_the_forces(order: int, coupled: bool) -> None:
    case = example(order, coupled)
    tangent = evaluated(case)[2]
    assert tangent_error(case, tangent) < DIFFERENCE * np.abs(tangent).max()


@pytest.mark.parametrize("order", ORDERS)
def test_one_wrong_entry_of_the_tangent_is_found(order: int) -> None:
    case = example(order)
    tangent = evaluated(case)[2]
    size = np.abs(tangent).max()
    for entry in ((0, 0), (3, 4), (-1, 0), (4, -2), (-1, -1)):
        wrong = tangent.copy()
        wrong[entry] += 1e-9 * size
        assert tangent_error(case, wrong) > DIFFERENCE * size


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_forces_and_moments_are_in_balance(order: int, coupled: bool) -> None:
    case = example(order, coupled)
    force, moment = np.split(evaluated(case)[1].reshape(-1, 6), 2, axis=1)
    world = np.cross(case.x, force) + np.einsum("nij,nj->ni", case.r, moment)
    # sums over the nodes of terms known to some eps: a dozen products each
    rounding = 12 * len(case.x) * EPS * np.abs(np.stack([force, world])).max()
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=rounding)
    np.testing.assert_allclose(world.sum(axis=0), 0.0, atol=rounding)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_a_rigid_motion_turns_forces_and_changes_nothing_else(order: int, coupled: bool) -> None:
    case, count = example(order, coupled), order + 1
    turn = exp_so3(np.array([1.1, 2.0, -0.7]))
    carried = replace(case, x=case.x @ turn.T + [3.0, -2.0, 1.0], r=turn @ case.r)
    energy, forces, tangent = evaluated(case)
    energy_there, forces_there, tangent_there = evaluated(carried)
    to_world = np.kron(np.eye(2 * count), np.eye(3))
    for node in range(count):
        to_world[6 * node : 6 * node + 3, 6 * node : 6 * node + 3] = turn
    # positions of size 5 are known to 5 eps, strains are their differences; some ten operations follow
    rounding = 50 * EPS * np.abs(tangent).max() * count
    assert energy_there == pytest.approx(energy, abs=rounding)
    np.testing.assert_allclose(forces_there, to_world @ forces, rtol=0, atol=rounding)
    np.testing.assert_allclose(tangent_there, to_world @ tangent @ to_world.T, rtol=0, atol=rounding)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_the_tangent_is_symmetric_but_for_the_turns_of_one_node(order: int, coupled: bool) -> None:
    """Turns of one node do not commute: K - K^T = skew(M_i)^T or its negative there, and zero everywhere else."""
    case, count = example(order, coupled), order + 1
    _, forces, tangent = evaluated(case)
    lopsided = tangent - tangent.T
    for node in range(count):
        x, y, z = forces[6 * node + 3 : 6 * node + 6]
        own = slice(6 * node + 3, 6 * node + 6)
        lopsided[own, own] -= np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    # each entry sums terms of the tangent's size over the nodes, some ten operations each
    np.testing.assert_allclose(lopsided, 0.0, atol=20 * count * EPS * np.abs(tangent).max())


@pytest.mark.parametrize("order", ORDERS)
def test_the_stress_free_shape_bears_no_force(order: int) -> None:
    case, ref = example(order), build_reference(order)
    straight = replace(
        case,
        arrays=case.arrays._replace(gamma0=np.tile([1.0, 0.0, 0.0], (1, order, 1)), kappa0=np.zeros((1, order, 3))),
        x=np.outer(ref.nodes + 1, case.r[0][:, 0]),
        r=np.tile(case.r[0], (order + 1, 1, 1)),
    )
    energy, forces, _ = evaluated(straight)
    assert energy < (order * EPS) ** 2 * 100  # strains of some eps, squared
    assert np.abs(forces).max() < 100 * EPS  # stiffness 3, slopes up to p^2
