"""Turn of a free body that spins about its middle axis, in Exudyn's Lie group node with steps of 10 ms."""

import exudyn as exu
import numpy as np
from exudyn.rigidBodyUtilities import AddRigidBody, RigidBodyInertia

container = exu.SystemContainer()
mbs = container.AddSystem()
inertia = RigidBodyInertia(mass=1.0, inertiaTensor=np.diag([1.0, 2.0, 3.0]))
node, _ = AddRigidBody(
    mainSys=mbs,
    inertia=inertia,
    nodeType=exu.NodeType.RotationRotationVector,
    angularVelocity=[0.5, 3.0, 0.2],
    gravity=[0, 0, 0],
)
mbs.Assemble()
settings = exu.SimulationSettings()
settings.timeIntegration.numberOfSteps = 200
settings.timeIntegration.endTime = 2.0
settings.solutionSettings.writeSolutionToFile = False
settings.timeIntegration.verboseMode = 0
mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
print("turn", mbs.GetNodeOutput(node, exu.OutputVariableType.AngularVelocity)[0])
