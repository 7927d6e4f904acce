"""``crosscheck export``: a minimal reproduction of one case in one engine."""

from __future__ import annotations

from pathlib import Path

import click

from crosscheck.commands.shared.options import CONFIG, collect_engines, find_task
from crosscheck.commands.shared.terminal import MODELS, TIMEOUT, Failure
from crosscheck.engines import ENGINES, describe_missing_package
from crosscheck.measures.limits import REFERENCE
from crosscheck.run.reproduce import write_reproduction
from flexinv.errors import InputError

EXPORTED = [name for name, engine in ENGINES.items() if name != REFERENCE and engine.exports]


@click.command("export", short_help="Write what an engine was given as files that need only it.")
@click.argument("name")
@MODELS
@click.option("--case", help="Which case; may be left out where there is only one.")
@click.option(
    "--engine", required=True, help=f"What to write it for: {', '.join(EXPORTED)}, or one of crosscheck.toml."
)
@CONFIG
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), help="Folder; exports/NAME-CASE-ENGINE by default."
)
@TIMEOUT
def command(
    name: str, models: Path, case: str | None, engine: str, config: Path | None, out: Path | None, timeout: float
) -> None:
    """Write what an engine was given, with the motion, the expected torque and a script that compares.

    The folder needs nothing of this project: it goes into a bug report, or into the engine's own viewer.

    \b
      crosscheck export ur5 --engine pinocchio       model.urdf
      crosscheck export ur5 --engine mujoco          model.xml; python run.py --view shows the motion
      crosscheck export flex_one_link --case cycloid --engine exudyn-ge     a script that builds the model
      crosscheck export five_bar_redundant --engine mujoco                  loops as equality constraints of MJCF
    """
    task = find_task(models, name, case)
    known = collect_engines(models, config).engines
    if engine == REFERENCE or engine not in known:
        raise Failure(f"no export is called {engine!r}; known: {', '.join(n for n in known if n != REFERENCE)}")
    if (reason := describe_missing_package(known[engine])) is not None:
        raise Failure(f"{engine}: {reason}")
    folder = out or Path("exports") / f"{name}-{task.case.name}-{engine}"
    try:
        next_step = write_reproduction(task, known[engine], folder, timeout)
    except InputError as error:
        raise Failure(str(error)) from error
    click.echo(f"{folder}: {next_step}")
