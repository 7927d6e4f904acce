"""flexinv: joint torques of rigid, flexible and mixed mechanisms by parallel finite-element inverse dynamics."""

from __future__ import annotations

from flexinv.errors import ConvergenceError, FlexinvError, InputError, ModelWarning
from flexinv.mechanism import Mechanism
from flexinv.torques import joint_torques

__all__ = [
    "ConvergenceError",
    "FlexinvError",
    "InputError",
    "Mechanism",
    "ModelWarning",
    "joint_torques",
]
