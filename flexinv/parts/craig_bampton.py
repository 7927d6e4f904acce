"""Craig-Bampton reduction of a meshed part: few shapes by which it deforms, its root interface at rest.

Static shapes: one for each unit motion of an interface's frame beside the root, all other interfaces at rest,
vibration modes: those with all interfaces at rest,

    K_ff X = - K_fb,      K_ff phi = omega^2 M_ff phi

and of both, the modes of the part held at its root: so modal mass and stiffness are diagonal.  Nodes of a rigid interface (RBE2)
move as u = u_b + theta_b x r; the frame of an average one (RBE3) as they do on average, A u = (u_b, theta_b), by multipliers:
[K A^T; A 0].  Sources: Hurty 1965; Craig, Bampton, *Coupling of substructures for dynamic analyses*, AIAA Journal 6, 1968.

Displacements of second order, u = Phi y + y H y / 2, follow from `second_order`: a bar that bends comes nearer to its root.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.errors import InputError
from flexinv.model.part import MeshedPart, PartInterface
from flexinv.parts.node_order import list_elimination_order
from flexinv.parts.part_matrices import PartMatrices, build_part_matrices, build_rigid_motions
from flexinv.parts.second_order import compute_second_order_forces
from flexinv.typing import Array, Indices, Sparse

# Modes that are asked for at once where their number follows from a frequency.
FIRST_MODES = 16
# Shapes, from the softest on, of which displacements of second order are known: loads along a part bend it by these.
SOFTEST = 6
# Modes that are found beside those that are kept, to say what is left out.
BEYOND = 1
# Of the largest omega^2 about: a motion below it is one without force. The slowest of a fine slender bar has 1e-10 and more.
NO_FORCE = 1e-13


@dataclass(frozen=True, eq=False)
class Reduction:
    """A part by few shapes, the root interface at rest.

    points : (n, 3) [m]; used : (n,) numbers in the file; mass : (n, n) sparse [kg]
    shapes : (n, 3, shapes) [-], displacements by coordinates [m]: the largest displacement of a node is 1 m for each of them
    modal_mass : (shapes,) [kg]; modal_stiffness : (shapes,) [N/m]; held at the root it vibrates with the root of their ratio
    moves, turns : (interfaces moved, 3, shapes) displacement [-] and rotation [rad/m] of frames, as `MeshedPart.moved` has them
    fixed : (modes,) frequencies with all interfaces at rest [Hz]; left_out : the next one [Hz], inf where there is none
    second : (n, 3, soft, soft) second derivatives of displacements by the first amplitudes, the softest [1/m]; soft 0 without
    second_moves, second_turns : (interfaces moved, 3, soft, soft) of frames [1/m], [rad/m^2]
    """

    points: Array
    used: Indices
    mass: Sparse
    shapes: Array
    modal_mass: Array
    modal_stiffness: Array
    moves: Array
    turns: Array
    fixed: Array
    left_out: float
    second: Array
    second_moves: Array
    second_turns: Array

    @property
    def soft(self) -> int:
        """Shapes with displacements of second order, the softest [-]."""
        return int(self.second.shape[2])

    @property
    def frequency(self) -> Array:
        """(shapes,) frequencies held at the root, all other interfaces free [Hz]."""
        return np.sqrt(self.modal_stiffness / self.modal_mass) / (2.0 * np.pi)

    def compute_free_frequencies(self) -> Array:
        """Return the frequencies of the part held nowhere, (shapes,) [Hz]: of its shapes, rigid motions beside them."""
        rigid = build_rigid_motions(self.points, np.zeros(3)).reshape(len(self.points), 3, 6)
        both = np.concatenate([rigid, self.shapes], axis=2)
        pushed = np.asarray(self.mass @ both.reshape(len(both), -1)).reshape(both.shape)
        mass = np.tensordot(both, pushed, axes=([0, 1], [0, 1]))  # (column, column)
        stiffness = np.diag(np.concatenate([np.zeros(6), self.modal_stiffness]))
        squared = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[6:]
        return np.asarray(np.sqrt(squared) / (2.0 * np.pi))


class _Held(NamedTuple):
    """A part with its interfaces held: numbers of free rows, factor of [K A^T; A 0], matrices of the free rows, and the ties.

    rigid : displacements of rigid interfaces' nodes by their frames (3 n, 6 moved), average : A (6 average interfaces, free rows)
    """

    free: Indices
    factor: Any
    mass: Sparse
    rigid: Sparse
    average: Sparse
    columns: Indices

    def solve_second_order(self, stiffness: Sparse, static: Array, force: Array, turned: Array) -> tuple[Array, Array]:
        """Return displacements (3 n, pairs) under forces of second order [N], and motions of frames (6 moved, pairs) [m], [rad].

        static : (3 n, 6 moved) of `_find_static_shapes`
        turned : (3 n, pairs) what turns of rigid interfaces put to their nodes [m]
        """
        out = turned.copy()
        out[self.free] += self.factor.solve(-(force + stiffness @ turned)[self.free])
        left = static.T @ (stiffness @ out + force)
        frames = -np.linalg.solve(static.T @ (stiffness @ static), left)
        return out + static @ frames, frames


def compute_reduction(part: MeshedPart) -> Reduction:
    """Return the reduction of a part [kg], [N/m].

    Raises InputError for a mesh that cannot be, and for more modes than it has.
    """
    found = build_part_matrices(part)
    held = _build_held_part(part, found)
    static = _find_static_shapes(part, found, held)
    squared, vibration = _find_modes(part, held)
    _check_positive(part, found, squared)
    whole = np.zeros((len(static), vibration.shape[1]))
    whole[held.free] = vibration
    basis = np.hstack([static, whole])
    stiffness = basis.T @ (found.stiffness @ basis)
    mass = basis.T @ _apply_mass(found.mass, basis)
    root, vectors = scipy.linalg.eigh((stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0)
    _check_positive(part, found, root)
    shapes = (basis @ vectors).reshape(len(found.points), 3, -1)
    size = np.linalg.norm(shapes, axis=1).max(axis=0)
    vectors = vectors / size
    fixed = np.sqrt(squared) / (2.0 * np.pi)
    kept = vibration.shape[1]
    frames = vectors[: static.shape[1]].reshape(-1, 6, len(root))
    soft = min(SOFTEST, len(root)) if part.stiffening and part.cells else 0
    curved = _find_second_order(part, found, held, static, (shapes / size, frames, root / size**2), soft)
    return Reduction(
        found.points, found.used, found.mass, shapes / size, size**-2.0, root / size**2,
        frames[:, :3], frames[:, 3:], fixed[:kept], float(fixed[kept]) if len(fixed) > kept else np.inf, *curved,
    )  # fmt: skip


def _check_positive(part: MeshedPart, found: PartMatrices, squared: Array) -> None:
    """Raise InputError where a motion of the held part costs no energy, by its squared angular frequencies [1/s^2]."""
    largest = float((found.stiffness.diagonal() / np.repeat(found.mass.diagonal(), 3)).max())
    if squared.min(initial=largest) > NO_FORCE * largest:
        return
    given = f"{part.source or 'mesh'}: held at its interfaces the part moves without force, omega^2 = {squared.min():.4g} 1/s^2"
    expected = "a positive stiffness, and cells that hang together by faces: a node or an edge is a hinge"
    raise InputError(f"{given}; expected {expected}; write the mesh without hinges, and matrices of the part at rest")


def _find_second_order(
    part: MeshedPart, found: PartMatrices, held: _Held, static: Array, basis: tuple[Array, Array, Array], soft: int
) -> tuple[Array, Array, Array]:
    """Second derivatives of the displacements of nodes and of frames by the softest amplitudes, symmetric in both.

    What a pair has of shapes that are not stiffer than both is taken out.  So of three shapes the two softest move the stiffest
    one, and the energy 1/2 y K y has no terms of third order: bending shortens a bar, but stretch does not bend it again.

    basis : shapes (n, 3, shapes) [-], frames (interfaces moved, 6, shapes) and modal stiffness [N/m]
    """
    whole, frames, modal = basis
    shapes = whole[:, :, :soft]
    first, second = np.triu_indices(soft)
    count = len(found.points)
    if not soft:
        none = np.zeros((len(part.moved), 3, 0, 0))
        return np.zeros((count, 3, 0, 0)), none, none
    force = compute_second_order_forces(part, found, shapes)
    turned, shifted = _collect_swung_arms(part, found, frames[:, 3:, first], frames[:, 3:, second])
    places, swung = held.solve_second_order(found.stiffness, static, force, turned.reshape(3 * count, -1))
    flat = whole.reshape(3 * count, -1)
    along = (flat.T @ (found.stiffness @ places)) / modal[:, None]
    along[np.arange(len(modal))[:, None] > np.maximum(first, second)] = 0.0
    places -= flat @ along
    moves = swung.reshape(len(part.moved), 6, -1) + shifted - frames @ along
    symmetric = np.zeros((soft, soft), dtype=np.int64)
    symmetric[first, second] = symmetric[second, first] = np.arange(len(first))
    return places.reshape(count, 3, -1)[:, :, symmetric], moves[:, :3][:, :, symmetric], moves[:, 3:][:, :, symmetric]


def _collect_swung_arms(part: MeshedPart, found: PartMatrices, a: Array, b: Array) -> tuple[Array, Array]:
    """Displacements of second order by turns of interfaces a, b (interfaces moved, 3, pairs) [rad/m].

    Of the nodes of rigid ones (n, 3, pairs); of an average one its frame (interfaces moved, 6, pairs) does not follow them.
    """
    turned = np.zeros((len(found.points), 3, a.shape[2]))
    shifted = np.zeros((len(part.moved), 6, a.shape[2]))
    for number, one in enumerate(part.moved):
        nodes = _find_local_nodes(found, one)
        arms = _compute_swung_arms(found.points[nodes] - one.origin, a[number], b[number])
        if one.tie == "average":
            motion = build_rigid_motions(found.points[nodes], one.origin)
            shifted[number] = -_compute_average(motion) @ arms.reshape(-1, a.shape[2])
        else:
            turned[nodes] = arms
    return turned, shifted


def _compute_swung_arms(arm: Array, first: Array, second: Array) -> Array:
    """(a x (b x r) + b x (a x r)) / 2 of arms (n, 3) [m] for pairs of turns (3, pairs), (n, 3, pairs)."""
    a = first.T[None]
    b = second.T[None]
    r = arm[:, None]
    both = np.cross(a, np.cross(b, r)) + np.cross(b, np.cross(a, r))  # (node, pair, xyz)
    return 0.5 * both.transpose(0, 2, 1)


def _apply_mass(mass: Sparse, columns: Array) -> Array:
    """M u of displacements (3 n, columns): the mass of each component by itself."""
    count = columns.shape[1]
    return np.asarray(mass @ columns.reshape(mass.shape[0], -1)).reshape(-1, count)


def _find_local_nodes(found: PartMatrices, one: PartInterface) -> Indices:
    """Numbers of an interface's nodes among those that are used."""
    return np.searchsorted(found.used, one.nodes)


def _list_rows(nodes: Indices) -> Indices:
    """The three rows of each node."""
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def _build_held_part(part: MeshedPart, found: PartMatrices) -> _Held:
    """The part with all interfaces at rest, factored."""
    count = 3 * len(found.points)
    moved = part.moved
    rigid = scipy.sparse.lil_array((count, 6 * len(moved)))
    held = np.zeros(count, dtype=bool)
    averages = []
    columns = []
    for one in part.interfaces:
        rows = _list_rows(_find_local_nodes(found, one))
        motion = build_rigid_motions(found.points[_find_local_nodes(found, one)], one.origin)
        number = next((k for k, other in enumerate(moved) if other is one), -1)
        if one.tie == "average":
            averages.append((rows, _compute_average(motion)))
            columns += [6 * number + k if number >= 0 else -1 for k in range(6)]
            continue
        held[rows] = True
        if number >= 0:
            rigid[rows, 6 * number : 6 * number + 6] = motion
    free = np.flatnonzero(~held)
    place = np.full(count, -1)
    place[free] = np.arange(len(free))
    average = scipy.sparse.lil_array((6 * len(averages), len(free)))
    for k, (rows, matrix) in enumerate(averages):
        average[6 * k : 6 * k + 6, place[rows]] = matrix
    mass = scipy.sparse.kron(found.mass, scipy.sparse.eye_array(3)).tocsr()[free][:, free]
    inside = list_elimination_order(found.points, _build_graph(found))
    order = place[_list_rows(inside)]
    factor = _Factor(found.stiffness[free][:, free], average.tocsr(), order[order >= 0])
    return _Held(free, factor, mass, rigid.tocsr(), average.tocsr(), np.array(columns, dtype=np.int64))


def _build_graph(found: PartMatrices) -> Sparse:
    """Nodes that touch, (n, n): those that stiffness couples."""
    links = found.stiffness.tocoo()
    count = len(found.points)
    touching = np.ones(len(links.row)), (links.row // 3, links.col // 3)
    return scipy.sparse.coo_array(touching, shape=(count, count)).tocsr()


def _compute_average(motion: Array) -> Array:
    """A (6, 3 nodes) [-], [1/m]: the rigid motion that fits displacements best, A = (R^T R)^-1 R^T."""
    return np.asarray(np.linalg.solve(motion.T @ motion, motion.T))


class _Factor:
    """Solutions of K u + A^T lambda = f, A u = g."""

    def __init__(self, stiffness: Sparse, average: Sparse, order: Indices) -> None:
        self.size = stiffness.shape[0]
        self.ties = average.shape[0]
        # Multipliers are scaled to the stiffness, so that pivots of both compare.
        self.scale = float(stiffness.diagonal().mean()) if self.ties else 1.0
        whole = stiffness
        if self.ties:
            across = self.scale * average
            whole = scipy.sparse.block_array([[stiffness, across.T], [across, None]])
        self.order = np.concatenate([order, np.arange(self.size, self.size + self.ties)])
        whole = scipy.sparse.csc_array(whole)[self.order][:, self.order]
        how: dict[str, Any] = {"permc_spec": "NATURAL", "diag_pivot_thresh": 0.1 if self.ties else 0.0}
        self.factor = scipy.sparse.linalg.splu(scipy.sparse.csc_array(whole), options={"SymmetricMode": True}, **how)

    def solve(self, force: Array, motion: Array | None = None) -> Array:
        """Return u (size, columns) [m] for f (size, columns) [N] and g (ties, columns) [m], [rad], zero by default."""
        sides = np.zeros((self.size + self.ties, force.shape[1]))
        sides[: self.size] = force
        if motion is not None:
            sides[self.size :] = self.scale * motion
        out = np.empty_like(sides)
        out[self.order] = self.factor.solve(sides[self.order])
        return out[: self.size]


def _find_static_shapes(part: MeshedPart, found: PartMatrices, held: _Held) -> Array:
    """Displacements (3 n, 6 moved) for unit motions of the interfaces' frames."""
    static = np.asarray(held.rigid.toarray())
    force = -(found.stiffness @ held.rigid).tocsr()[held.free].toarray()
    motion = np.zeros((held.average.shape[0], static.shape[1]))
    for row, column in enumerate(held.columns.tolist()):
        if column >= 0:
            motion[row, column] = 1.0
    static[held.free] = held.factor.solve(force, motion)
    return static


def _find_modes(part: MeshedPart, held: _Held) -> tuple[Array, Array]:
    """Squares of angular frequencies with all interfaces at rest, one more than is kept, and shapes (free rows, modes)."""
    most = len(held.free) - held.average.shape[0] - 2
    wanted = FIRST_MODES if part.frequency > 0.0 else part.modes
    while True:
        asked = wanted + BEYOND
        if asked > most:
            said = f"{part.source or 'mesh'}: modes = {wanted}"
            if most < BEYOND:
                given = f"{part.source or 'mesh'}: interfaces hold all nodes but {len(held.free) // 3}"
                raise InputError(f"{given}; expected nodes between them that move; write smaller sets or tolerances")
            raise InputError(
                f"{said}: expected at most {most - BEYOND}, the mesh has no more; write modes = {min(8, most - BEYOND)}"
            )
        squared, shapes = _solve_slowest(held, asked)
        if part.frequency == 0.0:
            return squared, shapes[:, :wanted]
        below = int((squared < (2.0 * np.pi * part.frequency) ** 2).sum())
        if below < asked:
            return squared[: below + 1], shapes[:, :below]
        wanted *= 2


def _solve_slowest(held: _Held, count: int) -> tuple[Array, Array]:
    """The slowest modes of the free rows by Lanczos on K^-1 M."""
    size = len(held.free)
    inverse = scipy.sparse.linalg.LinearOperator(
        (size, size), matvec=lambda side: held.factor.solve(np.reshape(side, (-1, 1)))[:, 0], dtype=float
    )
    begin = held.factor.solve(np.ones((size, 1)))[:, 0]
    begin += 0.1 * begin[::-1]  # no symmetry of the part may hide a mode
    squared, shapes = scipy.sparse.linalg.eigsh(
        held.mass, k=count, M=held.mass, sigma=0.0, OPinv=inverse, v0=begin, which="LM"
    )
    order = np.argsort(squared)
    return squared[order], shapes[:, order]
