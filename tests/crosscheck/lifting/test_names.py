"""Names that stand twice in a file, and parts without one: each reader gives every part a name of its own, and says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import crosscheck
from crosscheck.equivalence.sources import describe
from crosscheck.lifting.names import name_words, unique_names

CASES = Path(__file__).parents[2] / "data" / "cases"


def test_a_name_that_stands_once_is_kept_and_others_are_paths() -> None:
    plain, paths = ["a", "b", "a", "world", "m/a"], ["m/a", "m/b", "n/a", "world", "m/a"]
    assert unique_names(plain, paths, ("world",)) == ["m/a_", "b", "n/a", "world_", "m/a"]
    assert unique_names(["a", "a"], ["a", "a"]) == ["a", "a_"]


def test_what_is_called_otherwise_is_said_once_for_a_name() -> None:
    assert name_words("joints", ["a", "b", "a"], ["m/a", "b", "n/a"]) == [
        "name a of 2 joints: called by their paths, m/a, n/a"
    ]
    assert name_words("joints", ["a", "b"], ["a", "b"]) == []


def test_a_stage_with_names_below_different_parents_is_itself_and_the_mjcf_that_it_is_of() -> None:
    file = CASES / "c48b_two_arms.usda"
    comparison = crosscheck.compare(CASES / "c48b_two_arms.xml", file, unproven=True)
    assert comparison.equal
    assert dict(comparison.dropped)[file.name][0].startswith("name tool of 2 bodies: called by their paths")
    assert crosscheck.compare(file, file, unproven=True).equal


def test_a_heavier_one_of_two_links_of_one_name_is_named_by_its_path(tmp_path: Path) -> None:
    file = CASES / "c48b_two_arms.usda"
    other = tmp_path / "other.usda"
    text = file.read_text()
    assert text.count("physics:mass = 0.9") == 1
    other.write_text(text.replace("physics:mass = 0.9", "physics:mass = 1.2"))
    comparison = crosscheck.compare(file, other)
    assert [(d.cause, d.place) for d in comparison.differences] == [("mass", "link twoarms/stand/arm2/tool")]


UNNAMED = """<mujoco><compiler angle="radian"/><worldbody>
<body name="a"><joint axis="0 1 0"/><inertial pos="0 0 .1" mass="1" diaginertia=".1 .1 .1"/>
 <body pos="0 0 .2"><joint name="{name}" axis="0 1 0"/><inertial pos="0 0 .1" mass="2" diaginertia=".1 .1 .1"/>
  <body name="c" pos="0 0 .3"><joint axis="0 1 0"/><joint axis="1 0 0"/><inertial pos=".1 0 .1" mass="3" diaginertia=".1 .1 .1"/>
</body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("name", ["joint0", "joint2", "joint3", "a (unnamed)", "c (unnamed 1)"])
def test_joints_without_a_name_stand_beside_one_that_looks_like_theirs(name: str, tmp_path: Path) -> None:
    """The named joint is the second of four: in a file with other names it is matched by what it does."""
    (tmp_path / "a.xml").write_text(UNNAMED.format(name=name))
    (tmp_path / "b.xml").write_text(UNNAMED.format(name="knee").replace('"a"', '"x"').replace('"c"', '"z"'))
    comparison = crosscheck.compare(tmp_path / "a.xml", tmp_path / "b.xml")
    assert comparison.equal
    assert f"{name} is knee" in comparison.notes[0]


def test_a_joint_without_a_name_is_not_the_one_that_bears_its_number(tmp_path: Path) -> None:
    """The third joint of A has no name, the first of B is called joint2: numbers of a reader are no names."""
    (tmp_path / "a.xml").write_text(UNNAMED.format(name="knee"))
    (tmp_path / "b.xml").write_text(UNNAMED.format(name="knee").replace("<joint axis", '<joint name="joint2" axis', 1))
    assert crosscheck.compare(tmp_path / "a.xml", tmp_path / "b.xml").equal


def test_links_and_welds_that_a_reader_names_stand_beside_those_of_the_file(tmp_path: Path) -> None:
    text = UNNAMED.format(name="knee").replace('"a"', '"c before joint 2"')
    weld = '<body name="d"><inertial pos="0 0 1" mass="1" diaginertia="1 1 1"/></body></worldbody>'
    (tmp_path / "a.xml").write_text(text.replace("</worldbody>", weld).replace('"knee"', '"d on world"'))
    mechanism = describe(tmp_path / "a.xml").mechanism
    assert {"c before joint 2", "c before joint 2_", "d"} <= set(mechanism.link_of)
    assert {"d on world", "d on world_"} <= set(mechanism.joint_of)


def test_a_model_of_pinocchio_in_memory_may_name_joints_twice() -> None:
    model = pin.Model()
    parent = 0
    for mass in (1.0, 2.0):
        parent = model.addJoint(parent, pin.JointModelRY(), pin.SE3.Identity(), "j")
        model.appendBodyToJoint(
            parent, pin.Inertia(mass, np.array([0.1, 0.0, 0.2]), 0.1 * np.eye(3)), pin.SE3.Identity()
        )
    mechanism = describe(model).mechanism
    assert [joint.name for joint in mechanism.joints] == ["j", "j/j"]
    assert [link.bodies[0].inertia.mass for link in mechanism.links] == [1.0, 2.0]


def test_a_link_called_base_stands_beside_what_pinocchio_holds() -> None:
    model = pin.Model()
    body = pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3))
    model.appendBodyToJoint(0, body, pin.SE3.Identity())
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "j")
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("base", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    assert [link.name for link in describe(model).mechanism.links] == ["held base", "base"]


def test_a_body_of_a_stage_may_be_called_world(tmp_path: Path) -> None:
    text = (CASES / "c48b_two_arms.usda").read_text()
    (tmp_path / "a.usda").write_text(text.replace('"stand"', '"world"').replace("/stand", "/world"))
    assert crosscheck.compare(tmp_path / "a.usda", CASES / "c48b_two_arms.usda", unproven=True).equal
