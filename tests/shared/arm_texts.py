"""A small arm as URDF text, edited as a test wants it: three moving joints, a gripper with a mimic finger, a fixed flange."""

from __future__ import annotations

from pathlib import Path

ARM = """<robot name="arm">
  <link name="base"><inertial><mass value="4.125"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0.01 0.02 0.153" rpy="0.1 0.2 0.3"/><mass value="3.25"/>
    <inertia ixx="0.031" ixy="0.001" ixz="0.002" iyy="0.029" iyz="0.0005" izz="0.008"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.11 0.01 0.02"/><mass value="2.375"/>
    <inertia ixx="0.004" ixy="0.0002" ixz="0" iyy="0.016" iyz="0" izz="0.017"/></inertial></link>
  <link name="flange"><inertial><origin xyz="0 0 0.015"/><mass value="0.8125"/>
    <inertia ixx="0.0005" ixy="0" ixz="0" iyy="0.0006" iyz="0" izz="0.0007"/></inertial></link>
  <link name="finger"><inertial><origin xyz="0.01 0 0.03"/><mass value="0.125"/>
    <inertia ixx="0.00003" ixy="0" ixz="0" iyy="0.00003" iyz="0" izz="0.00001"/></inertial></link>
  <link name="other_finger"><inertial><origin xyz="-0.01 0 0.03"/><mass value="0.125"/>
    <inertia ixx="0.00003" ixy="0" ixz="0" iyy="0.00003" iyz="0" izz="0.00001"/></inertial></link>
  <joint name="shoulder" type="revolute"><origin xyz="0 0 0.1" rpy="0.2 0 0"/><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-1.5" upper="2.0" effort="50" velocity="2"/><dynamics damping="0.3" friction="0.1"/></joint>
  <joint name="elbow" type="revolute"><origin xyz="0.05 0 0.3" rpy="0 0.3 0.1"/><parent link="upper"/><child link="lower"/>
    <axis xyz="0 0 1"/><limit lower="-2.5" upper="2.0" effort="30" velocity="2"/></joint>
  <joint name="to_flange" type="fixed"><origin xyz="0.25 0 0" rpy="0 1.2 0"/><parent link="lower"/><child link="flange"/></joint>
  <joint name="grip" type="prismatic"><origin xyz="0.02 0 0.05"/><parent link="flange"/><child link="finger"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/></joint>
  <joint name="grip_mirror" type="prismatic"><origin xyz="-0.02 0 0.05"/><parent link="flange"/><child link="other_finger"/>
    <axis xyz="-1 0 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/><mimic joint="grip"/></joint>
</robot>
"""


def arm(folder: Path, *edits: tuple[str, str], name: str = "arm.urdf") -> Path:
    """Write the arm with parts of its text exchanged: each part has to be there."""
    text = ARM
    for before, after in edits:
        assert text.count(before) >= 1, before
        text = text.replace(before, after, 1)
    path = folder / name
    path.write_text(text)
    return path
