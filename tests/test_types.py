"""Types of the packages, the tests and what the tests share are right: the checks of `make lint`, beside the other tests."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["", "tests/shared"])
def test_types_are_right(folder: str, root: Path) -> None:
    if importlib.util.find_spec("mypy") is None:
        pytest.skip("mypy is not installed")
    files = sorted(str(path) for path in (root / folder).glob("*.py")) if folder else []
    words = [sys.executable, "-m", "mypy", "--cache-dir", str(root / ".mypy_cache" / folder), *files]
    surroundings = {**os.environ, "MYPYPATH": str(root / folder) if folder else ""}
    done = subprocess.run(words, cwd=root, env=surroundings, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
