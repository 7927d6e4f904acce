"""Attributes of engines in a stage of centimetres: each in the unit of its own schema, and what no mechanism says is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pxr", reason="USD is not installed (python -m pip install usd-core)")

import crosscheck
from crosscheck.equivalence.sources import describe
from crosscheck.lifting.description import Description

CASES = Path(__file__).parents[2] / "data" / "cases"
SINGLE = 1e-6  # relative: single precision, some of its rounding errors
HEAD = '#usda 1.0\n(\n    kilogramsPerUnit = 1\n    metersPerUnit = 0.01\n    upAxis = "Z"\n)\n'
BODY = """def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{{
    float physics:mass = 2
    point3f physics:centerOfMass = (10, 0, 0)
    float3 physics:diagonalInertia = (100, 200, 300)
    {more}
}}
"""
JOINT = """def {kind} "{name}" {apis}
{{
    rel physics:body0 = <{parent}>
    rel physics:body1 = <{child}>
    uniform token physics:axis = "Y"
    {more}
}}
"""


def joint(kind: str, name: str, parent: str, child: str, more: str, apis: str = "") -> str:
    named = f'(prepend apiSchemas = ["{apis}"])' if apis else ""
    return JOINT.format(kind=f"Physics{kind}Joint", name=name, parent=parent, child=child, more=more, apis=named)


def stage(folder: Path, *parts: str, scene: str = "", body: str = "") -> Description:
    """A stage with bodies "one", "two", "three", and what is given beside them."""
    bodies = [BODY.format(name=name, more=body if name == "two" else "") for name in ("one", "two", "three")]
    (folder / "a.usda").write_text(HEAD + scene + "".join(bodies) + "".join(parts))
    return describe(folder / "a.usda")


TURNING = {  # on a hinge, in kg, cm, degrees; in SI per radian
    "float newton:armature = 50": ("rotor_inertia", 50e-4),
    "float physxJoint:armature = 50": ("rotor_inertia", 50e-4),
    "float physxJointAxis:rotY:armature = 50": ("rotor_inertia", 50e-4),
    "float physxJointAxis:angular:armature = 50": ("rotor_inertia", 50e-4),
    "double mjc:armature = 50": ("rotor_inertia", 50e-4),
    "float newton:damping = 3": ("damping", 3e-4 * 180 / np.pi),
    "float physxJointAxis:rotY:viscousFrictionCoefficient = 3": ("damping", 3e-4 * 180 / np.pi),
    "double mjc:damping = 3": ("damping", 3e-4),
    "float newton:friction = 70": ("friction", 70e-4),
    "float physxJointAxis:rotY:dynamicFrictionEffort = 70": ("friction", 70e-4),
    "double mjc:frictionloss = 70": ("friction", 70e-4),
    "double mjc:stiffness = 40": ("stiffness", 40e-4),
    "double mjc:stiffness = 40\n double mjc:springref = 0.3": ("rest", 0.3),
}
SLIDING = {  # on a slide: nothing turns
    "float newton:armature = 5": ("rotor_inertia", 5.0),
    "float newton:damping = 3": ("damping", 3.0),
    "float physxJointAxis:transY:viscousFrictionCoefficient = 3": ("damping", 3.0),
    "float newton:friction = 70": ("friction", 0.7),
    "double mjc:stiffness = 40": ("stiffness", 40.0),
    "double mjc:stiffness = 40\n double mjc:springref = 3": ("rest", 0.03),
}


@pytest.mark.parametrize("more", TURNING)
def test_a_number_of_a_hinge_is_in_the_unit_of_its_schema(more: str, tmp_path: Path) -> None:
    field, value = TURNING[more]
    result = stage(tmp_path, joint("Revolute", "j", "/one", "/two", more))
    assert getattr(result.mechanism.joint_of["j"], field) == pytest.approx(value, rel=SINGLE)
    assert not result.features


@pytest.mark.parametrize("more", SLIDING)
def test_a_number_of_a_slide_is_in_the_unit_of_its_schema(more: str, tmp_path: Path) -> None:
    field, value = SLIDING[more]
    result = stage(tmp_path, joint("Prismatic", "j", "/one", "/two", more))
    assert getattr(result.mechanism.joint_of["j"], field) == pytest.approx(value, rel=SINGLE)


def test_a_ball_has_the_number_of_all_its_axes_per_degree(tmp_path: Path) -> None:
    result = stage(
        tmp_path, joint("Spherical", "j", "/one", "/two", "float newton:damping = 3\nfloat newton:armature = 50")
    )
    ball = result.mechanism.joint_of["j"]
    assert ball.damping == pytest.approx(3e-4 * 180 / np.pi, rel=SINGLE)
    assert ball.rotor_inertia == pytest.approx(50e-4, rel=SINGLE)


@pytest.mark.parametrize(
    ("more", "speed", "effort"),
    [
        ("float newton:velocityLimit = 90", np.pi / 2, np.inf),
        ("float physxJoint:maxJointVelocity = 90", np.pi / 2, np.inf),
        ("float physxJoint:maxJointVelocity = 1000000", np.inf, np.inf),
        ("float physxJointAxis:rotY:maxJointVelocity = 90\nfloat physxJoint:maxJointVelocity = 45", np.pi / 2, np.inf),
        ("double mjc:actuatorfrcrange:min = -30\ndouble mjc:actuatorfrcrange:max = 50", np.inf, 50e-4),
        ('uniform token mjc:actuatorfrclimited = "false"\ndouble mjc:actuatorfrcrange:max = 50', np.inf, np.inf),
    ],
)
def test_limits_of_engines_are_read(more: str, speed: float, effort: float, tmp_path: Path) -> None:
    limits = stage(tmp_path, joint("Revolute", "j", "/one", "/two", more)).mechanism.joint_of["j"].limits
    assert (limits.velocity, limits.effort) == pytest.approx((speed, effort), rel=SINGLE)


@pytest.mark.parametrize(("angle", "rest"), [("radian", 0.3), ("degree", 0.3 * np.pi / 180)])
def test_angles_of_mujoco_are_what_the_scene_says(angle: str, rest: float, tmp_path: Path) -> None:
    scene = f'def PhysicsScene "s"\n{{\nuniform token mjc:compiler:angle = "{angle}"\n}}\n'
    more = "double mjc:stiffness = 40\n double mjc:springref = 0.3"
    result = stage(tmp_path, joint("Revolute", "j", "/one", "/two", more), scene=scene)
    assert result.mechanism.joint_of["j"].rest == pytest.approx(rest, rel=SINGLE)
    assert not any("springref" in words for words in result.dropped)


MIMICS = {  # q_follower - factor q_leader = offset
    "rel newton:mimicJoint = </a>\nfloat newton:mimicCoef0 = 9\nfloat newton:mimicCoef1 = 2": (2.0, np.pi / 20),
    "rel newton:mimicJoint = </a>": (1.0, 0.0),
    "rel physxMimicJoint:rotY:referenceJoint = </a>\nfloat physxMimicJoint:rotY:gearing = 2\n"
    "float physxMimicJoint:rotY:offset = 9": (-2.0, -np.pi / 20),
    "rel physxMimicJoint:rotX:referenceJoint = </a>": (-1.0, 0.0),
    "rel mjc:target = </a>\ndouble mjc:coef0 = 0.2\ndouble mjc:coef1 = 3": (3.0, 0.2),
}


@pytest.mark.parametrize("more", MIMICS)
def test_a_mimic_of_either_schema_is_a_coupling(more: str, tmp_path: Path) -> None:
    factor, offset = MIMICS[more]
    parts = joint("Revolute", "a", "/one", "/two", ""), joint("Revolute", "b", "/one", "/three", more)
    (law,) = stage(tmp_path, *parts).mechanism.closures
    assert law.kind == "coupling"
    assert dict(law.factors) == pytest.approx({"b": 1.0, "a": -factor}, rel=SINGLE)
    assert law.offset == pytest.approx(offset, rel=SINGLE)


def test_a_mimic_that_is_switched_off_is_none(tmp_path: Path) -> None:
    more = "rel newton:mimicJoint = </a>\nbool newton:mimicEnabled = 0"
    parts = joint("Revolute", "a", "/one", "/two", ""), joint("Revolute", "b", "/one", "/three", more)
    result = stage(tmp_path, *parts)
    assert not result.mechanism.closures
    assert not result.features


@pytest.mark.parametrize(("kind", "target"), [("Prismatic", "/a"), ("Revolute", "/nothing")])
def test_a_mimic_that_has_no_law_is_named(kind: str, target: str, tmp_path: Path) -> None:
    more = f"rel newton:mimicJoint = <{target}>"
    parts = joint("Revolute", "a", "/one", "/two", ""), joint(kind, "b", "/one", "/three", more)
    result = stage(tmp_path, *parts)
    assert [(one.name, one.place) for one in result.features] == [("mimic", "joint b")]
    assert result.dropped[-1].startswith("mimic of /b: of ")


def test_higher_orders_of_a_mimic_are_named(tmp_path: Path) -> None:
    more = "rel newton:mimicJoint = </a>\nfloat newton:mimicCoef0 = 9\ndouble mjc:coef2 = 0.5"
    parts = joint("Revolute", "a", "/one", "/two", ""), joint("Revolute", "b", "/one", "/three", more)
    (law,) = stage(tmp_path, *parts).features
    assert (law.name, law.joints) == ("coupling-law", ("b", "a"))
    assert law.parameters["polycoef"] == pytest.approx((np.pi / 20, 1.0, 0.5, 0.0, 0.0), rel=SINGLE)


NAMED = {  # by what is written at a joint, at a body, in a scene: name and place of the feature
    ("float physxJoint:jointFriction = 0.05", "", ""): ("load-friction", "joint j"),
    ("double mjc:ref = 0.5", "", ""): ("coordinate-reference", "joint j"),
    ("double[] mjc:springdamper = [0.1, 1]", "", ""): ("spring-damper", "joint j"),
    ("double mjc:damping = 3\nfloat newton:damping = 3", "", ""): ("contradiction", "joint j"),
    ("", "bool physxRigidBody:disableGravity = 1", ""): ("gravcomp", "link two"),
    ("", "float mjc:body:gravcomp = 0.5", ""): ("gravcomp", "link two"),
    ("", "float physxRigidBody:linearDamping = 0.1", ""): ("body-damping", "link two"),
    ("", "", "double mjc:option:density = 1.2"): ("fluid", "the world"),
}


@pytest.mark.parametrize(("at_joint", "at_body", "in_scene"), NAMED)
def test_what_no_mechanism_says_is_a_feature(at_joint: str, at_body: str, in_scene: str, tmp_path: Path) -> None:
    scene = f'def PhysicsScene "s"\n{{\n{in_scene}\n}}\n'
    result = stage(tmp_path, joint("Revolute", "j", "/one", "/two", at_joint), scene=scene, body=at_body)
    assert [(one.name, one.place) for one in result.features] == [NAMED[at_joint, at_body, in_scene]]


def test_a_spring_of_a_ball_is_a_feature(tmp_path: Path) -> None:
    result = stage(tmp_path, joint("Spherical", "j", "/one", "/two", "double mjc:stiffness = 3"))
    assert [(one.name, one.place) for one in result.features] == [("ball-spring", "joint j")]


def test_joints_of_a_type_that_usd_does_not_know_and_tendons_are_features(tmp_path: Path) -> None:
    gear = 'def PhysxPhysicsGearJoint "gear"\n{\nfloat physics:gearRatio = 3\n}\n'
    tendon = 'def MjcTendon "tendon"\n{\n}\n'
    axis = joint("Revolute", "j", "/one", "/two", "", "PhysxTendonAxisRootAPI:t")
    result = stage(tmp_path, gear, tendon, axis)
    assert {(one.name, one.place) for one in result.features} == {
        ("tendon", "prim /j"), ("gear", "prim /gear"), ("tendon", "prim /tendon"),
    }  # fmt: skip


@pytest.mark.parametrize("key", ["newton:gravityEnabled", "mjc:flag:gravity"])
def test_gravity_that_a_scene_switches_off_does_not_pull(key: str, tmp_path: Path) -> None:
    result = stage(
        tmp_path, joint("Revolute", "j", "/one", "/two", ""), scene=f'def PhysicsScene "s"\n{{\nbool {key} = 0\n}}\n'
    )
    assert not result.mechanism.gravity.any()
    assert result.gravity_stated


@pytest.mark.parametrize(
    ("flag", "field"), [("spring", "stiffness"), ("damper", "damping"), ("frictionloss", "friction")]
)
def test_what_a_flag_of_the_scene_switches_off_is_none_and_said(flag: str, field: str, tmp_path: Path) -> None:
    more = "double mjc:stiffness = 3\ndouble mjc:damping = 3\ndouble mjc:frictionloss = 3"
    scene = f'def PhysicsScene "s"\n{{\nbool mjc:flag:{flag} = 0\n}}\n'
    result = stage(tmp_path, joint("Revolute", "j", "/one", "/two", more), scene=scene)
    made = result.mechanism.joint_of["j"]
    rest = {"stiffness", "damping", "friction"} - {field}
    assert getattr(made, field) == 0.0
    assert all(getattr(made, one) > 0.0 for one in rest)
    assert any(f"mjc:flag:{flag} of the scene" in words for words in result.dropped)


def test_a_whole_tensor_goes_before_principal_moments(tmp_path: Path) -> None:
    result = stage(tmp_path, body="double[] newton:inertia = [100, 200, 300, 10, 20, 30]")
    two = next(link for link in result.mechanism.links if link.name == "two").bodies[0].inertia
    expected = 1e-4 * np.array([[100, 10, 20], [10, 200, 30], [20, 30, 300]])
    assert two.tensor == pytest.approx(expected, rel=1e-14)  # doubles


def test_a_stage_is_not_proven_and_says_why() -> None:
    assert "usd-core" in describe(CASES / "c12_none.usda").unproven


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("c14_damp.xml", "c14_newton_damp.usda"),
        ("c14_damp.xml", "c14_both_damp.usda"),
        ("c14_stiff.xml", "c14_mjc_stiff.usda"),
    ],
)
def test_a_stage_and_the_mjcf_that_it_is_of_have_the_same_numbers(first: str, second: str) -> None:
    comparison = crosscheck.compare(CASES / first, CASES / second)
    assert not comparison.differences
    assert not comparison.unexplained
