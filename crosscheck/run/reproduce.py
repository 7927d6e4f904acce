"""A minimal reproduction: one engine's input for one case, in files that need nothing but that engine and numpy."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

from crosscheck.doors.command import fill_command
from crosscheck.engines import ENGINES, Engine
from crosscheck.engines.job_files import CaseRequest, ExportRequest
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import save
from crosscheck.run.isolation import ChildProcesses, ask, open_scratch_folder, run_engine
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

README = """# {mechanism}/{case} in {engine}

{title}

{use}
| file | what it is |
|---|---|
{table}
"""

SCRIPT = """Needs {needs}, nothing else:

{install}    python run.py

prints how far the efforts that {engine} computes are from `expected.csv` (those of {reference}) and writes `computed.csv`.
"""
PROGRAM = """The folder `kit` is what {engine} was given. Its own program is not here: where that is, it answers the kit by

    {command}

with `kit` and an empty folder `out` beside it; then hold `out/series.csv` against `expected.csv` (efforts of {reference}).
"""

# In this order, of what the export has written.
FILES = {
    "kit": "the case kit, as {engine} was given it: see its README.md",
    "run.txt": "the command of {engine}'s own program, with the folders `kit` and `out`",
    "model*": "the model, as {engine} was given it",
    "motion.csv": "the motion: coordinates, velocities and accelerations, in this engine's order and units [rad], [m], [s]",
    "forces.csv": "given forces [N] and moments [N m], along the axes they are given in",
    "drivers.npz": "what connectors and loads follow, step by step",
    "steps.npz": "the joints' motion at every step",
    "shares.npz": "how efforts of the joints that the motion gives are shared out among the drives, sample by sample",
    "expected.csv": "efforts of the actuators [N m], [N]",
    "settings.json": "what the model's format does not carry: drives, closures, springs",
    "run.py": "computes the efforts and compares",
}


class NoExport(InputError):
    """A mechanism that an engine's export cannot write, however often it is asked."""


def write_reproduction(
    task: Task, engine: Engine, folder: Path, limit: float, children: ChildProcesses | None = None
) -> str:
    """Write the reproduction of ``task`` in ``engine`` into ``folder``, and return what is to be run for it, in words.

    limit : [s] for each of two processes; children : where these start, prepared ones where there are several reproductions

    Raises NoExport where there is no export for the engine or the mechanism, InputError where an engine fails.
    """
    where = f"{task.folder.name}/{task.case.name} in {engine.name}"
    if engine.exports is False:
        raise NoExport(f"{where}: there is no export for {engine.name}")
    mechanism = str(task.folder.resolve())
    request: CaseRequest = {"mechanism": mechanism, "case": task.case.name, "options": {"error": False}}
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} is there already: write --out with a new or an empty folder, or remove it")
    children = children or ChildProcesses()
    with open_scratch_folder() as work:
        expected = run_engine(ENGINES[REFERENCE], request, task.time, limit, children)
        if expected.record.status != "ok":
            raise InputError(f"{where}: {REFERENCE} gives no expected effort: {expected.record.message}")
        save(expected.record, work / "expected")
        (made := work / "made").mkdir()
        job: ExportRequest = {
            "kind": "export",
            **engine.door,
            "engine": engine.name,
            "folder": str(made),
            "mechanism": mechanism,
            "case": task.case.name,
            "expected": str(work / "expected"),
        }
        answer, ending = ask(job, limit, children)
        if not answer:
            raise InputError(f"{where}: {ending.message}")
        if answer["problem"]:
            raise NoExport(f"{where}: {answer['problem']}")
        words = {
            "mechanism": task.folder.name, "case": task.case.name, "title": task.case.title or task.mechanism.title,
            "engine": engine.name, "use": _describe_use(made, engine), "table": "\n".join(_list_file_rows(made, engine)),
        }  # fmt: skip
        (made / "README.md").write_text(README.format(**words), encoding="utf-8")
        try:
            shutil.copytree(made, folder, dirs_exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be written: {error}; write --out with another folder") from error
    return _describe_next_step(folder, engine)


def _describe_use(made: Path, engine: Engine) -> str:
    """Return the part of the README about what is run: a script that was written, or a program of the user's own."""
    told = {"engine": engine.name, "reference": REFERENCE}
    if (command := made / "run.txt").is_file():
        return PROGRAM.format(command=command.read_text(encoding="utf-8").strip(), **told)
    if not (made / "run.py").is_file():
        return ""
    needs = " and ".join(filter(None, [engine.requires, "numpy"]))
    return SCRIPT.format(needs=needs, install=engine.install and f"    {engine.install}\n", **told)


def _describe_next_step(folder: Path, engine: Engine) -> str:
    """Return the command for a folder that was written, in words."""
    if (folder / "run.py").is_file():
        return "python run.py"
    if not (folder / "run.txt").is_file() or engine.settings is None:
        return "see README.md"
    place = folder.resolve()
    words = fill_command(engine.settings["command"], place / "kit", place / "out")
    return f"its program answers the kit there by\n  cd {shlex.quote(engine.settings['folder'])} && {shlex.join(words)}"


def _list_file_rows(folder: Path, engine: Engine) -> Iterator[str]:
    for pattern, words in FILES.items():
        if names := sorted(f.name for f in folder.glob(pattern)):
            yield f"| {', '.join(names)} | {words.format(engine=engine.name)} |"
