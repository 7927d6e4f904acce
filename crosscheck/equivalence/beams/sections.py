"""Differences of links that bend: length, curvature, stiffness, masses, damping, and the stations of what stands on them.

One factor on a whole table is one difference: another modulus, another density.  Meshes are no part of the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.equivalence.alignment.member_alignment import SAME
from crosscheck.equivalence.beams.mesh_beams import list_mesh_beam_differences
from crosscheck.equivalence.beams.meshes import list_mesh_differences
from crosscheck.equivalence.beams.sampled import SampledBeam, collect_stations, sample_beam
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.hints import describe_factor
from flexinv.model.mechanism import Array, Beam, Joint, Link, Mechanism, ModalDamping

# By field of a beam's numbers: quantity and unit of each column.
COLUMNS: dict[str, tuple[tuple[str, str], ...]] = {
    "length": (("length of beam", "m"),),
    "curvature": (("initial twist", "1/m"), ("initial curvature about y", "1/m"), ("initial curvature about z", "1/m")),
    "stiffness": (
        ("axial stiffness EA", "N"), ("shear stiffness GA_y", "N"), ("shear stiffness GA_z", "N"),
        ("torsional stiffness GJ", "N m^2"), ("bending stiffness EI_y", "N m^2"), ("bending stiffness EI_z", "N m^2"),
    ),
    "inertia": (
        ("mass per length", "kg/m"), ("rotary inertia about x", "kg m"), ("rotary inertia about y", "kg m"),
        ("rotary inertia about z", "kg m"),
    ),
    "retardation": tuple((f"damping of {strain}", "s") for strain in ("stretching", "shear along y", "shear along z", "twist",
                                                                      "bending about y", "bending about z")),
}  # fmt: skip
# A whole table that has one factor: what it is called, and what that looks like.
WHOLE = {
    "stiffness": ("stiffness of section", "EA, GA, GJ and EI by one factor: another modulus"),
    "inertia": ("inertia of section", "mass and rotary inertia by one factor: another density"),
    "retardation": ("damping of section", "all strains alike"),
}
Edit = Callable[[Mechanism], Mechanism]


@dataclass(frozen=True)
class BeamDifference:
    """A difference of beams, and the edit that gives B's value to a mechanism with A's."""

    difference: Difference
    edit: Edit


@dataclass(frozen=True)
class MatchedBeams:
    """Two mechanisms and B's links by those of A, where both are matched; joints : B's by those of A."""

    first: Mechanism
    second: Mechanism
    links: Mapping[str, str]
    joints: Mapping[str, str]

    @property
    def both(self) -> Iterator[tuple[str, str, Beam, Beam]]:
        """Yield links of A and of B that bend in both, with their beams."""
        for first, second in self.links.items():
            a = self.first.link_of[first].beam
            b = self.second.link_of[second].beam
            if a is not None and b is not None:
                yield first, second, a, b

    def _build_matched_beams(self) -> dict[str, Beam]:
        """B's beams with A's numbers at B's root, by link of B, but for coupled ones, which are no numbers to be exchanged."""
        return {
            second: sample_beam(a, collect_stations(a, b)).build_beam(b)
            for _, second, a, b in self.both
            if not (a.section.is_coupled or b.section.is_coupled)
        }

    def list_lone_beams(self) -> Iterator[Difference]:
        """Yield links that bend in one of both only (the other holds their shape), other meshes and other coupled sections."""
        for first, second in self.links.items():
            yield from _list_lone_link(f"link {first}", self.first.link_of[first], self.second.link_of[second])
        for first, _, a, b in self.both:
            if (a.section.is_coupled or b.section.is_coupled) and not _is_same_coupled_beam(a, b):
                one, two = ("coupled" if beam.section.is_coupled else "not coupled" for beam in (a, b))
                yield Difference(
                    "beam", "beam with a coupled section", f"link {first}", 1.0, "-", one, two, structural=True
                )

    def describe_other_meshes(self) -> list[str]:
        """Return in words which beams have another mesh: that is discretisation, and not the machine."""
        words = [
            f"{first} {a.elements} of order {a.order} in A, {b.elements} of order {b.order} in B"
            for first, _, a, b in self.both
            if (a.elements, a.order) != (b.elements, b.order)
        ]
        return [f"elements of beams, which are no part of the machine: {', '.join(words)}"] if words else []

    def build_base_mechanism(self) -> Mechanism:
        """Return B with A's beams, stations and stated modal damping, on B's mesh: what differs then is no matter of a beam."""
        shapes = self._build_matched_beams()
        stations = {second: self.first.joint_of[first].station for first, second in self.joints.items()}
        links = {
            second: _move_bodies_to_stations(self.second.link_of[second], self.first.link_of[first])
            for first, second in self.links.items()
        }
        made = [links.get(link.name, link) for link in self.second.links]
        return replace(
            self.second,
            links=tuple(replace(link, beam=shapes.get(link.name, link.beam)) for link in made),
            joints=tuple(_move_joint_to_station(joint, stations.get(joint.name)) for joint in self.second.joints),
            modal_damping=_drop_damping_time(self.first.modal_damping),
        )  # fmt: skip

    def list_differences(self) -> Iterator[BeamDifference]:
        """Yield every difference of beams with its edit [unit of each]."""
        names = COLUMNS if not self._stated else [name for name in COLUMNS if name != "retardation"]
        for first, second, a, b in self.both:
            if not (a.section.is_coupled or b.section.is_coupled):
                stations = collect_stations(a, b)
                tables = sample_beam(a, stations), sample_beam(b, stations)
                for name in names:
                    yield from _list_table_changes(first, second, name, *tables)
            yield from self._list_station_changes(first, second)
        yield from self._list_damping_changes()

    def _list_station_changes(self, first: str, second: str) -> Iterator[BeamDifference]:
        mine = self.first.link_of[first]
        other = self.second.link_of[second]
        at = {body.name: body.station for body in other.bodies}
        for body in mine.bodies:
            if body.name in at and _is_other_station(body.station, at[body.name]):
                station_difference = _make_station_difference(
                    "station of body", f"body {body.name} (on link {first})", body.station, at[body.name]
                )
                yield BeamDifference(station_difference, _make_body_edit(second, body.name, at[body.name]))
        for joint, partner in self.joints.items():
            one = self.first.joint_of[joint]
            two = self.second.joint_of[partner]
            if one.parent == first and two.parent == second and _is_other_station(_end(one.station), _end(two.station)):
                station_difference = _make_station_difference(
                    "station of joint", f"joint {joint}", _end(one.station), _end(two.station)
                )
                yield BeamDifference(station_difference, _make_joint_edit(partner, two.station))

    @property
    def _stated(self) -> bool:
        """Both state the ratio of a mode: retardation times follow from it."""
        return self.first.modal_damping is not None and self.second.modal_damping is not None

    def _list_damping_changes(self) -> Iterator[BeamDifference]:
        one = self.first.modal_damping
        two = self.second.modal_damping
        if one is None or two is None or (one.ratio, one.mode) == (two.ratio, two.mode):
            return
        size = abs(two.ratio - one.ratio)
        shown = (f"{one.ratio:.9g} at mode {one.mode}", f"{two.ratio:.9g} at mode {two.mode}")
        hints = describe_factor(two.ratio, one.ratio) if one.mode == two.mode else ()
        difference = Difference("beam", "modal damping", "all beams", size, "-", *shown, hints=hints)
        yield BeamDifference(difference, lambda mechanism: replace(mechanism, modal_damping=_drop_damping_time(two)))


def _list_lone_link(place: str, mine: Link, other: Link) -> Iterator[Difference]:
    """Differences of two links that are no two beams: of their kinds, or of two meshes, or of a mesh and a beam."""
    one, two = map(_describe_kind, (mine, other))
    if "rigid" in (one, two) and one != two:
        cause = f"link that bends in {'A' if two == 'rigid' else 'B'} only"
        yield Difference("beam", cause, place, 1.0, "-", one, two, structural=True)
    elif one != two:
        yield from list_mesh_beam_differences(place, mine, other)
    elif mine.part is not None and other.part is not None:
        yield from list_mesh_differences(place, mine.part, other.part)


def _describe_kind(link: Link) -> str:
    return "mesh" if link.part is not None else "rigid" if link.is_rigid else "beam"


def _is_same_coupled_beam(one: Beam, two: Beam) -> bool:
    """True where two beams, of which one is coupled, have the same length, curvature and matrices at the same stations."""
    pairs = [
        (np.array(one.length), np.array(two.length)),
        (one.curvature, two.curvature),
        (one.section.stations, two.section.stations),
        (one.section.stiffness_matrices, two.section.stiffness_matrices),
        (one.section.mass_matrices, two.section.mass_matrices),
        (one.section.damping_matrices, two.section.damping_matrices),
    ]
    return all(
        a.shape == b.shape and np.abs(a - b).max(initial=0.0) <= SAME * np.abs(a).max(initial=0.0) for a, b in pairs
    )


def _drop_damping_time(modal_damping: ModalDamping | None) -> ModalDamping | None:
    """A stated ratio whose time is to be computed for the mechanism that it is put into."""
    return None if modal_damping is None else replace(modal_damping, seconds=None)


def _list_table_changes(
    first: str, second: str, name: str, one: SampledBeam, two: SampledBeam
) -> Iterator[BeamDifference]:
    """Yield the differences of one field of a beam's numbers: as one where a factor is common, else by column."""
    a = getattr(one, name)
    b = getattr(two, name)
    place = f"link {first}"
    factor = _find_common_factor(a, b)
    if np.abs(b - a).max() <= SAME * max(np.abs(a).max(), np.abs(b).max()):
        return
    if name in WHOLE and factor is not None:
        cause, words = WHOLE[name]
        hints = (words, *describe_factor(factor, 1.0))
        shown = ("stated", f"{factor:.9g} times that of A")
        difference = Difference("beam", cause, place, abs(factor - 1.0), "of it", *shown, hints=hints)
        yield BeamDifference(difference, _make_table_edit(second, name, slice(None), b))
        return
    for k, (cause, unit) in enumerate(COLUMNS[name]):
        mine = a[:, k]
        other = b[:, k]
        size = float(np.abs(other - mine).max())
        if size > SAME * max(np.abs(mine).max(), np.abs(other).max()):
            worst = int(np.argmax(np.abs(other - mine)))
            hints = (
                *describe_factor(float(other[worst]), float(mine[worst])),
                *_describe_exchanged_axes(name, k, a, b),
            )
            difference = Difference(
                "beam",
                cause,
                place,
                size,
                unit,
                _format_station_values(mine),
                _format_station_values(other),
                hints=hints,
            )
            yield BeamDifference(difference, _make_table_edit(second, name, slice(k, k + 1), other[:, None]))


def _find_common_factor(a: Array, b: Array) -> float | None:
    """The factor of a whole table; None where its numbers have none in common."""
    if a.size < 2 or not a.any() or np.any((a == 0) != (b == 0)):
        return None
    factors = b[a != 0] / a[a != 0]
    return float(factors[0]) if np.ptp(factors) <= SAME * abs(factors[0]) else None


def _describe_exchanged_axes(name: str, column: int, a: Array, b: Array) -> tuple[str, ...]:
    """Words where bending about y in one file is that about z in the other."""
    pair = {"stiffness": (4, 5), "inertia": (2, 3)}.get(name, ())
    if column not in pair:
        return ()
    turned = all(np.abs(a[:, k] - b[:, pair[1 - n]]).max() <= SAME * np.abs(a[:, k]).max() for n, k in enumerate(pair))
    return ("y and z are exchanged",) if turned else ()


def _format_station_values(values: Array) -> str:
    """One number of a uniform beam, else those at the stations."""
    same = np.ptp(values) <= SAME * np.abs(values).max(initial=0.0)
    return " ".join(f"{x:.9g}" for x in (values[:1] if same else values))


def _end(station: float | None) -> float:
    return 1.0 if station is None else station


def _is_other_station(one: float | None, two: float | None) -> bool:
    return one is not None and two is not None and abs(one - two) > SAME


def _make_station_difference(cause: str, place: str, one: float | None, two: float | None) -> Difference:
    assert one is not None
    assert two is not None
    return Difference("beam", cause, place, abs(two - one), "of the length", f"{one:.9g}", f"{two:.9g}")


def _move_joint_to_station(joint: Joint, station: float | None) -> Joint:
    return joint if station is None or joint.station is None else replace(joint, station=station)


def _move_bodies_to_stations(link: Link, like: Link) -> Link:
    """A link whose bodies stand where those of the other link of the same names do."""
    at = {body.name: body.station for body in like.bodies if body.station is not None}
    moved = [
        replace(body, station=at.get(body.name, body.station)) if body.station is not None else body
        for body in link.bodies
    ]
    return replace(link, bodies=tuple(moved))  # fmt: skip


def _apply_to_link(mechanism: Mechanism, name: str, change: Callable[[Link], Link]) -> Mechanism:
    return replace(mechanism, links=tuple(change(link) if link.name == name else link for link in mechanism.links))


def _make_table_edit(link: str, name: str, columns: slice, values: Array) -> Edit:
    def replace_table(one: Link) -> Link:
        assert one.beam is not None
        table = sample_beam(one.beam, one.beam.section.stations).replace_table_columns(name, columns, values)
        return replace(one, beam=table.build_beam(one.beam))

    return lambda mechanism: _apply_to_link(mechanism, link, replace_table)


def _make_body_edit(link: str, name: str, station: float | None) -> Edit:
    def move_body(one: Link) -> Link:
        return replace(
            one, bodies=tuple(replace(b, station=station) if b.name == name else b for b in one.bodies)
        )  # fmt: skip

    return lambda mechanism: _apply_to_link(mechanism, link, move_body)


def _make_joint_edit(name: str, station: float | None) -> Edit:
    def move_joint(mechanism: Mechanism) -> Mechanism:
        joints = tuple(replace(j, station=station) if j.name == name else j for j in mechanism.joints)
        return replace(mechanism, joints=joints)

    return move_joint
