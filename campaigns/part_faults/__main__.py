"""Plant faults in meshes and matrices of parts: ``python -m campaigns.part_faults``.

    --only NAME    one fault, with what is said of it
    --each         what is said of each
    --seed N       other sizes, cells and nodes

Each fault is refused by one error that says what was expected and what to write, or found by lint; parts that are right are
silent.  Exit 1 where it is not so.
"""

from __future__ import annotations

from collections import Counter

import click

from campaigns.part_faults.catalogue import list_faults
from campaigns.part_faults.trial import GOOD, try_fault


@click.command(help=__doc__)
@click.option("--only", help="The fault of this name.")
@click.option("--each", is_flag=True, help="Print what is said of each.")
@click.option("--seed", type=int, default=0, help="Of all that is drawn by lot.")
def main(only: str | None, each: bool, seed: int) -> None:
    """Run the campaign [-]."""
    counts: Counter[str] = Counter()
    for planted in list_faults():
        if only is not None and planted.name != only:
            continue
        found = try_fault(planted, seed)
        counts[found.word] += 1
        if only or each or found.word not in GOOD:
            click.echo(f"{found.word:11} {found.name}\n{found.said}\n")
    click.echo(", ".join(f"{count} {word}" for word, count in counts.most_common()))
    raise SystemExit(1 if any(word not in GOOD for word in counts) else 0)


if __name__ == "__main__":
    main()
