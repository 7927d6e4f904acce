"""``crosscheck trust``: the programs of crosscheck.toml may run on this machine."""

from __future__ import annotations

from pathlib import Path

import click

from crosscheck.commands.shared.options import CONFIG, collect_engines
from crosscheck.commands.shared.terminal import MODELS, Failure
from crosscheck.doors.registry import SHOWN
from crosscheck.doors.trust import find_store, write_trusted_parts


@click.command("trust", short_help="Allow the programs of crosscheck.toml to run.")
@MODELS
@CONFIG
@click.option("--yes", is_flag=True, help="Without asking.")
def command(models: Path, config: Path | None, yes: bool) -> None:
    """Show what crosscheck.toml runs on this machine, and remember that you trust it.

    A command that is new or has changed since, or one of whose files has changed, is not run before it is trusted again: every
    file below the folder of a script that the command names, as far as it lies in the project.  Not covered is what a program
    reaches elsewhere: the interpreter, installed packages, other folders, the network.  What is remembered is a file of yours,
    outside of the project.
    """
    known = collect_engines(models, config)
    if known.config is None:
        raise Failure(f"there is no crosscheck.toml above {models}; write one there, or --config with its path")
    if not known.programs:
        raise Failure(f"{known.config} names no engines: there is nothing to trust")
    for program in known.programs:
        click.echo(f"{program.name} runs  {program.words}")
        if program.files:
            click.echo(f"  with {len(program.files)} files of this project: {_describe_files(list(program.files))}")
    if not yes and not click.confirm(f"Trust {known.config}?"):
        raise Failure("nothing was changed")
    try:
        write_trusted_parts(known.config, {program.name: program.trusted_parts for program in known.programs})
    except OSError as error:
        raise Failure(f"{find_store()} cannot be written: {error}") from error
    click.echo(f"remembered in {find_store()}")


def _describe_files(files: list[str]) -> str:
    """Return the first names of a list, and how many more there are."""
    more = f" and {len(files) - SHOWN} more" if len(files) > SHOWN else ""
    return ", ".join(files[:SHOWN]) + more
