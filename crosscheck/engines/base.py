"""What an adapter module is: four functions.  One module may offer several engines (formulations)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from crosscheck.record import Record
from flexinv.files.case import Case
from flexinv.mechanism import Mechanism

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
        """Return why the engine cannot do this case, or None when it can."""

    def run(self, mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
        """Return series on ``sample_times(case)``.  Forces [N], moments [N m], lengths [m]."""


def sample_times(case: Case) -> NDArray[np.float64]:
    """Return the times at which every engine reports: 0, sample, ..., end.

    returns : (samples,) [s]
    """
    return np.arange(0.0, case.end + case.sample / 2, case.sample, dtype=np.float64)
