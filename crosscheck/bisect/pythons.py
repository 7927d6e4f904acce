"""Pythons that are installed: found by version or path, asked for what they are."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from crosscheck.bisect.surroundings import make_script_environment
from flexinv.errors import InputError

QUESTION = (
    "import json, platform, sys; print(json.dumps([sys.executable, platform.python_version(), sys.version_info[:2]]))"
)
OLDEST = (3, 7)  # what today's pip can still install for
SHORT = re.compile(r"3\.\d+")
LONGEST_ANSWER = 60.0  # [s] that a Python may take to say its version


@dataclass(frozen=True)
class Python:
    """A Python that is installed; version : such as 3.12.1."""

    executable: str
    version: str


def find_pythons(wanted: Iterable[str]) -> list[Python]:
    """Return Pythons by versions (3.12) or paths, else that which runs this.  Raises InputError for one that is missing."""
    names = list(wanted)
    if not names:
        return [_ask_python(sys.executable, "the Python that runs crosscheck")]
    return [_ask_python(_find_executable(name), name) for name in names]


def _find_executable(name: str) -> str:
    """Return the path of a Python by version or path.  Raises InputError."""
    if SHORT.fullmatch(name):
        path = shutil.which(f"python{name}")
        if path is None:
            raise InputError(f"--python {name}: no python{name} is installed; write a version that is, or a path")
        return path
    if not Path(name).is_file():
        raise InputError(
            f"--python {name}: there is no such program; write a version such as 3.12, or the path of a Python"
        )
    return str(Path(name).absolute())


def _ask_python(path: str, name: str) -> Python:
    """Return a Python as it describes itself.  Raises InputError for a program that is none, or one that is too old."""
    try:
        done = subprocess.run(
            [path, "-I", "-c", QUESTION],
            capture_output=True,
            text=True,
            timeout=LONGEST_ANSWER,
            env=make_script_environment(),
            check=True,
        )
        executable, version, short = json.loads(done.stdout)
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        raise InputError(f"--python {name}: {path} does not say which Python it is: {error}") from error
    if tuple(short) < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        raise InputError(
            f"--python {name} is Python {version}, expected {oldest} or newer: pip cannot install for older ones"
        )
    return Python(executable, version)
