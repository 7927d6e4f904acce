"""Answers that are kept between runs: what engines and studies gave, taken again while nothing that matters has changed.

An entry is a file, a zip archive whose members carry their own checksums, named after a key that changes with everything that
the answer depends on: the files of the mechanism and the case, the engine, its options and its package, the sources of this
project, the versions of packages and of Python, the processor, and what the environment tells Numba.  Limits, which
judge, and the time limit are no part of it.  Only what came to an answer is kept.

Files appear as a whole or not at all, so two runs may use one folder at once.  What is damaged is removed and told, and
computed again; where nothing can be written, that is told and nothing is kept.  The entries that were not used for longest go
when the folder grows beyond `LARGEST`.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

from crosscheck import output_folder as owned
from crosscheck.doors.registry import COMMAND
from crosscheck.engines import ENGINES, Engine
from crosscheck.engines.base import Options as EngineOptions
from crosscheck.measures.record import Record, RecordError, check, compute_fingerprint, read_record, save
from crosscheck.run.isolation import Attempt, open_scratch_folder
from crosscheck.run.run_cache import add_door_digest, compute_attempt_key, compute_surroundings_digest
from crosscheck.run.work import Study
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.results import describe_machine, format_current_time

LARGEST = 2_000_000_000  # [bytes] of a folder of answers: some ten runs of everything
KEPT = ("ok", "skipped")
ENDING = ".answer"
TIMES = "times.json"
METADATA = ".dist-info", ".egg-info"  # ends of the names of folders
TOLD = ("NUMBA_", "FLEXINV_")  # beginnings of variables of the environment that computations hear
WHERE = "CROSSCHECK_KEPT"
DAMAGED = (OSError, ValueError, LookupError, TypeError, zipfile.BadZipFile, zlib.error, EOFError, RecordError)


def find_user_folder() -> Path | None:
    """Return the folder of this user's answers: what CROSSCHECK_KEPT says ("": None), else one in the cache of the user."""
    if (said := os.environ.get(WHERE)) is not None:
        return Path(said) if said else None
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base else Path.home() / ".cache") / "crosscheck" / "answers"


@dataclass
class AnswerCache:
    """A folder of answers; trouble : what was wrong with entries and with writing, for the reader."""

    folder: Path
    options: EngineOptions = field(default_factory=dict)
    trouble: list[str] = field(default_factory=list)

    @cached_property
    def setting(self) -> str:
        """A digest of all that every answer depends on."""
        return compute_setting_digest()

    @cached_property
    def contents(self) -> Callable[[Path], str]:
        """The digest of a folder (`compute_folder_digest`), which is read once."""
        return cache(compute_folder_digest)

    def find_attempt(self, task: Task, engine: Engine) -> Attempt | None:
        """Return the attempt that was kept of an engine at a case, with the time of it, or None."""
        attempt: Attempt | None = self._read(
            self._compute_attempt_key(task, engine), lambda words, stem: _read_attempt(words, stem, task)
        )
        return attempt

    def add_answer(self, task: Task, engine: Engine, attempt: Attempt) -> None:
        """Keep an attempt that came to an answer."""
        if attempt.record.status in KEPT and not attempt.kept:
            words = {"printed": attempt.printed, "elapsed": attempt.elapsed, "when": format_current_time()}
            self._write(self._compute_attempt_key(task, engine), words, attempt.record)

    def find_values(self, name: str, *things: object) -> Any:
        """Return the values that were kept under things that they depend on, with their time ("when"), None without them."""
        return self._read(compute_fingerprint(name, *things, self.setting), lambda words, stem: words)

    def list_study_dependencies(self, study: Study) -> tuple[object, ...]:
        """Return the things that a study depends on: its function, its options, and all files in the folders that these name."""
        words = {name: value for name, value in study.options.items() if isinstance(value, str | Path)}
        # os.path: a text that is too long for a path is no folder either, and no error.
        folders = {name: Path(value) for name, value in words.items() if os.path.isdir(value)}
        plain = {name: value for name, value in study.options.items() if name not in folders}
        return study.module, study.function, plain, {name: self.contents(folder) for name, folder in folders.items()}

    def add_values(self, words: Mapping[str, object], name: str, *things: object) -> None:
        """Keep JSON values under the things that they depend on."""
        self._write(compute_fingerprint(name, *things, self.setting), {**words, "when": format_current_time()})

    def _compute_attempt_key(self, task: Task, engine: Engine) -> str:
        """Return the key of an attempt, "" of an engine about which nobody can see whether it has changed."""
        if not is_traceable(engine):
            return ""
        options = add_door_digest(engine, task.folder, self.options)
        ours = "" if engine.name in ENGINES or engine.settings is not None else compute_package_digest(engine.module)
        return compute_fingerprint(
            compute_attempt_key(task, engine.name, options), self.contents(task.folder), ours, self.setting
        )

    def _read(self, name: str, read: Any) -> Any:
        file = self._make_entry_path(name)
        if not name or not file.is_file():
            return None
        try:
            with open_scratch_folder() as folder, zipfile.ZipFile(file) as archive:
                archive.extractall(folder)
                result = read(json.loads((folder / "words.json").read_text(encoding="utf-8")), folder / "record")
            os.utime(file)
        except FileNotFoundError:  # another run has just removed it
            return None
        except DAMAGED as error:
            self.trouble.append(f"a kept answer was damaged and is computed again: {error}")
            with contextlib.suppress(OSError):
                file.unlink()
            return None
        return result

    def _write(self, name: str, words: Mapping[str, object], record: Record | None = None) -> None:
        if not name:
            return
        try:
            data = make_entry(words, record)
            file = self._make_entry_path(name)
            file.parent.mkdir(parents=True, exist_ok=True)
            owned.replace(file, data)
        except OSError as error:
            said = f"answers are not kept: {error}"
            self.trouble += [] if said in self.trouble else [said]

    def _make_entry_path(self, name: str) -> Path:
        return self.folder / name[:2] / f"{name}{ENDING}"

    def read_times(self) -> dict[str, float]:
        """Return the times that jobs took when they ran last [s], by their names."""
        try:
            found = json.loads((self.folder / TIMES).read_text(encoding="utf-8"))
            return {str(name): float(seconds) for name, seconds in found.items()}
        except (OSError, ValueError, TypeError, AttributeError):
            return {}

    def close(self, times: Mapping[str, float]) -> None:
        """Add how long jobs took [s], and remove what was not used for longest where the folder is too large."""
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            owned.replace(self.folder / TIMES, json.dumps(self.read_times() | dict(times)))
            remove_oldest_entries(self.folder, LARGEST)


def _read_attempt(words: Mapping[str, Any], stem: Path, task: Task) -> Attempt:
    record = read_record(stem)
    check(record, task.time)
    return Attempt(record, words["printed"], words["elapsed"], words["when"])


def make_entry(words: Mapping[str, object], record: Record | None) -> bytes:
    """Return an entry: words, and the two files of a record where there is one."""
    made = io.BytesIO()
    with open_scratch_folder() as folder, zipfile.ZipFile(made, "w") as archive:
        if record is not None:
            save(record, folder / "record")
            for file in sorted(folder.iterdir()):
                archive.write(file, file.name)
        archive.writestr("words.json", json.dumps(words))
    return made.getvalue()


def remove_oldest_entries(folder: Path, largest: float) -> None:
    """Remove entries, those first that were not used for longest, until a folder has at most ``largest`` [bytes]."""
    entries = sorted(_list_entries(folder), reverse=True)
    total = 0
    for _, size, file in entries:
        total += size
        if total > largest:
            with contextlib.suppress(OSError):
                file.unlink()


def _list_entries(folder: Path) -> Iterator[tuple[float, int, Path]]:
    for file in folder.glob(f"*/*{ENDING}"):
        with contextlib.suppress(OSError):
            state = file.stat()
            yield state.st_mtime, state.st_size, file


def is_traceable(engine: Engine) -> bool:
    """Return True if what an engine is can be seen: a program, or a module in the user's folder, may hide what it uses."""
    return engine.module != COMMAND and not engine.path


def compute_setting_digest() -> str:
    """Return a digest of all that every answer depends on: sources, packages, Python, processor, environment."""
    told = sorted((name, value) for name, value in os.environ.items() if name.startswith(TOLD))
    here = {name: value for name, value in describe_machine().items() if name != "cores"}
    return compute_fingerprint(
        compute_surroundings_digest(), compute_source_digest(), here, compute_installed_digest(), told
    )


@cache
def compute_source_digest() -> str:
    """Return a digest of all files of flexinv and crosscheck, not of their sources alone."""
    root = Path(__file__).resolve().parents[2]
    return compute_fingerprint([compute_folder_digest(root / name) for name in ("flexinv", "crosscheck")])


@cache
def compute_installed_digest() -> str:
    """Return a digest of the names and versions of all installed packages: some engine may use any of them.

    Both stand in the name of a package's folder of metadata; reading the metadata themselves takes most of a second.
    """
    places = [Path(place) for place in sys.path if os.path.isdir(place)]
    return compute_fingerprint(
        sorted(one.name for place in places for end in METADATA for one in place.glob(f"*{end}"))
    )


@cache
def compute_package_digest(module: str) -> str:
    """Return a digest of the sources of another package, in which the adapter ``module`` is."""
    found = importlib.util.find_spec(module.partition(":")[0].partition(".")[0])
    if found is None or found.origin is None:
        return ""
    origin = Path(found.origin)
    return (
        compute_folder_digest(origin.parent)
        if origin.name == "__init__.py"
        else sha256(origin.read_bytes()).hexdigest()
    )


def compute_folder_digest(folder: Path) -> str:
    """Return a digest of all files below a folder, compiled ones aside."""
    digest = sha256()
    for file in sorted(f for f in folder.rglob("*") if f.is_file() and "__pycache__" not in f.parts):
        data = file.read_bytes()
        digest.update(f"{file.relative_to(folder)} {len(data)} ".encode() + data)
    return digest.hexdigest()
