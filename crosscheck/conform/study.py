"""The ladder as a table of a report: every engine that is installed climbs it, and every engine of the project.

Engines run as in `crosscheck conform`, each in a process of its own; records and measurements cannot be asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NotRequired, TypedDict

from crosscheck.conform import ladder
from crosscheck.doors.registry import RECORD
from crosscheck.engines import ENGINES, Engine, NamedDoor, describe_missing_package
from crosscheck.measures.limits import REFERENCE, Verdict, find_worst_verdict
from crosscheck.run.isolation import open_scratch_folder
from crosscheck.run.runner import run
from crosscheck.run.work import Options, Work
from crosscheck.verdicts.plan import discover
from crosscheck.verdicts.results import Results
from crosscheck.verdicts.study_table import SideTable, StudyTable

LONGEST = 600.0  # [s] of one engine on one rung: the slowest takes ten seconds, on a machine that is busy a hundred
UNASKED = (REFERENCE, "measured")
TEXT = f"""What `crosscheck conform ENGINE` says, of every engine ({ladder.VERSION}): {len(ladder.RUNGS)} small mechanisms,
each harder than the one before, and what an engine's own model says of itself over all of them. An engine is judged on what it
climbs; what it cannot do is no fault, and where an engine of the project states why a rung does not hold nothing is claimed.
Difference: the largest of all rungs that hold, over the range of the signal."""
COLUMNS = (
    ("engine", "engine", ""),
    ("holds", "rungs that hold", ""),
    ("difference", "largest difference over the range", "-"),
    ("time", "its own time", "s"),
    ("message", "which", ""),
)


class EngineNumbers(TypedDict, total=False):
    """Difference over the range [-], where a rung holds."""

    difference: float


class EngineLine(TypedDict):
    """A line of the table: difference over the range [-], time [s]."""

    engine: str
    holds: str
    difference: NotRequired[float]
    time: float
    message: str
    verdict: Verdict


def run_study(models: str, engines: Sequence[NamedDoor] = ()) -> StudyTable:
    """Return the tables of the report: differences over the range [-], times [s].

    models : not asked, the ladder has its own; engines : doors of the project's own engines (`crosscheck.engines.open_adapter`)
    """
    ladder_engines = list_ladder_engines(engines)
    taking = {REFERENCE: ENGINES[REFERENCE], **ladder_engines}
    with open_scratch_folder() as folder:
        results = run(Work(discover(ladder.FOLDER), taking, (), Options(LONGEST)), folder / "report")
    return make_tables(results, tuple(ladder_engines))


def list_ladder_engines(jobs: Sequence[NamedDoor] = ()) -> dict[str, Engine]:
    """Return the engines that can be asked, by name: ours that are installed, then those of jobs."""
    ours = {name: one for name, one in ENGINES.items() if name not in UNASKED and describe_missing_package(one) is None}
    theirs = (
        Engine(str(j["engine"]), j["module"], "", "", settings=j.get("settings"), path=j.get("path", "")) for j in jobs
    )
    return ours | {one.name: one for one in theirs if one.module != RECORD}


def make_tables(results: Results, engines: tuple[str, ...]) -> StudyTable:
    """Return a row for each engine, and a table with each of its rungs; differences over the range [-], times [s]."""
    rows = list(list_summary_rows(results, engines))
    if not rows:
        return {"status": "skipped", "message": f"no engine beside {REFERENCE} climbs a rung"}
    climbed = {row["engine"] for row in rows}
    idle = [name for name in engines if name not in climbed]
    text = TEXT + (f"\n\nOn no rung: {', '.join(idle)}." if idle else "")
    every = ladder.make_ladder_table(results, tuple(name for name in engines if name in climbed), "")
    verdicts = {
        (_describe_rung(rung.name), name): _judge_rung(results, rung)
        for name in climbed
        for rung in ladder.list_rungs(results, name)
    }
    judged = [{**row, "verdict": verdicts[row["rung"], row["engine"]]} for row in every.rows]
    said = [row for row, rung in zip(judged, every.rows, strict=True) if rung["verdict"] != "skipped"]
    table: SideTable = {"title": "Each rung that was climbed", "columns": list(every.columns), "rows": said}
    return {"text": text, "columns": COLUMNS, "rows": rows, "tables": [table]}


def list_summary_rows(results: Results, engines: tuple[str, ...]) -> Iterator[EngineLine]:
    """Yield the row of each engine that climbed a rung; difference over the range [-], time [s]."""
    for name in engines:
        climbed = [rung for rung in ladder.list_rungs(results, name) if rung.verdict != "skipped"]
        held = [rung for rung in climbed if rung.holds]
        if not climbed:
            continue
        shares = [rung.difference for rung in held if rung.difference is not None]
        fallen = [f"{_describe_rung(rung.name)}: {rung.message}" for rung in climbed if not rung.holds]
        words = ", ".join(_describe_rung(rung.name) for rung in held) or "none"
        numbers: EngineNumbers = {"difference": max(shares)} if shares else {}
        yield {
            "engine": name,
            "holds": f"{len(held)} of {len(climbed)}",
            **numbers,
            "time": sum(rung.time or 0.0 for rung in climbed),
            "message": "; ".join([words, *fallen]),
            "verdict": find_worst_verdict(_judge_rung(results, rung) for rung in climbed),
        }


def _judge_rung(results: Results, rung: ladder.Rung) -> Verdict:
    """The verdict of a rung; as in cases without a limit, nothing is claimed where our engine says why it differs."""
    known = rung.engine in ENGINES and ENGINES[rung.engine].native
    said = any(run.message for run in results.runs if (run.mechanism, run.engine) == (rung.name, rung.engine))
    return "skipped" if rung.verdict == "deviation" and known and said else rung.verdict


def _describe_rung(rung: str) -> str:
    return rung.replace("_", " ")
