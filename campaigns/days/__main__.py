"""Days that differ: does what one day tells hold on another?

    python -m campaigns.days                  # 40 machines; a quarter of an hour of one core
    python -m campaigns.days --count 1 --first 7      # one of them, with everything that was counted
    python -m campaigns.days --gains          # gains of efforts are others each day, too, and are free

Each machine has friction, offsets and temperature of its own on each of three days, `pairs`.  Printed are, with exact 90 %
intervals of the binomial distribution: the channels of the third day of which 80 % or more lie in their bands, the parameters of
two days that differ inside their 90 % intervals, and the logs of the third day in which no cause is named but friction and
offsets.
"""

from __future__ import annotations

from collections.abc import Sequence

import click
import numpy as np
import scipy

from campaigns.days.pairs import Check, run_pair

INSIDE = 0.9  # of the intervals that are printed


def format_count(what: str, checks: Sequence[Check]) -> str:
    """Return the number of checks that are good [-], and the interval of their share."""
    good = sum(check.good for check in checks)
    ends = scipy.stats.binomtest(good, len(checks)).proportion_ci(INSIDE, method="exact")
    parts = [check.part for check in checks]
    mean = "" if np.isnan(parts).all() else f"; {np.mean(parts):.1%} of samples inside on average"
    return f"{what}: {good} of {len(checks)} = {good / len(checks):.1%} ({ends.low:.1%} to {ends.high:.1%}){mean}"


@click.command(help=__doc__)
@click.option("--count", default=40, show_default=True, help="Machines.")
@click.option("--first", default=0, show_default=True, help="Seed of the first one.")
@click.option("--gains", is_flag=True, help="Draw gains of efforts anew each day, too.")
def main(count: int, first: int, gains: bool) -> None:
    """Run the campaign [-]."""
    checks: list[Check] = []
    for seed in range(first, first + count):
        now = run_pair(seed, gains)
        checks += now
        bad = [
            f"{one.what}: {one.place}" + ("" if np.isnan(one.part) else f" {one.part:.1%}")
            for one in now
            if not one.good
        ]
        click.echo(f"{seed}: {'; '.join(bad) or 'all as it should be'}")
    for what in sorted({one.what for one in checks}):
        click.echo(format_count(what, [one for one in checks if one.what == what]))


if __name__ == "__main__":
    main()
