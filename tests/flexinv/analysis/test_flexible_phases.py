"""Mechanisms with beams that open and close while they move: two arms with flexible forearms grasp, carry and release a bar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import torque_range
from two_arms_example import FROM, GRASP, LOWER, RELEASE, START, TO, motion, two_arms

import flexinv
from flexinv.model.mechanism import Beam, Joint, Link, Mechanism, Section

pytestmark = pytest.mark.slow  # what they share is computed once, and takes seconds

STEP = 1e-3
# 3.75 kg/m as the rigid forearm; a solid bar of aluminium with EI = 800 N m^2 sags by 1.2 mm under its own hand and bar
EI = 800.0


def section(stiffer: float = 1.0) -> Section:
    stiffness = stiffer * np.array([[9.7e7, 3e7, 3e7, 600.0, EI, EI]])
    return Section(np.zeros(1), stiffness, np.array([3.75]), np.array([[1e-4, 5e-5, 5e-5]]))


def bending_arms(stiffer: float = 1.0) -> Mechanism:
    """The two arms with beams for forearms; hands tie the bar where it lies, at whatever small velocity."""
    m = two_arms()
    forearms = {f"{side}2": Link(f"{side}2", (), Beam(LOWER, section(stiffer), 1, 4)) for side in "AB"}
    links = tuple(forearms.get(link.name, link) for link in m.links)
    joints = tuple(_on_tip(j) if j.parent in forearms else j for j in m.joints)
    closures = tuple(replace(c, capture=bool(c.active[0][0]), impact="plastic") for c in m.closures)
    return replace(m, links=links, joints=joints, closures=closures)


def _on_tip(joint: Joint) -> Joint:
    return replace(joint, placement=type(joint.placement)(), station=1.0)


def alone(m: Mechanism) -> Mechanism:
    return Mechanism("arms", m.links[:6], m.joints[:6], m.gravity)


@pytest.fixture(scope="module")
def carried() -> flexinv.Solution:
    return flexinv.solve(bending_arms(), motion(), step=STEP, start=START, initial="static")


def test_before_the_grasp_the_arms_are_on_their_own(carried: flexinv.Solution) -> None:
    before = round(GRASP / STEP)
    arms = flexinv.solve(alone(bending_arms()), motion(), step=STEP, end=GRASP, initial="static")
    # with closures accelerations are solved for once more at the converged positions (1e-8 squared), and EA = 9.7e7 N rounds
    assert abs(carried.torque[:before] - arms.torque[:before]).max() < 1e-7 * torque_range(arms.torque)


def test_the_bar_lies_is_carried_and_lies_where_it_was_put(carried: flexinv.Solution) -> None:
    bar = carried.q[:, 6:]
    grasp, release = round(GRASP / STEP), round(RELEASE / STEP)
    assert abs(bar[: grasp + 1] - FROM).max() < 1e-12
    assert np.ptp(bar[release:], axis=0).max() < 1e-9  # captured there
    assert 1e-5 < abs(bar[release] - TO).max() < 5e-3  # where the yielding arms have brought it
    assert abs(carried.unactuated).max() < 1e-9 * abs(carried.torque).max()


def test_balances_close_through_the_switches(carried: flexinv.Solution) -> None:
    power = np.abs(carried.torque_all * carried.qd).sum(axis=1).max()
    assert abs(carried.power_residual).max() < 1e-9 * power
    assert abs(carried.momentum_residual).max() < 1e-9 * abs(carried.wrench["A1"]).max()
    assert abs(carried.torque_all - carried.reaction)[:, :6].max() < 1e-9 * abs(carried.torque).max()
    until = round(RELEASE / STEP)  # what rings after the release the integrator damps
    half = flexinv.solve(bending_arms(), motion(), step=STEP / 2, start=START, initial="static")
    # energy through grasp and release too, what impacts take being counted: the rest is time error, of second order
    assert abs(half.balance.work[: 2 * until]).max() < 0.5 * abs(carried.balance.work[:until]).max()


def test_impacts_take_what_carnot_says(carried: flexinv.Solution) -> None:
    """Stopped by closures and drives that do no work on the jump: lost = 1/2 dv M dv >= 0; small here, the hands nearly rest."""
    assert carried.loops is not None
    grasp, release = carried.loops.impacts
    assert (grasp.time, grasp.closures) == (GRASP, ("left", "right"))
    assert (release.time, release.closures) == (RELEASE, ("lies again",))
    for impact in (grasp, release):
        assert 0 < impact.energy < 1e-3 * carried.balance.kinetic.max()
        assert abs(impact.torque[6:]).max() < 1e-15  # none along coordinates without drive: rounding of 1 kg m/s


def one_handed(m: Mechanism) -> Mechanism:
    """Only the left hand grasps: three drives for three freedoms, nothing is redundant."""
    return replace(m, closures=tuple(c for c in m.closures if c.name != "right"))


def test_stiff_arms_carry_as_rigid_ones_in_the_mean() -> None:
    """The bar's weight comes on at once: torques ring with all of it however stiff the arms; their mean is the rigid one."""
    span = slice(round(GRASP / STEP), round(RELEASE / STEP))
    rigid = flexinv.solve(one_handed(two_arms()), motion(), step=STEP, start=START).torque[span]
    gaps = []
    for stiffer in (1.0, 10.0):
        stiff = flexinv.solve(one_handed(bending_arms(stiffer)), motion(), step=STEP, start=START, initial="static")
        gaps.append(abs(stiff.torque[span].mean(axis=0) - rigid.mean(axis=0)).max() / torque_range(rigid))
    assert gaps[0] < 0.02  # the span is no whole number of periods: a part of one in some forty
    assert gaps[1] < 0.7 * gaps[0]


def test_frames_that_have_not_met_are_an_error() -> None:
    m = bending_arms()
    strict = replace(m, closures=tuple(replace(c, capture=False) for c in m.closures))
    with pytest.raises(
        flexinv.InputError, match=r"t = 0\.5 s: closure 'left' begins to act on frames that are .* apart"
    ):
        flexinv.solve(strict, motion(), step=STEP, start=START, initial="static")
    gentle = replace(m, closures=tuple(replace(c, impact="error") for c in m.closures))
    with pytest.raises(
        flexinv.InputError, match=r"closure 'left' begins to act on frames that move .*impact = \"plastic\""
    ):
        flexinv.solve(gentle, motion(), step=STEP, start=START, initial="static")
