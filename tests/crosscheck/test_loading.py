"""What a process loads before it does anything: many are started, and each waits for all of it."""

from __future__ import annotations

import subprocess
import sys

import pytest

COMPILER = ("numba", "llvmlite")
SLOW = (
    "pandas",
    "scipy.optimize",
    "scipy.signal",
    "scipy.stats",
    "sqlalchemy",
    "matplotlib",
    "plotly",
    "mujoco",
    "pinocchio",
)
ENGINE = ("crosscheck.run.child", (*COMPILER, *SLOW))
COMMANDS = [(f"crosscheck.commands.{name}", (*COMPILER, *SLOW)) for name in ("run", "report", "bless", "kit")]
IDENTIFY = ("crosscheck.commands.identify", tuple(name for name in SLOW if name != "pandas"))


def list_loaded(module: str, names: tuple[str, ...]) -> list[str]:
    code = f"import sys, {module}\nprint(*[name for name in {names!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize(("module", "names"), [ENGINE, *COMMANDS, IDENTIFY])
def test_a_process_loads_nothing_that_its_job_may_not_need(module: str, names: tuple[str, ...]) -> None:
    assert list_loaded(module, names) == []


def test_what_is_loaded_is_seen() -> None:
    assert list_loaded("crosscheck.equivalence.efforts", COMPILER) == list(COMPILER)
