"""Differences of couplings: mimic joints, gears between joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from crosscheck.equivalence.align import SAME, Aligned
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.tree import Tree

Law = tuple[dict[str, float], float]


def coupling_differences(
    one: Tree, two: Tree, pairs: Mapping[str, str], seats: Mapping[str, Aligned]
) -> Iterator[Difference]:
    """Yield couplings that differ [-], [rad], [m]: each a law  sum factor q = offset  in A's coordinates."""
    back = {theirs: ours for ours, theirs in pairs.items()}
    ours = dict(_laws(one))
    theirs = {key: _mapped(law, back, seats) for key, law in _laws(two, back)}
    for key in [*ours, *(k for k in theirs if k not in ours)]:
        a, b = ours.get(key), theirs.get(key)
        place = "joints " + ", ".join(sorted(key))
        if a is None or b is None:
            side, law = ("A", a) if b is None else ("B", b)
            assert law is not None
            values = (_words(law), "none") if side == "A" else ("none", _words(law))
            yield Difference("drive", f"coupling that only {side} has", place, 1.0, "-", *values)
            continue
        gap = max(abs(a[0][name] - b[0].get(name, 0.0)) for name in a[0])
        if gap > SAME:
            yield Difference("drive", "factor of coupling", place, gap, "-", _words(a), _words(b))
        if abs(a[1] - b[1]) > SAME:
            yield Difference("drive", "offset of coupling", place, abs(a[1] - b[1]), "rad", _words(a), _words(b))


def _laws(tree: Tree, names: Mapping[str, str] | None = None) -> Iterator[tuple[frozenset[str], Law]]:
    """Couplings by the joints that they tie, the largest factor first made one."""
    for factors, offset in tree.couplings.values():
        key = frozenset((names or {}).get(name, name) for name in factors)
        yield key, _normal((dict(factors), offset))


def _normal(law: Law) -> Law:
    """The law whose factor of the joint that comes first in the alphabet is one."""
    factors, offset = law
    named = sorted(name for name, factor in factors.items() if factor)
    lead = factors[named[0]] if named else 1.0
    return {name: factor / lead for name, factor in factors.items()}, offset / lead


def _mapped(law: Law, back: Mapping[str, str], seats: Mapping[str, Aligned]) -> Law:
    """B's law in A's coordinates: q_B = sign (q_A - offset)."""
    factors, offset = {}, law[1]
    for name, factor in law[0].items():
        ours = back.get(name, name)
        seat = seats.get(ours)
        sign, zero = (seat.sign, seat.offset) if seat is not None else (1.0, 0.0)
        factors[ours] = factor * sign
        offset += factor * sign * zero
    return _normal((factors, offset))


def _words(law: Law) -> str:
    parts = [f"{'-' if factor < 0 else '+'} {abs(factor):.6g} {name}" for name, factor in sorted(law[0].items())]
    return f"{' '.join(parts).removeprefix('+ ')} = {law[1] + 0.0:.6g}"
