"""``crosscheck new``: a mechanism that runs, to be made one's own."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import click

from crosscheck.commands.shared.terminal import (
    MEMORY_FOR_FILE,
    TIME_FOR_FILE,
    Console,
    Failure,
    convert_sigterm,
    open_progress,
    replace_control_characters,
)
from crosscheck.run.reading_limits import ReadingLimits
from crosscheck.run.work import Event
from crosscheck.workflows.scaffold import TEMPLATES, write_from_template, write_from_urdf
from crosscheck.workflows.zoo import list_lines, write_from_folder
from flexinv.errors import InputError


@click.command("new", short_help="Write the files of a mechanism NAME, or of a folder of robots.")
@click.argument("name", required=False)
@click.option("--template", type=click.Choice(TEMPLATES), default="arm", show_default=True, help="What to start from.")
@click.option(
    "--from-urdf",
    "urdf",
    type=click.Path(path_type=Path),
    help="Start from a URDF instead; of a folder, a mechanism for each URDF below it (without NAME).",
)
@click.option(
    "--replace", is_flag=True, help="Of a folder: write anew, without asking, what stands already and is another robot."
)
@click.option("--free-base", is_flag=True, help="The URDF's root moves freely (it has no drive).")
@click.option(
    "--models",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("models"),
    show_default=True,
    help="Folder of mechanisms; made where it does not exist.",
)
@TIME_FOR_FILE
@MEMORY_FOR_FILE
def command(
    name: str | None,
    template: str,
    urdf: Path | None,
    replace: bool,
    free_base: bool,
    models: Path,
    timeout: float,
    memory: float,
) -> None:
    """Write the two files of a mechanism NAME: what it is, and what it does.

    They run as they are; every number has its unit in its key, and a wrong one is answered with what to write.

    \b
      crosscheck new crane --template flexible
      crosscheck new ur5 --from-urdf ur5.urdf
      crosscheck new --from-urdf robots/            one for each URDF below the folder

    Of a folder each file is read in a process of its own, within --timeout and --memory, and one that cannot be read keeps no
    other back. Names are those of the files; folders above stand before them where several files share one.

    \b
    Exit codes: 0 all is written; 1 of a folder, some files are not; 2 nothing is
    """
    base = "free" if free_base else "fixed"
    if urdf is not None and urdf.is_dir():
        if name is not None:
            raise click.UsageError(f"{urdf} is a folder: its mechanisms are named by its files; leave out {name!r}")
        _write_many(urdf, models, base, replace, ReadingLimits(timeout, memory))
        return
    if name is None:
        raise click.UsageError("Missing argument 'NAME'; only --from-urdf FOLDER names mechanisms by their files")
    if replace:
        raise click.UsageError("--replace is for --from-urdf FOLDER; remove the mechanism, or write another name")
    try:
        folder = (
            write_from_template(models, name, template) if urdf is None else write_from_urdf(models, name, urdf, base)
        )
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    for file in sorted(folder.iterdir()):
        click.echo(f"wrote {file}")
    click.echo(f"next: edit them, then  crosscheck verify {name}")


def _write_many(folder: Path, models: Path, base: str, replace: bool, limits: ReadingLimits) -> None:
    console = Console(stderr=True)

    def ask(names: Sequence[str]) -> bool:
        if replace or not sys.stdin.isatty():
            return replace
        some = ", ".join(names[:5]) + (" ..." if len(names) > 5 else "")
        return click.confirm(
            f"{len(names)} stand in {models} and hold something else ({some}): write them anew?", err=True
        )

    try:
        with convert_sigterm(), open_progress(console) as notify:

            def update_bar(done: int, total: int, name: str) -> None:
                if console.is_terminal:
                    notify(Event(name, "ok", "", done, total))

            robots = write_from_folder(folder, models, base, ask, limits, update_bar)
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    for line in list_lines(robots):
        click.echo(replace_control_characters(line))
    written = sum(robot.kind in ("written", "there") for robot in robots)
    if not written:
        sys.exit(2)
    click.echo(f"next: crosscheck run --models {shlex.quote(str(models))}")
    sys.exit(0 if written == len(robots) else 1)
