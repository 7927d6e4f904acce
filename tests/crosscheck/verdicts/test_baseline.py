"""The blessed night: worse than it by more than noise is a deviation, and only ``crosscheck bless`` moves it."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from crosscheck import output_folder as owned
from crosscheck.cli import main
from crosscheck.report import words
from crosscheck.verdicts import baseline
from crosscheck.verdicts import results as store
from crosscheck.verdicts.baseline import Baseline, BaselineError
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, Results, RunRow
from crosscheck.verdicts.scope import Scope

ROW = Comparison("arm", "swing", "mujoco", "flexinv", "torque", "N m", "within", "", 2e-4, 1e-4, 1.0, limit=1e-3)
SMALL = replace(ROW, quantity="tip", unit="m", maximum=3e-14, limit=1e-12)
DEVIATION = replace(
    ROW, engine="exudyn", verdict="deviation", maximum=5e-3, message="0.005 of the range, the limit is 0.001"
)
SKIPPED = replace(ROW, engine="pinocchio", verdict="skipped", maximum=None, limit=None, unit="")


def night(*rows: Comparison, **more: object) -> Results:
    case = CaseRow("arm", "swing")
    results = Results(
        "2026-03-01T01:00:00+00:00", finished=True, cases=(case,), comparisons=rows, versions={"mujoco": "4.0"}
    )
    return replace(results, **more)


def blessed(fraction: float, row: Comparison = ROW) -> Baseline:
    return Baseline({baseline.make_comparison_key(row): fraction}, "it was looked at", "2026-02-01T01:00:00+00:00", {})


@pytest.mark.parametrize(
    ("row", "before", "verdict"),
    [
        (ROW, 2e-4, "within"),
        (ROW, 1.91e-4, "within"),  # a hundredth of the limit of 1e-3
        (ROW, 1.89e-4, "deviation"),
        (replace(ROW, maximum=0.9e-3), 0.883e-3, "within"),  # two per cent of the blessed value
        (replace(ROW, maximum=0.9e-3), 0.881e-3, "deviation"),
        (SMALL, 1e-15, "within"),  # of a limit of rounding a tenth
        (replace(SMALL, maximum=2e-13), 1e-15, "deviation"),
        (replace(ROW, maximum=1e-9), 2e-4, "within"),  # better is not worse
    ],
)
def test_worse_than_blessed_by_more_than_noise_is_a_deviation(row: Comparison, before: float, verdict: str) -> None:
    result = baseline.judge_by_baseline(row, blessed(before, row))
    assert result.verdict == verdict
    assert result.blessed == before
    assert ("worse than blessed" in result.message) == (verdict == "deviation")


@pytest.mark.parametrize(
    ("engine", "share", "verdict"),
    [
        ("exudyn-dae", 5e-8, "within"),
        ("exudyn-dae", 2e-7, "deviation"),
        ("mujoco", 5e-8, "deviation"),  # mj_inverse iterates nothing
    ],
)
def test_another_processor_may_end_an_iteration_earlier_up_to_a_tenth_of_the_limit(
    engine: str, share: float, verdict: str
) -> None:
    row = replace(ROW, engine=engine, limit=1e-6, maximum=share)
    assert baseline.judge_by_baseline(row, blessed(4e-16, row)).verdict == verdict


def test_the_message_says_what_it_was_and_how_to_bless() -> None:
    assert baseline.judge_by_baseline(ROW, blessed(1e-5)).message == (
        "worse than blessed: 0.0002 of the range, on 2026-02-01 it was 1e-05 (noise 1e-05); mend the cause, or "
        'crosscheck bless --reason "..."'
    )


def test_a_missing_value_fails_and_says_how_to_bless(tmp_path: Path) -> None:
    result = baseline.judge_by_baseline(ROW, baseline.find(tmp_path))
    assert result.verdict == "unjudged"
    assert 'no blessed value for it yet: crosscheck bless --reason "..."' in result.message
    assert night(result).exit_code == 1


def test_what_deviates_is_skipped_or_has_no_limit_is_left_as_it_is() -> None:
    explained = replace(ROW, verdict="explained", limit=None)
    for row in (DEVIATION, SKIPPED, explained):
        assert baseline.judge_by_baseline(row, Baseline()) is row
    bars = replace(ROW, verdict="explained", maximum=2e-3, message="by discretisation: ...")
    assert baseline.judge_by_baseline(bars, blessed(1e-3, bars)).verdict == "deviation"


def test_what_is_no_longer_compared_is_missed_after_a_run_over_everything() -> None:
    known = Baseline({baseline.make_comparison_key(ROW): 1e-3, baseline.make_comparison_key(SMALL): 1e-13})
    assert baseline.apply(night(ROW), known, None).exit_code == 0
    whole = baseline.apply(night(ROW), known, Scope())
    assert whole.baseline["gone"] == ("arm swing mujoco flexinv tip m",)
    assert whole.exit_code == 1


@pytest.mark.parametrize(
    ("scope", "expected"),
    [
        (Scope(), True),
        (Scope(engines=("mujoco", "flex*")), True),
        (Scope(names=("l*", "arm/swing")), True),
        (Scope(engines=("pinocchio", "flexinv")), False),
        (Scope(engines=("mujoco", "pinocchio")), False),  # its reference is not asked
        (Scope(names=("arm/turn", "leg")), False),
        (Scope(absent=("mujoco",)), False),  # this machine has no tool for it
        (Scope(absent=("pinocchio",)), True),
    ],
)
def test_a_model_that_is_not_there_any_more_is_missed_by_all_who_ask_for_it(
    scope: Scope, expected: bool, bless: Callable[..., Result], tmp_path: Path
) -> None:
    """Its folder was moved away: whatever the command line leaves out is not missed, and blessing agrees to the loss."""
    left = replace(night(replace(ROW, mechanism="leg")), cases=(CaseRow("leg", "swing"),))
    assert bless(night(ROW)).exit_code == 0
    judged = baseline.apply(left, baseline.read(tmp_path / "baseline"), scope)
    assert list(judged.baseline["gone_keys"]) == [baseline.make_comparison_key(ROW)] * expected
    said = "arm/swing: not there any more; 1 comparison is blessed (mujoco); bring it back, or crosscheck bless"
    assert [line.startswith(said) for line in words.describe_gone(judged)] == [True] * expected
    assert f"{int(expected)} dropped" in bless(judged).output


def test_what_failed_or_cannot_be_read_says_so_itself_and_keeps_its_blessed_value() -> None:
    known = blessed(1e-3)
    unread = night(cases=(CaseRow("arm", "", problem="links = ["),))
    failed = night(runs=(RunRow("arm", "swing", "flexinv", "error", "killed"),))
    assert [baseline.list_missing_keys(one, known, Scope()) for one in (unread, failed)] == [[], []]
    assert baseline.list_missing_keys(night(), known, Scope()) == [baseline.make_comparison_key(ROW)]


def test_blessing_a_run_over_everything_drops_what_is_gone(bless: Callable[..., Result], tmp_path: Path) -> None:
    assert bless(night(ROW, SMALL)).exit_code == 0
    whole = baseline.apply(night(ROW), baseline.read(tmp_path / "baseline"), Scope())
    assert "1 dropped" in bless(whole).output
    assert list(baseline.read(tmp_path / "baseline").fractions) == [baseline.make_comparison_key(ROW)]


def test_files_are_text_in_a_fixed_order_and_come_back(tmp_path: Path) -> None:
    baseline.write(tmp_path, night(SMALL, ROW), [SMALL, ROW], "a first look")
    text = (tmp_path / "metrics.csv").read_text()
    assert text == (
        "mechanism,case,engine,reference,quantity,unit,fraction\n"
        "arm,swing,mujoco,flexinv,tip,m,3e-14\n"
        "arm,swing,mujoco,flexinv,torque,N m,0.0002\n"
    )
    other = replace(ROW, engine="exudyn", maximum=1.23456e-4)
    baseline.write(tmp_path, night(other), [other], "one more")
    back = baseline.read(tmp_path)
    assert len(back.fractions) == 3  # what was not run keeps its value
    assert back.fractions[baseline.make_comparison_key(other)] == 1.23e-4
    assert (back.reason, back.date, back.versions) == ("one more", "2026-03-01T01:00:00+00:00", {"mujoco": "4.0"})


def test_a_missing_or_damaged_baseline_says_so(tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match=r"there is no blessed night in .*crosscheck bless --reason"):
        baseline.read(tmp_path)
    baseline.write(tmp_path, night(ROW), [ROW], "x")
    (tmp_path / "metrics.csv").write_text("a,b\n1,2\n")
    with pytest.raises(BaselineError, match="other columns than mechanism, case"):
        baseline.read(tmp_path)
    (tmp_path / "metrics.csv").write_text(",".join(baseline.HEAD) + "\na,b,c,d,e,f,often\n")
    with pytest.raises(BaselineError, match="cannot be read"):
        baseline.read(tmp_path)


# ------------------------------------------------------------------------------------------------------------ command


@pytest.fixture
def bless(tmp_path: Path) -> Callable[..., Result]:
    """Bless a made night in a temporary folder."""

    def go(results: Results, *words: str) -> Result:
        (tmp_path / "run").mkdir(exist_ok=True)
        store.write(results, tmp_path / "run" / "results.json")
        where = ["--from", str(tmp_path / "run"), "--baseline", str(tmp_path / "baseline")]
        return CliRunner().invoke(main, ["bless", *where, *(words or ("--reason", "measured anew"))])

    return go


def test_bless_writes_what_is_inside_its_limit_and_lists_the_rest(bless: Callable[..., Result], tmp_path: Path) -> None:
    done = bless(night(ROW, SKIPPED))
    assert (done.exit_code, "1 comparisons blessed: 1 new" in done.output) == (0, True)
    done = bless(night(replace(ROW, maximum=3e-4), DEVIATION))
    assert done.exit_code == 1
    assert "arm swing mujoco flexinv torque N m: 0.0002 -> 0.0003" in done.output
    assert "not blessed arm/swing exudyn torque [N m]: 0.005 of the range is beyond its limit of 0.001" in done.output
    assert baseline.make_comparison_key(DEVIATION) not in baseline.read(tmp_path / "baseline").fractions
    assert json.loads((tmp_path / "baseline" / "blessed.json").read_text())["reason"] == "measured anew"


def test_a_regression_can_be_blessed_and_is_then_within(bless: Callable[..., Result], tmp_path: Path) -> None:
    assert bless(night(replace(ROW, maximum=1e-5))).exit_code == 0
    worse = baseline.apply(night(ROW), baseline.read(tmp_path / "baseline"), Scope())
    assert worse.exit_code == 1
    assert bless(worse).exit_code == 0
    assert baseline.apply(night(ROW), baseline.read(tmp_path / "baseline"), Scope()).exit_code == 0


def test_bless_refuses_a_run_that_has_not_finished_and_an_empty_reason(bless: Callable[..., Result]) -> None:
    done = bless(night(ROW, finished=False, message="interrupted"))
    assert (done.exit_code, "has not finished (interrupted)" in done.output) == (2, True)
    done = bless(night(ROW), "--reason", " ")
    assert (done.exit_code, "--reason is empty" in done.output) == (2, True)
    assert bless(night(ROW), "--reason").exit_code == 2


def test_a_file_of_somebody_else_is_no_baseline_and_stays(tmp_path: Path) -> None:
    (tmp_path / "blessed.json").write_text('{"mine": 1}')
    with pytest.raises(BaselineError, match="there is no blessed night in"):
        baseline.write(tmp_path, night(ROW), [ROW], "a reason")
    assert [(f.name, f.read_text()) for f in tmp_path.iterdir()] == [("blessed.json", '{"mine": 1}')]


@pytest.mark.parametrize("value", ["nan", "inf", "-1.0", "1.0,2.0"])
def test_a_blessed_value_that_is_none_is_one_error(tmp_path: Path, value: str) -> None:
    baseline.write(tmp_path, night(ROW), [ROW], "a reason")
    file = tmp_path / baseline.METRICS
    file.write_text(file.read_text().replace("0.0002", value))
    with pytest.raises(BaselineError, match=r"metrics\.csv, line 2"):
        baseline.find(tmp_path)


@pytest.mark.parametrize("file", ["metrics.csv", "signals.csv", "provenance.json", "blessed.json"])
def test_an_interrupt_leaves_a_baseline_whole(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """It comes while one of the files is written, and is heard when all of them are."""
    baseline.write(tmp_path, night(ROW), [ROW], "the first")
    replace_file = owned.replace

    def interrupted(path: Path, data: str | bytes) -> None:
        if path.name == file:
            os.kill(os.getpid(), signal.SIGINT)
        replace_file(path, data)

    monkeypatch.setattr(owned, "replace", interrupted)
    request.addfinalizer(partial(signal.signal, signal.SIGINT, signal.getsignal(signal.SIGINT)))
    signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever started the tests may ignore it
    worse = replace(ROW, maximum=3e-4)
    with pytest.raises(KeyboardInterrupt):
        baseline.write(tmp_path, night(worse), [worse], "the second")
    result = baseline.read(tmp_path)
    assert (result.reason, result.fractions[baseline.make_comparison_key(ROW)]) == ("the second", 3e-4)
