"""MuJoCo's compiled model with a mistake in it: masses and switches as users leave them, for faults beyond the dictionary."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from crosscheck.engines.mujoco.joints import BuiltModel
from flexinv.typing import Array


def update_constants(built_model: BuiltModel) -> None:
    """Let MuJoCo work out again what depends on masses."""
    mujoco.mj_setConst(built_model.model, mujoco.MjData(built_model.model))


def scale_body_mass(built_model: BuiltModel, body: str, factor: float) -> None:
    """Change the mass [kg] of a body by a factor [-], its inertia not."""
    built_model.model.body(body).mass[:] *= factor
    update_constants(built_model)


def move_body_centre(built_model: BuiltModel, body: str, by: Array) -> None:
    """Move the centre of mass of a body by a vector (3,) [m]."""
    built_model.model.body(body).ipos[:] += by
    update_constants(built_model)


def apply_inertia_bound(built_model: BuiltModel, least: float) -> None:
    """Raise every principal inertia to a least value [kg m^2], as the compiler's boundinertia does."""
    built_model.model.body_inertia[1:] = np.maximum(built_model.model.body_inertia[1:], least)
    update_constants(built_model)


def scale_total_mass(built_model: BuiltModel, wanted: Callable[[float], float]) -> None:
    """Scale all masses and inertias to another total [kg], as the compiler's settotalmass does."""
    total = float(built_model.model.body_mass[1:].sum())
    built_model.model.body_mass[1:] *= wanted(total) / total
    built_model.model.body_inertia[1:] *= wanted(total) / total
    update_constants(built_model)


def apply_discrete_inverse(built_model: BuiltModel) -> None:
    """Switch the inverse of the discrete step on, with damping taken implicitly."""
    built_model.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_INVDISCRETE
    built_model.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST


def remove_dampers(built_model: BuiltModel) -> None:
    """Switch the dampers off; the model still has them."""
    built_model.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_DAMPER
