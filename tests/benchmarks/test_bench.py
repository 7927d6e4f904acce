"""The speed comparison: what is measured, compared and judged.  No time is tested: those are the machine's."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from crosscheck_examples import write_models

from benchmarks import (
    accuracy,
    first,
    flexible,
    latency,
    marches,
    parts,
    rigid,
    runs,
    single,
    targets,
    torque_errors,
)
from benchmarks.cores import SHARED, Cores, find_undisturbed_repetitions
from benchmarks.engines import pinocchio as pinocchio_bench
from benchmarks.timing import (
    BUSY,
    HALVES,
    LONG,
    Call,
    Spread,
    Times,
    compute_time_ratio,
    describe_disturbance,
    run_calls_in_turns,
)
from crosscheck.cli import main
from crosscheck.report.html import build_study_plot
from crosscheck.studies.robot_sweep import sample_states
from crosscheck.verdicts import history
from crosscheck.verdicts.history import list_metrics
from crosscheck.verdicts.results import StudyRow, read
from flexinv import joint_torques, load_mechanism
from flexinv.kernels.threads.affinity import count_processors

MODELS = Path(__file__).resolve().parents[2] / "models"
SHORT = 0.01  # [s] of timing: the least number of turns
TINY = {"robots": ["ur5"], "samples": [100, 1000], "seconds": SHORT}


def times(wall: list[float], clean: bool, threads: int = 1) -> Times:
    return Times(np.array(wall), np.array(wall) / 2, np.full(len(wall), clean), np.full(len(wall), True), threads)


def test_repetitions_that_were_interrupted_do_not_count() -> None:
    long, short = np.full(10, 4.0), np.full(10, 2.0)
    long[:5] = 100.0  # interrupted
    clean = np.arange(10) >= 5
    all_of_them = np.full(10, True)
    slow, fast = Times(long, long, clean, all_of_them), Times(short, short, all_of_them, all_of_them)
    assert slow.compute_quartiles().median == 4.0
    assert compute_time_ratio(slow, fast).median == 2.0
    assert compute_time_ratio(replace(slow, clean=all_of_them), fast).median > 2.0


def test_on_a_busy_machine_the_processors_time_counts_and_several_threads_are_not_judged() -> None:
    assert times([3.0] * 9, clean=False).compute_quartiles().median == 1.5  # the processor's
    assert times([3.0] * 9, clean=True).compute_quartiles().median == 3.0
    assert describe_disturbance(times([3.0] * 9, clean=False, threads=2)) == BUSY
    assert not describe_disturbance(times([3.0] * 9, clean=True, threads=2), times([3.0] * 9, clean=False))


def test_threads_that_interrupt_each_other_are_judged_where_others_hardly_use_the_machine() -> None:
    mine = replace(times([3.0] * 9, clean=False, threads=2), others=0.01)
    assert not describe_disturbance(mine)
    assert mine.compute_quartiles().median == 3.0
    assert compute_time_ratio(times([6.0] * 9, clean=True), mine).median == 2.0
    assert describe_disturbance(replace(mine, others=0.5)) == BUSY


def test_repetitions_on_halves_of_cores_do_not_count() -> None:
    """Whichever code suffers from it: only turns in which both had whole cores are compared, and too few are not judged."""
    slow, fast = times([10.0] * 20, clean=True, threads=2), times([1.0] * 12 + [2.0] * 8, clean=True, threads=2)
    halves = np.arange(20) >= 12
    assert compute_time_ratio(slow, fast).low == 5.0
    fast = replace(fast, whole=~halves)
    assert (compute_time_ratio(slow, fast).low, fast.compute_quartiles().high) == (10.0, 1.0)
    assert not describe_disturbance(slow, fast)
    assert describe_disturbance(slow, replace(fast, whole=np.arange(20) < 3)) == HALVES
    assert not describe_disturbance(replace(slow, threads=1), replace(fast, whole=np.arange(20) < 3, threads=1))
    slow = replace(slow, whole=halves)  # each on whole cores now and then, never both in turn
    assert compute_time_ratio(slow, fast) == Spread(10.0, 10.0, 10.0)


def test_a_core_is_whole_where_a_loop_takes_hardly_longer_than_ever() -> None:
    with Cores() as cores:
        result = [cores.run_loop(threads) for threads in (1, 2, 1)]
    assert 0.0 < Cores.least <= min(result[0], result[2])
    assert max(result) < np.inf
    loops = Cores.least * np.array([[1.0, 1.0], [1.0, SHARED + 0.1], [SHARED + 0.1, 1.0], [np.inf, 1.0]])
    assert find_undisturbed_repetitions(loops).tolist() == [True, False, False, False]


def test_a_long_look_sees_episodes_and_what_is_next_to_the_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """One loop in the middle that is interrupted says nothing; five of forty, the first or the last do."""
    for slow, seen in ((range(20, 21), 1.0), (range(20, 25), 1.5), (range(1), 1.5), (range(39, 40), 1.5)):
        taken = iter([1.5 if k in slow else 1.0 for k in range(40)])
        monkeypatch.setattr(Cores, "run_loop", lambda self, threads, taken=taken: next(taken))
        assert Cores().compute_loop_time(2, 40) == seen


def test_a_long_call_that_takes_more_of_the_processor_than_before_had_no_whole_cores() -> None:
    """Whatever was seen before and after it.  A short one is not judged by this: its first runs may fill caches."""
    turn = itertools.count()

    def work() -> None:
        end = time.process_time() + LONG * (1.5 + 0.5 * (next(turn) % 2))
        while time.process_time() < end:
            pass

    result = run_calls_in_turns({"long": Call(work)}, SHORT)["long"]
    assert not result.whole[result.processor > 1.2 * result.processor.min()].any()
    assert (result.processor > 1.2 * result.processor.min()).sum() >= 2


def test_calls_take_turns() -> None:
    order: list[str] = []
    result = run_calls_in_turns({name: Call(lambda name=name: order.append(name)) for name in "ab"}, SHORT)  # type: ignore[misc]
    turns = [name for k, name in enumerate(order) if k == 0 or order[k - 1] != name]
    assert turns[-8:] == list("abababab")
    assert len(result["a"].wall) == len(result["b"].wall) >= 5


def test_a_turn_begins_with_a_run_that_is_not_timed() -> None:
    """As slow as a call that finds cold caches; a long call is timed from its first run in a turn on."""
    fresh = {"short": True, "long": True}

    def run(name: str, slow: float, usual: float) -> None:
        time.sleep(slow if fresh[name] else usual)
        fresh.update(dict.fromkeys(fresh, True))
        fresh[name] = False

    calls = {
        "short": Call(lambda: run("short", 40e-3, 1e-3)),
        "long": Call(lambda: run("long", 2 * LONG, 2 * LONG)),
    }
    result = run_calls_in_turns(calls, SHORT)
    assert (
        np.median(result["short"].wall) < 20e-3
    )  # 1 ms and what a busy system adds, not the 40 ms of a turn's first run
    assert np.median(result["long"].wall) > LONG


def test_a_call_that_fills_its_caches_first_is_not_long() -> None:
    """Its turns begin with runs that are not timed, like those of every short call."""
    runs = itertools.count()
    result = run_calls_in_turns({"filling": Call(lambda: time.sleep(2 * LONG if next(runs) == 0 else 1e-3))}, SHORT)[
        "filling"
    ]
    assert next(runs) > 2 * len(result.wall)


def test_a_ratio_beyond_its_limit_is_a_deviation() -> None:
    def verdict(**limits: float) -> str:
        return str(targets.add_verdict({"metric": targets.make_metric("x", 3.0, "-", **limits)})["verdict"])

    assert (verdict(lower=2.0), verdict(lower=4.0)) == ("within", "deviation")
    assert (verdict(upper=4.0), verdict(upper=2.0)) == ("within", "deviation")
    assert verdict() == "within"


def test_without_avx512_half_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "find_vector_width", lambda: "avx512")
    assert [rigid.find_required_ratio(n, "coordinates") for n in (100, 1000, 4096, 32768)] == [None, 10.0, 15.0, 20.0]
    monkeypatch.setattr(targets, "find_vector_width", lambda: "avx2")
    assert rigid.find_required_ratio(32768, "samples") == 7.5
    assert "Without AVX-512, as here" in targets.describe_measurement()


def test_torques_are_compared_before_they_are_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    ur5 = load_mechanism(MODELS / "ur5")
    rows = rigid.list_robot_rows("ur5", ur5, 100, SHORT)
    assert {"flexinv by coordinate", "flexinv by sample", "rneaInParallel", "pin.rnea in a loop"} <= {
        row["method"] for row in rows
    }
    assert all(row["difference"] <= rigid.LARGEST_ERROR and row["time"] > 0.0 for row in rows)
    right = pinocchio_bench.prepare_loop

    def wrong(*given: Any) -> Any:
        run, said = right(*given)
        return run, lambda answer: said(answer) * (1.0 + 1e-9)

    monkeypatch.setattr(pinocchio_bench, "prepare_loop", wrong)
    rows = rigid.list_robot_rows("ur5", ur5, 100, SHORT)
    assert [(row["method"], row["verdict"], "time" in row) for row in rows] == [
        ("pin.rnea in a loop", "deviation", False)
    ]


def test_chains_are_the_same_in_both_engines() -> None:
    mechanism = single.build_rod_chain(5)
    state = sample_states(mechanism, 7, np.random.default_rng(1))
    run, said = pinocchio_bench.prepare_parallel(mechanism, *state, 1)
    torques = joint_torques(mechanism, *state)
    assert np.abs(said(run()) - torques).max() < rigid.LARGEST_ERROR * np.abs(torques).max()
    rows = single.run_chain_study(joints=[1, 3], seconds=SHORT)["rows"]
    assert [row["joints"] for row in rows] == [1, 1, 3, 3]


@pytest.mark.slow
@pytest.mark.parametrize("arm", [flexible.ARMS[0], flexible.ARMS[2]], ids=["plane", "space"])
def test_flexible_arms_have_error_beside_time(arm: flexible.FlexibleCase) -> None:
    # A twentieth of a second and a mesh of each kind: small, but the reference still has to be one.
    small = replace(arm, end=0.05, reference=(1, 2.5e-4), finest=(16, 2.5e-4))
    grid = flexible.Grid(exudyn=(4,), linear=(4,), spectral=(1,), steps=(1e-3,), finer=(2.5e-4,))
    head, *rows = flexible.list_arm_rows(small, MODELS, grid, SHORT)
    assert head["verdict"] == "within"
    assert {row["method"].split(",")[0] for row in rows} == {"flexinv", "Exudyn"}
    assert all(row["error"] > 0.0 and row["time"] > 0.0 for row in rows)
    theirs = next(row for row in rows if row["method"].startswith("Exudyn"))
    assert theirs["faster"] > 0.0
    assert theirs["metric"]["lower"] == arm.target
    (alone,) = flexible.list_arm_rows(replace(small, agreement=1e-12), MODELS, grid, SHORT)
    assert alone["verdict"] == "deviation"
    assert "no reference" in alone["by"]


@pytest.mark.skipif(count_processors() < 2, reason="rows of two threads need two processors")
def test_what_could_not_be_measured_stands_on_top_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is neither reached nor missed: no ratio is shown, and none goes into the history."""
    monkeypatch.setattr(rigid, "describe_disturbance", lambda *times: HALVES if times[0].threads > 1 else "")
    rows = rigid.list_robot_rows("ur5", load_mechanism(MODELS / "ur5"), 1000, SHORT)
    spoilt = [row for row in rows if row["threads"] > 1]
    assert spoilt
    assert all("faster" not in row and row["message"] == HALVES for row in spoilt)
    table = StudyRow("bench rigid", "", columns=rigid.COLUMNS, rows=tuple(rows))
    assert not any("2 threads" in one.name for one in list_metrics([table]))
    left = [row for row in targets.make_target_table([table]).rows if row["what"].endswith("2 threads")]
    assert [(row["verdict"], row["spread"]) for row in left] == 2 * [("skipped", HALVES)]
    known = [row["verdict"] == "deviation" or "value" not in row for row in targets.make_target_table([table]).rows]
    assert known == sorted(known, reverse=True)


@pytest.mark.slow
def test_marches_loops_and_threads_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(marches, "RIGID_LOOPS", ("four_bar", "five_bar"))
    monkeypatch.setattr(marches, "LOOP_SAMPLES", 256)
    monkeypatch.setattr(marches, "SCENARIOS", {"spatial_arm": 2, "flex_one_link": 2})
    rows = marches.run_loop_study(str(MODELS), SHORT)["rows"]
    assert {row["what"].split(",")[0] for row in rows} >= {"four-bar with a flexible coupler", "five-bar", "solve_many"}
    table = StudyRow("bench others", "", columns=marches.OTHER_COLUMNS, rows=tuple(rows))
    assert {m.upper for m in list_metrics([table])} >= {marches.LOOP_MARCH, marches.LOOP_RIGID}
    rows = marches.run_element_study(str(MODELS), {"1": [2, 4]}, SHORT)["rows"]
    assert [row["elements"] for row in rows] == [2, 4, 2, 4]
    # a number, of any sign: on a busy machine two elements may take as long as four
    assert all(np.isfinite(row["exponent"]) for row in rows if row["elements"] == 4)


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "PARTS", {"rigid": replace(parts.PARTS["rigid"], quick=TINY)})


@pytest.mark.slow
def test_the_command_leaves_a_page_and_ratios(tiny: None, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.sqlite'}"
    where = ["--models", str(MODELS), "--out", str(tmp_path / "out"), "--history", url]
    done = CliRunner().invoke(main, ["bench", "rigid", "--quick", *where])
    assert done.exit_code in (0, 1), done.output  # 1: a ratio that this machine, busy with tests, does not reach
    results = read(tmp_path / "out" / "results.json")
    assert [table.name for table in results.studies] == ["bench", "bench rigid"]
    page = (tmp_path / "out" / "studies" / "bench.html").read_text()
    assert targets.find_vector_width() in page
    assert "ur5: times as fast as rneaInParallel, 1000 samples by coordinate, 1 thread" in page
    database = history.open_database(url)
    (night,) = history.list_nights(database, "bench")
    rows = {row["name"]: row for row in history.read_rows(database, history.METRIC, night.id)}
    assert rows["ur5: times as fast as rneaInParallel, 1000 samples by sample, 1 thread"]["lower"] in (10.0, 5.0)
    plot = results.studies[1].plot
    assert plot is not None
    assert build_study_plot(results.studies[1], plot)["log"]


def test_a_part_that_there_is_not_is_named() -> None:
    done = CliRunner().invoke(main, ["bench", "rigit"])
    assert done.exit_code == 2
    known = ", ".join(parts.PARTS)
    assert "loops, one-link" in known
    assert f"no part is called 'rigit'; known: {known}" in done.output


@pytest.mark.slow
def test_a_night_may_measure_speed_at_its_end(tiny: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    write_models(tmp_path / "models", MODELS.parent)
    quick = parts.list_studies(MODELS, quick=True)
    monkeypatch.setattr("crosscheck.commands.nightly._list_speed_studies", lambda models: quick)
    where = ["--models", str(tmp_path / "models"), "--reports", str(tmp_path / "reports"), "--jobs", "1"]
    CliRunner().invoke(main, ["nightly", *where, "--engines", "flexinv,pinocchio", "--studies", "", "--bench"])
    database = history.open_database(f"sqlite:///{tmp_path / 'reports' / 'history.sqlite'}")
    (night,) = history.list_nights(database)
    assert {row["unit"] for row in history.read_rows(database, history.METRIC, night.id)} == {"-"}
    results = read(tmp_path / "reports" / "latest" / "results.json")
    assert {table.name for table in results.studies} == {"bench", "bench rigid"}
    assert "times as fast as rneaInParallel" in (tmp_path / "reports" / "latest" / "trends" / "index.html").read_text()


@pytest.mark.slow
def test_a_run_that_nothing_has_changed_for_takes_less(root: Path, tmp_path: Path) -> None:
    write_models(tmp_path / "models", root, "pendulum")
    asked = {"whole": False, "engines": ("flexinv", "pinocchio")}
    first, again = runs.run_study(str(tmp_path / "models"), names=("pendulum",), **asked)["rows"]
    assert (first["when"], again["when"]) == ("nothing kept", "unchanged")
    assert {first["verdict"], again["verdict"]} == {"within"}
    assert 0.0 < again["processor"] < first["processor"]
    (wrong, _) = runs.run_study(str(tmp_path / "models"), whole=False, names=("nobody",))["rows"]
    assert wrong["verdict"] == "error"
    assert "nothing to run is called 'nobody'" in wrong["message"]


def test_latencies_of_a_controller_are_a_histogram() -> None:
    table = latency.run_study(str(MODELS), arms=["panda", "flex_two_link"], steps=60)
    for name, asked in (("panda", 5.0), ("flex_two_link", 200.0)):
        rows = [row for row in table["rows"] if row["what"] == name]
        assert sum(row["steps"] for row in rows) == 60
        assert [row["latency"] for row in rows] == sorted(row["latency"] for row in rows)
        assert rows[-1]["slower"] == 0.0
        assert rows[0]["metric"]["upper"] == asked
        assert "of 60 steps" in rows[0]["note"]
        assert 0.0 < rows[0]["metric"]["value"] <= rows[-1]["latency"]


def test_a_slow_controller_is_a_deviation() -> None:
    rows = latency._list_histogram_rows("slow", 200.0, np.array([150.0, 250.0, 260.0, 2e4]))
    assert rows[0]["verdict"] == "deviation"
    assert "2 beyond" not in rows[0]["note"]
    assert "1 beyond 1 ms, 1 beyond 10 ms of 4 steps" in rows[0]["note"]
    assert rows[0]["slower"] == 75.0


@pytest.mark.slow
def test_first_torques_cold_and_warm() -> None:
    """A cold start compiles, a warm one reads: kernels of a rigid arm take seconds of the processor, reading them does not."""
    rows = first.run_study(str(MODELS), ["rigid_3r"])["rows"]
    cold, warm, imported = rows
    assert (cold["start"], warm["start"]) == ("cold", "warm")
    assert cold["processor"] > 1.5 * warm["processor"]
    assert imported["what"] == "import flexinv"
    assert 0 < imported["clock"] < warm["clock"]


@pytest.mark.slow
def test_every_way_to_a_torque_error_reaches_it() -> None:
    head, *rows = accuracy.run_study(str(MODELS), ["flex_one_link"], [1e-3], SHORT)["rows"]
    assert head["error"] < 1e-3 / 20
    assert [row["method"] for row in rows] == ["plain", "one extrapolation", "two extrapolations", "accuracy="]
    assert all(0.0 < row["error"] <= 1e-3 for row in rows)
    assert rows[1]["steps"] < rows[0]["steps"]  # order 4 beside order 2
    assert "faster" not in rows[0]


def test_a_reference_that_is_not_known_well_enough_judges_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accuracy, "compute_reference", lambda problem, least: (np.ones((2, 1)), least))
    (row,) = accuracy.run_study(str(MODELS), ["flex_one_link"], [1e-3], SHORT)["rows"]
    assert row["verdict"] == "deviation"
    assert row["message"] == "no reference: it is known to 0.001 of the peak only"


@pytest.mark.slow
def test_torque_errors_stand_beside_the_fastest_run_of_exudyn_that_reaches_them() -> None:
    arm = torque_errors.ARMS[0]
    head, *rows = torque_errors.list_arm_rows(arm, MODELS, (1e-2,), SHORT, longest=0.05)
    assert head["verdict"] == "within"
    assert [row["method"] for row in rows] == ["flexinv", "Exudyn"]
    assert all(0.0 < row["error"] <= row["asked_error"] for row in rows)
    assert all(row["faster"] > 1.0 and row["metric"]["lower"] is None for row in rows[1::2])  # asked at 1e-6 alone


@pytest.mark.slow
def test_an_error_that_no_run_reaches_is_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torque_errors, "MESHES", torque_errors.MESHES[:1])
    *_, row = torque_errors.list_arm_rows(torque_errors.ARMS[0], MODELS, (1e-3,), SHORT, longest=0.002)
    assert row["method"] == "Exudyn, not reached"
    assert row["error"] > 1e-3
    assert row["metric"]["name"].endswith("times as fast as Exudyn, at least")


def test_steps_that_are_all_equal_meet_the_breaks_of_a_motion() -> None:
    mechanism, case = torque_errors.prepare_arm_case(torque_errors.ARMS[2], MODELS)  # a move of 1 s, 0.5 s at rest
    problem = torque_errors.solve_problem(mechanism, case.motion, 1e-3, torque_errors.Settings(), {})
    assert len(problem.grid.counts) == 2  # steps of two lengths
    even = torque_errors.make_equal_steps(problem).grid
    assert even.counts == (42,)
    assert np.abs(even.list_steps(1) - 1.0).min() < 1e-12
