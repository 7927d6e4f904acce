"""Rigid closed loops whose whole motion is given: the same efforts as where passive joints are found, and no other motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from four_bar_example import START, TURN, four_bar

import flexinv
from flexinv.constraints.allocation import OPEN, OPEN_ACCELERATION, OPEN_RATE
from flexinv.files.load_cases import load_cases
from flexinv.model.mechanism import Mechanism

MODELS = Path(__file__).resolve().parents[3] / "models"
# Rounding of two ways to the efforts of the cut tree, enlarged by the loops' condition (some tens here).
ROUNDING = 1e-11


def found(name: str) -> flexinv.Solution:
    mechanism = flexinv.load_mechanism(MODELS / name)
    case = next(iter(load_cases(MODELS / name, mechanism).values()))
    return flexinv.solve(mechanism, case.motion, step=max(case.step, case.end / 60), start=case.start)


@pytest.mark.parametrize("name", ["five_bar", "five_bar_redundant", "geared_four_bar", "stewart_platform"])
def test_the_drives_share_what_they_share_where_passive_joints_are_found(name: str) -> None:
    s = found(name)
    f = flexinv.prepare(s.mechanism)
    largest = np.abs(s.torque_all).max()
    tau = f.torques(s.q, s.qd, s.qdd)
    assert np.abs(tau - s.torque_all).max() < ROUNDING * largest
    columns = [np.ascontiguousarray(a.T) for a in (s.q, s.qd, s.qdd)]
    assert np.abs(f.torques(*columns, order="coordinates").T - tau).max() < ROUNDING * largest
    out = np.empty(s.mechanism.nv)
    k = len(s.time) // 2
    assert np.abs(f.sample(s.q[k], s.qd[k], s.qdd[k], out) - tau[k]).max() < ROUNDING * largest
    assert np.abs(flexinv.joint_torques(s.mechanism, s.q[k], s.qd[k], s.qdd[k]) - tau[k]).max() < ROUNDING * largest


def closed() -> tuple[Mechanism, list[np.ndarray]]:
    s = flexinv.solve(four_bar(), TURN, step=5e-3, start=START)
    return s.mechanism, [np.array(a) for a in (s.q, s.qd, s.qdd)]


@pytest.mark.parametrize(
    ("which", "most", "words"),
    [
        (0, OPEN, r": q violates closure 'C' at sample 30: \|phi\| .*expected at most 1e-06"),
        (1, OPEN_RATE, r": qd violates closure 'C' at sample 30: \|G qd\| / "),
        (2, OPEN_ACCELERATION, r": qdd violates closure 'C' at sample 30: \|G qdd \+ G' qd\| / "),
    ],
)
def test_a_motion_that_the_closures_do_not_allow_is_named(which: int, most: float, words: str) -> None:
    mechanism, state = closed()
    f = flexinv.prepare(mechanism)
    f.torques(*state)
    size = 1.0 if which == 0 else np.abs(state[which]).max()
    state[which][30, 1] += 10.0 * most * size
    with pytest.raises(flexinv.InputError, match=words):
        f.torques(*state)


def test_solve_takes_the_motion_of_all_joints() -> None:
    mechanism = four_bar()
    s = flexinv.solve(mechanism, TURN, step=5e-3, start=START)
    given = flexinv.Motion.from_samples(s.time, s.q, [j.name for j in mechanism.joints])
    again = flexinv.solve(mechanism, given, step=5e-3)
    assert again.q == pytest.approx(s.q, abs=1e-9)  # the spline goes through its samples
    # Accelerations of the spline are those of samples 5 ms apart in a turn of 1 s: 1e-3 of the largest, at the ends most.
    inner = slice(20, -20)
    assert np.abs(again.torque[inner] - s.torque[inner]).max() < 1e-3 * np.abs(s.torque).max()
    broken = flexinv.Motion.from_samples(s.time, s.q + np.array([0.0, 0.1, 0.0]), [j.name for j in mechanism.joints])
    with pytest.raises(flexinv.InputError, match=": q violates closure 'C'"):
        flexinv.solve(mechanism, broken, step=5e-3)


def test_drives_that_cannot_hold_the_mechanism_are_named() -> None:
    mechanism, state = closed()
    joints = tuple(replace(j, actuated=False) for j in mechanism.joints)
    with pytest.raises(flexinv.InputError, match="the actuated joints cannot give this motion"):
        flexinv.prepare(replace(mechanism, joints=joints)).torques(*state)


def test_closures_that_act_for_a_while_need_a_time() -> None:
    mechanism = four_bar()
    (closure,) = mechanism.closures
    held = replace(mechanism, closures=(replace(closure, active=((0.0, 1.0),)),))
    with pytest.raises(flexinv.InputError, match=r"closures that act for a while \(C\).*write flexinv.solve"):
        flexinv.prepare(held)


def test_a_mechanism_at_rest_may_have_rates_of_rounding() -> None:
    """As those of a spline through constant samples; what opens faster is no rest."""
    mechanism, (q, _, _) = closed()
    f = flexinv.prepare(mechanism)
    q = np.repeat(q[:1], 50, axis=0)
    still = f.torques(q, np.zeros_like(q), np.zeros_like(q))
    noise = np.random.default_rng(0).normal(size=(2, *q.shape))
    tau = f.torques(q, 1e-13 * noise[0], 1e-10 * noise[1])
    assert np.abs(tau - still).max() < 1e-9 * np.abs(still).max()
    with pytest.raises(flexinv.InputError, match=": qd violates closure"):
        f.torques(q, 1e-6 * noise[0], np.zeros_like(q))
    with pytest.raises(flexinv.InputError, match=": qdd violates closure"):
        f.torques(q, np.zeros_like(q), 1e-4 * noise[1])
