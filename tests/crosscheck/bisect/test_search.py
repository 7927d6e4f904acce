"""The search finds every change of random sequences, in as few evaluations as it promises; the bound is sharp."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from itertools import pairwise

import pytest

from crosscheck.bisect.search import Change, Search, choose_element, count_halvings, find_all_labels, find_changes

Labels = Sequence[str | None]


def searched(labels: Labels, every: bool = False) -> Search:
    """The search of a sequence; an element that is asked for twice is an error."""
    asked: list[int] = []

    def ask(element: int) -> str | None:
        assert element not in asked
        asked.append(element)
        return labels[element]

    return find_changes(len(labels), ask, every)


def true_changes(labels: Labels) -> list[Change]:
    """All changes between neighbours that have labels."""
    known = [k for k, label in enumerate(labels) if label is not None]
    return [Change(a, b) for a, b in pairwise(known) if labels[a] != labels[b]]


def drawn(rng: random.Random, count: int, changes: int, holes: float) -> list[str | None]:
    """A sequence with so many changes, whose inner elements are holes with a probability; both ends have labels."""
    places = sorted(rng.sample(range(1, count), changes))
    labels: list[str | None] = [f"state {sum(k >= p for p in places)}" for k in range(count)]
    for k in range(1, count - 1):
        if rng.random() < holes:
            labels[k] = None
    return labels


def with_rows_of_holes(rng: random.Random, labels: list[str | None]) -> list[str | None]:
    """The same, with a row of holes somewhere inside: an interface that was broken for some releases."""
    first = rng.randrange(1, len(labels) - 1)
    last = rng.randrange(first, len(labels) - 1)
    return [None if first <= k <= last else label for k, label in enumerate(labels)]


def test_one_change_takes_no_more_than_the_logarithm_and_both_ends() -> None:
    """Every place of every sequence of up to 70 elements, which is more than any engine of ours has releases."""
    for count in range(2, 71):
        for place in range(1, count):
            labels = ["good"] * place + ["bad"] * (count - place)
            search = searched(labels)
            assert search.changes == (Change(place - 1, place),)
            assert len(search.labels) <= math.ceil(math.log2(count)) + 2


def test_the_bound_is_reached() -> None:
    """A search that promised one evaluation less would be refused by some sequence."""
    count = 33  # 31 unknown elements and 32 places: five halvings, no fewer
    most = max(len(searched(["good"] * p + ["bad"] * (count - p)).labels) for p in range(1, count))
    assert most == 2 + 5


@pytest.mark.parametrize("every", [False, True])
@pytest.mark.parametrize("changes", [1, 2, 4])
def test_holes_are_passed_over_and_cost_one_evaluation_each(changes: int, every: bool) -> None:
    rng = random.Random(7 * changes + every)
    for _ in range(400):
        count = rng.randrange(changes + 2, 60)
        labels = drawn(rng, count, changes, rng.choice([0.0, 0.1, 0.5, 0.9]))
        if rng.random() < 0.5:
            labels = with_rows_of_holes(rng, labels)
        search = searched(labels, every)
        expected = true_changes(labels)
        if every:
            assert list(search.changes) == expected
        else:  # labels do not come back here: what differs from the first one differs from then on
            assert list(search.changes) == expected[:1]
        found = max(len(search.changes), 1)
        bound = found * math.ceil(math.log2(count)) + 2 + len(search.holes)
        assert len(search.labels) <= bound


def test_a_long_row_of_holes_is_not_walked_through() -> None:
    """In rows of holes the search goes away from those it met: half of a row is never asked for, where there is a choice."""
    labels = ["good"] * 10 + [None] * 24 + ["bad"] * 16
    search = searched(labels)
    assert search.changes == (Change(9, 34),)
    # The change lies inside of the row: to be sure, all of it must be asked for.
    assert len(search.holes) == 24
    beyond = searched(["good"] * 13 + [None] * 20 + ["good"] * 9 + ["bad"] * 8)
    assert beyond.changes == (Change(41, 42),)
    assert len(beyond.holes) <= 6


def test_changes_that_come_back_are_found_where_a_label_between_them_is_met() -> None:
    labels = ["a"] * 5 + ["b"] * 6 + ["a"] * 5 + ["c"] * 5
    search = searched(labels, every=True)
    assert list(search.changes) == true_changes(labels)
    alike = searched(["a"] * 4 + ["b"] * 2 + ["a"] * 4, every=True)
    assert alike.changes == ()
    assert len(alike.labels) == 2  # nothing between ends that are alike is asked for, and the command says so


def test_every_element_can_be_asked_for() -> None:
    labels: Labels = ["a", "a", "b", None, "b", "a", None]
    search = find_all_labels(len(labels), lambda k: labels[k])
    assert search.changes == (Change(1, 2), Change(4, 5))
    assert search.labels == dict(enumerate(labels))
    assert (search.begins, search.stops) == (None, Change(5, 6))
    late = find_all_labels(3, lambda k: "a" if k else None)
    assert (late.begins, late.stops, late.ends) == (Change(0, 1), None, (1, 2))
    assert find_all_labels(2, lambda k: None).ends is None


@pytest.mark.parametrize("count", [2, 9, 50])
def test_ends_that_cannot_run_are_borders_of_what_can(count: int) -> None:
    for place in range(1, count):
        stops = searched(["a"] * place + [None] * (count - place))
        assert stops.stops == Change(place - 1, place)
        assert stops.changes == ()
        assert stops.ends == (0, place - 1)
        begins = searched([None] * place + ["a"] * (count - place))
        assert begins.begins == Change(place - 1, place)
        assert begins.ends == (place, count - 1)


def test_a_change_before_the_end_that_cannot_run_is_found_too() -> None:
    rng = random.Random(3)
    for _ in range(200):
        count = rng.randrange(6, 60)
        change, stop = sorted(rng.sample(range(1, count), 2))
        labels = ["a"] * change + ["b"] * (stop - change) + [None] * (count - stop)
        search = searched(labels)
        assert search.stops == Change(stop - 1, stop)
        assert search.changes == (Change(change - 1, change),)
        assert len(search.labels) <= 2 * math.ceil(math.log2(count)) + 2


def test_neither_end_can_run() -> None:
    search = searched([None, "a", None])
    assert search.ends is None
    assert search.changes == ()


def test_halvings_are_the_logarithm_rounded_up() -> None:
    assert [count_halvings(n) for n in range(1, 10)] == [math.ceil(math.log2(n)) for n in range(1, 10)]


def test_the_next_element_leaves_no_more_than_the_budget_can_tell_apart() -> None:
    rng = random.Random(11)
    for _ in range(500):
        unknown = sorted(rng.sample(range(80), rng.randrange(1, 40)))
        holes = [k for k in range(80) if k not in unknown and rng.random() < 0.3]
        budget = len(unknown).bit_length() + rng.randrange(2)
        rank = unknown.index(choose_element(unknown, holes, budget))
        assert max(rank, len(unknown) - 1 - rank) <= 2 ** (budget - 1) - 1
