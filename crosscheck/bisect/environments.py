"""Environments: one for each set of requirements, made once, kept, reused, and removed when they take too much room.

A folder of the store is an environment: ``venv``, ``pins.txt`` with the hash of every file, and ``made.json``, written last:
without it the environment is not whole and is made anew.  A lock beside it says that somebody makes or uses it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import filelock

from crosscheck import output_folder as owned
from crosscheck.bisect.installers import Installer, InstallerError, read_pins
from crosscheck.bisect.pythons import Python

PLACE = "CROSSCHECK_ENVIRONMENTS"  # variable that names another folder
GIGABYTE = 1e9  # [bytes]
NEEDED_SPACE = 0.5  # [GB] that the disk must have before an environment is made: the larger engines take 0.3
WHOLE = "made.json"


@dataclass(frozen=True)
class EnvironmentWish:
    """Contents that an environment shall have: a Python, requirements such as mujoco==3.3.7, constraints on what they bring."""

    python: Python
    requirements: tuple[str, ...]
    constraints: tuple[str, ...] = ()

    def compute_key(self, installer: Installer) -> str:
        """Return the name of its folder: a digest of all that decides what is in it."""
        wanted = [self.python.executable, self.python.version, sorted(self.requirements), sorted(self.constraints)]
        said = json.dumps([wanted, installer.index.options, installer.sources])
        return hashlib.sha256(said.encode()).hexdigest()[:20]


@dataclass(frozen=True)
class Environment:
    """An environment that is whole: its Python, its pins; made : whether it was made just now."""

    folder: Path
    python: str
    pins: str
    made: bool

    @property
    def versions(self) -> dict[str, str]:
        """The versions of all that is installed, by name."""
        return read_pins(self.pins)


@dataclass
class EnvironmentStore:
    """A folder of environments; limit : [bytes] that they may take together.

    made, reused : environments that this process was given; removed : those that were in the way of the limit
    """

    folder: Path
    installer: Installer
    limit: float = 10 * GIGABYTE
    made: int = 0
    reused: int = 0
    removed: list[str] = field(default_factory=list)

    @contextmanager
    def open_environment(self, wish: EnvironmentWish) -> Iterator[Environment]:
        """Give an environment, made where it is not there yet; nobody removes it meanwhile.

        Raises CannotInstall where the release cannot be had here, InstallerError where nothing can.
        """
        key = wish.compute_key(self.installer)
        with owned.convert_os_errors(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        with filelock.FileLock(self.folder / f"{key}.lock"):
            environment = self._read_environment(self.folder / key)
            if environment is None:
                environment = self._make_environment(self.folder / key, wish)
                self.made += 1
            else:
                self.reused += 1
            os.utime(self.folder / key / WHOLE)
            yield environment

    def _read_environment(self, folder: Path) -> Environment | None:
        """Return an environment that is there and whole, None for any other."""
        try:
            data = json.loads((folder / WHOLE).read_text(encoding="utf-8"))
            pins = (folder / "pins.txt").read_text(encoding="utf-8")
        except (OSError, ValueError):
            return None
        python = str(data["python"])
        return Environment(folder, python, pins, False) if Path(python).exists() else None

    def _make_environment(self, folder: Path, wish: EnvironmentWish) -> Environment:
        """Make an environment in a folder that is not there, or not whole; of one that fails nothing is left."""
        owned.remove_tree(folder)
        self.remove_oldest()
        self._check_space()
        try:
            with owned.convert_os_errors(folder):
                folder.mkdir(parents=True)
            python = self.installer.build_environment(wish.python.executable, folder / "venv")
            pins = self.installer.resolve_pins(python, wish.requirements, wish.constraints)
            (folder / "pins.txt").write_text(pins, encoding="utf-8")
            self.installer.fill_environment(python, folder / "pins.txt")
            data = {"python": python, "size": compute_folder_size(folder), "requirements": list(wish.requirements)}
            owned.replace(folder / WHOLE, json.dumps(data))
        except OSError as error:
            owned.remove_tree(folder)
            raise InstallerError(
                f"{folder} cannot be written: {error.strerror or error}; write another --environments"
            ) from error
        except BaseException:
            owned.remove_tree(folder)
            raise
        return Environment(folder, python, pins, True)

    def _check_space(self) -> None:
        """Raise InstallerError where the disk is nearly full."""
        free = shutil.disk_usage(self.folder).free / GIGABYTE
        if free < NEEDED_SPACE:
            raise InstallerError(
                f"{self.folder} has {free:.2f} GB left, an environment may take {NEEDED_SPACE:g} GB: free some, or write another "
                "--environments; what was found is kept"
            )

    def list_environments(self) -> list[tuple[float, float, Path]]:
        """Return the time of the last use [s], the room [bytes] and the folder of each, the oldest first."""
        found = []
        for file in self.folder.glob(f"*/{WHOLE}"):
            with contextlib.suppress(OSError, ValueError, LookupError):
                size = float(json.loads(file.read_text(encoding="utf-8"))["size"])
                found.append((file.stat().st_mtime, size, file.parent))
        return sorted(found)

    def remove_oldest(self) -> None:
        """Remove environments that were not used for longest until all take less than the limit; those in use stay."""
        known = self.list_environments()
        total = sum(size for _, size, _ in known)
        for _, size, folder in known:
            if total <= self.limit:
                return
            lock = filelock.FileLock(f"{folder}.lock")
            with contextlib.suppress(filelock.Timeout), lock.acquire(blocking=False):
                owned.remove_tree(folder)
                self.removed.append(folder.name)
                total -= size

    def compute_size(self) -> float:
        """Return the room that all environments take [bytes]."""
        return sum(size for _, size, _ in self.list_environments())


def find_store_folder() -> Path:
    """Return the folder of this user's environments: what CROSSCHECK_ENVIRONMENTS says, else one in the cache of the user."""
    if said := os.environ.get(PLACE):
        return Path(said)
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base else Path.home() / ".cache") / "crosscheck" / "environments"


def compute_folder_size(folder: Path) -> int:
    """Return the room that a folder takes on the disk [bytes]; of a file with several names (uv links to its cache) its share."""
    total = 0.0
    for top, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(OSError):
                state = os.lstat(os.path.join(top, name))
                total += state.st_size / max(state.st_nlink, 1)
    return round(total)
