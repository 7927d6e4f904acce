"""Sensitivities: derivatives along a solution, and of what goes on swinging after it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from flexinv.analysis.solution import Solution
from flexinv.errors import InputError
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.linearized.residual_vibration import ResidualVibration, compute_amplitudes
from flexinv.model.by_value import ByValue
from flexinv.typing import Array, Mask

if TYPE_CHECKING:
    import pandas as pd


def check_unchanged_ends(parameters: Sequence[str], alike: Mask, solution: Solution) -> None:
    """Raise InputError for a parameter that does not leave the end of a solution as it is; alike : (parameters,) [-]."""
    for name, ends in zip(parameters, alike, strict=True):
        if not ends:
            raise InputError(
                f"residual vibration by {name!r}: it changes how joints are at {solution.time[-1]:g} s, or the mechanism, and "
                "with that the modes; expected rows of the motion between its ends, or 'motion.duration' with an end behind "
                "the motion's own"
            )


@dataclass(frozen=True, eq=False)
class ResidualSlopes(ByValue):
    """Derivatives of a residual vibration by parameters.

    vibration : where they are taken; cosine, sine : (modes, parameters) of a_i, b_i [m kg^0.5] per unit
    energy : (parameters,) [J] per unit
    """

    vibration: ResidualVibration
    cosine: Array
    sine: Array
    energy: Array


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(ByValue):
    """Derivatives by parameters along a solution, in units of what is differentiated over the unit of each parameter.

    solution : where they are taken; parameters : names; values : (parameters,) where they stand
    torque : (samples, actuated, parameters) [N m] or [N] per unit, columns as ``solution.torque_names``
    tip : link -> (samples, 3, parameters) [m] per unit; q : (samples, nv, parameters) [rad], [m] per unit, of all joints
    end : of the motion of all nodes in the last sample, with an axis of parameters in place of samples, where
    ends_alike : (parameters,) says that a parameter leaves the mechanism and its joints at the end as they are
    results : what else was asked for -> joint, beam, closure or kind of energy -> (samples, ..., parameters), each as the
        Solution has it
    """

    solution: Solution
    parameters: tuple[str, ...]
    values: Array
    torque: Array
    tip: dict[str, Array]
    q: Array
    end: NodalMotion
    ends_alike: Mask
    results: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)

    def differentiate_residual_vibration(self, free: Collection[str] | None = None) -> ResidualSlopes:
        """Return the derivatives of the vibration after the last sample by parameters of the motion [m kg^0.5], [J] per unit.

        free : names of joints that go on moving, as of ``Solution.find_residual_vibration``
        Raises InputError for parameters that change the mechanism or where and when joints come to rest, and as
        ``find_residual_vibration``.
        """
        check_unchanged_ends(self.parameters, self.ends_alike, self.solution)
        vibration = self.solution.find_residual_vibration(free)
        cosine, sine = compute_amplitudes(vibration.modes, self.end)
        squared = vibration.modes.squared.real
        weighted = squared * vibration.cosine, squared * vibration.sine
        return ResidualSlopes(vibration, cosine.T, sine.T, cosine @ weighted[0] + sine @ weighted[1])

    def frame(self) -> pd.DataFrame:
        """Return the derivatives of the torques [N m], [N] per unit over time [s], a column for each drive and parameter."""
        import pandas

        columns = pandas.MultiIndex.from_product([self.solution.torque_names, self.parameters], names=["torque", "by"])
        table = self.torque.reshape(len(self.torque), -1)
        return pandas.DataFrame(table, index=pandas.Index(self.solution.time, name="time [s]"), columns=columns)

    def __repr__(self) -> str:
        """Return samples, torques and parameters in a line."""
        drives = ", ".join(self.solution.torque_names)
        return f"Sensitivities({len(self.torque)} samples; torques of {drives} by {', '.join(self.parameters)})"
