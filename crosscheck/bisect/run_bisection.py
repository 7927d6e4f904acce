"""A whole bisection: releases are listed, tried, the answer is made, and its files are written."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from packaging.utils import canonicalize_name

from crosscheck import output_folder as owned
from crosscheck.bisect.answer import Answer, make_answer
from crosscheck.bisect.bisection import Bisection, Plan
from crosscheck.bisect.causes import describe_case_change
from crosscheck.bisect.criteria import Criterion
from crosscheck.bisect.environments import EnvironmentStore
from crosscheck.bisect.installers import Installer
from crosscheck.bisect.observations import Reading
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.releases import Release, ReleaseQuery, choose_range, list_releases
from crosscheck.bisect.reproduction import write_reproduction
from crosscheck.bisect.script import Script
from crosscheck.bisect.trials import Question, Trials
from crosscheck.verdicts.plan import Task

ANSWER = "answer.json"


@dataclass(frozen=True)
class Wish:
    """Wish of a user: what is searched for, and how.

    disk : [bytes] of all environments; case : the case of ours and its engine, where it is one
    """

    package: str
    range: str
    beside: tuple[str, ...]
    script: Script
    reading: Reading
    criterion: Criterion
    plan: Plan
    pythons: tuple[str, ...]
    query: ReleaseQuery
    installer: Installer
    disk: float
    fresh: bool = False
    case: tuple[Task, str] | None = None


@dataclass(frozen=True)
class BisectionFiles:
    """Folders of a bisection: of its answer, and of the environments."""

    out: Path
    environments: Path


@dataclass(frozen=True)
class BisectionResult:
    """Answer of a bisection, its file, and the folders of its reproductions."""

    answer: Answer
    file: Path
    reproductions: list[Path]


def run_bisection(wish: Wish, files: BisectionFiles, notify: Callable[[str, str], None]) -> BisectionResult:
    """Search, and write the answer; notify : is told of what is done, release and words.

    Raises InputError for a bad range, a script that cannot be judged, and where index or disk fail: what was found is kept.
    """
    releases = find_releases(wish)
    store = EnvironmentStore(files.environments, wish.installer, wish.disk)
    question = Question(wish.package, wish.beside, wish.script, wish.reading)
    trials = Trials(question, store, files.out, notify)
    if not wish.fresh:
        trials.read_kept()
    bisection = Bisection(releases, trials, wish.criterion, wish.plan)
    search = bisection.find_changes()
    asked = f"{wish.package} {releases[0]}..{releases[-1]}, {' '.join(wish.script.names)}"
    answer = make_answer(bisection, search, asked, trials.compute_processor_time())
    if wish.case is not None:
        task, engine = wish.case
        changes = [replace(one, cause=describe_case_change(task, engine, bisection, one)) for one in answer.changes]
        answer = replace(answer, changes=changes)
    return _write_files(answer, trials, files.out)


def find_releases(wish: Wish) -> list[Release]:
    """Return the releases of the range.  Raises InputError."""
    pythons = find_pythons(wish.pythons)
    return choose_range(
        list_releases(wish.package, pythons, wish.installer.index, wish.query), wish.range, wish.package
    )


def _write_files(answer: Answer, trials: Trials, out: Path) -> BisectionResult:
    """Write answer and reproductions; those of an earlier answer that are no more are removed."""
    owned.remove(out, below="reproductions")
    folders = []
    for change in answer.changes:
        folder = out / "reproductions" / f"{canonicalize_name(answer.package)}-{change.before}-{change.after}"
        write_reproduction(answer, change, trials, folder)
        folders.append(folder)
    owned.write(out / ANSWER, json.dumps(answer.plain, indent=1))
    return BisectionResult(answer, out / ANSWER, folders)
