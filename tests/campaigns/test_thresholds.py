"""Thresholds that are halved and doubled: every one is there, changes wherever it is held, and comes back."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Sequence

import numpy as np
import pytest

from campaigns.beyond.campaign import Bench
from campaigns.log_faults.trial import Row, read_rows, run_row
from campaigns.thresholds import beyond_faults
from campaigns.thresholds.__main__ import PAGE, format_table, list_changed_verdicts, render_page
from campaigns.thresholds.absences import ABSENT, REASONS, WITHOUT_ABSENCE
from campaigns.thresholds.beyond_faults import KnownFault
from campaigns.thresholds.constants import (
    ABSENCE,
    LOGS,
    TORQUES,
    Threshold,
    list_thresholds,
    replace_threshold,
    scale_value,
)
from campaigns.thresholds.kept_effects import keep_effects
from campaigns.thresholds.kept_rounds import keep_rounds
from campaigns.thresholds.trials import LISTS
from campaigns.thresholds.verdict import COUNTED, Verdict
from crosscheck.causes import diagnosis, naming
from crosscheck.causes.fit import Columns
from crosscheck.identification.causes import name_causes, rounds
from crosscheck.identification.causes.cause import NamedCause


@pytest.mark.parametrize("kind", [TORQUES, LOGS])
def test_every_threshold_is_a_number_or_some(kind: str) -> None:
    for threshold in list_thresholds(kind):
        numbers = threshold.value.values() if isinstance(threshold.value, dict) else [threshold.value]
        assert all(isinstance(number, int | float) for number in numbers), threshold


def test_a_threshold_changes_while_it_is_tried_and_comes_back() -> None:
    before = rounds.SEEN
    little = name_causes.LITTLE
    with replace_threshold(Threshold(LOGS, rounds.__name__, "SEEN"), 2.0) as new:
        assert new == rounds.SEEN == 2.0 * before
        assert little == name_causes.LITTLE  # another constant stays
    assert before == rounds.SEEN


def test_an_absent_threshold_has_the_value_that_is_stated() -> None:
    before = rounds.NOISE
    with replace_threshold(Threshold(LOGS, rounds.__name__, "NOISE"), ABSENCE) as new:
        assert new == rounds.NOISE == np.inf
    assert before == rounds.NOISE


@pytest.mark.parametrize("kind", [TORQUES, LOGS])
def test_every_threshold_has_an_absence_or_a_reason(kind: str) -> None:
    assert list_undecided(list_thresholds(kind)) == []


def test_a_threshold_without_either_is_found() -> None:
    assert list_undecided([Threshold(LOGS, rounds.__name__, "NOT_THERE")]) == ["NOT_THERE"]


def list_undecided(thresholds: list[Threshold]) -> list[str]:
    """Names of thresholds that have no value of absence and no reason against one, or both."""
    return [
        one.name
        for one in thresholds
        if (one.name in ABSENT.get(one.module, {})) == (one.name in WITHOUT_ABSENCE.get(one.module, {}))
    ]


def test_absences_are_of_thresholds_that_are_there() -> None:
    known = {(one.module, one.name) for kind in (TORQUES, LOGS) for one in list_thresholds(kind)}
    stated = {(module, name) for table in (ABSENT, WITHOUT_ABSENCE) for module in table for name in table[module]}
    assert stated <= known
    assert set(REASONS) == {word for table in WITHOUT_ABSENCE.values() for word in table.values()}


def test_whole_numbers_stay_whole_and_above_none() -> None:
    assert scale_value(3, 0.5) == 2
    assert scale_value(1, 0.5) == 1
    assert scale_value({True: 24, False: 6}, 2.0) == {True: 48, False: 12}
    assert scale_value(0.3, 0.5) == 0.15


def test_the_table_has_all_ways_of_each() -> None:
    counts = dict.fromkeys((*COUNTED, "changed"), "4")
    module = rounds.__name__.removeprefix("crosscheck.")
    rows = [
        {"kind": LOGS, "module": module, "name": "SEEN", "factor": factor, **counts | {"right": right}}
        for factor, right in (("0.5", "9"), ("2", "8"), ("absent", "7"))
    ]
    line = f"| `{module}.SEEN` | {rounds.SEEN} | `log_faults` | 9 / 4 / 4 / 4 | 8 / 4 / 4 / 4 | 7 / 4 / 4 / 4 |"
    assert line in format_table(rows)


def test_the_page_has_the_values_of_the_code_and_what_stands() -> None:
    """`python -m campaigns.thresholds --page` writes it; a value that changes in the code alone is found here."""
    text = PAGE.read_text()
    assert render_page(text) == text
    for threshold in (*list_thresholds(LOGS), *list_thresholds(TORQUES)):
        place = f"`{threshold.module.removeprefix('crosscheck.')}.{threshold.name}`"
        assert f"| {place} | {threshold.value} |" in text
    assert render_page(text.replace("| 12.0 |", "| 13.0 |")) == text


def test_a_value_that_cannot_be_is_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> list[Verdict]:
        raise ValueError("Quantiles must be in the range [0, 1]")

    monkeypatch.setitem(LISTS, LOGS, refuse)
    assert list_changed_verdicts(LOGS) is None


def test_a_whole_number_changes_in_modules_that_import_it_and_in_no_other() -> None:
    other = rounds.MOST
    with replace_threshold(Threshold(TORQUES, naming.__name__, "MOST"), 2.0) as new:
        assert new == naming.MOST == diagnosis.MOST
        assert rounds.MOST is other  # of the same name in another module
    assert naming.MOST == diagnosis.MOST == new // 2


def test_no_argument_is_a_threshold_unless_it_is_said() -> None:
    """A default is what a threshold was when its module was read: no change of it would be felt."""
    for threshold in (*list_thresholds(LOGS), *list_thresholds(TORQUES)):
        tree = ast.parse(inspect.getsource(importlib.import_module(threshold.module)))
        functions = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
        defaults = (one for f in functions for one in (*f.args.defaults, *f.args.kw_defaults) if one is not None)
        names = {node.id for one in defaults for node in ast.walk(one) if isinstance(node, ast.Name)}
        assert threshold.name not in names, threshold


@pytest.mark.parametrize("name", ["EVIDENCE", "LITTLE"])
def test_what_is_kept_changes_no_verdict(name: str) -> None:
    rows = read_rows()[120:124]
    first = find_names(rows)
    threshold = Threshold(LOGS, name_causes.__name__, name)
    with replace_threshold(threshold, 0.5):
        anew = find_names(rows)
    with keep_rounds() as kept:
        assert find_names(rows) == first
        with replace_threshold(threshold, 0.5), kept.use_for(threshold):
            assert find_names(rows) == anew


def find_names(rows: list[Row]) -> list[tuple[NamedCause, ...]]:
    return [run_row(row).named for row in rows]


def test_what_is_kept_changes_no_verdict_of_a_users_mistake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two mistakes in one engine: a run that is kept for the first is none of the second."""
    monkeypatch.setattr(beyond_faults, "BENCHES", (Bench("double_pendulum", "swing", ("pinocchio",)),))
    monkeypatch.setattr(beyond_faults, "DRAWN", 3)
    known = beyond_faults.prepare_faults.__wrapped__()
    assert len(known) > 1
    threshold = Threshold(TORQUES, naming.__name__, "MOST")
    first = ask_about_all(known)
    with replace_threshold(threshold, 0.5):
        anew = ask_about_all(known)
    with keep_effects() as kept:
        assert ask_about_all(known) == first
        with replace_threshold(threshold, 0.5), kept.use_for(threshold):
            assert ask_about_all(known) == anew


def ask_about_all(known: Sequence[KnownFault]) -> list[Verdict]:
    columns = Columns()
    return [beyond_faults.ask_about(one, columns) for one in known]
