"""Comparisons: errors over the range, limits by name, verdicts; each verdict has an example that gets it."""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np
import pytest

from crosscheck.measures import limits
from crosscheck.measures.record import Record, make_wrench_series, series, torque_series
from crosscheck.verdicts.compare import Comparison, RecordPair, compare, compute_fraction, compute_signal_range
from flexinv.files.load_cases import Case, Limit
from flexinv.model.mechanism import Joint, Link, Mechanism
from flexinv.model.motion import Motion

TODAY = datetime.date(2026, 3, 1)
TIME = np.arange(0.0, 2.0, 1e-3)
MECHANISM = Mechanism(
    "arm",
    (Link("a"), Link("b"), Link("c")),
    (Joint("j1", "revolute", "world", "a"), Joint("j2", "revolute", "a", "b"), Joint("j3", "prismatic", "b", "c")),
)
LARGE = np.outer(np.sin(3.0 * TIME), [10.0, 0.1, 400.0])


def limit(quantity: str, maximum: float, *engines: str, **more: object) -> Limit:
    stated = {"reference": "flexinv", "reason": "a test", "expires": None, **more}
    return Limit(quantity=quantity, engines=engines or ("*",), maximum=maximum, **stated)


def case(quantities: tuple[str, ...] = ("torque",), *stated: Limit) -> Case:
    motion = Motion.point_to_point(np.zeros(3), np.ones(3), 1.0)
    return Case("c", "", motion, step=1e-3, end=2.0, sample=1e-3, quantities=quantities, limits=stated)


def record(engine: str, torque: np.ndarray) -> Record:
    return Record(engine, time=TIME, series=torque_series(MECHANISM, torque))


def checked(engine: str, torque: np.ndarray, bars: np.ndarray) -> Record:
    """A record whose error bars runs have shown (`crosscheck.measures.budget`)."""
    made = torque_series(MECHANISM, torque, bars)
    line = {"order": {"step": 2.0}, "how": {"step": "Richardson"}}
    return Record(engine, time=TIME, series=made, budget=dict.fromkeys(made, line))


def rows(ours: Record, theirs: Record, one: Case) -> list[Comparison]:
    return compare(RecordPair("arm", one, ours, theirs, rest=1.0, today=TODAY))


def test_errors_are_over_the_range_of_the_largest_series_of_the_unit() -> None:
    torque = LARGE.copy()
    torque[700, 1] += 0.04
    metres, newtons = rows(record("e", torque), record("flexinv", LARGE), case(("torque",), limit("torque", 1e-3)))
    span = float(np.ptp(10.0 * np.sin(3.0 * TIME)))
    assert (metres.unit, metres.series, metres.time) == ("N m", "torque/j2", pytest.approx(0.7))
    assert metres.maximum == pytest.approx(0.04)
    assert metres.rms == pytest.approx(0.04 / np.sqrt(TIME.size))
    assert metres.fraction == pytest.approx(0.04 / span)
    assert (metres.limit, metres.reason) == (1e-3, "a test")
    assert metres.verdict == "deviation"
    assert metres.message == f"{0.04 / span:.3g} of the range, the limit is 0.001"
    assert (newtons.unit, newtons.maximum, newtons.verdict) == ("N", 0.0, "within")


@pytest.mark.parametrize(("size", "verdict"), [(0.99, "within"), (1.01, "deviation")])
def test_the_limit_is_where_it_is_stated(size: float, verdict: str) -> None:
    torque = LARGE + size * 1e-6 * np.ptp(LARGE[:, 0]) * np.array([1.0, 0.0, 0.0])
    result = rows(record("e", torque), record("flexinv", LARGE), case(("torque",), limit("torque", 1e-6)))
    assert result[0].verdict == verdict


def test_a_holding_torque_is_measured_by_its_size() -> None:
    hold = np.full(10, 7.0) + np.linspace(0.0, 1e-14, 10)
    assert compute_signal_range([hold, np.zeros(10)]) == pytest.approx(7.0)
    assert compute_signal_range([hold, np.linspace(-1.0, 1.0, 10)]) == pytest.approx(2.0)
    assert compute_fraction(0.0, 0.0) == 0.0
    assert compute_fraction(1e-300, 0.0) == np.inf


def test_an_error_in_a_quantity_that_is_zero_is_a_deviation() -> None:
    zero = record("flexinv", np.zeros_like(LARGE))
    one = case(("torque",), limit("torque", 0.5))
    assert {r.verdict for r in rows(record("e", np.zeros_like(LARGE)), zero, one)} == {"within"}
    assert "deviation" in {r.verdict for r in rows(record("e", LARGE), zero, one)}


@pytest.mark.parametrize(
    ("ours", "theirs", "verdict", "message"),
    [
        (Record("e", "timeout", "stopped"), record("flexinv", LARGE), "error", "timeout: stopped"),
        (Record("e", "skipped", "has no beams"), record("flexinv", LARGE), "skipped", "has no beams"),
        (record("e", LARGE), Record("flexinv", "error", "sad"), "error", "reference flexinv: error: sad"),
        (record("e", LARGE), Record("flexinv", "skipped", "no"), "skipped", "reference flexinv: no"),
    ],
)
def test_what_did_not_run_is_never_within(ours: Record, theirs: Record, verdict: str, message: str) -> None:
    (result,) = rows(ours, theirs, case(("torque",), limit("torque", 1.0)))
    assert (result.verdict, result.message, result.maximum) == (verdict, message, None)


def test_records_of_different_models_are_not_compared() -> None:
    ours, theirs = replace(record("e", LARGE), model_hash="1"), replace(record("flexinv", LARGE), model_hash="2")
    (result,) = rows(ours, theirs, case(("torque",), limit("torque", 1.0)))
    assert (result.verdict, result.maximum) == ("error", None)
    assert "another model than flexinv" in result.message


def test_a_quantity_that_an_engine_does_not_give_is_skipped_and_one_in_part_is_an_error() -> None:
    whole = record("flexinv", LARGE)
    one = case(("torque", "tip"), limit("torque", 1.0))
    part = replace(whole, engine="e", series={"torque/j1": whole.series["torque/j1"]})
    result = {(r.quantity, r.unit): r for r in rows(part, whole, one)}
    assert result["torque", "N m"].verdict == "error"
    assert result["torque", "N m"].message == "1 of 2 series; torque/j2 is missing"
    assert result["torque", "N"].verdict == "skipped"
    assert (result["tip", ""].verdict, result["tip", ""].message) == ("skipped", "flexinv does not give it")


def test_of_wrenches_an_engine_may_give_a_part_and_the_row_says_so() -> None:
    whole = Record("flexinv", time=TIME, series=make_wrench_series("j1", np.ones((TIME.size, 6))))
    part = replace(whole, engine="e", series={"wrench/j1/fx": whole.series["wrench/j1/fx"]})
    force, moment = rows(part, whole, case(("wrench",), limit("wrench", 1e-9)))
    assert (force.verdict, force.message) == ("within", "1 of 3 series; wrench/j1/fy is missing")
    assert moment.verdict == "skipped"


def test_what_is_rounding_of_the_other_unit_is_measured_by_that() -> None:
    """A closure that carries 10 N and, but for rounding, no moment: 1e-15 N m instead of 2e-15 N m is no deviation."""

    def wrench(moment: float) -> np.ndarray:
        return np.outer(np.sin(3.0 * TIME), [10.0, 0.0, 0.0, 0.0, 0.0, moment])

    one = case(("wrench",), limit("wrench", 1e-9))

    def verdicts(ours: float, theirs: float) -> list[str]:
        pair = (
            Record(n, time=TIME, series=make_wrench_series("j1", wrench(m)))
            for n, m in (("e", ours), ("flexinv", theirs))
        )
        return [r.verdict for r in rows(*pair, one)]

    assert verdicts(2e-15, 1e-15) == ["within", "within"]
    assert verdicts(1e-3, 1e-15) == ["within", "deviation"]  # a moment where there should be none
    assert verdicts(2e-11, 1e-11) == ["within", "deviation"]  # small, and not rounding


def test_a_series_in_another_unit_is_an_error() -> None:
    wrong = replace(record("e", LARGE), series=series("torque/j1", "N mm", LARGE[:, 0]))
    result = rows(wrong, record("flexinv", LARGE), case(("torque",), limit("torque", 1.0)))
    assert (result[0].verdict, result[0].message) == ("error", "torque/j1 is in N mm, not in N m")


def test_error_bars_of_both_engines_add_up() -> None:
    bars = np.broadcast_to([1.0, 0.0, 0.0], LARGE.shape)
    ours = checked("e", LARGE + np.array([0.5, 0.0, 0.0]), bars)
    theirs = checked("flexinv", LARGE, 0.25 * bars)
    assert rows(ours, theirs, case())[0].error_bar == pytest.approx(1.25)
    assert rows(record("e", LARGE), record("flexinv", LARGE), case())[0].error_bar is None


def test_beyond_the_limit_but_within_the_error_bars_is_explained_by_discretisation() -> None:
    span = float(np.ptp(10.0 * np.sin(3.0 * TIME)))
    off, one = np.array([0.02 * span, 0.0, 0.0]), case(("torque",), limit("torque", 1e-2))

    def verdict(bar: float) -> Comparison:
        bars = np.broadcast_to([bar * span, 0.0, 0.0], LARGE.shape)
        return rows(checked("e", LARGE + off, bars), checked("flexinv", LARGE, 0.0 * bars), one)[0]

    assert verdict(0.019).verdict == "deviation"
    covered = verdict(0.021)
    assert (covered.verdict, covered.message) == (
        "explained",
        "by discretisation: 0.02 of the range, the limit is 0.01, and the error bars add up to 0.021: e 0.021, flexinv 0",
    )
    wide = verdict(0.11)
    assert wide.verdict == "deviation"
    assert "too wide to explain it: refine" in wide.message
    assert wide.magnitude is not None
    assert wide.comprehensive == pytest.approx(np.hypot(wide.magnitude, wide.phase or 0.0))


def test_a_series_whose_error_its_bar_does_not_cover_is_not_explained_by_the_bar_of_another() -> None:
    off = np.array([0.4, 0.3, 0.0])
    bars = np.broadcast_to([0.5, 0.1, 0.0], LARGE.shape)
    ours, theirs = checked("e", LARGE + off, bars), checked("flexinv", LARGE, 0.0 * bars)
    assert rows(ours, theirs, case(("torque",), limit("torque", 1e-3)))[0].verdict == "deviation"


def test_the_dominant_frequency_of_the_hold_phase_is_compared() -> None:
    def ringing(frequency: float) -> np.ndarray:
        return LARGE * 0.0 + np.where(TIME < 1.0, 50.0 * TIME, np.sin(2.0 * np.pi * frequency * TIME))[:, None]

    one = case(("frequency",), limit("frequency", 5e-3))
    (result,) = rows(record("e", ringing(20.0)), record("flexinv", ringing(20.2)), one)
    assert (result.unit, result.verdict) == ("Hz", "deviation")
    assert result.scale == pytest.approx(20.2, abs=0.01)
    assert result.maximum == pytest.approx(0.2, abs=0.01)
    (result,) = rows(record("e", ringing(20.0)), record("flexinv", ringing(20.05)), one)
    assert result.verdict == "within"
    (result,) = rows(record("e", LARGE * 0.0), record("flexinv", ringing(20.0)), one)
    assert result.verdict == "skipped"


# --- limits -----------------------------------------------------------------------------------------------------------


def test_the_first_limit_that_fits_holds() -> None:
    stated = (
        limit("torque", 0.5, "mujoco-*"),
        limit("torque", 0.1, "*"),
        limit("torque", 9.0, "*", reference="exudyn"),
    )
    assert limits.find(stated, "torque", "mujoco-flex", "flexinv") is stated[0]
    assert limits.find(stated, "torque", "exudyn-ge", "flexinv") is stated[1]
    assert limits.find(stated, "torque", "flexinv", "exudyn") is stated[2]
    assert limits.find(stated, "tip", "exudyn", "flexinv") is None


@pytest.mark.parametrize(("version", "found"), [("1.13.6", 0), ("1.14.0", 1), ("source tree", 1), ("", 1)])
def test_a_limit_may_hold_for_some_versions(version: str, found: int) -> None:
    stated = (limit("torque", 0.5, "exudyn", versions=">=1.13, <1.14"), limit("torque", 0.1, "*"))
    assert limits.find(stated, "torque", "exudyn", "flexinv", version) is stated[found]
    assert limits.find(stated[:1], "torque", "exudyn", "flexinv", "1.14") is None


def test_references_are_those_that_limits_name_and_flexinv() -> None:
    stated = (limit("torque", 1.0, "exudyn-ge", reference="exudyn-ancf"), limit("tip", 1.0, "*"))
    assert limits.list_references(stated, "exudyn-ge") == ("exudyn-ancf", "flexinv")
    assert limits.list_references(stated, "pinocchio") == ("flexinv",)
    assert limits.list_references(stated, "flexinv") == ()


def test_without_a_limit_or_with_an_expired_one_nothing_is_within() -> None:
    assert limits.judge_by_limit(0.0, None, TODAY)[0] == "unjudged"
    until = limit("torque", 1.0, expires=TODAY)
    assert limits.judge_by_limit(0.5, until, TODAY)[0] == "within"
    verdict, message = limits.judge_by_limit(0.0, until, TODAY + datetime.timedelta(days=1))
    assert verdict == "unjudged"
    assert "expired on 2026-03-01" in message
    assert limits.judge_by_limit(float("nan"), limit("torque", 1.0), TODAY)[0] == "deviation"


def test_limits_that_nobody_asked_for_are_found() -> None:
    stated = (limit("torque", 1.0), limit("torque", 1.0), limit("twist", 1.0))
    assert limits.list_unused_limits(stated, stated[:1]) == list(stated[1:])


@pytest.mark.parametrize(
    ("verdicts", "worst", "code"),
    [
        ([], "skipped", 0),
        (["within", "skipped"], "within", 0),
        (["within", "unjudged"], "unjudged", 1),
        (["deviation", "unjudged", "within"], "deviation", 1),
        (["deviation", "error", "within"], "error", 2),
    ],
)
def test_the_worst_verdict_gives_the_exit_code(verdicts: list[limits.Verdict], worst: str, code: int) -> None:
    assert limits.find_worst_verdict(verdicts) == worst
    assert limits.compute_exit_code(verdicts) == code


def test_nothing_is_claimed_of_a_native_result_that_says_why_and_only_without_a_limit() -> None:
    today = datetime.date(2026, 1, 1)
    verdict, message = limits.judge_by_limit(0.9, None, today, "soft")
    assert verdict == "skipped"
    assert message == "not judged: no limit is stated, and the engine itself says why: 0.9 of the range: soft"
    assert limits.judge_by_limit(0.9, None, today)[0] == "unjudged"
    strict = Limit("torque", ("*",), 0.1, "a reason")
    assert limits.judge_by_limit(0.9, strict, today, "soft")[0] == "deviation"
