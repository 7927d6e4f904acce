"""Runs on a real Dask cluster of this machine, a worker that is killed, and a run that is resumed."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from crosscheck_examples import write_models

from crosscheck.cli import main
from crosscheck.engines import ENGINES
from crosscheck.measures.record import read_record
from crosscheck.run.cluster import open_workers, read_task_files
from crosscheck.run.isolation import Attempt
from crosscheck.run.jobs import AbilitiesJob, CaseRun
from crosscheck.run.run_cache import AttemptFolder
from crosscheck.run.runner import KEPT, run
from crosscheck.run.work import Event, Options, Work
from crosscheck.verdicts.plan import Plan, discover
from crosscheck.verdicts.results import Results, read
from flexinv.errors import InputError

# How many cases the cluster gets; `CROSSCHECK_MANY=500 pytest tests/crosscheck/run/test_cluster.py` is the long show.
MANY = int(os.environ.get("CROSSCHECK_MANY", "2"))


def cases(root: Path, tmp_path: Path, count: int) -> Plan:
    """The double pendulum with as many short cases as asked for."""
    folder = write_models(tmp_path / "models", root)
    text = (folder / "cases.toml").read_text()
    start, end = text.index("[cases.swing]"), text.index("[[limits]]")
    case = text[start:end].replace("duration_s = 0.5", "duration_s = 0.1").replace("hold_s = 0.25", "hold_s = 0.05")
    copies = [
        case.replace("cases.swing", f"cases.swing{k}").replace("to_deg = 90", f"to_deg = {30 + k / 10}")
        for k in range(count)
    ]
    (folder / "cases.toml").write_text(text[:start] + "".join(copies) + text[end:])
    return discover(folder.parent)


@contextmanager
def cluster(folder: Path, workers: int = 2) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and workers in processes of their own, which see none of this project's folders but its packages."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    clean = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[3]), "OMP_NUM_THREADS": "1"}

    def start(*words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{words[0]}", *words[1:]]
        with (folder / "cluster.log").open("ab") as log:
            return subprocess.Popen(command, cwd=folder, env=clean, stdout=log, stderr=log, start_new_session=True)

    started = [start("dask_scheduler", "--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard")]
    worker = ("dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
    started += [start(*worker) for _ in range(workers)]
    try:
        yield address, started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_nothing_is_lost_when_a_worker_is_killed(root: Path, tmp_path: Path) -> None:
    plan = cases(root, tmp_path, MANY)
    engines = {name: ENGINES[name] for name in ("flexinv", "pinocchio")}
    with cluster(tmp_path) as (address, (first, _)):

        def kill(event: Event) -> None:
            if event.done == MANY:  # of twice as many
                first.send_signal(signal.SIGKILL)

        results = run(Work(plan, engines, (), Options(120.0, scheduler=address)), tmp_path / "out", kill)
        assert first.wait(10) == -signal.SIGKILL
        night = whole_night(plan.tasks[0].folder.parent, tmp_path / "reports", address)
    assert [r.message for r in results.runs if r.status != "ok"] == []
    assert len(results.runs) == 2 * MANY
    assert {c.verdict for c in results.comparisons} == {"within"}
    assert results.finished
    assert not (tmp_path / "out" / KEPT).exists()
    assert [(r.engine, r.status) for r in night.runs] == [("flexinv", "ok"), ("pinocchio", "ok")]
    assert address in night.command


def whole_night(models: Path, reports: Path, address: str) -> Results:
    """A night of one case on the worker that is left."""
    where = ["--models", str(models), "--reports", str(reports), "--scheduler", address]
    where += ["--engines", "flexinv,pinocchio"]
    words = ["nightly", "double_pendulum/swing0", *where]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["crosscheck", *words])
        done = CliRunner().invoke(main, words)
    assert done.exit_code == 1, done.output  # nothing is blessed yet
    return read(reports / "latest" / "results.json")


def stopped(plan: Plan, out: Path) -> Results:
    """A run that Ctrl-C meets after its first answer."""

    def stop(event: Event) -> None:
        if event.done == 1:
            raise KeyboardInterrupt

    return run(Work(plan, {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0)), out, stop)


@pytest.mark.slow
def test_a_run_that_was_cut_short_is_resumed(root: Path, tmp_path: Path) -> None:
    """What was answered is taken over, what was not is run; without --resume everything is."""
    plan, out = cases(root, tmp_path, 2), tmp_path / "out"
    cut = stopped(plan, out)
    assert not cut.finished
    attempt_folder = AttemptFolder(out / KEPT)
    done = run(Work(plan, {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0)), tmp_path / "other")
    first = plan.tasks[0]
    record = read_record(tmp_path / "other" / done.runs[0].series)
    attempt_folder.add_answer(first, "pinocchio", Attempt(record, "printed before", 7.0))
    again = run(Work(plan, {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0, resume=True)), out)
    assert again.finished
    assert [r.status for r in again.runs] == ["ok", "ok"]
    assert again.runs[0].printed == "printed before"  # not run again
    assert again.runs[1].printed != "printed before"
    anew = run(Work(replace(plan, tasks=plan.tasks[:1]), {"pinocchio": ENGINES["pinocchio"]}, (), Options(60.0)), out)
    assert anew.runs[0].printed != "printed before"


def test_a_scheduler_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crosscheck.run.cluster.CONNECT", 0.5)
    with (
        pytest.raises(InputError, match=r"--scheduler tcp://127.0.0.1:9: no scheduler answers there"),
        open_workers("tcp://127.0.0.1:9", 1),
    ):
        pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match=r"needs Dask; to install it: python -m pip install 'flexinv\[cluster\]'"),
        open_workers("tcp://x", 1),
    ):
        pass


def test_a_worker_gets_the_files_of_the_mechanism(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (task,) = cases(root, tmp_path, 1).tasks
    job = CaseRun(task, ENGINES["pinocchio"])
    files = read_task_files(job)
    assert set(files) == {"mechanism.toml", "cases.toml"}
    assert files["cases.toml"] == (task.folder / "cases.toml").read_bytes()
    assert read_task_files(AbilitiesJob(ENGINES["pinocchio"], ())) == {}
    monkeypatch.setattr("crosscheck.run.cluster.LARGEST_MODEL", 10)
    with pytest.raises(InputError, match="is not sent to workers"):
        read_task_files(job)


def test_a_cluster_without_workers_says_so_and_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scheduler alone takes jobs and does none: the reader at the terminal knows why nothing happens."""
    monkeypatch.setattr("crosscheck.run.cluster.AGAIN", 0.2)  # [s]
    said: list[str] = []
    with cluster(tmp_path, workers=0) as (address, _), open_workers(address, 1, said.append):
        until = clock.monotonic() + 20.0
        while len(said) < 3 and clock.monotonic() < until:
            clock.sleep(0.05)
    assert len(said) >= 3
    assert set(said) == {f"no worker is connected to {address}: jobs wait; start some with  dask worker {address}"}


def test_workers_of_another_python_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with cluster(tmp_path) as (address, _):
        with open_workers(address, 1) as pool:
            pool.submit(int, "1").result(60.0)  # both are there
        monkeypatch.setattr("crosscheck.run.cluster.HERE", "3.1")
        words = r"has Python 3\.\d+, this machine has 3\.1; start workers with Python 3\.1"
        with pytest.raises(InputError, match=words), open_workers(address, 1):
            pass
