"""Drake through the package door: it holds the rungs that it climbs, and its model is the mechanism's."""

from __future__ import annotations

from dataclasses import replace

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
from flexinv.model.motion import Motion

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
    result = flexinv.run(mechanism, case, "flexinv", {"error": False})
    theirs = drake_engine.run(mechanism, case, "drake", {})
    for name, one in theirs.series.items():
        size = max(float(np.ptp(s.values)) for s in result.series.values() if s.quantity == one.quantity)
        assert float(np.abs(one.values - result.series[name].values).max()) <= EXACT * size, name
    lines = checks("", "", "", drake_engine.certify(mechanism, case, "drake"), certify(mechanism, case, "flexinv"))
    assert {line.what for line in lines} >= {"total mass", "joint-space mass matrix", "gravity torque", "joint axes"}
    assert all(line.holds for line in lines)


def test_a_spring_in_a_joint_that_turns_without_end_is_followed_over_whole_turns() -> None:
    mechanism, case = scene("drives")
    joints = tuple(replace(j, kind="continuous") if j.name == "elbow" else j for j in mechanism.joints)
    mechanism = replace(mechanism, joints=joints)
    there, then = {"shoulder": 0.0, "elbow": 0.2}, {"shoulder": 0.3, "elbow": 12.0}
    case = replace(case, motion=Motion.point_to_point(there, then, 0.8, law="quintic"))
    result = adapter(ENGINES["flexinv"]).run(mechanism, case, "flexinv", {"error": False})
    expected = result.series["torque/elbow"].values
    theirs = drake_engine.run(mechanism, case, "drake", {})
    # Of the spring a whole turn more or less would be 2 pi times its stiffness: a quarter of the range.
    assert np.abs(theirs.series["torque/elbow"].values - expected).max() <= EXACT * np.ptp(expected)
