"""Answer of a bisection: the first release that differs, both values, and what else differs between both environments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

from crosscheck.bisect.bisection import Bisection, describe_holes
from crosscheck.bisect.criteria import BAD, GOOD
from crosscheck.bisect.defaults import list_differences, read_defaults
from crosscheck.bisect.dependencies import judge_dependencies
from crosscheck.bisect.environments import EnvironmentStore
from crosscheck.bisect.search import Change, Search, count_halvings

MISSING_LIBRARY = "cannot open shared object file"  # words of the dynamic linker
MOST_SHOWN = 12  # differences of default options that a terminal shows


@dataclass(frozen=True)
class ChangeReport:
    """A change: both releases, labels and values, what lies between and cannot run, and what else is another.

    packages, defaults : name, old and new value; defaults is None where the engine cannot be asked
    origin : whether the package or what it depends on makes the difference, "" where nothing else differs
    cause : the words of the cause and of the certificate, where it is one of our cases
    """

    before: str
    after: str
    old_label: str
    new_label: str
    old_value: str
    new_value: str
    holes: tuple[str, ...]
    packages: list[tuple[str, str, str]]
    origin: str
    defaults: list[tuple[str, str, str]] | None
    cause: str = ""


@dataclass(frozen=True)
class ReleaseRow:
    """One release that was tried: its label, value, and the time of a run [s]."""

    release: str
    label: str
    value: str
    seconds: float


@dataclass(frozen=True)
class Costs:
    """Costs of a search: releases of the range, environments, the bound on them, processor time [s], disk [GB].

    made, reused : environments that were made and taken in this run
    """

    releases: int
    environments: int
    bound: int
    made: int
    reused: int
    processor: float
    disk: float


@dataclass(frozen=True)
class Answer:
    """Answer: a sentence for each thing found, changes, all releases tried, costs."""

    package: str
    question: str
    words: list[str]
    changes: list[ChangeReport]
    rows: list[ReleaseRow]
    costs: Costs
    notes: list[str] = field(default_factory=list)

    @property
    def plain(self) -> dict[str, object]:
        """Return the answer as JSON values."""
        return asdict(self)

    @property
    def found(self) -> bool:
        """True where something changes in the range."""
        return bool(self.changes) or any("cannot run" in one for one in self.words)


def make_answer(bisection: Bisection, search: Search, question: str, processor: float) -> Answer:
    """Return the answer of a finished search; processor : time that it took so far [s]."""
    changes = [describe_change(bisection, search, change) for change in search.changes]
    package = bisection.trials.question.package
    rows = [_make_row(bisection, search, element) for element in sorted(search.labels)]
    words = [*_describe_borders(bisection, search, package), *(_describe_result(package, change) for change in changes)]
    if not changes and search.ends is not None:
        words.append(_describe_alike(bisection, search))
    costs = count_costs(bisection, search, processor)
    return Answer(package, question, words, changes, rows, costs, _list_notes(bisection, search))


def count_costs(bisection: Bisection, search: Search, processor: float) -> Costs:
    """Return the costs of a search; processor : [s].

    bound : ceil(log2 N) + 2 for one change, holes met added, ceil(log2 N) more for each further change [-]
    """
    trials = bisection.trials
    store: EnvironmentStore = trials.store
    count = len(bisection.releases)
    needed = [str(bisection.releases[element]) for element in search.labels]
    environments = sum(bool(trials.trials[name].pins) for name in needed)
    holes = sum(bool(trials.trials[str(bisection.releases[element])].pins) for element in search.holes)
    halving = max(len(search.changes), 1) * count_halvings(count) + 2 + holes
    bound = count if bisection.plan.each else halving
    disk = store.compute_size() / 1e9
    return Costs(count, environments, bound, store.made, store.reused, processor, disk)


def describe_change(bisection: Bisection, search: Search, change: Change) -> ChangeReport:
    """Return the report of a change; where other packages differ as well, one more environment tells them apart."""
    before = bisection.releases[change.before]
    after = bisection.releases[change.after]
    others = judge_dependencies(bisection, change)
    criterion = bisection.criterion
    return ChangeReport(
        before=str(before),
        after=str(after),
        old_label=str(search.labels[change.before]),
        new_label=str(search.labels[change.after]),
        old_value=criterion.describe_value(bisection.find_observation(change.before)),
        new_value=criterion.describe_value(bisection.find_observation(change.after)),
        holes=tuple(describe_holes(change, bisection.releases)),
        packages=others.differences,
        origin=others.words,
        defaults=_compare_defaults(bisection, change),
    )


def _compare_defaults(bisection: Bisection, change: Change) -> list[tuple[str, str, str]] | None:
    """Return the default options that are others, None where the engine cannot be asked for them."""
    trials = bisection.trials
    told = []
    for element in (change.before, change.after):
        with trials.store.open_environment(trials.make_wish(bisection.releases[element])) as environment:
            told.append(read_defaults(trials.question.package, environment))
    old, new = told
    return None if old is None or new is None else list_differences(old, new)


def _make_row(bisection: Bisection, search: Search, element: int) -> ReleaseRow:
    observation = bisection.find_observation(element)
    label = search.labels[element]
    value = bisection.criterion.describe_value(observation)
    return ReleaseRow(
        str(bisection.releases[element]), bisection.criterion.describe_label(label), value, observation.wall
    )


def _describe_result(package: str, change: ChangeReport) -> str:
    """Return the sentence of one change."""
    between = f" ({', '.join(change.holes)} between them cannot run)" if change.holes else ""
    if {change.old_label, change.new_label} == {GOOD, BAD}:
        return (
            f"{package}: {change.old_label} up to {change.before} ({change.old_value}), "
            f"{change.new_label} from {change.after} on ({change.new_value}){between}"
        )
    return (
        f"{package} {change.after} is the first release that differs from {change.before}: {change.old_value} becomes "
        f"{change.new_value}{between}"
    )


def _describe_borders(bisection: Bisection, search: Search, package: str) -> list[str]:
    """Return the sentences about ends that cannot run."""
    releases = bisection.releases
    words = []
    if search.stops is not None:
        reason = bisection.find_observation(search.stops.after).reason
        last = releases[search.stops.before]
        words.append(
            f"{package}: cannot run from {releases[search.stops.after]} on ({last} is the last that runs): {reason}"
        )
    if search.begins is not None:
        reason = bisection.find_observation(search.begins.before).reason
        first = releases[search.begins.after]
        words.append(
            f"{package}: cannot run up to {releases[search.begins.before]} ({first} is the first that runs): {reason}"
        )
    return words


def _describe_alike(bisection: Bisection, search: Search) -> str:
    """Return the sentence where both ends are alike."""
    assert search.ends is not None
    first, last = (bisection.releases[element] for element in search.ends)
    label = search.labels[search.ends[0]]
    value = bisection.criterion.describe_value(bisection.find_observation(search.ends[1]))
    alike = f"both {label}" if label in (GOOD, BAD) else "alike"
    if bisection.plan.each:
        return (
            f"{first} to {last} are all {label if label in (GOOD, BAD) else 'alike'} ({value}): every release was tried"
        )
    return f"{first} and {last} are {alike} ({value}): nothing is looked for between them; --each tries every release"


def _list_notes(bisection: Bisection, search: Search) -> list[str]:
    """Return the notes that a reader should have beside the answer."""
    notes = []
    if search.ends is not None:
        first, last = (search.labels[element] for element in search.ends)
        if (first, last) == (BAD, GOOD):
            notes.append(
                "the older end is bad and the newer one good: what was looked for is the release that mended it"
            )
    if bisection.trials.taken:
        notes.append(f"{bisection.trials.taken} releases were taken from an earlier run")
    if removed := bisection.trials.store.removed:
        notes.append(
            f"{len(removed)} environments made room: all together may take {bisection.trials.store.limit / 1e9:g} GB"
        )
    if unsure := _list_unsure(bisection.releases, search):
        notes.append(f"cannot run: {', '.join(unsure)}")
    reasons = [bisection.find_observation(element).reason for element in search.holes]
    if any(MISSING_LIBRARY in reason for reason in reasons):
        notes.append(
            "a library that is not there belongs to a dependency newer than the release: an older one by --beside may help"
        )
    return notes


def _list_unsure(releases: Sequence[object], search: Search) -> list[str]:
    """Return the releases that were tried and cannot run."""
    return [str(releases[element]) for element in search.holes]
