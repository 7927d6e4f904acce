"""Scripts of cases: what each engine is given, exported once and kept until case, engine or this project changes."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from crosscheck import output_folder as owned
from crosscheck.bisect.cases import CaseScript, find_package, read_case_script, write_case_script
from crosscheck.engines import Engine
from crosscheck.run.answer_cache import compute_folder_digest, compute_source_digest
from crosscheck.run.isolation import ChildProcesses, open_scratch_folder
from crosscheck.run.reproduce import NoExport
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

REFUSED = "refused.txt"  # why there is no script


@dataclass(frozen=True)
class BoardScript:
    """A case for one engine: its script, or why there is none; key : changes with case, installed engine and our sources."""

    task: Task
    engine: str
    key: str
    made: CaseScript | None
    refused: str = ""


def prepare_script(task: Task, engine: Engine, folder: Path, timeout: float, children: ChildProcesses) -> BoardScript:
    """Return the script of a case for an engine, exported in one of the children where it is not kept.

    timeout : [s] of an export and of a run
    """
    installed = metadata.version(find_package(engine.name))
    said = (compute_folder_digest(task.folder), task.case.name, engine.name, installed, compute_source_digest())
    key = hashlib.sha256(repr(said).encode()).hexdigest()[:20]
    place = folder / key
    if (place / REFUSED).is_file():
        return BoardScript(task, engine.name, key, None, (place / REFUSED).read_text(encoding="utf-8"))
    if not place.is_dir():
        try:
            _write_script(task, engine, place, timeout, children)
        except NoExport as error:
            place.mkdir(parents=True)
            owned.write(place / REFUSED, str(error))
            return BoardScript(task, engine.name, key, None, str(error))
        except InputError as error:  # asked for again the next time: a limit of time may have been too short
            return BoardScript(task, engine.name, key, None, str(error))
    return BoardScript(task, engine.name, key, read_case_script(place, timeout))


def _write_script(task: Task, engine: Engine, place: Path, timeout: float, children: ChildProcesses) -> None:
    """Export a case into a folder, whole or not at all.  Raises InputError where the engine or the export cannot."""
    with open_scratch_folder() as scratch:
        write_case_script(task, engine, scratch / "case", timeout, children)
        for file in sorted(path for path in (scratch / "case").rglob("*") if path.is_file()):
            owned.add_to_folder_list(place / file.relative_to(scratch / "case"))
        shutil.move(scratch / "case", place)
