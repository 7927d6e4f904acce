"""Loops whose joints turn about the point that is closed: their columns of G are rounding, or nothing at all."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from lane_examples import ROUNDING, doubts
from loop_examples import Y, Z, at, rod
from scipy.spatial.transform import Rotation

import flexinv
from flexinv.constraints.continuation import compute_mobility
from flexinv.kinematics.mesh import build
from flexinv.model.mechanism import WORLD, Attachment, Body, Closure, Inertia, Joint, Link, Mechanism, Placement
from flexinv.rigid.prepare import prepare
from flexinv.rnea.loop_plan import Elimination
from flexinv.typing import Array

ANGLE = 1.1
WHEEL = Joint("W", "revolute", WORLD, "wheel", at(1.0, 1.0), axis=Z)


def tied(joints: tuple[Joint, ...], first: Attachment, second: Attachment) -> Mechanism:
    """Two links and a wheel beside them, a ball between two places."""
    links = rod("arm", 0.5, 0.4), rod("other", 0.3, 0.2), rod("wheel", 0.2, 0.3)
    return Mechanism("idle", links, joints, np.array([0.5, -3.0, -9.0]), (Closure("C", "spherical", first, second),))


def tree_torques(m: Mechanism, state: tuple[Array, Array, Array]) -> Array:
    return prepare(replace(m, closures=()), threads=1).torques(*state)


@pytest.mark.parametrize("swapped", [False, True])
def test_an_axis_through_the_closed_point_gives_all_its_effort(swapped: bool) -> None:
    """An arm stands on its first axis, where a ball holds its tip: the second one is held, the first has to turn the arm."""
    ends = Attachment(WORLD, at(0.0, 0.0, 0.5)), Attachment("arm", at(0.5))
    arm = Joint("A", "universal", WORLD, "arm", axis=Z, second_axis=Y), Joint("B", "revolute", "arm", "other", axis=Y)
    m = tied((*arm, WHEEL), *(ends[::-1] if swapped else ends))
    random = np.random.default_rng(2)
    q, qd, qdd = random.normal(size=(3, 200, 4))
    q[:, 1], qd[:, 1], qdd[:, 1] = -np.pi / 2, 0.0, 0.0
    expected = tree_torques(m, (q, qd, qdd))
    expected[:, 1] = 0.0  # the ball carries it, at no effort
    tau = prepare(m, threads=1).torques(q, qd, qdd)
    assert np.abs(tau - expected).max() < ROUNDING * np.abs(expected).max()


def test_a_ball_joint_at_the_closed_point_gives_all_its_effort() -> None:
    """Its columns are nothing at all where the closure is closed, and something wherever it is open."""
    joints = (
        Joint("S", "spherical", WORLD, "arm", at(0.3)),
        Joint("P", "revolute", WORLD, "other", axis=Z, actuated=False),
        WHEEL,
    )
    m = tied(joints, Attachment("arm"), Attachment("other", at(0.3)))
    random = np.random.default_rng(2)
    q, qd, qdd = random.normal(size=(200, 6)), random.normal(size=(200, 5)), random.normal(size=(200, 5))
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    q[:, 4], qd[:, 3], qdd[:, 3] = 0.0, 0.0, 0.0
    expected = tree_torques(m, (q, qd, qdd))
    expected[:, 3] = 0.0
    tau = prepare(m, threads=1).torques(q, qd, qdd)
    assert np.abs(tau - expected).max() < ROUNDING * np.abs(expected).max()


def test_a_universal_joint_at_the_closed_point_is_said_to_have_no_drive() -> None:
    """Its closure is one that could be reduced, but the arm is rounding."""
    tip = Placement(0.3 * np.array([np.cos(ANGLE), np.sin(ANGLE), 0.0]) + 1e-16)
    joints = (
        Joint("U", "universal", WORLD, "arm", tip, axis=Z, second_axis=Y, actuated=False),
        Joint("P", "revolute", WORLD, "other", axis=Z),
        WHEEL,
    )
    m = tied(joints, Attachment("arm"), Attachment("other", at(0.3)))
    f = prepare(m, threads=1)
    q = np.random.default_rng(2).normal(size=(200, 4))
    q[:, 2] = ANGLE
    with pytest.raises(flexinv.InputError, match="the actuated joints cannot give this motion"):
        f.torques(q, 0 * q, 0 * q)
    assert doubts(f, 200) == [0, 1]


def test_rows_that_have_nothing_in_the_sample_are_combined_without_a_word() -> None:
    """An entry may be zero where the joints stand anywhere, and still be one: another row is the pivot."""
    numbers = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [2.0, 1.0, 1.0]])
    places = iter(range(1000, 10_000, 128))
    e = Elimination(
        [{0: 1, 1: 2}, {0: 3, 2: 4}, {0: 5, 1: 6, 2: 7}],
        numbers,
        np.zeros((3, 3), dtype=np.int64),
        {0: [8]},
        lambda _: next(places),
    )
    with warnings.catch_warnings(action="error"):
        assert e.plan_elimination(0, [0, 1, 2]) == 0
    assert np.array_equal(e.numbers[0], [2.0, 1.0, 1.0])
    assert not e.numbers[1:, 0].any()


@pytest.mark.parametrize("kind", ["spherical", "revolute", "cylindrical"])
@pytest.mark.parametrize("carried", [False, True])
def test_a_second_bearing_of_a_shaft_takes_nothing_from_its_drive(kind: str, carried: bool) -> None:
    """All of its rows are rounding, which no other row shows to be small."""
    turn, axis = Rotation.from_euler("xyz", [0.3, -0.5, 0.7]).as_matrix(), np.array([0.6, 0.0, 0.8])
    first, far = Placement(np.array([0.3, 0.1, 0.2]), turn), 0.7 * axis
    body = Body("rotor", Inertia(2.0, np.array([0.1, 0.05, 0.2]), np.diag([0.1, 0.2, 0.25])))
    base = "carrier" if carried else WORLD
    second = Attachment(base, Placement(first.position + turn @ far, turn)), Attachment("shaft", Placement(far))
    joints = (
        *((Joint("C", "revolute", WORLD, "carrier", first, axis=Y),) if carried else ()),
        Joint("S", "revolute", base, "shaft", first, axis=axis),
    )
    links = (*((Link("carrier", (body,)),) if carried else ()), Link("shaft", (body,)))
    alone = Mechanism("shaft", links, joints, np.array([1.0, 2.0, -9.0]))
    m = replace(alone, closures=(Closure("bearing", kind, *second, axis=axis),))
    names = [j.name for j in joints]
    motion = flexinv.Motion.point_to_point(dict.fromkeys(names, 0.0), dict.fromkeys(names, 2.0), 1.0)
    free, result = (flexinv.solve(mechanism, motion, 1e-2) for mechanism in (alone, m))
    largest = np.abs(free.torque).max()
    assert np.abs(result.torque - free.torque).max() < ROUNDING * largest
    assert np.abs(prepare(m).torques(free.q, free.qd, free.qdd) - free.torque).max() < ROUNDING * largest
    assert compute_mobility(build(m), np.zeros(len(names))).freedoms == len(names)
