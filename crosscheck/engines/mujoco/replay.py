"""Torques drive a rigid arm in MuJoCo: its own step with the integrator RK4, the torque of a step's middle throughout it."""

from __future__ import annotations

import mujoco
import numpy as np

from crosscheck.engines.mujoco.joints import convert_to_engine
from crosscheck.engines.mujoco.model import build
from crosscheck.engines.shared.prescribed import passive_effort
from crosscheck.engines.shared.replay import Array, DriveTorques
from flexinv.model.mechanism import Mechanism


def replay(mechanism: Mechanism, drive: DriveTorques) -> dict[str, Array]:
    """Return the paths of the links' tips, by link (samples, 3) [m], at the times of the torque; one step between two."""
    built = build(mechanism)
    model = built.model
    data = mujoco.MjData(built.model)
    if model.nv != mechanism.nv:
        raise ValueError("replayed in MuJoCo are arms whose joints are joints of MuJoCo, each with as many coordinates")
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = drive.spacing
    still = np.zeros((1, mechanism.nv))
    if passive_effort(mechanism, still + 1.0).any():
        raise ValueError("replayed in MuJoCo are arms without damping and dry friction in their joints")
    data.qpos[:] = convert_to_engine(mechanism, built, drive.q[None], still, still).q[0]
    efforts = drive.fill_efforts(mechanism.actuated)
    order = np.concatenate([built.v_at[j.name] + np.arange(j.nv) for j in mechanism.joints if j.nv])
    tip = {link.name: np.empty((len(efforts), 3)) for link in mechanism.links}
    for k in range(len(efforts)):
        mujoco.mj_kinematics(model, data)
        for link in mechanism.links:
            body = built.body[link.name]
            tip[link.name][k] = data.xpos[body] + data.xmat[body].reshape(3, 3) @ link.tip
        if k + 1 < len(efforts):
            data.qfrc_applied[order] = efforts[k : k + 2].mean(axis=0)
            mujoco.mj_step(model, data)
    return tip
