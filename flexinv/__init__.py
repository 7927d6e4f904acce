"""flexinv: joint torques of rigid, flexible and mixed mechanisms by parallel finite-element inverse dynamics."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexinv.analysis.controller import Controller
    from flexinv.analysis.find_limits import LimitUse, find_limits
    from flexinv.analysis.simulate import simulate
    from flexinv.analysis.solution import Solution
    from flexinv.analysis.solve import solve
    from flexinv.analysis.solve_in_parts import solve_in_parts
    from flexinv.analysis.solve_many import Batch, solve_many
    from flexinv.analysis.statics import Load, statics
    from flexinv.errors import ConvergenceError, FlexinvError, InputError, ModelWarning
    from flexinv.export.export_c import ExportedLibrary, export_c
    from flexinv.export.export_fmu import export_fmu
    from flexinv.export.export_ros import export_ros
    from flexinv.files.from_urdf import from_urdf
    from flexinv.files.load_cases import Case, load_cases
    from flexinv.files.load_mechanism import load_mechanism
    from flexinv.linearized.linear_model import LinearModel, linear_model
    from flexinv.linearized.make_shaped_motion import ShapedMotion, make_shaped_motion
    from flexinv.linearized.modes import Modes
    from flexinv.linearized.natural_modes import natural_modes
    from flexinv.linearized.residual_vibration import ResidualVibration
    from flexinv.linearized.steady_modes import SteadyModes, steady_modes
    from flexinv.model.input_shaper import InputShaper
    from flexinv.model.links import Body, Inertia
    from flexinv.model.make_shaper import make_shaper
    from flexinv.model.mechanism import Mechanism
    from flexinv.model.motion import Motion
    from flexinv.optimal_motion.motion_limits import MotionLimits, StrainLimit
    from flexinv.optimal_motion.optimize_motion import optimize_motion
    from flexinv.optimal_motion.optimized_motion import OptimizedMotion
    from flexinv.rigid.joint_torques import joint_torques
    from flexinv.rigid.prepare import TorqueFunction, prepare
    from flexinv.rigid.torque_derivatives import TorqueDerivatives, torque_derivatives
    from flexinv.rigid.torque_regressor import BaseParameters, Regressor, base_parameters, torque_regressor
    from flexinv.sampled.torques import torques
    from flexinv.sampled.write_torques import TorqueSummary, write_torques
    from flexinv.sensitivity.differentiate import differentiate
    from flexinv.sensitivity.differentiate_modes import ModeSlopes, differentiate_modes
    from flexinv.sensitivity.find_gradient import find_gradient
    from flexinv.sensitivity.gradient import Gradient
    from flexinv.sensitivity.parameters import Parameter
    from flexinv.sensitivity.sensitivities import Sensitivities
    from flexinv.tracking.follow import Following, follow
    from flexinv.tracking.frame_path import Path

# Where each public name lives; it is imported when first used: who only reads a mechanism does not wait for the compiler.
_NAMES = {
    "analysis.controller": "Controller", "analysis.find_limits": "LimitUse find_limits",
    "analysis.motor_side": "motor_side", "analysis.simulate": "simulate",
    "analysis.solution": "Solution", "analysis.solve": "solve", "analysis.solve_in_parts": "solve_in_parts",
    "analysis.solve_many": "Batch solve_many", "analysis.statics": "Load statics",
    "sampled.torques": "torques", "sampled.write_torques": "TorqueSummary write_torques",
    "export.export_c": "ExportedLibrary export_c",
    "export.export_fmu": "export_fmu",
    "export.export_ros": "export_ros",
    "errors": "ConvergenceError FlexinvError InputError ModelWarning",
    "files.from_urdf": "from_urdf", "files.load_cases": "Case load_cases", "files.load_mechanism": "load_mechanism",
    "linearized.linear_model": "LinearModel linear_model", "linearized.modes": "Modes",
    "linearized.natural_modes": "natural_modes", "linearized.residual_vibration": "ResidualVibration",
    "linearized.make_shaped_motion": "ShapedMotion make_shaped_motion",
    "model.input_shaper": "InputShaper", "model.make_shaper": "make_shaper",
    "linearized.steady_modes": "SteadyModes steady_modes", "model.links": "Body Inertia",
    "model.mechanism": "Mechanism", "model.motion": "Motion",
    "rigid.joint_torques": "joint_torques", "rigid.prepare": "TorqueFunction prepare",
    "rigid.torque_derivatives": "TorqueDerivatives torque_derivatives",
    "rigid.torque_regressor": "BaseParameters Regressor base_parameters torque_regressor",
    "optimal_motion.motion_limits": "MotionLimits StrainLimit", "optimal_motion.optimize_motion": "optimize_motion",
    "optimal_motion.optimized_motion": "OptimizedMotion",
    "sensitivity.differentiate": "differentiate",
    "sensitivity.differentiate_modes": "ModeSlopes differentiate_modes", "sensitivity.find_gradient": "find_gradient",
    "sensitivity.gradient": "Gradient",
    "sensitivity.parameters": "Parameter", "sensitivity.sensitivities": "Sensitivities",
    "tracking.follow": "Following follow", "tracking.frame_path": "Path",
}  # fmt: skip
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = [
    "BaseParameters", "Batch", "Body", "Case", "Controller", "ConvergenceError", "ExportedLibrary", "FlexinvError",
    "Following", "Gradient", "Inertia",
    "InputError", "InputShaper",
    "LimitUse", "LinearModel", "Load", "Mechanism", "ModeSlopes", "ModelWarning", "Modes", "Motion", "MotionLimits",
    "OptimizedMotion", "Parameter", "Path", "Regressor",
    "ResidualVibration", "Sensitivities", "ShapedMotion", "Solution", "SteadyModes", "StrainLimit",
    "TorqueDerivatives", "TorqueFunction", "TorqueSummary",
    "__version__", "base_parameters", "differentiate", "differentiate_modes", "export_c", "export_fmu", "export_ros",
    "find_gradient", "find_limits", "follow", "from_urdf", "joint_torques",
    "linear_model", "load_cases", "load_mechanism", "make_shaped_motion",
    "make_shaper", "motor_side", "natural_modes", "optimize_motion", "prepare", "simulate", "solve",
    "solve_in_parts", "solve_many", "statics", "steady_modes", "torque_derivatives", "torque_regressor",
    "torques", "write_torques",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562); the version is that of the installed package."""
    if name == "__version__":
        return _read_version()
    if name not in _HOME:
        raise AttributeError(f"module 'flexinv' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(f"flexinv.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def _read_version() -> str:
    from importlib import metadata

    try:
        return metadata.version("flexinv")
    except metadata.PackageNotFoundError:  # a checkout on the path that nobody has installed
        return "0+unknown"


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})
