"""What every test shares."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest

# Every run of a test computes everything, whatever earlier runs on this machine have kept; tests of kept answers say so.
os.environ["CROSSCHECK_KEPT"] = ""
# Matrices here are small: a second thread of BLAS waits by spinning, which takes half of a processor's time and gives nothing.
# NumPy reads this when it is imported, which is later; the processes of engines have one thread anyway.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Some hundreds of processes import the project: what one of them has compiled to bytecode is kept for the others.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# What is imported and collected stays to the end: looking for garbage among it took 8 % of the tests' time.
gc.set_threshold(50_000)


# What takes half a minute or more in one piece: begun last, it would keep one worker busy alone.
LONGEST = ("test_types.py", "test_site.py", "test_tutorial.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest."""
    items.sort(key=lambda item: item.path.name not in LONGEST)


def pytest_collection_finish() -> None:
    """Leave what stays to the end out of the search for garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def root() -> Path:
    """The folder of the project."""
    return Path(__file__).resolve().parent.parent
