"""What every test shares."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Every run of a test computes everything, whatever earlier runs on this machine have kept; tests of kept answers say so.
os.environ["CROSSCHECK_KEPT"] = ""


@pytest.fixture(scope="session")
def root() -> Path:
    """The folder of the project."""
    return Path(__file__).resolve().parent.parent
