"""Numbers and tables are read as they are printed, and compared by what their size is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from crosscheck.bisect.criteria import Criterion, compute_table_distance
from crosscheck.bisect.observations import Observation, Reading, find_number, parse_table, read_entry, read_observation
from crosscheck.bisect.script import ScriptEnd, find_last_words

END = ScriptEnd(0, "height = 1.5\n", "", 0.1, 0.1)


@pytest.mark.parametrize(
    ("printed", "word", "number"),
    [
        ("height = 1.5", "height", 1.5),
        ("height [m]: -2e-3", "height", -2e-3),
        ("height 1\nheight 2", "height", 2.0),
        ("height=.5 m", "height", 0.5),
        ("my height = inf", "height", np.inf),
        ("heights = 3", "height", None),
        ("width = 3", "height", None),
        ("a 1 b 2.5e0", "last", 2.5),
        ("v3.3.7", "last", None),
        ("no number", "last", None),
    ],
)
def test_numbers_are_found_behind_their_word(printed: str, word: str, number: float | None) -> None:
    assert find_number(printed, word) == number


def test_columns_of_words_are_no_columns_of_numbers() -> None:
    names, table = parse_table("time,name,x\n0,a,1\n1,b,2\n")
    assert names == ("time", "x")
    assert table.tolist() == [[0.0, 1.0], [1.0, 2.0]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,x\n", "expected a line of names and at least one of numbers"),
        ("a,b\nc,d\n", "no column holds numbers alone"),
    ],
)
def test_a_table_without_numbers_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse_table(text)


def test_what_was_asked_for_and_is_not_there_cannot_run(tmp_path: Path) -> None:
    assert (
        read_observation(END, tmp_path, Reading(number="width")).reason
        == "it printed no line with a number behind 'width'"
    )
    assert read_observation(END, tmp_path, Reading(table="x.csv")).reason == "x.csv: it was not written"
    (tmp_path.parent / "x.csv").write_text("a\n1\n")
    assert "own folder" in read_observation(END, tmp_path, Reading(table="../x.csv")).reason


def test_observations_come_back_from_their_json_values(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("a,b\n1,2\n3,4\n5,6\n")
    one = read_observation(END, tmp_path, Reading("height", "x.csv"))
    back = read_entry(one.plain)
    assert back.table.tolist() == one.table.tolist()
    assert back.plain == one.plain


def number(value: float) -> Observation:
    return Observation("", 0, value, (), np.zeros((0, 0)), "", "", 0.0, 0.0)


@pytest.mark.parametrize(
    ("one", "reference", "distance"),
    [
        (1.0, 1.0, 0.0),
        (1.1, 1.0, 0.1),
        (1.0, 0.0, 1.0),
        (np.nan, np.nan, 0.0),
        (np.nan, 1.0, np.inf),
        (np.inf, 1.0, np.inf),
    ],
)
def test_numbers_differ_by_a_part_of_their_size(one: float, reference: float, distance: float) -> None:
    assert Criterion("same").compute_distance(number(one), number(reference)) == pytest.approx(distance, rel=1e-12)


def test_tables_differ_by_the_range_of_each_column() -> None:
    reference = np.array([[0.0, 100.0, 1e-30], [1.0, 300.0, 2e-30]])
    assert compute_table_distance(reference, reference) == 0.0
    assert compute_table_distance(reference + np.array([0.01, 0.0, 0.0]), reference) == pytest.approx(0.01)
    assert compute_table_distance(reference + np.array([0.0, 3.0, 0.0]), reference) == pytest.approx(0.01)
    # One unit for all: the largest range counts, here 300.
    assert compute_table_distance(reference + np.array([3.0, 0.0, 0.0]), reference, one_scale=True) == pytest.approx(
        0.01
    )
    # Rounding in a column that is zero in truth is no change: 1e-12 of the largest column is 3e-10.
    assert compute_table_distance(reference + np.array([0.0, 0.0, 3e-20]), reference) == pytest.approx(1e-10)
    assert compute_table_distance(np.full((2, 3), np.nan), reference) == np.inf


def test_another_form_of_a_table_differs_by_all() -> None:
    one = Observation("", 0, None, ("a",), np.zeros((2, 1)), "", "", 0.0, 0.0)
    longer = Observation("", 0, None, ("a",), np.zeros((3, 1)), "", "", 0.0, 0.0)
    assert Criterion("same").compute_distance(one, longer) == np.inf


def test_a_difference_that_never_counts_does_not() -> None:
    rounded = Criterion("same", absolute=1e-12)
    assert rounded.compute_distance(number(8e-15), number(4e-15)) == 0.0
    assert rounded.compute_distance(number(2e-12), number(4e-15)) > 1.0
    assert compute_table_distance(np.full((2, 1), 8e-15), np.full((2, 1), 4e-15), absolute=1e-12) == 0.0


@pytest.mark.parametrize(
    ("printed", "words"),
    [
        ("", ""),
        ("one\ntwo \n\n", "two"),
        (
            "Traceback (most recent call last):\n  File x\n    y\nValueError: Schema violation\nElement 'a', line 2\n",
            "ValueError: Schema violation Element 'a', line 2",
        ),
        ("Traceback (most recent call last):\n  a\nKeyError: 1\n\nTraceback (most recent call last):\n  b\nOSError\n", "OSError"),
    ],
)  # fmt: skip
def test_the_last_words_of_an_exception_are_its_name_and_message(printed: str, words: str) -> None:
    assert find_last_words(printed) == words
