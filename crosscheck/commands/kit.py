"""``crosscheck kit``: one comparison as a folder for programs that know nothing of this project."""

from __future__ import annotations

from pathlib import Path

import click

from crosscheck.commands.shared.options import find_task
from crosscheck.commands.shared.terminal import MODELS, TIMEOUT, Failure
from crosscheck.engines import ENGINES
from crosscheck.engines.job_files import CaseRequest
from crosscheck.kit.write import write
from crosscheck.measures.limits import REFERENCE
from crosscheck.run.isolation import ChildProcesses, run_engine


@click.command("kit", short_help="Write one case as a folder for any program to answer.")
@click.argument("name")
@MODELS
@click.option("--case", help="Which case; may be left out where there is only one.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Folder; kits/NAME-CASE by default.")
@click.option("--blind", is_flag=True, help="Without expected values: for an answer that nobody can look up.")
@TIMEOUT
def command(name: str, models: Path, case: str | None, out: Path | None, blind: bool, timeout: float) -> None:
    """Write everything about one case of mechanism NAME into a folder: format crosscheck-case/1.

    The mechanism with every default written out, in SI units, the motion as a table, what is asked for, a page that explains
    frames and signs, JSON Schemas, and the expected series with error bars.  The same case gives the same files.

    \b
      crosscheck kit double_pendulum --case swing
      crosscheck kit four_bar --case turn --out kit --blind
    """
    task = find_task(models, name, case)
    folder = out or Path("kits") / f"{name}-{task.case.name}"
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise Failure(f"{folder} is there already: write --out with a new or an empty folder, or remove it")
    expected = None
    if not blind:
        request: CaseRequest = {"mechanism": str(task.folder.resolve()), "case": task.case.name, "options": {}}
        expected = run_engine(ENGINES[REFERENCE], request, task.time, timeout, ChildProcesses()).record
        if expected.status != "ok":
            raise Failure(f"{name}/{task.case.name}: {REFERENCE} gives no expected values: {expected.message}")
    try:
        file = write(task.mechanism, task.case, folder, expected)
    except OSError as error:
        raise Failure(f"{folder} cannot be written: {error}; write --out with another folder") from error
    click.echo(f"wrote {folder} ({file.format}, {file.digest}); read {folder / 'README.md'}")
