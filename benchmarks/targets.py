"""Speed targets of flexinv by machine, and the measured values: the table on top, and the ratios for the history.

A row of a part carries ``make_metric``: name, value, unit, lower, upper, note.  A limit is a limit like that of a torque: beyond
it the row is a deviation.  The ratios are those of runs side by side in one process; no time by itself has a limit, except those
that somebody waits for (one sample, the first call).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from llvmlite import binding

from crosscheck.measures.limits import Verdict
from crosscheck.verdicts.history import Metric, list_metrics
from crosscheck.verdicts.results import StudyRow, describe_machine

NAME = "bench"
COLUMNS = (
    ("what", "what", ""),
    ("value", "measured", ""),
    ("limit", "asked", ""),
    ("unit", "unit", ""),
    ("spread", "quartiles", ""),
)


def find_vector_width() -> str:
    """Return the widest vectors that compiled code uses here: avx512, avx2 or other."""
    features = binding.get_host_cpu_features()
    return "avx512" if features.get("avx512f") else "avx2" if features.get("avx2") else "other"


def compute_required_speed(times: float) -> float:
    """Return the demanded speed of rigid inverse dynamics as a multiple of others' here [-]: half of it without AVX-512."""
    return times if find_vector_width() == "avx512" else times / 2.0


def make_metric(
    name: str, value: float, unit: str, lower: float | None = None, upper: float | None = None, spread: str = ""
) -> dict[str, Any]:
    """Return the entry of a row for the table of targets and for the history; value, lower and upper in [unit]."""
    return {"name": name, "value": value, "unit": unit, "lower": lower, "upper": upper, "note": spread}


def drop_metric(row: Mapping[str, Any], ratio: str, why: str) -> dict[str, Any]:
    """Return a row whose metric, in the column ``ratio`` [-], says nothing, and why: no verdict, nothing for the history."""
    kept = {key: value for key, value in row.items() if key not in ("metric", ratio)}
    return kept | {"verdict": "skipped", "message": why, "missing": {**row["metric"], "note": why}}


def add_verdict(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with its verdict: within or a deviation where its metric has a limit, within where it has none."""
    own = row.get("metric")
    limited = own is not None and not (own["lower"] is None and own["upper"] is None)
    verdict: Verdict = Metric(**own).verdict if own and limited else "within"
    return {"verdict": verdict, **row}


def make_target_table(tables: Sequence[StudyRow]) -> StudyRow:
    """Return the table of targets: what is asked, what was measured."""
    rows = [
        {
            "what": one.name,
            "value": one.value,
            "limit": _describe_limit(one),
            "unit": one.unit,
            "spread": one.note,
            "verdict": "skipped" if one.verdict == "unjudged" else one.verdict,
        }
        for one in list_metrics(tables)
    ]
    rows += [
        {"what": one.name, "limit": _describe_limit(one), "unit": one.unit, "spread": one.note, "verdict": "skipped"}
        for one in _list_dropped_metrics(tables)
    ]
    rows.sort(key=lambda row: (row["verdict"] != "deviation", "value" in row))
    return StudyRow(NAME, "Speed: what was asked and what was measured", describe_measurement(), COLUMNS, tuple(rows))


def _list_dropped_metrics(tables: Sequence[StudyRow]) -> list[Metric]:
    """Return the metrics that have a limit and could not be measured."""
    found = [Metric(**row["missing"]) for table in tables for row in table.rows if row.get("missing")]
    return [one for one in found if one.lower is not None or one.upper is not None]


def _describe_limit(one: Metric) -> str:
    if one.lower is not None:
        return f"at least {one.lower:g}"
    return "nothing" if one.upper is None else f"at most {one.upper:g}"


def describe_measurement() -> str:
    """Return the words on top: which machine this was, and how it was measured."""
    here = describe_machine()
    width = find_vector_width()
    asked = (
        "The ratios asked of rigid inverse dynamics are those for AVX-512."
        if width == "avx512"
        else "Without AVX-512, as here, half of the ratios is asked of rigid inverse dynamics."
    )
    return (
        f"{here['processor']}, {here['cores']} cores, vectors: {width}. {asked}\n\n"
        "Calls take turns in one process. Each turn of a call begins with a run that is not timed (with 12 ms of runs where "
        "calls have threads, as OpenMP's go on watching for 9 ms; with none where one takes more than 50 ms), so that every "
        "call finds its data and its threads as in a loop of its own, not as others left the caches. "
        "Repetitions are dropped in which the system interrupted the process, or the processors were halves of cores: a loop "
        "of multiplications before or after took a fifth longer than it ever did, or a call of more than 50 ms took 6 % more "
        "of the processor's time than it did at best. Two processors of a virtual machine may be one core for seconds; then "
        "two threads of flexinv, which keeps the arithmetic units busy, are hardly faster than one, "
        "while Pinocchio's, which wait for their own results, still are. Where too few are left the "
        "processor's time is taken, or calls with threads are not judged. Shown are medians, with the quartiles of what stood "
        "side by side (of one and two threads: of each by itself). Targets that could not be measured stand on top. Results are "
        "compared before anything is timed. Rows without a verdict are measured, and nothing is asked of them."
    )
