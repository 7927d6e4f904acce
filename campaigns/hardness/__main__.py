"""What exported C libraries take of the system, what any call does to them, how many instructions they need, how fast they are.

    python -m campaigns.hardness                      # all of it: two to three hours of one core
    python -m campaigns.hardness memory fuzz          # these shows only
    python -m campaigns.hardness --scale 0.01         # a hundredth of all steps and calls: to see that all is well

It needs a C compiler, valgrind, qemu-user, gcc-aarch64-linux-gnu and libeigen3-dev.  Ends with 1 where a show fails.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import click

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "shared"))  # random mechanisms

from campaigns.hardness.shows import SHOWS
from flexinv.errors import FlexinvError


@click.command(help=__doc__)
@click.argument("names", nargs=-1, type=click.Choice(list(SHOWS)))
@click.option("--scale", default=1.0, show_default=True, help="Part of the steps and calls.")
def main(names: tuple[str, ...], scale: float) -> None:
    """Run the shows [-]."""
    failed = 0
    for name in names or SHOWS:
        click.echo(f"{name}: {(SHOWS[name].__doc__ or '').strip().splitlines()[0]}")
        try:
            for line in SHOWS[name](scale):
                failed += re.search(r"\bWRONG\b", line) is not None  # and not the status WRONG_LAYOUT
                click.echo(f"  {line}")
        except FlexinvError as error:
            failed += 1
            click.echo(f"  FAILED: {error}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
