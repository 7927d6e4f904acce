"""Angle of a stiff spring under the integrator `discrete`, which older releases do not know."""

import mujoco

MODEL = """<mujoco><option timestep="0.01" integrator="discrete"/><worldbody><body>
<joint type="hinge" axis="0 1 0" stiffness="100" damping="0.1"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/>
</body></worldbody></mujoco>"""

model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
for _ in range(100):
    mujoco.mj_step(model, data)
print("angle", data.qpos[0])
