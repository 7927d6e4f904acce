"""Halve and double each threshold of the causes, do without it, and count what known faults are then called.

    python -m campaigns.thresholds --kind logs           # those of identify --causes
    python -m campaigns.thresholds --kind torques        # those of crosscheck run
    python -m campaigns.thresholds --only SEEN           # one of them
    python -m campaigns.thresholds --change absent       # all of them, one way
    python -m campaigns.thresholds --table               # the table of what stands in thresholds.csv
    python -m campaigns.thresholds --page                # the same, into docs/reference/thresholds.md

Each line goes to thresholds.csv at once; a line that stands there is not run again.
"""

from __future__ import annotations

import csv
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import click

from campaigns.thresholds.absences import REASONS, WITHOUT_ABSENCE
from campaigns.thresholds.constants import (
    ABSENCE,
    LOGS,
    TORQUES,
    find_setter,
    list_changes,
    list_thresholds,
    replace_threshold,
)
from campaigns.thresholds.kept_effects import keep_effects
from campaigns.thresholds.kept_rounds import keep_rounds
from campaigns.thresholds.trials import LISTS
from campaigns.thresholds.verdict import COUNTED, Verdict

FILE = Path(__file__).resolve().parent / "thresholds.csv"
FIELDS = ("kind", "module", "name", "factor", "value", *COUNTED, "changed", "seconds")
PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "thresholds.md"
BEGIN = "<!-- thresholds begin -->"
END = "<!-- thresholds end -->"
AS_IT_IS = "as it is"
NONE = "none"  # of a value that cannot be: a share above 1
KEEP = {LOGS: keep_rounds, TORQUES: keep_effects}


def read_results() -> list[dict[str, str]]:
    """Return the lines of thresholds.csv [words]."""
    if not FILE.is_file():
        return []
    with FILE.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def write_result(
    key: tuple[str, str, str, str], value: str, verdicts: list[Verdict] | None, first: list[Verdict], begin: float
) -> None:
    """Add a line [words, s of processor time] to thresholds.csv.

    key : kind, module, name and factor; first : verdicts with the thresholds as they are; begin : processor time [s]
    verdicts : with the threshold changed, None where it cannot have this value
    """
    counts: Mapping[str, int | str] = dict.fromkeys(COUNTED, NONE)
    changed: int | str = NONE
    if verdicts is not None:
        counts = Counter(one.word for one in verdicts)
        changed = sum(one != other for one, other in zip(verdicts, first, strict=True))
    new = not FILE.is_file()
    with FILE.open("a", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        if new:
            writer.writerow(FIELDS)
        numbers = [counts[word] for word in COUNTED]
        writer.writerow([*key, value, *numbers, changed, f"{time.process_time() - begin:.0f}"])


def run_kind(kind: str, only: str, way: str) -> None:
    """Run the faults of a kind with its thresholds as they are, and with each of them changed.

    only, way : name of a threshold and word of a change, "" for all of them
    """
    known = {(row["kind"], row["module"], row["name"], row["factor"]) for row in read_results()}
    begin = time.process_time()
    with KEEP[kind]() as kept:
        first = LISTS[kind]()
        if (kind, "", AS_IT_IS, "1") not in known:
            write_result((kind, "", AS_IT_IS, "1"), "", first, first, begin)
        tried = [(one, change) for one in list_thresholds(kind) for change in list_changes(one)]
        for threshold, change in tried:
            key = (kind, threshold.module.removeprefix("crosscheck."), threshold.name, describe_change(change))
            if key in known or only not in ("", threshold.name) or way not in ("", key[3]):
                continue
            begin = time.process_time()
            with replace_threshold(threshold, change) as value, kept.use_for(threshold):
                write_result(key, str(value), list_changed_verdicts(kind), first, begin)


def describe_change(change: float | str) -> str:
    """Return the word for a change in thresholds.csv: its factor [-], or that the check is off."""
    return f"{change:g}" if isinstance(change, float) else change


def list_changed_verdicts(kind: str) -> list[Verdict] | None:
    """Return the verdicts of a kind with a threshold changed [-], None where it cannot be what it is."""
    try:
        return LISTS[kind]()
    except (ValueError, ArithmeticError):
        return None


def format_table(results: list[dict[str, str]]) -> str:
    """Return what stands as a table in Markdown.

    A row for each threshold, in the order of the modules: its value, the campaign or test that set it, and for each change the
    counts [-] of right, not named, wrong, and otherwise named than with the thresholds as they are.
    """
    cells: dict[tuple[str, str, str], dict[str, str]] = {}
    for row in results:
        counts = " / ".join(row[word] for word in (*COUNTED, "changed"))
        cells.setdefault((row["kind"], row["module"], row["name"]), {})[row["factor"]] = counts
    lines = ["| threshold | value | set by | halved | doubled | absent |", "|---|---|---|--:|--:|--:|"]
    for kind in (TORQUES, LOGS):
        lines.append(f"| {kind}, {AS_IT_IS} | | | {cells.get((kind, '', AS_IT_IS), {}).get('1', '')} | | |")
        for threshold in list_thresholds(kind):
            place = threshold.module.removeprefix("crosscheck.")
            found = cells.get((kind, place, threshold.name), {})
            reason = WITHOUT_ABSENCE.get(threshold.module, {}).get(threshold.name, "")
            tried = f"{found.get('0.5', '')} | {found.get('2', '')} | {found.get(ABSENCE, reason)}"
            lines.append(f"| `{place}.{threshold.name}` | {threshold.value} | {find_setter(threshold)} | {tried} |")
    reasons = [f"* *{word}*: {reason}" for word, reason in REASONS.items()]
    return "\n".join([*lines, "", "Where there is no absence, the word says why:", "", *reasons])


@click.command(help=__doc__)
@click.option("--kind", type=click.Choice([TORQUES, LOGS]), multiple=True, default=[LOGS, TORQUES])
@click.option("--only", default="", help="The thresholds of this name.")
@click.option("--change", "way", default="", help="One change of them: 0.5, 2 or absent.")
@click.option("--table", is_flag=True, help="Run nothing: show what stands.")
@click.option("--page", is_flag=True, help="Run nothing: write what stands into the page of the documentation.")
def main(kind: tuple[str, ...], only: str, way: str, table: bool, page: bool) -> None:
    """Run the campaign [-]."""
    for one in () if table or page else kind:
        run_kind(one, only, way)
    if page:
        PAGE.write_text(render_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    else:
        click.echo(format_table(read_results()))


def render_page(text: str) -> str:
    """Return the text of the page [-] with the table of what stands between its marks."""
    before, _, rest = text.partition(BEGIN)
    return f"{before}{BEGIN}\n{format_table(read_results())}\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    main()
