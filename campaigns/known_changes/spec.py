"""Mass of a model that is made by MjSpec, an interface that came, changed and stayed."""

import mujoco

spec = mujoco.MjSpec()
body = spec.worldbody.add_body(pos=[0, 0, 1])
body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0])
print("mass", spec.compile().body_mass[1])
