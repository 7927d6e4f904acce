"""identify on logs whose truth is known: parameters, intervals, bands, and predictions that look at no torque."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import crosscheck
from crosscheck.cli import Main
from crosscheck.identification.bands import factors, judge, predict
from crosscheck.identification.fit import fit, problem
from crosscheck.identification.identify import Identified, blocks, machine_of
from crosscheck.identification.log import read_log
from crosscheck.identification.readings import make_run
from flexinv.errors import InputError


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("models") / "arm"
    logged_arm.write_arm(base)
    for seed, name in enumerate(("one", "two")):
        logged_arm.frame(base, seed).to_csv(base / f"{name}.csv", index=False)
    return base


@pytest.fixture(scope="module")
def found(folder: Path) -> Identified:
    return crosscheck.identify(folder, [folder / "one.csv"], [folder / "two.csv"])


def test_the_truth_lies_in_the_intervals(found: Identified) -> None:
    """Friction and the static moment of the forearm, which its torque tells; 90 % intervals hold these with this seed."""
    table = {(row.parameter, row.place): row for row in found.parameters}
    for key, truth in ((("viscous friction", "shoulder"), 4.0), (("coulomb friction", "shoulder"), 2.0)):
        row = table[key]
        assert row.identifiable
        assert row.low < truth < row.high
        assert row.high - row.low < 0.2 * (row.before_high - row.before_low)


def test_what_no_torque_shows_keeps_its_prior(found: Identified) -> None:
    """The mass of the upper arm beside its static moment: a revolute joint on the ground never shows it."""
    row = next(r for r in found.parameters if (r.parameter, r.place) == ("Ixx", "upper"))
    assert not row.identifiable
    assert any("Ixx" in words and words.startswith("upper") for words in found.words)


def test_an_unseen_motion_is_predicted_inside_its_bands(found: Identified) -> None:
    """Noise of 0.05 N m behind 10 Hz is 0.014 N m of torques of some 10 N m."""
    for row in found.judged:
        assert row.explained > 0.999
        assert 0.8 < row.coverage < 0.99
        assert row.width < 5.0


def test_blocks_judge_each_other(folder: Path, found: Identified) -> None:
    for row in blocks(found.machine, read_log(folder / "one.csv"), 4):
        assert row.explained > 0.999
        assert row.coverage > 0.75  # of four blocks, a quarter of the log each


def run(*arguments: str) -> str:
    done = CliRunner().invoke(Main(), ["identify", *arguments])
    assert done.exit_code == 0, done.output
    return done.output


def test_a_prediction_looks_at_no_torque(folder: Path, tmp_path: Path) -> None:
    """Without the torque columns of the other log the file is the same, bit by bit."""
    models = ["--models", str(folder.parent)]
    pd.read_csv(folder / "two.csv").drop(columns=["t1", "t2"]).to_csv(tmp_path / "without.csv", index=False)
    files = []
    for name, log in (("a", folder / "two.csv"), ("b", tmp_path / "without.csv")):
        run("arm", *models, "--log", "one.csv", "--predict", str(log), "--out", str(tmp_path / name))
        files.append((tmp_path / name / "prediction.csv").read_bytes())
    assert files[0] == files[1]
    table = pd.read_csv(tmp_path / "a" / "prediction.csv")
    assert list(table.columns)[:4] == [
        "time_s", "torque/shoulder [N m]", "torque/shoulder low [N m]", "torque/shoulder high [N m]",
    ]  # fmt: skip
    assert np.array_equal(table["time_s"], pd.read_csv(folder / "two.csv")["time_s"])
    heads = pd.read_csv(tmp_path / "a" / "parameters.csv").columns
    assert list(heads) == ["parameter", "place", "value", "low", "high", "unit", "identifiable"]


def test_a_copy_as_hold_out_is_said(folder: Path) -> None:
    words = crosscheck.identify(folder, [folder / "one.csv"], [folder / "one.csv"]).words
    assert any("no test" in text for text in words)


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
    ],
)
def test_logs_that_cannot_be_used_are_refused_in_words(folder: Path, tmp_path: Path, change: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        crosscheck.identify(folder, [spoiled(folder, tmp_path, change)])


def test_a_doubled_column_is_refused(folder: Path, tmp_path: Path) -> None:
    text = (folder / "one.csv").read_text().replace("q2", "q1", 1)
    (tmp_path / "twice.csv").write_text(text)
    with pytest.raises(InputError, match="stands there twice"):
        crosscheck.identify(folder, [tmp_path / "twice.csv"])


def test_a_clipped_torque_is_said(folder: Path, tmp_path: Path) -> None:
    table = pd.read_csv(folder / "one.csv")
    table["t1"] = table["t1"].clip(upper=float(np.quantile(table["t1"], 0.9)))
    table.to_csv(tmp_path / "clipped.csv", index=False)
    assert any("clipped" in words for words in crosscheck.identify(folder, [tmp_path / "clipped.csv"]).words)


def test_a_mat_file_is_read(folder: Path, tmp_path: Path) -> None:
    from scipy.io import savemat

    table = pd.read_csv(folder / "one.csv")
    savemat(tmp_path / "one.mat", {name: table[name].to_numpy() for name in table.columns})
    log = read_log(tmp_path / "one.mat")
    assert np.array_equal(log.column("t1"), table["t1"])


@pytest.mark.slow
def test_four_fifths_of_the_measured_arm_predict_the_last(root: Path) -> None:
    """Motor torques of kuka_kr300: 99 % on axes 1 to 3 and 95 % on 4 to 6 is what its record is kept for."""
    folder = root / "models" / "kuka_kr300"
    machine = machine_of(folder)
    run = make_run(machine, read_log(folder / "run_A.csv.gz"))
    last = (run.time >= 6.92)[:, None]
    task = problem(machine, (run,), (run.counted & ~last,))
    found = fit(task)
    told = predict(machine, found, factors(task, found), run)
    seen = judge(machine, run, told, run.counted & ~last)
    assert all(row.explained > 0.99 for row in seen[:3])
    assert all(row.explained > 0.95 for row in seen[3:])
    unseen = judge(machine, run, told, run.counted & last)
    # of one block alone: errors over the spread of the whole window
    for c, row in enumerate(unseen):
        spread = run.measured[run.counted[:, c], c].std()  # type: ignore[index]
        assert 1.0 - (row.rms / spread) ** 2 > (0.99 if c < 3 else 0.95)
        assert row.coverage > 0.7  # of 90 % on average over blocks
