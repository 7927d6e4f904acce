"""The certificate: every engine's own model says the same of itself, and a harmed model is found out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loop_examples import case_of
from scipy.spatial.transform import Rotation

from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.evidence import Evidence
from crosscheck.causes.model import Model, make_model
from crosscheck.causes.naming import NamedCauses, find_causes
from crosscheck.causes.selftest import make_loose_closure
from crosscheck.causes.subject import Subject
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import offered
from crosscheck.measures.certificate import Certificate, Check, build_certificate, checks, is_certified
from crosscheck.measures.record import Record
from crosscheck.run.child import describe_supplied_data
from crosscheck.verdicts.certificates import list_certificate_lines
from crosscheck.verdicts.plan import make_task
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.mechanism import WORLD, Attachment, Body, Closure, Inertia, Joint, Link, Mechanism, Placement
from flexinv.model.motion import Motion

MODELS = Path(__file__).resolve().parents[3] / "models"


def load(place: str) -> tuple[Mechanism, Case]:
    mechanism, case = place.split("/")
    result = load_mechanism(MODELS / mechanism)
    return result, load_cases(MODELS / mechanism, result)[case]


def says(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """What an engine says, after the way through JSON that it takes between processes."""
    certify = offered(adapter(ENGINES[engine]), "certify")
    assert certify is not None
    return build_certificate(json.loads(json.dumps(certify(mechanism, case, engine).plain, allow_nan=False)))


def lines(place: str, engine: str, harmed: Subject | None = None) -> tuple[Check, ...]:
    mechanism, case = load(place)
    theirs = says(mechanism if harmed is None else harmed.mechanism, case, engine)
    return checks(mechanism.name, case.name, engine, theirs, says(mechanism, case, "flexinv"))


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco", "exudyn"])
@pytest.mark.parametrize("place", ["double_pendulum/swing", "rigid_one_link/cycloid", "panda/pick", "talos_arm/wave"])
def test_rigid_engines_have_the_same_mechanism(place: str, engine: str) -> None:
    result = lines(place, engine)
    assert is_certified(result), [line for line in result if not line.holds]
    assert {line.what for line in result} >= {
        "total mass",
        "joint-space mass matrix",
        "gravity torque",
        "order of the joints",
        "first moments by joint",
        "inertias by joint",
    }


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
@pytest.mark.parametrize("place", ["rigid_3r/cycloid", "ur5/reach", "four_bar/turn", "talos_arm/wave"])
def test_torques_have_the_same_slopes(place: str, engine: str) -> None:
    """Of Pinocchio by computeRNEADerivatives, to rounding; of MuJoCo by differences of sixth order, which leave 1e-12."""
    slopes = [line for line in lines(place, engine) if line.what.startswith("torque by")]
    assert [line.what for line in slopes] == ["torque by place", "torque by rate"]
    for line in slopes:
        assert line.error is not None
        assert line.error <= (1e-14 if engine == "pinocchio" else 1e-11) * (line.scale or 1.0)


def test_joints_without_one_number_for_each_coordinate_have_no_slopes() -> None:
    assert not [line for line in lines("stewart_platform/swoop", "pinocchio") if line.what.startswith("torque by")]


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
@pytest.mark.parametrize("place", ["four_bar/turn", "bricard/fold"])
def test_closed_mechanisms_have_the_same_closures(place: str, engine: str) -> None:
    result = lines(place, engine)
    assert is_certified(result), [line for line in result if not line.holds]
    assert {line.what for line in result} >= {"closure residual", "rank of the closures"}


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
@pytest.mark.parametrize("kind", ["spherical", "revolute", "cylindrical"])
def test_a_second_bearing_of_a_shaft_has_no_rank(kind: str, engine: str) -> None:
    """Its Jacobian is rounding, of which the largest singular value is as much as of any other."""
    turn, axis = Rotation.from_euler("xyz", [0.3, -0.5, 0.7]).as_matrix(), np.array([0.6, 0.0, 0.8])
    place, far = Placement(np.array([0.3, 0.1, 0.2]), turn), 0.7 * axis
    shaft = Link("shaft", (Body("rotor", Inertia(2.0, np.array([0.1, 0.05, 0.2]), np.diag([0.1, 0.2, 0.25]))),))
    ends = Attachment(WORLD, Placement(place.position + turn @ far, turn)), Attachment("shaft", Placement(far))
    joint, bearing = Joint("S", "revolute", WORLD, "shaft", place, axis=axis), Closure("B", kind, *ends, axis=axis)
    mechanism = Mechanism("shaft", (shaft,), (joint,), closures=(bearing,))
    case = case_of(mechanism, Motion.point_to_point({"S": 0.0}, {"S": 2.0}, 1.0), {})
    theirs = says(mechanism, case, engine)
    assert theirs.rank == 0
    result = checks("shaft", "turn", engine, theirs, says(mechanism, case, "flexinv"))
    assert is_certified(result), [line for line in result if not line.holds]


BEAMS = {"total mass", "masses of beams", "first moments of beams", "section stiffness"}
JOINTS = {"joint damping", "joint friction"}
# Uniform sections: what is not linear in the probe's load is 1e-6 of the answer, and bending leaves 5e-6 of shear (of MuJoCo's
# rod, whose clamp is softer by a thousandth of an edge, 5e-6 as well).
STATIC = 1e-5


@pytest.mark.parametrize("engine", ["exudyn-ge", "exudyn-ancf", "mujoco-flex"])
@pytest.mark.parametrize("place", ["flex_one_link/cycloid", "spatial_arm/reach"])
def test_static_probes_and_weights_find_every_beam(place: str, engine: str) -> None:
    if (place, engine) == ("spatial_arm/reach", "mujoco-flex"):
        pytest.skip("MuJoCo's rod lies in a plane")
    result = {line.what: line for line in lines(place, engine)}
    space = {"masses by joint", "first moments by joint", "inertias by joint"} if place.startswith("spatial") else set()
    assert set(result) - JOINTS == BEAMS | space
    assert is_certified(tuple(result.values()))
    assert (result["section stiffness"].error or 0.0) <= STATIC * (result["section stiffness"].scale or 0.0)


def test_the_probe_says_all_that_a_beam_in_space_has() -> None:
    mechanism, case = load("spatial_arm/reach")
    names = {"EA", "GA_y", "GA_z", "GJ", "EI_y", "EI_z"}
    assert set(says(mechanism, case, "exudyn-ge").stiffness) == {f"forearm: {name}" for name in names}
    plane = says(*load("flex_one_link/cycloid"), "exudyn-ge").stiffness
    assert set(plane) == {"link: EA", "link: EI_z", "link: GA_y"}


@pytest.mark.parametrize("place", ["double_pendulum/swing", "panda/pick", "stewart_platform/swoop"])
def test_redundant_coordinates_weigh_the_same(place: str) -> None:
    result = lines(place, "exudyn-dae")
    assert is_certified(result), [line for line in result if not line.holds]
    assert {"total mass", "masses by joint"} <= {line.what for line in result}


HARM = {
    "body mass": ("total mass", "masses by joint", "joint-space mass matrix", "gravity torque"),
    "centre of mass shifted": ("centre of mass", "joint-space mass matrix"),
    "inertia about the origin": ("joint-space mass matrix",),
    "gravity magnitude": ("gravity torque",),
    "axis tilted": ("joint axes",),
    "rotor inertia": ("joint-space mass matrix",),
}


@pytest.mark.parametrize("cause", HARM)
@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_a_harmed_model_has_no_certificate(engine: str, cause: str) -> None:
    mechanism, case = load("double_pendulum/swing")
    subject = Subject(mechanism, case)
    row = DICTIONARY[cause]
    size = np.full(max(1, row.parameters), 1e-3) if row.sized else np.ones(1)
    result = lines("double_pendulum/swing", engine, row.change(subject, row.targets(make_model(subject))[-1], size))
    assert {line.what for line in result if not line.holds} >= set(HARM[cause])


@pytest.mark.parametrize(
    ("cause", "target", "engine", "what", "words"),
    [
        ("section stiffness", "link: EA", "exudyn-ge", "section stiffness", "link: EA"),
        ("section stiffness", "link: EI_z", "mujoco-flex", "section stiffness", "link: EI_z"),
        ("shear factor", "link", "exudyn-ge", "section stiffness", "link: GA_y"),
        ("beam mass", "link", "exudyn-ancf", "masses of beams", "link"),
        ("beam length", "link", "mujoco-flex", "first moments of beams", "link"),
    ],
)
def test_a_beam_off_by_a_hundredth_is_found(cause: str, target: str, engine: str, what: str, words: str) -> None:
    harmed = DICTIONARY[cause].change(Subject(*load("flex_one_link/cycloid")), target, np.array([0.01]))
    result = lines("flex_one_link/cycloid", engine, harmed)
    assert (what, words) in [(line.what, line.words) for line in result if not line.holds]


def test_a_body_on_a_beam_is_weighed_where_it_sits() -> None:
    subject = Subject(*load("spatial_arm/reach"))
    harmed = DICTIONARY["centre of mass shifted"].change(subject, "forearm/tool", np.array([1e-3, 0.0, 0.0]))
    wrong = {line.what: line.words for line in lines("spatial_arm/reach", "exudyn-ge", harmed) if not line.holds}
    assert wrong == {"first moments by joint": "forearm at 1", "inertias by joint": "forearm at 1"}


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
@pytest.mark.parametrize("place", ["four_bar/turn", "bricard/fold"])
def test_a_closure_of_another_rank_is_found(place: str, engine: str) -> None:
    mechanism, case = load(place)
    loose = replace(mechanism, closures=tuple(map(make_loose_closure, mechanism.closures)))
    result = lines(place, engine, Subject(loose, case))
    wrong = [line for line in result if not line.holds]
    assert [line.what for line in wrong if line.what != "closure axes"] == ["rank of the closures"]
    assert wrong[-1].words.endswith("a closure ties less than it should")


@pytest.mark.parametrize(
    ("harm", "what", "words"),
    [
        ({"order": ("A", "B")}, "order of the joints", "of A, B; expected A, B, "),
        ({"residual": 1e-3}, "closure residual", ""),
        ({"mass_matrix": np.eye(3)}, "joint-space mass matrix", "of shape (3, 3), expected "),
        ({"torque_by_place": np.eye(3)}, "torque by place", "of shape (3, 3), expected "),
    ],
)
def test_what_no_cause_does_is_found(harm: dict[str, Any], what: str, words: str) -> None:
    """A joint that is lost, a loop that stays open, matrices of another size."""
    mechanism, case = load("four_bar/turn")
    theirs, ours = says(mechanism, case, "pinocchio"), says(mechanism, case, "flexinv")
    assert is_certified(checks("four_bar", "turn", "pinocchio", theirs, ours))
    wrong = [line for line in checks("four_bar", "turn", "pinocchio", replace(theirs, **harm), ours) if not line.holds]
    assert [line.what for line in wrong] == [what]
    assert wrong[0].words.startswith(words)


@pytest.mark.parametrize("slopes", ["torque_by_place", "torque_by_rate"])
def test_slopes_that_are_off_by_a_millionth_are_found(slopes: str) -> None:
    """As they are where a rate is taken in another frame, which no mass matrix says."""
    mechanism, case = load("four_bar/turn")
    theirs, ours = says(mechanism, case, "pinocchio"), says(mechanism, case, "flexinv")
    harmed = replace(theirs, **{slopes: 1.000001 * np.asarray(getattr(theirs, slopes))})
    wrong = [line.what for line in checks("four_bar", "turn", "pinocchio", harmed, ours) if not line.holds]
    assert wrong == [slopes.replace("_", " ")]


def test_an_engine_without_a_certificate_says_why() -> None:
    mechanism, case = load("four_bar/turn")
    records = {
        "flexinv": Record("flexinv", certificate=says(mechanism, case, "flexinv").plain),
        "exudyn-dae": Record("exudyn-dae", certificate={"problem": "redundant coordinates"}),
    }
    certificate_lines = list_certificate_lines(make_task(MODELS / "four_bar", mechanism, case), records)
    assert [(line.what, line.holds, line.words) for line in certificate_lines] == [
        ("no certificate", False, "redundant coordinates")
    ]


def test_the_certificate_rules_out_what_it_contradicts() -> None:
    """In one joint on a vertical axis rotor, link inertia and mass look alike; the mass matrix says nothing of which, the
    certificate of an effort that is scaled says that the model is right."""
    model = model_at("rigid_one_link/cycloid")
    scaled = DICTIONARY["effort scale"].change(model.base, "hub", np.array([0.05]))
    assert find_causes(model, model.compute_difference(scaled), 1e-9).words.endswith(
        "nothing that the engine gave tells them apart"
    )
    heard = with_evidence(model, scaled)
    # Without gravity, larger accelerations are larger efforts.
    assert set(heard.names) == {"effort scale", "acceleration scale", "coordinate scale"}
    assert {"mass scale", "rotor inertia"} <= {one.fit.cause.name for one in heard.ruled_out}
    assert all("joint-space mass matrix" in one.against for one in heard.ruled_out)
    heard = with_evidence(model, DICTIONARY["mass scale"].change(model.base, "", np.array([0.05])))
    assert "mass scale" in heard.names
    assert "effort scale" not in heard.names


@pytest.mark.parametrize("cause", ["inertial frame rotated", "rotary inertia dropped", "rotor inertia"])
def test_a_plane_motion_and_the_certificate_tell_inertias_apart(cause: str) -> None:
    """Of a plane motion all three are one moment of inertia more or less; the engine's model has all six numbers."""
    model = model_at("double_pendulum/swing")
    row = DICTIONARY[cause]
    target = row.targets(model)[0]
    size = 0.1 * row.scale(model, target) * np.array([0.78, -0.55, 0.31])[: row.parameters]
    harmed = row.change(model.base, target, size)
    assert not find_causes(model, model.compute_difference(harmed), 1e-9).named  # more than three explain it
    heard = with_evidence(model, harmed)
    # A rod's tensor is a multiple of what Steiner adds to it: taken about another point it is a shorter rod's.
    assert set(heard.names) <= {cause, "inertia about the wrong point"}
    result = next(f for f in heard.named if f.cause is row)
    assert row.parameters > 1 or result.size == pytest.approx(size, rel=1e-6)  # rounding over the change


@pytest.mark.slow
def test_where_the_certificate_contradicts_every_cause_none_is_named() -> None:
    """A damper explains the motion, and the engine's model says that a body is heavier: it is neither of them alone."""
    model = model_at("double_pendulum/swing")
    damped = DICTIONARY["viscous damping"].change(model.base, "knee", np.array([0.1]))
    other = DICTIONARY["body mass"].change(model.base, "upper", np.array([0.1]))
    heard = with_evidence(model, damped, other)
    assert heard.named == ()
    assert "viscous damping would explain the efforts, but is contradicted by total mass" in heard.words
    assert "total mass" in heard.failing


def model_at(place: str) -> Model:
    return make_model(Subject(*load(place)))


def with_evidence(model: Model, harmed: Subject, asked: Subject | None = None) -> NamedCauses:
    """What is named when Pinocchio's model of the harmed subject is asked, too (or of another one)."""
    base, residual = model.base, model.compute_difference(harmed)
    theirs = says((asked or harmed).mechanism, base.case, "pinocchio")
    evidence = Evidence(model, residual, theirs, says(base.mechanism, base.case, "flexinv"))
    return find_causes(model, residual, 1e-9, evidence=evidence)


def test_a_certificate_says_who_computed_what_an_engine_is_given() -> None:
    """The file states a damping ratio; the time that follows from it comes from flexinv's modes."""
    folder = MODELS / "flex_one_link_damped"
    assert describe_supplied_data(load_mechanism(folder)) == {}  # nothing is computed yet
    mechanism = apply_stated_ratio(load_mechanism(folder))
    (line,) = checks("m", "c", "exudyn", Certificate(given=describe_supplied_data(mechanism)), Certificate())
    assert line.holds
    assert line.words.startswith("retardation time 0.00095267 s from ratio 0.03 at mode 1, computed by flexinv")
    assert describe_supplied_data(load_mechanism(MODELS / "flex_one_link")) == {}
