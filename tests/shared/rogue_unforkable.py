"""An engine that says that it must not be forked."""

from __future__ import annotations

from rogue_engines import abilities, run, unsupported, version

__all__ = ["abilities", "forkable", "run", "unsupported", "version"]

forkable = False
