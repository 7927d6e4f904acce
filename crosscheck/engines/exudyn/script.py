"""Record of a run in Exudyn: every item that was added and the solver's settings, while ``collect_runs`` is on.

with recording() as runs:
    exudyn.run(...)                 -> runs: one Recorded per solve, in order
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np

from flexinv.model.attachments import GasLaw, Spring, TableLaw

SPRING = "spring"  # attribute of a user function: the spring whose law it is
ADDED = ("AddNode", "AddObject", "AddMarker", "AddLoad", "AddSensor")


@dataclass(frozen=True)
class RecordedSolve:
    """One solve: the calls (method, item) that built the system, the plan, the drivers, the sensors by key, what loads that
    vary are at a time, by number, and which of the connectors that are switched act from which time [s] on.
    """

    calls: tuple[tuple[str, Any], ...]
    plan: Any
    drivers: tuple[Any, ...]
    motions: dict[Any, Any]
    reactions: dict[Any, Any]
    loads: dict[Any, Any]
    switched: tuple[int, ...] = ()
    acting: tuple[tuple[float, tuple[int, ...]], ...] = ()


RUNS: ContextVar[list[RecordedSolve] | None] = ContextVar("RUNS", default=None)


@contextmanager
def collect_runs() -> Iterator[list[RecordedSolve]]:
    """Record every solve inside."""
    runs: list[RecordedSolve] = []
    token = RUNS.set(runs)
    try:
        yield runs
    finally:
        RUNS.reset(token)


class RecordingSystem:
    """A system that remembers what is added to it and is otherwise the system itself."""

    def __init__(self, mbs: Any) -> None:
        self.mbs = mbs
        self.calls: list[tuple[str, Any]] = []
        self.switched: tuple[int, ...] = ()
        self.acting: tuple[tuple[float, tuple[int, ...]], ...] = ()

    def __getattr__(self, name: str) -> Any:
        result = getattr(self.mbs, name)
        if name not in ADDED:
            return result

        def add(item: Any) -> Any:
            self.calls.append((name, item))
            return result(item)

        return add


def make_listener(mbs: Any) -> Any:
    """Return the system, or one that listens while recording is on."""
    return mbs if RUNS.get() is None else RecordingSystem(mbs)


def add_solve_record(
    mbs: Any,
    plan: Any,
    drivers: list[Any],
    motions: dict[Any, Any],
    reactions: dict[Any, Any],
    loads: Mapping[Any, Any],
) -> None:
    """Take down a solve, where recording is on."""
    runs = RUNS.get()
    if runs is not None and isinstance(mbs, RecordingSystem):
        told = tuple(mbs.calls), plan, tuple(drivers), dict(motions), dict(reactions), dict(loads)
        runs.append(RecordedSolve(*told, mbs.switched, mbs.acting))


def add_switch_record(mbs: Any, switched: tuple[int, ...], acting: tuple[tuple[float, tuple[int, ...]], ...]) -> None:
    """Take down which connectors are switched, and which of them act from which time [s] on, where recording is on."""
    if isinstance(mbs, RecordingSystem):
        mbs.switched = switched
        mbs.acting = acting


def write_model_code(run: RecordedSolve) -> str:
    """Return Python that builds the system ``mbs`` again, one line per item, numbers in full."""
    lines = [f"    mbs.{method}({_format_item(item)})" for method, item in run.calls]
    return "def build(mbs):\n" + "\n".join(lines) + "\n"


def _format_item(item: Any) -> str:
    stated = vars(item)
    usual = vars(type(item)())
    # laws of springs are written as they are; other user functions are put in before the run, from tables
    said = {k: v for k, v in stated.items() if k != "visualization" and not callable(v)}
    words = [f"{k}={_format_value(v)}" for k, v in said.items() if _format_value(v) != _format_value(usual[k])]
    words += [f"{k}={format_law(getattr(v, SPRING))}" for k, v in stated.items() if hasattr(v, SPRING)]
    return f"{type(item).__name__}({', '.join(words)})"


def format_law(spring: Spring) -> str:
    """Return the call that makes the user function of a spring with a law, as `HEAD` of the export defines it."""
    law = spring.law
    if isinstance(law, GasLaw):
        return f"gas({spring.rest!r}, {law.force!r}, {law.travel!r}, {law.exponent!r})"
    assert isinstance(law, TableLaw)
    first, *others = law.list_pieces().tolist()
    return f"pieces({spring.rest!r}, {[[others[0][0], *first[1:]], *others]!r})"


def _format_value(value: Any) -> str:
    if isinstance(value, exu.BeamSection):
        parts = {
            k: _format_value(getattr(value, k))
            for k in ("massPerLength", "inertia", "stiffnessMatrix", "dampingMatrix")
        }
        return f"section({', '.join(f'{k}={v}' for k, v in parts.items())})"
    if isinstance(value, exu.OutputVariableType):
        return f"exu.OutputVariableType.{value.name}"
    if isinstance(value, (np.ndarray, list, tuple)):
        return "[" + ", ".join(_format_value(x) for x in value) + "]"
    if isinstance(value, (bool, np.bool_)):
        return repr(bool(value))
    if isinstance(value, (int, np.integer)):
        return repr(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, str) or value is None:
        return repr(value)
    return str(int(value))  # Exudyn's indices of nodes, objects, markers
