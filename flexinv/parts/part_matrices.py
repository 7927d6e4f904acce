"""Mass and stiffness of a meshed part by the nodes that it uses, from its cells or from another program, and whether they can be.

A free body has K r = 0 for its six rigid motions r and no others, and a mass M = m x 1 that is the same in every direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.errors import InputError
from flexinv.model.part import MeshedPart, SparseMatrix
from flexinv.parts.solid_elements import assemble_cells
from flexinv.typing import Array, Indices, Sparse

# Of the largest entry: files carry some seven digits, sums of products of the rest.
UNEVEN = 1e-6
# Of a stiffness with a unit diagonal: what a rigid motion may feel, with the seven digits that files carry.
RIGID_FORCE = 1e-5
# Of the largest mass: below it a node has none.
NO_MASS = 1e-12


class PartMatrices(NamedTuple):
    """A part's matrices by its used nodes.

    points : (n, 3) [m]; used : (n,) their numbers among the points of the file
    mass : (n, n) [kg], of every component; stiffness : (3 n, 3 n) [N/m]
    """

    points: Array
    used: Indices
    mass: Sparse
    stiffness: Sparse


def build_part_matrices(part: MeshedPart) -> PartMatrices:
    """Return mass [kg] and stiffness [N/m] of a part.  Raises InputError for what no part has."""
    where = part.source or "mesh"
    if part.mass is not None and part.stiffness is not None:
        mass = _split_mass(part.mass, where)
        stiffness = _convert_to_sparse(part.stiffness)
    else:
        mass, stiffness = assemble_cells(part)
    used = np.flatnonzero(np.abs(mass).sum(axis=1) > NO_MASS * mass.max())
    lost = [one.name for one in part.interfaces if not np.isin(one.nodes, used).all()]
    if lost:
        expected = "nodes of cells with mass: others hold nothing; write a set of nodes of the solid"
        raise InputError(f"{where}: interface {lost[0]!r} has nodes that no cell uses; expected {expected}")
    threefold = (3 * used[:, None] + np.arange(3)).ravel()
    found = PartMatrices(part.points[used], used, mass[used][:, used], stiffness[threefold][:, threefold])
    _check_matrices(found, where)
    return found


def _convert_to_sparse(matrix: SparseMatrix) -> Sparse:
    entries = matrix.value, (matrix.row, matrix.column)
    return scipy.sparse.coo_array(entries, shape=(matrix.size, matrix.size)).tocsr()


def _split_mass(matrix: SparseMatrix, where: str) -> Sparse:
    """The mass of one component of displacements, of a matrix that has the same for all three."""
    whole = _convert_to_sparse(matrix)
    parts = [whole[i::3][:, j::3] for i in range(3) for j in range(3)]
    largest = abs(whole).max()
    apart = max(abs(parts[k] - parts[0]).max() for k in (4, 8))
    across = max(abs(parts[k]).max() for k in (1, 2, 3, 5, 6, 7))
    if max(apart, across) > UNEVEN * largest:
        expected = "the mass of displacements of solid elements, alike in x, y and z [kg]"
        advice = "matrices without rotations of shells or beams, and without masses scaled by direction"
        raise InputError(f"{where}: mass differs between directions; expected {expected}; write {advice}")
    return parts[0]


def _check_matrices(found: PartMatrices, where: str) -> None:
    """Raise InputError where matrices are not symmetric or not positive, hang apart, or resist a rigid motion."""
    for name, matrix, unit in (("mass", found.mass, "kg"), ("stiffness", found.stiffness, "N/m")):
        if abs(matrix - matrix.T).max() > UNEVEN * abs(matrix).max():
            advice = "the whole matrix, or its half as Matrix Market's `symmetric`"
            raise InputError(f"{where}: {name} is not symmetric; expected a symmetric matrix [{unit}]; write {advice}")
        if matrix.diagonal().min() <= 0.0:
            least = int(matrix.diagonal().argmin())
            given = f"{where}: {name} has {matrix.diagonal()[least]:.4g} on its diagonal, row {least + 1} of used nodes"
            raise InputError(
                f"{given}; expected a number above zero [{unit}]; write the {name} of the unconstrained part"
            )
    _check_connected(found, where)
    rigid = build_rigid_motions(found.points, found.points.mean(axis=0))
    size = np.sqrt(found.stiffness.diagonal())
    extent = float(np.ptp(found.points, axis=0).max())
    rigid[:, 3:] /= extent
    felt = np.abs(found.stiffness @ rigid) / size[:, None] / size.max()
    if felt.max() > RIGID_FORCE:
        which = "translations" if felt[:, :3].max() > RIGID_FORCE else "rotations"
        expected = (
            "six rigid motions without force: the part must be free, not clamped, and the points those of the matrix"
        )
        advice = "the stiffness without boundary conditions, and its nodes in the order of the rows"
        raise InputError(f"{where}: stiffness resists {which} of the whole part; expected {expected}; write {advice}")


def _check_connected(found: PartMatrices, where: str) -> None:
    """Raise InputError where cells do not hang together."""
    pieces, number = scipy.sparse.csgraph.connected_components(found.mass + found.mass.T, directed=False)
    if pieces > 1 and found.mass.nnz == len(found.points):  # lumped masses couple nothing
        links = found.stiffness.tocoo()
        count = len(found.points)
        pairs = scipy.sparse.coo_array(
            (np.ones(len(links.row)), (links.row // 3, links.col // 3)), shape=(count, count)
        )
        pieces, number = scipy.sparse.csgraph.connected_components(pairs, directed=False)
    if pieces > 1:
        sizes = np.bincount(number)
        small = int(sizes.argmin())
        first = int(found.used[np.flatnonzero(number == small)[0]]) + 1
        given = (
            f"{where}: {pieces} pieces that hang apart, the smallest of {sizes[small]} nodes, node {first} among them"
        )
        advice = "one mesh whose pieces share nodes (merge coincident nodes), or one file for each link"
        raise InputError(f"{given}; expected one connected part; write {advice}")


def build_rigid_motions(points: Array, origin: Array) -> Array:
    """Return the displacements (3 n, 6) of points [m], [-] for unit translations and turns about an origin (3,) [m]."""
    out = np.zeros((len(points), 3, 6))
    out[:, :, :3] = np.eye(3)
    arm = points - origin
    for k, axis in enumerate(np.eye(3)):
        out[:, :, 3 + k] = np.cross(axis, arm)
    return out.reshape(-1, 6)
