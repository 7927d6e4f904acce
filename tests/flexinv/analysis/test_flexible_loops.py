"""Closed loops with beams: closed to rounding, balanced, second order, and rigid in the limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bending_four_bar import bending, rigid_twin
from flexible_examples import STRIP, observed_order
from four_bar_example import START, TURN

import flexinv
from flexinv.kernels.so3 import exp_so3
from flexinv.model.mechanism import Attachment, Beam, Closure, Joint, Link, Mechanism, Placement

SHORT = flexinv.Motion.point_to_point({"A": 0.3}, {"A": 0.8}, 0.2)


@pytest.fixture(scope="module")
def turned() -> flexinv.Solution:
    return flexinv.solve(bending(), TURN, step=1e-3, start=START, initial="static")


def test_closed_and_balanced_at_every_step(turned: flexinv.Solution) -> None:
    ends = turned.tip["coupler"] - turned.tip["rocker"]
    assert turned.tip["rocker"].shape == turned.tip["coupler"].shape
    assert abs(ends).max() < 1e-14  # the closure is solved for, to rounding
    scale = abs(turned.torque).max()
    assert abs(turned.unactuated).max() < 1e-12 * scale  # multipliers belong to the accelerations: no effort is left
    assert abs(turned.torque - turned.reaction[:, :1]).max() < 1e-12 * scale  # elastic side = inertia side
    assert abs(turned.power_residual).max() < 1e-11 * scale * abs(turned.qd).max()  # closure forces do no work


def test_work_closes_with_the_time_error() -> None:
    errors = []
    for step in (2e-3, 1e-3, 5e-4):
        s = flexinv.solve(bending(), TURN, step=step, start=START, initial="static")
        errors.append(abs(s.balance.work).max())
    assert 1.8 < observed_order(errors) < 2.2


def test_torque_converges_with_second_order() -> None:
    """A turn with five derivatives zero at its ends: a cycloid's jump of jerk would ring the coupler's 700 Hz mode by
    1e-3 of the torque, with a phase that no step here resolves.
    """
    time = np.linspace(0, 1, 1001)
    smooth = time**6 * (462 - 1980 * time + 3465 * time**2 - 3080 * time**3 + 1386 * time**4 - 252 * time**5)
    turn = flexinv.Motion.from_samples(time, {"A": 0.3 + 2 * np.pi * smooth})
    runs = [
        flexinv.solve(bending(), turn, step=h, start=START, initial="static").torque
        for h in (2e-3, 1e-3, 5e-4, 1.25e-4)
    ]
    finest = runs[-1]
    errors = [float(np.sqrt(np.mean((run - finest[:: round(16 / 2**k)]) ** 2))) for k, run in enumerate(runs[:-1])]
    assert observed_order(errors) > 1.8
    assert errors[-1] < 1e-4 * abs(finest).max()


def test_error_bars_cover_the_error() -> None:
    coarse = flexinv.solve(bending(), SHORT, step=2e-3, start=START, initial="static", error=True)
    fine = flexinv.solve(bending(order=6), SHORT, step=2.5e-4, start=START, initial="static")
    assert coarse.torque_error is not None
    error = abs(coarse.torque - fine.torque[::8]).max()
    assert error <= coarse.torque_error.max() < 5 * error  # covered, and not by a mile


def test_rigid_limit_is_the_rigid_loop() -> None:
    rigid = flexinv.solve(rigid_twin(), TURN, step=5e-3, start=START).torque
    gaps = []
    for stiffer in (1.0, 10.0):
        torque = flexinv.solve(bending(stiffer), TURN, step=5e-4, start=START, initial="static").torque[::10]
        gaps.append(abs(torque - rigid).max() / np.ptp(rigid))
    assert gaps[0] < 2e-3
    assert gaps[1] < 0.2 * gaps[0]  # a tenth as EI grows tenfold, plus what the start leaves of vibration


def test_redundant_rows_keep_their_multipliers() -> None:
    """A revolute closure of a planar loop has redundant rows for a rigid coupler; beside a beam it costs nothing either."""
    a = flexinv.solve(bending(), TURN, step=2e-3, start=START, initial="static").torque
    b = flexinv.solve(bending(kind="spherical"), TURN, step=2e-3, start=START, initial="static").torque
    assert abs(a - b).max() < 1e-9 * abs(a).max()  # planar motion: both leave the strip straight out of plane


def test_rocker_balances_at_the_closure(turned: flexinv.Solution) -> None:
    assert turned.loops is not None
    force = turned.loops.reaction["C"][:, :3]
    angle, qdd = turned.q[:, 2], turned.qdd[:, 2]
    needed = 0.4 * 0.4**2 / 3 * qdd + 0.4 * 9.81 * 0.2 * np.cos(angle)
    assert (
        abs(0.4 * force[:, 1] - needed).max() < 1e-10 * abs(needed).max()
    )  # multipliers and accelerations of one instant


def test_a_drive_against_a_closure_bends_the_beam() -> None:
    """A beam held at its far end, whose root is turned by an angle: M = 4 EI angle / L, what rigid links would not allow."""
    beam = Link("beam", (), Beam(0.4, STRIP, 1, 4))
    end = Attachment("world", Placement(np.array([0.4, 0.0, 0.0])))
    # free to slide along x, so that the beam is not stretched
    held = Closure("end", "prismatic", end, Attachment("beam", Placement(), 1.0), axis=np.array([1.0, 0.0, 0.0]))
    m = Mechanism(
        "bridge", (beam,), (Joint("root", "revolute", "world", "beam"),), gravity=np.zeros(3), closures=(held,)
    )
    angle = 1e-4
    turn = flexinv.Motion.point_to_point({"root": 0.0}, {"root": angle}, 0.5, hold=0.1, law="quintic")
    s = flexinv.solve(m, turn, step=1e-3)
    ei, ga = STRIP.stiffness[0, 5], STRIP.stiffness[0, 1]
    shear = 12 * ei / (ga * 0.4**2)  # Timoshenko: (4 + phi) / (1 + phi)
    expected = (4 + shear) / (1 + shear) * ei * angle / 0.4
    assert s.torque[-1, 0] == pytest.approx(expected, rel=1e-3)  # what still rings at 170 Hz after half a second's move


@pytest.mark.parametrize(
    ("drives", "words"),
    [
        ("", r"gives a joint without a drive \('A'\).*actuated = true"),
        ("AD", r"leaves out a drive \('D'\).*actuated = false"),
        ("D", r"gives a joint without a drive \('A'\)"),
    ],
)
def test_motion_of_other_joints_than_the_drives_is_refused(drives: str, words: str) -> None:
    m = bending()
    driven = replace(m, joints=tuple(replace(j, actuated=j.name in drives) for j in m.joints))
    with pytest.raises(flexinv.InputError, match=words):
        flexinv.solve(driven, SHORT, step=2e-3, start=START)


def test_observer_does_not_matter(turned: flexinv.Solution) -> None:
    m = bending()
    turn, shift = exp_so3(np.array([0.4, 0.9, -0.3])), np.array([1.0, 2.0, 3.0])
    joints = tuple(
        replace(j, placement=Placement(shift + turn @ j.placement.position, turn @ j.placement.rotation))
        if j.parent == "world"
        else j
        for j in m.joints
    )
    other = flexinv.solve(
        replace(m, joints=joints, gravity=turn @ m.gravity), TURN, step=1e-3, start=START, initial="static"
    )
    # Rounding of EA = 1.45e6 N: 1e-9 N on 1e-2 kg; over 1000 steps a vibration of 1e-8 of the torque.
    assert abs(other.torque - turned.torque).max() < 1e-6 * abs(turned.torque).max()
