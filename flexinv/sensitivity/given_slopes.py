"""Derivatives of the joints with a motion by parameters: what enters the march of the tangents from outside."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from flexinv.kinematics.nodal_motion import collect_scalar_places
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.sensitivity.parameters import (
    Parameter,
    ParameterVariation,
    RowParameter,
    StretchParameter,
    VariedSetup,
    evaluate_rows,
    evaluate_stretch,
)
from flexinv.typing import Array, Mask, Triple


class GivenSlopes:
    """Derivatives of the joints with a motion, their rates and accelerations.

    given : (nv,) mask of coordinates with a motion; evaluate : setup, times -> q, qd, qdd of all joints
    """

    def __init__(
        self, setup: VariedSetup, parameters: Sequence[Parameter], variations: Sequence[ParameterVariation], given: Mask,
        evaluate: Callable[[VariedSetup, Array], Triple],
    ) -> None:  # fmt: skip
        """Record by what is differentiated."""
        self.mechanism: Mechanism
        self.motion: Motion
        self.mechanism, self.motion = setup
        self.parameters = parameters
        self.variations = variations
        self.given = given
        self.evaluate = evaluate

    def compute(self, time: Array) -> Array:
        """Return the derivatives (3, samples, joints, parameters) of joints with a motion, rates and accelerations [any unit]."""
        mechanism = self.mechanism
        out = np.zeros((3, len(time), mechanism.nv, len(self.parameters)))
        for v, columns, found in self._list_row_groups(time):
            out[:, :, v, columns] = found
        for k in self._list_other_parameters():
            out[..., k] = self._compute_given_column(k, time)
        return np.ascontiguousarray(out[:, :, self.given])  # one layout of memory, or kernels are compiled twice

    def add_up_weighted(self, time: Array, weights: Array) -> Array:
        """Return the sums (parameters,) of these derivatives times weights (3, samples, joints) [any unit].

        Of a motion with many rows no table of all derivatives is made.
        """
        out = np.zeros(len(self.parameters))
        whole = np.zeros((3, len(time), self.mechanism.nv))
        whole[:, :, self.given] = weights
        for v, columns, found in self._list_row_groups(time):
            out[columns] = sum(weight[:, v] @ part for weight, part in zip(whole, found, strict=True))
        for k in self._list_other_parameters():
            out[k] = np.vdot(whole, self._compute_given_column(k, time))
        return out

    def _list_row_groups(self, time: Array) -> Iterator[tuple[int, list[int], Triple]]:
        """Rows of a motion by joint: its coordinate, their numbers, derivatives (samples, rows) of place, rate, acceleration."""
        for (_, joint), columns in self._collect_rows().items():
            rows = [parameter for k in columns if isinstance(parameter := self.parameters[k], RowParameter)]
            yield self.mechanism.v_slices[joint].start, columns, evaluate_rows(self.motion, self.mechanism, rows, time)

    def _list_other_parameters(self) -> list[int]:
        """Numbers of the parameters that are no rows and change the motion."""
        return [
            k
            for k, (parameter, variation) in enumerate(zip(self.parameters, self.variations, strict=True))
            if isinstance(parameter, StretchParameter) or not all(one is self.motion for _, one in variation.setups)
        ]

    def _compute_given_column(self, k: int, time: Array) -> Array:
        """Derivatives (3, samples, nv) of all joints by one parameter that is no row."""
        mechanism = self.mechanism
        if isinstance(self.parameters[k], StretchParameter):
            return np.stack(evaluate_stretch(self.motion, mechanism, time))
        series = (self.evaluate(setup, time) for setup in self.variations[k].setups)
        found: Array = self.variations[k].join_results(
            np.stack([collect_scalar_places(mechanism, q), qd, qdd]) for q, qd, qdd in series
        )
        return found

    def _collect_rows(self) -> dict[tuple[int, str], list[int]]:
        """Numbers of the parameters that are rows of a motion, by track and joint."""
        groups: dict[tuple[int, str], list[int]] = {}
        for k, parameter in enumerate(self.parameters):
            if isinstance(parameter, RowParameter):
                groups.setdefault((parameter.track, parameter.joint), []).append(k)
        return groups
