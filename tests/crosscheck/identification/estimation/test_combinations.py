"""Numbers that logs tell only together are named with those they cannot be told apart from, and no others."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pytest

import crosscheck
from crosscheck.identification.estimation.combinations import count_narrowed_directions, list_combinations
from crosscheck.identification.estimation.fit import Fit
from crosscheck.identification.parameters import Parameter, ParameterSpace

EMPTY = np.zeros(0)


def seen(*columns: list[float]) -> tuple[ParameterSpace, Fit]:
    """Four numbers, known to 1 before, and logs whose readings change by these columns."""
    names = [f"p{k}" for k in range(len(columns))]
    space = ParameterSpace(tuple(Parameter("effort offset", n, "N m", 0.0, 1.0, False) for n in names), {})
    slopes = np.array(columns).T
    covariance = np.linalg.inv(slopes.T @ slopes + np.eye(len(columns)))
    return space, Fit(np.zeros(len(columns)), covariance, EMPTY, EMPTY, 1.0, EMPTY, (), ())


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        pytest.param(
            ([100.0, 0, 0], [100.0, 0, 0], [0, 90.0, 0], [0, 0, 0.0]), {"p0": {"p1"}, "p1": {"p0"}}, id="a pair"
        ),
        pytest.param(
            ([200.0, 0, 0], [0, 200.0, 0], [100.0, 100.0, 0], [0, 0, 80.0]),
            {"p2": {"p0", "p1"}},
            id="half the sum of two",
        ),
        pytest.param(([100.0, 0, 0], [0, 100.0, 0], [0, 0, 90.0], [0, 0, 0.0]), {}, id="each alone, one not at all"),
    ],
)
def test_columns_that_are_sums_of_others_are_found(
    columns: tuple[list[float], ...], expected: dict[str, set[str]]
) -> None:
    space, result = seen(*columns)
    together = {one.key[1]: {place for _, place in one.others} for one in list_combinations(space, result)}
    assert together == expected


def test_logs_tell_as_many_combinations_as_their_columns_have_rank() -> None:
    assert count_narrowed_directions(seen([100.0, 0, 0], [100.0, 0, 0], [0, 90.0, 0], [0, 0, 0.0])[1]) == 2


def test_a_centre_of_mass_is_told_with_its_mass_only(tmp_path: Path) -> None:
    """Efforts of a planar arm hold  m c  and  I + m c^2:  mass, centre and inertia share two numbers."""
    logged_arm.write_arm(tmp_path / "arm")
    logged_arm.frame(tmp_path / "arm", 0).to_csv(tmp_path / "one.csv", index=False)
    identification = crosscheck.identify(tmp_path / "arm", [tmp_path / "one.csv"])
    together = {one.key: set(one.others) for one in list_combinations(identification.machine.space, identification.fit)}
    assert together["com x", "upper"] == {("mass", "upper"), ("Iyy", "upper")}
    assert not any(kind == "com z" for kind, _ in together)
    assert any(text.startswith("com x of upper cannot be told apart from") for text in identification.words)
