"""Jobs of a board: the new cells of one release, computed in one environment, here or on a worker of a cluster."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from crosscheck.bisect.cases import make_case_reading, read_case_script
from crosscheck.bisect.environments import EnvironmentStore, EnvironmentWish, find_store_folder
from crosscheck.bisect.installers import CannotInstall, Installer, choose_installer
from crosscheck.bisect.observations import Observation, read_observation
from crosscheck.bisect.pythons import Python, find_pythons
from crosscheck.bisect.script import run_script
from crosscheck.run.isolation import open_scratch_folder

FileContents = Mapping[str, bytes]  # by path below the folder of a script


@dataclass(frozen=True)
class ReleaseJob:
    """New cells of one release: what is installed, and the files of each script; timeout : [s] of a run."""

    python: Python
    requirements: tuple[str, ...]
    scripts: tuple[FileContents, ...]
    timeout: float


def read_script_files(folder: Path) -> dict[str, bytes]:
    """Return the files of an exported case by path."""
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


def run_release(
    job: ReleaseJob, store: EnvironmentStore, stop: threading.Event | None = None
) -> list[Observation] | str:
    """Return the observation of every script, or the reason for which there is no environment; fewer where it is told to stop.

    Raises InstallerError where nothing can be installed.
    """
    observations: list[Observation] = []
    try:
        with store.open_environment(EnvironmentWish(job.python, job.requirements)) as environment:
            for files in job.scripts:
                observation = _run_files(files, job.timeout, environment.python, stop)
                if stop is not None and stop.is_set():
                    break
                observations.append(observation)
    except CannotInstall as error:
        return str(error)
    return observations


def run_release_on_worker(job: ReleaseJob, store: EnvironmentStore, own_folder: bool) -> list[Observation] | str:
    """Do a job on a worker, by its own Python and installer; own_folder : environments lie in the cache of its user."""
    installer = store.installer
    if isinstance(installer, Installer) and installer.uv:
        installer = choose_installer("auto", installer.index, installer.sources)
    python = job.python if Path(job.python.executable).exists() else find_pythons([])[0]
    folder = find_store_folder() if own_folder else store.folder
    return run_release(replace(job, python=python), replace(store, folder=folder, installer=installer))


def _run_files(files: FileContents, timeout: float, python: str, stop: threading.Event | None) -> Observation:
    """Return the observation of a script, whose files are put into a folder of its own."""
    with open_scratch_folder() as place:
        for name, content in files.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_bytes(content)
        script = read_case_script(place, timeout).script
        with run_script(script, python, stop=stop) as (end, folder):
            return read_observation(end, folder, make_case_reading())
