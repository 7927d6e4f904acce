"""What the commands that run engines are asked for: the options they have in common, and what follows from them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import click

from crosscheck.engines import Engine
from crosscheck.runner import Options, Work
from crosscheck.studies import STUDIES
from crosscheck.terminal import JOBS, MODELS, PATTERNS, TIMEOUT, chosen, plan_of

OPTIONS = (
    click.argument("names", nargs=-1),
    MODELS,
    PATTERNS,
    click.option("--studies", default="*", show_default=True, help="Names or patterns of the studies; '' for none."),
    click.option(
        "--scheduler", default="", help="Address of a Dask scheduler, tcp://host:8786: engines run on its workers."
    ),
    click.option("--resume", is_flag=True, help="Take over what an interrupted run has left there; run the rest."),
    JOBS,
    TIMEOUT,
)


@dataclass(frozen=True)
class Asked:
    """What shall run, in the words of the command line; timeout [s]."""

    names: tuple[str, ...]
    models: Path
    engines: str
    studies: str
    scheduler: str
    resume: bool
    jobs: int
    timeout: float

    def work(self, known: Mapping[str, Engine]) -> Work:
        """Return what that means among the known engines.  Raises Failure where a name or a pattern leads to nothing."""
        options = Options(self.timeout, self.jobs, scheduler=self.scheduler, resume=self.resume)
        engines = chosen(known, self.engines, "engine")
        # a reader who names mechanisms wants those; the studies belong to the whole
        tables = {} if self.names and self.studies == "*" else chosen(STUDIES, self.studies, "study")
        studies = (replace(study, options={"models": str(self.models.resolve())}) for study in tables.values())
        return Work(plan_of(self.models, self.names), engines, tuple(studies), options)


def running(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of what to run: it is called with them as one ``Asked``, and with its own by name."""

    @functools.wraps(command)
    def called(**words: Any) -> Any:
        asked = Asked(**{field.name: words.pop(field.name) for field in fields(Asked)})
        return command(asked, **words)

    for option in reversed(OPTIONS):
        called = option(called)
    return called
