"""What every test shares."""

from __future__ import annotations

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


@pytest.fixture(scope="session")
def root() -> Path:
    """The folder of the project."""
    return Path(__file__).resolve().parent.parent
