"""The campaign of days: its days differ in what may differ alone, and its sums say what was counted."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.days.__main__ import format_count
from campaigns.days.pairs import Check, sample_day, sample_machine


def test_days_differ_in_friction_and_offsets_alone() -> None:
    random = np.random.default_rng(1)
    world = sample_machine("arm", random)
    one, other = (sample_day(world, (0.1, 0.1, 0.05), random) for _ in range(2))
    for name in ("viscous", "coulomb", "offset", "growth"):
        assert not np.isclose(getattr(one, name), getattr(other, name)).any()
    assert one.bodies == other.bodies == world.bodies
    assert np.array_equal(one.rotor, other.rotor)


@pytest.mark.parametrize(
    ("good", "said"), [(9, "9 of 10 = 90.0% (60.6% to 99.5%)"), (10, "10 of 10 = 100.0% (74.1% to 100.0%)")]
)
def test_a_sum_has_its_exact_interval(good: int, said: str) -> None:
    """Clopper and Pearson: (1 - p)^10 and its first term are 0.05 at the ends; 0.05^0.1 = 0.741."""
    checks = [Check("bands", "elbow", k < good, 0.5) for k in range(10)]
    assert format_count("bands", checks) == f"bands: {said}; 50.0% of samples inside on average"
