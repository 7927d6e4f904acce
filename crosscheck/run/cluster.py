"""Executors of engines: processes of this machine, or the workers of a Dask cluster (``--scheduler tcp://...``).

A worker gets the files of the mechanism with the job, so it needs no folder in common with this machine, only the same
packages.  A job of a worker that dies goes to another one (Dask); what several workers died of becomes an error of that job.
"""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from crosscheck.run.isolation import ChildProcesses, open_scratch_folder
from crosscheck.run.jobs import Answer, EngineJob, Job
from crosscheck.run.work import Options
from flexinv.errors import InputError

INSTALL = "python -m pip install 'flexinv[cluster]'"
CONNECT = 20.0  # [s] for the scheduler to answer
AGAIN = 60.0  # [s] between two looks at the workers
HERE = f"{sys.version_info.major}.{sys.version_info.minor}"
LARGEST_MODEL = 50_000_000  # [bytes] of one mechanism's files


@contextlib.contextmanager
def open_workers(scheduler: str, jobs: int, tell: Callable[[str], None] = lambda line: None) -> Iterator[Executor]:
    """Give an executor: ``jobs`` threads that drive local processes, or a cluster.

    tell : is given a line where the cluster has no workers, or workers that cannot do jobs of ours; again every minute
    Raises InputError where Dask is missing, the scheduler does not answer, or all workers have another Python.
    """
    if not scheduler:
        with ThreadPoolExecutor(max_workers=max(1, jobs)) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError(f"--scheduler needs Dask; to install it: {INSTALL}") from None
    try:
        client = Client(scheduler, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {scheduler}: no scheduler answers there ({error})") from error
    with client:
        if words := find_trouble(client, scheduler):
            tell(words)
        others = _list_other_pythons(client)
        if others and len(others) == len(_list_workers(client)):
            raise InputError(f"--scheduler {scheduler}: {_describe_others(others)}; start workers with Python {HERE}")
        over = threading.Event()
        watcher = threading.Thread(target=_warn_of_trouble, args=(client, scheduler, tell, over), daemon=True)
        watcher.start()
        try:
            yield client.get_executor(pure=False)
        finally:
            over.set()
            watcher.join(timeout=AGAIN)


def _warn_of_trouble(client: Any, scheduler: str, tell: Callable[[str], None], over: threading.Event) -> None:
    """Tell every minute of a cluster that has trouble, until the run is over."""
    while not over.wait(AGAIN):
        with contextlib.suppress(Exception):  # the run finds out by itself that the cluster is gone
            if words := find_trouble(client, scheduler):
                tell(words)


def find_trouble(client: Any, scheduler: str) -> str:
    """Return in words why a cluster cannot do all jobs: no workers, or some with another Python; "" where it can."""
    if not _list_workers(client):
        return f"no worker is connected to {scheduler}: jobs wait; start some with  dask worker {scheduler}"
    others = _list_other_pythons(client)
    return f"{_describe_others(others)}: what they are given may fail" if others else ""


def _list_workers(client: Any) -> list[str]:
    return list(client.scheduler_info(n_workers=-1)["workers"])


def _list_other_pythons(client: Any) -> dict[str, str]:
    """Return the Python of workers that have another one than this machine, by their addresses."""
    result = client.run(_describe_python, on_error="return")
    return {worker: python for worker, python in result.items() if isinstance(python, str) and python != HERE}


def _describe_python() -> str:
    return ".".join(map(str, sys.version_info[:2]))


def _describe_others(others: Mapping[str, str]) -> str:
    worker, python = next(iter(others.items()))
    more = f" and {len(others) - 1} more" if len(others) > 1 else ""
    return f"the worker {worker}{more} has Python {python}, this machine has {HERE}"


def run_on_worker(do: Callable[..., Answer], job: Job, files: Mapping[str, bytes], options: Options) -> Answer:
    """Do a job on a worker: put the mechanism's files into a folder of its own, and run the engine there."""
    with open_scratch_folder() as folder:
        if files and isinstance(job, EngineJob):
            place = folder / job.task.folder.name
            for name, content in files.items():
                (place / name).parent.mkdir(parents=True, exist_ok=True)
                (place / name).write_bytes(content)
            job = replace(job, task=replace(job.task, folder=place))
        return do(job, options, ChildProcesses())


def read_task_files(job: Job) -> dict[str, bytes]:
    """Return the files of a job's mechanism by name; none where they are not all in its folder (a URDF elsewhere).

    Then, as for studies, a worker must see the same folders as this machine.  Raises InputError for a folder too large.
    """
    if not isinstance(job, EngineJob):
        return {}
    folder = job.task.folder.resolve()
    urdf = job.task.mechanism.urdf
    inside = urdf is None or urdf.resolve().is_relative_to(folder) or not urdf.resolve().is_relative_to(folder.parent)
    files = [f for f in sorted(folder.rglob("*")) if f.is_file()] if inside else []
    if (size := sum(f.stat().st_size for f in files)) > LARGEST_MODEL:
        raise InputError(
            f"{folder} has {size / 1e6:.0f} MB of files; a mechanism of more than 50 MB is not sent to workers"
        )
    return {str(f.relative_to(folder)): f.read_bytes() for f in files}
