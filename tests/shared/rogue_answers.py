"""Engines that misbehave when they are asked what they can do, by their names; of "deaf" every second case."""

from __future__ import annotations

import os
import time as clock

from rogue_engines import abilities, run, version

from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

__all__ = ["abilities", "run", "unsupported", "version"]


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    if engine == "killed":
        os.write(2, b"asked too much\n")
        os.abort()
    if engine == "hanging":
        clock.sleep(600.0)
    if engine == "raising":
        raise ArithmeticError("no answer")
    return "has no legs" if engine == "refusing" else None
