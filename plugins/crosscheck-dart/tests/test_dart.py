"""DART through the package door: it holds the rungs that it climbs, and mistakes in this very adapter are named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dartpy", reason="DART is not installed (python -m pip install dartpy)")

import crosscheck_dart as dart_engine

from crosscheck.causes.diagnosis import diagnose
from crosscheck.conform.ladder import FOLDER, RUNGS
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import offered
from crosscheck.measures.certificate import Certificate, checks
from crosscheck.measures.record import Record, save
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion

CLIMBED = ("double_pendulum", "tree", "drives")
EXACT = 1e-12  # of the range: closed formulas of a few links on both sides


def scene(rung: str) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(FOLDER / rung)
    return mechanism, next(iter(load_cases(FOLDER / rung, mechanism).values()))


def reference(mechanism: Mechanism, case: Case) -> tuple[Record, Certificate]:
    flexinv = adapter(ENGINES["flexinv"])
    certify = offered(flexinv, "certify")
    assert certify is not None
    return flexinv.run(mechanism, case, "flexinv", {"error": False}), certify(mechanism, case, "flexinv")


@pytest.mark.parametrize("rung", RUNGS)
def test_it_climbs_what_it_says(rung: str) -> None:
    reason = dart_engine.unsupported(*scene(rung), "dart")
    assert (reason is None) == (rung in CLIMBED)


@pytest.mark.parametrize("rung", CLIMBED)
def test_it_agrees_and_its_model_is_the_same(rung: str) -> None:
    mechanism, case = scene(rung)
    ours, said = reference(mechanism, case)
    result = dart_engine.run(mechanism, case, "dart", {})
    for name, one in result.series.items():
        size = max(float(np.ptp(s.values)) for s in ours.series.values() if s.quantity == one.quantity)
        assert float(np.abs(one.values - ours.series[name].values).max()) <= EXACT * size, name
    lines = checks("", "", "", dart_engine.certify(mechanism, case, "dart"), said)
    assert {line.what for line in lines} >= {"total mass", "joint-space mass matrix", "gravity torque", "joint axes"}
    assert all(line.holds for line in lines)


def test_a_spring_in_a_joint_that_turns_without_end_is_followed_over_whole_turns() -> None:
    mechanism, case = scene("drives")
    joints = tuple(replace(j, kind="continuous") if j.name == "elbow" else j for j in mechanism.joints)
    mechanism = replace(mechanism, joints=joints)
    there, then = {"shoulder": 0.0, "elbow": 0.2}, {"shoulder": 0.3, "elbow": 12.0}
    case = replace(case, motion=Motion.point_to_point(there, then, 0.8, law="quintic"))
    ours, theirs = reference(mechanism, case)[0], dart_engine.run(mechanism, case, "dart", {})
    expected = ours.series["torque/elbow"].values
    # Of the spring a whole turn more or less would be 2 pi times its stiffness: a quarter of the range.
    assert np.abs(theirs.series["torque/elbow"].values - expected).max() <= EXACT * np.ptp(expected)


# --- eight mistakes in this adapter, and what they may be called -----------------------------------------------------


def scaled_mass(body: Any, factor: float) -> None:
    body.setInertia(
        dart_engine.dart.dynamics.Inertia(factor * body.getMass(), np.ravel(body.getLocalCOM()), tensor(body))
    )


def tensor(body: Any) -> Any:
    return np.asarray(body.getInertia().getMoment())


def with_build(change: Callable[[Any], None]) -> dict[str, Any]:
    good = dart_engine.build

    def build(mechanism: Mechanism) -> Any:
        built = good(mechanism)
        change(built)
        return built

    return {"build": build}


def heavier(built_model: Any) -> None:
    scaled_mass(built_model.bodies["lower"], 1.15)


def moved_centre(built_model: Any) -> None:
    body = built_model.bodies["lower"]
    shifted = np.ravel(body.getLocalCOM()) + np.array([0.03, 0.0, 0.0])
    body.setInertia(dart_engine.dart.dynamics.Inertia(body.getMass(), shifted, tensor(body)))


def light_gravity(built_model: Any) -> None:
    built_model.skeleton.setGravity(0.9 * np.asarray(built_model.skeleton.getGravity()))


def no_rotors(mechanism: Mechanism, qdd: Any) -> Any:
    return 0.0 * qdd


def undamped(mechanism: Mechanism, qd: Any) -> Any:
    return np.array([j.friction for j in mechanism.joints]) * np.sign(qd)


def without_friction(mechanism: Mechanism, qd: Any) -> Any:
    return np.array([j.damping for j in mechanism.joints]) * qd


def pushed_the_wrong_way(mechanism: Mechanism, qd: Any) -> Any:
    return undamped(mechanism, -qd) + without_friction(mechanism, qd)


def longer(built_model: Any) -> None:
    joint = built_model.bodies["lower"].getParentJoint()
    moved = np.asarray(joint.getTransformFromParentBodyNode().matrix()).copy()
    moved[:3, 3] *= 1.1
    joint.setTransformFromParentBodyNode(dart_engine.dart.math.Isometry3(moved))


# The mistake, and the words of which one has to be in the name of a cause that is named (first, or among three at most).
FAULTS: dict[str, tuple[Callable[[], dict[str, Any]], tuple[str, ...]]] = {
    "the lower link is 15 % heavier": (lambda: with_build(heavier), ("mass", "inertia")),
    "the centre of mass is 3 cm off": (lambda: with_build(moved_centre), ("centre", "com")),
    "gravity is a tenth too small": (lambda: with_build(light_gravity), ("gravity",)),
    "the rotors are forgotten": (lambda: {"rotor_effort": no_rotors}, ("rotor",)),
    "the damping is forgotten": (lambda: {"passive_effort": undamped}, ("damping",)),
    "the dry friction is forgotten": (lambda: {"passive_effort": without_friction}, ("friction",)),
    "the dry friction has the wrong sign": (lambda: {"passive_effort": pushed_the_wrong_way}, ("friction",)),
    "the lower joint sits 6 cm too far out": (
        lambda: with_build(longer),
        ("position", "length", "placement", "offset"),
    ),
}
ENOUGH = 6  # of eight


def test_mistakes_in_the_adapter_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of eight at least six are named first or among three, and where one cause alone is named, it is the right one."""
    mechanism, case = scene("drives")
    ours, said = reference(mechanism, case)
    save(Record(**{**vars(ours), "certificate": said.plain}), tmp_path / "flexinv")
    right, wrong = [], {}
    for fault, (planted, words) in FAULTS.items():
        with monkeypatch.context() as patch:
            for name, new in planted().items():
                patch.setattr(dart_engine, name, new)
            record = dart_engine.run(mechanism, case, "dart", {})
            record = Record(**{**vars(record), "certificate": dart_engine.certify(mechanism, case, "dart").plain})
            save(record, tmp_path / "dart")
            stems = str(tmp_path / "dart"), str(tmp_path / "flexinv")
            diagnosis = diagnose(str(FOLDER / "drives"), case.name, "dart", *stems, door={"module": "crosscheck_dart"})
        names = [str(one["cause"]) for one in diagnosis["named"]][:3]
        if any(word in name for name in names for word in words):
            right.append(fault)
        elif len(names) == 1:
            wrong[fault] = names
    assert len(right) >= ENOUGH, (right, wrong)
    assert not wrong
