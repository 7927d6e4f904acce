"""Pinocchio's model with a mistake in it: inertias and armatures as users leave them, for faults beyond the dictionary."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from crosscheck.engines.pinocchio.model import BuiltModel


def replace_inertia_order(built_model: BuiltModel, joint: str) -> None:
    """Give xx, yy, zz, xy, xz, yz [kg m^2] of what a joint carries where xx, xy, yy, xz, yz, zz are wanted.

    The constructor refuses a tensor with a negative diagonal, as yz may be one; who writes into an inertia is not refused.
    """
    index, _ = built_model.joint[joint]
    old = built_model.model.inertias[index]
    t = np.array(old.inertia)
    xx = t[0, 0]
    yy = t[1, 1]
    zz = t[2, 2]
    xy = t[0, 1]
    xz = t[0, 2]
    yz = t[1, 2]
    wrong = pin.Inertia(old)
    wrong.inertia = np.array([[xx, yy, xy], [yy, zz, xz], [xy, xz, yz]])
    built_model.model.inertias[index] = wrong


def scale_mass_lever(built_model: BuiltModel, joint: str, factor: float) -> None:
    """Put the centre of mass of what a joint carries farther out by a factor [-]."""
    index, _ = built_model.joint[joint]
    old = built_model.model.inertias[index]
    built_model.model.inertias[index] = pin.Inertia(old.mass, old.lever * factor, old.inertia)


def remove_armature(built_model: BuiltModel) -> None:
    """Forget all rotors."""
    built_model.model.armature[:] = 0.0
