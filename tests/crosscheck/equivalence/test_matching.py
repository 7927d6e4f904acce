"""Joints that names count and not name, machines that stand elsewhere as a whole, and digits that fixed links add."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from pathlib import Path

import pytest
from arm_texts import arm

from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.result import REPAIRED

Step = tuple[str, str, float]  # axis, place on the link before, mass [kg] of the link that it carries
SIX: tuple[Step, ...] = (
    ("0 0 1", "0 0 0.2", 3.0), ("0 1 0", "0 0 0.1", 2.5), ("0 1 0", "0 0 0.4", 2.0), ("0 0 1", "0.02 0 0.2", 1.2),
    ("0 1 0", "0 0 0.1", 0.8), ("0 0 1", "0 0 0.1", 0.4),
)  # fmt: skip
# One joint more, in the upper arm; all others as they were.
SEVEN = (*SIX[:2], ("0 0 1", "0 0 0.2", 1.1), (SIX[2][0], "0 0 0.2", SIX[2][2]), *SIX[3:])


def chain(folder: Path, name: str, steps: Iterable[Step], called: str = "joint_{}") -> Path:
    """A URDF of hinges one after the other, numbered from 1."""
    text, before = ['<robot name="chain"><link name="base"/>'], "base"
    for k, (axis, place, mass) in enumerate(steps, 1):
        text += [
            f'<link name="link_{k}"><inertial><origin xyz="0.01 0.02 0.05"/><mass value="{mass!r}"/>',
            f'<inertia ixx="{mass / 64!r}" ixy="0" ixz="0" iyy="{mass / 80!r}" iyz="0" izz="{mass / 96!r}"/></inertial></link>',
            f'<joint name="{called.format(k)}" type="revolute"><origin xyz="{place}"/><parent link="{before}"/>',
            f'<child link="link_{k}"/><axis xyz="{axis}"/><limit lower="-2" upper="2" effort="50" velocity="2"/></joint>',
        ]
        before = f"link_{k}"
    (folder / name).write_text("".join([*text, "</robot>"]))
    return folder / name


def test_the_third_of_six_is_the_fourth_of_seven(tmp_path: Path) -> None:
    six, seven = chain(tmp_path, "six.urdf", SIX), chain(tmp_path, "seven.urdf", SEVEN)
    comparison = compare(six, seven)
    assert "4 by structure, against the numbers in their names" in comparison.matched
    assert ("joint that moves in B only", "joint joint_3") in [(d.cause, d.place) for d in comparison.differences]
    assert not [
        d for d in comparison.differences if d.cause in ("position of joint", "orientation of joint", "joint axis")
    ]
    assert comparison.judged.after <= REPAIRED
    other = compare(seven, six)
    assert [(d.cause, d.place) for d in other.judged.causes if d.structural] == [
        ("joint that moves in A only", "joint joint_3")
    ]
    stated = compare(six, seven, match={"joint_3": "joint_3"})  # who says it is believed
    assert "against the numbers" not in stated.matched


@pytest.mark.parametrize("called", ["joint_{}", "j{}_axis"])
def test_a_joint_that_is_held_leaves_the_numbers_of_all_others(called: str, tmp_path: Path) -> None:
    six = chain(tmp_path, "six.urdf", SIX, called)
    joint = re.escape(called.format(3))
    held = re.sub(f'name="{joint}" type="revolute"', f'name="{called.format(3)}" type="fixed"', six.read_text())
    (tmp_path / "held.urdf").write_text(
        held.replace('value="2.5"', 'value="3.75"').replace('"0.02 0 0.2"', '"0.2 0 0.2"')
    )
    comparison = compare(six, tmp_path / "held.urdf")
    assert "5 by name" in comparison.matched
    assert len(comparison.differences) == 3


LEG = """<link name="hip_{0}"><inertial><origin xyz="0.01 0.02 -0.1"/><mass value="{1}"/>
  <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>
<joint name="hip_{0}" type="revolute"><origin xyz="{2}" rpy="{3}"/><parent link="trunk"/><child link="hip_{0}"/>
  <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="50" velocity="2"/></joint>"""
TRUNK = """<robot name="legs">{}<link name="trunk"><inertial><mass value="9"/>
  <inertia ixx="1" iyy="1" izz="1"/></inertial></link>{}</robot>"""
QUARTER = repr(math.pi / 2)


def legs(folder: Path, name: str, places: Iterable[str], turn: str = "0 0 0", before: str = "") -> Path:
    """A trunk with legs that hang at places on it, all turned alike."""
    masses = ("1.5", "2.25", "1.75", "2.5")
    every = "".join(LEG.format(k, masses[k], place, turn) for k, place in enumerate(places))
    (folder / name).write_text(TRUNK.format(before, every))
    return folder / name


UPRIGHT = ("0.2 0.1 0", "0.2 -0.1 0", "-0.2 0.1 0", "-0.2 -0.1 0")
LYING = ("0.2 0 0.1", "0.2 0 -0.1", "-0.2 0 0.1", "-0.2 0 -0.1")  # turned by a quarter about x


def test_a_base_that_is_turned_is_one_difference_and_what_to_write_puts_it_right(tmp_path: Path) -> None:
    a, b = legs(tmp_path, "a.urdf", UPRIGHT), legs(tmp_path, "b.urdf", LYING, f"{QUARTER} 0 0")
    comparison = compare(a, b)
    assert [d.cause for d in comparison.differences] == ["pose of base"]
    assert comparison.differences[0].size == pytest.approx(math.pi / 2, rel=1e-9)
    assert comparison.judged.after <= REPAIRED < comparison.judged.before
    ((_, (in_a, _)),) = comparison.advice
    origin = re.search("<origin .*/>", in_a)
    assert origin is not None
    stand = f'<link name="w"/><joint name="w" type="fixed">{origin[0]}<parent link="w"/><child link="trunk"/></joint>'
    assert compare(legs(tmp_path, "c.urdf", UPRIGHT, before=stand), b).equal


def test_a_base_that_is_moved_is_felt_by_no_torque_and_named_all_the_same(tmp_path: Path) -> None:
    moved = [f"{place.removesuffix(' 0')} 0.5" for place in UPRIGHT]
    comparison = compare(legs(tmp_path, "a.urdf", UPRIGHT), legs(tmp_path, "b.urdf", moved))
    assert [(d.cause, d.size, d.unit) for d in comparison.differences] == [
        ("pose of base", pytest.approx(0.5, rel=1e-9), "m")
    ]
    assert comparison.differences[0].hints == ("no torque feels it: gravity has the same direction in it",)
    one = compare(tmp_path / "a.urdf", legs(tmp_path, "c.urdf", ("0.25 0.1 0", *UPRIGHT[1:])))
    assert [(d.cause, d.place) for d in one.differences] == [("position of joint", "joint hip_0")]


def test_a_leg_that_stands_elsewhere_on_a_turned_base_is_named_beside_it(tmp_path: Path) -> None:
    b = legs(tmp_path, "b.urdf", ("0.25 0 0.1", *LYING[1:]), f"{QUARTER} 0 0")
    comparison = compare(legs(tmp_path, "a.urdf", UPRIGHT), b)
    assert comparison.differences[0].cause == "pose of base"
    assert {d.place for d in comparison.differences[1:]} == {"joint hip_0"}
    assert comparison.judged.after <= REPAIRED


def plated(folder: Path, turn: str) -> Path:
    """The arm with another name for the link that is fixed to its forearm, turned by an angle [rad]."""
    text = arm(folder, ('rpy="0 1.2 0"', f'rpy="0 {turn} 0"'), name="b.urdf").read_text()
    (folder / "b.urdf").write_text(text.replace('"flange"', '"plate"'))
    return folder / "b.urdf"


def test_digits_of_a_fixed_link_between_count_for_what_hangs_on_it(tmp_path: Path) -> None:
    """The fingers' carrier is turned by what is below its last digit; merged into the forearm, that turns the fingers."""
    a = arm(tmp_path, ('rpy="0 1.2 0"', 'rpy="0 1.200000 0"'))
    comparison = compare(a, plated(tmp_path, "1.2000004"))
    assert [d.words for d in comparison.differences] == []
    assert comparison.judged.rounding
    assert comparison.judged.rounding_effort > 0.0
    assert not compare(a, plated(tmp_path, "1.2004")).equal


def test_six_digits_of_an_mjcf_are_rounding(tmp_path: Path) -> None:
    """MuJoCo writes the hand's frame with six digits, as a body that it holds to the forearm or merges into it."""
    mujoco = pytest.importorskip("mujoco")
    file = arm(tmp_path, ('<mimic joint="grip"/>', ""), ('friction="0.1"', ""))
    for fused in ("true", "false"):
        told = f'<mujoco><compiler fusestatic="{fused}"/></mujoco></robot>'
        model = mujoco.MjModel.from_xml_string(file.read_text().replace("</robot>", told))
        mujoco.mj_saveLastXML(str(tmp_path / "arm.xml"), model)
        comparison = compare(file, tmp_path / "arm.xml")
        assert [d.words for d in comparison.differences] == []
        assert comparison.judged.rounding
