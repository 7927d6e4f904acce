"""Hints: what the two numbers of a difference look like beside one another: units, signs, factors, another point."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexinv.model.mechanism import Array, Inertia
from flexinv.model.parallel_axis import compute_parallel_axis_term

NEAR = 2e-3  # relative: printed numbers keep a factor to about three digits
DEGREE = 180.0 / np.pi
FACTORS = {
    1000.0: "times 1000: looks like mm for m, or g for kg",
    1e-3: "divided by 1000: looks like m for mm, or kg for g",
    1e6: "times a million: looks like kg mm^2 for kg m^2",
    1e-6: "divided by a million: looks like kg m^2 for kg mm^2",
    DEGREE: "times 180/pi: looks like degrees for radians",
    1 / DEGREE: "times pi/180: looks like radians for degrees",
    0.45359237: "times 0.4536: looks like pounds for kg",
    0.0254: "times 0.0254: looks like inches for m",
    -1.0: "the opposite sign",
    2.0: "twice as much",
    0.5: "half as much",
    10.0: "times ten: looks like a decimal point that moved",
    0.1: "a tenth: looks like a decimal point that moved",
}
ANGLES = {np.pi: "half a turn", np.pi / 2: "a quarter turn"}


def describe_factor(value: float, before: float) -> tuple[str, ...]:
    """Return words for the factor from one number to another [any unit]; nothing for an ordinary one."""
    if before == 0.0:
        return tuple(f"it is {words}" for turn, words in ANGLES.items() if abs(abs(value) - turn) <= NEAR * turn)
    if value == 0.0:
        return ("B has none",)
    ratio = value / before
    found = tuple(words for factor, words in FACTORS.items() if abs(ratio - factor) <= NEAR * abs(factor))
    return found or (("the same digits in another order",) if _list_digits(value) == _list_digits(before) else ())


def describe_vector_change(value: Array, before: Array) -> tuple[str, ...]:
    """Return words for the way from one vector to another (3,) [any unit]: signs, exchanged or mistyped entries, a factor."""
    near = NEAR * max(float(np.abs(value).max()), float(np.abs(before).max()))
    other = [k for k in range(3) if abs(value[k] - before[k]) > near]
    if other and len(other) < 3 and all(abs(value[k] + before[k]) <= near for k in other):
        return (f"the opposite sign of {' and '.join('xyz'[k] for k in other)}",)
    if len(other) == 2:
        a, b = other
        if abs(value[a] - before[b]) <= near and abs(value[b] - before[a]) <= near:
            return (f"{'xyz'[a]} and {'xyz'[b]} are exchanged",)
    if len(other) == 1:
        hints = describe_factor(float(value[other[0]]), float(before[other[0]])) if before[other[0]] else ()
        return tuple(f"its {'xyz'[other[0]]}: {words}" for words in hints)
    return describe_factor(float(np.linalg.norm(value)), float(np.linalg.norm(before)))


def _list_digits(value: float) -> list[str]:
    """The digits of a number as files print it, in order of size; none where there are too few to be an accident."""
    digits = sorted(f"{abs(value):.6e}".partition("e")[0].replace(".", "").rstrip("0"))
    return digits if len(set(digits)) > 1 else [f"{value!r}"]


def describe_tensor_change(one: Inertia, two: Inertia) -> tuple[str, ...]:
    """Return words for the way from one tensor to another [kg m^2]: a factor, another point, other axes, signs of products."""
    return tuple(_list_tensor_hints(one, two))


def _list_tensor_hints(one: Inertia, two: Inertia) -> Iterator[str]:
    a = one.tensor
    b = two.tensor
    scale = max(float(np.abs(a).max()), float(np.abs(b).max()))
    largest = float(np.abs(a).max())
    for factor, words in FACTORS.items():
        if largest and float(np.abs(b - factor * a).max()) <= NEAR * abs(factor) * largest:
            yield words
            return
    for body, sign, words in (
        (two, 1.0, "B's is about the link's origin"),
        (one, -1.0, "A's is about the link's origin"),
    ):
        if float(np.abs(b - a - sign * compute_parallel_axis_term(body.mass, body.com)).max()) <= NEAR * scale:
            yield f"they differ by m (c^2 1 - c c^T): {words}, not about the centre of mass"
            return
    flipped = np.where(np.eye(3, dtype=bool), a, -a)
    if float(np.abs(b - flipped).max()) <= NEAR * scale:
        yield "the products of inertia have the opposite sign"
    elif float(np.abs(np.linalg.eigvalsh(a) - np.linalg.eigvalsh(b)).max()) <= NEAR * scale:
        yield "the principal moments are the same: its axes are turned"
