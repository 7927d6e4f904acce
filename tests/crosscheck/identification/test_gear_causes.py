"""Faults of gears and of known shapes in a log, by their sizes; tried as campaigns/log_faults does."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.log_faults.trial import Row, run_row
from crosscheck.identification.causes.signals import find_quantisation_step


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "fault", "name", "size", "most"),
    [
        (693848, "gear ripple @ 0 0.3 12", "ripple of the effort", 0.3, 0.01),
        (11017, "backlash @ 0 0.02", "backlash of the gear", 0.02, 0.002),
        (11017, "effort step @ 0 0.5 3.5", "step of the effort, at 3.5 s", 0.5, 0.01),
        (11017, "shaking floor @ 0 0.4 3", "oscillation of the effort, 3 Hz", 0.4, 0.01),
        (11017, "end stop @ 0 40 0.15", "end stop, on the last 0.15", 40.0, 1.0),
        (11017, "soft drive @ 0 2000", "twist of the gear by its load", 1.0 / 2000.0, 2e-5),
    ],
)
def test_a_fault_of_a_gear_is_named_with_its_size(seed: int, fault: str, name: str, size: float, most: float) -> None:
    """Of backlash within a tenth: the passage through the play has a width of its own, of which the log knows little."""
    named = run_row(Row(0, "pendulum", "same", "sines", seed, fault, "")).named
    (one,) = named
    assert one.name.startswith(name)
    assert one.place == "hinge"
    assert abs(one.size - size) < max(most, 3.0 * one.error)


@pytest.mark.slow
def test_a_soft_spring_of_an_elastic_drive_is_named_with_its_size() -> None:
    """A loose screw leaves seven tenths of the stiffness: no slope leads there: natural frequencies lie between."""
    (only,) = run_row(Row(0, "elastic", "same", "moves", 293227, "soft gear @ 0 0.7", "")).named
    assert (only.name, only.place) == ("stiffness of the joint, relative error", "gear")
    assert abs(only.size + 0.3) < 3.0 * only.error


@pytest.mark.parametrize("levels", [5, 400, 3000])
def test_a_step_is_found_among_many_levels_and_noise_has_none(levels: int) -> None:
    """The tolerance grew with the number of levels, so that above 500 of them any numbers were multiples."""
    random = np.random.default_rng(levels)
    coarse = np.round(random.uniform(0.0, levels, 4 * levels)) * 0.0123
    written = np.array([float(f"{x:.5g}") for x in coarse])
    assert abs(find_quantisation_step(written) - 0.0123) < 1e-4 * 0.0123 + 1e-5 / levels
    assert find_quantisation_step(random.normal(size=levels)) == 0.0
