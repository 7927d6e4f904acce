"""Differences of couplings: mimic joints, gears between joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations

from crosscheck.equivalence.alignment.member_alignment import SAME, MemberAlignment
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.judge import is_rounding
from crosscheck.equivalence.members import SIGN, ZERO
from crosscheck.equivalence.tree import Tree

Law = tuple[dict[str, float], float]
Joints = frozenset[str]
Counted = tuple[str, str]  # a way in which coordinates count, by its cause, and the joint
Follows = dict[Joints, tuple[Counted, ...]]
CONVENTIONS = (SIGN, ZERO)
MOST = 2  # of them that are tried together
SHOWN = 4  # names of joints


def add_coupling_differences(
    one: Tree, two: Tree, pairs: Mapping[str, str], alignments: Mapping[str, MemberAlignment], differences: Iterable[Difference],
    tolerance: float = SAME,
) -> list[Difference]:  # fmt: skip
    """Return the differences given and those of couplings [-], [rad], [m]: laws  sum factor q = offset  in A's coordinates.

    tolerance : of factors [-] and offsets [rad], [m]: rounding of the readers' numbers

    A law that both files write alike, over a coordinate that counts another way in B, moves what it couples another way.  That is
    one difference, of the coordinate, and counts as a difference of what drives add: a convention is what no torque feels.
    """
    back = {second: first for first, second in pairs.items()}
    first = dict(_list_coupling_laws(one))
    plain = dict(_list_coupling_laws(two, back))
    second = {key: _map_law(law, back, alignments) for key, law in plain.items()}
    apart = {
        key: (law, plain[key])
        for key, law in first.items()
        if key in second and not _is_same_law(law, second[key], tolerance)
    }
    told = list(differences)
    counted = [(d.cause, d.place.removeprefix("joint ")) for d in told if d.cause in CONVENTIONS]
    follows = _find_following_couplings(apart, back, alignments, counted, tolerance)
    told = [_move_to_drive_family(difference, follows) for difference in told]
    for key, law in first.items():
        if key not in second:
            told.append(_make_lone_coupling("A", key, (_format_law(law), "none")))
        elif key in apart and key not in follows:
            told += _list_law_differences(_describe_place(key), law, second[key], tolerance)
    return told + [
        _make_lone_coupling("B", key, ("none", _format_law(law))) for key, law in second.items() if key not in first
    ]


def _describe_place(joints: Joints) -> str:
    return "joints " + ", ".join(sorted(joints))


def _make_lone_coupling(side: str, joints: Joints, values: tuple[str, str]) -> Difference:
    return Difference("drive", f"coupling that only {side} has", _describe_place(joints), 1.0, "-", *values)


def _list_law_differences(place: str, a: Law, b: Law, tolerance: float) -> Iterator[Difference]:
    gap = max(abs(a[0][name] - b[0].get(name, 0.0)) for name in a[0])
    if gap > tolerance:
        yield Difference("drive", "factor of coupling", place, gap, "-", _format_law(a), _format_law(b))
    if abs(a[1] - b[1]) > tolerance:
        yield Difference("drive", "offset of coupling", place, abs(a[1] - b[1]), "rad", _format_law(a), _format_law(b))


def _is_same_law(a: Law, b: Law, tolerance: float) -> bool:
    gaps = [abs(a[0].get(name, 0.0) - b[0].get(name, 0.0)) for name in {*a[0], *b[0]}]
    return max([*gaps, abs(a[1] - b[1])]) <= tolerance


def _find_following_couplings(
    apart: Mapping[Joints, tuple[Law, Law]],
    back: Mapping[str, str],
    alignments: Mapping[str, MemberAlignment],
    counted: list[Counted],
    tolerance: float,
) -> Follows:
    """Couplings that differ because coordinates count another way: with the fewest of them, and with those of most couplings."""
    ways: dict[Joints, list[tuple[Counted, ...]]] = {}
    for key, (first, second) in apart.items():
        for number in range(1, MOST + 1):
            tried = combinations([one for one in counted if one[1] in key and one[1] in alignments], number)
            alike = [
                some
                for some in tried
                if _is_same_law(first, _map_law(second, back, _drop_coordinate_changes(alignments, some)), tolerance)
            ]
            if alike:
                ways[key] = alike
                break
    often = Counter(one for alike in ways.values() for one in {c for some in alike for c in some})
    return {key: max(alike, key=lambda some: sum(often[one] for one in some)) for key, alike in ways.items()}


def _drop_coordinate_changes(
    alignments: Mapping[str, MemberAlignment], some: Iterable[Counted]
) -> dict[str, MemberAlignment]:
    """The alignments as if some coordinates counted in B as in A."""
    result = dict(alignments)
    for cause, name in some:
        result[name] = replace(result[name], sign=1.0) if cause == SIGN else replace(result[name], offset=0.0)
    return result


def _move_to_drive_family(difference: Difference, follows: Follows) -> Difference:
    """The difference; that of a coordinate by which others go is one of drives."""
    counted = (difference.cause, difference.place.removeprefix("joint "))
    moved = sorted({name for key, some in follows.items() if counted in some for name in key} - {counted[1]})
    if difference.family != "convention" or not moved or is_rounding(difference):
        return difference
    more = f" and {len(moved) - SHOWN} more" if len(moved) > SHOWN else ""
    hint = f"coupled to it by the same law in both: {', '.join(moved[:SHOWN])}{more}"
    return replace(difference, family="drive", hints=(*difference.hints, hint))


def _list_coupling_laws(tree: Tree, names: Mapping[str, str] | None = None) -> Iterator[tuple[Joints, Law]]:
    """Couplings by the joints that they tie, the largest factor first made one."""
    for factors, offset in tree.couplings.values():
        key = frozenset((names or {}).get(name, name) for name in factors)
        yield key, _scale_law((dict(factors), offset))


def _scale_law(law: Law) -> Law:
    """The law whose factor of the joint that comes first in the alphabet is one."""
    factors, offset = law
    named = sorted(name for name, factor in factors.items() if factor)
    lead = factors[named[0]] if named else 1.0
    return {name: factor / lead for name, factor in factors.items()}, offset / lead


def _map_law(law: Law, back: Mapping[str, str], alignments: Mapping[str, MemberAlignment]) -> Law:
    """B's law in A's coordinates: q_B = sign (q_A - offset)."""
    factors = {}
    offset = law[1]
    for name, factor in law[0].items():
        first = back.get(name, name)
        seat = alignments.get(first)
        sign, zero = (seat.sign, seat.offset) if seat is not None else (1.0, 0.0)
        factors[first] = factor * sign
        offset += factor * sign * zero
    return _scale_law((factors, offset))


def _format_law(law: Law) -> str:
    parts = [f"{'-' if factor < 0 else '+'} {abs(factor):.6g} {name}" for name, factor in sorted(law[0].items())]
    return f"{' '.join(parts).removeprefix('+ ')} = {law[1] + 0.0:.6g}"
