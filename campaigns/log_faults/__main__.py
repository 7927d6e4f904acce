"""Faults of logs, by somebody who has not read how causes are found: planted, named, judged.

    python -m campaigns.log_faults                    # all of faults.csv; a few minutes
    python -m campaigns.log_faults --only 41          # one row, with what was named
    python -m campaigns.log_faults --every 25         # each 25th row
    python -m campaigns.log_faults --seed 7           # other motions, noise and days
    python -m campaigns.log_faults --each             # the verdict on each row, too

    right         all faults are named, and nothing else
    in set        a right one stands among at most three that are said to be as likely
    in part       one of two is named, and nothing wrong
    unknown       that something is there, and no name
    silent        nothing is said
    wrong name    something is named that is not there, or the log is refused for what it has not
    wrong size    outside of three stated errors and 5 %

The command ends with 1 where wrong names exceed 2 %.
"""

from __future__ import annotations

import sys
from collections import Counter

import click

from campaigns.log_faults.answers import Verdict, judge_causes
from campaigns.log_faults.trial import Row, read_rows, run_row

WORDS = ("right", "in set", "in part", "unknown", "silent", "wrong name", "wrong size")
MOST_WRONG = 0.02  # of the rows may have a wrong name


def find_kind(row: Row) -> str:
    """Return the kind of a row's fault [-]."""
    kinds = [part.split("@")[0].strip() for part in row.faults.split(";") if part]
    if not kinds:
        return f"untouched, {row.day} day"
    return kinds[0] if len(kinds) == 1 else "two faults"


def format_table(verdicts: list[tuple[Row, Verdict]]) -> str:
    """Return the counts of verdicts [-] by kind of fault, and their sums."""
    counts = Counter((find_kind(row), verdict.word) for row, verdict in verdicts)
    totals = Counter(("all", verdict.word) for _, verdict in verdicts)
    lines = ["| fault | " + " | ".join(WORDS) + " |", "|---|" + "--:|" * len(WORDS)]
    for kind in [*dict.fromkeys(find_kind(row) for row, _ in verdicts), "all"]:
        cells = [str((counts + totals)[kind, word] or "") for word in WORDS]
        lines.append(f"| {kind} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


@click.command(help=__doc__)
@click.option("--only", type=int, help="The row with this number.")
@click.option("--every", type=int, default=1, help="Each so-manieth row.")
@click.option("--seed", type=int, default=0, help="Added to the seed of each row.")
@click.option("--each", is_flag=True, help="Print the verdict on each row.")
def main(only: int | None, every: int, seed: int, each: bool) -> None:
    """Run the campaign [-]."""
    rows = [row for row in read_rows() if row.number == only] if only else read_rows()[::every]
    verdicts: list[tuple[Row, Verdict]] = []
    for row in rows:
        trial = run_row(row, seed)
        verdict = judge_causes(row.right, trial.named, trial.refused, row.day == "other")
        verdicts.append((row, verdict))
        if only or each or verdict.word.startswith("wrong"):
            click.echo(
                f"{row.number} {row.machine}, {row.day} day, {row.faults or 'untouched'}: {verdict.word}: {verdict.said}"
            )
        if only:
            click.echo(
                "\n".join([f"right: {row.right}", *(cause.words for cause in trial.named), f"{trial.seconds:.1f} s"])
            )
    click.echo(format_table(verdicts))
    wrong = sum(verdict.word == "wrong name" for _, verdict in verdicts)
    click.echo(f"{wrong} of {len(verdicts)} have a wrong name ({wrong / max(len(verdicts), 1):.1%})")
    sys.exit(int(wrong > MOST_WRONG * len(verdicts)))


if __name__ == "__main__":
    main()
