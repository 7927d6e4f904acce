"""pytest collects ``models/*/cases.toml``: one test per comparison (mechanism, case, engine, quantity).

``pytest models/`` runs them all, ``pytest models/ -k "four_bar and exudyn-dae and torque"`` some.  Every engine runs
once per case, in a process of its own and however many tests ask for it, also from the workers of pytest-xdist.
Nothing of crosscheck is imported before a ``cases.toml`` beside a ``mechanism.toml`` is found.
"""

from __future__ import annotations

import shutil
import tempfile
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from crosscheck.engines import Engine
    from crosscheck.run.isolation import ChildProcesses
    from crosscheck.run.pair_runner import RunContext
    from crosscheck.verdicts.compare import Comparison
    from crosscheck.verdicts.plan import Task

FOLDER = pytest.StashKey[str]()
OWNED = pytest.StashKey[bool]()
CHILDREN = pytest.StashKey["ChildProcesses"]()
SAID = pytest.StashKey[set[str]]()


class ComparisonFailed(Exception):
    """A comparison that is not within its limit; its text is the report."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of `crosscheck run` that make sense here."""
    group = parser.getgroup("crosscheck", "mechanisms in several engines (models/*/cases.toml)")
    group.addoption(
        "--crosscheck-engines", default="*", metavar="PATTERNS", help="Engines to compare, separated by commas (all)."
    )
    group.addoption(
        "--crosscheck-timeout", type=float, default=900.0, metavar="SECONDS", help="For one engine on one case (900)."
    )
    group.addoption(
        "--crosscheck-baseline",
        metavar="FOLDER",
        help="The blessed night that judges, too (reports/baseline beside the models, where it is; '' for none).",
    )
    group.addoption(
        "--crosscheck-config", metavar="FILE", help="File that names programs as engines (crosscheck.toml)."
    )
    group.addoption(
        "--crosscheck-engine", action="append", default=[], metavar="MODULE:NAME", help="A Python object as an engine."
    )
    group.addoption(
        "--crosscheck-trust-commands",
        "--crosscheck-trust",
        dest="crosscheck_trust_commands",
        action="store_true",
        help="Run programs of crosscheck.toml without crosscheck trust (in CI), as --trust-commands of crosscheck run.",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Take the folder of shared records from the process that leads a distributed run."""
    given = getattr(config, "workerinput", {}).get("crosscheck_records")
    config.stash[OWNED] = given is None
    if given is not None:
        config.stash[FOLDER] = given


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Give every worker of pytest-xdist the same folder of records."""
    node.workerinput["crosscheck_records"] = str(_make_records_folder(node.config))


def pytest_unconfigure(config: pytest.Config) -> None:
    """End the prepared processes, and remove the records."""
    if CHILDREN in config.stash and (servers := config.stash[CHILDREN].servers) is not None:
        servers.close()
    if config.stash.get(OWNED, False) and FOLDER in config.stash:
        shutil.rmtree(config.stash[FOLDER], ignore_errors=True)


def _make_records_folder(config: pytest.Config) -> Path:
    if FOLDER not in config.stash:
        config.stash[FOLDER] = tempfile.mkdtemp(prefix="crosscheck-records-")
    return Path(config.stash[FOLDER])


def _prepare_children(config: pytest.Config) -> ChildProcesses:
    """Return the processes of this run: what engines need is imported once, not for every run of one."""
    if CHILDREN not in config.stash:
        from crosscheck.run.forking import ForkServers
        from crosscheck.run.isolation import ChildProcesses

        config.stash[CHILDREN] = ChildProcesses(servers=ForkServers())
    return config.stash[CHILDREN]


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect a ``cases.toml`` that lies beside a ``mechanism.toml``."""
    if file_path.name == "cases.toml" and (file_path.parent / "mechanism.toml").is_file():
        return CasesFile.from_parent(parent, path=file_path)
    return None


class CasesFile(pytest.File):
    """The cases of one mechanism."""

    def collect(self) -> Iterable[pytest.Item]:
        """Yield one test per comparison that a run would make."""
        from crosscheck.doors.registry import add_engine_limits
        from crosscheck.measures.limits import list_references
        from crosscheck.run.pair_runner import read_blessed_night
        from crosscheck.verdicts.baseline import BaselineError
        from crosscheck.verdicts.plan import discover
        from flexinv.errors import ModelWarning

        folder = self.path.parent
        known = _collect_engines(self.config, folder.parent)
        wanted = _list_wanted_engines(self.config, known)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)  # a run says it in its report
            plan = add_engine_limits(discover(folder.parent, [folder.name]), {name: known[name] for name in wanted})
        if plan.broken:
            raise self.CollectError(plan.broken[0][1])
        try:
            read_blessed_night(_find_baseline(self.config, folder.parent))
        except BaselineError as error:
            raise self.CollectError(str(error)) from error
        for task in plan.tasks:
            for engine in wanted:
                others = list_references(task.case.limits, engine)
                for reference in (r for r in others if r in known):
                    against = "" if reference == "flexinv" else f"-{reference}"
                    for quantity in task.case.quantities:
                        name = f"{folder.name}-{task.case.name}-{engine}{against}-{quantity}"
                        pair = known[engine], known[reference]
                        yield ComparisonItem.from_parent(self, name=name, task=task, pair=pair, quantity=quantity)


def _find_baseline(config: pytest.Config, models: Path) -> Path | None:
    from crosscheck.run.pair_runner import find_blessed_folder

    said = config.getoption("--crosscheck-baseline")
    return find_blessed_folder(models) if said is None else Path(said) if said else None


def _collect_engines(config: pytest.Config, models: Path) -> Mapping[str, Engine]:
    """Return the engines of a folder of models; programs that are chosen have to be trusted."""
    from crosscheck.doors.registry import collect_doors
    from flexinv.errors import InputError

    stated = config.getoption("--crosscheck-config")
    try:
        known = collect_doors(models, Path(stated) if stated else None, config.getoption("--crosscheck-engine"))
        wanted = _list_wanted_engines(config, known.engines)
        known.check_trust(
            wanted, bool(config.getoption("crosscheck_trust_commands")), config.stash.setdefault(SAID, set()).add
        )
    except InputError as error:
        raise pytest.UsageError(str(error)) from error
    return known.engines


def pytest_report_collectionfinish(config: pytest.Config) -> list[str]:
    """Name the programs that are going to run."""
    said: set[str] = config.stash.get(SAID, set())
    return sorted(said)


def _list_wanted_engines(config: pytest.Config, known: Mapping[str, Engine]) -> list[str]:
    from fnmatch import fnmatchcase

    patterns = [p.strip() for p in config.getoption("--crosscheck-engines").split(",") if p.strip()]
    if not patterns:
        raise pytest.UsageError(f"--crosscheck-engines names no engine; known: {', '.join(known)}")
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in known):
            raise pytest.UsageError(f"--crosscheck-engines: no engine is called {pattern!r}; known: {', '.join(known)}")
    return [name for name in known if any(fnmatchcase(name, pattern) for pattern in patterns)]


class ComparisonItem(pytest.Item):
    """One engine against another in one quantity of one case."""

    def __init__(self, *, task: Task, pair: tuple[Engine, Engine], quantity: str, **other: Any) -> None:
        super().__init__(**other)
        self.task = task
        self.pair = pair
        self.quantity = quantity

    def runtest(self) -> None:
        """Run both engines unless that was done, compare, and fail with words."""
        from crosscheck.measures.limits import find_worst_verdict
        from crosscheck.run.pair_runner import compare_engines, describe_pair_cause

        shared = self._build_shared()
        pair = compare_engines(shared, self.task, *self.pair)
        rows = [row for row in pair if row.quantity == self.quantity]
        for row in rows:
            self._add_junit_properties(row)
        verdict = find_worst_verdict(row.verdict for row in rows)
        messages = "; ".join(dict.fromkeys(row.message for row in rows if row.verdict == verdict and row.message))
        if verdict == "skipped":
            pytest.skip(messages)
        if verdict == "explained":
            pytest.xfail(messages)
        if verdict != "within":
            from crosscheck.report.failure import describe_failure

            wrong = [row for row in rows if row.verdict in ("deviation", "unjudged", "error")]
            why = describe_pair_cause(shared, self.task, pair) if any(row.maximum is not None for row in wrong) else ""
            exported = bool(self.pair[0].exports)
            raise ComparisonFailed("\n\n".join(describe_failure(row, why, exported) for row in wrong))

    def _build_shared(self) -> RunContext:
        from crosscheck.run.pair_runner import RunContext

        baseline = _find_baseline(self.config, self.task.folder.parent)
        limit = float(self.config.getoption("--crosscheck-timeout"))
        engines = {engine.name: engine for engine in self.pair}
        return RunContext(_make_records_folder(self.config), baseline, limit, engines, _prepare_children(self.config))

    def _add_junit_properties(self, row: Comparison) -> None:
        """Give the numbers to JUnit."""
        unit = f" [{row.unit}]" if row.unit else ""
        numbers = {f"difference{unit}": row.maximum, f"error bar{unit}": row.error_bar}
        numbers |= {"fraction": row.fraction, "limit": row.limit}
        self.user_properties += [(name, value) for name, value in numbers.items() if value is not None]

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the message alone: where in this file it was raised helps nobody."""
        if isinstance(excinfo.value, ComparisonFailed):
            return str(excinfo.value)
        return super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return file, line and headline of a report."""
        return self.path, None, self.name
