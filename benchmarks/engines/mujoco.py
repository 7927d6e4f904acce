"""MuJoCo's inverse dynamics as it is called when time matters: ``mj_inverse`` in a loop, nothing kept but the torque."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from crosscheck.engines.mujoco.joints import convert_effort_from_engine, convert_to_engine
from crosscheck.engines.mujoco.model import build
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array


def prepare_loop(
    mechanism: Mechanism, q: Array, qd: Array, qdd: Array
) -> tuple[Callable[[], Array], Callable[[Array], Array]]:
    """Call ``mj_inverse`` for every sample (samples, nq), (samples, nv) [rad, s].

    Returns what does the work, and what turns its forces into torques (samples, nv) [N m] in the mechanism's order.
    """
    built = build(mechanism)
    model = built.model
    data = mujoco.MjData(built.model)
    state = convert_to_engine(mechanism, built, q, qd, qdd)
    tau = np.empty((len(q), model.nv))

    def run() -> Array:
        for k in range(len(tau)):
            data.qpos[:] = state.q[k]
            data.qvel[:] = state.v[k]
            data.qacc[:] = state.a[k]
            mujoco.mj_inverse(model, data)
            tau[k] = data.qfrc_inverse
        return tau

    return run, lambda answer: convert_effort_from_engine(mechanism, built, q, answer)
