"""What several tests share and takes long to make: made once for all workers of pytest-xdist."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import filelock
import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """Return a folder that ``make`` has filled: whoever comes second waits, and takes what is there."""
    own = factory.getbasetemp()
    home = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / name
    with filelock.FileLock(home.with_suffix(".lock")):
        if not (home / "made").exists():
            shutil.rmtree(home, ignore_errors=True)  # of a try that failed: each worker says why
            home.mkdir()
            make(home)
            (home / "made").touch()
    return home
