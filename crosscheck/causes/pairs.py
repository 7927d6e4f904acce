"""Two causes at once: pairs whose effects together explain a difference that no cause explains alone.

Of all pairs the linear look comes from their columns' Gram matrices; the best of them are refined together, one change put
upon the other.  A pair is a cause like any other: its size is that of both, so it is held against all that is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from crosscheck.causes.cause import Cause
from crosscheck.causes.fit import SMALL, Candidate, Fit, describe_size, fit, fit_from, list_candidates
from crosscheck.causes.model import Model, is_tree
from crosscheck.causes.subject import Subject
from flexinv.typing import Array

AND = " + "
NUMBERS = 4  # of a pair's sizes together: with more of them, anything can be explained
TRIED = {True: 32, False: 4}  # pairs that are refined, by whether the mechanism is a rigid tree
ROUNDS = {True: 8, False: 3}  # of a refinement, by whether it is rigid
# Causes that are taken off first, by whether the mechanism is a rigid tree, and sized ones that are tried beside each of them.
FIRST = {True: 4, False: 2}
NEXT = 8
LINEAR = 0.5  # of |r|: a pair that leaves more in the linear look is none
DEPENDENT = 1e-6  # of a column: what another one leaves of it is rounding


def find_pairs(
    model: Model, residual: Array, known: list[Candidate], explains: Callable[[Fit], bool], noise: float
) -> list[Fit]:
    """Return the pairs that explain a residual (samples nv,) [-], what explains most first; noise : part of |r| [-].

    With them come parts that explain it alone, at the size that the pair found for them.
    """
    usable = [c for c in known if not c.cause.linear and c.cause.guess is None]
    quick = is_tree(model.base)
    found: dict[tuple[str, str], Fit] = {}
    likely = _list_likely_pairs(usable, residual, LINEAR + model.rough_error)[: TRIED[quick]]
    for a, b in (*likely, *_list_sequential_pairs(model, residual, usable)):
        one = fit(model, residual, join_causes(a, b), ROUNDS[model.base.mechanism.is_rigid], noise)
        if explains(one):
            alone = [f for f in _fit_parts(model, residual, one, (a, b), noise) if explains(f)]
            found |= {f.key: f for f in (*alone, _add_words(one, a, b))}
    return sorted(found.values(), key=lambda f: f.residual)


def _fit_parts(
    model: Model, residual: Array, both: Fit, of: tuple[Candidate, Candidate], noise: float
) -> Iterator[Fit]:
    """Yield the fit of each part of a pair by itself, from the size that it has in the pair."""
    for one, size in _split_size(both, *of):
        if one.cause.sized:
            fitted = fit_from(model, residual, one, size, ROUNDS[model.base.mechanism.is_rigid], noise)
            if fitted is not None:
                yield fitted


def _split_size(both: Fit, first: Candidate, second: Candidate) -> Iterator[tuple[Candidate, Array]]:
    """Yield the two causes of a pair in its order, each with its size [its unit]."""
    first, second = sorted((first, second), key=lambda c: (c.cause.name, c.target))
    count = first.cause.parameters
    yield first, _scale_size(first, both.size[:count])
    yield second, _scale_size(second, both.size[count:])


def join_causes(first: Candidate, second: Candidate) -> Candidate:
    """Return two causes at once as one; its size is that of both, each over the size that matters [-]."""
    first, second = sorted((first, second), key=lambda c: (c.cause.name, c.target))
    count = first.cause.parameters

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        once = first.cause.change(subject, first.target, _scale_size(first, size[:count]))
        return second.cause.change(once, second.target, _scale_size(second, size[count:]))

    covered = [f"{x}{AND}{second.cause.name}" for x in first.cause.covers] + [
        f"{first.cause.name}{AND}{x}" for x in second.cause.covers
    ]
    cause = Cause(
        f"{first.cause.name}{AND}{second.cause.name}",
        "",
        apply_change,
        parameters=count + second.cause.parameters,
        covers=tuple(AND.join(sorted(one.split(AND))) for one in covered),
        shows="; and ".join(dict.fromkeys((first.cause.shows, second.cause.shows))),
        unsaid=(*first.cause.unsaid, *second.cause.unsaid),
    )
    return Candidate(
        cause,
        AND.join((first.target, second.target)),
        1.0,
        np.hstack([c.columns for c in (first, second) if c.cause.sized]),
    )


def _scale_size(one: Candidate, size: Array) -> Array:
    """Return the size [its unit] of one of two causes; of one without sizes that it is there."""
    return size * one.scale if one.cause.sized else np.ones(1)


def _add_words(one: Fit, first: Candidate, second: Candidate) -> Fit:
    """Return the fit of a pair whose cause says both sizes in their units."""
    words = [
        c.cause.words.format(target=c.target or "all", size=describe_size(size, c.cause.unit))
        for c, size in _split_size(one, first, second)
    ]
    cause = Cause(**{**vars(one.cause), "words": "two at once: " + "; and ".join(words)})
    return Fit(cause, one.target, one.size, one.residual, one.column)


def _list_likely_pairs(usable: list[Candidate], residual: Array, most: float) -> list[tuple[Candidate, Candidate]]:
    """Return the pairs that leave least in the linear look, least first, up to ``most`` of |r| [-]."""
    sized = [c for c in usable if c.cause.sized]
    bases = [_compute_orthonormal_basis(c.look) for c in sized]
    total = float(residual @ residual)
    found: list[tuple[float, int, Candidate, Candidate]] = []
    for i, (a, q) in enumerate(zip(sized[:-1], bases[:-1], strict=True)):
        rest = residual - q @ (q.T @ residual)
        others = np.hstack(bases[i + 1 :])
        found += _list_pair_remainders(a, sized[i + 1 :], others - q @ (q.T @ others), rest, len(found))
    return [(a, b) for left, _, a, b in sorted(found, key=lambda one: one[:2]) if left <= most**2 * total]


def _list_sequential_pairs(model: Model, residual: Array, usable: list[Candidate]) -> list[tuple[Candidate, Candidate]]:
    """Return pairs of a cause that explains much and a sized one, by the columns of the subject with the first one in it.

    In a tree the first one is there or not; in a mechanism with loops it may have a size, for what it does to closures changes
    what all others do.
    """
    if not model.base.mechanism.is_rigid:
        return []
    tree = is_tree(model.base)
    first = [fit(model, residual, c) for c in usable if not (tree and c.cause.sized)]
    sequential_pairs = []
    for one in sorted(first, key=lambda f: f.residual)[: FIRST[tree]]:
        if one.residual > LINEAR:
            break
        (candidate,) = (c for c in usable if c.key == one.key)
        base = one.cause.change(model.base, one.target, one.size)
        harmed = replace(model, base=base, torque=model.compute_torques(base))
        causes = {c.cause.name: c.cause for c in usable if c.cause.sized}
        others = [
            (fit(harmed, residual - one.column, c).residual, n, c)
            for n, c in enumerate(list_candidates(harmed, causes))
            if c.key != one.key
        ]
        sequential_pairs += [(candidate, c) for _, _, c in sorted(others, key=lambda x: x[:2])[:NEXT]]
    return sequential_pairs


def _list_pair_remainders(
    one: Candidate, others: list[Candidate], columns: Array, rest: Array, before: int
) -> list[tuple[float, int, Candidate, Candidate]]:
    """Return the residual of every other cause beside one, |rest|^2 less its gain [-], with its number and the pair."""
    have = float(rest @ rest)
    at = 0
    pair_remainders: list[tuple[float, int, Candidate, Candidate]] = []
    for b in others:
        width = _compute_rank(b)
        block = columns[:, at : at + width]
        at = at + width
        if one.cause.parameters + b.cause.parameters <= NUMBERS:
            pair_remainders.append((have - _compute_gain(block, rest), before + len(pair_remainders), one, b))
    return pair_remainders


def _compute_rank(one: Candidate) -> int:
    return int(_compute_orthonormal_basis(one.look).shape[1])


def _compute_gain(block: Array, rest: Array) -> float:
    """Return the amount of |rest|^2 that a block of columns explains [-]."""
    seen = block.T @ rest
    if block.shape[1] == 1:
        size = float(block[:, 0] @ block[:, 0])
        return float(seen[0]) ** 2 / size if size > DEPENDENT**2 else 0.0
    return float(seen @ np.linalg.pinv(block.T @ block, rcond=DEPENDENT, hermitian=True) @ seen)


def _compute_orthonormal_basis(columns: Array) -> Array:
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, values > SMALL * values.max(initial=0.0)])


def is_part_of_pair(both: Fit, alone: Fit) -> bool:
    """Return True if a fit is one of the two parts of a pair."""
    both_keys = zip(both.cause.name.split(AND), both.target.split(AND), strict=False)
    return AND in both.cause.name and alone.key in both_keys


def split_name(name: str) -> Iterator[str]:
    """Yield the names of the causes in a name: two of a pair, else one."""
    yield from name.split(AND)
