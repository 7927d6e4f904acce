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
from pathlib import Path

import click

from campaigns.thresholds.constants import FACTORS, LOGS, TORQUES, Threshold, list_thresholds, replace_threshold
from campaigns.thresholds.trials import COUNTED, COUNTS

FILE = Path(__file__).resolve().parent / "thresholds.csv"
FIELDS = ("kind", "module", "name", "factor", "value", *COUNTED, "seconds")
AS_IT_IS = "as it is"


def read_results() -> list[dict[str, str]]:
    """Return the lines of thresholds.csv [words]."""
    if not FILE.is_file():
        return []
    with FILE.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def write_result(
    kind: str, module: str, name: str, factor: str, value: str, counts: Counter[str], begin: float
) -> None:
    """Add a line [words, s of processor time] to thresholds.csv; ``begin`` : processor time at its begin [s]."""
    numbers = [counts[word] for word in COUNTED]
    new = not FILE.is_file()
    with FILE.open("a", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        if new:
            writer.writerow(FIELDS)
        writer.writerow([kind, module, name, factor, value, *numbers, f"{time.process_time() - begin:.0f}"])


def run_threshold(threshold: Threshold, factor: float) -> None:
    """Run the faults of a kind with one threshold times a factor [-]."""
    begin = time.process_time()
    with replace_threshold(threshold, factor) as value:
        counts = COUNTS[threshold.kind]()
    module = threshold.module.removeprefix("crosscheck.")
    write_result(threshold.kind, module, threshold.name, f"{factor:g}", str(value), counts, begin)


def format_table(results: list[dict[str, str]]) -> str:
    """Return what stands as a table in Markdown: counts [-] of right, not named and wrong for each threshold and factor."""
    cells: dict[tuple[str, str, str], dict[str, str]] = {}
    for row in results:
        counts = " / ".join(row[word] for word in COUNTED)
        cells.setdefault((row["kind"], row["module"], row["name"]), {})[row["factor"]] = counts
    lines = ["| threshold | halved | doubled |", "|---|--:|--:|"]
    for (kind, module, name), found in cells.items():
        if module:
            lines.append(f"| `{module}.{name}` | {found.get('0.5', '')} | {found.get('2', '')} |")
        else:
            lines.append(f"| {kind}, {AS_IT_IS} | {found.get('1', '')} | |")
    return "\n".join(lines)


@click.command(help=__doc__)
@click.option("--kind", type=click.Choice([TORQUES, LOGS]), multiple=True, default=[LOGS, TORQUES])
@click.option("--only", default="", help="The thresholds of this name.")
@click.option("--table", is_flag=True, help="Run nothing: show what stands.")
def main(kind: tuple[str, ...], only: str, table: bool) -> None:
    """Run the campaign [-]."""
    known = {(row["kind"], row["module"], row["name"], row["factor"]) for row in read_results()}
    for one in () if table else kind:
        if (one, "", AS_IT_IS, "1") not in known:
            begin = time.process_time()
            write_result(one, "", AS_IT_IS, "1", "", COUNTS[one](), begin)
        for threshold in list_thresholds(one):
            for factor in FACTORS:
                key = (one, threshold.module.removeprefix("crosscheck."), threshold.name, f"{factor:g}")
                if key not in known and only in ("", threshold.name):
                    run_threshold(threshold, factor)
    click.echo(format_table(read_results()))


if __name__ == "__main__":
    main()
