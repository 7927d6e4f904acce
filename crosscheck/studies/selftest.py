"""The tables of ``crosscheck selftest``: one per bench with every fault, and the matrix planted x named over all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TypedDict, cast

from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.fault_benches import BENCHES
from crosscheck.causes.selftest import CLEAN, FOUND, MATTERS, RANK, SIZES, PlantedFault, run_bench
from crosscheck.causes.single_samples import NAME as SINGLE
from crosscheck.measures.limits import Verdict
from crosscheck.studies import Study
from crosscheck.verdicts.results import StudyRow
from crosscheck.verdicts.study_table import StudyTable

ENOUGH = 0.95  # of the faults that matter have to be named
FEWEST = 25  # causes
ALL = (*DICTIONARY, RANK, SINGLE)  # each of them has to be named alone somewhere
ALONE = "alone"
NOWHERE = "nowhere"
MARKS = {"alone": "●", "first": "◐", "in the set": "○", "another": "✗", "none": "–", "unseen": "·", "silent": "●"}
WORDS = (
    "● named alone, ◐ named first, ○ in the printed set that the motion cannot tell apart, ✗ another cause, – none named, "
    "· below the error bars. Of several sizes and places the worst mark is shown; faults that change the effort by less than "
    "1 % of its range are left out unless they were named."
)
PLACES = (("number", "number", ""), ("bench", "mechanism, motion and engine", ""))
ORDER = ("another", "none", "unseen", "in the set", "first", "alone", "silent")  # the worst first
TEXT = """Every cause of the dictionary, planted in this engine's model, motion or options, in several sizes, at the first and
at the last place where it shows. The reference stays unharmed; only the difference of the efforts is looked at. "Change" is
the largest change of an effort over its range; faults that change it by less than 1 % need not be found."""
COLUMNS = (
    ("cause", "planted", ""),
    ("target", "where", ""),
    ("size", "size", ""),
    ("change", "change", "of the range"),
    ("outcome", "outcome", ""),
    ("named", "named", ""),
)


class JudgedFault(TypedDict):
    """A line of a bench: a planted fault as in `crosscheck.causes.selftest.PlantedFault`, and the verdict on it."""

    bench: str
    cause: str
    target: str
    size: float
    change: float
    outcome: str
    named: str
    words: str
    verdict: Verdict


def run_study(models: str, bench: int, sizes: Sequence[float] = SIZES, targets: int = 2) -> StudyTable:
    """Return the table of one bench, by its number; sizes [-] of the sizes that matter."""
    rows = run_bench(BENCHES[bench], Path(models), sizes, targets=targets)
    table = [asdict(row) | {"named": "; ".join(row.named) or row.words, "verdict": judge_fault(row)} for row in rows]
    return {"text": TEXT, "columns": COLUMNS, "rows": table}


def list_studies(models: Path, names: Sequence[str]) -> tuple[Study, ...]:
    """Return the studies of the benches whose mechanism is named, of all where none is."""
    return tuple(
        Study(
            f"selftest {bench.label}",
            f"Planted faults: {bench.label}",
            "crosscheck.studies.selftest",
            options={"models": str(models.resolve()), "bench": k},
        )
        for k, bench in enumerate(BENCHES)
        if not names or bench.mechanism in names
    )


def judge_fault(fault: PlantedFault) -> Verdict:
    """Return the verdict on a planted fault: found, missed, or too small to have to be found."""
    if fault.outcome in FOUND:
        return "within"
    return "deviation" if fault.change >= MATTERS or fault.cause == CLEAN else "skipped"


def build_summary(tables: Iterable[StudyRow], whole: bool = True) -> StudyRow:
    """Return the matrix planted x named: a row per cause, a column per bench, and at the end a row per target.

    whole : all benches ran, so that every cause has to be planted and named alone somewhere
    """
    rows = collect_faults(tables)
    benches = list(dict.fromkeys(row["bench"] for row in rows))
    planted = dict.fromkeys(row["cause"] for row in rows)
    causes = dict.fromkeys((*planted, *ALL)) if whole else planted
    matrix = [_make_cause_row(cause, benches, rows, whole) for cause in causes]
    numbered = ((b, str(k + 1), "") for k, b in enumerate(benches))
    columns = (("cause", "planted", ""), *numbered, (ALONE, "named alone on", ""))
    blank = dict.fromkeys((key for key, _, _ in columns), "")
    return StudyRow(
        "selftest",
        "The checker is checked: planted causes by mechanism",
        text=f"{describe_outcomes(rows)}\n\n{WORDS}",
        columns=columns,
        rows=tuple(blank | line for line in (*matrix, *_list_target_rows(rows, whole))),
        tables=({"title": "Where faults were planted", "columns": PLACES, "rows": _list_bench_places(benches)},),
    )


def _list_bench_places(benches: Sequence[str]) -> tuple[dict[str, str], ...]:
    return tuple({"number": str(k + 1), "bench": bench} for k, bench in enumerate(benches))


def _make_cause_row(cause: str, benches: Sequence[str], rows: Sequence[JudgedFault], whole: bool) -> dict[str, str]:
    mine = [row for row in rows if row["cause"] == cause]
    shown = {b: _choose_mark([r for r in mine if r["bench"] == b]) for b in benches}
    alone = next((row["bench"] for row in mine if row["outcome"] == "alone"), NOWHERE if cause != CLEAN else "")
    missed = any(row["verdict"] == "deviation" for row in mine) or (whole and alone == NOWHERE)
    return {"cause": cause, **shown, ALONE: alone, "verdict": "deviation" if missed else "within"}


def _choose_mark(rows: Sequence[JudgedFault]) -> str:
    counted = [r for r in rows if r["change"] >= MATTERS or r["outcome"] in FOUND]
    outcomes = {r["outcome"] for r in (counted or rows)}
    return next((MARKS[o] for o in ORDER if o in outcomes), "")


def count_outcomes(rows: Sequence[JudgedFault]) -> dict[str, int]:
    """Return the counts that the targets are stated for."""
    planted = [r for r in rows if r["cause"] != CLEAN]
    matter = [r for r in planted if r["change"] >= MATTERS]
    causes = {r["cause"] for r in planted}
    return {
        "causes": len(causes),
        "planted": len(planted),
        "matter": len(matter),
        "named": sum(r["outcome"] in FOUND for r in matter),
        "alone": len({r["cause"] for r in planted if r["outcome"] == "alone"}),
        "clean": sum(r["cause"] == CLEAN for r in rows),
        "false": sum(r["cause"] == CLEAN and r["outcome"] != "silent" for r in rows),
    }


def collect_faults(tables: Iterable[StudyRow]) -> list[JudgedFault]:
    """Return the rows of all benches that ran; tables : as `run_study` makes them."""
    return [cast(JudgedFault, row) for table in tables if table.status == "ok" for row in table.rows]


def judge_targets(tables: Iterable[StudyRow], whole: bool = True) -> list[dict[str, str]]:
    """Return the demands on the benches, the values reached, and the verdict, one line each."""
    return _list_target_rows(collect_faults(tables), whole)


def _list_target_rows(rows: Sequence[JudgedFault], whole: bool) -> list[dict[str, str]]:
    """Return the demands, the values reached, and the verdict, one line each."""
    counts = count_outcomes(rows)
    alone = {r["cause"] for r in rows if r["outcome"] == "alone"}
    missing = [cause for cause in ALL if cause not in alone]
    share = counts["named"] / counts["matter"] if counts["matter"] else 0.0
    of_all = (
        (f"at least {FEWEST} causes", str(counts["causes"]), counts["causes"] >= FEWEST),
        (
            "each cause named alone on at least one mechanism",
            f"all {len(ALL)}" if not missing else f"not {', '.join(missing)}",
            not missing,
        ),
    )
    of_any = (
        (
            f"of the faults that change an effort by {MATTERS:.0%} of its range or more, {ENOUGH:.0%} named first or in the set",
            f"{counts['named']} of {counts['matter']} ({share:.1%})",
            bool(counts["planted"]) and counts["named"] >= ENOUGH * counts["matter"],
        ),
        ("no false cause on unharmed mechanisms", f"{counts['false']} on {counts['clean']}", not counts["false"]),
    )
    lines = (*of_any, *(of_all if whole else ()))
    return [{"cause": what, ALONE: found, "verdict": "within" if good else "deviation"} for what, found, good in lines]


def describe_outcomes(rows: Sequence[JudgedFault]) -> str:
    """Return the figures in words."""
    counts = count_outcomes(rows)
    share = counts["named"] / counts["matter"] if counts["matter"] else 0.0
    return (
        f"{counts['causes']} causes planted {counts['planted']} times; of {counts['matter']} faults that change an effort by 1 % "
        f"of its range or more, {counts['named']} ({share:.1%}) are named first or in the printed set; {counts['alone']} causes "
        f"are named alone on at least one mechanism; {counts['false']} false causes on {counts['clean']} unharmed mechanisms."
    )
