"""Search of a sequence for the places where it changes, when some of its elements cannot be evaluated.

Each of N elements has a label, or ``None`` where it cannot be evaluated (a hole, as in ``git bisect skip``).  Both ends are
evaluated first.  Between two elements with other labels the search then halves what it does not know:

    evaluated elements with a label <= changes * ceil(log2 N) + 2

For that bound an element splits the m unknown ones of an interval, of which ``budget`` more may be evaluated, so that at most
2^(budget - 1) - 1 are left on either side.  Where m leaves a choice, elements far from the holes met so far are preferred, twice
as far after each further hole: holes come in rows.  Where both ends have one label, nothing between them is looked for.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

Label = Hashable
Ask = Callable[[int], Label | None]


@dataclass(frozen=True)
class Change:
    """A change: the last element that is as before, and the first that is not; all between them are holes."""

    before: int
    after: int


@dataclass
class Search:
    """State of a search and its result.

    ask : returns the label of an element, None where it is a hole; labels : of the elements that were asked for
    begins, stops : the element from which on elements have labels, and that from which on they have none, where an end is a hole
    """

    count: int
    ask: Ask
    labels: dict[int, Label | None] = field(default_factory=dict)
    changes: tuple[Change, ...] = ()
    begins: Change | None = None
    stops: Change | None = None

    def find_label(self, element: int) -> Label | None:
        """Return the label of an element, asked for once."""
        if element not in self.labels:
            self.labels[element] = self.ask(element)
        return self.labels[element]

    @property
    def ends(self) -> tuple[int, int] | None:
        """The outermost elements that have labels as far as is known; None where neither end has one."""
        first = self.begins.after if self.begins else 0
        last = self.stops.before if self.stops else self.count - 1
        return None if self.labels[first] is None or self.labels[last] is None else (first, last)

    @property
    def holes(self) -> list[int]:
        """The holes that were met."""
        return sorted(element for element, label in self.labels.items() if label is None)


def find_changes(count: int, ask: Ask, every: bool = False) -> Search:
    """Return the finished search of a sequence [-]; every : all changes that can be told, not only the first.

    count : of the elements, at least 2
    """
    search = Search(count, ask)
    first = search.find_label(0)
    last = search.find_label(count - 1)
    if first is None and last is None:
        return search
    if last is None:
        search.stops = _find_border(search, 0, count - 1)
    if first is None:
        border = _find_border(search, count - 1, 0)
        search.begins = Change(border.after, border.before)
    if search.ends is not None:
        low, high = search.ends
        search.changes = tuple(_find_between(search, low, high, count_halvings(high - low), every))
    return search


def count_halvings(length: int) -> int:
    """Return ceil(log2 length) [-], the evaluations that find one of ``length`` places."""
    return max(length - 1, 0).bit_length()


def _find_border(search: Search, inside: int, outside: int) -> Change:
    """Return the border between an element with a label and a hole, as one of them and its neighbour."""
    while abs(outside - inside) > 1:
        middle = (inside + outside) // 2
        if search.find_label(middle) is None:
            outside = middle
        else:
            inside = middle
    return Change(inside, outside)


def _find_between(search: Search, low: int, high: int, budget: int, every: bool) -> list[Change]:
    """Return the changes between two elements with labels; budget : evaluations that may still be needed for one of them."""
    labels = search.labels
    while labels[low] != labels[high]:
        inner = range(low + 1, high)
        middle = _choose_known(labels, inner)
        if middle is None:
            unknown = [element for element in inner if element not in labels]
            if not unknown:
                return [Change(low, high)]
            middle = choose_element(unknown, [element for element in inner if element in labels], budget)
            if search.find_label(middle) is None:
                continue
            budget -= 1
        if labels[middle] == labels[low]:
            low = middle
        elif labels[middle] == labels[high] or not every:
            high = middle
        else:
            below = _find_between(search, low, middle, budget, every)
            return below + _find_between(search, middle, high, budget, every)
    return []


def _choose_known(labels: dict[int, Label | None], inner: Sequence[int]) -> int | None:
    """Return the middle one of the elements whose labels are known already, None where there is none."""
    known = [element for element in inner if labels.get(element) is not None]
    return known[len(known) // 2] if known else None


def choose_element(unknown: Sequence[int], holes: Sequence[int], budget: int) -> int:
    """Return the element to be evaluated next [-].

    unknown : elements of an interval that were not asked for, in order; holes : those of the interval that were met
    budget : evaluations with a label that may still be needed
    """
    largest = 2 ** (budget - 1) - 1  # what the evaluations after this one can tell apart
    window = unknown[max(0, len(unknown) - 1 - largest) : largest + 1]
    centre = unknown[(len(unknown) - 1) // 2]
    nearest_first = sorted(window, key=lambda element: (abs(element - centre), element))
    if not holes:
        return nearest_first[0]
    wanted = 2 ** (len(holes) - 1)
    distances = {element: min(abs(element - hole) for hole in holes) for element in nearest_first}
    far = [element for element in nearest_first if distances[element] >= wanted]
    return far[0] if far else max(nearest_first, key=lambda element: distances[element])


def find_all_labels(count: int, ask: Ask) -> Search:
    """Return the finished search of a sequence [-] each of whose elements was asked for; count : of the elements"""
    search = Search(count, ask)
    known = [element for element in range(count) if search.find_label(element) is not None]
    if known and known[0] > 0:
        search.begins = Change(known[0] - 1, known[0])
    if known and known[-1] < count - 1:
        search.stops = Change(known[-1], known[-1] + 1)
    labels = search.labels
    search.changes = tuple(Change(low, high) for low, high in pairwise(known) if labels[low] != labels[high])
    return search
