"""Relations of columns in numbers: which are times, which are rates of which, which are copies, and which follow a motion.

rate        b is the rate of a where b = k da/dt behind a low-pass, with k of two units of one quantity: 1, deg per rad, mm per m
copy        b is a copy of a where both differ by less than a thousandth of their spread
effort      e is told by the motion where it is a sum of sin, cos of the angles, and of q', sign q', q'' of each joint; it
            belongs to the joint without whose q', sign q' and q'' most of it stays unexplained
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from crosscheck.identification.filters import low_pass
from flexinv.typing import Array

EVEN = 0.5  # of the usual step: times of a log that is taken as they come
RATE = 0.99  # correlation of a rate with the derivative: two angles that move alike have less
UNITS = {1.0: "", 180.0 / np.pi: "deg per rad", np.pi / 180.0: "rad per deg", 1000.0: "mm per m", 1e-3: "m per mm"}
FACTOR = 0.03  # relative: what noise and low-pass leave of the factor
COPY = 1e-3  # of the spread
SAMPLES = 2000  # that tell whether two columns are the same: bags have hundreds of columns
DRIFT = 0.1  # of the spread that a parabola leaves: of an angle that goes back and forth it leaves more than half
FASTEST = 10.0  # [Hz]
STILL = 0.02  # of the largest rate: slower than this, dry friction has no sign


def is_time(values: Array) -> bool:
    """Return True for numbers that rise without end, in steps that hardly differ [-]."""
    steps = np.diff(values)
    if len(steps) < 2 or not np.isfinite(values).all() or not (steps > 0.0).all():
        return False
    middle = np.median(steps)
    return bool(np.mean(np.abs(steps - middle) < EVEN * middle) > 1.0 - FACTOR)


def is_constant(values: Array) -> bool:
    """Return True for a column that says nothing [-]."""
    return not np.isfinite(values).all() or np.ptp(values) <= 1e-12 * np.abs(values).max(initial=0.0)


def is_drift(values: Array) -> bool:
    """Return True for a column that is a parabola but for a tenth of its spread: no joint that goes back and forth is."""
    place = np.linspace(-1.0, 1.0, len(values))
    rest = values - np.polynomial.Polynomial.fit(place, values, 2)(place)
    return bool(np.std(rest) < DRIFT * np.std(values))


def apply_low_pass(values: Array, spacing: float) -> Array:
    """Return a signal behind the low-pass that its angle is taken behind, too [unit of the signal]; spacing : [s]."""
    return low_pass(values, spacing, min(FASTEST, 0.1 / spacing))


def find_rates(columns: Mapping[str, Array], spacing: float) -> dict[str, tuple[str, float]]:
    """Return by rate the column whose rate it is, and the factor of their units [-]; spacing : of the samples [s]."""
    names = list(columns)
    if len(names) < 2:
        return {}
    table = np.array([apply_low_pass(columns[name], spacing) for name in names])
    slope = np.gradient(table, spacing, axis=1)
    table = table - table.mean(axis=1, keepdims=True)
    slope = slope - slope.mean(axis=1, keepdims=True)
    size = np.sqrt(np.sum(slope**2, axis=1))[:, None] * np.sqrt(np.sum(table**2, axis=1))[None, :]
    products = slope @ table.T
    alike = products / np.maximum(size, np.finfo(float).tiny)
    np.fill_diagonal(alike, 0.0)
    out = {}
    for b, name in enumerate(names):
        a = int(np.argmax(alike[:, b]))
        factor = float(products[a, b] / np.sum(slope[a] ** 2)) if alike[a, b] > RATE else 0.0
        unit = next((one for one in UNITS if abs(factor / one - 1.0) < FACTOR), None)
        if unit is not None:
            out[name] = (names[a], unit)
    return out


def find_copies(columns: Mapping[str, Array]) -> dict[str, str]:
    """Return by copy the first column that it is the same as [-], by some samples of each."""
    out: dict[str, str] = {}
    names = list(columns)
    columns = {name: values[:: max(1, len(values) // SAMPLES)] for name, values in columns.items()}
    for k, name in enumerate(names):
        for other in names[:k]:
            spread = np.std(columns[other])
            if other not in out and np.std(columns[name] - columns[other]) < COPY * spread:
                out[name] = other
                break
    return out


def compute_roughness(values: Array) -> float:
    """Return the second difference of a signal over its spread [-]: angles are smoother than what moves them."""
    return float(np.std(np.diff(values, 2)) / max(float(np.std(values)), np.finfo(float).tiny))


@dataclass(frozen=True)
class MotionTerms:
    """Terms of which efforts are made, behind the low-pass.

    common : (terms, samples) of gravity, and 1; own : (joints, 3, samples), q', sign q' and q'' of each joint
    """

    common: Array
    own: Array
    spacing: float

    @classmethod
    def build(cls, angles: Array, spacing: float) -> MotionTerms:
        """Return the terms of angles (samples, joints) [rad], [m]; spacing : of the samples [s]."""
        q = np.array([apply_low_pass(one, spacing) for one in angles.T])
        qd = np.gradient(q, spacing, axis=1)
        size = np.maximum(np.abs(qd).max(axis=1, keepdims=True), np.finfo(float).tiny)
        terms = np.stack([qd, np.tanh(qd / (STILL * size)), np.gradient(qd, spacing, axis=1)], axis=1)
        turned = np.cumsum(q, axis=0)  # of a chain: gravity acts by sums of its angles
        common = np.vstack([np.ones_like(q[:1]), np.sin(q), np.cos(q), np.sin(turned), np.cos(turned)])
        return cls(common, terms, spacing)

    def compute_share(self, effort: Array, without: int | None = None) -> float:
        """Return the part of an effort (samples,) that the terms explain [-]; without : a joint whose own are left out."""
        terms = self.own if without is None else np.delete(self.own, without, axis=0)
        target = apply_low_pass(effort, self.spacing)
        rows = np.vstack([self.common, terms.reshape(-1, len(target))]).T
        rows = rows / np.maximum(np.linalg.norm(rows, axis=0), np.finfo(float).tiny)
        rest = target - rows @ np.linalg.lstsq(rows, target, rcond=1e-9)[0]
        return float(1.0 - np.var(rest) / max(float(np.var(target)), np.finfo(float).tiny))

    def find_owner(self, effort: Array) -> int:
        """Return the joint [-] without whose own terms least of an effort (samples,) is explained."""
        return int(np.argmin([self.compute_share(effort, k) for k in range(len(self.own))]))
