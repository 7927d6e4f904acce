"""Closed loops: their bodies as kernels read them (`loop_bodies`, `loop_plane`), and the tables while they are made."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.simd import BLOCK
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import FREE, HELICAL, PRISMATIC, SPHERICAL
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.body_table import TURNING, Bodies, carriers
from flexinv.rnea.loop_layout import BodyRecord, ClosureRecord, ColumnRecord
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

    plane : the formulas of the plane; pairs : closure -> two columns that are taken from it; matrix : where entries of G stand
    size : of the work space so far [-]
    shared : (root, body) in several closures; used : of the rows that one closure needs after the other, behind the bodies'
    """

    mesh: Mesh
    bodies: Bodies
    plane: bool
    pairs: dict[int, tuple[int, int]]
    matrix: NDArray[np.int64]
    size: int = 0
    used: int = 0
    shared: frozenset[tuple[int, int]] = frozenset()
    fixed: list[float] = field(default_factory=list)
    frames: dict[tuple[int, int], Frame] = field(default_factory=dict)  # (root, body)
    world: int = 0  # how the world accelerates, for closures that end there
    keeps: list[tuple[int, int]] = field(default_factory=list)
    summed: list[tuple[int, int]] = field(default_factory=list)
    roots: list[tuple[int, int]] = field(default_factory=list)
    moved: list[BodyRecord] = field(default_factory=list)
    closures: list[ClosureRecord] = field(default_factory=list)
    columns: list[ColumnRecord] = field(default_factory=list)
    sizes: dict[int, list[int]] = field(default_factory=dict)
    held: dict[int, int] = field(default_factory=dict)  # free body -> room for its next row
    known: dict[int, float] = field(default_factory=dict)  # where sizes stand that are constant while a loop is closed

    def __post_init__(self) -> None:
        most = len(self.bodies.node) * layout.BODY_ROWS + layout.CLOSURE_ROWS + 3 * layout.MOST_ROWS
        self.size = self.bodies.size + (0 if self.plane else most * BLOCK)

    def rows(self, count: int, passing: bool = False) -> int:
        """Room for so many rows; in space, of what is ``passing``, the next closure uses it again."""
        if passing and not self.plane:
            self.used += count * BLOCK
            return self.bodies.size + self.used - count * BLOCK
        self.size += count * BLOCK
        return self.size - count * BLOCK

    def numbers(self, *parts: Array | float) -> int:
        """Append constants; return the offset of the first."""
        at = len(self.fixed)
        for part in parts:
            self.fixed += np.ravel(part).tolist()
        return at

    def constant_rows(self, count: int, *parts: Array) -> int:
        """Rows that keep twelve numbers, made once for every call."""
        at = self.rows(count)
        self.roots.append((at, self.numbers(*parts)))
        return at

    def spans(self, before: list[int] | None = None) -> list[int]:
        """The numbers of columns and bodies so far; with those ``before`` of each the first since then, and how many."""
        counts = [len(self.columns), len(self.moved)]
        return (
            counts if before is None else [n for old, new in zip(before, counts, strict=True) for n in (old, new - old)]
        )


def seated(mesh: Mesh, bodies: Bodies, node: int) -> tuple[int, Array, Array]:
    """The body that carries a node (-1: the world), R_body,node and the node's place in the body's frame [m]."""
    if node < 0:
        return 0, np.eye(3), np.zeros(3)
    carrier, turn, place = carriers(mesh)
    body = int(
        np.flatnonzero(bodies.node == carrier[node])[0]
    )  # the world's node is -1, its axes are those of the mesh
    axes = bodies.axes[body].T
    return body, axes @ turn[node], axes @ place[node]


def _seat(bodies: Bodies, i: int) -> tuple[Array, Array]:
    """R_parent,body at the coordinate's zero but for the turn about z, and p."""
    n = bodies.numbers[i]
    (c, s) = n[27:29]
    return n[:9].reshape(3, 3) @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), n[9:12]


def root_of(tables: Tables, root: int, ways: tuple[list[int], ...]) -> None:
    """The frame of a root, z that of the first joint of the loop that turns; slides before it turn nothing."""
    if (root, root) in tables.frames:
        return
    axes = []
    for way in ways:
        turn = np.eye(3)
        for body in way[::-1]:
            turn = turn @ _seat(tables.bodies, body)[0]
            axes.append((int(tables.bodies.tree[body, 0]) == PRISMATIC, turn[:, 2]))
            if not axes[-1][0]:
                break
    z = min(axes, key=lambda one: one[0])[1]
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    basis, one = np.stack([x, np.cross(z, x), z]), np.eye(3)  # rows: the root's axes z and two at right angles
    rows = tables.constant_rows(layout.PLANE_ROWS if tables.plane else layout.BODY_ROWS, one[2], np.zeros(3), one[:2])
    tables.frames[root, root] = Frame(rows, rows + int(layout.AT), 0, basis)


def frame(tables: Tables, root: int, body: int) -> Frame:
    """The frame of a body of a loop, made with those of its parents; one that slides in space has its parent's axes."""
    if (root, body) in tables.frames:
        return tables.frames[root, body]
    kind, parent, rows = (int(cell) for cell in tables.bodies.tree[body, :3])
    above = frame(tables, root, parent)
    r, p = (above.turned @ x for x in _seat(tables.bodies, body))
    is_tilt = r[0, 0] == 1.0 and not (r[0, 1:].any() or r[1:, 0].any())  # R is a rotation about x
    turn = layout.ROOT_TURN if parent == root else layout.TURN if tables.plane or not is_tilt else layout.TILT
    own = tables.rows(layout.PLANE_ROWS if tables.plane else layout.BODY_ROWS, (root, body) not in tables.shared)
    known = {PRISMATIC: layout.SLIDE, HELICAL: layout.SCREW, SPHERICAL: layout.FLOAT, FREE: layout.FLOAT}
    how = turn if kind in TURNING else known[kind]
    numbers = tables.numbers(r.T, p, tables.bodies.numbers[body, 37])
    tables.moved.append(BodyRecord(how, own, above.axes, rows, numbers, 0 if tables.plane else above.place))
    slides = how == layout.SLIDE
    axes, turned = above.axes if slides and not tables.plane else own, r if slides else np.eye(3)
    made = Frame(axes, own + int(layout.AT), own + int(layout.DIRECTION), turned)
    tables.frames[root, body] = made
    return made


def state(tables: Tables, body: int) -> int:
    """Return the offset of a body's state (w, al, a); the world accelerates by -g."""
    if body:
        return int(tables.bodies.tree[body, 3])
    if not tables.world:
        tables.world = tables.constant_rows(12, np.zeros(6), -tables.mesh.mechanism.gravity, np.zeros(3))
    return tables.world
