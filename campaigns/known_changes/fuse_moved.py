"""Inertia of a link with a tool that a fixed joint of a URDF turns and moves: expected is the sum of both, about their centre."""

import mujoco
import numpy as np

URDF = """<robot name="arm">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
  <inertia ixx="0.03" iyy="0.05" izz="0.07" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="flange" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0.3 0 0" rpy="0.4 0.7 -0.3"/></joint>
</robot>"""


def turned(roll, pitch, yaw):
    (a, b), (c, d), (e, f) = [(np.cos(x), np.sin(x)) for x in (roll, pitch, yaw)]
    x = np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
    y = np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]])
    return np.array([[e, -f, 0], [f, e, 0], [0, 0, 1]]) @ y @ x


r = turned(0.4, 0.7, -0.3)
masses = np.array([1.0, 2.0])
centres = np.array([[0.1, 0.0, 0.0], np.array([0.3, 0, 0]) + r @ [0, 0, 0.2]])
tensors = [np.diag([0.01, 0.02, 0.025]), r @ np.diag([0.03, 0.05, 0.07]) @ r.T]
centre = masses @ centres / masses.sum()
whole = sum(
    t + m * ((d @ d) * np.eye(3) - np.outer(d, d)) for t, m, d in zip(tensors, masses, centres - centre, strict=True)
)

model = mujoco.MjModel.from_xml_string(URDF)
body = model.nbody - 1
got = np.sort(model.body_inertia[body])
expected = np.sort(np.linalg.eigvalsh(whole))
print("moments", got, "expected", expected)
print("distance", np.abs(got - expected).max() / expected.max())
