"""Judgement of differences: each is left out in turn; what leaves no more than the tolerance is not among the causes.

The tree of A with all changes has to have B's efforts.  A difference is a *cause* where leaving it out, alone, leaves more than
the tolerance of an effort's range; the rest is rounding of printed digits, or nothing that a torque of this mechanism can tell.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.efforts import States, evaluate_tree_efforts
from crosscheck.equivalence.members import ZERO
from crosscheck.equivalence.tree import Tree
from flexinv.model.mechanism import Array

# A coordinate whose efforts are that small beside the largest of all is judged against those: rounding sums over the whole tree.
FLOOR = 1e-6
KINEMATIC = ("pose of base", "position of joint", "orientation of joint", "joint axis", "pitch", "kind of joint")
Share = tuple[float, float, str]
ROUNDED = 1e-3  # relative: a number is not a rounded other one where it is farther off
SIGNIFICANT = 5e-3  # relative: half the last of three significant digits; to those a number may be rounded


@dataclass(frozen=True)
class Judgement:
    """Causes, what files round, what no torque can tell; the largest effort error [-] of its range before and after repair.

    before_effort : the largest difference of an effort before repair [N m], [N], and at which joint
    """

    causes: tuple[Difference, ...]
    rounding: tuple[Difference, ...]
    unseen: tuple[Difference, ...]
    conventions: tuple[Difference, ...]
    limits: tuple[Difference, ...]
    before: float
    after: float
    before_effort: float = 0.0
    worst_joint: str = ""
    rounding_effort: float = 0.0


@dataclass(frozen=True)
class EffortProblem:
    """The tree of A, states, and B's efforts there in A's coordinates [N m], [N]; kinds : A's moving joints as B has them."""

    tree: Tree
    states: States
    target_efforts: Mapping[str, Array]

    def compute_efforts(self, differences: Iterable[Difference]) -> dict[str, Array]:
        """Return the efforts of A with the changes of differences [N m], [N]."""
        return evaluate_tree_efforts(self.tree.replace_fields(c for d in differences for c in d.changes), self.states)

    def compute_share(self, values: Mapping[str, Array], targets: Mapping[str, Array]) -> Share:
        """Return the largest difference over the range of B's effort [-], the difference there [N m], [N], and its joint."""
        return compute_effort_share(values, targets, self.target_efforts)


def compute_effort_share(
    values: Mapping[str, Array], targets: Mapping[str, Array], scale: Mapping[str, Array]
) -> Share:
    """Return the largest difference over the range of its effort [-], the difference there [N m], [N], and its joint.

    scale : efforts by joint (samples, nv) whose sizes are the ranges [N m], [N]; of the smallest ones FLOOR times the largest
    """
    sizes = {name: np.abs(rows).max(axis=0) for name, rows in scale.items()}
    largest = max((float(size.max(initial=0.0)) for size in sizes.values()), default=0.0) or 1.0
    worst = (0.0, 0.0, "")
    for name, effort_size in sizes.items():
        size = np.maximum(effort_size, FLOOR * largest)
        gap = np.abs(values[name] - targets[name]).max(axis=0, initial=0.0)
        k = int(np.argmax(gap / size)) if gap.size else 0
        if gap.size and gap[k] / size[k] > worst[0]:
            worst = (float(gap[k] / size[k]), float(gap[k]), name)
    return worst


def judge(bench: EffortProblem, differences: Iterable[Difference], tolerance: float) -> Judgement:
    """Sort differences by what they do to efforts; tolerance : relative to the range of an effort [-]."""
    differences = list(differences)
    silent = [d for d in differences if not d.cause]
    named = [d for d in differences if d.cause and d.family in ("rigid", "drive")]
    acting = [d for d in named if d.changes]
    stated = [d for d in named if not d.changes]
    whole = bench.compute_efforts([*silent, *acting])
    share, effort, joint = bench.compute_share(bench.compute_efforts(silent), bench.target_efforts)
    found, rounding, unseen = _split_by_effect(bench, silent, acting, whole, tolerance)
    small = bench.compute_efforts([*silent, *found, *unseen]) if rounding else whole
    bent = _list_family(differences, "beam")  # measured already, with torques of their own
    hidden = [d for d in bent if d.share is not None and d.share <= tolerance]
    stated += [d for d in bent if d.share is None or d.share > tolerance]
    conventions = _list_family(differences, "convention")
    limits = _list_family(differences, "limits")
    return Judgement(
        causes=tuple(sorted([*stated, *found], key=_make_sort_key)),
        rounding=(*rounding, *_list_rounding([*conventions, *limits])),
        unseen=(*unseen, *hidden),
        conventions=tuple(_list_beyond_rounding(conventions)),
        limits=tuple(_list_beyond_rounding(limits)),
        before=share,
        after=bench.compute_share(whole, bench.target_efforts)[0],
        before_effort=effort,
        worst_joint=joint,
        rounding_effort=bench.compute_share(small, whole)[1],
    )


def _make_sort_key(difference: Difference) -> tuple[bool, bool, float]:
    """Return a key that sorts causes: rigid ones first, of them those of the structure, then by size of the effect [-]."""
    return difference.family != "rigid", not difference.structural, -(difference.share or 0.0)


def _split_by_effect(
    bench: EffortProblem,
    silent: list[Difference],
    acting: list[Difference],
    whole: Mapping[str, Array],
    tolerance: float,
) -> tuple[list[Difference], list[Difference], list[Difference]]:
    """Return the causes, the rounding and the unseen among differences that change the tree, each with its effect."""
    measured = [_compute_effect(bench, d, [*silent, *acting], whole) for d in acting]
    rounding = _list_rounding(measured)
    rest = _list_beyond_rounding(measured)
    # where a link goes is seen without a torque
    placed = [d for d in rest if d.cause in KINEMATIC and d.size > tolerance]
    others = [d for d in rest if d not in placed]
    felt, unseen = _find_minimal_differences(bench, silent + rounding + placed, others, whole, tolerance)
    return [*placed, *felt], rounding, unseen


def _list_family(differences: list[Difference], family: str) -> list[Difference]:
    return [d for d in differences if d.family == family]


def _list_rounding(differences: Iterable[Difference]) -> list[Difference]:
    return [d for d in differences if is_rounding(d)]


def _list_beyond_rounding(differences: Iterable[Difference]) -> list[Difference]:
    return [d for d in differences if not is_rounding(d)]


def is_rounding(difference: Difference) -> bool:
    """Return True if a difference is below half the last digit that a file prints, and small beside the number itself."""
    if not 0.0 < difference.size <= difference.printed * (1.0 + 1e-9):
        return False
    values = [_find_largest_number(text) for text in (difference.first, difference.second)]
    largest = 1.0 if difference.unit == "rad" or difference.cause == ZERO else max(*values, 1e-300)
    return difference.size <= ROUNDED * largest or difference.printed <= SIGNIFICANT * largest


def _find_largest_number(text: str) -> float:
    numbers = []
    for word in text.split():
        try:
            numbers.append(abs(float(word)))
        except ValueError:
            continue
    return max(numbers, default=0.0)


def _compute_effect(
    bench: EffortProblem, difference: Difference, every: list[Difference], whole: Mapping[str, Array]
) -> Difference:
    without = bench.compute_efforts(d for d in every if d is not difference)
    share, effort, _ = bench.compute_share(without, whole)
    return replace(difference, effect=effort, share=share)


def _find_minimal_differences(
    bench: EffortProblem,
    always: list[Difference],
    acting: list[Difference],
    whole: Mapping[str, Array],
    tolerance: float,
) -> tuple[list[Difference], list[Difference]]:
    """Leave out, one after the other, what leaves no more than the tolerance; then all of a link, then all of rigid bodies."""
    kept = list(acting)
    unseen = []
    for candidates in _list_groups(acting, tolerance):
        group = [d for d in candidates if d in kept]
        rest = [d for d in kept if d not in group]
        if group and bench.compute_share(bench.compute_efforts([*always, *rest]), whole)[0] <= tolerance:
            unseen += group
            kept = rest
    return kept, unseen


def _list_groups(acting: list[Difference], tolerance: float) -> Iterator[list[Difference]]:
    """Yield what may be left out together: each small difference, the smallest first, those of a link, those of all links."""
    for difference in sorted(acting, key=lambda d: d.share or 0.0):
        if (difference.share or 0.0) <= tolerance:
            yield [difference]
    bodies = [d for d in acting if d.family == "rigid" and d.cause in ("mass", "centre of mass", "inertia tensor")]
    places = dict.fromkeys(d.place for d in bodies)
    for group in [*([d for d in bodies if d.place == place] for place in places), bodies]:
        if len(group) > 1:
            yield group
