"""flexinv: joint torques of rigid, flexible and mixed mechanisms by parallel finite-element inverse dynamics."""

from __future__ import annotations

from flexinv.errors import ConvergenceError, FlexinvError, InputError, ModelWarning
from flexinv.mechanism import Mechanism
from flexinv.mechanism_file import load_mechanism
from flexinv.motion import Motion
from flexinv.solution import Solution
from flexinv.solve import solve
from flexinv.statics import Load, statics
from flexinv.torques import joint_torques
from flexinv.urdf import from_urdf

__all__ = [
    "ConvergenceError",
    "FlexinvError",
    "InputError",
    "Load",
    "Mechanism",
    "ModelWarning",
    "Motion",
    "Solution",
    "from_urdf",
    "joint_torques",
    "load_mechanism",
    "solve",
    "statics",
]
