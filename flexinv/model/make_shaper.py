"""Shapers of the three usual kinds, of one mode or several.

With K = exp(-z pi / sqrt(1 - z^2)) and T = 2 pi / (w sqrt(1 - z^2)), the period of a mode of frequency w and damping ratio z:

| kind | parts | times | what it leaves |
|---|---|---|---|
| ZV | (1, K) / (1 + K) | 0, T/2 | V = 0 at the mode |
| ZVD | (1, 2 K, K^2) / (1 + K)^2 | 0, T/2, T | V = 0 and dV/dw = 0 there |
| EI, z = 0 | ((1 + V)/4, (1 - V)/2, (1 + V)/4) | 0, T/2, T | V as allowed there, nothing at a frequency on each side |

ZV and ZVD: Singer and Seering 1990, doi:10.1115/1.2894142.  EI: Singhose, Seering and Singer 1994, doi:10.1115/1.2919428; its
conditions are solved here for damped modes, not fitted.  A shaper of several modes is the convolution of theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.model.input_shaper import InputShaper, check_ratio
from flexinv.typing import Array
from flexinv.validation import check_choice, check_number, convert_to_floats

MOST_DAMPED = 0.3  # beyond, EI shapers are not solved for: such modes end by themselves
SOLVED = 1e-9  # defects of the six conditions; Newton's last step leaves 1e-13 of them where there is a shaper
CONTINUED = 0.01  # steps of the damping ratio from the closed form without damping


@dataclass(frozen=True)
class ShaperKind:
    """A kind of shaper: what it leaves; times [damped periods] and parts [-] by damping ratio and allowed vibration [-]."""

    meaning: str
    find: Callable[[float, float], tuple[Array, Array]]


def make_shaper(kind: str, frequency: ArrayLike, ratio: ArrayLike = 0.0, vibration: float = 0.05) -> InputShaper:
    """Return the shaper of a kind, "ZV", "ZVD" or "EI", for one mode or several.

    frequency : natural frequency [Hz], or (modes,) of them; ratio : of damping [-], one for all or (modes,)
    vibration : of EI alone, V [-] that may be left at the frequency itself; the band in which less is left is the wider
    Raises InputError for another kind, a frequency that is not above 0, a ratio of 1 or more.
    """
    check_choice("kind", kind, {name: shaper.meaning for name, shaper in SHAPERS.items()})
    frequencies = np.atleast_1d(np.asarray(convert_to_floats("frequency", frequency)))
    if frequencies.ndim != 1 or not frequencies.size or not (np.isfinite(frequencies) & (frequencies > 0.0)).all():
        raise InputError(f"frequency: {frequency!r}; expected natural frequencies above 0 [Hz], for example 4.2")
    ratios = np.asarray(convert_to_floats("ratio", ratio))
    if ratios.shape not in ((), (1,), frequencies.shape):
        raise InputError(
            f"ratio: shape {ratios.shape}; expected one damping ratio [-], or one for each of {frequencies.size} modes"
        )
    allowed = check_number("vibration", vibration, "a part of the vibration between 0 and 1, for example 0.05")
    if not 0.0 < allowed < 1.0:
        raise InputError(f"vibration = {allowed:g}: expected a part above 0 and below 1 [-], for example 0.05")
    shapers = [
        _make_for_mode(kind, float(hertz), check_ratio(float(damped)), allowed)
        for hertz, damped in zip(frequencies, np.broadcast_to(ratios, frequencies.shape), strict=True)
    ]
    whole = shapers[0]
    for shaper in shapers[1:]:
        whole = whole.join(shaper)
    return whole


def _make_for_mode(kind: str, frequency: float, ratio: float, vibration: float) -> InputShaper:
    """The shaper of one mode, frequency [Hz], ratio and vibration [-]."""
    times, parts = SHAPERS[kind].find(ratio, vibration)
    period = 1.0 / (frequency * np.sqrt(1.0 - ratio**2))
    return InputShaper(period * times, parts / parts.sum())


def _find_zero(ratio: float, vibration: float) -> tuple[Array, Array]:
    """Times in damped periods and parts of ZV [-]."""
    later = np.exp(-ratio * np.pi / np.sqrt(1.0 - ratio**2))
    return np.array([0.0, 0.5]), np.array([1.0, later])


def _find_double_zero(ratio: float, vibration: float) -> tuple[Array, Array]:
    """Times in damped periods and parts of ZVD [-]."""
    later = np.exp(-ratio * np.pi / np.sqrt(1.0 - ratio**2))
    return np.array([0.0, 0.5, 1.0]), np.array([1.0, 2.0 * later, later**2])


def _find_insensitive(ratio: float, vibration: float) -> tuple[Array, Array]:
    """Times in damped periods and parts of EI [-]: from the closed form without damping in small steps of the ratio."""
    if ratio > MOST_DAMPED:
        raise InputError(f"ratio = {ratio:g}: EI shapers are solved for to {MOST_DAMPED:g} [-]; write kind = 'ZVD'")
    side = np.arccos(-(1.0 - vibration) / (1.0 + vibration)) / np.pi  # where V = 0, of the frequency
    found = np.array([(1.0 + vibration) / 4.0, (1.0 - vibration) / 2.0, 0.5, 1.0, side, 2.0 - side])
    for damped in np.linspace(0.0, ratio, 1 + int(np.ceil(ratio / CONTINUED)))[1:]:
        solved = scipy.optimize.root(_compute_defects, found, args=(float(damped), vibration), tol=1e-13)
        if not np.abs(_compute_defects(solved.x, float(damped), vibration)).max() < SOLVED:
            raise InputError(f"EI: no shaper for ratio = {ratio:g} and vibration = {vibration:g}; write kind = 'ZVD'")
        found = solved.x
    first, second, middle, last = found[:4]
    return np.array([0.0, middle, last]), np.array([first, second, 1.0 - first - second])


def _compute_defects(unknown: Array, ratio: float, vibration: float) -> Array:
    """The defects of the six conditions of EI [-]: V = 0 twice beside the mode, V as allowed at it, and largest there.

    unknown : two parts, two times in damped periods, and the two frequencies, of that of the mode
    """
    first, second, middle, last, low, high = unknown
    parts = np.array([first, second, 1.0 - first - second])
    phase = 2.0 * np.pi / np.sqrt(1.0 - ratio**2) * np.array([0.0, middle, last])  # w t at w = 1
    pole = ratio + 1j * np.sqrt(1.0 - ratio**2)
    sums = np.array([parts @ np.exp(pole * w * phase) for w in (low, high, 1.0)])
    slope = (parts * pole * phase) @ np.exp(pole * phase)
    growth = (slope * sums[2].conj()).real / abs(sums[2]) ** 2 - ratio * phase[-1]  # d(log V)/dw
    at_mode = np.exp(-ratio * phase[-1]) * abs(sums[2])
    return np.array([sums[0].real, sums[0].imag, sums[1].real, sums[1].imag, at_mode - vibration, vibration * growth])


SHAPERS = {
    "ZV": ShaperKind("no vibration at the mode", _find_zero),
    "ZVD": ShaperKind("none, and little beside it", _find_double_zero),
    "EI": ShaperKind("as much as is allowed, in the widest band", _find_insensitive),
}
