"""Solid elements: patches, mass, turned materials, and cells that cannot be."""

from __future__ import annotations

import numpy as np
import pytest
from part_examples import ALUMINIUM, make_block, make_part

from flexinv.errors import InputError
from flexinv.model.part import CELL_KINDS, Cells, Material, MeshedPart
from flexinv.parts.craig_bampton import Reduction
from flexinv.parts.part_matrices import build_part_matrices, build_rigid_motions
from flexinv.parts.part_stress import compute_stress_shapes, compute_von_mises
from flexinv.parts.solid_elements import assemble_cells
from flexinv.typing import Array

SIZE = (0.3, 0.2, 0.1)
COUNT = (2, 2, 2)


def make_distorted(kind: str, material: Material = ALUMINIUM) -> MeshedPart:
    """A block whose inner nodes are moved, but for tetrahedra with curved edges, which its rule does not integrate exactly."""
    points, cells = make_block(kind, SIZE, COUNT)
    if kind != "tetra10":
        points = points + 0.01 * find_inside(points)[:, None] * np.random.default_rng(1).uniform(-1, 1, points.shape)
    return make_part(points, cells, kind, material)


def find_inside(points: Array) -> Array:
    """Which points are on none of a block's faces."""
    return ((points > points.min(axis=0) + 1e-9) & (points < points.max(axis=0) - 1e-9)).all(axis=1)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_constant_strain_has_the_energy_of_the_volume(kind: str) -> None:
    """The patch test: a displacement linear in the places stores  volume strain . stress / 2, and pulls at the surface alone."""
    part = make_distorted(kind)
    mass, stiffness = assemble_cells(part)
    volume = mass.sum() / ALUMINIUM.density
    slope = np.array([[1e-3, 2e-4, 0], [-3e-4, 5e-4, 1e-4], [4e-4, 0, -6e-4]])
    moved = (part.points @ slope.T).ravel()
    both = slope + slope.T
    strain = np.array([*np.diag(slope), both[1, 2], both[0, 2], both[0, 1]])
    energy = 0.5 * volume * strain @ ALUMINIUM.stiffness @ strain
    assert 0.5 * moved @ stiffness @ moved == pytest.approx(energy, rel=1e-12)  # rounding of some thousand products
    force = (stiffness @ moved).reshape(-1, 3)
    inside = find_inside(part.points)
    assert inside.any()
    assert np.abs(force[inside]).max() < 1e-10 * np.abs(force).max()


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_mass_is_that_of_a_block(kind: str) -> None:
    """Whatever the cells, mass and second moments are those of the block: shape functions hold products of coordinates."""
    points, cells = make_block(kind, SIZE, COUNT)
    mass, stiffness = assemble_cells(make_part(points, cells, kind))
    whole = ALUMINIUM.density * np.prod(SIZE)
    assert mass.sum() == pytest.approx(whole, rel=1e-13)
    moments = points.T @ (mass @ points)
    exact = whole * np.diag([SIZE[0] ** 2 / 3, SIZE[1] ** 2 / 12, SIZE[2] ** 2 / 12])
    assert np.abs(moments - exact).max() < 1e-12 * exact.max()
    rigid = build_rigid_motions(points, np.zeros(3))
    assert np.abs(stiffness @ rigid).max() < 1e-13 * abs(stiffness).max()


def test_lumped_masses_are_those_of_linear_cells_alone() -> None:
    points, cells = make_block("tetra", SIZE, COUNT)
    lumped = assemble_cells(make_part(points, cells, "tetra", lumped=True)).mass
    whole = assemble_cells(make_part(points, cells, "tetra")).mass
    assert np.abs(lumped.toarray() - np.diag(np.asarray(whole.sum(axis=1)).ravel())).max() < 1e-15
    points, cells = make_block("tetra10", SIZE, (1, 1, 1))
    quadratic = [assemble_cells(make_part(points, cells, "tetra10", lumped=one)).mass for one in (True, False)]
    assert abs(quadratic[0] - quadratic[1]).max() == 0.0


def make_orthotropic(turn: Array) -> Material:
    return Material.build_orthotropic(
        np.array([120e9, 9e9, 8e9]), np.array([0.3, 0.28, 0.4]), np.array([5e9, 4.5e9, 3e9]), 1600.0, turn
    )


def test_an_orthotropic_material_turns_with_its_axes() -> None:
    """A strain and its axes turned together have the same energy; an isotropic material has it however it is turned."""
    c, s = np.cos(0.6), np.sin(0.6)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    strain = np.array([[1.0, 0.2, -0.3], [0.2, 0.5, 0.1], [-0.3, 0.1, -0.4]])
    turned = turn @ strain @ turn.T

    def find_energy(material: Material, e: Array) -> float:
        six = np.array([*np.diag(e), 2 * e[1, 2], 2 * e[0, 2], 2 * e[0, 1]])
        return float(six @ material.stiffness @ six)

    plain, other = make_orthotropic(np.eye(3)), make_orthotropic(turn)
    assert find_energy(other, turned) == pytest.approx(find_energy(plain, strain), rel=1e-13)
    assert find_energy(other, strain) != pytest.approx(find_energy(plain, strain), rel=1e-2)
    assert find_energy(ALUMINIUM, turned) == pytest.approx(find_energy(ALUMINIUM, strain), rel=1e-13)
    alone = np.linalg.inv(plain.stiffness)  # compliance by hand: e_2 = - nu_12 / E_1 under stress along 1
    assert alone[0, 0] == pytest.approx(1 / 120e9, rel=1e-12)
    assert alone[1, 0] == pytest.approx(-0.3 / 120e9, rel=1e-12)
    assert alone[5, 5] == pytest.approx(1 / 5e9, rel=1e-12)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_inverted_cells_are_refused(kind: str) -> None:
    points, cells = make_block(kind, SIZE, (1, 1, 1))
    with pytest.raises(InputError, match=rf"{kind} 1 is inverted.*counted from 1.*VTK's order"):
        assemble_cells(make_part(points * [1, -1, 1], cells, kind))


def test_flat_cells_are_refused() -> None:
    points, cells = make_block("hexahedron", SIZE, (3, 1, 1))
    flat = points.copy()
    flat[np.abs(points[:, 0] - 0.2) < 1e-9, 0] = 0.1
    with pytest.raises(InputError, match="hexahedron 2 is flat"):
        assemble_cells(make_part(flat, cells, "hexahedron"))


def test_pieces_that_hang_apart_are_refused() -> None:
    points, cells = make_block("hexahedron", SIZE, (2, 1, 1))
    beside, others = make_block("hexahedron", (0.1, 0.1, 0.1), (1, 1, 1))
    whole = np.vstack([points, beside + np.array([0.0, 0.5, 0.0])])
    part = make_part(points, cells, "hexahedron")
    apart = (*part.cells, Cells("hexahedron", others + len(points), ALUMINIUM))
    with pytest.raises(InputError, match=f"2 pieces that hang apart, the smallest of 8 nodes, node {len(points) + 1}"):
        build_part_matrices(MeshedPart(whole, apart, part.interfaces, "hub", "tip"))


def test_nodes_that_no_cell_uses_are_left_out() -> None:
    part = make_distorted("hexahedron")
    more = MeshedPart(np.vstack([part.points, [[9.0, 9.0, 9.0]]]), part.cells, part.interfaces, "hub", "tip")
    assert len(build_part_matrices(more).points) == len(part.points)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_stress_of_a_constant_strain(kind: str) -> None:
    """Every node has the stress of the law; von Mises of pure shear is the root of three times it, of pressure nothing."""
    part = make_distorted(kind)
    slope = np.array([[1e-3, 2e-4, 0], [-3e-4, 5e-4, 1e-4], [4e-4, 0, -6e-4]])
    found = build_part_matrices(part)
    none = np.zeros((len(found.points), 3, 0, 0))
    shape = (found.points @ slope.T)[:, :, None]
    reduced = Reduction(
        found.points, found.used, found.mass, shape, *2 * [np.ones(1)], *2 * [np.zeros((1, 3, 1))], np.zeros(0), np.inf,
        none, *2 * [np.zeros((1, 3, 0, 0))],
    )  # fmt: skip
    both = slope + slope.T
    strain = np.array([*np.diag(slope), both[1, 2], both[0, 2], both[0, 1]])
    exact = ALUMINIUM.stiffness @ strain
    stress = compute_stress_shapes(part, reduced)[:, :, 0]
    assert np.abs(stress - exact).max() < 1e-10 * np.abs(exact).max()
    assert compute_von_mises(np.array([0, 0, 0, 0, 0, 2.0])[:, None])[0] == pytest.approx(2 * np.sqrt(3))
    assert compute_von_mises(np.array([5.0, 5.0, 5.0, 0, 0, 0])[:, None])[0] == pytest.approx(0.0, abs=1e-12)
