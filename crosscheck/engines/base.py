"""Protocol of an adapter: four functions, and seven more that it may have.  One adapter may offer several engines."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from crosscheck.measures.certificate import Certificate
from crosscheck.measures.record import Record
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

if TYPE_CHECKING:
    from crosscheck.engines.shared.replay import DriveTorques
    from crosscheck.lifting.description import Description
    from crosscheck.lifting.reader_dynamics import ReaderDynamics

Array = NDArray[np.float64]
Options = Mapping[str, Any]


class Adapter(Protocol):
    """An engine behind its door; a module with these functions is one, and so is an object with these methods.

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


class FullAdapter(Adapter, Protocol):
    """An adapter with all optional functions; the report omits what an adapter does not implement.

    ``repeatable = False`` says that it gives the same whatever mechanism it is asked for: a record, no program.
    ``forkable = False`` says that a process that has imported it must not be forked: each of its jobs imports it anew.
    """

    def certify(self, mechanism: Mechanism, case: Case, engine: str) -> Certificate:
        """Return the certificate of the engine's own model.  Raises InputError where it has nothing to say."""

    def export(self, mechanism: Mechanism, case: Case, engine: str, effort: Array, folder: Path) -> None:
        """Write what the engine was given, with the expected effort (samples, nv) [N m], [N]; NotExported where it cannot."""

    def replay(self, mechanism: Mechanism, drive: DriveTorques, **settings: float) -> dict[str, Array]:
        """Let torques drive the free arm; tips (samples, 3) [m] by link."""

    def lift(self, source: Any) -> Description:
        """Return the description of a file as the engine's own reader has it, or of a model in memory.  Raises InputError.

        Its ``dynamics`` are those of the compiled model: without them `crosscheck compare` calls the description not proven.
        What the model does and a mechanism cannot say is one of its ``features``.
        """

    def lifts(self, source: Any) -> bool:
        """Return True if something in memory is a model of this engine."""

    def dynamics(self, path: Path, mechanism: Mechanism) -> ReaderDynamics:
        """Return the engine's own model of a file, in the coordinates of a mechanism that another reader made of it.

        Joints are found by name.  Raises InputError where the engine refuses the file, or has other joints.
        """


MEMBERS = ("certify", "export", "replay", "lift", "lifts", "dynamics")


def offered(adapter: Adapter, member: str) -> Callable[..., Any] | None:
    """Return one of ``MEMBERS`` of an adapter, None where it has none."""
    assert member in MEMBERS
    result: Callable[..., Any] | None = getattr(adapter, member, None)
    return result


def is_repeatable(adapter: Adapter) -> bool:
    """Return True if an adapter computes: asked for another mechanism it gives another answer."""
    return bool(getattr(adapter, "repeatable", True))


def can_fork_jobs(adapter: Adapter) -> bool:
    """Return True if jobs may be forked from a process that has imported an adapter (`crosscheck.run.fork_server`)."""
    return bool(getattr(adapter, "forkable", True))


def prepare_adapter(adapter: Adapter) -> None:
    """Import what every run of an adapter needs and it imports late: the module of its certificate."""
    if module := getattr(getattr(adapter, "certify", None), "module", ""):
        importlib.import_module(module)


def beside(module: str, member: str) -> Callable[..., Any]:
    """Return a member of an adapter that another module defines; it is imported when the member is called."""

    return _LazyFunction(module, member)


@dataclass(frozen=True)
class _LazyFunction:
    """A function of a module that is imported when it is called."""

    module: str
    member: str

    def __call__(self, *words: Any, **named: Any) -> Any:
        return getattr(importlib.import_module(self.module), self.member)(*words, **named)
