"""One fault, tried: planted in an engine that is run for real, compared, judged and diagnosed as `crosscheck run` does it."""

from __future__ import annotations

import importlib
import json
import time as clock
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from campaigns.beyond.catalogue import DrawnFault, make_fault
from campaigns.beyond.fault import Fault, FaultScenario
from campaigns.beyond.judge import Outcome, judge_fault
from campaigns.beyond.planting import apply_fault
from crosscheck.causes.fit import Columns
from crosscheck.engines import ENGINES
from crosscheck.engines.job_files import CaseJobFile
from crosscheck.measures.certificate import Check
from crosscheck.measures.limits import REFERENCE, find
from crosscheck.measures.record import Record, RecordError, check, read_record
from crosscheck.run.child import run_case
from crosscheck.run.isolation import Attempt
from crosscheck.run.questions import Question, list_questions
from crosscheck.run.result_rows import compare_all, run_row
from crosscheck.verdicts.bars import find_checked_bar
from crosscheck.verdicts.certificates import judge_by_certificate, list_certificate_lines
from crosscheck.verdicts.compare import Comparison, compute_fraction, scale_of, split_by_unit
from crosscheck.verdicts.plan import Plan, Task, discover, make_case_row
from crosscheck.verdicts.repeatability import is_doubtful, judge_by_repetition
from crosscheck.verdicts.results import Results

Effect = Literal["above", "between", "below"]
TOLD = ("deviation", "error", "unjudged")


@dataclass(frozen=True)
class TrialLocation:
    """Place of a trial: folder of models, mechanism, case, engine, and the folder of unharmed records."""

    models: str
    mechanism: str
    case: str
    engine: str
    records: str

    def make_record_path(self, engine: str) -> Path:
        """The files of an unharmed record."""
        return Path(self.records) / f"{self.mechanism}-{self.case}-{engine}"

    @property
    def task(self) -> Task:
        """The case as it is run."""
        return discover(Path(self.models), (f"{self.mechanism}/{self.case}",)).tasks[0]

    def make_job(self, engine: str, out: Path) -> CaseJobFile:
        """Return the instructions for the process of an engine."""
        return {
            "kind": "run",
            "engine": engine,
            "module": ENGINES[engine].module,
            "mechanism": str((Path(self.models) / self.mechanism).resolve()),
            "case": self.case,
            "options": {},
            "out": str(out),
        }

    def read_setup(self) -> FaultScenario:
        """The scene of the unharmed reference.  Raises RecordError where there is none."""
        task = self.task
        return FaultScenario(task.mechanism, task.case, self.engine, read_record(self.make_record_path(REFERENCE)))


@dataclass(frozen=True)
class HarmedRun:
    """Findings of a run on a harmed engine, before causes are asked for.

    questions : those of the deviations; effect : of the fault, and most : its largest over its bar [-], `compute_effect`
    deviate : the comparison says so
    """

    engine: str
    fault: Fault
    results: Results
    questions: tuple[Question, ...]
    effect: Effect
    most: float | None
    deviate: bool

    @property
    def failed(self) -> list[str]:
        """The lines of the certificate that fail."""
        return [line.what for line in self.results.certificates if not line.holds]


def prepare(places: Sequence[Mapping[str, str]]) -> list[dict[str, Any]]:
    """Run engines unharmed, the reference among them, and keep their records; return what became of each."""
    rows = []
    for words in places:
        place = TrialLocation(**words)
        start = clock.perf_counter()
        stem = place.make_record_path(place.engine)
        stem.parent.mkdir(parents=True, exist_ok=True)
        run_case(place.make_job(place.engine, stem))
        record = read_record(stem)
        row = {"mechanism": place.mechanism, "case": place.case, "engine": place.engine, "status": record.status}
        rows.append({**row, "message": record.message, "seconds": clock.perf_counter() - start})
    return rows


def run_trials(place: Mapping[str, str], drawn: Sequence[Mapping[str, Any]], lines: str, scratch: str) -> int:
    """Try faults one after the other, adding a line of JSON to a file for each; return how many were tried.

    A fault of number 0 is none: the unharmed engine, which has to be left alone.
    """
    here = TrialLocation(**place)
    scene = here.read_setup()
    columns = Columns()
    for words in drawn:
        one = DrawnFault(**{**words, "recipes": tuple(words["recipes"]), "sizes": tuple(words["sizes"])})
        with Path(lines).open("a", encoding="utf-8") as file:
            file.write(json.dumps(run_trial(here, scene, one, Path(scratch), columns)) + "\n")
    return len(drawn)


def run_trial(
    place: TrialLocation,
    scenario: FaultScenario,
    drawn_fault: DrawnFault,
    scratch: Path,
    columns: Columns | None = None,
) -> dict[str, Any]:
    """Return everything about one fault: what was planted, what it changed, what was said, and the outcome."""
    start = clock.perf_counter()
    fault = make_fault(drawn_fault, scenario) if drawn_fault.number else Fault("nothing", ())
    if fault is None:
        raise ValueError(
            f"fault {drawn_fault.number} cannot be made again: the mechanism or the catalogue is another one"
        )
    row: dict[str, Any] = {
        "number": drawn_fault.number,
        "mechanism": place.mechanism,
        "case": place.case,
        "engine": place.engine,
        "recipe": drawn_fault.name,
        "topic": drawn_fault.topic,
        "seed": drawn_fault.seed,
        "fault": fault.words,
        "right": [[asdict(truth) for truth in part] for part in fault.parts],
    }
    try:
        with apply_fault(fault, place.engine):
            run = run_harmed_engine(place, scenario, fault, scratch / f"fault{drawn_fault.number}-{place.engine}")
            row |= _describe_refusal(run) if isinstance(run, Record) else ask_for_causes(run, columns)
    except Exception as error:
        traceback.print_exc()
        row |= {"outcome": "failed", "words": f"{type(error).__name__}: {error}"}
    return row | {"seconds": round(clock.perf_counter() - start, 2)}


def run_harmed_engine(place: TrialLocation, scenario: FaultScenario, fault: Fault, stem: Path) -> HarmedRun | Record:
    """Run the harmed engine and compare; return what a run has to ask then, or its record where it refuses.

    The fault is planted meanwhile; stem : of the record's files, which the questions are about
    """
    task = place.task
    stem.parent.mkdir(parents=True, exist_ok=True)
    run_case(place.make_job(place.engine, stem))
    record = _read(stem, task)
    if record.status != "ok":
        return record
    reference = scenario.reference
    unharmed = read_record(place.make_record_path(place.engine))
    records = {REFERENCE: reference, place.engine: record}
    rows, _ = compare_all(task, records)
    lines = list_certificate_lines(task, records)
    deviate = any(row.verdict in TOLD for row in rows)
    rows = judge_by_certificate(rows, lines)
    if any(map(is_doubtful, rows)):  # as a run does: bars that explain a difference are those of an engine that repeats
        run_case(place.make_job(place.engine, twice := stem.with_name(f"{stem.name}-again")))
        again = {REFERENCE: reference, place.engine: _read(twice, task)}
        rows = [judge_by_repetition(row, records, again) if is_doubtful(row) else row for row in rows]
    series = {REFERENCE: str(place.make_record_path(REFERENCE).resolve()), place.engine: str(stem.resolve())}
    results = _make_results(task, records, rows, lines, series)
    effect, most = compute_effect(fault, task, reference, unharmed, record)
    deviate |= any(row.verdict in TOLD and not row.uncertified for row in rows)
    questions = list_questions(results, Plan((task,)), Path("/"))
    return HarmedRun(place.engine, fault, results, tuple(questions), effect, most, deviate)


def ask_for_causes(run: HarmedRun, columns: Columns | None) -> dict[str, Any]:
    """Ask why a harmed engine deviates; return what came out, and the outcome.  The fault is planted meanwhile."""
    answers = [_ask_question(question.job, columns) for question in run.questions]
    named = [one for answer in answers for one in answer.get("named", ())]
    failed = run.failed
    alarm = run.results.exit_code != 0 or bool(failed)
    rows = run.results.comparisons
    return {
        "effect": run.effect,
        "times_the_bar": run.most,
        "exit_code": run.results.exit_code,
        "verdicts": {f"{r.quantity} [{r.unit}]": r.verdict for r in rows if r.engine == run.engine},
        "certificate_fails": failed,
        "named": [{k: one.get(k) for k in ("cause", "target", "words")} for one in named],
        "words": " ".join(str(answer.get("words", "")) for answer in answers),
        "outcome": _judge_trial(named, run.fault, run.effect, alarm, run.deviate, failed),
    }


def _describe_refusal(record: Record) -> dict[str, Any]:
    """The row of an engine that does not run with the fault."""
    return {"outcome": "refused", "effect": "above", "words": f"{record.status}: {record.message}"}


def _judge_trial(
    named: Sequence[Mapping[str, Any]],
    fault: Fault,
    effect: Effect,
    alarm: bool,
    deviate: bool,
    failed: Sequence[str],
) -> Outcome:
    """Return the outcome; a comparison that deviates although the fault is below the bars is a false alarm.

    A line of the certificate that fails there is none: it looks at the mechanism itself, sharper than the bars of a motion.
    """
    if not fault.parts:  # nothing was planted
        return "wrong" if named else "false alarm" if deviate or failed else "silent"
    result = judge_fault(named, fault, effect, alarm)
    if effect != "below" or result != "silent":
        return result
    return "false alarm" if deviate else "seen" if failed else "silent"


def _read(stem: Path, task: Task) -> Record:
    record = read_record(stem)
    try:
        check(record, task.time)
    except RecordError as error:
        return Record(engine=record.engine, status="error", message=str(error))
    return record


def _make_results(
    task: Task,
    records: Mapping[str, Record],
    rows: Sequence[Comparison],
    lines: Sequence[Check],
    series: Mapping[str, str],
) -> Results:
    """Return the results of a run of these two engines, as far as questions and the exit code need them."""
    runs = [{**asdict(run_row(task, Attempt(record))), "series": series[name]} for name, record in records.items()]
    kind = type(run_row(task, Attempt(next(iter(records.values())))))
    return Results(
        started="",
        finished=True,
        cases=(make_case_row(task),),
        runs=tuple(kind(**run) for run in runs),
        comparisons=tuple(rows),
        certificates=tuple(lines),
    )


def _ask_question(job: Mapping[str, Any], columns: Columns | None) -> dict[str, Any]:
    """Return the answer of a question, asked in this process, where the fault is planted."""
    function = getattr(importlib.import_module(job["module"]), job["function"])
    answer: dict[str, Any] = json.loads(json.dumps(function(**job["options"], columns=columns)))
    return answer


def compute_effect(
    fault: Fault, task: Task, reference: Record, unharmed: Record, harmed: Record
) -> tuple[Effect, float | None]:
    """Return the rank of a fault's effect (above, between or below the bars), and the largest over its bar [-].

    The effect is what the fault changes in the engine's own series, over the range.  The bar is the limit that is stated, or
    what both engines' error bars add up to where that is more; those of the harmed engine count where the fault is one that it
    can see itself (a coarse mesh).  Above: no distance that the unharmed engine had can hide it.  Below: with it the engine
    is still within its limit.
    """
    most = 0.0
    below = True
    seen = False
    for quantity in task.case.quantities:
        limit = find(task.case.limits, quantity, unharmed.engine, REFERENCE, unharmed.version)
        for names in split_by_unit(reference.series, quantity).values():
            known = [n for n in names if n in unharmed.series and n in harmed.series]
            if limit is None or not known:
                continue
            scale = scale_of(reference, quantity, [reference.series[n].values for n in names])
            for n in known:
                change = _compute_difference(harmed, unharmed, n, scale)
                distance = _compute_difference(unharmed, reference, n, scale)
                owners = (unharmed, harmed) if fault.bars else (unharmed,)
                bars = [sum(find_checked_bar(side, n) or 0.0 for side in (one, reference)) for one in owners]
                bar = max(limit.maximum, compute_fraction(max(bars), scale))
                most = max(most, change / bar)
                seen |= change - distance > bar
                below &= change + distance <= limit.maximum
    return "above" if seen else "below" if below else "between", float(f"{most:.3g}") if np.isfinite(most) else None


def _compute_difference(one: Record, other: Record, name: str, scale: float) -> float:
    return compute_fraction(float(np.abs(one.series[name].values - other.series[name].values).max()), scale)
