"""Options that commands which write libraries share, and what they say at the end."""

from __future__ import annotations

from pathlib import Path

import click

from flexinv.export.export_c import ExportedLibrary
from flexinv.export.machine_code import NATIVE, TARGETS

OUT = click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder that is written."
)
PROCESSORS = click.option(
    "--target", "targets", multiple=True, default=(NATIVE,), show_default=True, type=click.Choice(list(TARGETS)),
    help="Processor (may be repeated): this machine's, or any of a kind. A package of ROS links the first.",
)  # fmt: skip
START = click.option(
    "--start",
    metavar="NUMBERS",
    help="Links that bend: q where they begin at rest [rad], [m]: --start 0.5,-1; loops: near it.",
)
PAYLOADS = click.option(
    "--payload", "payloads", multiple=True, metavar="LINK",
    help="Links that bend, or are carried by some: LINK carries something that changes while the library runs (may be repeated).",
)  # fmt: skip
OVERWRITE_FOLDER = click.option("--overwrite", is_flag=True, help="Write into a folder that has files in it.")


def write_made(made: ExportedLibrary, library: Path) -> None:
    """Print what was written, and what is to be run in the folder of the library where no compiler was found [-]."""
    click.echo(f"wrote {made.name}, {len(made.files)} files, into {made.folder}")
    if made.to_link:
        click.echo(f"no C compiler was found for all targets; run in {library}:")
        for line in made.to_link:
            click.echo(f"  {line}")
