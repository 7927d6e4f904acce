"""Sine and cosine without branches, against the 64-bit mantissas of the processor's extended numbers."""

from __future__ import annotations

import numpy as np
import pytest

from flexinv.kernels.jit import jit, jit_blocks
from flexinv.kernels.simd import FAR_ANGLE, cos_sin, cos_sin_unfused

# One unit in the last place of a number just below 1 is 1.1e-16; two of them (polynomial, reduced angle) are promised.
PROMISED = 2.2e-16

ANGLES = {
    "first quarter": np.linspace(-np.pi / 4, np.pi / 4, 100_001),
    "some turns": np.random.default_rng(0).uniform(-20, 20, 100_000),
    "as far as it goes": np.random.default_rng(1).uniform(-FAR_ANGLE, FAR_ANGLE, 100_000),
    "near quarter turns": np.arange(-600_000, 600_000, 11) * (np.pi / 2),
    "next to quarter turns": np.nextafter(np.arange(-600_000, 600_000, 11) * (np.pi / 2), np.inf),
    "tiny": 10.0 ** np.arange(-300, 0),
}


@jit_blocks
def cos_sin_many(angle, c, s):
    """Cosines and sines of many angles into c and s."""
    for k in range(angle.shape[0]):
        c[k], s[k] = cos_sin(angle[k])


@jit
def cos_sin_alike(angle, c, s):
    """The same as every processor rounds them."""
    for k in range(angle.shape[0]):
        c[k], s[k] = cos_sin_unfused(angle[k])


@pytest.mark.parametrize("name", ANGLES)
def test_errors_are_as_small_as_promised(name: str) -> None:
    angle = ANGLES[name]
    c, s = np.empty_like(angle), np.empty_like(angle)
    cos_sin_many(angle, c, s)
    long = angle.astype(np.longdouble)
    assert np.abs(c - np.cos(long)).max() <= PROMISED
    assert np.abs(s - np.sin(long)).max() <= PROMISED
    assert np.abs(c * c + s * s - 1).max() <= 2 * PROMISED  # as both errors together make it


@pytest.mark.parametrize("name", ANGLES)
def test_unfused_products_are_rounded_as_numpy_rounds_them(name: str) -> None:
    """Each product and each sum by itself: the digits of any processor.  Fused ones have others."""
    angle = ANGLES[name]
    c, s = np.empty_like(angle), np.empty_like(angle)
    cos_sin_alike(angle, c, s)
    expected = np.array([getattr(cos_sin, "py_func", cos_sin)(one) for one in angle[:2000]]).T
    assert np.array_equal(c[:2000], expected[0])
    assert np.array_equal(s[:2000], expected[1])
    long = angle.astype(np.longdouble)
    assert np.abs(c - np.cos(long)).max() <= PROMISED
    assert np.abs(s - np.sin(long)).max() <= PROMISED


def test_what_is_no_angle_gives_no_cosine() -> None:
    c, s = np.zeros(3), np.zeros(3)
    cos_sin_many(np.array([np.nan, np.inf, -np.inf]), c, s)
    assert np.isnan(c).all()
    assert np.isnan(s).all()
