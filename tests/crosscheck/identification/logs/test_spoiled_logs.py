"""Logs that are broken, jump, wrap, have swapped columns or uneven times: an error, or words with column and time."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.interpolate import CubicSpline

import crosscheck
from crosscheck.cli import Main
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import read_log
from crosscheck.identification.readings import make_run
from flexinv.errors import InputError


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("models") / "arm"
    logged_arm.write_arm(base)
    for seed, name in enumerate(("one", "two")):
        logged_arm.frame(base, seed).to_csv(base / f"{name}.csv", index=False)
    return base


def spoiled(folder: Path, tmp_path: Path, change: str) -> Path:
    table = pd.read_csv(folder / "one.csv")
    if change == "missing":
        table = table.drop(columns=["t1"])
    elif change == "backwards":
        table.loc[500, "time_s"] = 0.0
    elif change == "jump":
        table.loc[500:, "time_s"] += 1.0
    elif change == "nan":
        table.loc[500, "q1"] = np.nan
    elif change == "constant":
        table["t1"] = 1.0
    elif change == "still":
        table["q1"] = 0.5
    elif change == "degrees":
        table["q1"] = np.degrees(table["q1"])
    elif change == "slow":
        table = table[::20]
    elif change in ("empty", "far", "beyond"):
        table["t1"] = table["t1"].where(table.index < 500, {"empty": np.nan, "far": 1e200, "beyond": 1e308}[change])
    elif change == "word":
        table["t1"] = table["t1"].map(str).where(table.index != 500, "n/v")
    elif change == "turn":
        table["q1"] -= 2.0 * np.pi * (table["q1"] > table["q1"].median())
    elif change == "range":
        table["q1"] -= 4.096 * (table["q1"] > table["q1"].median())
    elif change == "words":
        table["time_s"] = table["time_s"].map("{:.3f} s".format)
    table.to_csv(tmp_path / "bad.csv", index=False)
    return tmp_path / "bad.csv"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("missing", "no column 't1'"),
        ("backwards", "times run backwards"),
        ("jump", "times jump"),
        ("nan", "has no number at 2 s"),
        ("constant", "is constant"),
        ("still", "hardly moves"),
        ("degrees", 'write unit = "deg"'),
        ("slow", "too slow for a bandwidth of 10 Hz; write bandwidth_Hz = 3.75 or less"),
        ("words", "holds words such as '"),
        ("empty", r"column 't1' has no number at 2 s \(1500 of 2000"),
        ("far", r"column 't1' is 1e\+200 at 2 s"),
        ("beyond", r"column 't1' is 1e\+308 at 2 s"),
        ("word", "column 't1' has no number at 2 s"),
        ("turn", r"column 'q1' of joint shoulder leaps by 6\.278 rad at .* \(6 times in all\).*period=6\.283"),
        ("range", r"column 'q1' of joint shoulder leaps by 4.09.* rad at .* expected an angle that goes on; unwrap"),
    ],
)
def test_logs_that_cannot_be_used_are_refused_in_words(folder: Path, tmp_path: Path, change: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        crosscheck.identify(folder, [spoiled(folder, tmp_path, change)])


@pytest.mark.parametrize("change", ["empty", "all", "one"])
def test_a_column_without_numbers_is_no_traceback(folder: Path, tmp_path: Path, change: str) -> None:
    table = pd.read_csv(folder / "one.csv")
    table["t1"] = {"empty": np.nan, "all": np.inf, "one": 1e308}[change]
    table.to_csv(tmp_path / "bad.csv", index=False)
    with pytest.raises(InputError, match=r"bad\.csv: .*column 't1'"):
        crosscheck.identify(folder, [tmp_path / "bad.csv"])


def test_a_jump_is_said_with_column_and_time(folder: Path, tmp_path: Path) -> None:
    table = pd.read_csv(folder / "one.csv")
    table.loc[900:, "q1"] += 0.5
    table.to_csv(tmp_path / "jump.csv", index=False)
    words = crosscheck.identify(folder, [tmp_path / "jump.csv"]).words
    assert any("column 'q1' of joint shoulder leaps by 0.49" in text and "at 3.6 s" in text for text in words)
    assert words[0].startswith("jump.csv: the model explains torque/shoulder (column 't1') worse")


@pytest.mark.parametrize("columns", [["q1", "q2"], ["t1", "t2"]])
def test_swapped_columns_of_a_log_that_identifies_are_named(folder: Path, tmp_path: Path, columns: list[str]) -> None:
    """Without --causes: the model explains the log worse than a constant does, and that asks for a reason."""
    table = pd.read_csv(folder / "one.csv")[::2]
    table[columns] = table[columns[::-1]].to_numpy()
    table.to_csv(tmp_path / "swapped.csv", index=False)
    models = ["--models", str(folder.parent), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(Main(), ["identify", "arm", *models, "--log", str(tmp_path / "swapped.csv")])
    said = " ".join(done.output.split())
    kind = "angles" if columns[0] == "q1" else "efforts"
    assert f"what remains of swapped.csv swapped columns of the {kind} of shoulder and elbow" in said
    assert "(column 't1')" in said
    assert "would hide" not in said  # nobody asked


def test_uneven_steps_give_the_parameters_of_even_ones(folder: Path, tmp_path: Path) -> None:
    """40 % of the steps off by up to 30 %, and 2 % missing: each parameter stays inside the interval of the even log."""
    table = pd.read_csv(folder / "one.csv")
    at = logged_arm.jitter(table["time_s"].to_numpy(), 3)
    curves = CubicSpline(table["time_s"], table.to_numpy()[:, 1:])(at)
    pd.DataFrame(np.column_stack([at, curves]), columns=table.columns).to_csv(tmp_path / "uneven.csv", index=False)
    even, uneven = (crosscheck.identify(folder, [path]) for path in (folder / "one.csv", tmp_path / "uneven.csv"))
    assert "of its steps are uneven" in uneven.words[0]
    for row, other in zip(even.parameters, uneven.parameters, strict=True):
        assert row.low < other.value < row.high


def test_a_leap_that_no_sample_saw_does_not_count(folder: Path, tmp_path: Path) -> None:
    """Friction of the elbow turns round between two samples that are there: a spline makes that up, and the fit believed it."""
    table = pd.read_csv(folder / "one.csv")
    turns = np.flatnonzero(np.diff(np.sign(np.diff(table["q2"]))))
    turn = int(turns[(turns > 500) & (turns < 1500)][0])
    machine = read_machine(folder)
    counted = {}
    for name, lost in (("even", []), ("leap", [turn, turn + 1]), ("smooth", [turn + 200])):
        table.drop(index=lost).to_csv(tmp_path / f"{name}.csv", index=False)
        counted[name] = make_run(machine, read_log(tmp_path / f"{name}.csv")).counted
    assert (counted["smooth"] == counted["even"]).all()
    left_out = np.flatnonzero(counted["even"][:, 1] & ~counted["leap"][:, 1])
    assert left_out.min() < turn < left_out.max()
    assert np.ptp(left_out) * 0.004 < 2 * 1.5 / 10.0 + 0.02  # 1.5 periods of the bandwidth, 10 Hz, on either side
    assert (counted["leap"][:, 0] == counted["even"][:, 0]).all()  # the shoulder's friction does not turn round there


def test_few_degrees_that_are_promised_as_radians_are_said(folder: Path, tmp_path: Path) -> None:
    """An arm that moves by half a turn at most: 90 rad are possible by themselves, and no model explains torques with them."""
    table = pd.read_csv(folder / "two.csv")
    table["q1"] = np.degrees(0.3 * table["q1"])
    assert 2.0 * np.pi < np.ptp(table["q1"]) < 20.0 * np.pi
    table.to_csv(tmp_path / "degrees.csv", index=False)
    words = crosscheck.identify(folder, [folder / "one.csv"], [tmp_path / "degrees.csv"]).words
    assert "torque/shoulder" in words[0]
    assert "worse than a constant" in words[0]
    assert "column 'q1' goes over" in words[1]
    assert 'write unit = "deg" in [joints.shoulder] angle' in words[1]
    assert not any("worse" in text for text in crosscheck.identify(folder, [folder / "one.csv"]).words)
