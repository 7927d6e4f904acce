"""Drake through the package door: it holds the rungs that it climbs, and its model is the mechanism's."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pydrake", reason="Drake is not installed (python -m pip install --no-deps drake)")

import crosscheck_drake as drake_engine

from crosscheck.conform.ladder import FOLDER, RUNGS
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import offered
from crosscheck.measures.certificate import checks
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism

CLIMBED = ("double_pendulum", "tree", "drives")
EXACT = 1e-12  # of the range: closed formulas of a few links on both sides


def scene(rung: str) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(FOLDER / rung)
    return mechanism, next(iter(load_cases(FOLDER / rung, mechanism).values()))


@pytest.mark.parametrize("rung", RUNGS)
def test_it_climbs_what_it_says(rung: str) -> None:
    reason = drake_engine.unsupported(*scene(rung), "drake")
    assert (reason is None) == (rung in CLIMBED)


@pytest.mark.parametrize("rung", CLIMBED)
def test_it_agrees_and_its_model_is_the_same(rung: str) -> None:
    mechanism, case = scene(rung)
    flexinv = adapter(ENGINES["flexinv"])
    certify = offered(flexinv, "certify")
    assert certify is not None
    ours = flexinv.run(mechanism, case, "flexinv", {"error": False})
    theirs = drake_engine.run(mechanism, case, "drake", {})
    for name, one in theirs.series.items():
        size = max(float(np.ptp(s.values)) for s in ours.series.values() if s.quantity == one.quantity)
        assert float(np.abs(one.values - ours.series[name].values).max()) <= EXACT * size, name
    lines = checks("", "", "", drake_engine.certify(mechanism, case, "drake"), certify(mechanism, case, "flexinv"))
    assert {line.what for line in lines} >= {"total mass", "joint-space mass matrix", "gravity torque", "joint axes"}
    assert all(line.holds for line in lines)
