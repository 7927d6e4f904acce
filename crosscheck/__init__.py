"""crosscheck: one mechanism in several engines, each built from primary data, compared quantity by quantity and judged."""

from __future__ import annotations

import importlib
from typing import Any

# What scripts and tests use, imported when it is asked for.
_HOME = {
    "compare": "crosscheck.equivalence.compare",
    "assert_same": "crosscheck.equivalence.assert_same",
    "identify": "crosscheck.identification.identify",
    "lint": "crosscheck.linting.lint",
}
__all__ = ["assert_same", "compare", "identify", "lint"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'crosscheck' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
