"""Threads that help with one call: they wait between calls, and take what the calling thread has not taken yet."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def processors() -> int:
    """Return how many processors this process may use [-], where the system tells."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Helpers:
    """The waiting threads, started when first needed; a forked child begins without them."""

    def __init__(self) -> None:
        self.size, self.pool = 0, ThreadPoolExecutor(1)
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.forget)

    def forget(self) -> None:
        self.size, self.pool = 0, ThreadPoolExecutor(1)

    def at_least(self, size: int) -> ThreadPoolExecutor:
        if size > self.size:
            self.size, self.pool = size, ThreadPoolExecutor(size, thread_name_prefix="flexinv")
        return self.pool


_HELPERS = _Helpers()


def share(work: Callable[[], int], threads: int) -> int:
    """Return the sum of what ``work`` returns in this thread and in ``threads`` - 1 helpers [-].

    A helper that has not begun when this thread finds nothing left to do is not waited for.
    """
    if threads == 1:
        return work()
    pool = _HELPERS.at_least(threads - 1)
    helping = [pool.submit(work) for _ in range(threads - 1)]
    done = work()
    return done + sum(future.result() for future in helping if not future.cancel())
