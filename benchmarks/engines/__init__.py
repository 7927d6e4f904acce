"""Calls of other engines whose time is taken: on the models that crosscheck's adapters build, and nothing kept but torques."""

from __future__ import annotations

import importlib
from typing import Any


def open_calls(engine: str) -> Any:
    """Import the module of one engine's calls: "pinocchio", "mujoco" or "exudyn".  Raises ImportError."""
    return importlib.import_module(f"{__name__}.{engine}")
