"""A parameter is told by how much the logs narrow it, wherever it lies."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from crosscheck.identification.table import _compute_score_width


@pytest.mark.parametrize("place", [0.0, 3.0, -4.0, 6.0])
def test_a_width_is_the_same_far_out(place: float) -> None:
    """Behind the last draw of the prior all had the same score, and what lies four widths off was told by that.

    To a twentieth, for what interpolation between a hundred quantiles makes of it.
    """
    known = scipy.special.ndtri((np.arange(4000) + 0.5) / 4000)
    assert _compute_score_width(place + 0.4 * known, known) == pytest.approx(0.4, rel=0.05)
