"""The work of a run: cases, engines, studies and options; and what is told while it goes on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crosscheck.engines import Engine
from crosscheck.engines.base import Options as EngineOptions
from crosscheck.verdicts.baseline import Baseline
from crosscheck.verdicts.plan import Plan
from crosscheck.verdicts.scope import Scope


@dataclass(frozen=True)
class Study:
    """A named study: the function of a module, and what it is called with (JSON values).

    asks : its function is told the project's own engines, too (``engines``: doors for `crosscheck.engines.open_adapter`)
    path : folder that its module is imported from, where that is not installed
    """

    name: str
    title: str
    module: str
    function: str = "run_study"
    options: Mapping[str, Any] = field(default_factory=dict)
    asks: bool = False
    path: str = ""


@dataclass(frozen=True)
class Options:
    """Options of a run: timeout [s] per engine and case, jobs at a time, options for the engines.

    scheduler : address of a Dask cluster, "" for this machine; resume : take what an interrupted run left in the folder
    baseline : the blessed night that judges beside the limits, or None
    scope : what is asked for: what is blessed of it and not measured any more is gone
    kept : folder of answers of earlier runs, which are taken where nothing has changed (`crosscheck.run.answer_cache`), or None
    fresh : everything is computed all the same, and kept
    asking : engines repeat what their error bars explain, and are asked why where they deviate
    climbing : what takes least comes first, and the reference runs only where another engine came to an answer
    """

    timeout: float = 900.0
    jobs: int = 1
    engine: EngineOptions = field(default_factory=dict)
    scheduler: str = ""
    resume: bool = False
    baseline: Baseline | None = None
    scope: Scope = field(default_factory=Scope)
    kept: Path | None = None
    fresh: bool = False
    asking: bool = True
    climbing: bool = False


@dataclass(frozen=True)
class Work:
    """Work of a run: cases, engines, studies and options."""

    plan: Plan
    engines: Mapping[str, Engine]
    studies: tuple[Study, ...] = ()
    options: Options = Options()


@dataclass(frozen=True)
class Event:
    """Something that finished, for a progress display."""

    label: str
    verdict: str
    message: str
    done: int
    total: int


Notify = Callable[[Event], None]
