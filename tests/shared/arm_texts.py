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

# The same arm in SDF, without the coupling of its fingers and without dry friction, which Drake's reader does not take.
ARM_SDF = """<sdf version="1.9"><model name="arm">
  <joint name="to_world" type="fixed"><parent>world</parent><child>base</child></joint>
  <link name="base"><inertial><mass>4.125</mass><inertia><ixx>0.02</ixx><iyy>0.02</iyy><izz>0.02</izz></inertia></inertial></link>
  <joint name="shoulder" type="revolute"><parent>base</parent><child>upper</child><pose relative_to="base">0 0 0.1 0.2 0 0</pose>
    <axis><xyz>0 1 0</xyz><limit><lower>-1.5</lower><upper>2.0</upper><effort>50</effort><velocity>2</velocity></limit>
      <dynamics><damping>0.3</damping></dynamics></axis></joint>
  <link name="upper"><pose relative_to="shoulder">0 0 0 0 0 0</pose><inertial><pose>0.01 0.02 0.153 0.1 0.2 0.3</pose>
    <mass>3.25</mass><inertia><ixx>0.031</ixx><ixy>0.001</ixy><ixz>0.002</ixz><iyy>0.029</iyy><iyz>0.0005</iyz>
      <izz>0.008</izz></inertia></inertial></link>
  <joint name="elbow" type="revolute"><parent>upper</parent><child>lower</child>
    <pose relative_to="upper">0.05 0 0.3 0 0.3 0.1</pose>
    <axis><xyz>0 0 1</xyz><limit><lower>-2.5</lower><upper>2.0</upper><effort>30</effort><velocity>2</velocity></limit></axis>
  </joint>
  <link name="lower"><pose relative_to="elbow">0 0 0 0 0 0</pose><inertial><pose>0.11 0.01 0.02 0 0 0</pose>
    <mass>2.375</mass><inertia><ixx>0.004</ixx><ixy>0.0002</ixy><iyy>0.016</iyy><izz>0.017</izz></inertia></inertial></link>
  <joint name="to_flange" type="fixed"><parent>lower</parent><child>flange</child>
    <pose relative_to="lower">0.25 0 0 0 1.2 0</pose></joint>
  <link name="flange"><pose relative_to="to_flange">0 0 0 0 0 0</pose><inertial><pose>0 0 0.015 0 0 0</pose>
    <mass>0.8125</mass><inertia><ixx>0.0005</ixx><iyy>0.0006</iyy><izz>0.0007</izz></inertia></inertial></link>
  <joint name="grip" type="prismatic"><parent>flange</parent><child>finger</child>
    <pose relative_to="flange">0.02 0 0.05 0 0 0</pose>
    <axis><xyz>1 0 0</xyz><limit><lower>0</lower><upper>0.04</upper><effort>20</effort><velocity>0.2</velocity></limit></axis>
  </joint>
  <link name="finger"><pose relative_to="grip">0 0 0 0 0 0</pose><inertial><pose>0.01 0 0.03 0 0 0</pose>
    <mass>0.125</mass><inertia><ixx>0.00003</ixx><iyy>0.00003</iyy><izz>0.00001</izz></inertia></inertial></link>
  <joint name="grip_mirror" type="prismatic"><parent>flange</parent><child>other_finger</child>
    <pose relative_to="flange">-0.02 0 0.05 0 0 0</pose>
    <axis><xyz>-1 0 0</xyz><limit><lower>0</lower><upper>0.04</upper><effort>20</effort><velocity>0.2</velocity></limit></axis>
  </joint>
  <link name="other_finger"><pose relative_to="grip_mirror">0 0 0 0 0 0</pose><inertial><pose>-0.01 0 0.03 0 0 0</pose>
    <mass>0.125</mass><inertia><ixx>0.00003</ixx><iyy>0.00003</iyy><izz>0.00001</izz></inertia></inertial></link>
</model></sdf>
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
