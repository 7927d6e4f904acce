"""Terms of the equation of motion that a cause takes away: together they are all that goes with rates, or all of gravity."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.fault_benches import BENCHES
from crosscheck.causes.model import Model, make_model, open_tree
from crosscheck.causes.rows.terms import (
    compute_centrifugal_terms,
    compute_closure_efforts,
    compute_gyroscopic_efforts,
    compute_quadratic_terms,
    list_single_closures,
)
from crosscheck.causes.selftest import CLEAN, ask, find_fault_causes, prepare, run_bench, run_fault
from crosscheck.causes.subject import Subject
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

MODELS = Path(__file__).resolve().parents[3] / "models"
ROUNDING = 1e-12  # of the largest effort: some hundred operations


def model_of(name: str, case: str) -> Model:
    mechanism = load_mechanism(MODELS / name)
    return make_model(Subject(mechanism, load_cases(MODELS / name, mechanism)[case]))


def without(model: Model, cause: str, target: str = "") -> Array:
    """The efforts of the model with one cause in it."""
    return model.compute_torques(DICTIONARY[cause].change(model.base, target, np.ones(1)))


def test_coriolis_and_centrifugal_terms_are_all_that_goes_with_rates() -> None:
    """Pinocchio's own matrix: C(q, q') q'; the arm has neither damping nor friction."""
    pin = pytest.importorskip("pinocchio")
    model = model_of("ur5", "reach")
    assert model.base.mechanism.urdf is not None
    robot = pin.buildModelFromUrdf(str(model.base.mechanism.urdf))
    data = robot.createData()
    states = model.states
    quadratic = np.array([
        pin.computeCoriolisMatrix(robot, data, q, qd) @ qd for q, qd in zip(states.q, states.qd, strict=True)
    ])  # fmt: skip
    dropped = 2 * model.torque - without(model, "Coriolis terms dropped") - without(model, "centrifugal terms dropped")
    np.testing.assert_allclose(dropped, quadratic, rtol=0, atol=ROUNDING * np.abs(model.torque).max())
    assert np.abs(quadratic).max() > 0.1  # the motion shows them


def test_what_one_joint_does_alone_is_centrifugal() -> None:
    model = model_of("ur5", "reach")
    states = replace(model.states, qd=model.states.qd * np.eye(model.base.mechanism.nv)[1])
    alone = compute_quadratic_terms(model.base.mechanism, states, states.qd)
    most = np.abs(alone).max()
    assert most > 0.1
    np.testing.assert_allclose(
        compute_centrifugal_terms(model.base.mechanism, states), alone, rtol=0, atol=ROUNDING * most
    )


def test_damping_and_dry_friction_are_no_quadratic_terms() -> None:
    model = model_of("ur5", "reach")
    rubbing = replace(
        model.base.mechanism,
        joints=tuple(
            replace(j, damping=2.0, friction=3.0) if j.nv else j for j in model.base.mechanism.joints
        ),
    )  # fmt: skip
    free, rubbed = (compute_quadratic_terms(m, model.states, model.states.qd) for m in (model.base.mechanism, rubbing))
    np.testing.assert_allclose(rubbed, free, rtol=0, atol=ROUNDING * np.abs(model.torque).max())


def with_tensors(mechanism: Mechanism, tensor: Array | None) -> Mechanism:
    """The mechanism with another inertia tensor in all its bodies, or none."""
    links = (
        replace(
            link,
            bodies=tuple(
                replace(
                    b, inertia=b.inertia.replace_unchecked(tensor=0.0 * b.inertia.tensor if tensor is None else tensor)
                )
                for b in link.bodies
            ),
        )
        for link in mechanism.links
    )
    return replace(mechanism, urdf=None, links=tuple(links))


def test_gyroscopic_moments_are_those_of_the_tensors() -> None:
    """A ball has none, nor has a hinge about a principal axis; and they do no work."""
    model = model_of("ur5", "reach")
    mechanism = model.base.mechanism
    assert np.abs(compute_gyroscopic_efforts(mechanism, model.states)).max() > 1e-3
    ball = with_tensors(mechanism, 0.1 * np.eye(3))
    assert np.abs(compute_gyroscopic_efforts(ball, model.states)).max() < ROUNDING
    still = replace(model.states, qdd=0.0 * model.states.qdd)
    # A single hinge about a principal axis: w x J w = 0, whatever J is.
    one = model_of("rigid_one_link", "cycloid")
    assert np.abs(compute_gyroscopic_efforts(one.base.mechanism, one.states)).max() < ROUNDING
    # Power: gyroscopic moments do no work, w . (w x J w) = 0.
    power = (compute_gyroscopic_efforts(mechanism, still) * still.qd).sum(axis=1)
    assert np.abs(power).max() < ROUNDING * np.abs(model.torque).max()


def test_the_weights_of_all_bodies_are_gravity() -> None:
    model = model_of("ur5", "reach")
    bodies = DICTIONARY["weight of a body dropped"].targets(model)
    assert len(bodies) > 5
    dropped = sum(model.torque - without(model, "weight of a body dropped", body) for body in bodies)
    still = 0.0 * model.states.qdd
    gravity = open_tree(model.base.mechanism, replace(model.states, qd=still, qdd=still))
    np.testing.assert_allclose(dropped, gravity, rtol=0, atol=ROUNDING * np.abs(gravity).max())


# Solving for multipliers multiplies rounding by the condition of G: some hundred.
OF_LOOPS = 1e-9


@pytest.mark.parametrize("name", ["andrews_squeezer", "geared_four_bar"])
def test_the_forces_of_all_closures_are_what_the_open_tree_lacks(name: str) -> None:
    model = model_of(name, "turn")
    mechanism = model.base.mechanism
    closures = list_single_closures(model)
    assert closures == [c.name for c in mechanism.closures]
    shares = [compute_closure_efforts(mechanism, model.states, model.torque, closure) for closure in closures]
    whole = open_tree(mechanism, model.states) - model.torque
    most = np.abs(whole).max()
    np.testing.assert_allclose(sum(shares), whole, rtol=0, atol=OF_LOOPS * most)
    for share in shares:  # no force of a closure does work along a motion that it allows
        assert np.abs(share).max() > 1e-2 * most
        assert np.abs((share * model.states.qd).sum(axis=1)).max() < OF_LOOPS * most * np.abs(model.states.qd).max()
    soft = DICTIONARY["soft constraint"].change(model.base, "", np.ones(1))
    np.testing.assert_allclose(model.compute_torques(soft) - model.torque, whole, rtol=0, atol=OF_LOOPS * most)


def test_the_force_of_a_coupling_acts_on_its_joints_in_the_ratio_of_its_factors() -> None:
    model = model_of("geared_four_bar", "turn")
    mechanism = model.base.mechanism
    for coupling in (c for c in mechanism.closures if c.kind == "coupling"):
        share = compute_closure_efforts(mechanism, model.states, model.torque, coupling.name)
        ratio = np.zeros(mechanism.nv)
        for joint, factor in coupling.factors:
            ratio[mechanism.v_slices[joint]] = factor
        along = np.outer(share @ ratio / (ratio @ ratio), ratio)
        np.testing.assert_allclose(share, along, rtol=0, atol=OF_LOOPS * np.abs(share).max())


def test_a_closure_whose_force_another_can_take_over_has_none_of_its_own() -> None:
    model = model_of("andrews_squeezer", "turn")
    first, *others = model.base.mechanism.closures
    twice = model.base.replace_mechanism(closures=(first, replace(first, name="again"), *others))
    assert list_single_closures(replace(model, base=twice)) == [c.name for c in others]
    alone = model.base.replace_mechanism(closures=(first,))
    assert list_single_closures(replace(model, base=alone)) == []  # "soft constraint" says it


def test_a_closure_without_its_force_is_named_alone() -> None:
    (bench,) = (one for one in BENCHES if one.mechanism == "geared_four_bar")
    rows = run_bench(bench, MODELS, (0.1,), ("closure force dropped",), targets=2)
    assert [(row.cause, row.outcome) for row in rows] == [(CLEAN, "silent"), *[("closure force dropped", "alone")] * 2]
    assert len({row.target for row in rows}) == 3


def test_each_is_named_alone_beside_a_damper_that_differs() -> None:
    """A second fault: both are named, as a pair, and nothing else is."""
    (bench,) = (one for one in BENCHES if one.label == "double_pendulum/swing in pinocchio")
    setting = prepare(bench, MODELS)
    unsized = ("Coriolis terms dropped", "weight of a body dropped")
    for name in unsized:
        one = next(c for c in setting.known if c.cause.name == name)
        fault = run_fault(setting, one, 1.0)
        assert fault is not None
        assert fault.outcome == "alone", fault
        damped = DICTIONARY["viscous damping"].change(setting.subject, "knee", np.array([0.05]))
        both = one.cause.change(damped, one.target, np.ones(1))
        naming = find_fault_causes(setting, ask(bench, both), both)
        assert {f.cause.name for f in naming.named} <= {f"{name} + viscous damping", f"viscous damping + {name}"}, name
        assert naming.named, name


def test_a_closures_force_is_named_beside_a_damper_that_it_hides() -> None:
    """Without the closure's force a damper acts otherwise than alone: columns of the mechanism as it is do not show the pair."""
    (bench,) = (one for one in BENCHES if one.label.startswith("andrews_squeezer (with a damper)"))
    setting = prepare(bench, MODELS)
    few = ("closure force dropped", "viscous damping", "dry friction", "body mass", "rotor inertia", "force at the tip")
    setting = replace(setting, known=[one for one in setting.known if one.cause.name in few])
    lost = next(one for one in setting.known if one.cause.name == "closure force dropped")
    damper = [one for one in setting.known if one.cause.name == "viscous damping"][-1]
    harmed = lost.cause.change(setting.subject, lost.target, np.ones(1))
    both = damper.cause.change(harmed, damper.target, np.array([0.1 * damper.scale]))
    named = find_fault_causes(setting, ask(bench, both), both).named
    assert {(one.cause.name, one.target) for one in named} == {
        ("closure force dropped + viscous damping", f"{lost.target} + {damper.target}")
    }
