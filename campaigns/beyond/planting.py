"""Plant a fault: for a while one engine's adapter is what it would be if a user had made that mistake in it."""

from __future__ import annotations

import contextlib
import functools
import importlib
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any, cast

from campaigns.beyond.fault import Fault, join_options
from crosscheck.engines import ENGINES
from crosscheck.engines.base import Adapter, Options, offered
from crosscheck.measures.record import Record
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

# Where an adapter takes its engine's own model from, and where it makes series of one run inside the engine.
BUILDERS = {
    "pinocchio": ("crosscheck.engines.pinocchio.adapter", "crosscheck.engines.pinocchio.certificate"),
    "mujoco": ("crosscheck.engines.mujoco.adapter", "crosscheck.engines.mujoco.certificate"),
}
RUNS = (
    ("crosscheck.engines.exudyn.run_in_time", "_collect_series"),
    ("crosscheck.engines.exudyn.loops", "collect_flexible_series"),
    ("crosscheck.engines.exudyn.loops", "_collect_rigid_series"),
)


@contextlib.contextmanager
def apply_fault(fault: Fault, engine: str) -> Iterator[None]:
    """Make every run and every certificate of one engine those of a user who made the mistake; undone at the end.

    Whoever asks the engine meanwhile, a diagnosis too, gets the harmed one: a bug is there whoever looks.
    """
    name = ENGINES[engine].module
    with contextlib.ExitStack() as stack:
        module = importlib.import_module(name)
        stack.enter_context(replace_in_module(module, "run", functools.partial(_run, module.run, fault, engine)))
        if (certify := offered(cast(Adapter, module), "certify")) is not None:
            stack.enter_context(
                replace_in_module(module, "certify", functools.partial(_compute_certificate, certify, fault, engine))
            )
        for other in BUILDERS.get(engine, ()) if fault.built is not None else ():
            home = importlib.import_module(other)
            stack.enter_context(replace_in_module(home, "build", functools.partial(_build, home.build, fault)))
        for other, function in RUNS if fault.raw is not None else ():
            home = importlib.import_module(other)
            stack.enter_context(
                replace_in_module(home, function, functools.partial(_compute_series, getattr(home, function), fault))
            )
        yield


@contextlib.contextmanager
def replace_in_module(module: ModuleType, name: str, new: Callable[..., Any]) -> Iterator[None]:
    """Put something else in a module for a while."""
    old = getattr(module, name)
    setattr(module, name, new)
    try:
        yield
    finally:
        setattr(module, name, old)


def _run(
    old: Callable[..., Record],
    fault: Fault,
    harmed: str,
    mechanism: Mechanism,
    case: Case,
    engine: str,
    options: Options,
) -> Record:
    if engine != harmed:
        return old(mechanism, case, engine, options)
    other = fault.mechanism(mechanism)
    record = old(other, fault.case(other, case), engine, join_options(options, fault))
    return fault.record(record, mechanism, case) if record.status == "ok" else record


def _compute_certificate(
    old: Callable[..., Any], fault: Fault, harmed: str, mechanism: Mechanism, case: Case, engine: str
) -> Any:
    """The certificate of the harmed model: where it is asked comes from primary data, whatever motion the user ran."""
    return old(fault.mechanism(mechanism) if engine == harmed else mechanism, case, engine)


def _build(old: Callable[..., Any], fault: Fault, mechanism: Mechanism, *words: Any, **named: Any) -> Any:
    built = old(mechanism, *words, **named)
    if fault.built is not None:
        fault.built(built, mechanism)
    return built


def _compute_series(old: Callable[..., Any], fault: Fault, *words: Any, **named: Any) -> Any:
    series = old(*words, **named)
    return series if fault.raw is None else fault.raw(series)
