"""An engine whose import starts a thread, as pools of OpenMP and runtimes of graphics cards do: it must not be forked."""

from __future__ import annotations

import threading

from rogue_engines import abilities, run, unsupported, version

__all__ = ["abilities", "run", "unsupported", "version"]

threading.Thread(target=threading.Event().wait, daemon=True).start()
