"""Height of the free end of a cable that is a composite, after it has hung for a second."""

import mujoco

MODEL = """<mujoco><option timestep="0.001"/><extension><plugin plugin="mujoco.elasticity.cable"/></extension><worldbody>
<composite type="cable" curve="s" count="11 1 1" size="1" offset="0 0 1" initial="none">
  <plugin plugin="mujoco.elasticity.cable"><config key="twist" value="1e7"/><config key="bend" value="4e6"/></plugin>
  <joint kind="main" damping="0.01"/><geom type="capsule" size=".005"/></composite>
</worldbody></mujoco>"""

model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
for _ in range(100):
    mujoco.mj_step(model, data)
print("height", data.xpos[-1, 2])
