"""A night with the newest engines: a fresh environment, filled by pip, in which the same command runs again."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

from crosscheck.engines import ENGINES

FLAG = "--latest-engines"
LABEL = "latest-engines"
EXTRAS = "engines,robots,report,history"
Tell = Callable[[str], object]


class FreshError(RuntimeError):
    """The environment could not be made; the message ends with what pip said last."""


def nightly(reports: Path, words: Sequence[str], tell: Tell) -> int:
    """Make the environment, run ``crosscheck`` with these words in it, and return its exit code [-] (2: it failed)."""
    folder = reports / f".{LABEL}"
    try:
        python = environment(folder, tell)
    except (FreshError, OSError) as error:
        tell(f"the newest engines could not be installed: {error}")
        return 2
    try:
        return subprocess.run([str(python), "-m", "crosscheck", *words, "--label", LABEL], env=_clean()).returncode
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def environment(folder: Path, tell: Tell) -> Path:
    """Make a virtual environment with this project and the newest engines and return its Python.  Raises FreshError."""
    shutil.rmtree(folder, ignore_errors=True)
    # Some systems have no ensurepip: the pip that runs here fills the environment from outside.
    _do([sys.executable, "-m", "venv", "--without-pip", str(folder)])
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    wanted = [project(), *engine_packages()]
    tell(f"installing {', '.join(wanted)} into {folder}")
    _do([sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--upgrade", *wanted])
    return python


def project() -> str:
    """Return what pip installs for this project: its source folder, or the release that runs here."""
    root = Path(__file__).resolve().parents[1]
    if (root / "pyproject.toml").is_file():
        return f"{root}[{EXTRAS}]"
    return f"flexinv[{EXTRAS}]=={metadata.version('flexinv')}"


def engine_packages() -> list[str]:
    """Return the packages of the engines, from their own words on how to install them."""
    names = (engine.install.rsplit(" ", 1)[-1] for engine in ENGINES.values())
    return [name for name in dict.fromkeys(names) if name != "."]


def without_flag(words: Sequence[str]) -> list[str]:
    """Return the words of a command line without the flag that brought it here."""
    return [word for word in words if word != FLAG]


def _do(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, env=_clean())
    if done.returncode:
        said = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        raise FreshError(said[-1] if said else f"{command[0]} left with exit code {done.returncode}")


def _clean() -> dict[str, str]:
    """Return the environment variables without those that lead Python to the packages of this environment."""
    return {
        name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    }
