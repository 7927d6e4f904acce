"""The command line of crosscheck: what it prints, what it writes, and its exit codes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time as clock
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result
from crosscheck_examples import write_models

from crosscheck.cli import main
from crosscheck.engines import ENGINES, Engine
from crosscheck.results import read

Invoke = Callable[..., Result]


@pytest.fixture
def invoke() -> Invoke:
    return lambda *words: CliRunner().invoke(main, list(map(str, words)))


@pytest.fixture
def models(root: Path, tmp_path: Path) -> Path:
    return write_models(tmp_path / "models", root).parent


def test_a_sound_run_has_exit_code_0_and_writes_everything(models: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "report"
    done = invoke("run", "--models", models, "--engines", "flexinv,pino*", "--studies", "", "--jobs", 1, "--out", out)
    assert done.exit_code == 0, done.output
    assert "All 4 comparisons are within their limits." in done.output
    assert "double_pendulum/swing pinocchio" in done.output
    names = {p.name for p in out.iterdir()}
    assert names >= {"index.html", "results.json", "summary.md", "junit.xml", "series", "cases", "data", "assets"}
    (out / "index.html").unlink()
    again = invoke("report", out)
    assert again.exit_code == 0
    assert (out / "index.html").is_file()


def test_a_missing_engine_has_exit_code_2_and_still_a_report(
    models: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = Engine("pinocchio", "x", "no_such_package", "python -m pip install pin")
    monkeypatch.setattr("crosscheck.commands.run.ENGINES", {"pinocchio": gone})
    monkeypatch.setattr("crosscheck.commands.engines.ENGINES", {"pinocchio": gone})
    out = tmp_path / "report"
    done = invoke("run", "double_pendulum", "--models", models, "--engines", "pinocchio", "--out", out)
    assert done.exit_code == 2
    assert "python -m pip install pin" in done.output
    assert "python -m pip install pin" in (out / "index.html").read_text()
    listed = invoke("engines")
    assert "missing" in listed.output


@pytest.mark.skipif(sys.platform != "linux", reason="finds the child processes in /proc")
def test_ctrl_c_ends_the_engines_and_still_writes_a_report(models: Path, tmp_path: Path) -> None:
    out = tmp_path / "report"
    command = [sys.executable, "-m", "crosscheck", "run", "--models", str(models), "--out", str(out), "--jobs", "1"]
    run = subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1], preexec_fn=_hear_ctrl_c
    )
    children = Path(f"/proc/{run.pid}/task")
    end = clock.monotonic() + 60.0
    while not (started := offspring(children)) and clock.monotonic() < end:
        clock.sleep(0.02)
    assert started
    run.send_signal(signal.SIGINT)
    _, printed = run.communicate(timeout=120.0)
    assert run.returncode == 2, printed
    assert "interrupted before everything was run" in printed
    assert all(not Path(f"/proc/{pid}").exists() for pid in started)
    results = read(out / "results.json")
    assert {r.engine for r in results.runs} == set(ENGINES)
    assert (out / "index.html").is_file()


def _hear_ctrl_c() -> None:
    """A shell's background job ignores Ctrl-C, and so do its children: this one is to hear it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def offspring(tasks: Path) -> list[str]:
    """Children of all threads of a process."""
    try:
        return [pid for t in os.listdir(tasks) for pid in (tasks / t / "children").read_text().split()]
    except OSError:
        return []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "tail"), "nothing to run is called 'tail'; mechanisms here: double_pendulum"),
        (("run", "--engines", "adams"), "no engine is called 'adams'; known: flexinv, pinocchio"),
        (("run", "--studies", "weather"), "no study is called 'weather'"),
        (("run", "--timeout", "0"), "0.0 is not in the range"),
        (("run", "--jobs", "0"), "0 is not in the range"),
        (("dance",), "No such command 'dance'"),
    ],
)
def test_wrong_words_have_exit_code_2_and_say_what_is_right(
    models: Path, invoke: Invoke, words: tuple[str, ...], message: str
) -> None:
    where = ("--models", models) if words[0] == "run" else ()
    done = invoke(*words, *where)
    assert done.exit_code == 2
    assert message in done.output


def test_a_failure_of_the_harness_is_not_a_deviation(
    models: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fall(*_: object) -> None:
        raise ZeroDivisionError("unforeseen")

    monkeypatch.setattr("crosscheck.terminal.render", fall)
    monkeypatch.setattr("crosscheck.commands.run.ENGINES", {"e": Engine("e", "x", "no_such_package", "never")})
    done = invoke("run", "double_pendulum", "--models", models, "--out", tmp_path / "o")
    assert done.exit_code == 2
    assert "the harness failed: ZeroDivisionError: unforeseen" in done.output


def test_what_is_no_report_is_refused(tmp_path: Path, invoke: Invoke) -> None:
    assert "cannot read" in invoke("report", tmp_path).output
    (tmp_path / "results.json").write_text('{"schema": 99}')
    done = invoke("report", tmp_path)
    assert (done.exit_code, "schema 1" in done.output) == (2, True)


def test_list_shows_mechanisms_cases_and_what_cannot_be_read(models: Path, invoke: Invoke) -> None:
    done = invoke("list", "--models", models)
    assert done.exit_code == 0
    for word in ("double_pendulum", "swing", "torque, tip, wrench"):
        assert word in done.output
    (models / "double_pendulum" / "mechanism.toml").write_text("links = [")
    done = invoke("list", "--models", models)
    assert done.exit_code == 2
    assert "cannot be read" in done.output


def test_every_help_teaches(invoke: Invoke) -> None:
    assert "Exit codes" in invoke("--help").output
    context = click.Context(main)
    names = main.list_commands(context)  # every file of crosscheck/commands
    assert {"run", "report", "list", "engines"} <= set(names)
    for name in names:
        command = main.get_command(context, name)
        assert command is not None
        assert command.name == name
        text = invoke(name, "--help").output
        assert len(command.help or "") > 40
        assert all(getattr(p, "help", "") for p in command.params if p.param_type_name == "option"), command.name
        assert "Usage" in text


def test_no_line_of_the_overview_is_cut_off() -> None:
    shown = CliRunner().invoke(main, ["--help"], terminal_width=80).output
    assert "..." not in shown.partition("Commands:")[2]
