"""Efforts that actuators and joints of an MJCF allow, each by the formula of MuJoCo's documentation, against numbers by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

import crosscheck
from crosscheck.equivalence.sources import describe

MJCF = """<mujoco><worldbody><body name="arm"><joint name="hinge" axis="0 0 1"{joint}/>
  <inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody><actuator>{actuators}</actuator></mujoco>"""
URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hinge" type="continuous">
  <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/><limit effort="35" velocity="9"/></joint></robot>"""
CASES = {
    "of the joint": (' actuatorfrcrange="-35 35"', "", 35.0),
    "of the actuator, by its gear": ("", '<motor joint="hinge" gear="-50" forcerange="-0.7 0.7"/>', 35.0),
    "of a motor's control": ("", '<motor joint="hinge" gear="10" ctrlrange="-3.5 3.5"/>', 35.0),
    "the smaller of both": (' actuatorfrcrange="-35 35"', '<motor joint="hinge" gear="50" forcerange="-7 7"/>', 35.0),
    "of two together": ("", '<motor joint="hinge" forcerange="-30 30"/><motor joint="hinge" forcerange="-5 5"/>', 35.0),
    "a control that is an angle": ("", '<position joint="hinge" kp="9" ctrlrange="-3.5 3.5"/>', np.inf),
    "one of two without a bound": ("", '<motor joint="hinge" forcerange="-30 30"/><motor joint="hinge"/>', np.inf),
    "none": ("", "", np.inf),
}


@pytest.mark.parametrize("kind", CASES)
def test_the_largest_effort(kind: str, tmp_path: Path) -> None:
    joint, actuators, effort = CASES[kind]
    (tmp_path / "arm.xml").write_text(MJCF.format(joint=joint, actuators=actuators))
    result = describe(tmp_path / "arm.xml").mechanism.joint_of["hinge"].limits.effort
    assert result == pytest.approx(effort, rel=1e-12)


PLUGIN = """<extension><plugin plugin="mujoco.pid"><instance name="pid"><config key="kp" value="4"/></instance></plugin>
</extension>
<worldbody>"""


def test_the_setpoints_of_a_plugin_bound_no_effort(tmp_path: Path) -> None:
    text = MJCF.format(
        joint="", actuators='<plugin plugin="mujoco.pid" instance="pid" joint="hinge" ctrlrange="-3.5 3.5"/>'
    )
    (tmp_path / "arm.xml").write_text(text.replace("<worldbody>", PLUGIN))
    assert describe(tmp_path / "arm.xml").mechanism.joint_of["hinge"].limits.effort == np.inf


def test_a_control_that_is_not_clamped_bounds_no_effort(tmp_path: Path) -> None:
    text = MJCF.format(joint="", actuators='<motor joint="hinge" gear="10" ctrlrange="-3.5 3.5"/>')
    text = text.replace("<worldbody>", '<option><flag clampctrl="disable"/></option><worldbody>')
    (tmp_path / "arm.xml").write_text(text)
    assert describe(tmp_path / "arm.xml").mechanism.joint_of["hinge"].limits.effort == np.inf


def test_two_directions_that_differ_are_told(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(MJCF.format(joint=' actuatorfrcrange="-20 35"', actuators=""))
    result = describe(tmp_path / "arm.xml")
    assert result.mechanism.joint_of["hinge"].limits.effort == 35.0
    assert any("effort of joint hinge: -20 to 35" in words for words in result.dropped)


def test_it_is_compared_with_a_urdf(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(URDF)
    for effort, named in ((35, []), (30, ["effort limit"])):
        (tmp_path / "arm.xml").write_text(MJCF.format(joint=f' actuatorfrcrange="-{effort} {effort}"', actuators=""))
        comparison = crosscheck.compare(tmp_path / "arm.urdf", tmp_path / "arm.xml")
        assert [d.cause for d in comparison.differences] == named
    assert any('<joint actuatorfrcrange="-35 35"/>' in line for _, lines in comparison.advice for line in lines)
