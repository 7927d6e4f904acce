"""``crosscheck init``: a project of one's own: mechanisms, engines, reports."""

from __future__ import annotations

from pathlib import Path

import click

from crosscheck.commands.shared.terminal import Failure
from crosscheck.workflows.skeleton import write
from flexinv.errors import InputError


@click.command("init", short_help="Write a project of your own: models, an engine, crosscheck.toml.")
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path), default=Path())
def command(folder: Path) -> None:
    """Write the skeleton of a project into FOLDER (this one without a name): it runs as it is.

    A mechanism, an engine of your own in Python, and crosscheck.toml, which names it; README.md there says how to go on.
    """
    try:
        files = write(folder)
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    for file in files:
        click.echo(f"wrote {file}")
    click.echo("next: crosscheck trust, then crosscheck run")
