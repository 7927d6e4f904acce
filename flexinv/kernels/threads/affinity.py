"""Processors and the threads on them.

Some systems, virtual machines above all, let a thread begin on the processor of the one that starts or wakes it, and leave it
there for milliseconds though others are idle: the two take turns.  So threads go elsewhere by themselves.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from ctypes import CDLL
from functools import cache
from pathlib import Path

from flexinv.errors import InputError

GROUP = Path("/sys/fs/cgroup")


def count_processors() -> int:
    """Return the number of processors that this process may use [-], a container's limit and `read_thread_limit` included."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min(allowed, read_granted_processors(), read_thread_limit())))


@cache
def read_thread_limit() -> int:
    """Return the number of threads [-] that a call may use by ``FLEXINV_THREADS``: 1 for no helpers, no limit without it."""
    stated = os.environ.get("FLEXINV_THREADS", "").strip()
    if stated and not (stated.isdecimal() and int(stated) > 0):
        expected = "expected a whole number of threads, 1 or more; write FLEXINV_THREADS=1"
        raise InputError(f"FLEXINV_THREADS = {stated!r}: {expected}")
    return int(stated) if stated else sys.maxsize


def read_granted_processors() -> float:
    """Return the number of processors whose time a container may use [-], infinite without a limit.

    More threads than that are stopped, all of them, for most of every tenth of a second.  Source: cgroup-v2.rst and
    sched-bwc.rst of Linux, "cpu.max" and "cpu.cfs_quota_us".
    """
    for files in (["cpu.max"], ["cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us"]):
        with suppress(OSError, ValueError):
            quota, period = " ".join((GROUP / name).read_text(encoding="ascii") for name in files).split()
            return math.inf if quota in ("max", "-1") else int(quota) / int(period)
    return math.inf


def _make_processor_finder() -> Callable[[], int]:
    """Return a function for the processor of the calling thread: -1 if the system does not tell or lets no thread move."""
    if not hasattr(os, "sched_setaffinity"):
        return lambda: -1
    try:
        processor_finder: Callable[[], int] = CDLL(None).sched_getcpu
    except (AttributeError, OSError, TypeError):
        return lambda: -1
    return processor_finder


processor_now = _make_processor_finder()


def move_from_processor(processor: int) -> None:
    """Move this thread from a processor [-] to any other that it may use, if it is there; it may come back later."""
    if processor < 0 or processor_now() != processor:
        return
    allowed = os.sched_getaffinity(0)
    _move(allowed - {processor}, allowed)


def move_to_processor(number: int, first: int) -> None:
    """Move this thread to the processor that is so many after the ``first`` [-] among those that it may use."""
    if first < 0:
        return
    allowed = os.sched_getaffinity(0)
    order = sorted(allowed)
    at = order.index(first) if first in allowed else 0
    _move({order[(at + number) % len(order)]}, allowed)


def _move(to: set[int], allowed: set[int]) -> None:
    """Go there, where the system lets: sandboxes may not."""
    if to and len(allowed) > 1:
        with suppress(OSError):
            os.sched_setaffinity(0, to)
            os.sched_setaffinity(0, allowed)
