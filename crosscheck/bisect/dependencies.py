"""Dependencies: what beside the package differs between two environments, and whether that alone makes the difference."""

from __future__ import annotations

from dataclasses import dataclass

from packaging.utils import canonicalize_name

from crosscheck.bisect.bisection import Bisection
from crosscheck.bisect.defaults import list_differences
from crosscheck.bisect.installers import CannotInstall, read_pins
from crosscheck.bisect.search import Change


@dataclass(frozen=True)
class DependencyTrial:
    """Packages beside that differ, and the words of the trial with the new release beside the old of these."""

    differences: list[tuple[str, str, str]]
    words: str


def judge_dependencies(bisection: Bisection, change: Change) -> DependencyTrial:
    """Return the packages beside that differ between both sides; where some do, the new release is run beside the old ones.

    That needs one more environment: ``after``, with the other packages held at what they are in that of ``before``.
    """
    trials = bisection.trials
    package = trials.question.package
    before = bisection.releases[change.before]
    after = bisection.releases[change.after]
    old = _read_others(trials.trials[str(before)].pins, package)
    new = _read_others(trials.trials[str(after)].pins, package)
    differences = list_differences(old, new)
    others = [name for name, one, other in differences if one and other]
    if not others:
        return DependencyTrial(differences, "")
    names = ", ".join(others)
    held = tuple(f"{name}=={version}" for name, version in old.items() if name in new)
    try:
        with trials.store.open_environment(trials.make_wish(after, held)) as environment:
            observation = trials.run_once(environment)
    except CannotInstall:
        return DependencyTrial(
            differences, f"{after} cannot be had beside the old {names}: which of both did it is open"
        )
    label = bisection.criterion.find_label(f"{after} beside the old {names}", observation)
    value = bisection.criterion.describe_value(observation)
    sides = {
        element: bisection.criterion.find_label("", bisection.find_observation(element))
        for element in (change.before, change.after)
    }
    if label is None:
        words = f"{after} beside the old {names} cannot run ({observation.reason}): which of both did it is open"
    elif label == sides[change.after]:
        words = f"{after} beside the old {names} gives the new result, too ({value}): it is {package} itself"
    elif label == sides[change.before]:
        words = f"{after} beside the old {names} gives the old result ({value}): it is not {package}, it is {names}"
    else:
        words = f"{after} beside the old {names} gives a third result ({value}): both have a part in it"
    return DependencyTrial(differences, words)


def _read_others(pins: str, package: str) -> dict[str, str]:
    """Return the versions of all but the package itself."""
    return {
        name: version
        for name, version in read_pins(pins).items()
        if canonicalize_name(name) != canonicalize_name(package)
    }
