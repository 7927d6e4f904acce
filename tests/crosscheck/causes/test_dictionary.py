"""The dictionary of causes: every row is what it says, fits find sizes, and nothing is named without reason."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from crosscheck.causes.dictionary import DICTIONARY, collect_causes
from crosscheck.causes.fit import Candidate, Columns, compute_effect, fit, list_candidates
from crosscheck.causes.model import Model, _has_same_motion, make_model
from crosscheck.causes.naming import UNEXPLAINED, find_causes
from crosscheck.causes.subject import Subject
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

MODELS = Path(__file__).resolve().parents[3] / "models"
# Rounding of torques over their range: 1e-16 over some thousand operations, and of loops whose condition is some hundred.
ROUNDING = 1e-11


@cache
def model(mechanism: str = "double_pendulum", case: str = "swing") -> Model:
    result = load_mechanism(MODELS / mechanism)
    return make_model(Subject(result, load_cases(MODELS / mechanism, result)[case]))


@cache
def known(mechanism: str = "double_pendulum", case: str = "swing") -> list[Candidate]:
    """The dictionary's columns, which are those of the unharmed model whatever it is asked."""
    return list_candidates(model(mechanism, case), collect_causes())


def test_there_are_at_least_twenty_five_causes() -> None:
    assert len(DICTIONARY) >= 25
    assert all(cause.words and cause.shows for cause in DICTIONARY.values())
    assert all(covered in DICTIONARY for cause in DICTIONARY.values() for covered in cause.covers)


@pytest.mark.parametrize("mechanism", ["double_pendulum/swing", "panda/pick", "four_bar/turn", "flex_one_link/cycloid"])
def test_a_cause_of_size_zero_changes_nothing(mechanism: str) -> None:
    here = model(*mechanism.split("/"))
    # A march repeats itself bit by bit, but lumps of no mass put nodes at other places.
    allowed = ROUNDING if here.base.mechanism.is_rigid else 2e-4
    for cause in DICTIONARY.values():
        for target in cause.targets(here)[:1] if cause.sized and not cause.linear else ():
            assert np.abs(compute_effect(here, cause, target, np.zeros(cause.parameters))).max() < allowed, cause.name


@pytest.mark.parametrize("mechanism", ["double_pendulum/swing", "four_bar/turn"])
def test_the_size_of_a_lone_cause_is_found(mechanism: str) -> None:
    here = model(*mechanism.split("/"))
    two = list_candidates(here, {n: DICTIONARY[n] for n in ("viscous damping", "payload")})
    for one in two:
        size = np.array([0.03 * one.scale])
        naming = find_causes(here, compute_effect(here, one.cause, one.target, size), 1e-9, two)
        result = {f.key: f for f in naming.named}
        # Gauss-Newton stops where the difference is rounding; sizes are then as sure as that.
        assert result[one.cause.name, one.target].size == pytest.approx(size, rel=1e-6)


def test_nothing_is_named_inside_the_error_bars_nor_for_noise() -> None:
    here = model()
    quiet = find_causes(here, compute_effect(here, DICTIONARY["payload"], "lower", np.array([1e-3])), 1.0, known())
    assert not quiet.found
    assert quiet.words == "the difference is inside the error bars"
    noise = np.random.default_rng(3).normal(size=here.torque.size)
    naming = find_causes(here, noise, 1e-9, known())
    assert naming.found
    assert naming.named == ()
    assert naming.words.startswith("no single cause explains it, and no two; the nearest, ")


def test_two_causes_at_once_are_not_taken_for_one() -> None:
    here = model()
    both = compute_effect(here, DICTIONARY["viscous damping"], "pivot", np.array([0.1]))
    both = both + compute_effect(here, DICTIONARY["centre of mass shifted"], "lower", np.array([0.02, 0.01, 0.0]))
    # Each alone was looked at here, so that the sum differs from both at once by their product: above bars of rounding.
    assert not {"viscous damping", "centre of mass shifted"} & set(find_causes(here, both, 1e-9, known()).names)


def test_two_causes_at_once_are_named_as_two() -> None:
    here = model("rigid_3r", "quintic")
    once = DICTIONARY["body mass"].change(here.base, "link3", np.array([0.05]))
    twice = DICTIONARY["viscous damping"].change(once, "joint2", np.array([1.0]))
    (result,) = find_causes(here, here.compute_difference(twice), 1e-9).named
    assert result.key == ("body mass + viscous damping", "link3 + joint2")
    assert result.cause.words == (
        "two at once: mass and inertia of link3 differ by the fraction 0.05; and the viscous damping of joint2 differs by "
        "1 N m s/rad or N s/m"
    )


def test_a_cause_that_leaves_more_than_the_bars_is_not_named() -> None:
    """A damper, and beside it a hundredth of its effect that goes with nothing: 99.99 % of the squares, and not the whole."""
    here = model()
    damped = compute_effect(here, DICTIONARY["viscous damping"], "knee", np.array([0.1]))
    noise = np.random.default_rng(5).normal(size=damped.size)
    more = damped + 0.01 * np.linalg.norm(damped) / np.linalg.norm(noise) * noise
    naming = find_causes(here, more, 1e-9, known())
    assert naming.named == ()
    assert naming.words.startswith("no single cause explains it")
    assert find_causes(
        here, more, 0.01 * np.abs(damped).max() + 3e-2 * np.abs(more - damped).max(), known()
    ).names  # inside wide bars


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.02])
def test_an_engine_that_gives_something_else_is_not_taken_for_a_mechanism_almost_without_mass(share: float) -> None:
    """A sine in the place of efforts ten times as large: a mass scale of -0.9 or so leaves little of the *difference*."""
    here = model()
    sine = np.sin(10.0 * here.states.time)[:, None] * share * here.scale * [1.0, 2.0]
    residual = here.scale_efforts(sine - here.torque)
    light = fit(here, residual, list_candidates(here, {"mass scale": DICTIONARY["mass scale"]})[0], rounds=6)
    assert light.residual < UNEXPLAINED
    naming = find_causes(here, residual, 1e-9, known())
    assert naming.named == ()
    assert naming.words.startswith("no single cause explains it")


def test_nothing_has_less_than_no_mass() -> None:
    here = model()
    for cause, target in (("mass scale", ""), ("body mass", "lower")):
        with pytest.raises(
            InputError, match=r"a fraction of -1\.1 leaves next to nothing: expected more than -0\.9999"
        ):
            DICTIONARY[cause].change(here.base, target, np.array([-1.1]))


def test_causes_that_a_motion_cannot_tell_apart_are_named_together() -> None:
    here = model("rigid_one_link", "cycloid")
    naming = find_causes(here, compute_effect(here, DICTIONARY["rotor inertia"], "hub", np.array([1e-5])), 1e-9)
    assert naming.named == ()
    assert naming.words.endswith(" explain it, and nothing that the engine gave tells them apart")


def test_a_special_case_is_named_instead_of_the_general_one() -> None:
    here = model()
    result = find_causes(here, compute_effect(here, DICTIONARY["gravity off"], "", np.ones(1)), 1e-9, known()).names
    assert result[0] == "gravity off"
    assert not {"gravity magnitude", "base acceleration"} & set(result)


def test_a_model_harmed_where_closures_depend_on_it_is_closed_again() -> None:
    here = model("four_bar", "turn")
    moved = DICTIONARY["joint misplaced"].change(here.base, "B", np.array([0.01, 0.0, 0.0]))
    assert np.abs(here.compute_difference(moved)).max() > 1e-3
    # The quick way through the open tree and the full solution give the same where the closures are the same.
    heavy = DICTIONARY["body mass"].change(here.base, "coupler", np.array([0.1]))
    again = replace(heavy, mechanism=replace(heavy.mechanism, closures=(*heavy.mechanism.closures,)))
    other = replace(again, case=replace(again.case, motion=replace(again.case.motion)))
    assert np.abs(here.compute_torques(heavy) - here.compute_torques(other)).max() < 1e-9


@pytest.mark.parametrize(("place", "samples"), [("two_arms/carry", 76), ("walker/walk", 141)])
def test_the_samples_that_a_fit_looks_at_meet_the_instants_at_which_closures_switch(place: str, samples: int) -> None:
    """A third of the 151 samples would do for the arms, but would step over the grasp; half of them do not."""
    mechanism, case = place.split("/")
    here = model(mechanism, case)
    instants = [
        t for c in here.base.mechanism.closures for span in c.active for t in span if 0 < t < here.base.case.end
    ]
    assert instants
    for instant in instants:
        # times are multiples of the sampling interval, to rounding
        assert np.abs(here.states.time - instant).min() < 1e-9
    assert len(here.rows) == samples
    assert np.abs(here.compute_difference(DICTIONARY["gravity off"].change(here.base, "", np.ones(1)))).max() > 0.1


def test_columns_are_shared_by_equal_models_only() -> None:
    causes = {"payload": DICTIONARY["payload"]}
    columns, one = Columns(), model.__wrapped__()
    candidates = columns.collect_candidates(one, causes)
    assert columns.collect_candidates(model.__wrapped__(), dict(causes)) is candidates
    more = columns.collect_candidates(one, {**causes, "body mass": DICTIONARY["body mass"]})
    assert {c.cause.name for c in more} == {"payload", "body mass"}
    assert {c.cause.name for c in columns.collect_candidates(one, causes)} == {"payload"}
    for other in (replace(one, scale=2.0 * one.scale), model.__wrapped__("rigid_3r", "quintic")):
        again = columns.collect_candidates(other, causes)
        assert again is not candidates
        fresh = list_candidates(other, causes)
        assert [(c.target, c.scale) for c in again] == [(c.target, c.scale) for c in fresh]
        assert all(np.array_equal(a.columns, b.columns) for a, b in zip(again, fresh, strict=True))


@pytest.mark.parametrize("mechanism", ["double_pendulum/swing", "flex_one_link/cycloid"])
def test_a_spring_in_a_driven_joint_shows_in_rigid_and_in_flexible_mechanisms(mechanism: str) -> None:
    here = model(*mechanism.split("/"))
    cause = DICTIONARY["spring in a joint"]
    name = next(iter(cause.targets(here)))
    size = 0.1 * np.array([cause.scale(here, name), 0.0])
    joint = here.base.mechanism.v_slices[name]
    expected = np.zeros_like(here.torque)
    expected[:, joint] = size[0] * here.states.q[:, here.base.mechanism.q_slices[name]]
    effect = compute_effect(here, cause, name, size)
    # Marches repeat to what their Newton iterations leave, 1e-9 of the range; the spring is some hundredth of it.
    assert np.abs(effect - here.scale_efforts(expected)).max() < 1e-7


def test_a_mass_leaves_a_loop_its_motion_and_an_axis_does_not() -> None:
    """So a diagnosis solves the loops for changes of their geometry alone: a copied mechanism has a new tuple of closures."""
    base = model("four_bar", "turn").base
    heavier = replace(
        base.mechanism,
        links=tuple(
            replace(
                link,
                bodies=tuple(replace(b, inertia=replace(b.inertia, mass=1.1 * b.inertia.mass)) for b in link.bodies),
            )
            for link in base.mechanism.links
        ),
    )
    assert _has_same_motion(base, replace(base, mechanism=heavier))
    first, *others = base.mechanism.joints
    turned = replace(base.mechanism, joints=(replace(first, axis=np.array([0.0, 0.0, -1.0])), *others))
    assert not _has_same_motion(base, replace(base, mechanism=turned))
    tied = replace(base.mechanism.closures[0], capture=True)
    assert not _has_same_motion(base, replace(base, mechanism=replace(base.mechanism, closures=(tied,))))
