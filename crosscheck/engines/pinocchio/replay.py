"""Torques drive a rigid arm in Pinocchio: articulated-body accelerations (aba), Runge and Kutta's method of order 4."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from crosscheck.engines.pinocchio.model import build
from crosscheck.engines.shared.prescribed import passive_effort
from crosscheck.engines.shared.replay import Array, DriveTorques
from flexinv.model.mechanism import Mechanism


def replay(mechanism: Mechanism, drive: DriveTorques) -> dict[str, Array]:
    """Return the paths of the links' tips, by link (samples, 3) [m], at the times of the torque; one step between two."""
    built = build(mechanism)
    model = built.model
    data = built.model.createData()
    efforts = np.empty((len(drive.torque), model.nv))
    efforts[:, built.v_order] = drive.fill_efforts(mechanism.actuated)
    q = np.empty(model.nq)
    v = np.zeros(model.nv)
    q[built.q_order] = drive.q

    def compute_acceleration(at: Array, rate: Array, effort: Array) -> Array:
        slowed = passive_effort(mechanism, rate[built.v_order][None])[0]
        resisted = effort.copy()
        resisted[built.v_order] -= slowed
        return np.asarray(pin.aba(model, data, at, rate, resisted))

    tip = {name: np.empty((len(efforts), 3)) for name in built.tip}
    for k in range(len(efforts)):
        pin.forwardKinematics(model, data, q)
        for name, (index, point) in built.tip.items():
            tip[name][k] = data.oMi[index].act(point)
        if k + 1 < len(efforts):
            q, v = _take_step(model, q, v, efforts[k : k + 2], drive.spacing, compute_acceleration)
    return tip


def _take_step(model: Any, q: Array, v: Array, efforts: Array, h: float, acceleration: Any) -> tuple[Array, Array]:
    middle = efforts.mean(axis=0)
    a1 = acceleration(q, v, efforts[0])
    v2 = v + 0.5 * h * a1
    a2 = acceleration(pin.integrate(model, q, 0.5 * h * v), v2, middle)
    v3 = v + 0.5 * h * a2
    a3 = acceleration(pin.integrate(model, q, 0.5 * h * v2), v3, middle)
    v4 = v + h * a3
    a4 = acceleration(pin.integrate(model, q, h * v3), v4, efforts[1])
    moved = pin.integrate(model, q, h / 6 * (v + 2 * v2 + 2 * v3 + v4))
    return moved, v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
