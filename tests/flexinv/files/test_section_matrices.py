"""Sections by matrices: what a file says of them, about which axis, in whose order; and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from coupled_beams import BEND_TWIST, full, mass_about

import flexinv
from flexinv.elements.beam_element import scale_stiffness
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kinematics.mesh import build
from flexinv.model.mechanism import Mechanism, Section, with_retardation
from flexinv.typing import Array

HEAD = 'source = "test"\ngravity_m_per_s2 = [0, 0, 0]\n'
LINK = """[links.link]
kind = "beam"
length_m = 1
section = "s"
[joints.base]
kind = "fixed"
parent = "world"
child = "link"
"""
MASS = mass_about(0.01, -0.02)
# BeamDyn's axes: x and y across, z along the blade, so that x, y, z of VABS are its z, x, y.
BEAMDYN = [1, 2, 0, 4, 5, 3]


def load(tmp_path: Path, section: str, extra: str = "") -> Mechanism:
    file = tmp_path / "models" / "arm" / "mechanism.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(HEAD + "[sections.s]\n" + section + extra + LINK, encoding="utf-8")
    return load_mechanism(file)


def section_of(mechanism: Mechanism) -> Section:
    beam = mechanism.links[0].beam
    assert beam is not None
    return beam.section


def write(stiffness: Array, mass: Array, *more: str) -> str:
    lines = ['shape = "matrices"', f"stiffness_matrix = {stiffness.tolist()}", f"mass_matrix = {mass.tolist()}", *more]
    return "\n".join(lines) + "\n"


def test_matrices_are_those_of_the_file(tmp_path: Path) -> None:
    own = section_of(load(tmp_path, write(full(), MASS, "retardation_s = 1e-3")))
    # symmetric to rounding of the generator; the mass is taken apart and put together again
    np.testing.assert_allclose(own.stiffness_matrices[0], full(), rtol=1e-15)
    np.testing.assert_allclose(own.mass_matrices[0], MASS, rtol=0, atol=1e-15)
    np.testing.assert_allclose(own.damping_matrices[0], 1e-3 * full(), rtol=1e-15)
    assert own.mass_centre is not None
    np.testing.assert_allclose(own.mass_centre[0], [0.01, -0.02], rtol=1e-14)


def test_beamdyn_writes_the_same_section_in_another_order(tmp_path: Path) -> None:
    order = np.ix_(BEAMDYN, BEAMDYN)
    lost = 1e-3 * full(4)
    more = f"damping_matrix = {lost[order].tolist()}"
    theirs = load(tmp_path, write(full()[order], MASS[order], 'convention = "BeamDyn"', more))
    ours = load(tmp_path, write(full(), MASS, f"damping_matrix = {lost.tolist()}"))
    assert section_of(theirs) == section_of(ours)
    assert section_of(theirs) != section_of(load(tmp_path, write(full(1), MASS)))


def test_diagonal_matrices_are_a_section_by_numbers(tmp_path: Path) -> None:
    diagonal = np.diag([1e5, 4e4, 3e4, 2.0, 5.0, 4.0])
    mass = mass_about(0.0, 0.0, product=0.0)
    matrices = section_of(load(tmp_path, write(diagonal, mass)))
    numbers = (
        "EA_N = 1e5\nGA_N = { y = 4e4, z = 3e4 }\nGJ_Nm2 = 2.0\nEI_Nm2 = { y = 5.0, z = 4.0 }\n"
        "mass_per_length_kg_per_m = 0.4\nrho_I_kgm = { x = 9e-4, y = 5e-4, z = 4e-4 }\n"
    )
    assert not matrices.is_coupled
    assert matrices == section_of(load(tmp_path, numbers))


def test_the_axis_of_the_beam_may_be_elsewhere_in_the_matrices(tmp_path: Path) -> None:
    own = section_of(load(tmp_path, write(full(), MASS, "axis = { y_m = 0.03, z_m = -0.01, turn_deg = 30 }")))
    there = section_of(load(tmp_path, write(full(), MASS))).move_axis(0.03, -0.01, np.pi / 6)
    assert own == there
    back = own.move_axis(0.0, 0.0, -np.pi / 6).move_axis(-0.03, 0.01)
    np.testing.assert_allclose(back.stiffness_matrices[0], full(), rtol=0, atol=1e-13)  # rounding of 90 N
    np.testing.assert_allclose(back.mass_matrices[0], MASS, rtol=0, atol=1e-15)


def test_a_shear_centre_off_the_axis_couples_shear_and_twist() -> None:
    """A force through the shear centre does not twist: about an axis p before it, gamma' = gamma + kappa x p."""
    plain = Section(
        np.zeros(1), np.array([[90.0, 40.0, 30.0, 0.5, 0.8, 0.6]]), np.ones(1), np.array([[2e-3, 1e-3, 1e-3]])
    )
    c = plain.move_axis(-0.1, 0.0).stiffness_matrices[0]  # the shear centre is at y = 0.1 of the new axis
    strain = np.linalg.solve(
        c, [0.0, 0.0, 1.0, 0.1, 0.0, 0.0]
    )  # the unit force along z there: its moment about x is y F
    assert strain[3] == pytest.approx(0.0, abs=1e-15)
    assert strain[2] == pytest.approx(1.0 / 30.0, rel=1e-14)


def test_a_taper_between_two_matrices_is_linear_in_them(tmp_path: Path) -> None:
    other = '[sections.t]\nshape = "circle"\ndiameter_m = 0.01\nE_Pa = 1e6\nnu = 0.3\nrho_kg_per_m3 = 1000\n'
    text = LINK.replace('section = "s"', 'section = [{ at = 0, section = "s" }, { at = 1, section = "t" }]')
    file = tmp_path / "mechanism.toml"
    file.write_text(HEAD + "[sections.s]\n" + write(full(), MASS) + other + text, encoding="utf-8")
    own = section_of(load_mechanism(file))
    assert own.stiffness.shape == (2, 6, 6)
    assert (own.stiffness[1] == np.diag(np.diagonal(own.stiffness[1]))).all()
    np.testing.assert_allclose(own.mass_matrices[0], MASS, rtol=0, atol=1e-15)


def lopsided() -> Array:
    c = full()
    c[0, 3] *= 1.01
    return c


def indefinite() -> Array:
    c = BEND_TWIST.copy()
    c[3, 4] = c[4, 3] = 1.1 * np.sqrt(c[3, 3] * c[4, 4])
    return c


def changed(matrix: Array, row: int, column: int, value: float) -> Array:
    c = matrix.copy()
    c[row, column] = c[column, row] = value
    return c


REFUSED = {
    "not symmetric": (write(lopsided(), MASS), r"stiffness_matrix[\s\S]*not symmetric: entry \(1, 4\)"),
    "not positive": (write(indefinite(), MASS), r"stiffness_matrix[\s\S]*not positive definite"),
    "negative stiffness": (write(changed(full(), 3, 3, -1.0), MASS), r"not positive definite: the stiffness of twist is -1"),
    "mass not symmetric": (write(full(), MASS + np.triu(np.full((6, 6), 1e-2), 1)), r"mass_matrix[\s\S]*not symmetric"),
    "two masses": (write(full(), changed(MASS, 2, 2, 0.5)), r"mass_matrix[\s\S]*no mass in the section's plane"),
    "mass before the section": (write(full(), changed(MASS, 1, 5, 0.01)), r"mass_matrix[\s\S]*no mass in the section's plane"),
    "no mass": (write(full(), np.zeros((6, 6))), r"mass_matrix[\s\S]*its mass is 0 kg/m"),
    "offset without inertia": (write(full(), changed(MASS, 3, 3, 1e-5)), r"mass_matrix[\s\S]*about the mass centre"),
    "damping that feeds": (
        write(full(), MASS, f"damping_matrix = {(1e-3 * indefinite()).tolist()}"), r"damping_matrix[\s\S]*feeds energy",
    ),
    "two dampings": (
        write(full(), MASS, f"damping_matrix = {full().tolist()}", "retardation_s = 1e-3"), r"damping_matrix[\s\S]*both",
    ),
    "both forms": (write(full(), MASS, "EA_N = 1e5"), r"EA_N[\s\S]*EA_N beside stiffness_matrix[\s\S]*not both"),
    "no shape": (write(full(), MASS).split("\n", 1)[1], r'without a shape[\s\S]*shape = "matrices"'),
    "shape and matrices": (
        write(full(), MASS).replace('"matrices"', '"circle"'), r'stiffness_matrix with shape = "circle"',
    ),
    "five rows": (write(full()[:5], MASS), "six rows of six numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_no_section_is(name: str, tmp_path: Path) -> None:
    text, words = REFUSED[name]
    with pytest.raises(InputError, match=words):
        load(tmp_path, text)


def test_damping_of_all_beams(tmp_path: Path) -> None:
    plain = load(tmp_path, write(full(), MASS))
    whole = load(tmp_path, write(full(), MASS), "[damping]\nretardation_s = 1e-3\n")
    np.testing.assert_allclose(section_of(whole).damping_matrices[0], 1e-3 * full(), rtol=1e-15)
    assert section_of(with_retardation(plain, 1e-3)) == section_of(whole)
    with pytest.raises(InputError, match="coupled strains: expected one number"):
        with_retardation(plain, [1e-3, 1e-3, 1e-3, 2e-3, 1e-3, 1e-3])
    ratio = flexinv.natural_modes(load(tmp_path, write(full(), MASS), "[damping]\nratio = 0.02\nmode = 2\n"))
    assert ratio.ratio[1] == pytest.approx(0.02, rel=1e-9)


def test_the_overview_says_what_is_coupled(tmp_path: Path) -> None:
    from flexinv.analysis.overview import build_overview_tables

    row = build_overview_tables(load(tmp_path, write(BEND_TWIST, MASS)))["beams"].iloc[0]
    assert row["EI_y [N m^2]"] == BEND_TWIST[4, 4]
    assert row["coupled"] == "twist with bending y +0.4, mass centre 0.01, -0.02 m"


def test_elements_end_where_matrices_step_or_kink(tmp_path: Path) -> None:
    """A coupling that jumps from one station to the next ends an element; one that grows along the beam does not."""
    sections = ""
    for name, part in (("s", 0.1), ("t", 0.2), ("u", -0.3)):
        c = full()
        c[3, 4] = c[4, 3] = part * np.sqrt(c[3, 3] * c[4, 4])
        sections += f"[sections.{name}]\n" + write(c, MASS)
    rows = {
        "smooth": ([(0, "s"), (0.5, "t"), (1, "t")], 2),
        "step": ([(0, "s"), (0.4, "s"), (0.4, "u"), (1, "u")], 3),
    }
    for stations, bounds in rows.values():
        table = ", ".join(f'{{ at = {at}, section = "{name}" }}' for at, name in stations)
        file = tmp_path / "mechanism.toml"
        file.write_text(HEAD + sections + LINK.replace('section = "s"', f"section = [{table}]"), encoding="utf-8")
        mesh = build(load_mechanism(file))
        assert len(mesh.elements.order) == bounds - 1
        # the mass of a beam whose matrices are linear between the stations, at order 4 to rounding
        assert mesh.mass.sum() == pytest.approx(0.4, rel=1e-14)


def test_stiffer_elements_are_coupled_as_much(tmp_path: Path) -> None:
    elements = build(load(tmp_path, write(full(), MASS, "retardation_s = 1e-3"))).elements
    stiffer = scale_stiffness(elements, 3.0)
    for name, factor in (("stiffness", 3.0), ("coupling", 3.0), ("damping", 1.0), ("damping_coupling", 1.0)):
        np.testing.assert_array_equal(getattr(stiffer, name), factor * getattr(elements, name))
    assert np.abs(elements.coupling).max() > 0.0
