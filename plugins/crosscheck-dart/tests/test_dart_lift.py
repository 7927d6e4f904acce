"""DART's reader: a URDF is itself, a skeleton in memory is a description, and what its reader of SDF loses is named."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dartpy", reason="DART is not installed (python -m pip install dartpy)")

import dartpy as dart
from arm_texts import ARM_SDF, arm

import crosscheck
from crosscheck.equivalence.proof import LOST, PROVEN, prove
from crosscheck.equivalence.sources import describe
from flexinv.errors import InputError

CASES = Path(__file__).parents[3] / "tests" / "data" / "cases"


def test_its_reader_of_urdf_keeps_damping_friction_and_mimics(tmp_path: Path) -> None:
    file = arm(tmp_path)
    assert crosscheck.compare(file, f"{file}@dart").equal


def test_a_heavier_link_in_memory_is_named(tmp_path: Path) -> None:
    file = arm(tmp_path)
    loader, options = dart.utils.DartLoader(), dart.utils.DartLoaderOptions()
    options.mDefaultRootJointType = dart.utils.DartLoaderRootJointType.FIXED
    loader.setOptions(options)
    skeleton = loader.parseSkeleton(dart.common.Uri(f"file://{file}"))
    skeleton.getBodyNode("lower").setMass(2.625)
    comparison = crosscheck.compare(arm(tmp_path, ('<mimic joint="grip"/>', "")), skeleton, judge=["rigid"])
    assert [(d.cause, d.place) for d in comparison.differences] == [("mass", "link lower")]


def test_sdf_beyond_1_6_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "arm.sdf").write_text(ARM_SDF)
    with pytest.raises(InputError, match=r"SDF beyond 1\.6"):
        crosscheck.compare(f"{tmp_path}/arm.sdf@dart", arm(tmp_path))


def test_an_sdf_s_friction_and_spring_are_read_and_its_added_mass_is_named(tmp_path: Path) -> None:
    for name in ("c15_plain", "c15_nospring", "c15_added"):
        text = (CASES / f"{name}.sdf").read_text()
        version = re.compile(r'version="1\.\d+"')
        turned = "<pose>0.3 0.02 0 0 0 0.4</pose>"  # DART leaves the rotation of an inertial frame out
        assert turned in text
        text = version.sub('version="1.6"', text).replace(turned, "<pose>0.3 0.02 0 0 0 0</pose>")
        text = re.sub(r"(<izz>[\d.]+</izz>)(?!<ixy>)", r"\1<ixy>0</ixy>", text)
        text = re.sub(r"(<ixy>[\d.]+</ixy>)", r"\1<ixz>0</ixz><iyz>0</iyz>", text)
        (tmp_path / f"{name}.sdf").write_text(text)
    plain = describe(f"{tmp_path}/c15_plain.sdf@dart")
    joint = plain.mechanism.joint_of["luff"]
    assert (joint.stiffness, joint.rest, joint.friction, joint.damping) == (3.0, 0.1, 0.2, 0.4)
    assert prove(plain).state == PROVEN
    added = describe(f"{tmp_path}/c15_added.sdf@dart")
    assert [(one.name, one.place) for one in added.features] == [("added-mass", "link boom")]


def test_a_floating_joint_floats() -> None:
    comparison = crosscheck.compare(f"{CASES}/c16_floating.urdf@dart", CASES / "c16_floating.xml")
    assert comparison.equal
    assert {proof.state for _, proof in comparison.proofs} == {PROVEN}


def skeleton(kind: str) -> Any:
    """A body on a joint of a kind, on a hinge; springs, damping and dry friction where DART has them."""
    made = dart.dynamics.Skeleton()
    hinge, first = made.createRevoluteJointAndBodyNodePair()
    joint, second = getattr(made, f"create{kind}JointAndBodyNodePair")(first)
    hinge.setName("hinge")
    joint.setName("j")
    hinge.setAxis(np.array([0.0, 0.6, 0.8]))
    hinge.setSpringStiffness(0, 3.0)
    hinge.setRestPosition(0, 0.1)
    for one in (hinge, joint) if kind != "Free" else (hinge,):
        for k in range(one.getNumDofs()):
            one.setDampingCoefficient(k, 0.4)
            one.setCoulombFriction(k, 0.2)
    pose = dart.math.Isometry3()
    pose.set_translation([0.3, 0.2, 0.1])
    pose.set_rotation(dart.math.eulerXYZToMatrix([0.3, 0.2, 0.1]))
    joint.setTransformFromParentBodyNode(pose)
    pose.set_translation([0.05, -0.1, 0.2])
    joint.setTransformFromChildBodyNode(pose)
    for body in (first, second):
        tensor = np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.0], [0.0, 0.0, 0.04]])
        body.setInertia(dart.dynamics.Inertia(2.0, np.array([0.1, 0.02, 0.03]), tensor))
    return made


@pytest.mark.parametrize("kind", ["Revolute", "Prismatic", "Screw", "Universal", "Ball", "Free"])
def test_the_mechanism_of_a_skeleton_has_its_efforts_joint_by_joint(kind: str) -> None:
    made = skeleton(kind)
    step = made.getTimeStep()
    found = prove(describe(made))
    assert found.state == PROVEN, found.words
    assert made.getTimeStep() == step
    assert made.getGravity().tolist() == [0.0, 0.0, -9.81]


def test_a_mechanism_that_is_not_the_skeleton_s_is_not_reproduced() -> None:
    """The check can fail: a joint with 1 % more damping than the skeleton's."""
    found = describe(skeleton("Revolute"))
    joints = [replace(one, damping=1.01 * one.damping) for one in found.mechanism.joints]
    assert prove(replace(found, mechanism=replace(found.mechanism, joints=tuple(joints)))).state == LOST
