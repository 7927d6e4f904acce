"""Ctrl-C and a polite kill are words from the first import on, and what strangers write is no command for a terminal."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from crosscheck.cli import main
from crosscheck.commands import selftest
from crosscheck.commands.shared.terminal import Console, Failure, replace_control_characters
from crosscheck.verdicts.results import Results

EVIL = "\x1b]0;owned\x07\x1b[2J[red]a[/red]\u202eb\x9bc\r"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_of_the_first_moment_is_words(number: signal.Signals) -> None:
    """Its signal comes when the entry point is imported, and the commands are not."""
    program = f"""
import importlib, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from crosscheck import start
found = importlib.import_module
def interrupted(name, *rest):
    os.kill(os.getpid(), {int(number)})
    return found(name, *rest)
importlib.import_module = interrupted
sys.argv = ["crosscheck", "list"]
start.main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", "Error: interrupted\n")


def test_controls_of_strangers_are_shown_as_replacements(capsys: pytest.CaptureFixture[str]) -> None:
    Console(force_terminal=False).print(EVIL)
    told = capsys.readouterr().out
    assert not set("\x1b\x07\x9b\r\u202e") & set(told)
    assert "owned" in told
    assert "\x1b" not in str(Failure(EVIL))
    assert replace_control_characters("a\tb\nc é 角") == "a\tb\nc é 角"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_after_the_last_word_comes_too_late(number: signal.Signals) -> None:
    """Everything is done, and Python leaves: the exit code stays what the command said."""
    program = f"""
import atexit, os, sys
from crosscheck import start
atexit.register(os.kill, os.getpid(), {int(number)})
sys.argv = ["crosscheck", "--help"]
start.main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_selftest_that_was_interrupted_says_so(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cut = Results("2026-03-01T01:00:00+00:00", finished=False, message="interrupted before everything was run")
    monkeypatch.setattr(selftest, "run", lambda *given: cut)
    words = ["selftest", "rigid_3r", "--models", str(root / "models"), "--out", str(tmp_path / "report")]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 2, done.output
    assert "interrupted before everything was run" in done.output
