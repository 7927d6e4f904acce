"""Error bars count where runs show them that were asked for, on both sides; all else beyond a limit deviates or stays open."""

from __future__ import annotations

import datetime
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from crosscheck.conform import ladder
from crosscheck.doors.outside_bars import convert_door_bars, of_package
from crosscheck.engines.base import Adapter
from crosscheck.measures.budget import STATED, Family, add_error_bars, compute_error_bar, is_checked
from crosscheck.measures.record import Record, RecordError, Series, check, read_record, save, series
from crosscheck.report import junit, markdown, words
from crosscheck.verdicts.bars import COARSE, PART
from crosscheck.verdicts.baseline import choose_blessable
from crosscheck.verdicts.compare import Comparison, RecordPair, compare
from crosscheck.verdicts.refinement import (
    RefinementHalvings,
    find_wanted_refinement,
    is_open,
    update_open_rows,
)
from crosscheck.verdicts.results import CaseRow, EngineRow, Results, RunRow
from flexinv.files.load_cases import Case, Limit
from flexinv.model.motion import Motion

TIME = np.arange(0.0, 1.0005, 1e-3)
EXACT = np.sin(9.0 * TIME)  # [N m]
SHAPE = np.cos(31.0 * TIME)  # of discretisation errors
RANGE = float(np.ptp(EXACT))
LIMIT = 2e-4  # of the range, as a case of ours states it
NAME = "torque/hub"


def runs(exact: np.ndarray, size: float, orders: float = 2.0) -> list[dict[str, Series]]:
    """Three runs whose errors are ``size`` [-] of the range in the first, and of an order in the step."""
    return [series(NAME, "N m", exact + size * RANGE * SHAPE * 2.0 ** (-orders * k)) for k in range(3)]


def record(engine: str, size: float, factor: float = 1.0, value: int = -1) -> Record:
    """A record with bars of three runs; factor : a mistake in all of them [-]; value : which one is reported."""
    levels = runs(factor * EXACT, size)
    made, budget = add_error_bars(levels[value], [Family("step", levels, value)])
    return Record(engine, time=TIME, series=made, budget=budget)


def bare(values: np.ndarray, bar: float | None = None) -> Record:
    """A record from outside, perhaps with a bar that it states [-]; as its door hands it on."""
    error = None if bar is None else np.full(TIME.size, bar * RANGE)
    return convert_door_bars(Record("mine", time=TIME, series=series(NAME, "N m", values, error)))


def case(maximum: float = LIMIT) -> Case:
    motion = Motion.point_to_point(np.zeros(1), np.ones(1), 1.0)
    limit = Limit(quantity="torque", engines=("*",), maximum=maximum, reason="a test")
    return Case("c", "", motion, step=1e-3, end=1.0, sample=1e-3, quantities=("torque",), limits=(limit,))


def row(ours: Record, theirs: Record, maximum: float = LIMIT) -> Comparison:
    (result,) = compare(RecordPair("arm", case(maximum), ours, theirs, rest=1.0, today=datetime.date(2026, 3, 1)))
    return result


def blurred(bar: float) -> Record:
    """flexinv with a bar [-] whose refinements tend to nothing that is known better."""
    one = record("flexinv", bar, value=0)
    plain = {name: replace(s, refined=None, left=None) for name, s in one.series.items()}
    return replace(one, series=plain)


@pytest.mark.parametrize("off", [0.006, 0.023])
def test_the_bar_of_the_reference_alone_explains_nothing(off: float) -> None:
    """Records without bars, 0.6 to 2.3 % of the range away where the limit is 2e-4 and our own bar 2.9 %."""
    result = row(bare(EXACT + off * RANGE * SHAPE), blurred(0.029))
    assert result.verdict == "unjudged"
    assert result.message.startswith(f"{COARSE}: the error bar of flexinv is 0.02")


def test_a_reference_that_is_too_coarse_is_compared_by_what_its_refinements_tend_to() -> None:
    """Half a step late, as of a motion that was sampled wrongly: 1 % of the range, inside our bar and not inside what is left."""
    coarse = record("flexinv", 0.029, value=0)
    late = row(bare(np.sin(9.0 * (TIME - 0.002))), coarse, maximum=2e-3)
    assert (late.verdict, late.refined) == ("deviation", True)
    right = row(bare(EXACT), coarse, maximum=2e-3)
    assert (right.verdict, right.refined) == ("within", True)
    assert right.reference_bar is not None
    assert right.reference_bar < 0.029 * RANGE / 16  # of three runs with errors 1, 1/4, 1/16 the last at most
    assert not row(bare(EXACT), record("flexinv", 0.9 * PART * LIMIT, value=0)).refined


def test_a_difference_that_no_refinement_can_change_is_judged_all_the_same() -> None:
    """With a bar of half the limit: 0.4 and 0.6 limits apart, and one and a half limits, more or less a tenth."""
    reference = blurred(0.5 * LIMIT)
    ours = reference.series[NAME].values
    expected = {0.4: "within", 0.6: "unjudged", 1.4: "unjudged", 1.6: "deviation"}
    for apart, verdict in expected.items():
        assert row(bare(ours + apart * RANGE * LIMIT), reference).verdict == verdict


def test_a_bar_that_an_engine_states_by_itself_explains_nothing() -> None:
    """Torques times 1.05 with a bar of 9.9 %, narrower than a tenth of the range."""
    result = row(bare(1.05 * EXACT, 0.099), record("flexinv", 1e-6))
    assert result.verdict == "deviation"
    assert "mine states error bars of 0.099 by itself, which no run has shown" in result.message
    assert (result.error_bar, result.engine_bar) == (None, None)
    assert result.stated_bar == pytest.approx(0.099 * RANGE)


def test_bars_of_both_that_runs_show_explain() -> None:
    result = row(record("mine", 0.2), record("flexinv", 1e-6))
    assert result.verdict == "explained"
    assert result.message.startswith("by discretisation: ")
    assert f"mine {(result.engine_bar or 0) / RANGE:.3g}, flexinv" in result.message
    assert result.error_bar == pytest.approx((result.engine_bar or 0.0) + (result.reference_bar or 0.0))
    unknown = Record("flexinv", time=TIME, series=series(NAME, "N m", EXACT))
    assert row(record("mine", 0.2), unknown).verdict == "deviation"  # a reference without a bar carries nothing


def test_a_mistake_that_stays_when_runs_are_refined_is_not_explained_by_their_bars() -> None:
    """Torques times 1.05 in a run that is 6 % coarse: its bars cover that, what the runs tend to does not."""
    levels = [series(NAME, "N m", (1.05 - 0.96 * 4.0**-k) * EXACT) for k in range(3)]
    made, budget = add_error_bars(levels[-1], [Family("step and mesh", levels)])
    result = row(Record("mine", time=TIME, series=made, budget=budget), record("flexinv", 1e-6))
    assert result.maximum is not None
    assert result.error_bar is not None
    assert result.maximum <= result.error_bar
    assert result.verdict == "deviation"
    assert "is left where the refined runs of mine tend to" in result.message


def test_a_program_that_refines_once_and_then_no_more_shows_no_bar() -> None:
    """A first run far away, then twice the same wrong one: the largest difference is a wide bar, but the last two agree."""
    levels = [series(NAME, "N m", 1.05 * EXACT + off * RANGE * SHAPE) for off in (0.09, 0.0, 0.0)]
    made, budget = add_error_bars(levels[-1], [Family("step and mesh", levels)])
    program = Record("mine", time=TIME, series=made, budget=budget)
    result = row(program, record("flexinv", 1e-6))
    assert result.verdict == "deviation"
    assert result.engine_bar == pytest.approx(0.09 * RANGE)


def test_what_runs_tend_to_is_covered_by_its_bar() -> None:
    """Of errors of two powers, in which no single order fits: what is left of the error is inside the bar that is left."""
    for size in (1e-1, 1e-3):
        levels = [EXACT + size * SHAPE * (h**2 + 0.4 * h**3) for h in (1.0, 0.5, 0.25)]
        error_bar = compute_error_bar(levels, 0)
        assert error_bar.tends_to is not None
        assert error_bar.left is not None
        assert (np.abs(error_bar.tends_to - EXACT) <= error_bar.left).all()
        assert error_bar.left.max() < 0.1 * error_bar.bar.max()


def test_families_that_do_not_all_say_what_they_tend_to_say_nothing() -> None:
    good, wild = runs(EXACT, 1e-2), runs(EXACT, 1e-2, orders=-1.0)
    wild[0] = good[0]
    made, _ = add_error_bars(good[0], [Family("step", good, 0), Family("mesh", wild, 0)])
    assert made[NAME].error is not None
    assert made[NAME].refined is None


# ------------------------------------------------------------------------------------------------- engines from outside


def adapter(**members: Any) -> Adapter:
    return cast(Adapter, SimpleNamespace(version=str, **members))


def answer(factor: float, bar: float) -> Any:
    """A package whose runs are factor times right, coarse by 20 %, with a budget of its own that says a bar [-]."""

    def run(mechanism: Any, one: Any, engine: str, options: dict[str, Any]) -> Record:
        level = int(options.get("refinement", 0))
        values = factor * EXACT + 0.2 * RANGE * SHAPE * 4.0**-level
        made = series(NAME, "N m", values, np.full(TIME.size, bar * RANGE))
        line = {"bar": bar, "peak": 1.0, "peak_bar": bar, "order": {"step": 2.0}, "how": {"step": "Richardson"}}
        return Record(engine, time=TIME, series=made, budget={NAME: line})

    return run


def test_the_budget_of_a_package_is_what_it_states() -> None:
    result = of_package(adapter(run=answer(1.05, 0.099)), cast(Any, None), case(), "mine", {})
    assert not is_checked(result.budget, NAME)
    assert STATED in result.budget[NAME]["how"]
    assert row(result, record("flexinv", 1e-6)).verdict == "deviation"


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "explained"), (1.05, "deviation")])
def test_a_package_that_refines_is_asked_for_three_runs(factor: float, verdict: str) -> None:
    result = of_package(adapter(run=answer(factor, 0.0), refines=True), cast(Any, None), case(), "mine", {})
    assert is_checked(result.budget, NAME)
    assert result.series[NAME].error is not None
    assert row(result, record("flexinv", 1e-6)).verdict == verdict


def test_a_door_keeps_the_bars_that_it_made() -> None:
    ours = record("mine", 0.1)
    assert convert_door_bars(ours).series[NAME].refined is not None
    assert is_checked(convert_door_bars(ours).budget, NAME)
    other = series("tip/arm/x", "m", EXACT, np.ones(TIME.size))
    mixed = convert_door_bars(replace(ours, series={**ours.series, **other}))
    assert (is_checked(mixed.budget, NAME), is_checked(mixed.budget, "tip/arm/x")) == (True, False)


@pytest.mark.parametrize(
    ("bars", "words"),
    [
        (np.full(TIME.size, -1.0), "are negative"),
        (np.where(TIME == 0.5, np.nan, 1.0), "are not finite"),
        (np.zeros(0), "of shape"),
        (np.full(TIME.size, 1.0j), "expected real numbers"),
    ],
)
def test_bars_that_are_none_are_refused(bars: np.ndarray, words: str) -> None:
    whole = series(NAME, "N m", EXACT)[NAME]
    for one in (replace(whole, error=bars), replace(whole, refined=EXACT, left=bars)):
        with pytest.raises(RecordError, match=words):
            check(Record("mine", time=TIME, series={NAME: one}), TIME)


def test_masked_entries_are_no_numbers(tmp_path: Any) -> None:
    masked = np.ma.masked_array(EXACT, TIME > 0.5)
    with pytest.raises(RecordError, match="masked"):
        save(Record("mine", time=TIME, series={NAME: Series(NAME, "N m", masked)}), tmp_path / "r")


def test_what_refinements_tend_to_is_kept_with_a_record(tmp_path: Any) -> None:
    one = record("mine", 0.1)
    save(one, tmp_path / "r")
    again = read_record(tmp_path / "r").series[NAME]
    for part in ("error", "refined", "left"):
        np.testing.assert_array_equal(getattr(again, part), getattr(one.series[NAME], part))


# ------------------------------------------------------------------------------------------------- a finer reference


def test_the_reference_is_refined_as_far_as_a_comparison_needs_and_no_further() -> None:
    reference = blurred(0.029)
    lines = {**reference.budget[NAME], "bars": {"step": 0.029 * RANGE}, "left": {}}
    reference = replace(reference, budget={NAME: lines})
    open_ = row(bare(EXACT), reference, maximum=2e-2)
    assert is_open(open_)
    assert find_wanted_refinement([open_], reference, RefinementHalvings()) == RefinementHalvings(
        step=2
    )  # 0.029 / 4^2 < 2e-3 < 0.029 / 4
    assert find_wanted_refinement([open_], reference, RefinementHalvings(step=3)) is None  # no more halvings than that
    assert find_wanted_refinement([replace(open_, verdict="deviation")], reference, RefinementHalvings()) is None
    closed = replace(reference, budget={NAME: {**lines, "bars": {"rounding": 1.0}}})
    assert (
        find_wanted_refinement([open_], closed, RefinementHalvings()) is None
    )  # closed formulas have nothing to refine


def test_only_open_comparisons_are_judged_anew() -> None:
    open_ = row(bare(EXACT), blurred(0.029))
    fresh = row(bare(EXACT), record("flexinv", 1e-6))
    assert [one.verdict for one in update_open_rows([open_], [fresh])] == ["within"]
    shut = replace(open_, verdict="within", message="")
    assert update_open_rows([shut], [fresh]) == [shut]


# ------------------------------------------------------------------------------------------------- what outputs say


def results(*rows: Comparison) -> Results:
    here = ("arm", "c")
    ran = tuple(RunRow(*here, name, "ok") for name in ("flexinv", "mine"))
    engines = tuple(EngineRow(name, True) for name in ("flexinv", "mine"))
    return Results("2026-03-01", finished=True, engines=engines, cases=(CaseRow(*here),), runs=ran, comparisons=rows)


def test_every_output_says_that_the_reference_is_too_coarse() -> None:
    result = results(row(bare(EXACT + 0.006 * RANGE * SHAPE), blurred(0.029)))
    assert "1 comparison needs a finer reference" in words.describe_run(result)
    assert COARSE in markdown.render(result)
    assert COARSE in str(junit.render(result))
    assert any(COARSE in text for _, _, _, text in words.list_troubles(result))
    assert result.exit_code == 1
    good, bad = choose_blessable(result)
    assert not good
    assert COARSE in bad[0]


def test_every_output_says_that_a_bar_is_but_stated() -> None:
    result = results(row(bare(1.05 * EXACT, 0.099), record("flexinv", 1e-6)))
    for text in (markdown.render(result), str(junit.render(result))):
        assert "mine states error bars of 0.099 by itself" in text


def test_a_rung_has_a_largest_bar_and_says_how_wide_bars_were() -> None:
    """Torques that bars of 9.9 % cover hold no rung of 2e-3, even if runs show the bars; what holds says how wide they are."""
    here = ("beam_moving", "turn")
    one = replace(row(record("mine", 0.2), record("flexinv", 1e-6)), mechanism=here[0], case=here[1], limit=2e-3)
    assert one.verdict == "explained"

    def rung(comparison: Comparison) -> ladder.Rung:
        climbed = Results("", cases=(CaseRow(*here),), runs=(RunRow(*here, "mine", "ok"),), comparisons=(comparison,))
        return next(each for each in ladder.list_rungs(climbed, "mine") if each.name == "beam_moving")

    assert rung(one).verdict == "explained"
    assert "error bars: mine 0.0" in rung(one).message
    wide = replace(one, error_bar=0.099 * RANGE, engine_bar=0.099 * RANGE)
    assert rung(wide).verdict == "deviation"
    assert "wider than the 0.02 that this rung admits: refine" in rung(wide).message
    told = replace(one, verdict="within", message="", engine_bar=None, error_bar=None, stated_bar=0.099 * RANGE)
    assert "mine none (states 0.099 by itself, unchecked)" in rung(told).message


def test_an_engine_with_the_same_steps_is_held_against_the_values_themselves() -> None:
    """Its difference is no discretisation error, and no bar of the reference excuses it or hides it."""
    theirs = record("flexinv", 1e-2)
    same = Record("flexinv-c", time=TIME, series=series(NAME, "N m", theirs.series[NAME].values))
    assert row(same, theirs).verdict == "within"
    assert row(replace(same, engine="mine"), theirs).verdict == "deviation"  # refined, the reference is elsewhere
    off = theirs.series[NAME].values + 1e-3 * RANGE
    assert row(replace(same, series=series(NAME, "N m", off)), theirs).verdict == "deviation"
