"""Height of a box that has fallen upon another one."""

import mujoco

MODEL = """<mujoco><worldbody><geom type="box" size="0.2 0.2 0.1" pos="0 0 0.1"/><body pos="0.05 0 0.6" euler="20 30 0">
<freejoint/><geom type="box" size="0.1 0.05 0.03"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
while data.time < 0.6:
    mujoco.mj_step(model, data)
print("height", data.qpos[2])
assert 0.2 < data.qpos[2] < 0.4
