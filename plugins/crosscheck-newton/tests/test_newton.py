"""Newton through the package door: it holds the rungs that it climbs within single precision, and mistakes here are named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("newton", reason="Newton is not installed (python -m pip install newton)")

import crosscheck_newton as newton_engine

from crosscheck.causes.diagnosis import diagnose
from crosscheck.conform.ladder import FOLDER, RUNGS
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import offered
from crosscheck.measures.record import Record, save
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion

CLIMBED = ("double_pendulum", "tree", "drives")
# Single precision has seven digits, of which sums of a few bodies lose some: a model that is another one is off by far more.
SINGLE = 2e-5  # of the range


def scene(rung: str) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(FOLDER / rung)
    return mechanism, next(iter(load_cases(FOLDER / rung, mechanism).values()))


def reference(mechanism: Mechanism, case: Case) -> Record:
    flexinv = adapter(ENGINES["flexinv"])
    certify = offered(flexinv, "certify")
    assert certify is not None
    record = flexinv.run(mechanism, case, "flexinv", {"error": False})
    return replace(record, certificate=certify(mechanism, case, "flexinv").plain)


@pytest.mark.parametrize("rung", RUNGS)
def test_it_climbs_what_it_says(rung: str) -> None:
    reason = newton_engine.unsupported(*scene(rung), "newton")
    assert (reason is None) == (rung in CLIMBED)


@pytest.mark.parametrize("rung", CLIMBED)
def test_it_agrees_within_its_error_bars_which_are_those_of_single_precision(rung: str) -> None:
    mechanism, case = scene(rung)
    ours, theirs = reference(mechanism, case), newton_engine.run(mechanism, case, "newton", {})
    for name, one in theirs.series.items():
        off = np.abs(one.values - ours.series[name].values)
        assert one.error is not None
        assert (off <= one.error).all(), name
        size = max(float(np.ptp(s.values)) for s in ours.series.values() if s.quantity == one.quantity)
        assert float(one.error.max()) <= SINGLE * size, name


def test_it_repeats_bit_by_bit() -> None:
    one, two = (newton_engine.run(*scene("tree"), "newton", {}) for _ in range(2))
    assert all(np.array_equal(series.values, two.series[name].values) for name, series in one.series.items())


def test_a_spring_in_a_joint_that_turns_without_end_is_followed_over_whole_turns() -> None:
    mechanism, case = scene("drives")
    joints = tuple(replace(j, kind="continuous") if j.name == "elbow" else j for j in mechanism.joints)
    mechanism = replace(mechanism, joints=joints)
    there, then = {"shoulder": 0.0, "elbow": 0.2}, {"shoulder": 0.3, "elbow": 12.0}
    case = replace(case, motion=Motion.point_to_point(there, then, 0.8, law="quintic"))
    ours, theirs = reference(mechanism, case), newton_engine.run(mechanism, case, "newton", {})
    expected = ours.series["torque/elbow"].values
    # Of the spring a whole turn more or less would be 2 pi times its stiffness: a quarter of the range.
    assert np.abs(theirs.series["torque/elbow"].values - expected).max() <= SINGLE * np.ptp(expected)


def heavier(parts: Any) -> Any:
    mass, com, tensor = GOOD["weight"](parts)
    return 1.15 * mass, com, tensor


def lighter_gravity(mechanism: Mechanism, worlds: int) -> Any:
    return GOOD["build"](replace(mechanism, gravity=0.9 * np.asarray(mechanism.gravity)), worlds)


def without_rotors(mechanism: Mechanism, worlds: int) -> Any:
    joints = tuple(replace(joint, rotor_inertia=0.0) for joint in mechanism.joints)
    return GOOD["build"](replace(mechanism, joints=joints), worlds)


def without_friction(mechanism: Mechanism, qd: Any) -> Any:
    return np.array([joint.damping for joint in mechanism.joints if joint.nv]) * qd


GOOD: dict[str, Callable[..., Any]] = {"weight": newton_engine.weight, "build": newton_engine.build}
# The mistake, and the words of which one has to be in the name of a cause that is named (first, or among three at most).
FAULTS: dict[str, tuple[dict[str, Callable[..., Any]], tuple[str, ...]]] = {
    "all links are 15 % heavier": ({"weight": heavier}, ("mass",)),
    "gravity is a tenth too small": ({"build": lighter_gravity}, ("gravity",)),
    "the rotors are forgotten": ({"build": without_rotors}, ("rotor",)),
    "the dry friction is forgotten": ({"passive_effort": without_friction}, ("friction",)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_mistakes_in_the_adapter_are_named(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, case = scene("drives")
    save(reference(mechanism, case), tmp_path / "flexinv")
    planted, words = FAULTS[fault]
    for name, new in planted.items():
        monkeypatch.setattr(newton_engine, name, new)
    save(newton_engine.run(mechanism, case, "newton", {}), tmp_path / "newton")
    stems = str(tmp_path / "newton"), str(tmp_path / "flexinv")
    diagnosis = diagnose(str(FOLDER / "drives"), case.name, "newton", *stems, door={"module": "crosscheck_newton"})
    names = [str(one["cause"]) for one in diagnosis["named"]][:3]
    assert any(word in name for name in names for word in words), diagnosis["words"]
