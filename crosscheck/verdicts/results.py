"""The results of a run as data, and ``results.json``: the source of truth from which every report is rendered."""

from __future__ import annotations

import dataclasses
import datetime
import json
import math
import os
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from importlib import metadata
from pathlib import Path
from typing import Any, NotRequired, TypedDict, TypeVar

from crosscheck import output_folder as owned
from crosscheck.engines import Door
from crosscheck.measures.certificate import Check
from crosscheck.measures.limits import Verdict, compute_exit_code, find_worst_verdict
from crosscheck.measures.record import BudgetLine
from crosscheck.measures.spectrum import FEWEST
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.night_changes import NightChanges
from crosscheck.verdicts.signals import Move
from crosscheck.verdicts.study_table import Column, Line, SideTable, StudyFigure, StudyPlot

SCHEMA = 1
PACKAGES = ("flexinv", "numpy", "scipy", "pin", "mujoco", "exudyn", "example-robot-data", "plotly")
NO_CERTIFICATE = "no certificate"  # the one line of an engine that cannot be asked
BROKEN_CERTIFICATE = "broken certificate"  # the one line of an engine whose certificate cannot be read
Place = tuple[str, str, str]  # mechanism, case, engine
OF_STATUS: dict[str, Verdict] = {"ok": "within", "skipped": "skipped"}


class SkeletonLink(TypedDict):
    """A link as a drawing connects it: name, parent, whether it bends, where its joint is in the world [m] (None: on a link)."""

    link: str
    parent: str
    bends: bool
    at: list[float] | None


@dataclass(frozen=True)
class CaseRow:
    """One case of one mechanism; rest, end, step [s]; files: name and text of the model's files.

    skeleton : what is drawn: every link with its parent, whether it bends, and where its joint is in the world [m] (None
        on another link)
    """

    mechanism: str
    case: str
    mechanism_title: str = ""
    title: str = ""
    source: str = ""
    mechanism_source: str = ""
    notes: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    end: float = 0.0
    step: float = 0.0
    sample: float = 0.0
    rest: float = 0.0
    files: Mapping[str, str] = field(default_factory=dict)
    unused_limits: tuple[str, ...] = ()
    problem: str = ""
    skeleton: tuple[SkeletonLink, ...] = ()

    @property
    def slug(self) -> str:
        """A name for files and links."""
        return make_slug(f"{self.mechanism}-{self.case}")

    @property
    def held(self) -> bool:
        """Return True if spectra are of the time after the motion (else of the whole signal)."""
        return self.sample > 0.0 and round((self.end - self.rest) / self.sample) + 1 >= FEWEST


class BudgetRow(BudgetLine):
    """The largest error bar of a quantity and unit, and the series that has it."""

    quantity: str
    unit: str
    series: str


@dataclass(frozen=True)
class RunRow:
    """One engine on one case; wall_time [s] of the engine, elapsed [s] of the process; series: stem of its files.

    peaks : frequency [Hz] and amplitude [unit of the series] of the spectrum's peaks, by series
    budget : by quantity and unit, the series with the largest error bar: see ``crosscheck.measures.budget.add_error_bars``
    kept : when it was computed, where that was in an earlier run and nothing has changed since
    """

    mechanism: str
    case: str
    engine: str
    status: str
    message: str = ""
    version: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    wall_time: float = 0.0
    elapsed: float = 0.0
    model_hash: str = ""
    printed: str = ""
    series: str = ""
    peaks: Mapping[str, list[tuple[float, float]]] = field(default_factory=dict)
    budget: tuple[BudgetRow, ...] = ()
    kept: str = ""

    @property
    def verdict(self) -> Verdict:
        """Return the verdict on the run alone."""
        return OF_STATUS.get(self.status, "error")


@dataclass(frozen=True)
class EngineRow:
    """An engine: present or not, its version, what it can do, or why it is not there."""

    name: str
    present: bool
    version: str = ""
    abilities: str = ""
    message: str = ""


@dataclass(frozen=True)
class StudyRow:
    """A table made by a study of its own: columns (key, title, unit), rows by key, each with a verdict.

    plot, figures : curves of the table, and beside it; tables : beside the one that is judged; kept : as of a run
    heading : what stands over the table that is judged, where others lead
    gist : its figures in one sentence, for readers of the first line; assumed : what they rest on, for readers of the summary
    """

    name: str
    title: str
    text: str = ""
    columns: tuple[Column, ...] = ()
    rows: tuple[Line, ...] = ()
    plot: StudyPlot | None = None
    figures: tuple[StudyFigure, ...] = ()
    tables: tuple[SideTable, ...] = ()
    status: str = "ok"
    message: str = ""
    printed: str = ""
    elapsed: float = 0.0
    kept: str = ""
    heading: str = ""
    gist: str = ""
    assumed: str = ""

    @property
    def verdict(self) -> Verdict:
        """The gravest verdict of its rows, "error" where there is no table."""
        if self.status != "ok":
            return OF_STATUS.get(self.status, "error")
        return find_worst_verdict(row.get("verdict", "error") for row in self.rows)


class DiagnosisQuestion(TypedDict):
    """Arguments of `crosscheck.causes.diagnosis.diagnose`: folder of the mechanism, case, stems of two saved records.

    door : where the engine's adapter is, of an engine that is not one of ours
    """

    folder: str
    case: str
    engine: str
    ours: str
    theirs: str
    door: NotRequired[Door]


class NamedCause(TypedDict):
    """A cause that explains a deviation: name, target, a sentence, what it leaves [-], and where it shows."""

    cause: str
    target: str
    words: str
    left: float
    shows: str


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of one engine's deviating efforts (`crosscheck.causes.diagnosis`).

    words : the sentence for the reader; named : cause, target, words, what it leaves [-], for each that explains it
    separate : the motion that would tell them apart; difference, noise : largest, over the range [-]
    repaired : largest difference left after the repair, over the range [-], None where there is none; where : which side
    """

    mechanism: str
    case: str
    engine: str
    reference: str
    words: str = ""
    named: tuple[NamedCause, ...] = ()
    separate: str = ""
    difference: float | None = None
    noise: float | None = None
    repaired: float | None = None
    where: str = ""


Row = TypeVar("Row", RunRow, Comparison, Check)


class BlessedNight(TypedDict, total=False):
    """The night that results were judged against; gone : names of what is measured no more, gone_keys : keys of these.

    Empty where nothing was judged so.
    """

    reason: str
    date: str
    versions: Mapping[str, str]
    gone: Sequence[str]
    gone_keys: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Results:
    """Everything that a report says.

    settings : of the run, and what a reader has to know of it (failures, by what failed)
    certificates : what the engines' own models say, line by line; diagnoses : why engines deviate
    baseline : the blessed night that it was judged against: reason, date, versions, what is gone (`crosscheck.verdicts.baseline`)
    changes : what is different from an earlier night (`crosscheck.verdicts.changes`)
    moves : values of engines that are not what was blessed (`crosscheck.verdicts.signals`)
    """

    started: str
    command: str = ""
    elapsed: float = 0.0
    finished: bool = False
    message: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    machine: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    engines: tuple[EngineRow, ...] = ()
    cases: tuple[CaseRow, ...] = ()
    runs: tuple[RunRow, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    studies: tuple[StudyRow, ...] = ()
    certificates: tuple[Check, ...] = ()
    diagnoses: tuple[Diagnosis, ...] = ()
    baseline: BlessedNight = field(default_factory=BlessedNight)
    changes: NightChanges = field(default_factory=NightChanges)
    moves: tuple[Move, ...] = ()

    @property
    def moves_by_reason(self) -> dict[str, list[Move]]:
        """Return the values that have moved since they were blessed, by what else has changed: one change each."""
        groups: dict[str, list[Move]] = {}
        for move in self.moves:
            groups.setdefault(move.reason, []).append(move)
        return groups

    @cached_property
    def comparisons_of(self) -> Mapping[Place, tuple[Comparison, ...]]:
        """Return the comparisons of every engine in every case."""
        return _split_by_place(self.comparisons)

    @cached_property
    def runs_of(self) -> Mapping[Place, tuple[RunRow, ...]]:
        """Return the runs of every engine in every case: one, where it has run."""
        return _split_by_place(self.runs)

    @cached_property
    def certificates_of(self) -> Mapping[Place, tuple[Check, ...]]:
        """Return the lines of every engine's certificate in every case."""
        return _split_by_place(self.certificates)

    @property
    def compared(self) -> bool:
        """Return True if anything was compared: two engines in one quantity, or a study."""
        return any(c.maximum is not None for c in self.comparisons) or any(s.rows for s in self.studies)

    @property
    def verdicts(self) -> list[Verdict]:
        """Every verdict that counts for the exit code."""
        rows: list[Verdict] = ["error"] if self.message or not self.finished or not (self.cases or self.studies) else []
        rows += ["error" for case in self.cases if case.problem]
        rows += ["error"] if self.cases and not self.compared else []  # skipped is not passed
        rows += [run.verdict for run in self.runs]
        rows += [one.verdict for one in self.comparisons]
        rows += ["deviation" for line in self.certificates if is_failing(line)]
        gone = len(self.baseline.get("gone", ()))  # what was compared once and is no more
        rows += ["deviation"] * (gone + len(self.moves_by_reason))
        return rows + [study.verdict for study in self.studies]

    @property
    def exit_code(self) -> int:
        """0 all within limits, 1 a deviation or a missing limit, 2 an engine or the harness failed."""
        return compute_exit_code(self.verdicts)


def _split_by_place(rows: Iterable[Row]) -> dict[Place, tuple[Row, ...]]:
    groups: dict[Place, list[Row]] = {}
    for row in rows:
        groups.setdefault((row.mechanism, row.case, row.engine), []).append(row)
    return {place: tuple(group) for place, group in groups.items()}


def is_failing(line: Check) -> bool:
    """Return True if a line of a certificate does not hold; an engine without a certificate has no such line."""
    return not line.holds and line.what != NO_CERTIFICATE


def write(results: Results, file: Path) -> None:
    """Write ``results.json``: whole or not at all, whatever happens meanwhile.

    A number that JSON cannot say (inf, nan) stands as null, and the message of the results says how many there are: such a file
    is of a run that failed, but it holds all that has finished.
    """
    plain = {"schema": SCHEMA, "exit_code": results.exit_code, **dataclasses.asdict(results)}
    for row, one in zip(plain["comparisons"], results.comparisons, strict=True):
        share = one.fraction
        row["fraction"] = share if share is not None and share < float("inf") else None
    try:
        text = json.dumps(plain, indent=1, allow_nan=False)
    except ValueError:
        text = json.dumps(_replace_unsayable(plain), indent=1, allow_nan=False)
    owned.write(file, text + "\n")


def _replace_unsayable(plain: Mapping[str, object]) -> dict[str, object]:
    """Return JSON values in which null stands for every number that is not finite, with a message that says so."""
    places: list[str] = []

    def replace_value(value: object, place: str) -> object:
        if isinstance(value, Mapping):
            return {str(key): replace_value(item, f"{place}.{key}") for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [replace_value(item, f"{place}[{k}]") for k, item in enumerate(value)]
        if isinstance(value, float) and not math.isfinite(value):
            places.append(place.removeprefix("."))
            return None
        return value

    made = {key: replace_value(value, f".{key}") for key, value in plain.items()}
    words = f"numbers that are not finite stand as null: {len(places)}, the first is {places[0]}"
    message = "; ".join(filter(None, [str(made["message"]), words]))
    return made | {"message": message, "exit_code": compute_exit_code(["error"])}


def read(file: Path) -> Results:
    """Read ``results.json``.  Raises ValueError where it is none, or one of another version."""
    plain = json.loads(file.read_text(encoding="utf-8"))
    if not isinstance(plain, dict) or plain.get("schema") != SCHEMA:
        raise ValueError(f"{file} is not a results file of schema {SCHEMA}")
    rows = {name: tuple(_make_row(kind, row) for row in plain.get(name, ())) for name, kind in TABLES.items()}
    known = {f.name for f in dataclasses.fields(Results)}
    values: Mapping[str, Any] = {name: value for name, value in plain.items() if name in known} | rows
    return Results(**values)


TABLES: dict[str, type] = {
    "engines": EngineRow,
    "cases": CaseRow,
    "runs": RunRow,
    "comparisons": Comparison,
    "studies": StudyRow,
    "certificates": Check,
    "diagnoses": Diagnosis,
    "moves": Move,
}


def _make_row(kind: type, row: Mapping[str, Any]) -> Any:
    return kind(**collect_row_values(kind, row))


def collect_row_values(kind: type, row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a dataclass that a row of JSON has, lists as tuples [units of the fields]; other keys are left out."""
    names = {f.name for f in dataclasses.fields(kind)}
    return {key: tuple(value) if isinstance(value, list) else value for key, value in row.items() if key in names}


def make_slug(text: str) -> str:
    """Return a name that is safe in a path and a link; one that had to be changed gets a mark of its own."""
    safe = re.sub(r"[^A-Za-z0-9_-]+", "_", text)[:80]
    return safe if safe == text != "" else f"{safe}-{sha256(text.encode()).hexdigest()[:8]}"


def format_current_time() -> str:
    """Return date and time with the zone, to the second."""
    return datetime.datetime.now().astimezone().isoformat(timespec="seconds")


def describe_machine() -> dict[str, str]:
    """Return the properties of this machine that timings depend on."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": read_processor_name(),
        "cores": str(cores),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
    }


def read_processor_name() -> str:
    """Return the name of the processor."""
    try:
        names = re.findall(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()


def list_versions() -> dict[str, str]:
    """Return the installed versions of the packages that results depend on."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return versions
