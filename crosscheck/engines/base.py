"""Protocol of an adapter module: four functions.  One module may offer several engines (formulations)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from crosscheck.measures.record import Record
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

Options = Mapping[str, Any]


class Adapter(Protocol):
    """An engine behind its door; a module with these functions is one.

    It reads primary data from the mechanism and the case, and imports none of flexinv's numerical modules
    (the adapter of flexinv itself excepted).  It runs in a child process with a time limit and may raise:
    the exception's words become the record's message.
    """

    def version(self) -> str:
        """Return the version of the engine that is installed."""

    def abilities(self) -> str:
        """Return one sentence: what the engine can do here."""

    def unsupported(self, mechanism: Mechanism, case: Case, engine: str) -> str | None:
        """Return the reason why the engine cannot do this case, or None when it can."""

    def run(self, mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
        """Return series on ``sample_times(case)``.  Forces [N], moments [N m], lengths [m]."""


def sample_times(case: Case) -> NDArray[np.float64]:
    """Return the times at which every engine reports: 0, sample, ..., end.

    returns : (samples,) [s]
    """
    return np.arange(0.0, case.end + case.sample / 2, case.sample, dtype=np.float64)


def companion(adapter: str, part: str) -> str:
    """Return the dotted name of the module with a ``part`` of an adapter's work [-], which lies beside the adapter.

    ``pinocchio.adapter`` has ``pinocchio.export``; ``mujoco.flex``, the second adapter of its folder, ``mujoco.flex_export``.
    """
    folder, _, name = adapter.rpartition(".")
    return f"{folder}.{part}" if name == "adapter" else f"{adapter}_{part}"
