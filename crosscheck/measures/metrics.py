"""Difference of two signals in one number each: magnitude, phase and both together."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from flexinv.typing import Array


class SpragueGeers(TypedDict, total=False):
    """Sprague and Geers' errors [-]."""

    magnitude: float
    phase: float
    comprehensive: float


def compute_sprague_geers(ours: Array, theirs: Array) -> SpragueGeers:
    """Return Sprague and Geers' errors [-]; empty where one of the signals is zero throughout.

        M = sqrt(oo / tt) - 1,    P = arccos(ot / sqrt(oo tt)) / pi,    C = sqrt(M^2 + P^2)
    with oo, tt, ot the sums over the samples of ours^2, theirs^2 and their product.  A pure scale s gives M = s - 1
    and P = 0, a shift of a sine by an angle phi gives M = 0 and P = phi / pi.

    ours, theirs : (samples,) [unit]
    Source: M. A. Sprague, T. L. Geers, "A spectral-element method for modelling cavitation in transient fluid-structure
    interaction", Int. J. Numer. Meth. Engng 60 (2004), equations 29 to 31.
    """
    size = max(float(np.abs(ours).max()), float(np.abs(theirs).max()))
    if size == 0.0 or not np.isfinite(size):
        return {}
    a = ours / size
    b = theirs / size
    oo = float(a @ a)
    tt = float(b @ b)
    if oo == 0.0 or tt == 0.0:
        return {}
    magnitude = float(np.sqrt(oo / tt) - 1.0)
    # arccos loses half of the digits near 1: half the chord between the unit vectors does not.
    chord = float(np.linalg.norm(a / np.sqrt(oo) - b / np.sqrt(tt)))
    phase = float(2.0 * np.arcsin(min(1.0, chord / 2.0)) / np.pi)
    return {"magnitude": magnitude, "phase": phase, "comprehensive": float(np.hypot(magnitude, phase))}
