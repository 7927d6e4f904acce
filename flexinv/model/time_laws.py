"""Time laws: the completed fraction of a move as a function of time, from 0 to 1.

A law maps s = (t - start)/T in [0, 1] to (u, u', u''), derivatives with respect to s; a move of length D in T seconds
then has the speed D u'/T and the acceleration D u''/T^2.  Source of the peaks in the table: the formulas themselves,
see any text on cam design.

| law       | u' peak | u'' peak | acceleration jumps at s |
|-----------|---------|----------|-------------------------|
| cycloid   | 2       | 2 pi     | none                    |
| quintic   | 15/8    | 10/sqrt3 | none                    |
| septic    | 35/16   | 84/(5 sqrt5) | none, nor of its next derivative |
| nonic     | 315/128 | 9.372    | none, nor of its two next derivatives |
| bang-bang | 2       | 4        | 0, 1/2, 1               |
| trapezoid | 3/2     | 9/2      | 0, 1/3, 2/3, 1          |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexinv.errors import InputError
from flexinv.typing import Array, Triple
from flexinv.validation import nearest, shown

# Times k * step carry the rounding of a product; a sample this close to a jump is meant to be at the jump.
# 1e-9 of the move is far above rounding (1e-16) and far below any step that resolves the move.
SNAP = 1e-9


@dataclass(frozen=True)
class Law:
    """One time law.

    jumps : fractions of the move [-] where u'' jumps, rest before and after the move included
    function : s (samples,) in [0, 1] -> u, u', u'' (samples,) each [-]; right-hand limits inside, u''(1) from the left
    """

    jumps: tuple[float, ...]
    function: Callable[[Array], Triple]


def _cycloid(s: Array) -> Triple:
    turn = 2.0 * np.pi * s
    return s - np.sin(turn) / (2.0 * np.pi), 1.0 - np.cos(turn), 2.0 * np.pi * np.sin(turn)


def _smooth(power: int, peak: float, *series: float) -> Callable[[Array], Triple]:
    """u' = peak (s (1 - s))^power: what is left of both ends is symmetric, so that u near 1 rounds as near 0.

    series : what is completed at a distance p from the start, over p^(power + 1), by rising powers of p
    """

    def law(s: Array) -> Triple:
        p, bell = np.minimum(s, 1.0 - s), s * (1.0 - s)
        part = p ** (power + 1) * np.polynomial.polynomial.polyval(p, series)
        slope = power * peak * bell ** (power - 1) * (1.0 - 2.0 * s)
        return np.where(s < 0.5, part, 1.0 - part), peak * bell**power, slope

    return law


def _bang_bang(s: Array) -> Triple:
    first = s < 0.5
    u = np.where(first, 2.0 * s**2, 1.0 - 2.0 * (1.0 - s) ** 2)
    return u, np.where(first, 4.0 * s, 4.0 * (1.0 - s)), np.where(first, 4.0, -4.0)


def _trapezoid(s: Array) -> Triple:
    thirds = [s < 1.0 / 3.0, s < 2.0 / 3.0]
    u = np.select(thirds, [2.25 * s**2, 1.5 * s - 0.25], 1.0 - 2.25 * (1.0 - s) ** 2)
    speed = np.select(thirds, [4.5 * s, np.full_like(s, 1.5)], 4.5 * (1.0 - s))
    return u, speed, np.select(thirds, [np.full_like(s, 4.5), np.zeros_like(s)], -4.5)


LAWS: dict[str, Law] = {
    "cycloid": Law((), _cycloid),
    "quintic": Law((), _smooth(2, 30.0, 10.0, -15.0, 6.0)),
    "septic": Law((), _smooth(3, 140.0, 35.0, -84.0, 70.0, -20.0)),
    # for torques without corners of arms that bend
    "nonic": Law((), _smooth(4, 630.0, 126.0, -420.0, 540.0, -315.0, 70.0)),
    "bang-bang": Law((0.0, 1.0 / 2.0, 1.0), _bang_bang),
    "trapezoid": Law((0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0), _trapezoid),
}


def find_law(name: str) -> Law:
    """Return the law of that name; InputError names the laws [-] that exist."""
    if not isinstance(name, str) or name not in LAWS:
        known, like = ", ".join(LAWS), nearest(str(name), LAWS)
        raise InputError(f"law = {shown(name)}: expected one of {known}" + (f"; write {like!r}" if like else ""))
    return LAWS[name]


def progress(law: Law, s: Array, left: NDArray[np.bool_]) -> Triple:
    """Evaluate a law for any s: at rest before 0 and after 1, right-hand limits at its jumps.

    s : (samples,) [-]; left : (samples,) True where the limit from the left is wanted instead
    returns u, u', u'' : (samples,) each [-]
    """
    inside = np.where(s > SNAP, s, 0.0)
    inside[s >= 1.0 - SNAP] = 1.0
    for mark in law.jumps[1:-1]:
        inside[np.abs(s - mark) <= SNAP] = mark
    u, speed, acceleration = law.function(inside)
    if law.jumps:  # u'' is constant between the jumps, so its limit from the left is its value a little earlier
        before = law.function(np.clip(inside - SNAP, 0.0, 1.0))[2]
        acceleration = np.where(left & np.isin(inside, law.jumps), before, acceleration)
    moving = np.where(left, (s > SNAP) & (s <= 1.0 + SNAP), (s >= -SNAP) & (s < 1.0 - SNAP))
    return u, np.where(moving, speed, 0.0), np.where(moving, acceleration, 0.0)
