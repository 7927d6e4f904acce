"""Faults planted in a log are named first, with their size; nothing is named where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import logged_arm
import numpy as np
import pytest

import crosscheck
from crosscheck.identification.causes import name_causes
from crosscheck.identification.identify import Identified
from crosscheck.identification.log import Log, read_log
from crosscheck.identification.readings import delayed, lagged


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> tuple[Identified, Log]:
    """The arm identified on one log, and another log of it."""
    folder: Path = tmp_path_factory.mktemp("models") / "arm"
    logged_arm.write_arm(folder)
    for seed, name in enumerate(("one", "two")):
        logged_arm.frame(folder, seed).to_csv(folder / f"{name}.csv", index=False)
    return crosscheck.identify(folder, [folder / "one.csv"]), read_log(folder / "two.csv")


def changed(log: Log, column: str, values: np.ndarray) -> Log:
    return replace(log, columns={**log.columns, column: values})


def test_nothing_is_named_on_an_untouched_log(known: tuple[Identified, Log]) -> None:
    found, log = known
    assert name_causes(found.machine, found.fit, log) == []


@pytest.mark.parametrize(
    ("name", "place", "column", "size"),
    [
        ("torque constant, relative error", "shoulder", "t1", 0.3),
        ("delay of the effort", "elbow", "t2", 0.008),
        ("delay of the angle", "shoulder", "q1", 0.008),
        ("first-order lag of the effort", "shoulder", "t1", 0.005),
    ],
)
def test_a_planted_fault_is_named_first_with_its_size(
    known: tuple[Identified, Log], name: str, place: str, column: str, size: float
) -> None:
    """To a tenth: a lag is undone to first order, and its second leaves 5 % below 10 Hz."""
    found, log = known
    values = log.columns[column]
    if name.startswith("torque"):
        spoiled = values * (1.0 + size)
    elif name.startswith("delay"):
        spoiled = delayed(values, log.spacing, size)
    else:
        spoiled = lagged(values, log.spacing, size)
    first = name_causes(found.machine, found.fit, changed(log, column, spoiled))[0]
    assert (first.name, first.place) == (name, place)
    assert first.size == pytest.approx(size, rel=0.1)
    assert name in first.words
