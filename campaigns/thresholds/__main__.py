"""Halve and double each threshold of the causes, and count what known faults are then called.

    python -m campaigns.thresholds --kind logs           # those of identify --causes
    python -m campaigns.thresholds --kind torques        # those of crosscheck run
    python -m campaigns.thresholds --only SEEN           # one of them
    python -m campaigns.thresholds --table               # the table of what stands in thresholds.csv

Each line goes to thresholds.csv at once; a line that stands there is not run again.
"""

from __future__ import annotations

import csv
import time
from collections import Counter
from itertools import product
from pathlib import Path

import click

from campaigns.thresholds.constants import FACTORS, LOGS, SET_BY, TORQUES, Threshold, list_thresholds, replace_threshold
from campaigns.thresholds.kept_effects import keep_effects
from campaigns.thresholds.kept_rounds import keep_rounds
from campaigns.thresholds.trials import COUNTED, LISTS, Verdict

FILE = Path(__file__).resolve().parent / "thresholds.csv"
FIELDS = ("kind", "module", "name", "factor", "value", *COUNTED, "changed", "seconds")
AS_IT_IS = "as it is"
KEEP = {LOGS: keep_rounds, TORQUES: keep_effects}


def read_results() -> list[dict[str, str]]:
    """Return the lines of thresholds.csv [words]."""
    if not FILE.is_file():
        return []
    with FILE.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def write_result(
    key: tuple[str, str, str, str], value: str, verdicts: list[Verdict], first: list[Verdict], begin: float
) -> None:
    """Add a line [words, s of processor time] to thresholds.csv.

    key : kind, module, name and factor; first : verdicts with the thresholds as they are; begin : processor time [s]
    """
    counts = Counter(one.word for one in verdicts)
    changed = sum(one != other for one, other in zip(verdicts, first, strict=True))
    new = not FILE.is_file()
    with FILE.open("a", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        if new:
            writer.writerow(FIELDS)
        numbers = [counts[word] for word in COUNTED]
        writer.writerow([*key, value, *numbers, changed, f"{time.process_time() - begin:.0f}"])


def run_kind(kind: str, only: str) -> None:
    """Run the faults of a kind with its thresholds as they are, and with each of them times each factor."""
    known = {(row["kind"], row["module"], row["name"], row["factor"]) for row in read_results()}
    begin = time.process_time()
    with KEEP[kind]() as kept:
        first = LISTS[kind]()
        if (kind, "", AS_IT_IS, "1") not in known:
            write_result((kind, "", AS_IT_IS, "1"), "", first, first, begin)
        for threshold, factor in product(list_thresholds(kind), FACTORS):
            key = (kind, threshold.module.removeprefix("crosscheck."), threshold.name, f"{factor:g}")
            if key in known or only not in ("", threshold.name):
                continue
            begin = time.process_time()
            with replace_threshold(threshold, factor) as value, kept.use_for(threshold):
                write_result(key, str(value), LISTS[kind](), first, begin)


def format_table(results: list[dict[str, str]]) -> str:
    """Return what stands as a table in Markdown.

    A row for each threshold: its value, the campaign that set it, and for each factor the counts [-] of right, not named,
    wrong, and otherwise named than with the thresholds as they are.
    """
    cells: dict[tuple[str, str, str], dict[str, str]] = {}
    for row in results:
        counts = " / ".join(row[word] for word in (*COUNTED, "changed"))
        cells.setdefault((row["kind"], row["module"], row["name"]), {})[row["factor"]] = counts
    lines = ["| threshold | value | set by | halved | doubled |", "|---|---|---|--:|--:|"]
    for (kind, module, name), found in cells.items():
        if module:
            value = Threshold(kind, f"crosscheck.{module}", name).value
            tried = f"{found.get('0.5', '')} | {found.get('2', '')}"
            lines.append(f"| `{module}.{name}` | {value} | {SET_BY[kind]} | {tried} |")
        else:
            lines.append(f"| {kind}, {AS_IT_IS} | | | {found.get('1', '')} | |")
    return "\n".join(lines)


@click.command(help=__doc__)
@click.option("--kind", type=click.Choice([TORQUES, LOGS]), multiple=True, default=[LOGS, TORQUES])
@click.option("--only", default="", help="The thresholds of this name.")
@click.option("--table", is_flag=True, help="Run nothing: show what stands.")
def main(kind: tuple[str, ...], only: str, table: bool) -> None:
    """Run the campaign [-]."""
    for one in () if table else kind:
        run_kind(one, only)
    click.echo(format_table(read_results()))


if __name__ == "__main__":
    main()
