"""Limits that a motion passes: positions, rates and efforts of joints at the samples, held against what its file states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from flexinv.analysis.solution import list_effort_units
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

ROUNDING = 1e-9  # of a limit: values that planners put on it are not beyond
SAID = 6  # joints of one kind of limit: more tell no more


@dataclass
class PassedLimits:
    """Least and largest position, largest rate and effort so far (nv,) [rad], [m], 1/s, [N m], [N]."""

    mechanism: Mechanism
    lowest: Array = field(init=False)
    highest: Array = field(init=False)
    fastest: Array = field(init=False)
    strongest: Array = field(init=False)

    def __post_init__(self) -> None:
        self.lowest = np.full(self.mechanism.nv, np.inf)
        self.highest = np.full(self.mechanism.nv, -np.inf)
        self.fastest = np.zeros(self.mechanism.nv)
        self.strongest = np.zeros(self.mechanism.nv)

    def update(self, q: Array, qd: Array, tau: Array) -> None:
        """Take more samples: q (samples, nq), qd, tau (samples, nv) [rad], [m], 1/s, [N m], [N]."""
        m = self.mechanism
        for joint in m.joints:
            if joint.nv == 1 and KINDS[joint.kind].scalar:
                coordinates = q[:, m.q_slices[joint.name]]
                at = m.v_slices[joint.name]
                self.lowest[at] = np.minimum(self.lowest[at], coordinates.min(initial=np.inf))
                self.highest[at] = np.maximum(self.highest[at], coordinates.max(initial=-np.inf))
        self.fastest = np.maximum(self.fastest, np.abs(qd).max(axis=0, initial=0.0))
        self.strongest = np.maximum(self.strongest, np.abs(tau).max(axis=0, initial=0.0))

    def describe(self) -> Iterator[str]:
        """Yield one sentence per kind of limit that is passed, with joints, values and limits in their units."""
        m = self.mechanism
        named = [(joint, m.v_slices[joint.name].start) for joint in m.joints if joint.nv == 1]
        units = list_effort_units(m)
        rows: dict[str, list[str]] = {"positions": [], "rates": [], "efforts": []}
        for joint, k in named:
            unit = "m" if joint.kind == "prismatic" else "rad"
            for value, limit, side in (
                (self.lowest[k], joint.limits.lower, -1.0),
                (self.highest[k], joint.limits.upper, 1.0),
            ):
                if np.isfinite(value) and side * (value - limit) > ROUNDING * max(abs(limit), 1.0):
                    rows["positions"].append(f"{joint.name} {value:.4g} {unit} (limit {limit:.4g})")
            if self.fastest[k] > joint.limits.velocity * (1.0 + ROUNDING):
                rows["rates"].append(f"{joint.name} {self.fastest[k]:.4g} {unit}/s (limit {joint.limits.velocity:.4g})")
            if self.strongest[k] > joint.limits.effort * (1.0 + ROUNDING):
                rows["efforts"].append(
                    f"{joint.name} {self.strongest[k]:.4g} {units[k]} (limit {joint.limits.effort:.4g})"
                )
        for what, said in rows.items():
            if said:
                more = f" and {len(said) - SAID} more" if len(said) > SAID else ""
                yield f"{what} pass the limits of the robot: {', '.join(said[:SAID])}{more}"
