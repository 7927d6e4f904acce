"""Mechanisms that open and close while they move: two arms reach, grasp, carry and release a bar."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import flexinv
from crosscheck.engines import pinocchio
from flexinv.closures import constraint_jacobian, constraint_rows
from flexinv.files.case import load_cases
from flexinv.inverse import joint_wrenches, nodal_forces, project
from flexinv.loops import closed_motion, closed_near, mobility
from flexinv.mechanism import Attachment, Body, Closure, Inertia, Joint, Link, Mechanism, Placement
from flexinv.mesh import build
from flexinv.phases import phases
from flexinv.rigid import rigid_motion
from flexinv.rotations import exp_so3

Array = NDArray[np.float64]
UPPER, LOWER, HALF = 0.5, 0.4, 0.2  # lengths of the arms, half the length between the hands [m]
BASES = (np.array([0.0, 0.0]), np.array([1.2, 0.0]))
GRASP, RELEASE, END = 0.5, 1.0, 1.5  # [s]
STEP = 0.005
FROM, TO = np.array([0.6, 0.45, 0.0]), np.array([0.7, 0.6, 0.3])  # bar: x, y, angle


def _at(x: float, angle: float = 0.0) -> Placement:
    return Placement(np.array([x, 0.0, 0.0]), exp_so3(np.array([0.0, 0.0, angle])))


def _rod(name: str, length: float, mass: float) -> Link:
    tensor = np.diag([1e-5, mass * length**2 / 12, mass * length**2 / 12])
    return Link(name, (Body(name, Inertia(mass, np.array([length / 2, 0, 0]), tensor)),))


def _table(bar: Array) -> Attachment:
    return Attachment("world", Placement(np.array([bar[0], bar[1], 0.0]), exp_so3(np.array([0.0, 0.0, bar[2]]))))


def two_arms(timed: bool = True) -> Mechanism:
    """Two planar arms of three joints each and a bar that lies, is carried, and lies again; gravity in the plane."""
    links, joints = [], []
    for side, base in zip("AB", BASES, strict=True):
        links += [_rod(f"{side}1", UPPER, 2.0), _rod(f"{side}2", LOWER, 1.5), _rod(f"{side}3", 0.05, 0.3)]
        where = Placement(np.array([*base, 0.0]))
        joints += [
            Joint(f"{side}1", "revolute", "world", f"{side}1", where),
            Joint(f"{side}2", "revolute", f"{side}1", f"{side}2", _at(UPPER)),
            Joint(f"{side}3", "revolute", f"{side}2", f"{side}3", _at(LOWER)),
        ]
    bar = Link("bar", (Body("bar", Inertia(4.0, np.zeros(3), np.diag([0.01, 0.1, 0.1]))),))
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    links += [Link("slide"), Link("lift"), bar]
    joints += [
        Joint("x", "prismatic", "world", "slide", axis=x, actuated=False),
        Joint("y", "prismatic", "slide", "lift", axis=y, actuated=False),
        Joint("turn", "revolute", "lift", "bar", actuated=False),
    ]
    hold = {
        "lies": ((0.0, GRASP),),
        "left": ((GRASP, RELEASE),),
        "right": ((GRASP, RELEASE),),
        "lies again": ((RELEASE, 9.0),),
    }
    centre = Attachment("bar")
    closures = (
        Closure("lies", "fixed", _table(FROM), centre, active=hold["lies"]),
        Closure("left", "fixed", Attachment("A3"), Attachment("bar", _at(-HALF)), active=hold["left"]),
        Closure("right", "fixed", Attachment("B3"), Attachment("bar", _at(HALF, np.pi)), active=hold["right"]),
        Closure("lies again", "fixed", _table(TO), centre, active=hold["lies again"]),
    )
    gravity = np.array([0.0, -9.81, 0.0])
    if timed:
        return Mechanism("two arms", tuple(links), tuple(joints), gravity, closures)
    carried = tuple(replace(c, active=()) for c in closures[1:3])
    return Mechanism("two arms", tuple(links), tuple(joints), gravity, carried)


def _angles(bar: Array) -> Array:
    """Joint angles of both arms whose third links lie on the bar's ends, by the law of cosines; (samples, 6) [rad]."""
    out = []
    for side, base, bend in ((-1.0, BASES[0], -1.0), (1.0, BASES[1], 1.0)):
        turn = bar[:, 2]
        wrist = bar[:, :2] + side * HALF * np.stack([np.cos(turn), np.sin(turn)], axis=1) - base
        reach = np.hypot(*wrist.T)
        elbow = bend * np.arccos((reach**2 - UPPER**2 - LOWER**2) / (2 * UPPER * LOWER))
        shoulder = np.arctan2(wrist[:, 1], wrist[:, 0]) - np.arctan2(
            LOWER * np.sin(elbow), UPPER + LOWER * np.cos(elbow)
        )
        hand = turn + (0.0 if side < 0 else np.pi) - shoulder - elbow
        out += [shoulder, elbow, hand]
    return np.stack(out, axis=1)


def _soft(s: Array) -> Array:
    """From 0 to 1 with four derivatives zero at both ends, constant outside: splines of it stay smooth at switches."""
    s = np.clip(s, 0, 1)
    return np.asarray(s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4))


def motion(hurry: float = 0.0) -> flexinv.Motion:
    """Reach from above, carry, draw back; with ``hurry`` the hands still move when they grasp [rad]."""
    time = np.arange(0, END + STEP / 10, STEP / 5)
    carry = FROM + _soft((time - GRASP) / (RELEASE - GRASP))[:, None] * (TO - FROM)
    q = _angles(carry)
    away = 0.3 * (1 - _soft(time / GRASP)) + 0.3 * _soft((time - RELEASE) / (END - RELEASE))
    q[:, [0, 3]] += away[:, None] * np.array([1.0, -1.0])
    if hurry:
        q[:, 0] += hurry * (time - GRASP) * (time < GRASP)
    return flexinv.Motion.from_samples(
        time, {f"{side}{k + 1}": q[:, 3 * i + k] for i, side in enumerate("AB") for k in range(3)}
    )


START = {"x": FROM[0], "y": FROM[1], "turn": FROM[2]}


@pytest.fixture(scope="module")
def carried() -> flexinv.Solution:
    return flexinv.solve(two_arms(), motion(), step=STEP, start=START)


def test_the_bar_lies_is_carried_and_lies_again(carried: flexinv.Solution) -> None:
    bar = carried.q[:, 6:]
    grasp, release = round(GRASP / STEP), round(RELEASE / STEP)
    assert abs(bar[: grasp + 1] - FROM).max() < 1e-12
    assert abs(bar[release:] - TO).max() < 1e-12
    assert np.ptp(bar[grasp:release, 1]) > 0.1
    assert abs(carried.unactuated).max() < 1e-10 * abs(carried.torque).max()  # rounding: the bar drives nothing


def test_open_phases_equal_the_arms_alone(carried: flexinv.Solution) -> None:
    """Before the grasp and after the release the torques are those of two open arms."""
    m = two_arms()
    alone = Mechanism("arms", m.links[:6], m.joints[:6], m.gravity)
    open_ = np.r_[0 : round(GRASP / STEP), round(RELEASE / STEP) : len(carried.time)]
    expected = flexinv.joint_torques(alone, carried.q[open_, :6], carried.qd[open_, :6], carried.qdd[open_, :6])
    assert abs(carried.torque[open_] - expected).max() < 1e-9 * np.ptp(expected)  # the bound; rounding is less


def test_the_closed_phase_equals_the_closed_mechanism_and_least_squares(carried: flexinv.Solution) -> None:
    """While they carry: motion and virtual work of the mechanism with both grips, shared by scipy-like least squares."""
    closed = two_arms(timed=False)
    mesh, move = build(closed), motion()
    span = slice(round(GRASP / STEP), round(RELEASE / STEP))
    time = carried.time[span]
    unknown = np.array([False] * 6 + [True] * 3)
    rows = constraint_rows(mesh)
    q, qd, qdd = closed_motion(mesh, lambda t: move.evaluate(closed, t), time, unknown, rows, carried.q[span.start])
    assert abs(q - carried.q[span]).max() < 1e-12
    nodes = rigid_motion(mesh, q, qd, qdd)
    tree = project(mesh, nodes, joint_wrenches(mesh, nodes, nodal_forces(mesh, nodes)))
    g = constraint_jacobian(mesh, nodes, rows)
    for k in range(0, len(time), 20):
        allowed = np.linalg.svd(g[k])[2][np.linalg.matrix_rank(g[k], tol=1e-9) :]
        least = np.linalg.lstsq(allowed[:, :6], allowed @ tree[k])[0]
        assert carried.torque[span][k] == pytest.approx(least, abs=1e-9 * abs(least).max())
    assert carried.loops is not None
    assert carried.loops.preload.shape[2] == 3  # six drives, three freedoms


def test_closures_act_only_in_their_intervals(carried: flexinv.Solution) -> None:
    assert carried.loops is not None
    grip, table = carried.loops.reaction["left"], carried.loops.reaction["lies"]
    held = (carried.time >= GRASP) & (carried.time < RELEASE)
    assert abs(grip[~held]).max() == 0.0
    assert abs(grip[held]).max() > 1.0
    lies = carried.time < GRASP
    assert table[lies, 1] == pytest.approx(4.0 * 9.81, rel=1e-12)  # the table carries the bar's weight
    assert abs(table[~lies]).max() == 0.0


def test_power_balances_through_the_switches(carried: flexinv.Solution) -> None:
    power = np.abs(carried.torque_all * carried.qd).sum(axis=1).max()
    # grips that the spline of the samples meets to 1e-9 only do that much work
    assert abs(carried.power_residual).max() < 1e-6 * power


def test_an_incompatible_grasp_is_an_error() -> None:
    with pytest.raises(
        flexinv.InputError,
        match=r"t = 0\.5 s: closure 'left' begins to act on frames that move .* with 1 rad/s.*impact = \"plastic\"",
    ):
        flexinv.solve(two_arms(), motion(hurry=2.0), step=STEP, start=START)


def test_a_switch_between_samples_is_an_error() -> None:
    m = two_arms()
    late = replace(m.closures[0], active=((0.0, 0.5013),))
    with pytest.raises(
        flexinv.InputError, match=r"closure 'lies': it switches at 0\.5013 s, between two samples.*write step = "
    ):
        flexinv.solve(replace(m, closures=(late, *m.closures[1:])), motion(), step=STEP, start=START)


def test_a_bar_that_nothing_holds_is_an_error() -> None:
    m = two_arms()
    gone = replace(m.closures[0], active=((0.0, 0.25),))
    with pytest.raises(
        flexinv.InputError, match=r"t = 0\.25 s: from here on 3 of the coordinates.*x, y, turn.*active_s"
    ):
        flexinv.solve(replace(m, closures=(gone, *m.closures[1:])), motion(), step=STEP, start=START)


def test_info_counts_the_freedoms_at_the_start() -> None:
    """Only the table acts then: nine coordinates less the bar's three in the plane."""
    mesh = build(two_arms())
    q = closed_near(mesh, np.array([2.0, -1.0, 0.0, 1.0, 1.0, 0.0, *FROM]))
    found = mobility(mesh, q)
    assert (found.freedoms, found.constraints, found.redundant) == (6, 6, 3)


def test_phases_of_a_grid() -> None:
    found = phases(two_arms(), STEP * np.arange(301))
    assert [(p.first, p.last) for p in found] == [(0, 100), (100, 200), (200, 301)]
    assert [p.active.tolist() for p in found] == [
        [True, False, False, False],
        [False, True, True, False],
        [False, False, False, True],
    ]


def test_the_model_is_this_mechanism(root: Path) -> None:
    """models/two_arms and its samples are the mechanism and the motion of this file."""
    model = flexinv.load_mechanism(root / "models" / "two_arms")
    case = load_cases(root / "models" / "two_arms", model)["carry"]
    s = flexinv.solve(model, case.motion, step=case.step, start=case.start)
    here = flexinv.solve(two_arms(), motion(), step=case.step, start=START)
    # the same samples; the file says that they end at rest, which changes the spline near its ends only
    assert abs(s.torque - here.torque)[5:-5].max() < 1e-6 * np.ptp(here.torque)


def test_pinocchio_agrees_phase_by_phase_and_a_wrong_interval_is_seen(root: Path) -> None:
    model = flexinv.load_mechanism(root / "models" / "two_arms")
    case = load_cases(root / "models" / "two_arms", model)["carry"]
    ours = flexinv.solve(model, case.motion, step=case.step, start=case.start)
    theirs = pinocchio.run(model, case, "pinocchio", {})
    columns = np.stack([theirs.series[f"torque/{name}"].values for name in model.velocity_names], axis=1)
    scale = np.ptp(ours.torque_all)
    assert abs(columns - ours.torque_all).max() < 1e-10 * scale  # the bound for loops
    late = tuple(replace(c, active=((0.5, 0.9),)) if c.name == "right" else c for c in model.closures)
    other = pinocchio.run(replace(model, closures=late), case, "pinocchio", {})
    wrong = np.stack([other.series[f"torque/{name}"].values for name in model.velocity_names], axis=1)
    assert abs(wrong - ours.torque_all).max() > 1e-2 * scale  # one hand holds the bar alone for 0.1 s
