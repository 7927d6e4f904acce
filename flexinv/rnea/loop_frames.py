"""Closed loops: their bodies as kernels read them (`loop_bodies`, `loop_plane`), and the tables while they are made."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.simd import BLOCK
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import CONTINUOUS, FREE, HELICAL, PRISMATIC, REVOLUTE, SPHERICAL
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.body_table import TURNING as TURNS
from flexinv.rnea.body_table import Bodies, carriers
from flexinv.rnea.loop_layout import BodyRecord, ClosureRecord, ColumnRecord, SumRecord
from flexinv.typing import Array


@dataclass(frozen=True, eq=False)
class Frame:
    """Offsets of a body's axes, place and direction; turned : R of its own axes as the recursion has them [-]."""

    axes: int
    place: int
    direction: int
    turned: Array


@dataclass
class Tables:
    """The tables while they are made.

    size : of the work space so far [-]; plane : the formulas of the plane; pairs : closure -> two columns that are taken from it
    order : of passive coordinates, as they go from rows
    shared : (root, body) in several closures; pool : where rows are that one closure needs after the other; used, most : of them
    """

    mesh: Mesh
    bodies: Bodies
    size: int
    plane: bool
    pairs: dict[int, tuple[int, int]]
    order: list[int] = field(default_factory=list)
    shared: frozenset[tuple[int, int]] = frozenset()
    pool: int = 0
    used: int = 0
    most: int = 0
    fixed: list[float] = field(default_factory=list)
    frames: dict[tuple[int, int], Frame] = field(default_factory=dict)  # (root, body)
    world: int = 0  # how the world accelerates, for closures that end there
    keeps: list[tuple[int, int]] = field(default_factory=list)
    summed: list[tuple[int, int]] = field(default_factory=list)
    roots: list[tuple[int, int]] = field(default_factory=list)
    moved: list[BodyRecord] = field(default_factory=list)
    closures: list[ClosureRecord] = field(default_factory=list)
    columns: list[ColumnRecord] = field(default_factory=list)
    sums: list[SumRecord] = field(default_factory=list)
    header: dict[int, int] = field(default_factory=dict)
    matrix: dict[tuple[int, int], int] = field(default_factory=dict)
    sizes: dict[int, list[int]] = field(default_factory=dict)
    held: dict[int, int] = field(default_factory=dict)  # free body -> room for its next row
    constants: dict[tuple[float, ...], list[int]] = field(default_factory=dict)
    known: dict[int, float] = field(default_factory=dict)  # where such squares stand

    def rows(self, count: int, passing: bool = False) -> int:
        """Room for so many rows; in space, of what is ``passing``, the next closure uses it again."""
        if passing and not self.plane:
            self.used += count * BLOCK
            self.most = max(self.most, self.used)
            return self.pool + self.used - count * BLOCK
        self.size += count * BLOCK
        return self.size - count * BLOCK

    def numbers(self, *parts: Array | float) -> int:
        """Append constants; return the offset of the first."""
        at = len(self.fixed)
        for part in parts:
            self.fixed += np.ravel(part).tolist()
        return at

    def constant_size(self, *squares: float) -> list[int]:
        """Return the offsets of squared sizes of columns that are constant as long as the closure is closed."""
        if squares not in self.constants:
            at = self.constant_rows(12, np.pad(squares, (0, 12 - len(squares))))
            self.constants[squares] = [at + i * BLOCK for i in range(len(squares))]
            self.known.update(zip(self.constants[squares], squares, strict=True))
        return self.constants[squares]

    def counts(self) -> tuple[int, int, int]:
        """Bodies, columns and sums so far."""
        return len(self.moved), len(self.columns), len(self.sums)

    def constant_rows(self, count: int, *parts: Array) -> int:
        """Rows that keep twelve numbers, made once for every call."""
        at = self.rows(count)
        self.roots.append((at, self.numbers(*parts)))
        return at


def path(parents: NDArray[np.uint64], body: int) -> list[int]:
    """A body and all before it, the world last."""
    out = [body]
    while out[-1]:
        out.append(int(parents[out[-1]]))
    return out


def seated(mesh: Mesh, bodies: Bodies, node: int) -> tuple[int, Array, Array]:
    """The body that carries a node (-1: the world), R_body,node and the node's place in the body's frame [m]."""
    if node < 0:
        return 0, np.eye(3), np.zeros(3)
    carrier, turn, place = carriers(mesh)
    if carrier[node] < 0:
        return 0, turn[node], place[node]
    body = int(np.flatnonzero(bodies.node == carrier[node])[0])
    axes = bodies.axes[body].T
    return body, axes @ turn[node], axes @ place[node]


def _first_axis(bodies: Bodies, ways: tuple[list[int], ...]) -> Array:
    """The axis, in the root, of the first joint of a loop that turns; slides before it turn nothing."""
    axes = []
    for way in ways:
        turn = np.eye(3)
        for body in way[::-1]:
            turn = turn @ _seat(bodies, body)[0]
            axes.append((int(bodies.tree[body, 0]) == PRISMATIC, turn[:, 2]))
            if not axes[-1][0]:
                break
    axis: Array = min(axes, key=lambda one: one[0])[1]
    return axis


def root_of(tables: Tables, root: int, ways: tuple[list[int], ...]) -> None:
    """The frame of a root, its axes so that z is that of the first joint of the loop that turns."""
    if (root, root) in tables.frames:
        return
    z = _first_axis(tables.bodies, ways)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    basis = np.stack([x, np.cross(z, x), z])  # rows: the root's axes z and two at right angles
    rows = tables.constant_rows(
        layout.PLANE_ROWS if tables.plane else layout.BODY_ROWS, *_standing(np.eye(3), np.zeros(3))
    )
    tables.frames[root, root] = Frame(rows, rows + int(layout.AT), 0, basis)


def _standing(axes: Array, place: Array) -> tuple[Array, Array, Array]:
    """Axes (rows) and a place in the order of their rows: z, the place, x and y."""
    return axes[2], place, axes[:2]


def _seat(bodies: Bodies, i: int) -> tuple[Array, Array]:
    """R_parent,body at the coordinate's zero but for the turn about z, and p."""
    n = bodies.numbers[i]
    (c, s) = n[27:29]
    return n[:9].reshape(3, 3) @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), n[9:12]


def frame(tables: Tables, root: int, body: int) -> Frame:
    """The frame of a body of a loop, made with those of its parents."""
    if (root, body) not in tables.frames:
        above = frame(tables, root, int(tables.bodies.tree[body, 1]))
        r, p = (above.turned @ x for x in _seat(tables.bodies, body))
        if not tables.plane and _is_universal(tables, root, body, (r, p)):
            return _two_turns(tables, root, body, r)
        if not tables.plane and _goes_on(tables, root, body, r):
            return _chain(tables, root, body, above, (r, p))
        own = tables.rows(layout.PLANE_ROWS if tables.plane else layout.BODY_ROWS, (root, body) not in tables.shared)
        first = above is tables.frames[root, root]
        tables.frames[root, body] = _moving(tables, above, own, body, (r, p), first)
    return tables.frames[root, body]


def _goes_on(tables: Tables, root: int, body: int, r: Array) -> bool:
    """Return True if a body turns on one that turns, both in no other closure: nobody else needs the latter's x and y."""
    parent = int(tables.bodies.tree[body, 1])
    turn = [int(tables.bodies.tree[i, 0]) in TURNS for i in (body, parent)]
    above, alone = tables.frames[root, parent], not {(root, parent), (root, body)} & tables.shared
    return parent != root and all(turn) and alone and _is_tilt(r) and above.place == above.axes + int(layout.AT)


def _chain(tables: Tables, root: int, body: int, above: Frame, seat: tuple[Array, Array]) -> Frame:
    """A body whose rows begin in those of its parent, the last ones that were taken."""
    tables.rows(int(layout.CHAINED) // BLOCK, True)
    own = above.axes + int(layout.CHAINED)
    rows, numbers = int(tables.bodies.tree[body, 2]), tables.numbers(seat[0].T, seat[1])
    tables.moved.append(BodyRecord(layout.CHAIN, own, above.axes, rows, numbers, above.place))
    tables.frames[root, body] = Frame(own, own + int(layout.AT), 0, np.eye(3))
    return tables.frames[root, body]


def _is_universal(tables: Tables, root: int, body: int, seat: tuple[Array, Array]) -> bool:
    """Return True if body and parent form a universal joint: both turn at one place, the parent fixed in the root."""
    parent = int(tables.bodies.tree[body, 1])
    turn = [int(tables.bodies.tree[i, 0]) in TURNS for i in (body, parent)]
    first = parent != root and int(tables.bodies.tree[parent, 1]) == root and (root, parent) not in tables.shared
    return all(turn) and first and _is_tilt(seat[0]) and not seat[1].any()


def _two_turns(tables: Tables, root: int, body: int, r: Array) -> Frame:
    """Both bodies of a universal joint: the first one's axis and place are constant, and its other axes nobody asks for."""
    parent = int(tables.bodies.tree[body, 1])
    seat, p = (tables.frames[root, root].turned @ x for x in _seat(tables.bodies, parent))
    first = tables.constant_rows(layout.BODY_ROWS, *_standing(seat.T, p))
    tables.frames[root, parent] = Frame(first, first + int(layout.AT), 0, np.eye(3))
    above, rows = (int(tables.bodies.tree[i, 2]) for i in (parent, body))
    own = tables.rows(layout.BODY_ROWS, (root, body) not in tables.shared)
    numbers = tables.numbers(seat.T, p, r[1, 1], r[2, 1])
    tables.moved[-1] = BodyRecord(layout.TWO_TURNS, own, above, rows, numbers, 0)
    tables.frames[root, body] = Frame(own, first + int(layout.AT), 0, np.eye(3))
    return tables.frames[root, body]


def _is_tilt(r: Array) -> bool:
    """Return True if R is a rotation about x."""
    return bool(r[0, 0] == 1.0 and not (r[0, 1:].any() or r[1:, 0].any()))


def _moving(tables: Tables, above: Frame, own: int, body: int, seat: tuple[Array, Array], first: bool) -> Frame:
    """A body's axes and place: one that slides in space has its parent's axes."""
    r, kind = seat[0], int(tables.bodies.tree[body, 0])
    turn = layout.ROOT_TURN if first else layout.TURN if tables.plane or not _is_tilt(r) else layout.TILT
    known = {PRISMATIC: layout.SLIDE, SPHERICAL: layout.FLOAT, FREE: layout.FLOAT, HELICAL: layout.SCREW}
    how = (known | {REVOLUTE: turn, CONTINUOUS: turn})[kind]
    rows, numbers = int(tables.bodies.tree[body, 2]), tables.numbers(r.T, seat[1], tables.bodies.numbers[body, 37])
    tables.moved.append(BodyRecord(how, own, above.axes, rows, numbers, 0 if tables.plane else above.place))
    if how == layout.SLIDE:
        return Frame(own if tables.plane else above.axes, own + int(layout.AT), own + int(layout.DIRECTION), r)
    return Frame(own, own + int(layout.AT), 0, np.eye(3))


def state(tables: Tables, body: int) -> int:
    """Return the offset of a body's state (w, al, a); the world accelerates by -g."""
    if body:
        return int(tables.bodies.tree[body, 3])
    if not tables.world:
        tables.world = tables.constant_rows(12, np.zeros(6), -tables.mesh.mechanism.gravity, np.zeros(3))
    return tables.world
