"""Days: each has friction and offsets of its own, widths are told by several, and a payload is the difference of two logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import logged_arm
import numpy as np
import pytest
from click.testing import CliRunner

from crosscheck.cli import Main
from crosscheck.identification.bands import Prediction, compute_margins, predict
from crosscheck.identification.causes.rounds import CauseSearch
from crosscheck.identification.estimation.days import (
    DRY,
    GAIN,
    OFFSET,
    VISCOUS,
    DayFits,
    compute_day_deviations,
    compute_expected_widths,
    describe_days,
    find_day,
    find_day_widths,
    fit_days,
)
from crosscheck.identification.estimation.fit import STEP, Fit, Problem, compute_jacobian
from crosscheck.identification.identify import identify, read_machine
from crosscheck.identification.logs.log import Log, read_log
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import Run, make_run
from crosscheck.identification.settings import FreeTable, IdentifyTable, read_settings
from crosscheck.identification.table import list_day_rows, list_parameter_rows
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.typing import Array

EMPTY = np.zeros(0)
MORE = 1.2  # times the friction, on the second day


def read_arm(folder: Path, between_runs: float = 0.15) -> Machine:
    """The true arm, of which friction and offsets alone are free: fits of it take a tenth of a second."""
    base = logged_arm.write_arm(folder / "arm", logged_arm.TRUTH)
    known = read_settings(base, load_mechanism(base))
    free = known.free[1:]
    return read_machine(load_mechanism(base), known.model_copy(update={"free": free, "between_runs": between_runs}))


def make_log(folder: Path, seed: int, times: float = 1.0) -> Log:
    """A log of the true arm with so many times the friction."""
    table = logged_arm.frame(folder, seed, seconds=4.0)
    for k, law in ((1, (4.0, 2.0)), (2, (1.0, 1.0))):
        rate = np.gradient(table[f"q{k}"], 0.004)
        table[f"t{k}"] += (times - 1.0) * (law[0] * rate + law[1] * np.tanh(rate / 0.02))
    return Log(f"log {seed}", table["time_s"].to_numpy(), {n: table[n].to_numpy() for n in ("q1", "q2", "t1", "t2")})


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Log]:
    base = tmp_path_factory.mktemp("logs")
    return [make_log(base, 0), make_log(base, 1, MORE), make_log(base, 2, MORE)]


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return read_arm(tmp_path_factory.mktemp("known"))


def fit_logs(machine: Machine, logs: list[Log], days: list[str]) -> tuple[Problem, DayFits]:
    return fit_days(machine, [make_run(machine, log) for log in logs], days, "files")


@pytest.fixture(scope="module")
def both(machine: Machine, logs: list[Log]) -> tuple[Problem, DayFits]:
    return fit_logs(machine, logs[:2], ["monday", "friday"])


def build_widths_problem(machine: Machine, count: int) -> tuple[Problem, Array]:
    """A problem of so many days without a log, and the deviations (parameters,) of z that are expected."""
    expected = compute_expected_widths(machine)
    unit = compute_day_deviations(machine, np.zeros(len(machine.space.parameters)), expected)
    moved = tuple(np.flatnonzero(unit).tolist())
    return Problem(machine, (), (), (), tuple(range(count)), moved), unit


def make_fit(task: Problem, unit: Array, told: float, true: Array) -> Fit:
    """The fit of days whose own parameters z_d, true (days, parameters), are told to 1 / told^0.5."""
    maps = [task.build_day_map(day) for day in set(task.days)]
    own = np.tile(unit[list(task.moved)], len(maps)) ** -2.0
    held = np.diag(np.concatenate([np.ones(task.size - len(own)), own]))
    covariance = np.linalg.inv(held + told * sum(t.T @ t for t in maps))
    z = covariance @ (told * sum(t.T @ one for t, one in zip(maps, true, strict=True)))
    return Fit(z, covariance, EMPTY, EMPTY, 1.0, EMPTY, (), ())


def test_logs_that_tell_nothing_leave_the_widths_that_were_expected(machine: Machine) -> None:
    """To 1 %, as the squares are sums over ten widths."""
    task, unit = build_widths_problem(machine, 2)
    expected = compute_expected_widths(machine)
    widths = find_day_widths(task, make_fit(task, unit, 0.0, np.zeros((2, len(unit)))), unit, expected)
    assert widths == pytest.approx(expected, rel=0.01)


def test_many_days_tell_how_far_they_lie_apart(machine: Machine) -> None:
    """24 deviations of each class tell their width to 15 %; 2.4 errors and the prior's pull are 40 %."""
    task, unit = build_widths_problem(machine, 12)
    expected = compute_expected_widths(machine)
    for times in (0.4, 2.0):
        drawn = times * unit * np.random.default_rng(4).normal(size=(12, len(unit)))
        widths = find_day_widths(task, make_fit(task, unit, 1e6, drawn), unit, expected)
        for kind in (VISCOUS, DRY, OFFSET):
            assert widths[kind] == pytest.approx(times * expected[kind], rel=0.4)


def test_what_a_day_adds_has_the_slopes_of_its_runs(both: tuple[Problem, DayFits]) -> None:
    """Against difference quotients of the same step: the order of sums alone differs."""
    task, _ = both
    z = np.linspace(-0.2, 0.3, task.size)
    slopes = compute_jacobian(task, z)
    for k in range(len(task.machine.space.parameters), task.size):
        ahead, level = (
            task.collect_counted_samples(task.predict(z + side * np.eye(task.size)[k])) for side in (STEP, 0.0)
        )
        for slope, a, b in zip(slopes, ahead, level, strict=True):
            assert slope[:, k] == pytest.approx((a - b) / STEP, abs=1e-8)


def test_each_day_has_its_own_friction_and_the_machine_holds_both(
    machine: Machine, both: tuple[Problem, DayFits]
) -> None:
    """Friction of the second day is a fifth more; intervals of 90 %, widened by a half, for eight of them are asked at once."""
    _, days = both
    rows = list_day_rows(machine, days, list_parameter_rows(machine.space, days.machine))
    for kind, place, truth in (
        (VISCOUS, "shoulder", 4.0),
        (VISCOUS, "elbow", 1.0),
        (DRY, "shoulder", 2.0),
        (DRY, "elbow", 1.0),
    ):
        own = {row.day: row for row in rows if (row.parameter, row.place) == (kind, place)}
        for name, times in (("log 0", 1.0), ("log 1", MORE)):
            row = own[name]
            assert abs(row.value - times * truth) < 1.5 * (row.high - row.low) / 2.0
        assert own["log 0"].high < own["log 1"].low
        assert own[""].low < own["log 0"].value < own["log 1"].value < own[""].high


def test_logs_of_one_day_share_their_friction(machine: Machine, logs: list[Log], both: tuple[Problem, DayFits]) -> None:
    """What two days tell apart is between them where somebody says that they are one: nothing moves, and much is left."""
    task, days = fit_logs(machine, logs[:2], ["monday", "monday"])
    assert task.moved == ()
    assert len(days.own) == 1
    assert 4.0 < machine.space.compute_values(days.own[0].z)[VISCOUS, "shoulder"] < MORE * 4.0
    assert (days.own[0].spread > 3.0 * both[1].own[0].spread).all()


def cover(told: Prediction, run: Run) -> float:
    """Part of the samples that count inside the bands [-]."""
    assert run.measured is not None
    inside = (run.measured >= told.low) & (run.measured <= told.high)
    return float(inside[run.counted].mean())


def test_bands_of_another_day_hold_what_friction_changes(machine: Machine, logs: list[Log]) -> None:
    """A fifth is one standard deviation of dry friction between two days; bands of the same day hold few samples."""
    task, days = fit_logs(machine, logs[:1], ["monday"])
    margin = compute_margins(task, days.own[0])
    run = make_run(machine, logs[1])
    same, other = (predict(machine, days.choose_fit(day), margin, run) for day in ("monday", "friday"))
    assert cover(other, run) > 0.9
    assert cover(same, run) < 0.5
    assert np.array_equal(same.value, other.value)
    assert not same.day.any()


def test_two_days_that_agree_narrow_the_bands_of_a_third(machine: Machine, logs: list[Log]) -> None:
    """Friction of both is the same; that of a third is expected to be, too, and twice as near as after one of them."""
    run = make_run(machine, logs[0])
    widths = []
    for days in (["monday"], ["monday", "friday"]):
        task, found = fit_logs(machine, logs[1 : 1 + len(days)], days)
        told = predict(machine, found.choose_fit("sunday"), compute_margins(task, found.own[0]), run)
        widths.append(float(np.mean(told.high - told.low)))
    assert widths[1] < 0.5 * widths[0]


def test_where_every_day_is_the_same_nothing_is_added(tmp_path: Path, logs: list[Log]) -> None:
    steady = read_arm(tmp_path, 0.0)
    task, days = fit_logs(steady, logs[:2], ["monday", "friday"])
    assert task.moved == ()
    assert days.machine.scatter == {}
    assert not compute_day_deviations(steady, days.own[0].z, days.machine.scatter).any()


def test_causes_leave_friction_as_free_as_days_are(machine: Machine, logs: list[Log]) -> None:
    """Beside a log of another day viscous friction is known to 2^0.5 20 %, beside one of the same day as the fit has it."""
    _, days = fit_logs(machine, logs[:1], ["monday"])
    spread = {}
    for day in ("monday", "friday"):
        search = CauseSearch(machine, days.choose_fit(day), np.zeros((0, 2), dtype=bool), False)
        spread[day] = (
            np.sqrt(np.diag(np.linalg.inv(search.root.T @ search.root)))[0] * machine.space.parameters[0].error
        )
    assert machine.space.parameters[0].kind == VISCOUS
    assert spread["friday"] == pytest.approx(2.0**0.5 * 0.2, rel=0.01)
    assert spread["monday"] < 0.01


HIGHER = 1.03  # times the efforts, on the second day


@pytest.fixture(scope="module")
def gained(machine: Machine) -> Machine:
    """The same arm with gains of its efforts that are known to 5 %."""
    free = FreeTable(parameter=GAIN, relative=0.05)
    more = machine.settings.model_copy(update={"free": [*machine.settings.free, free]})
    return read_machine(machine.mechanism, more)


@pytest.fixture(scope="module")
def gained_logs(logs: list[Log]) -> list[Log]:
    """Two days with efforts of 1 and `HIGHER`."""
    columns = logs[0].columns
    efforts = {name: HIGHER * columns[name] for name in ("t1", "t2")}
    return [logs[0], Log("higher", logs[0].time, columns | efforts)]


def test_gains_differ_from_day_to_day_where_they_are_free(machine: Machine, gained: Machine) -> None:
    assert GAIN not in compute_expected_widths(machine)
    assert compute_expected_widths(gained)[GAIN] == pytest.approx(0.02)
    deviations = compute_day_deviations(gained, np.zeros(len(gained.space.parameters)), compute_expected_widths(gained))
    assert deviations[[one.kind == GAIN for one in gained.space.parameters]] == pytest.approx([0.4, 0.4])


def test_each_day_has_its_own_gain(gained: Machine, gained_logs: list[Log]) -> None:
    """Masses are known, so that the load tells the gains: 90 % intervals, widened by a half, for four are asked at once."""
    _, days = fit_logs(gained, gained_logs, ["monday", "friday"])
    rows = list_day_rows(gained, days, list_parameter_rows(gained.space, days.machine))
    for place in ("shoulder", "elbow"):
        own = {row.day: row for row in rows if (row.parameter, row.place) == (GAIN, place)}
        for day, truth in (("log 0", 1.0), ("higher", HIGHER)):
            assert abs(own[day].value - truth) < 1.5 * (own[day].high - own[day].low) / 2.0
        assert own["log 0"].high < own["higher"].low
    said = describe_days(days)
    assert "each with friction, offsets and gains of its own" in said
    assert "% of the gains of efforts, " in said


def test_bands_of_another_day_hold_what_its_gain_changes(gained: Machine, gained_logs: list[Log]) -> None:
    """The loads of the second day are one standard deviation of gains between two days more; bands of one day hold few."""
    task, days = fit_logs(gained, gained_logs[:1], ["monday"])
    margin = compute_margins(task, days.own[0])
    run = make_run(gained, gained_logs[1])
    same, other = (predict(gained, days.choose_fit(day), margin, run) for day in ("monday", "friday"))
    assert cover(other, run) > 0.9
    assert cover(same, run) < 0.5
    still = replace(days.machine, scatter={**days.machine.scatter, GAIN: 0.0})
    narrow = predict(gained, still, margin, run)
    width = 2.0**0.5 * 0.02 * np.abs(other.value)
    assert np.hypot(narrow.day, width) == pytest.approx(other.day)


def test_the_rule_says_which_logs_are_of_one_day(tmp_path: Path) -> None:
    file = tmp_path / "long.csv"
    logged_arm.frame(tmp_path, seconds=2.0).to_csv(file, index=False)
    early, late = (read_log(f"{file}@{part}") for part in ("0:1", "1:2"))
    assert find_day(early, "files") == find_day(late, "files")
    assert find_day(early, "logs") != find_day(late, "logs")
    assert find_day(early, "one") == find_day(Log("other", EMPTY, {}), "one")
    assert find_day(Log("other", EMPTY, {}), "files") == "other"
    with pytest.raises(InputError, match="days: 'weeks', expected one of files, logs, one"):
        identify(tmp_path, [file], days="weeks")  # type: ignore[arg-type]


LOAD, ARM, SIZE = 0.8, np.array([0.3, 0.0, 0.05]), 1.33e-3  # [kg], [m], [kg m^2] of a cube of 0.1 m


def add_load(log: Log, folder: Path) -> Log:
    """The log of the arm with a cube on its forearm."""
    from flexinv.model.links import Body, Inertia
    from flexinv.rigid.joint_torques import joint_torques

    truth = load_mechanism(logged_arm.write_arm(folder / "truth", logged_arm.TRUTH))
    load = Body("load", Inertia(LOAD, ARM, SIZE * np.eye(3)))
    links = tuple(replace(k, bodies=(*k.bodies, load)) if k.name == "fore" else k for k in truth.links)
    angle = np.column_stack([log.columns["q1"], log.columns["q2"]])
    rate, acceleration = (
        np.gradient(angle, 0.004, axis=0),
        np.gradient(np.gradient(angle, 0.004, axis=0), 0.004, axis=0),
    )
    more = joint_torques(replace(truth, links=links), angle, rate, acceleration) - joint_torques(
        truth, angle, rate, acceleration
    )
    columns = log.columns | {"t1": log.columns["t1"] + more[:, 0], "t2": log.columns["t2"] + more[:, 1]}
    return Log(f"{log.name} with it", log.time, columns)


def test_a_payload_is_the_difference_of_two_logs(machine: Machine, logs: list[Log], tmp_path: Path) -> None:
    """Mass and centre in the plane of motion; three intervals of 90 %, widened by a half, hold the truth together."""
    settings: IdentifyTable = machine.settings
    loaded = add_load(logs[1], tmp_path)
    found = identify(machine.mechanism, [logs[0]], settings=settings, payloads={"fore": loaded})
    rows = {row.parameter: row for row in found.parameters if row.place == "payload of fore"}
    for name, truth in (("mass", LOAD), ("com x", ARM[0]), ("com z", ARM[2])):
        row = rows[name]
        assert row.identifiable
        assert abs(row.value - truth) < 1.5 * (row.high - row.low) / 2.0
    assert not rows["com y"].identifiable
    blind = identify(machine.mechanism, [logs[0]], [loaded], settings=settings, days="one")
    assert min(row.explained for row in found.seen) > 0.9999 > max(row.explained for row in blind.judged)


def test_a_payload_on_no_link_says_which_there_are(machine: Machine, logs: list[Log]) -> None:
    with pytest.raises(
        InputError, match=r"a payload on 'fora', expected a rigid link with mass: upper, fore; write --payload fore=LOG"
    ):
        identify(machine.mechanism, logs[:1], settings=machine.settings, payloads={"fora": logs[1]})


@pytest.mark.parametrize("given", ["loaded.csv", "=loaded.csv", "fore="])
def test_a_payload_without_link_or_log_is_refused(tmp_path: Path, given: str) -> None:
    base = logged_arm.write_arm(tmp_path / "arm")
    logged_arm.frame(base, seconds=2.0).to_csv(base / "one.csv", index=False)
    done = CliRunner().invoke(
        Main(),
        [
            "identify",
            "arm",
            "--models",
            str(tmp_path),
            "--log",
            "one.csv",
            "--payload",
            given,
            "--out",
            str(tmp_path / "o"),
        ],
    )
    assert done.exit_code == 2
    assert "expected LINK=LOG, once for a link; write --payload forearm=loaded.csv" in done.output
