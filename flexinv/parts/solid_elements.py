"""Solid elements: stiffness and mass of linear elastic cells, isoparametric, from scikit-fem's shape functions and rules.

    K_e = sum_g w det J B^T C B,      m_e = sum_g w det J rho N^T N          at the points g of a rule, B the strains of N

Every component of a displacement has the same mass matrix, M = m x 1: a turn of the axes leaves it, which the nodal forces
P = M (a - g) of a body that turns far rest on.  Source: Zwoelfer, Gerstmayr, *The nodal-based floating frame of reference
formulation with modal reduction*, Acta Mech. 232, 2021.

Rules: K and m exactly where edges are straight: 1 and 4 points (4 nodes), 4 and 11 (10), 8 and 27 (8), 27 and 27 (20 and 27
nodes), 6 and 6 (wedge).  Abaqus and CalculiX integrate K of 8 nodes with volume changes averaged and lump the mass of linear
elements (`MeshedPart.lumped`): these differ on purpose.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.errors import InputError
from flexinv.model.part import LINEAR_KINDS, Cells, MeshedPart
from flexinv.typing import Array, Indices, Sparse

# Corners of a brick, and midpoints of its edges, faces and volume as VTK orders them, on 0..1.
_BRICK = "000 100 110 010 001 101 111 011"
_BRICK_EDGES = "h00 1h0 h10 0h0 h01 1h1 h11 0h1 00h 10h 11h 01h"
_BRICK_MIDDLES = "0hh 1hh h0h h1h hh0 hh1 hhh"
# Nodes of each kind on its reference cell: digits are coordinates, h one half.
NODE_PLACES = {
    "tetra": "000 100 010 001",
    "tetra10": "000 100 010 001 h00 hh0 0h0 00h h0h 0hh",
    "hexahedron": _BRICK,
    "hexahedron20": f"{_BRICK} {_BRICK_EDGES}",
    "hexahedron27": f"{_BRICK} {_BRICK_EDGES} {_BRICK_MIDDLES}",
    "wedge": "000 100 010 001 101 011",
}
# scikit-fem's element, its reference cell, and the orders of the rules for stiffness and mass.
RULES = {
    "tetra": ("ElementTetP1", "RefTet", 1, 4),
    "tetra10": ("ElementTetP2", "RefTet", 2, 4),
    "hexahedron": ("ElementHex1", "RefHex", 3, 4),
    "hexahedron20": ("ElementHexS2", "RefHex", 4, 4),
    "hexahedron27": ("ElementHex2", "RefHex", 4, 4),
    "wedge": ("ElementWedge1", "RefWedge", 2, 2),
}
# Cells whose matrices are held at once: some 60 MB at 27 nodes.
CELLS_AT_ONCE = 1000
# A cell whose volume is below this part of the cube of its extent is flat.
FLAT_CELL = 1e-9


class CellRule(NamedTuple):
    """Shape functions at the points of a rule: shape (points, nodes) [-], slope (points, nodes, 3) [-], weight (points,) [-]."""

    shape: Array
    slope: Array
    weight: Array


def _list_places(kind: str) -> Array:
    """Places of a kind's nodes on its reference cell (nodes, 3)."""
    return np.array([[0.5 if digit == "h" else float(digit) for digit in word] for word in NODE_PLACES[kind].split()])


def _evaluate_shapes(kind: str, at: Array) -> tuple[Array, Array]:
    """Shape functions (points, nodes) and slopes (points, nodes, 3) at places (3, points), the nodes in VTK's order."""
    import skfem

    element = getattr(skfem, RULES[kind][0])()
    apart = np.abs(_list_places(kind)[:, None] - np.asarray(element.doflocs)[None]).sum(axis=2)
    values = [element.lbasis(at, int(k)) for k in apart.argmin(axis=1)]  # of each node among scikit-fem's
    shape = np.array([value for value, _ in values]).T
    slope = np.array([np.broadcast_to(gradient, (3, at.shape[1])) for _, gradient in values])
    return shape, slope.transpose(2, 0, 1)


@lru_cache
def build_node_slopes(kind: str) -> Array:
    """Return slopes of the shape functions at the nodes of a kind of cell, (places, nodes, 3) [-]."""
    return _evaluate_shapes(kind, _list_places(kind).T)[1]


@lru_cache
def build_rules(kind: str) -> tuple[CellRule, CellRule]:
    """Return the rules for stiffness and for mass of a kind of cell, its nodes in VTK's order [-]."""
    _, cell_name, *orders = RULES[kind]
    rules = []
    for order in orders:
        at, weight = _build_points(cell_name, order)
        rules.append(CellRule(*_evaluate_shapes(kind, at), weight))
    return rules[0], rules[1]


def _build_points(cell_name: str, order: int) -> tuple[Array, Array]:
    """Points (3, points) and weights of a rule on a reference cell.

    That of a wedge is the product of a triangle's and a line's: scikit-fem 12 has one of half the volume.
    """
    import skfem.refdom as cells
    from skfem.quadrature import get_quadrature

    if cell_name != "RefWedge":
        return get_quadrature(getattr(cells, cell_name), order)  # type: ignore[no-any-return]
    flat, area = get_quadrature(cells.RefTri, order)
    along, length = get_quadrature(cells.RefLine, order)
    places = np.vstack([np.repeat(flat, len(length), axis=1), np.tile(along, len(area))])
    return places, np.outer(area, length).ravel()


class CellMatrices(NamedTuple):
    """Mass m (n, n) [kg] of every component of the displacements of n points, and stiffness (3 n, 3 n) [N/m], sparse."""

    mass: Sparse
    stiffness: Sparse


def assemble_cells(part: MeshedPart) -> CellMatrices:
    """Return mass [kg] and stiffness [N/m] of a part's cells by all of its points.

    Raises InputError for inverted or flat cells.
    """
    count = len(part.points)
    mass = scipy.sparse.csr_array((count, count))
    stiffness = scipy.sparse.csr_array((3 * count, 3 * count))
    for cells in part.cells:
        for first in range(0, len(cells.nodes), CELLS_AT_ONCE):
            nodes = cells.nodes[first : first + CELLS_AT_ONCE]
            k, m = _compute_cell_matrices(part, cells, nodes, first)
            stiffness = stiffness + _add_blocks(
                (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1), k, 3 * count
            )
            mass = mass + _add_blocks(nodes, m, count)
    return CellMatrices(scipy.sparse.csr_array(mass), scipy.sparse.csr_array(stiffness))


def _add_blocks(places: Indices, values: Array, size: int) -> Sparse:
    """The sum of dense blocks (cells, n, n) at their places (cells, n)."""
    rows = np.repeat(places, places.shape[1], axis=1).ravel()
    columns = np.tile(places, (1, places.shape[1])).ravel()
    return scipy.sparse.coo_array((values.ravel(), (rows, columns)), shape=(size, size)).tocsr()


def _compute_cell_matrices(part: MeshedPart, cells: Cells, nodes: Indices, first: int) -> tuple[Array, Array]:
    """Stiffness (cells, 3 n, 3 n) [N/m] and mass (cells, n, n) [kg] of some cells, of which the first has a number."""
    for_stiffness, for_mass = build_rules(cells.kind)
    at = part.points[nodes]
    count = nodes.shape[1]
    stiffness = np.zeros((len(nodes), 3 * count, 3 * count))
    for slope, weight in zip(for_stiffness.slope, for_stiffness.weight, strict=True):
        jacobian = _compute_jacobians(part, cells, at, slope, first)
        gradient = np.linalg.solve(jacobian, np.broadcast_to(slope.T, (len(nodes), 3, count)))  # (cell, xyz, node)
        strain = compute_strain_matrices(gradient)
        scaled = weight * np.linalg.det(jacobian)[:, None, None] * cells.material.stiffness
        stiffness += strain.transpose(0, 2, 1) @ (scaled @ strain)
    mass = np.zeros((len(nodes), count, count))
    for shape, slope, weight in zip(*for_mass, strict=True):
        volume = weight * np.linalg.det(_compute_jacobians(part, cells, at, slope, first))
        mass += (cells.material.density * volume)[:, None, None] * np.outer(shape, shape)
    if part.lumped and cells.kind in LINEAR_KINDS:
        mass = np.einsum("cij,jk->cjk", mass, np.eye(count))  # (cell, node, node), sums of columns
    return stiffness, mass


def _compute_jacobians(part: MeshedPart, cells: Cells, at: Array, slope: Array, first: int) -> Array:
    """dx/dxi transposed, (cells, 3, 3) [m] at one point.  Raises InputError where the volume is not positive."""
    jacobian = slope.T @ at  # (cell, xi, xyz)
    volume = np.linalg.det(jacobian)
    extent = np.ptp(at, axis=1).max(axis=1)
    if (bad := volume <= FLAT_CELL * extent**3).any():
        worst = int(np.argmax(bad))
        what = "inverted" if volume[worst] < -FLAT_CELL * extent[worst] ** 3 else "flat"
        name = f"of {cells.name!r} " if cells.name else ""
        said = f"{part.source or 'mesh'}: {cells.kind} {first + worst + 1} {name}is {what}, its nodes are"
        raise InputError(
            f"{said} {(cells.nodes[first + worst] + 1).tolist()} (counted from 1); expected a volume above zero at every "
            "point of integration; write the nodes in VTK's order, or mesh the part anew"
        )
    return jacobian


def compute_strain_matrices(gradient: Array) -> Array:
    """Return B (cells, 6, 3 n) [1/m]: strains xx, yy, zz, yz, xz, xy by displacements, from slopes (cells, 3, n) [1/m]."""
    cells, _, count = gradient.shape
    out = np.zeros((cells, 6, count, 3))
    for row, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))):
        out[:, row, :, i] = gradient[:, j]
        out[:, row, :, j] = gradient[:, i]
    return out.reshape(cells, 6, 3 * count)
