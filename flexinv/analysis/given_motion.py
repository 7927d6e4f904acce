"""Motions whose rates and accelerations are given at samples: between two samples the polynomial of degree 5 that has both.

With s = (t - t_k) / h and d = 1 - s, the polynomial that takes q, qd, qdd from sample k to sample k + 1 is, by Hermite,

    q(s) = sum over both ends of  q H0 + h qd H1 + h^2 qdd H2,
    H0(s) = d^3 (1 + 3 s + 6 s^2),  H1(s) = d^3 (s + 3 s^2),  H2(s) = d^3 s^2 / 2,

at the other end with s and d exchanged, and H1 with its sign.  Source: any text on interpolation by Hermite.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array, Triple

_S = Polynomial([0.0, 1.0])
_D = 1.0 - _S
_LEFT = (_D**3 * (1 + 3 * _S + 6 * _S**2), _D**3 * (_S + 3 * _S**2), 0.5 * _D**3 * _S**2)
BASIS = (*_LEFT, *(sign * one(_D) for sign, one in zip((1.0, -1.0, 1.0), _LEFT, strict=True)))


@dataclass(frozen=True, eq=False)
class GivenMotion:
    """A motion of joints whose coordinates are numbers of their own, with its rates and accelerations, for `solve`.

    time : (samples,) [s], from 0; angles, rates, accelerations : (samples, nv) [rad], [m], [1/s]; moved : names of the joints
    """

    time: Array
    angles: Array
    rates: Array
    accelerations: Array
    moved: tuple[str, ...]

    @property
    def duration(self) -> float:
        """The time of the last sample [s]."""
        return float(self.time[-1])

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times [s] where the acceleration may jump: both ends, as before and after the samples a motion rests."""
        return (0.0, self.duration)

    @property
    def knots(self) -> tuple[float, ...]:
        """Times [s] between which every coordinate is one polynomial."""
        return tuple(self.time)

    breaks = knots

    def joints(self, mechanism: Mechanism) -> tuple[str, ...]:
        """Return the names of the joints [-] that the motion gives."""
        return tuple(joint.name for joint in mechanism.joints if joint.name in self.moved)

    def evaluate(self, mechanism: Mechanism, time: ArrayLike, side: Literal["left", "right"] = "right") -> Triple:
        """Return q (samples, nq), qd and qdd (samples, nv) at times [rad], [m], [1/s]; at samples those that are given."""
        at = np.asarray(time, dtype=np.float64)
        inside = np.clip(at, 0.0, self.duration)
        k = np.clip(np.searchsorted(self.time, inside, side="right") - 1, 0, len(self.time) - 2)
        width = self.time[k + 1] - self.time[k]
        s = (inside - self.time[k]) / width
        h = width[:, None]
        ends = [(self.angles[i], h * self.rates[i], h**2 * self.accelerations[i]) for i in (k, k + 1)]
        path = []
        for order in range(3):
            values = [basis.deriv(order)(s) if order else basis(s) for basis in BASIS]
            parts = (value[:, None] * part for value, part in zip(values, [*ends[0], *ends[1]], strict=True))
            path.append(sum(parts) / h**order)
        angles, rates, accelerations = (np.asarray(part) for part in path)
        q = np.tile(mechanism.neutral, (at.size, 1))
        for joint in mechanism.joints:
            own = q[:, mechanism.q_slices[joint.name]]
            angle = angles[:, mechanism.v_slices[joint.name]]
            own[:] = np.hstack([np.cos(angle), np.sin(angle)]) if KINDS[joint.kind].circle else angle
        outside = ((at < 0.0) | (at > self.duration))[:, None]
        return q, np.where(outside, 0.0, rates), np.where(outside, 0.0, accelerations)


AnyMotion = Motion | GivenMotion
