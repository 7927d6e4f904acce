"""Torque of one joint with a rotor's inertia by pin.rnea: 1 kg at 1 m, accelerated by 1 rad/s^2, and 0.5 kg m^2 of the rotor."""

import numpy as np
import pinocchio as pin

model = pin.Model()
joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([1.0, 0.0, 0.0]), np.zeros((3, 3))), pin.SE3.Identity())
model.armature = np.array([0.5])
data = model.createData()
print("torque", pin.rnea(model, data, np.zeros(1), np.zeros(1), np.ones(1))[0])
