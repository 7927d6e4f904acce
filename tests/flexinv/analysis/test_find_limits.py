"""Limits of joints between samples: instants against closed forms at any step; touching counts; it is said where was looked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy
from four_bar_example import START, TURN, four_bar

import flexinv
from flexinv.analysis.find_limits import LimitUse, find_limits
from flexinv.model.joints import Limits
from flexinv.model.mechanism import Mechanism

TIME_BAR = 1e-9


def limited(mechanism: Mechanism, name: str, limits: Limits) -> Mechanism:
    return replace(
        mechanism, joints=tuple(replace(j, limits=limits) if j.name == name else j for j in mechanism.joints)
    )


def uses(solution: flexinv.Solution, motion: flexinv.Motion | None = None) -> dict[str, LimitUse]:
    return {one.quantity: one for one in find_limits(solution, motion)}


@pytest.mark.parametrize("step", [0.5, 0.1, 7e-3])
def test_a_limit_that_is_touched_between_samples_is_reached(root: Path, step: float) -> None:
    time = np.linspace(0.0, 1.0, 41)
    q = np.stack([0.8 * time**2, time, 0.9 - (time - 0.5173) ** 2], axis=1)
    motion = flexinv.Motion.from_samples(time, q)
    arm = limited(flexinv.load_mechanism(root / "models" / "rigid_3r"), "joint3", Limits(upper=0.9, velocity=1.0))
    result = uses(flexinv.solve(arm, motion, step=step), motion)
    assert result["upper"].reached == pytest.approx(0.5173, abs=TIME_BAR)
    assert result["upper"].at == pytest.approx(0.5173, abs=TIME_BAR)
    assert not result["upper"].passed
    assert result["velocity"].reached == pytest.approx(0.0, abs=TIME_BAR)  # 1.0346 at the start
    assert result["velocity"].passed
    assert result["upper"].looked == "between samples, exactly"


@pytest.mark.parametrize("law", ["cycloid", "quintic", "nonic", "bang-bang", "trapezoid"])
def test_laws_pass_limits_where_their_formulas_do(root: Path, law: str) -> None:
    motion = flexinv.Motion.point_to_point([0.0, 0.0, 0.0], [0.1, 0.2, 1.0], 1.0, law=law, delay=0.25)
    arm = limited(flexinv.load_mechanism(root / "models" / "rigid_3r"), "joint3", Limits(upper=0.83, velocity=1.2))
    result = uses(flexinv.solve(arm, motion, step=0.25), motion)

    def state(t: float) -> tuple[float, float]:
        q, qd, _ = motion.evaluate(arm, [t])
        return float(q[0, 2]), float(qd[0, 2])

    place = scipy.optimize.brentq(lambda t: state(t)[0] - 0.83, 0.25, 1.25, xtol=1e-15)
    rate = scipy.optimize.brentq(lambda t: state(t)[1] - 1.2, 0.25, 0.75, xtol=1e-15)
    assert result["upper"].reached == pytest.approx(place, abs=TIME_BAR)
    assert result["velocity"].reached == pytest.approx(rate, abs=TIME_BAR)


def test_joints_that_closures_move_and_efforts_are_looked_at_between_samples() -> None:
    """The rocker of a four-bar turns back at a dead centre of crank and coupler; finer samples confirm the effort."""
    mechanism = limited(four_bar(), "D", Limits(lower=-4.0, upper=4.0))
    mechanism = limited(mechanism, "A", Limits(effort=100.0))
    coarse, fine = (flexinv.solve(mechanism, TURN, step=step, start=START) for step in (0.05, 1e-4))
    result = {(one.coordinate, one.quantity): one for one in find_limits(coarse, TURN)}
    k = int(np.argmax(fine.q[:, 2]))
    assert result["D", "upper"].peak == pytest.approx(
        fine.q[:, 2].max(), abs=1e-6
    )  # half a step squared, times the acceleration
    assert result["D", "upper"].peak >= fine.q[:, 2].max() - 1e-14
    assert abs(result["D", "upper"].at - fine.time[k]) <= 1e-4
    crank, coupler, rocker, base = 0.2, 0.5, 0.4, 0.45
    ahead, behind = crank + coupler, coupler - crank
    angles = [np.pi - np.arccos((base**2 + rocker**2 - one**2) / (2 * base * rocker)) for one in (ahead, behind)]
    assert result["D", "upper"].peak == pytest.approx(angles[1], abs=1e-12)
    assert result["D", "lower"].peak == pytest.approx(angles[0], abs=1e-12)
    effort = result["A", "effort"]
    assert effort.peak == pytest.approx(np.abs(fine.torque).max(), rel=1e-6)
    assert effort.peak >= np.abs(fine.torque).max() * (1 - 1e-12)
    assert effort.looked == "between samples, exactly"


def test_what_is_marched_says_that_it_was_looked_at_in_steps(root: Path) -> None:
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    arm = limited(arm, arm.joints[0].name, Limits(effort=1e3, upper=1.0))
    motion = flexinv.Motion.point_to_point([0.0], [1.0], 0.2)
    result = uses(flexinv.solve(arm, motion, step=1e-3), motion)
    assert result["effort"].looked == "at samples"
    assert result["upper"].looked == "between samples, exactly"
    assert result["upper"].reached == pytest.approx(0.2, abs=TIME_BAR)
    assert not result["upper"].passed
    alone = uses(flexinv.solve(arm, motion, step=1e-3))
    assert alone["upper"].looked == "between samples, within a step"
    assert str(alone["effort"]).endswith("looked at samples)")


def test_another_motion_is_refused(root: Path) -> None:
    arm = limited(flexinv.load_mechanism(root / "models" / "rigid_3r"), "joint3", Limits(upper=0.9))
    one, two = (flexinv.Motion.point_to_point([0.0, 0.0, 0.0], [0.1, 0.2, end], 1.0) for end in (1.0, 0.5))
    with pytest.raises(flexinv.InputError, match=r"joint 'joint3' of the solution is 0\.5 away from the motion"):
        find_limits(flexinv.solve(arm, one, step=0.1), two)


def test_what_is_no_motion_is_refused_where_no_limit_is_stated_too(root: Path) -> None:
    arm = flexinv.load_mechanism(root / "models" / "rigid_3r")
    motion = flexinv.Motion.point_to_point([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], 1.0)
    solution = flexinv.solve(arm, motion, step=0.1)
    assert find_limits(solution) == ()
    with pytest.raises(flexinv.InputError, match="motion"):
        find_limits(solution, "text")  # type: ignore[arg-type]
