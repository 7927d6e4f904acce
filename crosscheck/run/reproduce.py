"""A minimal reproduction: one engine's input for one case, in files that need nothing but that engine and numpy."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

from crosscheck.engines import ENGINES, Engine
from crosscheck.engines.job_files import CaseRequest, ExportRequest
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import save
from crosscheck.run.isolation import ChildProcesses, ask, open_scratch_folder, run_engine
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

README = """# {mechanism}/{case} in {engine}

{title}

Needs {requires} and numpy, nothing else:

    {install}
    python run.py

prints how far the efforts that {engine} computes are from `expected.csv` (those of {reference}) and writes `computed.csv`.

| file | what it is |
|---|---|
{table}
"""


# In this order, of what the export has written.
FILES = {
    "kit": "the case kit, as {engine} was given it: see its README.md",
    "run.txt": "the command that answers it, run beside the kit",
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


def write_reproduction(task: Task, engine: Engine, folder: Path, limit: float) -> None:
    """Write the reproduction of ``task`` in ``engine`` into ``folder``; limit : [s] for each of two processes.

    Raises InputError where there is no export for the engine or the mechanism, or where an engine fails.
    """
    where = f"{task.folder.name}/{task.case.name} in {engine.name}"
    if engine.name in ENGINES and not engine.exports:
        raise InputError(f"{where}: there is no export for {engine.name}")
    mechanism = str(task.folder.resolve())
    request: CaseRequest = {"mechanism": mechanism, "case": task.case.name, "options": {"error": False}}
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} is there already: write --out with a new or an empty folder, or remove it")
    with open_scratch_folder() as work:
        expected = run_engine(ENGINES[REFERENCE], request, task.time, limit, ChildProcesses())
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
        answer, ending = ask(job, limit, ChildProcesses())
        problem = answer["problem"] if answer else ending.message
        if problem:
            raise InputError(f"{where}: {problem}")
        words = {
            "mechanism": task.folder.name, "case": task.case.name, "title": task.case.title or task.mechanism.title,
            "engine": engine.name, "requires": engine.requires, "install": engine.install, "reference": REFERENCE,
            "table": "\n".join(_list_file_rows(made, engine)),
        }  # fmt: skip
        (made / "README.md").write_text(README.format(**words), encoding="utf-8")
        try:
            shutil.copytree(made, folder, dirs_exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be written: {error}; write --out with another folder") from error


def _list_file_rows(folder: Path, engine: Engine) -> Iterator[str]:
    for pattern, words in FILES.items():
        if names := sorted(f.name for f in folder.glob(pattern)):
            yield f"| {', '.join(names)} | {words.format(engine=engine.name)} |"
