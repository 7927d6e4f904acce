"""A bar is the largest difference nearby, whatever the length of the run."""

from __future__ import annotations

import numpy as np
import pytest

from flexinv.analysis.nearby import NEARBY, find_largest_nearby


@pytest.mark.parametrize("count", [1, 2, 3, 49, 50, 51, 1000])
@pytest.mark.parametrize("columns", [(), (3,)])
def test_it_is_the_largest_of_the_window(count: int, columns: tuple[int, ...]) -> None:
    """Against the definition, exactly: maxima round nothing."""
    values = np.random.default_rng(count).normal(size=(count, *columns))
    half = int(np.ceil(NEARBY * count))
    wanted = [values[max(k - half, 0) : k + half + 1].max(axis=0) for k in range(count)]
    np.testing.assert_array_equal(find_largest_nearby(values), wanted)


def test_what_is_no_number_stays_none() -> None:
    values = np.zeros(100)
    values[50] = np.nan
    assert np.isnan(find_largest_nearby(values)[50])
