"""Bisection: releases are tried until the first one that differs is found, and is shown to differ each time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from crosscheck.bisect.criteria import Criterion, compute_scatter
from crosscheck.bisect.observations import Observation
from crosscheck.bisect.releases import Release
from crosscheck.bisect.search import Change, Search, find_all_labels, find_changes
from crosscheck.bisect.trials import Trials
from crosscheck.report.words import format_short
from flexinv.errors import InputError

REPEATS = 3  # runs of both ends, and of both sides of a change


class NotRepeatable(InputError):
    """A script gives something else each time: no release can be blamed."""


@dataclass(frozen=True)
class Plan:
    """Ways of a search: every change or the first; each release or those that are needed; runs of what has to be sure."""

    every: bool = False
    each: bool = False
    repeats: int = REPEATS


@dataclass
class Bisection:
    """A search over releases with its trials and its criterion."""

    releases: Sequence[Release]
    trials: Trials
    criterion: Criterion
    plan: Plan

    def find_changes(self) -> Search:
        """Return the finished search.  Raises NotRepeatable with the scatter, InputError where neither end can run."""
        count = len(self.releases)
        if self.plan.each:
            search = find_all_labels(count, self._find_label)
        else:
            search = find_changes(count, self._find_label, self.plan.every)
        if search.ends is None:
            raise InputError(self._describe_dead_ends())
        for change in search.changes:
            self._check_side(change.before)
            self._check_side(change.after)
        return search

    def find_observation(self, element: int) -> Observation:
        """Return the first run of a release."""
        return self.trials.run_release(self.releases[element], 1)[0]

    def _find_label(self, element: int) -> str | None:
        """Return the label of a release, by its place in the range; the ends are run several times."""
        is_end = element in (0, len(self.releases) - 1)
        if is_end:
            self._check_side(element)
        release = self.releases[element]
        label = self.criterion.find_label(str(release), self.find_observation(element))
        value = self.criterion.describe_value(self.find_observation(element))
        told = value if label is None else f"{self.criterion.describe_label(label)}: {value}"
        self.trials.notify(str(release), f"= {told}")
        return label

    def _check_side(self, element: int) -> None:
        """Run a release several times.  Raises NotRepeatable where it has several labels, or scatters too much."""
        release = self.releases[element]
        observations = self.trials.run_release(release, self.plan.repeats)
        reasons = {bool(one.reason) for one in observations}
        if len(reasons) > 1:
            failed = next(one.reason for one in observations if one.reason)
            raise NotRepeatable(f"{release} ran, and did not run, in one and the same environment ({failed}): {REMEDY}")
        if not observations[0].reason:
            self._check_scatter(release, observations)

    def _check_scatter(self, release: Release, observations: Sequence[Observation]) -> None:
        criterion = self.criterion
        if criterion.kind in ("exit", "bounds", "verdict"):
            labels = [criterion.find_label(str(release), one) for one in observations]
            if len(set(labels)) > 1:
                values = ", ".join(criterion.describe_value(one) for one in observations)
                told = ", ".join(map(str, labels))
                raise NotRepeatable(f"{release} is {told} in one and the same environment ({values}): {REMEDY}")
            return
        first = observations[0]
        if criterion.kind == "changed":
            if any(one.digest != first.digest for one in observations):
                raise NotRepeatable(
                    f"{release} prints or writes something else each time, in one and the same environment: {REMEDY}; "
                    "print no times and no addresses, or compare with --number or --csv and a --tolerance"
                )
            return
        scatter = compute_scatter(criterion, observations)
        if scatter > criterion.tolerance:
            values = _describe_values(observations)
            raise NotRepeatable(
                f"{release} scatters by {format_short(scatter)} of its size in one and the same environment{values}, more than "
                f"--tolerance {criterion.tolerance:g}: {REMEDY}, or write a --tolerance above {format_short(3 * scatter)}"
            )

    def _describe_dead_ends(self) -> str:
        """Return the message where neither end of the range can run."""
        first = self.releases[0]
        last = self.releases[-1]
        reasons = [self.find_observation(0).reason, self.find_observation(len(self.releases) - 1).reason]
        return (
            f"neither {first} nor {last} can run it: write a range with an end that can ({first}: {reasons[0]}; "
            f"{last}: {reasons[1]}); files beside the script are copied by --with, packages beside by --beside"
        )


REMEDY = "fix its seed and its order of threads"


def _describe_values(observations: Sequence[Observation]) -> str:
    """Return the numbers of repeated runs in brackets, "" for tables."""
    numbers = [f"{one.number:.9g}" for one in observations if one.number is not None]
    return f" ({', '.join(numbers)})" if numbers else ""


def describe_holes(change: Change, releases: Sequence[Release]) -> list[str]:
    """Return the releases inside a change, which cannot run."""
    return [str(releases[element]) for element in range(change.before + 1, change.after)]
