"""Cross products are those of NumPy, to the bit."""

from __future__ import annotations

import numpy as np

from crosscheck.engines.shared.cross import cross, cross_columns


def test_products_are_numpys_to_the_bit() -> None:
    random = np.random.default_rng(5)
    a, b = (random.standard_normal((1000, 3)) * 10.0 ** random.integers(-150, 150, (1000, 1)) for _ in range(2))
    for one, other in zip(a, b, strict=True):
        assert np.array_equal(cross(one, other), np.cross(one, other))
    assert np.array_equal(cross_columns(a.T, b[0]), np.cross(a.T, b[0], axis=0))
    assert cross_columns(np.zeros((3, 0)), b[0]).shape == (3, 0)
