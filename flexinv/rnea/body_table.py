"""A rigid mechanism as bodies: everything between two joints that move is one body of ten inertial parameters.

The nodal forces of the paper, P = M (a - g) at every lumped mass, are linear in the second moments of the mass: with the
acceleration a + S r of a point r of the body, S = skew(al) + skew(w)^2,

    F = sum m_k (a + S r_k) = m a + S h              h = sum m_k r_k
    N = sum r_k x m_k (a + S r_k) = h x a + axial(S Sigma)    Sigma = sum m_k r_k r_k^T

so that the nodes of a rigid body collapse exactly, whatever their number.

The frame of a body has its joint's axis along z and, where it can, x at right angles to the axis of its last child, too: then
R_parent,child = Rx(tilt) Rz(zero + q), as Denavit's and Hartenberg's, takes half the operations of a general rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.kernels.simd import BLOCK, row
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import CONTINUOUS, FREE, HELICAL, PRISMATIC, REVOLUTE, SPHERICAL
from flexinv.rnea import recursion
from flexinv.typing import Array, Indices, Unsigned


def _list_following_rows(first: np.uint64, count: int) -> tuple[np.uint64, ...]:
    return tuple(first + row(k) for k in range(count))


# Columns of ``Bodies.numbers`` that belong together.
_R, _P, _MOMENTS, _SECOND, _TILT, _ZERO, _CHILD, _STEP = (
    slice(first, first + count)
    for first, count in (
        (recursion.BODY_R, 9), (recursion.BODY_P, 3), (recursion.BODY_MASS, 4), (recursion.BODY_SECOND, 6),
        (recursion.BODY_TILT, 2), (recursion.BODY_ZERO, 2), (recursion.BODY_CHILD, 3), (recursion.BODY_STEP, 3),
    )
)  # fmt: skip
ONE_AXIS = 8 * np.finfo(float).eps  # sine of the angle between two axes that are one: what rounding leaves of it
TURNING_KINDS = (REVOLUTE, CONTINUOUS)
_SCALAR = ((recursion.RATE,), (recursion.EFFORT,))
_QUATERNION = _list_following_rows(recursion.QUATERNION, 4)
# Offsets, in a body's rows, of the coordinates of its joint, of their rates and of their accelerations.
_ROWS: dict[int, tuple[tuple[np.uint64, ...], ...]] = {
    **dict.fromkeys((REVOLUTE, PRISMATIC, HELICAL), ((recursion.PLACE,), *_SCALAR)),
    CONTINUOUS: ((recursion.COS, recursion.SIN), *_SCALAR),
    SPHERICAL: (
        _QUATERNION,
        _list_following_rows(recursion.RATES_TURNING, 3),
        _list_following_rows(recursion.EFFORTS_TURNING, 3),
    ),
    FREE: (
        (*_list_following_rows(recursion.SHIFT, 3), *_QUATERNION),
        _list_following_rows(recursion.RATES_FREE, 6),
        _list_following_rows(recursion.EFFORTS_FREE, 6),
    ),
}


@dataclass(frozen=True, eq=False)
class Bodies:
    """Bodies as the recursion reads them; body 0 is the world, parents come first.

    tree : (bodies, 6) kind (nv for the world), parent, offset of its rows, of its state, how the state begins, from where
    numbers : (bodies, 38) R before the joint and p of the joint in the parent's frame [-], [m]; mass [kg], first moments [kg m],
        second moments xx, yy, zz, xy, xz, yz [kg m^2]; rotor inertia, damping, friction, stiffness, rest; cosine and sine of the
        tilt, of the zero; p of the last child, p less that of the parent's last child [m]; way of a screw [m/rad]; of the world
        gravity [m/s^2] first
    columns : (nq + 2 nv,) offsets of the rows that hold the columns of q, qd, qdd; those of qdd hold the efforts in the end
    size : of the work space [-]; node : (bodies,) node of the mesh, -1 the world; axes : (bodies, 3, 3) R_node,body
    """

    tree: Unsigned
    numbers: Array
    columns: Unsigned
    size: int
    node: Indices
    axes: Array


@dataclass(frozen=True, eq=False)
class _Tree:
    """The bodies as a tree.

    node : of the mesh, for each body, -1 the world; number : the other way round; above : node that the joint hangs on, of all
        bodies but the world; kinds : of joint, parents : bodies; last : body -> the child that goes on in its state
    """

    node: Indices
    number: dict[int, int]
    above: list[int]
    kinds: Indices
    parents: list[int]
    last: dict[int, int]

    @property
    def moving(self) -> Indices:
        return self.node[1:]

    def is_on(self, i: int) -> bool:
        """Return True if body i turns about an axis, is its parent's last child, and the parent's frame may be turned to it."""
        parent = self.parents[i]
        suits = self.kinds[i] in TURNING_KINDS and self.kinds[parent] in (*TURNING_KINDS, PRISMATIC, HELICAL)
        return bool(suits and parent > 0 and self.last.get(parent) == i)


def build_bodies(mesh: Mesh, passive: bool = True, kept: frozenset[int] = frozenset()) -> Bodies:
    """Return the bodies [kg, m] of a mesh, its beams undeformed; without ``passive`` no damping, friction or springs.

    kept : moving nodes whose state no child carries on, so that it is there in the end
    """
    carrier, turn, place = find_carrier_nodes(mesh)
    tree = _build_tree(mesh, carrier, kept)
    seats = [(turn[a], place[a]) if a >= 0 else (np.eye(3), np.zeros(3)) for a in tree.above]
    placed = [(r @ mesh.rotation[n], x + r @ mesh.offset[n]) for n, (r, x) in zip(tree.moving, seats, strict=True)]
    axes = [np.eye(3), *(_choose_body_axes(mesh, tree, placed, i) for i in range(1, len(tree.node)))]
    numbers = np.zeros((len(tree.node), int(recursion.NUMBERS)))
    numbers[0, :3] = mesh.mechanism.gravity
    _write_placements(numbers, tree, placed, axes)
    _add_masses(mesh, numbers, [tree.number[int(c)] for c in carrier], axes, turn, place)
    _write_joints(mesh, numbers, tree.moving, passive)
    table, size = _compute_layout(tree)
    return Bodies(table, numbers, _list_columns(mesh, table, tree.moving), size, tree.node, np.array(axes))


def _write_placement(row: Array, r: Array, p: Array, on: bool) -> None:
    """Write R_parent,body at the coordinate's zero, as R = Rx(tilt) Rz(zero) where the frames lie so, and p."""
    row[_P] = p
    tilt = (r[2, 2], -r[1, 2])
    zero = (r[0, 0], -r[0, 1])
    row[_R] = np.eye(3).ravel() if on else r.ravel()
    row[_TILT] = tilt / np.hypot(*tilt) if on else (1.0, 0.0)
    row[_ZERO] = zero / np.hypot(*zero) if on else (1.0, 0.0)


def find_carrier_nodes(mesh: Mesh) -> tuple[Indices, Array, Array]:
    """Return for each node the moving node (-1: the world) that it is fixed on, and R [-], x [m] in that node's frame."""
    carrier = np.full(mesh.size, -1, dtype=np.int64)
    turn = np.tile(np.eye(3), (mesh.size, 1, 1))
    place = np.zeros((mesh.size, 3))
    for n in range(mesh.size):
        parent = int(mesh.parent[n])
        if mesh.v_index[n] >= 0:
            carrier[n] = n
        elif parent < 0:
            turn[n] = mesh.rotation[n]
            place[n] = mesh.offset[n]
        else:
            carrier[n] = carrier[parent]
            turn[n], place[n] = turn[parent] @ mesh.rotation[n], place[parent] + turn[parent] @ mesh.offset[n]
    return carrier, turn, place


def _choose_axes(mesh: Mesh, node: int, other: Array | None) -> Array:
    """R_node,body with the joint's axis along z and x at right angles to another axis, where there is one.

    Otherwise an axis along x, y or z only renames the axes.  The product of two axes that are one to rounding is rounding, of
    any direction, that of the axis itself among them: it shows no right angle.
    """
    if mesh.kind[node] in (SPHERICAL, FREE):
        return np.eye(3)
    z = mesh.axis[node]
    x = np.zeros(3) if other is None else _cross(z, other)
    if np.linalg.norm(x) <= ONE_AXIS:
        x = np.eye(3)[(int(np.argmax(np.abs(z))) + 1) % 3]
    x = x / np.linalg.norm(x)
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, _cross(z, x), z], axis=1)


def _cross(a: Array, b: Array) -> Array:
    """Return a x b of two plain vectors: numpy's own takes ten times as long."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _add_masses(mesh: Mesh, numbers: Array, body: list[int], axes: list[Array], turn: Array, place: Array) -> None:
    """Collapse the lumped masses: m, h = sum m r and Sigma = sum m r r^T + R (tr(J)/2 - J) R^T in the body's frame."""
    for n, i in enumerate(body):
        if i == 0:
            continue
        x = axes[i].T @ place[n]
        r = axes[i].T @ turn[n]
        central = 0.5 * np.trace(mesh.inertia[n]) * np.eye(3) - mesh.inertia[n]
        second = mesh.mass[n] * np.outer(x, x) + r @ central @ r.T
        numbers[i, _MOMENTS] += mesh.mass[n] * np.array([1.0, *x])
        numbers[i, _SECOND] += second[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _build_tree(mesh: Mesh, carrier: Indices, kept: frozenset[int]) -> _Tree:
    """The tree of bodies; a node that a joint hangs on is fixed on that of the parent."""
    moving = np.flatnonzero(mesh.v_index >= 0)
    node = np.concatenate([[-1], moving]).astype(np.int64)
    number = {int(n): i for i, n in enumerate(node)}
    above = [int(mesh.parent[n]) for n in moving]
    parents = [0, *(number[int(carrier[a])] if a >= 0 else 0 for a in above)]
    kinds = np.array([mesh.mechanism.nv, *mesh.kind[moving]])
    last = {parent: child for child, parent in enumerate(parents) if child and int(node[parent]) not in kept}
    return _Tree(node, number, above, kinds, parents, last)


def _choose_body_axes(mesh: Mesh, tree: _Tree, placed: list[tuple[Array, Array]], i: int) -> Array:
    """R_node,body of a body, with x at right angles to the axis of the child that its frame is turned to."""
    child = tree.last.get(i, 0)
    other = None
    if child and tree.is_on(child):
        other = placed[child - 1][0] @ mesh.axis[tree.node[child]]
    return _choose_axes(mesh, int(tree.node[i]), other)


def _write_placements(numbers: Array, tree: _Tree, placed: list[tuple[Array, Array]], axes: list[Array]) -> None:
    """Write where each body stands in its parent, and its steps from the last child of that."""
    for i, (r, x) in enumerate(placed, start=1):
        to_parent = axes[tree.parents[i]].T
        _write_placement(numbers[i], to_parent @ r @ axes[i], to_parent @ x, tree.is_on(i))
    for parent, child in tree.last.items():
        numbers[parent, _CHILD] = numbers[child, _P] if parent else 0.0
    numbers[1:, _STEP] = numbers[1:, _P] - numbers[tree.parents[1:], _CHILD]


def _write_joints(mesh: Mesh, numbers: Array, moving: Indices, passive: bool) -> None:
    """Write the ways of screws, and of each joint rotor inertia, and where asked damping, friction, stiffness and rest."""
    leads = [mesh.slide[n, 0] @ mesh.axis[n] if mesh.kind[n] == HELICAL else 0.0 for n in moving]
    numbers[1:, recursion.BODY_LEAD] = leads
    count = 5 if passive else 1
    laws = mesh.mechanism.drive_table[:count, mesh.v_index[moving]].T
    numbers[1:, recursion.BODY_LAW : recursion.BODY_LAW + count] = laws


def _compute_layout(tree: _Tree) -> tuple[Unsigned, int]:
    """Offsets of the rows of each body, and of its state: the last child goes on in its parent's, others in a copy."""
    kinds = tree.kinds
    rows = [0, *(recursion.FREE_ROWS if k in (SPHERICAL, FREE) else recursion.SCALAR_ROWS for k in kinds[1:])]
    first = np.concatenate([[0], np.cumsum(rows)])
    table = np.zeros((len(kinds), int(recursion.TREE)), dtype=np.uint64)
    state = [0] * len(kinds)
    slots = 0
    for i, parent in enumerate(tree.parents):
        how = recursion.FROM_WORLD
        source = state[parent]
        if i and parent and tree.last.get(parent) == i:
            state[i] = source
            how = recursion.ON if tree.is_on(i) else recursion.TURNED
        elif i:
            how = recursion.COPIED if parent else recursion.FROM_WORLD
            state[i] = int(first[-1]) + recursion.STATE_ROWS * slots
            slots += 1
        table[i] = kinds[i], parent, BLOCK * first[i], BLOCK * state[i], how, BLOCK * source
    return table, BLOCK * (int(first[-1]) + recursion.STATE_ROWS * slots)


def _list_columns(mesh: Mesh, tree: Unsigned, moving: Indices) -> Unsigned:
    """Return the offsets of the rows that take the columns of q, qd and qdd: those of the bodies that they move."""
    m = mesh.mechanism
    columns = list[np.uint64]()
    for part in range(3):
        numbers = np.zeros(m.nv if part else m.nq, np.uint64)
        for n, (_, _, first, *_) in zip(moving, tree[1:], strict=True):
            at = (mesh.v_index if part else mesh.q_index)[n]
            rows = _ROWS[int(mesh.kind[n])][part]
            numbers[at : at + len(rows)] = [first + row for row in rows]
        columns.extend(numbers)
    return np.array(columns, dtype=np.uint64)
