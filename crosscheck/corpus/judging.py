"""Judge answers to the kits of a corpus from its files alone: no engine and no folder of models is needed.

An answer lies in a folder called by the id of its case.  A value is inside where its own interval, that of its stated error bar
with the floor of the corpus, meets the consensus; a bar wider than a tenth of the range excuses nothing.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.corpus.consensus import REACHED, CaseConsensus
from crosscheck.corpus.entry import FORMAT, describe_series, make_case_id, make_expected_record
from crosscheck.corpus.folder import KITS, MANIFEST, compute_digest
from crosscheck.corpus.intervals import EngineValues, Interval, make_interval
from crosscheck.kit.answer import read_table
from crosscheck.kit.answer import resolve_file as file_inside
from crosscheck.kit.tables import MetaFile
from crosscheck.measures.limits import WIDEST_BAR
from crosscheck.measures.record import Series
from crosscheck.measures.series_csv import check_times, read
from crosscheck.verdicts.compare import WHOLE
from flexinv.errors import InputError
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

INSIDE = "inside"
OUTSIDE = "outside"
MISSING = "missing"
SKIPPED = "skipped"


@dataclass(frozen=True)
class SeriesJudgement:
    """One series of an answer: its verdict, the share of samples outside [-], and the largest distance over the range [-]."""

    id: str
    series: str
    verdict: str
    outside: float = 0.0
    distance: float = 0.0
    words: str = ""


@dataclass(frozen=True)
class CaseBands:
    """Consensus of a case as answers are held against it.

    time : (samples,) [s]; rows : of ``consensus.json`` by series that have one, with size and range [unit]
    series : their middles, with half-widths as errors [unit]
    """

    id: str
    time: Array
    rows: Mapping[str, Mapping[str, Any]]
    series: Mapping[str, Series]


def make_bands(case: CaseConsensus) -> CaseBands:
    """Return the consensus of a case that was just found, without files."""
    made = make_expected_record(case, None)
    rows = {one.name: describe_series(one) for one in case.series if one.name in made.series}
    return CaseBands(make_case_id(case.task.folder.name, case.task.case.name), made.time, rows, made.series)


def read_bands(corpus: Path, case: Mapping[str, Any]) -> CaseBands | None:
    """Return the consensus of a case of the manifest, None where no series has one.  Raises InputError for files that changed."""
    said = json.loads(_check_kit_file(corpus, case, "consensus.json").read_text(encoding="utf-8"))
    rows = {row["name"]: row for row in said["series"] if row["status"] in REACHED}
    if not rows:
        return None
    time, series = read(_check_kit_file(corpus, case, "expected/series.csv"))
    return CaseBands(case["id"], time, rows, series)


def judge_answers(answers: Path, corpus: Path) -> list[SeriesJudgement]:
    """Return the judgement of every series of the answers in a folder [-].

    Raises InputError where there is no corpus, no answer, an unknown id, or an answer that cannot be read.
    """
    known = read_manifest(corpus)
    folders = sorted(f for f in answers.iterdir() if f.is_dir()) if answers.is_dir() else []
    if not folders:
        raise InputError(f"{answers} holds no answer; expected folders named by the ids of {corpus / MANIFEST}")
    result: list[SeriesJudgement] = []
    for folder in folders:
        if folder.name not in known:
            near = find_nearest_word(folder.name, sorted(known)) or next(iter(known))
            raise InputError(f"{folder}: no case has the id {folder.name!r}; write {near!r}")
        result += _judge_answer(folder, known[folder.name], corpus)
    return result


def read_manifest(corpus: Path) -> dict[str, Mapping[str, Any]]:
    """Return the cases of a corpus by id.  Raises InputError where there is none, or it is of another format."""
    file = corpus / MANIFEST
    write = "write one with crosscheck corpus --out"
    if not file.is_file():
        raise InputError(f"{file}: there is no such file, expected the manifest of a corpus; {write}")
    try:
        plain = json.loads(file.read_text(encoding="utf-8"))
        said = plain["format"]
        cases = {one["id"]: one for one in plain["cases"]}
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise InputError(f"{file} is no manifest of a corpus: {error}; {write}") from None
    if said != FORMAT:
        raise InputError(f"{file} has format {said!r}, expected {FORMAT!r}; {write}")
    return cases


def _judge_answer(folder: Path, case: Mapping[str, Any], corpus: Path) -> Iterator[SeriesJudgement]:
    """Yield the judgement of one answer, series by series."""
    kit = corpus / KITS / case["id"]
    bands = read_bands(corpus, case)
    meta = read_table(file_inside(folder, "meta.json"), MetaFile) or MetaFile()
    if meta.case and meta.case != case["case.json"]:
        raise InputError(
            f"{folder / 'meta.json'}: an answer for the case {meta.case}, but {case['id']} is {case['case.json']}: "
            f"answer the kit in {kit}"
        )
    if meta.skipped or bands is None:
        yield SeriesJudgement(
            case["id"], "all", SKIPPED, words=meta.skipped or "no series of this case has a consensus"
        )
        return
    file = file_inside(folder, "series.csv")
    if not file.is_file():
        raise InputError(f"{folder} holds no series.csv: nothing was answered")
    given, series = read(file)
    check_times(file, given, bands.time, float(bands.time[1] - bands.time[0]) if bands.time.size > 1 else 1.0)
    for name in bands.rows:
        if name in series:
            yield judge_series(bands, series[name], file)
        elif name.split("/", 1)[0] in WHOLE:
            yield SeriesJudgement(case["id"], name, MISSING, words="every torque has to be answered")


def judge_series(bands: CaseBands, one: Series, file: Path) -> SeriesJudgement:
    """Return the judgement of one series [unit of it].  Raises InputError for another unit, and values that are not finite.

    file : that a message names
    """
    consensus = bands.series[one.name]
    row = bands.rows[one.name]
    if one.unit != consensus.unit:
        raise InputError(f"{file}: column {one.name!r} is in {one.unit}, expected {consensus.unit}")
    assert consensus.error is not None
    where = Interval(consensus.values - consensus.error, consensus.values + consensus.error)
    bar = np.zeros_like(one.values) if one.error is None else one.error
    for what, values in (("values", one.values), ("half-widths", bar)):
        if not np.isfinite(values).all() or (what != "values" and (values < 0.0).any()):
            raise InputError(f"{file}: column {one.name!r} holds {what} that are no finite {what}")
    span = row["range"] or row["size"] or 1.0
    if wide := float(bar.max()) > WIDEST_BAR * span:
        bar = np.zeros_like(bar)
    interval = make_interval(EngineValues("answer", "", one.values, bar), row["size"])
    gap = np.maximum(np.maximum(interval.low - where.high, where.low - interval.high), 0.0)
    off = float((gap > 0.0).mean())
    words = f"its bar is wider than {WIDEST_BAR:g} of the range and excuses nothing" if wide else ""
    return SeriesJudgement(bands.id, one.name, OUTSIDE if off else INSIDE, off, float(gap.max()) / span, words)


def _check_kit_file(corpus: Path, case: Mapping[str, Any], name: str) -> Path:
    """Return a file of a kit.  Raises InputError where it is not what the manifest says."""
    stated = f"{KITS}/{case['id']}/{name}"
    file = corpus / stated
    if not file.is_file() or compute_digest(file) != case["files"].get(stated):
        raise InputError(f"{file} is not what {corpus / MANIFEST} says: it was changed or lost; write the corpus anew")
    return file


def find_exit_code(rows: list[SeriesJudgement]) -> int:
    """Return 0 where all that was answered lies inside, 1 where not, 2 where nothing was judged."""
    if not any(row.verdict in (INSIDE, OUTSIDE, MISSING) for row in rows):
        return 2
    return 1 if any(row.verdict in (OUTSIDE, MISSING) for row in rows) else 0
