"""Step grids meet what is not smooth, join what is, and are short after jumps."""

from __future__ import annotations

import numpy as np

from flexinv.analysis.accurate import FEWEST_IN_RUN, GRADES, build_step_grid

ROUNDED = 1e-15  # of a second


def test_breaks_are_samples_of_every_refinement() -> None:
    grid = build_step_grid((0.0, 0.1234, 0.3), (), 0.0, 0.7)
    for finer in (1, 2, 3, 8):
        steps = grid.list_steps(finer)
        assert len(steps) == finer * grid.total + 1
        assert (np.diff(steps) > 0).all()
        assert all(np.abs(steps - t).min() < ROUNDED for t in (0.0, 0.1234, 0.3, 0.7))
        assert np.abs(steps[::finer] - grid.list_steps(1)).max() < ROUNDED
        assert np.diff(steps).max() <= grid.compute_longest_step(finer) * (1 + 1e-9)
    assert grid.total >= FEWEST_IN_RUN


def test_stretches_of_equal_steps_are_joined_unless_accelerations_jump_between() -> None:
    assert build_step_grid((0.2,), (), 0.0, 0.5).list_seams(3) == ()
    jumped = build_step_grid((0.2,), (0.2,), 0.0, 0.5)
    times = jumped.list_steps(1)[list(jumped.list_seams(1))]
    assert np.abs(times - 0.2).min() < ROUNDED


def test_steps_are_short_after_a_jump_and_double() -> None:
    grid = build_step_grid((), (0.0, 0.25), 0.0, 0.5)
    steps = np.diff(grid.list_steps(1))
    after = np.flatnonzero(grid.list_steps(1)[:-1] >= 0.25 - ROUNDED)
    for first in (0, after[0]):
        growth = steps[first : first + 2 * GRADES].max() / steps[first]
        assert growth >= 2 ** (GRADES - 2)
