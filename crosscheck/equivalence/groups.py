"""Several differences that are one: links that are missing, bodies that were exchanged, one factor on all numbers of a kind."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import SAME, SEEN
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.members import MemberPair, list_body_differences
from crosscheck.equivalence.tree import Member, Tree
from crosscheck.lifting.rigid import join_bodies, move_inertia
from flexinv.model.mechanism import Array, Inertia, Placement
from flexinv.model.parallel_axis import compute_parallel_axis_term

BODY = ("mass", "centre of mass", "inertia tensor")
TURNED = 10.0  # rounding errors of a tensor that is turned and summed over those of a number
ALL = 3  # differences of one kind and factor from which on they are one
# Numbers of drives that many joints share.
ALIKE = ("rotor inertia", "damping", "dry friction", "spring stiffness", "gear", "effort limit", "velocity limit")
FIELDS = {
    "mass": "mass",
    "centre of mass": "com",
    "inertia tensor": "tensor",
    "position of joint": "placement position",
}
FIELDS |= {"rotor inertia": "rotor_inertia", "damping": "damping", "dry friction": "friction"}


def find_missing_links(pair: MemberPair) -> Difference | None:
    """Return the links whose bodies only one of them has, where that is all that differs of a member [kg]."""
    one = pair.one
    there = move_inertia(pair.alignment.frame, pair.two.inertia)
    first = dict(one.parts)
    second = {name: move_inertia(pair.alignment.frame, body) for name, body in pair.two.parts}
    for side, mine, others, target in (("A", first, second, there), ("B", second, first, one.inertia)):
        for lost in _list_missing_candidates(mine, others):
            bodies = join_bodies(body for name, body in mine.items() if name not in lost)
            if _is_same_body(bodies, target, pair.size):
                return _make_missing_difference(pair, side, lost, mine, there)
    return None


def find_differing_body(pair: MemberPair) -> list[Difference]:
    """Return the differences of one body of several that make up a member, where that body is all that differs.

    Bodies have counterparts by their names; or one body of either is what the whole of the other leaves beside its others,
    however the other merged or split them.
    """
    first = dict(pair.one.parts)
    second = {n: move_inertia(pair.alignment.frame, body) for n, body in pair.two.parts}
    if len(first) == len(pair.one.parts) > 1 and first.keys() == second.keys():
        found = {name: list(_list_part_differences(pair, name, first[name], second[name])) for name in first}
        # What is no more than rounding of turned frames is put right with it.
        off = [differences for differences in found.values() if _list_with_cause(differences)]
        return [d for differences in found.values() for d in differences] if len(off) == 1 else []
    tried = [
        differences
        for differences in (_list_single_body_differences(pair, first), _find_body_of_second(pair, second))
        if differences
    ]
    return min(tried, key=lambda differences: len(_list_with_cause(differences)), default=[])


def find_counterpart(parts: Mapping[str, Inertia], rest: Inertia, size: float) -> str:
    """Return the name of the body beside which the others are, together, a rest [kg, m, kg m^2]; "" where none is."""
    for name in parts:
        if _is_same_body(join_bodies(body for part, body in parts.items() if part != name), rest, size):
            return name
    return ""


def _list_single_body_differences(pair: MemberPair, ours: dict[str, Inertia]) -> list[Difference]:
    """The differences of one body of A, where those are fewer than those of the whole."""
    if len(ours) < max(2, len(pair.one.parts)):
        return []
    whole = _list_with_cause(list_body_differences(pair))
    there = move_inertia(pair.alignment.frame, pair.two.inertia)
    tried = []
    for name, body in ours.items():
        rest = join_bodies(other for part, other in ours.items() if part != name)
        if there.mass - rest.mass > SEEN * there.mass:
            tried.append(list(_list_part_differences(pair, name, body, _compute_body_remainder(there, rest))))
    best = min(tried, key=lambda part: len(_list_with_cause(part)), default=[])
    return best if best and len(_list_with_cause(best)) < len(whole) else []


def _find_body_of_second(pair: MemberPair, theirs: dict[str, Inertia]) -> list[Difference]:
    """The difference of one body of B, where that body's alone stands for two or more of the whole."""
    whole = list(list_body_differences(pair))
    one = pair.one.inertia
    if len(theirs) < max(2, len(pair.two.parts)) or len(_list_with_cause(whole)) < 2:
        return []
    for name, body in theirs.items():
        rest = join_bodies(other for part, other in theirs.items() if part != name)
        if one.mass - rest.mass <= SEEN * one.mass:
            continue
        part = _list_with_cause(_list_part_differences(pair, name, _compute_body_remainder(one, rest), body))
        if len(part) == 1:
            return [replace(part[0], changes=tuple(change for d in whole for change in d.changes))]
    return []


def _list_with_cause(differences: Iterable[Difference]) -> list[Difference]:
    return [d for d in differences if d.cause]


def _compute_body_remainder(whole: Inertia, part: Inertia) -> Inertia:
    """The rest of a body that a part of it is taken from [kg, m, kg m^2]; tensors by Steiner's theorem."""
    mass = whole.mass - part.mass
    com = (whole.mass * whole.com - part.mass * part.com) / mass
    arms = [(body.mass, body.com - com) for body in (whole, part)]
    about = [compute_parallel_axis_term(m, d) for m, d in arms]
    return Inertia.build_unchecked(mass, com, whole.tensor + about[0] - part.tensor - about[1])


def _list_part_differences(pair: MemberPair, name: str, one: Inertia, two: Inertia) -> Iterator[Difference]:
    """Yield the differences of one body of a member, each with a change of that body."""
    seat = replace(pair.alignment, frame=Placement())
    for d in list_body_differences(
        replace(pair, one=_make_body_member(pair, name, one), two=_make_body_member(pair, name, two), alignment=seat)
    ):
        changes = tuple((index, f"part {field_name} {name}", value) for index, field_name, value in d.changes)
        yield replace(d, place=f"body {name} (on link {pair.one.name})", changes=changes)


def _make_body_member(pair: MemberPair, name: str, body: Inertia) -> Member:
    return replace(pair.one, name=name, mass=body.mass, com=body.com, tensor=body.tensor, parts=((name, body),))


def _list_missing_candidates(mine: dict[str, Inertia], others: dict[str, Inertia]) -> Iterator[tuple[str, ...]]:
    """Candidates: all links with a mass that the other has not, then each alone."""
    empty = [name for name, body in others.items() if not body.mass and not body.tensor.any()]
    lost = [n for n, body in mine.items() if (n not in others or n in empty) and (body.mass or body.tensor.any())]
    if lost:
        yield tuple(lost)
        if len(lost) > 1:
            yield from ((name,) for name in lost)


def _is_same_body(one: Inertia, two: Inertia, size: float, tolerance: float = SAME) -> bool:
    scale = max(one.mass, two.mass)
    largest = max(float(np.abs(one.tensor).max()), float(np.abs(two.tensor).max()))
    return (
        abs(one.mass - two.mass) <= tolerance * scale
        and (not scale or float(np.linalg.norm(one.com - two.com)) <= tolerance * size)
        and float(np.abs(one.tensor - two.tensor).max()) <= TURNED * tolerance * largest
    )


def _make_missing_difference(
    pair: MemberPair, side: str, lost: tuple[str, ...], mine: dict[str, Inertia], there: Inertia
) -> Difference:
    mass = sum(mine[name].mass for name in lost)
    values = (f"{mass:.9g} kg", "none") if side == "A" else ("none", f"{mass:.9g} kg")
    place = ("link " if len(lost) == 1 else "links ") + ", ".join(lost)
    changes = tuple(
        pair.make_change(n, v) for n, v in (("mass", there.mass), ("com", there.com), ("tensor", there.tensor))
    )
    return Difference("rigid", f"body that only {side} has", place, mass, "kg", *values, changes)


def join_exchanged_bodies(
    first: Tree, second: Tree, pairs: Iterable[MemberPair], differences: list[Difference]
) -> list[Difference]:
    """Return the differences with bodies that stand at one another's link as one each."""
    off = {d.place for d in differences if d.cause in BODY}
    by_place = {pair.link: pair for pair in pairs if pair.link in off}
    used: set[str] = set()
    made = []
    for place, pair in by_place.items():
        for other, that in by_place.items():
            if place >= other or {place, other} & used or not _is_exchanged_pair(pair, that):
                continue
            used |= {place, other}
            changes = [
                c for d in differences if d.place in (place, other) and d.cause in (*BODY, "") for c in d.changes
            ]
            size = abs(pair.one.mass - that.one.mass)
            words = f"{place} and {other}"
            made.append(Difference("rigid", "bodies exchanged", words, size, "kg", "", "", tuple(changes)))
    return made + [d for d in differences if not (d.place in used and d.cause in (*BODY, ""))]


def _is_exchanged_pair(one: MemberPair, two: MemberPair) -> bool:
    """Return True if each has the other's body, and not its own to rounding: two alike are not exchanged."""
    alike = _has_equal_inertia(one.one, one.two, one.size, SEEN) and _has_equal_inertia(
        two.one, two.two, one.size, SEEN
    )
    return (
        _has_equal_inertia(one.one, two.two, one.size) and _has_equal_inertia(two.one, one.two, one.size) and not alike
    )


def _has_equal_inertia(one: Member, two: Member, size: float, tolerance: float = SAME) -> bool:
    return bool(one.mass) and _is_same_body(one.inertia, two.inertia, size, tolerance)


def join_scaled_differences(first: Tree, differences: list[Difference]) -> list[Difference]:
    """Return the differences with one factor on all numbers of a kind as one each."""
    for cause, name in FIELDS.items():
        members = [d for d in differences if d.cause == cause]
        factors = [factor for d in members if (factor := _find_common_factor(first, d, name)) is not None]
        if len(members) < ALL or len(factors) < len(members) or np.ptp(factors) > 1e-6 * abs(factors[0]):
            continue
        if len(members) == sum(bool(np.any(_read_member_field(m, name))) for m in first.members):
            differences = [d for d in differences if d.cause != cause]
            differences.append(_join_differences(members, factors[0]))
    return differences


def join_equal_differences(differences: list[Difference]) -> list[Difference]:
    """Return the differences with the same two numbers of drives in several joints as one each [unit of each]."""
    for cause in ALIKE:
        members = [d for d in differences if d.cause == cause and d.place.startswith("joint ")]
        for pair in dict.fromkeys((d.first, d.second) for d in members):
            same = [d for d in members if (d.first, d.second) == pair]
            if len(same) >= ALL and len({d.unit for d in same}) == 1:
                differences = [*(d for d in differences if d not in same), _join_same_joints(same)]
    return differences


def _join_same_joints(same: list[Difference]) -> Difference:
    names = ", ".join(d.place.removeprefix("joint ") for d in same)
    changes = tuple(change for d in same for change in d.changes)
    return replace(same[0], place=f"joints {names}", changes=changes, printed=max(d.printed for d in same))


def _read_member_field(member: Member, name: str) -> Array:
    record, _, part = name.partition(" ")
    value = getattr(member, record)
    return np.asarray(getattr(value, part) if part else value)


def _find_common_factor(first: Tree, difference: Difference, name: str) -> float | None:
    """The factor of all numbers of a difference; None where they have none in common."""
    changes = [(k, value) for k, field_name, value in difference.changes if field_name == name]
    if len(changes) != 1:
        return None
    before = _read_member_field(first.members[changes[0][0]], name).ravel()
    after = np.asarray(changes[0][1]).ravel()
    square = float(before @ before)
    factor = float(before @ after) / square if square else None
    if factor is None or np.abs(after - factor * before).max() > 1e-6 * max(np.abs(after).max(), np.abs(before).max()):
        return None
    return factor


def _join_differences(members: list[Difference], factor: float) -> Difference:
    kind = "links" if members[0].place.startswith("link") else "joints"
    hints = members[0].hints if all(d.hints == members[0].hints for d in members) else ()
    largest = max(members, key=lambda d: d.size)
    return replace(
        largest, place=f"all {kind} with one ({len(members)})", changes=tuple(c for d in members for c in d.changes), hints=hints,
        first="stated", second=f"{factor:.9g} times that of A" if factor else "none", size=abs(factor - 1.0), unit="of it",
    )  # fmt: skip
