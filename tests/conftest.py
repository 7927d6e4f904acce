"""What every test shares."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Every run of a test computes everything, whatever earlier runs on this machine have kept; tests of kept answers say so.
os.environ["CROSSCHECK_KEPT"] = ""
# Tests run side by side, one on each processor: threads of matrix products, which wait turning in circles, would be in the way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def root() -> Path:
    """The folder of the project."""
    return Path(__file__).resolve().parent.parent
