"""Inertia of a link whose frame of inertia is turned in its URDF: expected is the tensor in the link's axes."""

import mujoco
import numpy as np

URDF = """<robot name="arm">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.5"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0.004" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
c, s = np.cos(0.5), np.sin(0.5)
r = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
expected = r @ [[0.01, 0.004, 0], [0.004, 0.02, 0], [0, 0, 0.025]] @ r.T

model = mujoco.MjModel.from_xml_string(URDF)
body = model.nbody - 1
axes = np.zeros(9)
mujoco.mju_quat2Mat(axes, model.body_iquat[body])
axes = axes.reshape(3, 3)
got = axes @ np.diag(model.body_inertia[body]) @ axes.T
print("tensor", got.round(6).tolist())
assert np.allclose(got, expected, atol=1e-8), (got, expected)
