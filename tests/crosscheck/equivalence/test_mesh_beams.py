"""A mesh beside a beam before `compare`: length, mass, EA, GJ and EI of both, and how far rigid end faces take them apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from part_examples import make_bar, make_block, make_part, make_same_beam

from crosscheck.equivalence.beams.mesh_beams import END_FACES, UniformBar, compute_uniform_bar
from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.difference import Difference
from flexinv.model.mechanism import Beam, Body, Inertia, Joint, Link, Mechanism, Placement, Section
from flexinv.model.part import Material, MeshedPart
from flexinv.typing import Array

STIFF = ("axial", "torsion", "softer", "stiffer")
TORSION_CONSTANTS = {
    1: 0.1405770,
    2: 0.2286817 / 8.0,
}  # of a square and of 1 : 1/2 by the width to the fourth (Saint-Venant)


def make_material(young: float = 70e9, poisson: float = 0.0, density: float = 2700.0) -> Material:
    return Material.build_isotropic(young, poisson, density)


def make_arm(link: Link, **at: object) -> Mechanism:
    """A link on a hub with a hinge and a load at its end, which is an interface or a station."""
    wrist = Joint("wrist", "revolute", "bar", "hand", axis=np.array([0.0, 1.0, 0.0]), **at)  # type: ignore[arg-type]
    return Mechanism(
        "arm", (link, Link("hand", (Body("load", Inertia(0.4)),))), (Joint("hub", "revolute", "world", "bar"), wrist)
    )


def compare_bar(part: MeshedPart, beam: Beam, swapped: bool = False) -> dict[str, Difference]:
    """Differences by the words before "of mesh and of beam"."""
    both = [make_arm(Link("bar", part=part), interface="tip"), make_arm(Link("bar", beam=beam), station=1.0)]
    found = compare(*(both[::-1] if swapped else both))
    assert not found.equal
    assert all(one.family == "beam" for one in found.differences), [one.words for one in found.differences]
    return {one.cause.removesuffix(" of mesh and of beam"): one for one in found.differences}


@pytest.mark.parametrize("swapped", [False, True])
def test_a_slender_bar_is_its_beam_within_the_bound(swapped: bool) -> None:
    """Without Poisson's ratio only torsion is off: by the mesh, of which 4 x 4 bricks across leave less than the bound."""
    part = make_bar("hexahedron20", count=(20, 4, 4), material=make_material(), stiffening=False)
    found = compare_bar(part, make_same_beam(), swapped)
    assert list(found) == [
        "length", "mass", "axial stiffness EA", "torsional stiffness GJ", "bending stiffness EI, the softer",
        "bending stiffness EI, the stiffer",
    ]  # fmt: skip
    for name, one in found.items():
        assert one.size < (0.5 / 40 if "GJ" in name else 1e-7), (
            one.words
        )  # the bound; what factoring leaves of exact fields
        assert one.unit == "of it"
        assert not one.hints or one.hints[0].startswith("within 1.2 % (0.5 of width over length)")
    assert float(found["bending stiffness EI, the softer"].first.split()[0]) == pytest.approx(70e9 * 0.02**4 / 12)


@pytest.mark.parametrize(
    ("material", "count", "beyond"),
    [
        (make_material(young=73.5e9), (20, 2, 2), ["EA", "GJ", "softer", "stiffer"]),
        (make_material(), (20, 1, 1), ["GJ"]),  # one brick across takes the polar moment for the torsion constant
    ],
)
def test_what_end_faces_do_not_explain_is_said(
    material: Material, count: tuple[int, int, int], beyond: list[str]
) -> None:
    part = make_bar("hexahedron20", count=count, material=material, stiffening=False)
    found = compare_bar(part, make_same_beam())
    told = [name for name, one in found.items() if any(hint.startswith("beyond") for hint in one.hints)]
    assert [any(name.endswith(word) for name in told) for word in beyond] == [True] * len(beyond)
    assert len(told) == len(beyond)


def test_another_density_is_another_mass() -> None:
    """Masses are those of rigid bodies too: named there, and beside the stiffness."""
    part = make_bar("hexahedron20", count=(20, 1, 1), material=make_material(density=2727.0), stiffening=False)
    both = [
        make_arm(Link("bar", part=part), interface="tip"),
        make_arm(Link("bar", beam=make_same_beam()), station=1.0),
    ]
    found = {one.cause: one for one in compare(*both).differences}
    assert found["mass of mesh and of beam"].size == pytest.approx(1 - 1 / 1.01)
    assert any(one.family == "rigid" for one in found.values())


@pytest.mark.parametrize("poisson", [0.3, 0.45])
@pytest.mark.parametrize("flat", [1, 2])
def test_end_faces_stiffen_by_less_than_the_bound(flat: int, poisson: float) -> None:
    """Of two lengths, so that what the mesh leaves of the section (the same for both) is told from what the ends add."""
    width = 0.02
    section = width**2 / flat
    second = sorted([width * (width / flat) ** 3 / 12, width**3 * (width / flat) / 12])
    shear = 70e9 / 2 / (1 + poisson)
    exact = [70e9 * section, shear * TORSION_CONSTANTS[flat] * width**4, *(70e9 * one for one in second)]
    off = []
    for slender in (5, 10):
        points, cells = make_block("hexahedron20", (width * slender, width, width / flat), (2 * slender, 2, 2))
        part = make_part(points, cells, "hexahedron20", make_material(poisson=poisson), modes=2, stiffening=False)
        bar = compute_uniform_bar(Link("bar", part=part))
        assert bar.width == pytest.approx(width)
        off.append([getattr(bar, name) / value - 1.0 for name, value in zip(STIFF, exact, strict=True)])
    ends = (np.array(off[0]) - off[1]) / (1 / 5 - 1 / 10)
    assert (ends > 0.0).all()
    assert (ends < [0.27, 0.35, 0.27, 0.27]).all(), ends  # as the module states
    assert max(ends) < END_FACES


def list_numbers(bar: UniformBar) -> Mapping[str, float]:
    return {name: getattr(bar, name) for name in ("length", "mass", *STIFF)}


def make_tapered_beam() -> Beam:
    """EI from 1 to 3 N m^2, softer about z, in a frame that is turned and moved."""
    rows = np.array([[2e4, 1e4, 1e4, 0.5, 2.0, 1.0], [6e4, 3e4, 3e4, 1.5, 6.0, 3.0]])
    section = Section(np.array([0.0, 1.0]), rows, np.array([0.2, 0.6]), np.array([[2e-6, 1e-6, 1e-6]] * 2))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return Beam(0.5, section, elements=2, order=3, placement=Placement(np.array([0.1, 0.2, 0.3]), turn))


def test_a_tapered_beam_has_the_mean_of_its_compliance() -> None:
    """Of numbers that grow from k to 3 k along the length the harmonic mean is 2 k / ln 3."""
    mean = 2.0 / np.log(3.0)
    found = list_numbers(compute_uniform_bar(Link("bar", beam=make_tapered_beam())))
    expected = {
        "length": 0.5,
        "mass": 0.2,
        "axial": 2e4 * mean,
        "torsion": 0.5 * mean,
        "softer": mean,
        "stiffer": 2 * mean,
    }
    assert found == pytest.approx(expected, rel=1e-9)  # Gauss points of a fraction


def test_the_axis_on_which_a_section_is_stated_does_not_matter() -> None:
    beam = make_tapered_beam()
    moved = replace(beam.section.move_axis(0.01, -0.02, 0.3))
    found, same = (compute_uniform_bar(Link("bar", beam=one)) for one in (beam, replace(beam, section=moved)))
    assert list_numbers(found) == pytest.approx(list_numbers(same), rel=1e-9)  # rounding of the stiffness's inverse


def test_a_bent_bar_is_its_curved_beam() -> None:
    """An arc of 60 degrees: frames along the axis count, to what 40 widths and two bricks across leave (2 %, of torsion)."""
    angle = np.pi / 3
    points, cells = make_block("hexahedron20", (0.8, 0.02, 0.02), (20, 2, 2))
    radius = 0.8 / angle
    bent = np.column_stack(_bend(points, radius))
    faces = [np.flatnonzero(np.abs(points[:, 0] - x) < 1e-9) for x in (0.0, 0.8)]
    straight = make_part(points, cells, "hexahedron20", make_material(), stiffening=False)
    interfaces = tuple(
        replace(one, nodes=nodes, origin=bent[nodes].mean(axis=0))
        for one, nodes in zip(straight.interfaces, faces, strict=True)
    )
    part = replace(straight, points=bent, interfaces=interfaces)
    beam = replace(make_same_beam(), curvature=np.array([0.0, 0.0, 1.0 / radius]))
    mesh, own = (list_numbers(compute_uniform_bar(link)) for link in (Link("a", part=part), Link("a", beam=beam)))
    assert mesh == pytest.approx(own, rel=0.02)
    assert own["axial"] < 0.1 * 28e6  # an arc bends where a bar is pulled


def _bend(points: Array, radius: float) -> tuple[Array, Array, Array]:
    turned = points[:, 0] / radius
    return (radius - points[:, 1]) * np.sin(turned), radius - (radius - points[:, 1]) * np.cos(turned), points[:, 2]
