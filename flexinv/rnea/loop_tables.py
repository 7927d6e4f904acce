"""Closed loops as the tables that kernels read: bodies, closures and columns (`loop_space`, `loop_plane`, `loop_allocation`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexinv.constraints.closures import Rows
from flexinv.kernels.simd import BLOCK
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import FREE, HELICAL, PRISMATIC, SPHERICAL
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.body_table import TURNING_KINDS, Bodies, find_carrier_nodes
from flexinv.rnea.loop_layout import BodyRecord, ClosureRecord, ColumnRecord, LoopPlan
from flexinv.rnea.recursion import BODY_LEAD, BODY_P, BODY_R, BODY_TILT, TREE_KIND, TREE_PARENT, TREE_ROWS, TREE_STATE
from flexinv.typing import Array, Indices, Mask, Unsigned

# The limits of `allocation` over those of a closure's squares (rows of one that is open by as much as is allowed differ by less);
# axes of the root for those of the closure's own make a factor of sqrt(3) in the sums, |c| |qd| for those of three rows one of 3.
CLEARLY = 0.5
IN_PLANE = np.sqrt(3.0)
IN_SPACE = 3.0
_AXES = (int(layout.AXES), int(layout.AXIS_Y), int(layout.AXIS_Z))
# How bodies move whose joint is no turn about one axis.
_MOTIONS = {PRISMATIC: layout.SLIDE, HELICAL: layout.SCREW, SPHERICAL: layout.FLOAT, FREE: layout.FLOAT}


@dataclass(frozen=True, eq=False)
class _Frame:
    """Offsets of a body's axes, place and direction; turned : R of its own axes as the recursion has them [-]."""

    axes: int
    place: int
    direction: int
    turned: Array


@dataclass
class _Tables:
    """The tables while they are made.

    plane : the formulas of the plane; pairs : closure -> two columns that are taken from it; matrix : where entries of G stand
    size : of the work space so far [-]
    shared : (root, body) in several closures; used : of the rows that one closure needs after the other, behind the bodies'
    """

    mesh: Mesh
    bodies: Bodies
    plane: bool
    pairs: dict[int, tuple[int, int]]
    matrix: Indices
    size: int = 0
    used: int = 0
    shared: frozenset[tuple[int, int]] = frozenset()
    fixed: list[float] = field(default_factory=list)
    frames: dict[tuple[int, int], _Frame] = field(default_factory=dict)  # (root, body)
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

    def add_rows(self, count: int, passing: bool = False) -> int:
        """Room for so many rows; in space, of what is ``passing``, the next closure uses it again."""
        if passing and not self.plane:
            self.used += count * BLOCK
            return self.bodies.size + self.used - count * BLOCK
        self.size += count * BLOCK
        return self.size - count * BLOCK

    def add_constants(self, *parts: Array | float) -> int:
        """Append constants; return the offset of the first."""
        at = len(self.fixed)
        for part in parts:
            self.fixed += np.ravel(part).tolist()
        return at

    def add_constant_rows(self, count: int, *parts: Array) -> int:
        """Rows that keep twelve numbers, made once for every call."""
        at = self.add_rows(count)
        self.roots.append((at, self.add_constants(*parts)))
        return at

    def list_spans(self, columns: int, bodies: int) -> tuple[int, int, int, int]:
        """The first column and the first body after so many, each with how many there are since then."""
        return columns, len(self.columns) - columns, bodies, len(self.moved) - bodies


class _Loop(NamedTuple):
    """A loop: its ends, each a body, R of its node and the node's place; the root, and the bodies from both ends to there."""

    ends: tuple[tuple[int, Array, Array], tuple[int, Array, Array]]
    root: int
    ways: tuple[list[int], list[int]]


class _Column(NamedTuple):
    """Column of G: its velocity coordinate, the body of its joint, its record but for what is written."""

    v: int
    body: int
    record: ColumnRecord


class _End(NamedTuple):
    """End of a closure: its body and the frame of that; R of its node in the frame, its point in the body's axes [m]."""

    body: int
    frame: _Frame
    turn: Array
    arm: Array


def build_loop_tables(
    mesh: Mesh,
    bodies: Bodies,
    rows: Rows,
    limits: tuple[float, float, float],
    mask: Mask,
    plane: bool = False,
    pairs: dict[int, tuple[int, int]] | None = None,
) -> LoopPlan:
    """Return the tables [any unit] without steps: with the rows ``mask`` (rows,) only, positions always.

    limits : (3,) of `allocation` [-], on phi, phi', phi''; plane : by the formulas of the plane
    pairs : closure -> velocity coordinates of two passive joints that no other closure moves, see `loop_space`
    """
    matrix = np.zeros((len(rows.closure), mesh.mechanism.nv), dtype=np.int64)
    tables = _Tables(mesh, bodies, plane, pairs or {}, matrix)
    header = _begin_header(tables, limits)
    own_rows = [np.flatnonzero(rows.closure == closure) for closure in np.unique(rows.closure)]
    loops = [
        None if rows.gear[closure_rows].any() else _find_loop(mesh, bodies, rows, int(closure_rows[0]))
        for closure_rows in own_rows
    ]
    tables.shared = _find_shared_bodies(loops)
    for closure_rows, loop in zip(own_rows, loops, strict=True):
        tables.used = 0
        if loop is None:
            _add_coupling(tables, rows, int(closure_rows[0]))
        elif any(loop.ways):  # else both ends are on one body: nothing moves
            _add_closure(tables, rows, closure_rows[mask[closure_rows] | ~rows.direction[closure_rows]], loop)
    plan = _join_records(tables, header)
    sizes = _drop_smaller_constants(tables)
    fixed = np.array(tables.fixed)
    constant = frozenset(tables.known)
    return LoopPlan(plan, fixed, tables.size, matrix, sizes, constant, (), tuple(tables.moved), tuple(tables.closures))


def _resolve_carrying_body(mesh: Mesh, bodies: Bodies, node: int) -> tuple[int, Array, Array]:
    """The body that carries a node (-1: the world), R_body,node and the node's place in the body's frame [m]."""
    if node < 0:
        return 0, np.eye(3), np.zeros(3)
    carrier, turn, place = find_carrier_nodes(mesh)
    body = int(np.flatnonzero(bodies.node == carrier[node])[0])  # the world's node is -1, its axes those of the mesh
    axes = bodies.axes[body].T
    return body, axes @ turn[node], axes @ place[node]


def _compute_zero_placement(bodies: Bodies, i: int) -> tuple[Array, Array]:
    """R_parent,body at the coordinate's zero but for the turn about z, and p."""
    n = bodies.numbers[i]
    c, s = n[BODY_TILT : BODY_TILT + 2]
    r = n[BODY_R : BODY_R + 9].reshape(3, 3)
    p = n[BODY_P : BODY_P + 3]
    return r @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), p


def _add_root_frame(tables: _Tables, root: int, ways: tuple[list[int], ...]) -> None:
    """The frame of a root, z that of the first joint of the loop that turns; slides before it turn nothing."""
    if (root, root) in tables.frames:
        return
    axes = []
    for way in ways:
        turn = np.eye(3)
        for body in way[::-1]:
            turn = turn @ _compute_zero_placement(tables.bodies, body)[0]
            axes.append((int(tables.bodies.tree[body, TREE_KIND]) == PRISMATIC, turn[:, 2]))
            if not axes[-1][0]:
                break
    z = min(axes, key=lambda one: one[0])[1]
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    # rows: the root's axes z and two at right angles
    basis = np.stack([x, np.cross(z, x), z])
    one = np.eye(3)
    rows = tables.add_constant_rows(
        layout.PLANE_ROWS if tables.plane else layout.BODY_ROWS, one[2], np.zeros(3), one[:2]
    )
    tables.frames[root, root] = _Frame(rows, rows + int(layout.AT), 0, basis)


def _begin_header(tables: _Tables, limits: tuple[float, float, float]) -> list[int]:
    """The header of a plan, with the rows that every call needs; what closures are held against comes first of all constants."""
    axes = IN_PLANE if tables.plane else IN_SPACE
    tables.add_constants(CLEARLY * limits[0], *(CLEARLY / axes * limit for limit in limits[1:]), tables.mesh.length)
    header = [0] * layout.HEADER
    header[layout.LIMITS] = tables.add_rows(layout.LIMIT_ROWS)
    header[layout.SCRATCH] = tables.add_rows(layout.SCRATCH_ROWS)
    header[layout.PLANE] = int(tables.plane)
    return header


def _find_shared_bodies(loops: Sequence[_Loop | None]) -> frozenset[tuple[int, int]]:
    """(root, body) of the bodies that move in several closures."""
    several = Counter((loop.root, body) for loop in loops if loop for way in loop.ways for body in way)
    return frozenset(key for key, count in several.items() if count > 1)


def _join_records(tables: _Tables, header: list[int]) -> Unsigned:
    """The header with where each table begins and how many records it has, and the records behind it."""
    lists: dict[int, Sequence[Sequence[int]]] = {
        layout.KEEPS: tables.keeps, layout.SUMMED: tables.summed, layout.ROOTS: tables.roots,
        layout.BODIES: tables.moved, layout.COLUMNS: tables.columns, layout.CLOSURE_RECORDS: tables.closures,
    }  # fmt: skip
    words = list(header)
    for at, records in lists.items():
        words[at : at + 2] = len(words), len(records)
        words += [word for record in records for word in record]
    return np.array(words, dtype=np.uint64)


def _drop_smaller_constants(tables: _Tables) -> dict[int, list[int]]:
    """Places of the sizes of each velocity coordinate: of those that are constant the largest is enough."""
    sizes = {}
    for v, places in tables.sizes.items():
        known = sorted((at for at in places if at in tables.known), key=lambda at: -tables.known[at])
        sizes[v] = [at for at in places if at not in tables.known] + known[:1]
    return sizes


def _make_frame(tables: _Tables, root: int, body: int) -> _Frame:
    """The frame of a body of a loop, made with those of its parents; one that slides in space has its parent's axes."""
    if (root, body) in tables.frames:
        return tables.frames[root, body]
    kind, parent, rows = (int(cell) for cell in tables.bodies.tree[body, :3])
    above = _make_frame(tables, root, parent)
    r, p = (above.turned @ x for x in _compute_zero_placement(tables.bodies, body))
    how = _resolve_motion(tables, kind, parent == root, r)
    before = _find_kind_before(tables, root, parent, how)
    alone = (root, body) not in tables.shared
    if before == layout.ROOT_TURN and not p.any():
        return _make_universal_frame(tables, root, body, tables.add_rows(layout.BODY_ROWS, alone))
    if before in (layout.ROOT_TURN, layout.CHAIN) and alone:
        how = layout.CHAIN
        offset = above.axes + int(layout.CHAINED)
        tables.add_rows(int(layout.CHAINED) // BLOCK, True)
    else:
        offset = tables.add_rows(layout.PLANE_ROWS if tables.plane else layout.BODY_ROWS, alone)
    numbers = tables.add_constants(r.T, p, tables.bodies.numbers[body, BODY_LEAD])
    tables.moved.append(BodyRecord(how, offset, above.axes, rows, numbers, 0 if tables.plane else above.place))
    slides = how == layout.SLIDE
    axes = above.axes if slides and not tables.plane else offset
    turned = r if slides else np.eye(3)
    tables.frames[root, body] = _Frame(axes, offset + int(layout.AT), offset + int(layout.SLIDING_AXIS), turned)
    return tables.frames[root, body]


def _make_universal_frame(tables: _Tables, root: int, body: int, offset: int) -> _Frame:
    """The frame of a body on a universal joint in the root; the axis and the place of its first turn are constant."""
    parent, rows = (int(cell) for cell in tables.bodies.tree[body, [TREE_PARENT, TREE_ROWS]])
    seat, place = (tables.frames[root, root].turned @ x for x in _compute_zero_placement(tables.bodies, parent))
    first = tables.add_constant_rows(layout.BODY_ROWS, seat.T[2], place, seat.T[:2])
    numbers = tables.add_constants(seat.T, place, _compute_zero_placement(tables.bodies, body)[0][1:, 1])
    above = int(tables.bodies.tree[parent, TREE_ROWS])
    tables.moved[-1] = BodyRecord(layout.TWO_TURNS, offset, above, rows, numbers, 0)
    tables.frames[root, parent] = _Frame(first, first + int(layout.AT), 0, np.eye(3))
    tables.frames[root, body] = _Frame(offset, offset + int(layout.AT), 0, np.eye(3))
    return tables.frames[root, body]


def _find_state_offset(tables: _Tables, body: int) -> int:
    """Return the offset of a body's state (w, al, a); the world accelerates by -g."""
    if not body and not tables.world:
        tables.world = tables.add_constant_rows(12, np.zeros(6), -tables.mesh.mechanism.gravity, np.zeros(3))
    return int(tables.bodies.tree[body, TREE_STATE]) if body else tables.world


def _find_loop(mesh: Mesh, bodies: Bodies, rows: Rows, k: int) -> _Loop:
    """The loop that the closure of a row makes."""
    ends = _resolve_carrying_body(mesh, bodies, int(rows.a[k])), _resolve_carrying_body(mesh, bodies, int(rows.b[k]))
    to_world = [[end[0]] for end in ends]
    for way in to_world:
        while way[-1]:
            way.append(int(bodies.tree[way[-1], TREE_PARENT]))
    root = next(i for i in to_world[0] if i in to_world[1])
    way_a, way_b = (way[: way.index(root)] for way in to_world)
    return _Loop(ends, root, (way_a, way_b))


def _find_kind_before(tables: _Tables, root: int, parent: int, how: int) -> int | None:
    """The kind of the parent, made just now, that a body may go on with; None where it may not."""
    return tables.moved[-1].kind if how == layout.TILT and (root, parent) not in tables.shared else None


def _resolve_motion(tables: _Tables, kind: int, on_root: bool, r: Array) -> int:
    """The kind of motion of a body beside the one that carries it; r : R_parent,body at the coordinate's zero [-]."""
    if kind not in TURNING_KINDS:
        return _MOTIONS[kind]
    if on_root:
        return layout.ROOT_TURN
    is_about_x = r[0, 0] == 1.0 and not (r[0, 1:].any() or r[1:, 0].any())
    return layout.TILT if is_about_x and not tables.plane else layout.TURN


def _add_closure(tables: _Tables, rows: Rows, closure_rows: Indices, loop: _Loop) -> None:
    """A closure of two ends: the bodies between them, its record, its columns."""
    k = closure_rows[0]
    pair = tables.pairs.get(int(rows.closure[k]))
    before = (len(tables.columns), len(tables.moved))
    _add_root_frame(tables, loop.root, loop.ways[::-1])
    a = _make_end(tables, loop.root, loop.ends[0], rows.place_a[k])
    b = _make_end(tables, loop.root, loop.ends[1], rows.place_b[k])
    positions = [int(r) for r in closure_rows if not rows.direction[r]]
    directions = [int(r) for r in closure_rows if rows.direction[r]]
    columns = _list_loop_columns(tables, loop)
    whole = len(positions) == 3 and (tables.plane or pair is not None or len(columns) <= layout.MOST_COLUMNS)
    alone = [] if whole else positions  # one by one
    ground, fixed = _add_closure_constants(tables, (a, b), whole, _list_vectors(rows, (a, b), alone, directions))
    first = tables.add_rows(layout.CLOSURE_ROWS + 3 * (len(directions) + len(alone)), True)
    if pair is None:
        stride = _add_all_rows(tables, columns, whole, [*positions, *directions])
    else:
        stride = 0
        _add_remaining_row(tables, columns, first, pair, positions[0], b)
    states = (0, 0) if tables.plane else (_find_state_offset(tables, a.body), _find_state_offset(tables, b.body))
    kind = layout.WHOLE if whole else layout.PARTIAL
    frames = a.frame.axes, b.frame.axes, a.frame.place, b.frame.place
    places = kind, first, *frames, *states, fixed, len(alone), len(directions)
    tables.closures.append(ClosureRecord(*places, *tables.list_spans(*before), stride, int(pair is not None), ground))


def _make_end(tables: _Tables, root: int, end: tuple[int, Array, Array], place: Array) -> _End:
    """An end of a closure, whose point stands at ``place`` in the axes of its node [m]."""
    body, r, x = end
    frame = _make_frame(tables, root, body)
    return _End(body, frame, frame.turned @ r, x + r @ place)


def _list_loop_columns(tables: _Tables, loop: _Loop) -> list[_Column]:
    """The columns of all joints of a loop."""
    signed = [(body, sign) for way, sign in zip(loop.ways, (-1.0, 1.0), strict=True) for body in way]
    return [column for body, sign in signed for column in _list_joint_columns(tables, loop.root, body, sign)]


def _list_vectors(rows: Rows, ends: tuple[_End, _End], positions: list[int], directions: list[int]) -> list[Array]:
    """The vectors of rows that stand alone, in the frames of their ends: one of a position, two of a direction."""
    a, b = ends
    vectors = [a.turn @ rows.u[r] for r in positions]
    for r in directions:
        vectors += [a.turn @ rows.u[r], b.turn @ rows.w[r]]
    return vectors


def _add_closure_constants(
    tables: _Tables, ends: tuple[_End, _End], whole: bool, vectors: list[Array]
) -> tuple[int, int]:
    """Append the constants of a closure; return the end that stands in the world, and the offset of the constants."""
    a, b = ends
    scale = 1.0 / tables.mesh.length ** (2 if whole else 1)
    points = a.frame.turned @ a.arm, b.frame.turned @ b.arm
    turned = a.frame.turned.T, b.frame.turned.T
    fixed = tables.add_constants(*points, scale, a.arm, b.arm, *turned, *vectors)
    if whole and not tables.plane and 0 in (a.body, b.body):
        return _resolve_ground_end(tables, (a.body, b.body).index(0), ends, vectors, fixed)
    return layout.NO_GROUND, fixed


def _resolve_ground_end(
    tables: _Tables, stands: int, ends: tuple[_End, _End], vectors: list[Array], fixed: int
) -> tuple[int, int]:
    """Return the end that stands in the world and the constants of `loop_space`; none where the other end is turned."""
    moves = 1 - stands
    if not np.array_equal(ends[moves].frame.turned, np.eye(3)):
        return layout.NO_GROUND, fixed
    sign = 1.0 if moves else -1.0
    pairs = [v for i in range(0, len(vectors), 2) for v in (sign * vectors[i + moves], vectors[i + stands])]
    rest, there = (ends[stands].frame.turned @ x for x in (-tables.mesh.mechanism.gravity, ends[stands].arm))
    at = tables.add_constants(ends[moves].arm, there, 1.0 / tables.mesh.length**2, rest, float(moves), *pairs)
    return layout.B_STANDS if stands else layout.A_STANDS, at


def _list_joint_columns(tables: _Tables, root: int, body: int, sign: float) -> list[_Column]:
    """The columns of one joint: those of a slide, of a turn about z, or of all axes; sign : 1 on B's way, -1 on A's.

    Their accelerations are stored, in the plane for the kernels, in space for the sums.
    """
    kind = int(tables.bodies.tree[body, TREE_KIND])
    frame = tables.frames[root, body]
    m = tables.mesh.mechanism
    length = tables.mesh.length
    slides, turns = ([(how, frame.axes + at) for at in _AXES] for how in (layout.SLIDING, layout.TURNING))
    several = {PRISMATIC: [(layout.SLIDING, frame.direction)], SPHERICAL: turns, FREE: slides + turns}
    out = []
    first = int(tables.mesh.v_index[tables.bodies.node[body]])
    for v, (how, axis) in enumerate(several.get(kind, turns[2:]), start=first):
        lead, about = (1.0, 0.0) if how == layout.SLIDING else (tables.bodies.numbers[body, BODY_LEAD], 1.0)
        signs = tables.add_constants(sign * lead / length, sign * about / length, sign * about, length)
        rate, effort = (int(tables.bodies.columns[i + v]) for i in (m.nq, m.nq + m.nv))
        kept = frame.place - int(layout.AT) + int(layout.KEPT_ACCELERATION) if tables.plane else tables.add_rows(1)
        (tables.keeps if tables.plane else tables.summed).append((effort, kept))
        out.append(_Column(v, body, ColumnRecord(how, axis, frame.place, 0, rate, kept, signs, effort, 0)))
    return out


def _add_column(tables: _Tables, column: _Column, rows: list[int], stride: int = 0, **where: int) -> None:
    """Write a column with what is known of it now, and note where its size and its entries in these rows stand."""
    record = column.record._replace(**where)
    tables.columns.append(record)
    tables.sizes.setdefault(column.v, []).append(record.to)
    for j, row in enumerate(rows):
        tables.matrix[row, column.v] = record.entry + j * stride


def _add_all_rows(tables: _Tables, columns: list[_Column], whole: bool, rows: list[int]) -> int:
    """Columns of a closure in all its rows; return how far rows are apart.

    In the plane a column's entries are behind its size; in space columns stand side by side, of three positions their sizes, too.
    """
    stride = BLOCK if tables.plane else BLOCK * (layout.MOST_COLUMNS if whole else len(columns))
    base = 0 if tables.plane else tables.add_rows((1 + len(rows)) * stride // BLOCK)
    for i, column in enumerate(columns):
        first = tables.add_rows(4) if tables.plane else base + i * BLOCK
        _add_column(tables, column, rows, stride, to=first if whole else tables.add_rows(4), entry=first + stride)
    return stride


def _add_remaining_row(
    tables: _Tables, columns: list[_Column], offset: int, pair: tuple[int, int], row: int, end: _End
) -> None:
    """Columns of a closure from which a universal joint is taken; end : that of B."""
    for v, at in zip(pair, (layout.SIZE, layout.SIZE_TOO), strict=True):
        column = next(c for c in columns if c.v == v)
        _add_column(tables, column, [], to=offset + int(at))
    is_free = int(tables.bodies.tree[end.body, TREE_KIND]) == FREE
    free = [c for c in columns if is_free and c.body == end.body]
    for column in (c for c in columns if c.v not in pair and c not in free):
        _add_column(tables, column, [row], to=tables.add_rows(1), entry=tables.add_rows(1))
    if free:
        _add_free_body(tables, free, row, end)


def _add_free_body(tables: _Tables, columns: list[_Column], row: int, end: _End) -> None:
    """The six columns of a free body in a row of the closure at its point; their sizes are constant."""
    body = end.body
    if body not in tables.held:
        tables.held[body] = tables.add_rows(6 * len(tables.pairs))
    entry = tables.held[body]
    tables.held[body] += 6 * BLOCK
    x, y, z = end.arm
    scale = 1.0 / tables.mesh.length**2
    squares = [scale, scale, scale, scale * (y * y + z * z), scale * (x * x + z * z), scale * (x * x + y * y)]
    known = tables.add_constant_rows(12, np.pad(squares, (0, 6)))
    sizes = [int(known) + i * BLOCK for i in range(6)]
    tables.known.update(zip(sizes, squares, strict=True))
    record = columns[0].record
    signs = tables.add_constants(*tables.fixed[record.signs : record.signs + 4], end.arm)
    axes = record.axis - int(layout.AXES)
    joint = int(tables.bodies.tree[body, TREE_ROWS])
    first = columns[0]._replace(record=record._replace(kind=layout.FLOATING, axis=axes, joint=joint, signs=signs))
    for j, (column, size) in enumerate(zip([first, *columns[1:]], sizes, strict=True)):
        _add_column(tables, column, [row], to=size, entry=entry + j * BLOCK)


def _add_coupling(tables: _Tables, rows: Rows, row: int) -> None:
    """A coupling: its record, a column for each coordinate."""
    m = tables.mesh.mechanism
    before = len(tables.columns)
    first = tables.add_rows(layout.CLOSURE_ROWS, True)
    for v in np.flatnonzero(rows.gear[row]).tolist():
        place, rate, second = (int(tables.bodies.columns[i]) for i in (rows.place[v], m.nq + v, m.nq + m.nv + v))
        to = tables.add_rows(2)
        kept = tables.add_rows(1)
        gear = tables.add_constants(rows.gear[row, v])
        tables.keeps.append((second, kept))
        record = ColumnRecord(layout.TURNING, place, 0, to, rate, kept, gear, second, to + BLOCK)
        _add_column(tables, _Column(v, 0, record), [row])
    places = layout.COUPLED, first, 0, 0, 0, 0, 0, 0, tables.add_constants(rows.offset[row]), 1, 0
    tables.closures.append(
        ClosureRecord(*places, *tables.list_spans(before, len(tables.moved)), 0, 0, layout.NO_GROUND)
    )
