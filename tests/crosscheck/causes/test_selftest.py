"""The checker is checked: planted causes are named, unharmed mechanisms are left alone (the full matrix: crosscheck selftest)."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.fault_benches import BENCHES, Bench
from crosscheck.causes.fit import Candidate
from crosscheck.causes.model import make_model
from crosscheck.causes.selftest import CLEAN, FOUND, MATTERS, RANK, PlantedFault, _list_fault_sizes, run_bench
from crosscheck.causes.subject import Subject
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.studies.selftest import ALL, build_summary, count_outcomes, judge_fault, judge_targets
from crosscheck.verdicts.results import StudyRow
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Mechanism

MODELS = Path(__file__).resolve().parents[3] / "models"
BY_NAME = {bench.mechanism: bench for bench in BENCHES if bench.motion is None and bench.shape is None}
BY_LABEL = {bench.label: bench for bench in BENCHES}
RIGID = (
    "rotor inertia",
    "viscous damping",
    "joint misplaced",
    "gravity sign",
    "body mass",
    "order of efforts",
    "axis tilted",
)
COARSE = {"elements": 4, "error": False}


def quicker(bench: Bench) -> Bench:
    """A bench of a march with half the steps, in flexinv and in the engine.

    Error bars grow with that, and stay some ten times less than what the faults change here; `crosscheck selftest` has all steps.
    """
    name, moved = bench.motion or (bench.case, lambda mechanism, case: case)

    def coarser(mechanism: Mechanism, case: Case) -> Case:
        case = moved(mechanism, case)
        return replace(case, step=2.0 * case.step)

    return replace(bench, motion=(name, coarser), steps=bench.steps // 2)


CLOSED = ("viscous damping", "gravity off", "soft constraint", "missing body")
FLEXIBLE = ("dry friction", "section turned", "effort sign", "lumped mass")


def check(rows: list[PlantedFault], least: int) -> None:
    assert rows[0].cause == CLEAN
    assert rows[0].outcome == "silent"
    assert len([row for row in rows if row.change >= MATTERS]) >= least
    missed = [row for row in rows if row.change >= MATTERS and row.outcome not in FOUND]
    assert not missed, "\n".join(map(str, missed))


def test_planted_causes_are_named_on_a_rigid_mechanism() -> None:
    rows = run_bench(BY_NAME["double_pendulum"], MODELS, (0.1,), RIGID, targets=1)
    check(rows, least=6)
    assert {row.cause for row in rows if row.outcome == "alone"} >= {
        "viscous damping",
        "gravity sign",
        "order of efforts",
    }


def test_a_dry_friction_that_is_smoothed_is_named_with_the_speed_over_which_it_rises() -> None:
    """At a speed of nothing it is no change, so that no derivative leads to it: the efforts themselves say the speed."""
    rows = run_bench(BY_LABEL["ur5 (rubbing)/reach in mujoco"], MODELS, (0.1,), ("smoothed friction",))
    assert [row.outcome for row in rows] == ["silent", "alone", "alone"]


def test_what_cannot_be_along_no_axis_is_planted_where_it_shows() -> None:
    """A point out of a planar loop's plane leaves no loop, and a body at the end of its beam can only go back."""
    (*_, row) = run_bench(BY_LABEL["four_bar/turn in mujoco"], MODELS, (0.1,), ("closure point misplaced",), 1)
    assert row.outcome == "alone"
    columns = np.array([[1e-7, 0.5, 0.0], [0.0, 0.1, 0.0]])
    one = Candidate(DICTIONARY["closure point misplaced"], "C: first", 2.0, columns)
    for numbers in (tries := _list_fault_sizes(one, 0.1)):
        assert np.linalg.norm(numbers) == pytest.approx(0.2)
    assert [int(np.count_nonzero(numbers)) for numbers in tries] == [3, 2, 1] * 2
    assert np.array_equal(tries[5], -tries[2])


def test_what_a_bench_has_besides_is_planted_too() -> None:
    bench = Bench("rigid_3r", "quintic", "pinocchio", causes=("payload",), more=("rotor inertia",))
    assert {row.cause for row in run_bench(bench, MODELS, (0.1,))} == {CLEAN, "payload", "rotor inertia"}


@pytest.mark.slow
def test_planted_causes_are_named_on_a_closed_mechanism() -> None:
    check(run_bench(BY_NAME["four_bar"], MODELS, (0.1,), CLOSED, targets=1), least=4)


@pytest.mark.slow
def test_planted_causes_are_named_on_a_flexible_mechanism() -> None:
    bench = quicker(replace(BY_NAME["flex_one_link"], case="quintic", options=COARSE))
    check(run_bench(bench, MODELS, (0.1,), FLEXIBLE, targets=1), least=4)


@pytest.mark.slow
def test_inertias_are_told_apart_by_a_quick_motion_and_the_certificate() -> None:
    causes = ("inertial frame rotated", "rotary inertia dropped", "fixed joint fused wrongly")
    clean, *rows = run_bench(BY_LABEL["panda/quick in exudyn"], MODELS, (0.1,), causes)
    assert (clean.cause, clean.outcome) == (CLEAN, "silent")
    for cause in causes:
        result = {row.outcome for row in rows if row.cause == cause}
        assert "alone" in result, cause
        assert result <= {"alone", "unseen"}, cause  # the base's inertia is in no torque


@pytest.mark.slow
def test_long_steps_and_numerical_damping_are_told_apart_by_short_waves() -> None:
    finer = ("order 8", lambda arm: arm.with_mesh(1, 8))  # which carries these waves as two elements do
    bench = quicker(replace(BY_LABEL["flex_one_link/flick in exudyn-ge"], case="cycloid", shape=finer))
    rows = run_bench(bench, MODELS, causes=("time step", "numerical damping"))
    assert [(row.cause, row.outcome) for row in rows] == [
        (CLEAN, "silent"),
        ("time step", "alone"),
        ("numerical damping", "alone"),
    ]
    assert all(row.change > 0.005 for row in rows[1:])  # some ten times the error bars


def test_a_closure_of_wrong_rank_is_planted_and_found_by_the_certificate() -> None:
    rows = run_bench(BY_NAME["bricard"], MODELS, causes=(RANK,))
    assert [(row.cause, row.outcome) for row in rows] == [(CLEAN, "silent"), (RANK, "alone")]


ROWS = [
    PlantedFault("a", CLEAN, "", 0.0, 0.0, "silent", ()),
    *[PlantedFault("a", "payload", "tip", 0.1, 0.02, "alone", ("payload: tip",))] * 19,
    PlantedFault("a", "payload", "tip", 0.001, 1e-4, "unseen", ()),
]


@pytest.mark.parametrize(
    ("more", "enough"),
    [
        ([], True),
        ([PlantedFault("a", "payload", "tip", 0.1, 0.02, "another", ("rotor inertia: hub",))], True),  # 19 of 20
        ([PlantedFault("a", "payload", "tip", 0.1, 0.02, "none", ())] * 2, False),  # 19 of 21
        ([PlantedFault("b", CLEAN, "", 0.0, 0.0, "another", ("time step",))], False),  # a false cause
    ],
)
def test_the_targets_can_be_missed(more: list[PlantedFault], enough: bool) -> None:
    rows = [asdict(row) | {"verdict": judge_fault(row)} for row in [*ROWS, *more]]
    assert count_outcomes(rows)["matter"] == 19 + sum(row.change >= MATTERS for row in more)
    table = StudyRow("one", "one", rows=tuple(rows))
    some = build_summary([table], whole=False)
    assert some.verdict == ("within" if not more else "deviation")
    met = judge_targets([table], whole=False)
    assert all(line["verdict"] == "within" for line in met) is enough
    assert [row["verdict"] for row in some.rows[-len(met) :]] == [line["verdict"] for line in met]


def test_every_cause_has_to_be_named_alone_somewhere() -> None:
    """Of all benches; one that is only in the set, or was never planted, is a target missed, and so are few causes."""
    rows = [
        asdict(PlantedFault("a", cause, "x", 0.1, 0.02, "alone", (cause,))) | {"verdict": "within"} for cause in ALL
    ]
    rows.append(asdict(ROWS[0]) | {"verdict": "within"})
    complete = StudyRow("one", "one", rows=tuple(rows))
    assert {line["verdict"] for line in judge_targets([complete])} == {"within"}
    assert build_summary([complete]).verdict == "within"
    assert [row["alone"] for row in build_summary([complete]).rows if row["cause"] == "beam mass"] == ["a"]
    together = [*rows[:-2], rows[-1], rows[-2] | {"outcome": "in the set"}]
    for less, missing in ((together, ALL[-1]), (rows[1:], ALL[0])):
        result = {line["cause"]: line for line in judge_targets([StudyRow("one", "one", rows=tuple(less))])}
        line = result["each cause named alone on at least one mechanism"]
        assert (line["verdict"], line["alone"]) == ("deviation", f"not {missing}")
        shown = [r for r in build_summary([StudyRow("one", "one", rows=tuple(less))]).rows if r["cause"] == missing]
        assert [(r["alone"], r["verdict"]) for r in shown] == [("nowhere", "deviation")]
    few = judge_targets([StudyRow("one", "one", rows=tuple(rows[:24]))])
    assert {line["cause"]: line["verdict"] for line in few}["at least 25 causes"] == "deviation"


def test_every_cause_can_sit_on_some_bench() -> None:
    """Without a run of any engine: one that has a place nowhere would be missed by the long run only."""
    left = dict(DICTIONARY)
    for bench in BENCHES:
        folder = MODELS / bench.mechanism
        mechanism = read_mechanism(folder)
        mechanism, case = bench.make_bench_case(mechanism, load_cases(folder, mechanism)[bench.case])
        model = make_model(Subject(mechanism, case))
        known = {name: cause for name, cause in left.items() if name in bench.planted}
        for name, cause in known.items():
            if any(cause.scale(model, target) for target in cause.targets(model)):
                del left[name]
    assert not left


@pytest.mark.slow
@pytest.mark.parametrize(
    ("label", "cause", "other"),
    [
        ("ur5 (geared)/reach in pinocchio", "rotor inertia dropped", {}),
        # A motion of the bench's own, with the mesh of the smooth one.
        ("flex_one_link (stout)/snap in exudyn-ge", "shear factor", {"case": "cycloid"}),
        ("flex_one_link_damped/cycloid in exudyn-ge", "beam damping dropped", {"case": "septic", "options": COARSE}),
    ],
)
def test_what_only_a_bench_of_its_own_shows_is_named_alone(label: str, cause: str, other: dict[str, Any]) -> None:
    bench = replace(BY_LABEL[label], **other)
    rows = run_bench(quicker(bench) if bench.options else bench, MODELS, (0.1,), (cause,))
    assert [(row.cause, row.outcome) for row in rows] == [(CLEAN, "silent"), (cause, "alone")]
    assert rows[1].change >= MATTERS
