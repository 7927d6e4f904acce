"""Losses of MuJoCo when it fuses bodies without joints into their parents (``fusestatic``, its default for URDF).

For every moving body the inertia of all that is welded to it is composed from the model that was *not* fused,

    I = sum R_k J_k R_k^T + m_k (|d_k|^2 1 - d_k d_k^T),   d_k = x_k - x_com   (world axes, qpos0)

and compared with the inertia of the fused body.  What is missing is compared with the inertia of the welded bodies that
have inertia but no mass: a fusion weighted by mass is blind to those.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.mujoco.model import build
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InertiaLoss:
    """Inertia that a fused body lacks.

    body : its name; missing : (3, 3) [kg m^2], world axes at qpos0
    scale : largest entry of what it should have [kg m^2]
    massless : names of the welded bodies without mass; stated : (3, 3) [kg m^2], the sum of their inertia
    """

    body: str
    missing: Array
    scale: float
    massless: tuple[str, ...]
    stated: Array

    @property
    def explained(self) -> bool:
        """Return True if the massless bodies' inertia is the missing one, to rounding of the composition."""
        return bool(self.massless) and _is_close(self.missing, self.stated, self.scale)


def list_losses(mechanism: Mechanism) -> tuple[InertiaLoss, ...]:
    """Return the losses of fusing, body by body; empty where it loses nothing."""
    whole, fused = (_build_start(build(mechanism, fuse=fuse).model) for fuse in (False, True))
    found = []
    for body in range(1, fused.model.nbody):
        name = fused.model.body(body).name
        parts = np.flatnonzero(whole.model.body_weldid == whole.model.body_weldid[whole.model.body(name).id])
        expected = compute_composite_inertia(whole, parts)
        got = compute_composite_inertia(fused, np.array([body]))
        scale = float(np.abs(expected).max())
        if not _is_close(expected, got, scale):
            massless = [int(k) for k in parts if whole.model.body_mass[k] == 0.0 and whole.model.body_inertia[k].any()]
            stated = sum((_compute_world_inertia(whole, k) for k in massless), np.zeros((3, 3)))
            names = tuple(whole.model.body(k).name for k in massless)
            found.append(InertiaLoss(name, expected - got, scale, names, stated))
    return tuple(found)


@dataclass(frozen=True)
class ReferenceState:
    """A model and its data at qpos0, kinematics done."""

    model: Any
    data: Any


def _build_start(model: Any) -> ReferenceState:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return ReferenceState(model, data)


def compute_composite_inertia(start: ReferenceState, bodies: NDArray[np.intp]) -> Array:
    """Return the inertia of several bodies as one about its centre of mass, (3, 3) [kg m^2], world axes."""
    mass = start.model.body_mass[bodies]
    centre = start.data.xipos[bodies]
    total = mass.sum()
    arms = centre - (mass @ centre / total if total > 0 else centre[0])  # (body, xyz)
    out = np.zeros((3, 3))
    for body, m, d in zip(bodies, mass, arms, strict=True):
        out += _compute_world_inertia(start, int(body)) + m * (d @ d * np.eye(3) - np.outer(d, d))
    return out


def _compute_world_inertia(start: ReferenceState, body: int) -> Array:
    axes = start.data.ximat[body].reshape(3, 3)
    return np.asarray(axes @ np.diag(start.model.body_inertia[body]) @ axes.T)


def _is_close(a: Array, b: Array, scale: float) -> bool:
    # Each side went through an eigenvalue problem whose threshold in MuJoCo is 1e-12, and through sums of a few bodies.
    return bool(np.abs(a - b).max() <= 1e-11 * scale)
