"""Files of a program: all that a command of ``crosscheck.toml`` may read as its own code, with a digest of each.

A command names a program, a script or a module; what it loads besides, nobody can know before it runs.  So every file below the
folder of each named file counts, as far as it lies in the project.  What does not count is data of the project and what tools
write by themselves: folders of models, folders that crosscheck writes into, hidden files, caches of compiled Python, databases
and logs; and ``crosscheck.toml`` itself, whose settings of each engine are looked at apart.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from crosscheck.output_folder import LIST
from flexinv.errors import InputError

MODELS = "mechanism.toml"  # a folder with one is a model
CACHES = ("__pycache__", "node_modules")
WRITTEN = (".db", ".sqlite", ".sqlite3", ".log")  # suffixes of what programs write as they run
SETTINGS = "crosscheck.toml"
MOST_FILES = 5_000
MOST_BYTES = 500_000_000


def compute_digests(named: Iterable[Path], project: Path) -> dict[str, str]:
    """Return the digest of every file below the folders of named files, by its path in the project.

    Raises InputError where there are too many, or one cannot be read.
    """
    root = project.resolve()
    folders = {file.resolve().parent for file in named if file.resolve().is_relative_to(root)}
    outermost = [one for one in folders if not any(other in one.parents for other in folders)]
    digests: dict[str, str] = {}
    size = 0
    for folder in sorted(outermost):
        for file in _list_files(folder):
            size += file.stat().st_size
            if len(digests) >= MOST_FILES or size > MOST_BYTES:
                raise InputError(
                    f"{folder} holds more than {MOST_FILES} files or {MOST_BYTES / 1e6:.0f} MB beside the program: trust is "
                    "given to all of them; move the program into a folder of its own"
                )
            digests[file.relative_to(root).as_posix()] = _compute_digest(file)
    return digests


def _list_files(folder: Path) -> Iterator[Path]:
    """Yield the regular files below a folder in their order, but for data and what tools write."""
    for place, folders, names in os.walk(folder):
        here = Path(place)
        folders[:] = sorted(name for name in folders if not _is_left_out(here / name))
        for name in sorted(names):
            file = here / name
            is_code = not name.startswith(".") and file.suffix not in WRITTEN and name != SETTINGS
            if is_code and file.is_file():
                yield file


def _is_left_out(folder: Path) -> bool:
    if folder.name.startswith(".") or folder.name in CACHES:
        return True
    is_model = (folder / MODELS).is_file()
    holds_models = any(True for _ in folder.glob(f"*/{MODELS}"))
    return is_model or holds_models or (folder / LIST).is_file()


def _compute_digest(file: Path) -> str:
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror or error}; trust is given to its content") from error


def list_changes(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """Return in words which files are new, have changed or are gone."""
    words = dict.fromkeys(after.keys() - before.keys(), "is new")
    words |= dict.fromkeys(before.keys() - after.keys(), "is gone")
    words |= {name: "has changed" for name in before.keys() & after.keys() if before[name] != after[name]}
    return [f"{name} {what}" for name, what in sorted(words.items())]
