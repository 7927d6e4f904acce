"""The measurement as an engine: read from the file that a case names, and refused where it does not fit."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.measured import adapter as measured
from crosscheck.measures.record import check
from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism

NAME = "quanser_2dsfl"


@pytest.fixture(scope="module")
def task(root: Path) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(root / "models" / NAME)
    return mechanism, load_cases(root / "models" / NAME, mechanism)["moves"]


def test_what_was_measured_is_a_record_with_bars(task: tuple[Mechanism, Case]) -> None:
    record = adapter(ENGINES["measured"]).run(*task, "measured", {})
    check(record, np.arange(0.0, task[1].end + task[1].sample / 2, task[1].sample))
    for name in ("torque/shoulder", "torque/elbow", "deflection/link1/y", "deflection/link2/y"):
        bar = record.series[name].error
        assert bar is not None
        assert bar.min() > 0.0
    # Joints without a drive have no effort, by what they are.
    assert not record.series["torque/clamp1"].values.any()
    assert record.series["torque/shoulder"].unit == "N m"
    assert (
        3.0 < np.abs(record.series["torque/shoulder"].values).max() < 8.925
    )  # below that of 1 A, with which the rig saturates


def test_cases_that_nobody_measured_are_skipped(task: tuple[Mechanism, Case]) -> None:
    mechanism, case = task
    assert measured.unsupported(mechanism, case, "measured") is None
    assert measured.unsupported(mechanism, replace(case, measured=None), "measured") == "nobody measured this case"
    with pytest.raises(InputError, match="names no record"):
        measured.run(mechanism, replace(case, measured=None), "measured", {})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,a [m]\n0,1\n", "the first column is 't', expected 'time \\[s\\]'"),
        ("", "there is no header, expected 'time \\[s\\]'"),
        (
            "time [s],torque/hub\n0,1\n",
            "column 'torque/hub': expected a series and its unit; write 'torque/hub \\[N m\\]'",
        ),
        ("time [s],torque/hub [N m]\n0,x\n", "row 2, column 'torque/hub \\[N m\\]': 'x' is no number"),
        ("time [s],torque/hub error [N m]\n0,1\n", "has no column 'torque/hub \\[N m\\]' beside it"),
        (
            "time [s],torque/shoulder [N m]\n0,1\n1,1\n",
            "has 2 times, not the 625 of the case, 0 to 4.992 s every 0.008 s",
        ),
    ],
)
def test_bad_files_are_refused(task: tuple[Mechanism, Case], tmp_path: Path, text: str, message: str) -> None:
    mechanism, case = task
    (tmp_path / "measured.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        measured.run(mechanism, replace(case, measured=tmp_path / "measured.csv"), "measured", {})


def edited(task: tuple[Mechanism, Case], folder: Path, old: str, new: str) -> Case:
    text = task[1].measured.read_text()  # type: ignore[union-attr]
    assert old in text
    (folder / "measured.csv").write_text(text.replace(old, new))
    return replace(task[1], measured=folder / "measured.csv")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("torque/elbow", "torque/elbo", "column 'torque/elbo': the mechanism has no such series; write 'torque/elbow'"),
        ("deflection/link1/y", "deflections/link1/y", "column 'deflections/link1/y': .* write 'deflection/link1/y'"),
        ("\n0.008,", "\n0.0085,", r"row 3: 0\.0085 s, where the case has 0\.008 s .*interpolate the record"),
        ("\n0.008,", "\nnan,", r"row 3: nan s, where the case has 0\.008 s"),
    ],
)
def test_columns_and_times_that_are_those_of_nothing_are_refused(
    task: tuple[Mechanism, Case], tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        measured.run(task[0], edited(task, tmp_path, old, new), "measured", {})


def test_a_file_that_is_not_there_is_named(root: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(root / "models" / NAME, tmp_path / NAME)
    file = folder / "cases.toml"
    file.write_text(file.read_text().replace('measured = "measured.csv"', 'measured = "measure.csv"'))
    with pytest.raises(InputError, match=r'(?s)measured = "measure.csv".*write: +measured = "measured.csv"'):
        load_cases(folder, load_mechanism(folder))
