"""Calls of a program, followed while it runs: from one function to all others of the package, as paths of names.

Kernels are Python here (NUMBA_DISABLE_JIT), so that a profile sees every call, those between kernels too: what runs is followed,
not what the source could call.  Run in a process of its own: ``python followed_calls.py`` prints the paths as JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

from bending_four_bar import bending
from flexible_examples import HALF_TURN, TREE_MOTION, arm, spatial_tree
from four_bar_example import START, TURN

import flexinv
from flexinv.model.mechanism import Mechanism

ROOT = Path(flexinv.__file__).parent
Calls = tuple[str, ...]
# A decorator that keeps results: what it stands before is the call, as with `functools.lru_cache`.
KEPT = "model/owned_cache.run_cached"


def name_of(frame: FrameType) -> str | None:
    """Return ``folder/module.function`` of a frame of the package, None of all others and of comprehensions."""
    code, file = frame.f_code, frame.f_code.co_filename
    if not file.startswith(str(ROOT)) or code.co_name.startswith("<"):
        return None
    name = f"{Path(file).relative_to(ROOT).with_suffix('').as_posix()}.{code.co_name}"
    return None if name == KEPT else name


def paths(task: Callable[[], object], begin: str) -> set[Calls]:
    """Return the paths of calls, each from the function ``begin`` on, that a task goes; a generator is called by who asks it."""
    result: set[Calls] = set()
    open_calls: dict[int, Calls] = {}

    def entered(frame: FrameType, event: str, _: Any) -> None:
        if event == "return":
            open_calls.pop(id(frame), None)
        if event != "call" or (name := name_of(frame)) is None:
            return
        above = frame.f_back
        while above is not None and id(above) not in open_calls:
            above = above.f_back
        before = open_calls[id(above)] if above is not None else ()
        if before or name == begin:
            open_calls[id(frame)] = (*before, name)
            result.add(open_calls[id(frame)])

    sys.setprofile(entered)
    try:
        task()
    finally:
        sys.setprofile(None)
    return result


def coarse(mechanism: Mechanism) -> Mechanism:
    """Return it with fewer points on its beams, on which the same calls are made."""
    links = [replace(link, beam=link.beam and replace(link.beam, order=2)) for link in mechanism.links]
    return replace(mechanism, links=tuple(links))


def main() -> None:
    """Print the paths of `solve` for beams that move in a plane, in space, and in a closed loop."""
    step, end = 1e-3, 1e-3  # [s]: a second step makes no other call
    tasks = {
        "plane": lambda: flexinv.solve(arm(), HALF_TURN, step=step, end=end),
        "space": lambda: flexinv.solve(coarse(spatial_tree()), TREE_MOTION, step=step, end=end),
        "loop": lambda: flexinv.solve(coarse(bending()), TURN, step=step, end=end, start=START),
    }
    json.dump({name: sorted(paths(task, "analysis/solve.solve")) for name, task in tasks.items()}, sys.stdout)


if __name__ == "__main__":
    main()
