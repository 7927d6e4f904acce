"""find_gradient equals the sums of what differentiate gives: one is the other read backwards."""

from __future__ import annotations

import numpy as np
import pytest
from derivative_examples import EXAMPLES, SOFT, shorten, soften

import flexinv
from flexinv.errors import InputError

# Places are known to 1e-16; times the stiffness of an element along its axis, 1e8 N/m, that is 1e-8 of efforts of some N m, and
# sums over a hundred samples drawn by lot have ten times as much.
ROUNDING = 1e-7


def _move(mechanism, law="nonic"):
    joints = [joint.name for joint in mechanism.joints if joint.nv and joint.actuated]
    ends = {name: 0.5 + 0.1 * k for k, name in enumerate(joints)}
    return flexinv.Motion.point_to_point(dict.fromkeys(joints, 0.0), ends, duration=0.2, hold=0.05, law=law)


def _swing(mechanism):
    return flexinv.Motion.point_to_point({"A": np.radians(20)}, {"A": np.radians(120)}, duration=0.3, law="nonic")


START = {"B": np.radians(46.0), "D": np.radians(103.0)}
# Mechanism, names, and what solve takes beside the motion.
CASES = {
    "two links": (
        "flex_two_link",
        ["motion.joint1[0]", "motion.joint2[1]", "motion.duration", "links.link2.beam.length", "joints.joint2.damping"],
        {},
    ),
    "modal damping": ("flex_one_link_damped", ["motion.duration", "modal_damping.ratio"], {}),
    "sudden start in space": ("spatial_arm", ["gravity[2]", "links.forearm.bodies.tool.inertia.mass"], {}),
    "static start in space": ("spatial_arm", ["gravity[0]", "motion.duration"], {"initial": "static"}),
    "passive joints": ("quanser_2dsfl", ["joints.1.stiffness", "motion.duration"], {}),
    "rigid tree": ("rigid_3r", ["gravity[1]", "motion.duration"], {}),
    "loop that bends": (
        "four_bar_flexible",
        ["motion.A[1]", "links.coupler.beam.length", "closures.C.second.placement.position[0]", "gravity[1]"],
        {"start": START},
    ),
    "rigid loop": ("four_bar", ["motion.A[1]", "links.rocker.bodies.0.inertia.mass"], {"start": START}),
}


def _draw_weights(solution, seed=3):
    draw = np.random.default_rng(seed)
    tips = list(solution.tip)
    return {
        "torque": draw.standard_normal(solution.torque.shape),
        "q": draw.standard_normal(solution.qd.shape),
        "tip": {tips[-1]: draw.standard_normal((len(solution.time), 3))},
    }


def _sum_derivatives(found, weights):
    total = np.einsum("sa,sap->p", weights["torque"], found.torque) + np.einsum("sv,svp->p", weights["q"], found.q)
    sizes = [np.abs(weights["torque"][..., None] * found.torque).max(axis=(0, 1))]
    sizes.append(np.abs(weights["q"][..., None] * found.q).max(axis=(0, 1)))
    for name, weight in weights["tip"].items():
        total += np.einsum("si,sip->p", weight, found.tip[name])
        sizes.append(np.abs(weight[..., None] * found.tip[name]).max(axis=(0, 1)))
    return total, np.max(sizes, axis=0)


def _check_equal(mechanism, motion, names, settings):
    found = flexinv.differentiate(mechanism, motion, names, step=3e-3, **settings)
    weights = _draw_weights(found.solution)
    backward = flexinv.find_gradient(mechanism, motion, weights, names, step=3e-3, **settings)
    forward, size = _sum_derivatives(found, weights)
    assert (size > 0.0).all()
    assert (np.abs(backward.gradient - forward) / size).max() < ROUNDING
    assert backward.parameters == tuple(names)


@pytest.mark.parametrize("case", CASES)
def test_gradient_is_the_sum_of_derivatives(root, case):
    name, names, settings = CASES[case]
    mechanism = flexinv.load_mechanism(root / "models" / name)
    motion = _swing(mechanism) if "start" in settings else _move(mechanism)
    _check_equal(mechanism, motion, names, settings)


@pytest.mark.parametrize("case", SOFT)
def test_gradient_of_beams_in_loops_is_the_sum_of_derivatives(root, case):
    make, names, by, _ = SOFT[case]
    mechanism, motion, start, _ = shorten(soften(root, make(), names), 100)
    _check_equal(mechanism, motion, [by, "motion.A[0]"] if by != "motion.A[0]" else [by], {"start": start})


@pytest.mark.parametrize(
    "case", ["springs and forces in a loop", "a coupling", "drives that are more than the freedoms"]
)
def test_gradient_of_rigid_loops_is_the_sum_of_derivatives(case):
    make, name, _ = EXAMPLES[case]
    mechanism, motion, start, _ = shorten(make(), 60)
    _check_equal(mechanism, motion, [name], {"start": start})


def test_energy_left_is_differentiated(root):
    arm = flexinv.load_mechanism(root / "models" / "flex_two_link")
    time = np.linspace(0.0, 0.3, 9)
    way = (time / 0.3) ** 3 * (10 - 15 * time / 0.3 + 6 * (time / 0.3) ** 2)
    motion = flexinv.Motion.from_samples(time, {"joint1": way, "joint2": -0.5 * way}, rest=True)
    names = [f"motion.joint1[{k}]" for k in range(2, 7)]
    forward = flexinv.differentiate(arm, motion, names, step=3e-3).differentiate_residual_vibration().energy
    backward = flexinv.find_gradient(arm, motion, {"residual": 2.0}, names, step=3e-3)
    assert abs(backward.gradient - 2.0 * forward).max() < ROUNDING * abs(forward).max()
    with pytest.raises(InputError, match=r"it changes how joints are at 0\.3 s"):
        flexinv.find_gradient(arm, motion, {"residual": 1.0}, ["motion.joint1[8]"], step=3e-3)


def test_weights_may_follow_from_the_solution(root):
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link_damped")
    motion = _move(arm)
    found = flexinv.differentiate(arm, motion, ["motion.duration"], step=3e-3)
    mean = flexinv.find_gradient(
        arm, motion, lambda s: {"torque": s.torque / len(s.time)}, ["motion.duration"], step=3e-3
    )
    torque = found.solution.torque
    assert mean.gradient[0] == pytest.approx((torque * found.torque[:, :, 0]).sum() / len(torque), rel=ROUNDING)
    assert list(mean.frame().columns) == ["value", "gradient"]
    assert "motion.duration" in repr(mean)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({}, "of: expected at least one of torque, q, tip, residual"),
        ({"torqe": 1.0}, "of: 'torqe': expected one of torque, q, tip, residual; write 'torque'"),
        ({"torque": np.ones(3)}, r"of: torque = .*: expected finite numbers \(84, 1\)"),
        ({"tip": np.ones(3)}, "of: tip = .*: expected a table of weights"),
        ({"tip": {"hand": np.ones(3)}}, "of: tip of 'hand': expected one of link"),
        ({"residual": "much"}, "of: residual = 'much': expected a finite number"),
        ("torque", "of = 'torque': expected a table of weights"),
    ],
)
def test_bad_weights_are_named(root, weights, message):
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link_damped")
    with pytest.raises(InputError, match=message):
        flexinv.find_gradient(arm, _move(arm), weights, ["motion.duration"], step=3e-3)
