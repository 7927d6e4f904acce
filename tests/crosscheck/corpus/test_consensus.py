"""Consensus is what engines of different authors have in common: found, refused, named, and floored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.corpus.authors import Author, find_author
from crosscheck.corpus.consensus import (
    CLOSED_FORM,
    CONSENSUS,
    DISAGREEMENT,
    SINGLE,
    CaseConsensus,
    EnginePanel,
    SeriesConsensus,
    find_case_consensus,
)
from crosscheck.corpus.intervals import (
    FLOOR,
    EngineValues,
    Interval,
    compute_hull,
    compute_intersection,
    find_agreeing_groups,
    find_samples_inside,
    make_interval,
)
from crosscheck.corpus.notes import CorpusTable, EngineNote, PublishedValue, check_published, read_notes
from crosscheck.corpus.published import compare_published
from crosscheck.engines import ENGINES, Engine
from crosscheck.measures.budget import UNORDERED, apply_stated_bars
from crosscheck.measures.record import Record, Series
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import Task, discover
from crosscheck.verdicts.results import Diagnosis, Results
from flexinv.errors import InputError

AUTHORS = {"a": "A", "a2": "A", "b": "B", "c": "C", "exact": "E"}


def given(engine: str, value: float, bar: float) -> EngineValues:
    return EngineValues(engine, AUTHORS[engine], np.full(3, value), np.full(3, bar))


def test_authors_that_meet_at_every_sample_agree_and_one_sample_apart_is_apart() -> None:
    a, b = given("a", 1.0, 0.1), given("b", 1.15, 0.1)
    (group,) = find_agreeing_groups([a, b], 1.0)
    assert [one.engine for one in group] == ["a", "b"]
    met = compute_intersection([make_interval(one, 1.0) for one in group])
    assert met.low == pytest.approx(1.05)
    assert met.high == pytest.approx(1.1)
    off = replace(b, values=np.array([1.15, 1.15, 1.21]))
    assert find_agreeing_groups([a, off], 1.0) == ()


def test_two_engines_of_one_author_are_no_consensus_and_more_authors_win() -> None:
    assert find_agreeing_groups([given("a", 1.0, 0.1), given("a2", 1.0, 0.1)], 1.0) == ()
    everyone = [given("a", 1.0, 0.1), given("a2", 2.0, 0.1), given("b", 1.0, 0.1), given("c", 1.1, 0.1)]
    (group,) = find_agreeing_groups(everyone, 1.0)
    assert {one.engine for one in group} == {"a", "b", "c"}


def test_the_floor_lets_rounding_meet_and_nothing_more() -> None:
    """Two bars of nothing meet up to twice the floor of the quantity's size."""
    for apart, groups in ((1.9 * FLOOR, 1), (2.1 * FLOOR, 0)):
        assert len(find_agreeing_groups([given("a", 10.0, 0.0), given("b", 10.0 * (1.0 + apart), 0.0)], 10.0)) == groups


def test_an_interval_is_written_as_middle_and_half_width_that_reach_its_ends() -> None:
    random = np.random.default_rng(3)
    low = random.normal(size=1000)
    where = Interval(low, low + 1e-13 * random.random(1000))
    again = Interval(where.middle - where.half, where.middle + where.half)
    assert (again.low <= where.low).all()
    assert (again.high >= where.high).all()
    assert find_samples_inside(where.low, again).all()
    wide = compute_hull([where, Interval(where.low + 1.0, where.high + 1.0)])
    assert (wide.low == where.low).all()
    assert (wide.high == where.high + 1.0).all()


# --- a case ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    return discover(root / "models", ["rigid_one_link/cycloid"]).tasks[0]


def panel(*names: str, results: Results | None = None, closed: str = "") -> EnginePanel:
    engines = {n: Engine(n, "", "", "") for n in names}
    authors = {n: Author(AUTHORS[n], n == closed) for n in names}
    return EnginePanel(engines, authors, authors, results or Results(started=""))


def record(task: Task, engine: str, shift: float = 0.0, bar: float | None = 1e-3, order: bool = True) -> Record:
    """A record with one torque: a sine that is shifted, and its bar."""
    values = np.sin(task.time) + shift
    error = None if bar is None else np.full(task.time.size, bar)
    made = {"torque/hub": Series("torque/hub", "N m", values, error)}
    how = {"torque/hub": {"how": {"step": "Richardson" if order else UNORDERED}}}
    return Record(engine, time=task.time, series=made, budget=how)


def found(task: Task, who: EnginePanel, *records: Record) -> tuple[CaseConsensus, SeriesConsensus]:
    case = find_case_consensus(task, {one.engine: one for one in records}, who)
    return case, case.series[0]


def test_two_authors_reach_consensus_and_who_is_off_is_named_with_the_cause(task: Task) -> None:
    why = Diagnosis("rigid_one_link", "cycloid", "c", "a", words="the rotor is missing", named=({"cause": "rotor"},))
    who = panel("a", "b", "c", results=Results(started="", diagnoses=(why,)))
    case, one = found(task, who, record(task, "a"), record(task, "b", 1e-3), record(task, "c", 0.5))
    assert (case.status, one.status, case.whole) == (CONSENSUS, CONSENSUS, True)
    assert {v.engine: v.part for v in one.voices} == {"a": "agrees", "b": "agrees", "c": "disagrees"}
    assert one.voices[2].reason == "the rotor is missing"
    assert one.voices[2].outside == 1.0


def test_an_empty_intersection_is_a_disagreement_with_its_cause(task: Task) -> None:
    row = Comparison("rigid_one_link", "cycloid", "b", "a", "torque", "N m", "deviation", "0.5 of the range")
    who = panel("a", "b", results=Results(started="", comparisons=(row,)))
    case, one = found(task, who, record(task, "a"), record(task, "b", 0.5))
    assert (case.status, one.interval) == (DISAGREEMENT, None)
    assert one.cause == "b: 0.5 of the range"


def test_one_author_alone_is_single_whatever_its_engines_say(task: Task) -> None:
    case, one = found(task, panel("a", "a2"), record(task, "a"), record(task, "a2"))
    assert (case.status, one.status) == (SINGLE, SINGLE)
    assert one.sole is not None


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"bar": None}, "gives no error bar"),
        ({"order": False}, "has no order"),
        ({"bar": 1.0}, "wider than 0.1 of the range"),
    ],
)
def test_a_bar_that_is_none_takes_no_part(task: Task, bad: Mapping[str, float], words: str) -> None:
    case, one = found(task, panel("a", "b"), record(task, "a"), record(task, "b", **bad))  # type: ignore[arg-type]
    assert case.status == SINGLE
    assert words in one.voices[1].reason


def test_a_bar_that_an_engine_states_by_itself_takes_no_part(task: Task) -> None:
    case, one = found(task, panel("a", "b"), record(task, "a"), apply_stated_bars(record(task, "b")))
    assert case.status == SINGLE
    assert "no refinement that was asked for shows it" in one.voices[1].reason


def test_two_formulations_of_one_author_that_differ_are_both_reached(task: Task) -> None:
    """The other author's bar holds both: the consensus is no choice between them."""
    records = record(task, "a", -9e-3), record(task, "a2", 9e-3), record(task, "b", bar=1e-2)
    _, one = found(task, panel("a", "a2", "b"), *records)
    assert one.status == CONSENSUS
    assert one.interval is not None
    assert one.interval.half.max() == pytest.approx(1e-2)


def test_groups_of_different_authors_that_exclude_each_other_are_no_consensus(task: Task) -> None:
    records = record(task, "a", -9e-3), record(task, "c", 9e-3), record(task, "b", bar=1e-2)
    case, one = found(task, panel("a", "b", "c"), *records)
    assert case.status == DISAGREEMENT
    assert "nobody tells which" in one.cause


def test_a_closed_form_needs_nobody(task: Task) -> None:
    case, one = found(
        task, panel("a", "exact", closed="exact"), record(task, "a", 0.5), record(task, "exact", bar=None)
    )
    assert case.status == CLOSED_FORM
    assert {v.engine: v.part for v in one.voices} == {"a": "disagrees", "exact": "agrees"}


def test_authors_are_packages_unless_the_file_says_otherwise() -> None:
    names = ("exudyn", "exudyn-ancf", "exudyn-ge", "exudyn-dae")
    assert {find_author(ENGINES[name], {}).name for name in names} == {"exudyn"}
    assert (
        len({find_author(one, {}).name for one in ENGINES.values()}) == 5
    )  # flexinv, pinocchio, mujoco, exudyn, measured
    # whose loops follow from one text of ours
    loops = {one.name: find_author(one, {}, loops=True).name for one in ENGINES.values()}
    assert len({name for engine, name in loops.items() if engine.startswith(("pinocchio", "mujoco", "exudyn"))}) == 1
    assert len(set(loops.values())) == 3  # flexinv, that text, measured
    stated = {"mine": EngineNote(author="somebody", closed_form=True)}
    assert (
        find_author(ENGINES["pinocchio"], {"pinocchio": EngineNote(author="somebody")}, loops=True).name == "somebody"
    )
    assert find_author(Engine("mine", "", "", ""), stated) == Author("somebody", True)
    assert find_author(Engine("mine", "", "", ""), {}).name == "mine"


# --- published numbers and corpus.toml ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "when", "agrees"),
    [(0.1, 0.1, True), (0.2, 0.1, False), (float(np.sin(0.5)), None, True), (0.3, None, False)],
)
def test_published_numbers_stand_beside_the_consensus(
    task: Task, value: float, when: float | None, agrees: bool
) -> None:
    """sin(0.1) = 0.0998 is 0.1 to its digit; sin(0.5) is the largest."""
    case, _ = found(task, panel("a", "b"), record(task, "a"), record(task, "b"))
    published_value = PublishedValue(
        mechanism="rigid_one_link", case="cycloid", series="torque/hub", value=value, unit="N m", source="x", at_s=when
    )
    (one,) = compare_published(case, [published_value])
    assert one.agrees is agrees
    assert (one.distance == 0.0) is agrees


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[mechanisms.a]\nlicense = 'MIT'", "licence instead of license"),
        ("[[published]]\nmechanism = 'a'", "key case"),
        ("format = 2", "format"),
        ("[engines.a]\nauthor = 3", "who wrote it"),
    ],
)
def test_a_wrong_corpus_file_is_explained(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "corpus.toml").write_text(text)
    with pytest.raises(InputError, match=words) as failed:
        read_notes(tmp_path)
    assert "corpus.toml" in str(failed.value)


def test_a_published_number_of_no_case_or_no_sample_is_refused(task: Task) -> None:
    said = {"mechanism": "rigid_one_link", "series": "torque/hub", "value": 1.0, "unit": "N m", "source": "x"}
    for more, words in (
        ({"case": "cyclod"}, "a case of rigid_one_link"),
        ({"case": "cycloid", "at_s": 0.01234}, "a sample"),
    ):
        notes = CorpusTable(published=[PublishedValue(**said, **more)])  # type: ignore[arg-type]
        with pytest.raises(InputError, match=words):
            check_published(notes, [task], Path("models"), whole=True)


def test_the_notes_of_our_models_fit_them(root: Path) -> None:
    notes = read_notes(root / "models")
    tasks = discover(root / "models").tasks
    check_published(notes, tasks, root / "models", whole=True)
    for one in tasks:
        note = notes.find_licence(one)
        assert all((root / "models" / name).is_file() for name in note.licence_files)
        assert note.licence_files or not note.redistribute  # a licence of others goes with its text
