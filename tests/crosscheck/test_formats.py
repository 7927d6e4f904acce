"""Formats of files: an older one is read, a newer one refused in words before anything else in it is judged."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import sqlalchemy as sql

from crosscheck.equivalence.sources import describe
from crosscheck.identification.settings import read_settings
from crosscheck.kit import write as kit
from crosscheck.verdicts import history
from crosscheck.verdicts.history import HistoryError
from crosscheck.verdicts.results import Results, read, write
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism

NEWER = 'format = 2\nsomething_new = "of another meaning"\n'  # a key that this version would complain about, too
MODEL = Path(__file__).resolve().parents[2] / "models" / "double_pendulum"
NIGHT = Results("2026-03-01T01:00:00+00:00", finished=True)


def written(folder: Path, mechanism: str, cases: str) -> Path:
    """Write a mechanism and the samples that one of its cases reads."""
    folder.mkdir()
    (folder / "swing.csv").write_text((MODEL / "swing.csv").read_text())
    (folder / "mechanism.toml").write_text(mechanism)
    (folder / "cases.toml").write_text(cases)
    return folder


def without(text: str) -> str:
    """Return a file as it was before it had the number of a format."""
    return "\n".join(line for line in text.splitlines() if not line.startswith("format"))


def test_files_without_a_number_are_of_the_first_format(tmp_path: Path) -> None:
    mechanism, cases = ((MODEL / name).read_text() for name in ("mechanism.toml", "cases.toml"))
    for name, change in (("old", without), ("now", lambda text: "format = 1\n" + without(text))):
        folder = written(tmp_path / name, change(mechanism), change(cases))
        read_mechanism = load_mechanism(folder)
        assert isinstance(read_mechanism, Mechanism)
        assert load_cases(folder, read_mechanism)


@pytest.mark.parametrize("file", ["mechanism.toml", "cases.toml"])
def test_a_newer_file_is_refused_by_its_number_alone(tmp_path: Path, file: str) -> None:
    mechanism, cases = ((MODEL / name).read_text() for name in ("mechanism.toml", "cases.toml"))
    folder = written(tmp_path / "arm", mechanism, cases)
    known = load_mechanism(folder)
    reads = {"mechanism.toml": lambda: load_mechanism(folder), "cases.toml": lambda: load_cases(folder, known)}
    (folder / file).write_text(NEWER + without((folder / file).read_text()))
    with pytest.raises(InputError, match=r"format = 2[\s\S]*format 1 or older[\s\S]*newer flexinv") as refused:
        reads[file]()
    assert "something_new" not in str(refused.value)
    assert str(folder / file) in str(refused.value)


@pytest.mark.parametrize("number", [0, -1])
def test_a_number_that_no_format_ever_had_is_refused(tmp_path: Path, number: int) -> None:
    mechanism, cases = ((MODEL / name).read_text() for name in ("mechanism.toml", "cases.toml"))
    folder = written(tmp_path / "arm", f"format = {number}\n" + without(mechanism), cases)
    with pytest.raises(InputError, match="reads formats 1 to 1"):
        load_mechanism(folder)


def test_settings_of_an_identification_have_the_same_rule(tmp_path: Path) -> None:
    mechanism = load_mechanism(MODEL)
    (tmp_path / "identify.toml").write_text(NEWER)
    with pytest.raises(InputError, match=r"format = 2[\s\S]*newer flexinv"):
        read_settings(tmp_path, mechanism)
    (tmp_path / "identify.toml").write_text("format = 1\n")
    with pytest.raises(InputError, match="bandwidth_Hz") as said:  # the number is known: the next complaint is of a key
        read_settings(tmp_path, mechanism)
    assert "format" not in str(said.value)


def test_a_newer_kit_is_refused_by_its_number_alone(tmp_path: Path) -> None:
    mechanism = load_mechanism(MODEL)
    case = next(iter(load_cases(MODEL, mechanism).values()))
    kit.write(mechanism, case, tmp_path / "kit")
    file = tmp_path / "kit" / "case.json"
    said = json.loads(file.read_text())
    assert said["format"] == "crosscheck-case/1"
    assert describe(str(file)).mechanism is not None
    file.write_text(json.dumps({"format": "crosscheck-case/2", "what": "a table of another form"}))
    with pytest.raises(InputError, match=r'"crosscheck-case/2"[\s\S]*newer crosscheck') as refused:
        describe(str(file))
    assert "mechanism" not in str(refused.value)


def test_a_newer_history_is_refused_and_one_of_before_the_number_is_read(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.sqlite'}"
    database = history.open_database(url)
    history.add_night(database, NIGHT)
    with database.begin() as link:
        assert link.scalar(sql.text("select number from history_format")) == history.FORMAT
        link.execute(sql.text("drop table history_format"))  # as histories were before
    again = history.open_database(url)
    assert len(history.list_nights(again)) == 1
    history.add_night(again, Results("2026-03-02T01:00:00+00:00", finished=True))  # which writes the number
    with again.begin() as link:
        link.execute(sql.text("update history_format set number = 2"))
    with pytest.raises(HistoryError, match="of format 2, and this crosscheck knows 1; install a newer crosscheck"):
        history.open_database(url)


def test_results_of_another_schema_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "results.json"
    write(NIGHT, file)
    assert read(file).started == NIGHT.started
    file.write_text(file.read_text().replace('"schema": 1', '"schema": 2', 1))
    with pytest.raises(ValueError, match="not a results file of schema 1"):
        read(file)
