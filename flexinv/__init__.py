"""flexinv: joint torques of rigid, flexible and mixed mechanisms by parallel finite-element inverse dynamics."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexinv.batch import Batch, solve_many
    from flexinv.controller import Controller
    from flexinv.derivatives import TorqueDerivatives, torque_derivatives
    from flexinv.errors import ConvergenceError, FlexinvError, InputError, ModelWarning
    from flexinv.files.case import Case, load_cases
    from flexinv.files.mechanism_file import load_mechanism
    from flexinv.files.urdf import from_urdf
    from flexinv.following import Following, follow
    from flexinv.forward import simulate
    from flexinv.linear import LinearModel, linear_model
    from flexinv.mechanism import Mechanism
    from flexinv.modes import Modes, natural_modes
    from flexinv.motion import Motion
    from flexinv.parameters import BaseParameters, Regressor, base_parameters, torque_regressor
    from flexinv.parts import solve_in_parts
    from flexinv.path import Path
    from flexinv.prepared import TorqueFunction, prepare
    from flexinv.rest import Load, statics
    from flexinv.scheme import solve
    from flexinv.solution import Solution
    from flexinv.torques import joint_torques
    from flexinv.vibration import SteadyModes, steady_modes

# Where each public name lives; it is imported when first used, so that a program that only reads a mechanism
# does not wait for the compiler.
_HOME = {
    "BaseParameters": "parameters",
    "Batch": "batch",
    "Case": "files.case",
    "Controller": "controller",
    "ConvergenceError": "errors",
    "FlexinvError": "errors",
    "Following": "following",
    "InputError": "errors",
    "LinearModel": "linear",
    "Load": "rest",
    "Mechanism": "mechanism",
    "ModelWarning": "errors",
    "Modes": "modes",
    "Motion": "motion",
    "Regressor": "parameters",
    "Path": "path",
    "Solution": "solution",
    "SteadyModes": "vibration",
    "TorqueDerivatives": "derivatives",
    "TorqueFunction": "prepared",
    "base_parameters": "parameters",
    "follow": "following",
    "from_urdf": "files.urdf",
    "joint_torques": "torques",
    "linear_model": "linear",
    "load_cases": "files.case",
    "load_mechanism": "files.mechanism_file",
    "natural_modes": "modes",
    "prepare": "prepared",
    "simulate": "forward",
    "solve": "scheme",
    "solve_in_parts": "parts",
    "solve_many": "batch",
    "statics": "rest",
    "steady_modes": "vibration",
    "torque_derivatives": "derivatives",
    "torque_regressor": "parameters",
}

__all__ = [
    "BaseParameters",
    "Batch",
    "Case",
    "Controller",
    "ConvergenceError",
    "FlexinvError",
    "Following",
    "InputError",
    "LinearModel",
    "Load",
    "Mechanism",
    "ModelWarning",
    "Modes",
    "Motion",
    "Path",
    "Regressor",
    "Solution",
    "SteadyModes",
    "TorqueDerivatives",
    "TorqueFunction",
    "base_parameters",
    "follow",
    "from_urdf",
    "joint_torques",
    "linear_model",
    "load_cases",
    "load_mechanism",
    "natural_modes",
    "prepare",
    "simulate",
    "solve",
    "solve_in_parts",
    "solve_many",
    "statics",
    "steady_modes",
    "torque_derivatives",
    "torque_regressor",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'flexinv' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(f"flexinv.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})
