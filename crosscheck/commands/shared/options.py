"""Options that the commands that run engines have in common, and the work that follows from them."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import click

from crosscheck.commands.shared.terminal import (
    JOBS,
    MODELS,
    PATTERNS,
    TIMEOUT,
    Failure,
    match_engines,
    match_entries,
    plan_of,
    split_patterns,
)
from crosscheck.doors.registry import ProjectEngines, add_engine_limits, collect_doors, compute_answer_digest
from crosscheck.engines import ENGINES, Engine, NamedDoor
from crosscheck.run.work import Options, Work
from crosscheck.studies import STUDIES, Study
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.scope import Scope
from flexinv.errors import InputError
from flexinv.files.toml_tables import read_toml

DECLARED = "studies.toml"  # in a folder of models: which studies belong to it
CONFIG = click.option(
    "--config",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File that names programs, FMUs and Python objects as engines.  [default: crosscheck.toml above the models]",
)
NAMED = click.option(
    "--engine",
    multiple=True,
    metavar="MODULE:NAME",
    help="A Python object as an engine, without installation; repeatable.",
)
TRUST = click.option(
    "--trust-commands", is_flag=True, help="Run programs of crosscheck.toml without `crosscheck trust` (in CI)."
)
DOORS = (CONFIG, NAMED, TRUST)
OPTIONS = (
    click.argument("names", nargs=-1),
    MODELS,
    PATTERNS,
    click.option(
        "--studies",
        help="Names or patterns of the studies; '' for none.  [default: those that studies.toml in the models names]",
    ),
    click.option(
        "--scheduler", default="", help="Address of a Dask scheduler, tcp://host:8786: engines run on its workers."
    ),
    click.option("--resume", is_flag=True, help="Take over what an interrupted run has left there; run the rest."),
    JOBS,
    TIMEOUT,
    *DOORS,
)


class StudyOptions(TypedDict):
    """Options of a study: the folder of models, and the project's own engines for one that asks for them."""

    models: str
    engines: NotRequired[list[NamedDoor]]


@dataclass(frozen=True)
class RunSelection:
    """Selection of mechanisms, engines and studies, in the words of the command line; timeout [s]."""

    names: tuple[str, ...]
    models: Path
    engines: str
    studies: str | None
    scheduler: str
    resume: bool
    jobs: int
    timeout: float
    config: Path | None
    engine: tuple[str, ...]
    trust_commands: bool

    def prepare_work(self, say: Callable[[str], None]) -> Work:
        """Return the work; say : is told which programs run.

        Raises Failure where a name or a pattern leads to nothing, or a program is not trusted.
        """
        importlib.import_module("jinja2")  # a report needs it at the very end: who has none learns it now
        known = collect_engines(self.models, self.config, self.engine)
        engines = match_engines(known.engines, self.engines)
        absent = tuple(name for name, engine in engines.items() if not engine.has_tool)
        scope = Scope(self.names, tuple(split_patterns(self.engines)), absent)
        options = Options(self.timeout, self.jobs, scheduler=self.scheduler, resume=self.resume, scope=scope)
        check_trust(known, engines, self.trust_commands, say)
        # a reader who names mechanisms wants those; the studies belong to the whole
        wanted = ("" if self.names else read_study_patterns(self.models)) if self.studies is None else self.studies
        tables = match_entries(STUDIES, wanted, "study")
        studies = (replace(study, options=self._make_study_options(study, engines)) for study in tables.values())
        plan = add_engine_limits(plan_of(self.models, self.names), engines)
        return Work(plan, engines, tuple(studies), options)

    def _make_study_options(self, study: Study, engines: Mapping[str, Engine]) -> StudyOptions:
        """Return the options of a study: the folder of models, and to one that asks for them the project's engines."""
        models = self.models.resolve()
        strangers = [engine for name, engine in engines.items() if name not in ENGINES]
        folders = sorted(file.parent for file in models.glob("*/mechanism.toml"))
        stamps = {engine.name: [compute_answer_digest(engine, folder) for folder in folders] for engine in strangers}
        options: StudyOptions = {"models": str(models)}
        if study.asks and strangers:
            options["engines"] = [
                {**engine.door, "engine": engine.name, "stamp": stamps[engine.name]} for engine in strangers
            ]
        return options


def collect_engines(models: Path, config: Path | None = None, named: Iterable[str] = ()) -> ProjectEngines:
    """Return the engines of a folder of models.  Raises Failure where a file is refused."""
    try:
        return collect_doors(models, config, named)
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error


def check_trust(known: ProjectEngines, chosen: Iterable[str], trusting: bool, say: Callable[[str], None]) -> None:
    """Say which programs run.  Raises Failure where one is not trusted."""
    try:
        known.check_trust(chosen, trusting, say)
    except InputError as error:
        raise Failure(str(error)) from error


def read_study_patterns(models: Path) -> str:
    """Return the patterns of the studies that belong to a folder of models, as its studies.toml says; "" without one.

    Raises Failure where it says something else.
    """
    file = models / DECLARED
    if not file.exists():
        return ""
    try:
        table = read_toml(file)
    except InputError as error:
        raise Failure(str(error)) from error
    names = table.get("studies")
    if set(table) != {"studies"} or not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise Failure(f'{file}: expected one list of names; write studies = ["{next(iter(STUDIES))}"]')
    if unknown := [name for name in names if name not in STUDIES]:
        raise Failure(f"{file}: no study is called {unknown[0]!r}; known: {', '.join(STUDIES)}")
    return ",".join(names)


def add_run_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of what to run: it is called with them as one ``RunSelection``, and with its own by name."""

    @functools.wraps(command)
    def run_with_options(**words: Any) -> Any:
        run_selection = RunSelection(**{field.name: words.pop(field.name) for field in fields(RunSelection)})
        return command(run_selection, **words)

    for option in reversed(OPTIONS):
        run_with_options = option(run_with_options)
    return run_with_options


def find_task(models: Path, name: str, case: str | None) -> Task:
    """Return the task of one case; without its name that of the only one.  Raises Failure."""
    plan = plan_of(models, (f"{name}/{case}" if case else name,))
    if plan.broken:
        raise Failure(f"{plan.broken[0][0]} cannot be read: {plan.broken[0][1]}")
    if len(plan.tasks) > 1:
        raise Failure(
            f"{name} has several cases: write --case with one of {', '.join(t.case.name for t in plan.tasks)}"
        )
    return plan.tasks[0]
