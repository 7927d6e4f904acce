"""A night with the newest engines: a fresh environment, filled by pip, in which the same command runs again."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from crosscheck.engines import ENGINES
from crosscheck.start import list_requirements

FLAG = "--latest-engines"
LABEL = "latest-engines"
EXTRAS = "engines,robots,report,history"
ROOT = Path(__file__).resolve().parents[2]
Tell = Callable[[str], object]


class LatestEnginesError(RuntimeError):
    """The environment could not be made; the message ends with what pip said last."""


def run_in_fresh_environment(reports: Path, words: Sequence[str], tell: Tell) -> int:
    """Make the environment, run ``crosscheck`` with these words in it, and return its exit code [-] (2: it failed)."""
    try:
        reports.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=f".{LABEL}-", dir=reports, ignore_cleanup_errors=True) as folder:
            python = build_environment(Path(folder), tell)
            return subprocess.run(
                [str(python), "-m", "crosscheck", *words, "--label", LABEL], env=_list_clean_variables()
            ).returncode
    except (LatestEnginesError, OSError) as error:
        tell(f"the newest engines could not be installed: {error}")
        return 2


def build_environment(folder: Path, tell: Tell) -> Path:
    """Make a virtual environment with this project and the newest engines and return its Python.  Raises FreshError."""
    # Some systems have no ensurepip: the pip that runs here fills the environment from outside.
    _run_command([sys.executable, "-m", "venv", "--without-pip", str(folder)])
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    wanted = [*list_project_packages(), *list_engine_packages()]
    tell(f"installing {', '.join(wanted)} into {folder}")
    _run_command([sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--upgrade", *wanted])
    if not (ROOT / "pyproject.toml").is_file():
        _copy(python)
    return python


def list_project_packages() -> list[str]:
    """Return the packages for pip of this project: its source folder, or the requirements of the installed packages.

    What runs here need not be a release that pip could find anywhere: the packages themselves are copied (``_copy``).
    """
    if (ROOT / "pyproject.toml").is_file():
        return [f"{ROOT}[{EXTRAS}]"]
    return [need for extra in ("", *EXTRAS.split(",")) for need in list_requirements(extra)]


def _copy(python: Path) -> None:
    """Copy the installed packages of this project into the environment of another Python."""
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    said = subprocess.run(
        [str(python), "-c", ask], capture_output=True, text=True, check=True, env=_list_clean_variables()
    ).stdout
    for folder in [ROOT / "flexinv", ROOT / "crosscheck", *ROOT.glob("flexinv-*.dist-info")]:
        shutil.copytree(folder, Path(said.strip()) / folder.name, ignore=shutil.ignore_patterns("__pycache__"))


def list_engine_packages() -> list[str]:
    """Return the packages of the engines, from their own words on how to install them."""
    names = (engine.install.rsplit(" ", 1)[-1] for engine in ENGINES.values())
    return [name for name in dict.fromkeys(names) if name != "."]


def remove_flag(words: Sequence[str]) -> list[str]:
    """Return the words of a command line without the flag that brought it here."""
    return [word for word in words if word != FLAG]


def _run_command(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, env=_list_clean_variables())
    if done.returncode:
        said = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        raise LatestEnginesError(said[-1] if said else f"{command[0]} left with exit code {done.returncode}")


def _list_clean_variables() -> dict[str, str]:
    """Return the environment variables without those that lead Python to the packages of this environment."""
    return {
        name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    }
