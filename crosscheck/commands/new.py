"""``crosscheck new``: a mechanism that runs, to be made one's own."""

from __future__ import annotations

from pathlib import Path

import click

from crosscheck.commands.shared.terminal import Failure
from crosscheck.workflows.scaffold import TEMPLATES, write_from_template, write_from_urdf
from flexinv.errors import InputError


@click.command("new", short_help="Write the two files of a mechanism NAME.")
@click.argument("name")
@click.option("--template", type=click.Choice(TEMPLATES), default="arm", show_default=True, help="What to start from.")
@click.option(
    "--from-urdf",
    "urdf",
    type=click.Path(path_type=Path),
    help="Start from a URDF instead.",
)
@click.option("--free-base", is_flag=True, help="The URDF's root moves freely (it has no drive).")
@click.option(
    "--models",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("models"),
    show_default=True,
    help="Folder of mechanisms; made where it does not exist.",
)
def command(name: str, template: str, urdf: Path | None, free_base: bool, models: Path) -> None:
    """Write the two files of a mechanism NAME: what it is, and what it does.

    They run as they are; every number has its unit in its key, and a wrong one is answered with what to write.

    \b
      crosscheck new crane --template flexible
      crosscheck new ur5 --from-urdf ur5.urdf
    """
    try:
        if urdf is None:
            folder = write_from_template(models, name, template)
        else:
            folder = write_from_urdf(models, name, urdf, "free" if free_base else "fixed")
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    for file in sorted(folder.iterdir()):
        click.echo(f"wrote {file}")
    click.echo(f"next: edit them, then  crosscheck verify {name}")
