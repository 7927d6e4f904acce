"""Closed loops as the tables that kernels read: bodies, closures and columns (`loop_space`, `loop_plane`, `loop_allocation`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.closures import Rows
from flexinv.kernels.simd import BLOCK
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import CONTINUOUS, FREE, HELICAL, PRISMATIC, REVOLUTE, SPHERICAL
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.body_table import Bodies
from flexinv.rnea.elimination_order import Step
from flexinv.rnea.loop_frames import Frame, Tables, frame, path, root_of, seated, state
from flexinv.rnea.loop_layout import BodyRecord, ClosureRecord, ColumnRecord, SumRecord
from flexinv.typing import Array

# The limits of `allocation` over those of a closure's squares; rows of a closure that is open by as much as is allowed
# differ by less.
# Axes of the root for those of the closure's own make a factor of sqrt(3) in the sums, |c| |qd| for those of three rows one of 3.
CLEARLY, IN_PLANE, IN_SPACE = 0.5, np.sqrt(3.0), 3.0
_AXES = (int(layout.AXES), int(layout.AXIS_Y), int(layout.AXIS_Z))


@dataclass(frozen=True, eq=False)
class LoopPlan:
    """Plan of the kernels: ``plan`` of whole numbers, ``fixed`` of others [any unit]; ``size`` of the whole work space [-].

    matrix : (rows, nv) where the entries of G stand, 0 where there are none; sizes : velocity coordinate -> of its columns
    constant : which of these are; effort : where efforts of the velocity coordinates stand
    bodies, closures, steps : the records of ``plan``; rows, coordinates : names of equations and of velocity coordinates
    """

    plan: NDArray[np.uint64]
    fixed: Array
    size: int
    matrix: NDArray[np.int64]
    sizes: dict[int, list[int]]
    constant: frozenset[int] = frozenset()
    effort: tuple[int, ...] = ()
    bodies: tuple[BodyRecord, ...] = ()
    closures: tuple[ClosureRecord, ...] = ()
    steps: tuple[Step, ...] = ()
    rows: tuple[str, ...] = ()
    coordinates: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return the plan as text, a line for every step (`plan_listing`)."""
        from flexinv.rnea.plan_listing import listing

        return listing(self)


@dataclass(frozen=True)
class _Column:
    """Column of G of a joint, named by its body: axis, place, coordinate; True if on B's way; offset of the stored qdd."""

    how: int
    axis: int
    place: int
    v: int
    joint: int
    forward: bool
    kept: int = 0


def tables(
    mesh: Mesh,
    bodies: Bodies,
    rows: Rows,
    limits: tuple[float, float, float],
    kept: NDArray[np.bool_],
    plane: bool = False,
    pairs: dict[int, tuple[int, int]] | None = None,
    order: list[int] | None = None,
) -> LoopPlan:
    """Return the tables [any unit] without steps: with the rows ``kept`` (rows,) only, positions always.

    limits : (3,) of `allocation` [-], on phi, phi', phi''; plane : by the formulas of the plane
    pairs : closure -> velocity coordinates of two passive joints that no other closure moves, see `loop_reduce`
    order : of passive coordinates, as they go from rows
    """
    t = Tables(mesh, bodies, bodies.size, plane, pairs or {}, order or [], _shared(mesh, bodies, rows))
    _fill(t, rows, limits, kept)
    if t.most:  # once more, now that it is known how much the closures need that is passing
        t = Tables(mesh, bodies, bodies.size + t.most, plane, t.pairs, t.order, t.shared, bodies.size)
        _fill(t, rows, limits, kept)
    matrix = np.zeros((len(rows), mesh.mechanism.nv), dtype=np.int64)
    for (row, column), at in t.matrix.items():
        matrix[row, column] = at
    plan = LoopPlan(_packed(t), np.array(t.fixed), t.size, matrix, _sizes(t), frozenset(t.known))
    return replace(plan, bodies=tuple(t.moved), closures=tuple(t.closures))


def _fill(tables: Tables, rows: Rows, limits: tuple[float, float, float], kept: NDArray[np.bool_]) -> None:
    """Write all closures."""
    axes = IN_PLANE if tables.plane else IN_SPACE
    tables.numbers(CLEARLY * limits[0], *(CLEARLY / axes * limit for limit in limits[1:]), tables.mesh.length)
    tables.header = {
        layout.LIMITS: tables.rows(layout.LIMIT_ROWS),
        layout.SCRATCH: tables.rows(layout.SCRATCH_ROWS),
        layout.PLANE: int(tables.plane),
    }
    for closure in np.unique(rows.closure):
        own = np.flatnonzero(rows.closure == closure)
        tables.used = 0
        if rows.gear[own].any():
            _coupling(tables, rows, int(own[0]))
        else:
            _closure(tables, rows, own[kept[own] | ~rows.direction[own]])


def _sizes(tables: Tables) -> dict[int, list[int]]:
    """Return the offsets of the sizes of columns: of those that are constant the largest is enough."""
    out = {}
    for v, sizes in tables.sizes.items():
        known = [at for at in sizes if at in tables.known]
        out[v] = [at for at in sizes if at not in tables.known] + (
            [max(known, key=lambda at: tables.known[at])] if known else []
        )
    return out


def _shared(mesh: Mesh, bodies: Bodies, rows: Rows) -> frozenset[tuple[int, int]]:
    """The bodies, (root, body), that are in several closures."""
    several = Counter[tuple[int, int]]()
    for closure in np.unique(rows.closure[~rows.gear.any(axis=1)]):
        k = int(np.argmax(rows.closure == closure))
        root, *ways = _ways(bodies, seated(mesh, bodies, int(rows.a[k]))[0], seated(mesh, bodies, int(rows.b[k]))[0])
        several.update({(root, body) for way in ways for body in way})
    return frozenset(key for key, count in several.items() if count > 1)


def _ways(bodies: Bodies, one: int, other: int) -> tuple[int, list[int], list[int]]:
    """The root of a loop, and its bodies from both ends to there."""
    way_a, way_b = path(bodies.tree[:, 1], one), path(bodies.tree[:, 1], other)
    root = next(i for i in way_a if i in way_b)
    return root, way_a[: way_a.index(root)], way_b[: way_b.index(root)]


def _packed(tables: Tables) -> NDArray[np.uint64]:
    """A header and the tables behind it: where each begins, and how many records it has."""
    header, words = np.zeros(layout.HEADER, dtype=np.uint64), list[int]()
    for at, value in tables.header.items():
        header[at] = value
    lists: dict[int, Sequence[Sequence[int]]] = {
        layout.KEEPS: tables.keeps,
        layout.SUMMED: tables.summed,
        layout.ROOTS: tables.roots,
        layout.BODIES: tables.moved,
        layout.COLUMNS: tables.columns,
        layout.SUMS: tables.sums,
        layout.CLOSURES: tables.closures,
    }
    for at, records in lists.items():
        header[at], header[at + 1] = layout.HEADER + len(words), len(records)
        for record in records:
            words += _placed(record, header) if isinstance(record, ClosureRecord) else record
    return np.concatenate([header, np.array(words, dtype=np.uint64)])


def _placed(closure: ClosureRecord, header: NDArray[np.uint64]) -> ClosureRecord:
    """A closure whose first column, sum and body are no longer numbers, but where they stand in the plan."""
    columns, sums, bodies = (int(header[table]) for table in (layout.COLUMNS, layout.SUMS, layout.BODIES))
    return closure._replace(
        first=columns + len(ColumnRecord._fields) * closure.first,
        first_sum=sums + len(SumRecord._fields) * closure.first_sum,
        first_body=bodies + len(BodyRecord._fields) * closure.first_body,
    )


def _closure(tables: Tables, rows: Rows, own: NDArray[np.int64]) -> None:
    """A closure of two ends: the bodies between them, its record, its columns."""
    k = own[0]
    (a, ra, xa), (b, rb, xb) = (seated(tables.mesh, tables.bodies, int(end[k])) for end in (rows.a, rows.b))
    root, way_a, way_b = _ways(tables.bodies, a, b)
    if not (way_a or way_b):
        return  # both ends on one body: nothing moves
    before, pair = tables.counts(), tables.pairs.get(int(rows.closure[k]))
    root_of(tables, root, (way_b, way_a))
    one, other = frame(tables, root, a), frame(tables, root, b)
    positions, directions = ([int(r) for r in own if rows.direction[r] == which] for which in (False, True))
    columns = [c for way in (way_a, way_b) for body in way for c in _columns_of(tables, root, body, way is way_b)]
    together = len(columns) <= layout.MOST_COLUMNS and all(c.how != layout.SCREWING for c in columns)
    whole = len(positions) == 3 and (tables.plane or pair is not None or together)
    vectors = [] if whole else [one.turned @ ra @ rows.u[r] for r in positions]
    for r in directions:
        vectors += [one.turned @ ra @ rows.u[r], other.turned @ rb @ rows.w[r]]
    scale = 1.0 / tables.mesh.length**2 if whole else 1.0 / tables.mesh.length
    arms = xa + ra @ rows.place_a[k], xb + rb @ rows.place_b[k]
    turned = one.turned.T, other.turned.T
    fixed = tables.numbers(one.turned @ arms[0], other.turned @ arms[1], scale, *arms, *turned, *vectors)
    ground = layout.NO_GROUND
    if whole and not tables.plane and 0 in (a, b):
        ground, fixed = _from_ground(tables, root, (a, b), (one, other), arms, vectors, fixed)
    first = tables.rows(layout.CLOSURE_ROWS + 3 * (len(directions) + (0 if whole else len(positions))), True)
    if tables.plane:
        stride = _rows_in_plane(tables, columns, positions)
    elif pair is None:
        stride = _rows_in_space(tables, columns, whole, [*positions, *directions])
    else:
        stride = _row_that_is_left(tables, columns, first, pair, positions[0], (b, arms[1]))
    bodies, number, sums = (now - then for now, then in zip(tables.counts(), before, strict=True))
    ends = (0, 0, 0, 0) if tables.plane else (one.place, other.place, state(tables, a), state(tables, b))
    kind, counts = (layout.WHOLE, 0) if whole else (layout.PARTIAL, len(positions))
    places = kind, first, one.axes, other.axes, fixed, counts, len(directions), before[1], number, *ends
    tables.closures.append(
        ClosureRecord(*places, int(pair is not None), before[2], sums, stride, before[0], bodies, ground)
    )


def _from_ground(
    tables: Tables,
    root: int,
    bodies: tuple[int, int],
    ends: tuple[Frame, Frame],
    arms: tuple[Array, Array],
    vectors: list[Array],
    fixed: int,
) -> tuple[int, int]:
    """Return the end that stands in the world and the constants of `loop_space`; none where the other end is turned."""
    stands = bodies.index(0)
    moves = 1 - stands
    if not np.array_equal(ends[moves].turned, np.eye(3)):
        return layout.NO_GROUND, fixed
    sign = 1.0 if moves else -1.0
    pairs = [v for i in range(0, len(vectors), 2) for v in (sign * vectors[i + moves], vectors[i + stands])]
    rest = ends[stands].turned @ -tables.mesh.mechanism.gravity
    there = ends[stands].turned @ arms[stands]
    at = tables.numbers(arms[moves], there, 1.0 / tables.mesh.length**2, rest, float(moves), *pairs)
    return layout.B_STANDS if stands else layout.A_STANDS, at


def _columns_of(tables: Tables, root: int, body: int, forward: bool) -> list[_Column]:
    """The columns of one joint; those of a slide, of a turn about z, or of all axes."""
    kind, own = int(tables.bodies.tree[body, 0]), tables.frames[root, body]
    slides, turns = ([(how, own.axes + at) for at in _AXES] for how in (layout.SLIDING, layout.TURNING))
    several = {PRISMATIC: [(layout.SLIDING, own.direction)], SPHERICAL: turns, FREE: slides + turns}
    several |= {HELICAL: [(layout.SCREWING, own.axes + int(layout.AXIS_Z))], REVOLUTE: turns[2:], CONTINUOUS: turns[2:]}
    v = int(tables.mesh.v_index[tables.bodies.node[body]])
    made = enumerate(several[kind])
    return [_Column(how, axis, own.place, v + j, body, forward) for j, (how, axis) in made]


def _write(tables: Tables, column: _Column, to: int, entry: int) -> None:
    """Write a column's record; the way of a screw stands behind signs and length."""
    m, sign, length = tables.mesh.mechanism, 1.0 if column.forward else -1.0, tables.mesh.length
    rate, effort = (int(tables.bodies.columns[i + column.v]) for i in (m.nq, m.nq + m.nv))
    signs = tables.numbers(sign / length, sign, length, tables.bodies.numbers[column.joint, 37])
    tables.columns.append(
        ColumnRecord(column.how, column.axis, column.place, to, rate, column.kept, signs, effort, entry)
    )


def _rows_in_plane(tables: Tables, columns: list[_Column], rows: list[int]) -> int:
    """Columns with their entries behind them."""
    for c in columns:
        to = tables.rows(4)
        entry = to + int(layout.ENTRIES)
        _write(tables, replace(c, kept=_kept(tables, c.v, c.place - int(layout.AT) + int(layout.KEPT))), to, entry)
        _enter(tables, c.v, to, [(row, entry + i * BLOCK) for i, row in enumerate(rows)])
    return BLOCK


def _rows_in_space(tables: Tables, columns: list[_Column], whole: bool, rows: list[int]) -> int:
    """Columns of a closure in all its rows; return how far rows are apart.

    Those of drives come first, then passive ones: those that go last, the first of them.
    """
    m, count = tables.mesh.mechanism, layout.MOST_COLUMNS if whole else len(columns)
    base, stride = tables.rows((1 + len(rows)) * count), count * BLOCK
    turn = {v: -i for i, v in enumerate(tables.order)}
    side_by_side = sorted((c.v for c in columns), key=lambda v: (not m.actuated[v], turn.get(v, 1), v))
    for column in columns:
        c, first = (
            replace(column, kept=_kept(tables, column.v, tables.rows(1))),
            base + side_by_side.index(column.v) * BLOCK,
        )
        to, entry = first if whole else tables.rows(4), first + stride
        _write(tables, c, to, entry)
        if whole:
            _sum(tables, c, to)
        _enter(tables, c.v, to, [(row, entry + j * stride) for j, row in enumerate(rows)])
    return stride


def _row_that_is_left(
    tables: Tables, columns: list[_Column], own: int, pair: tuple[int, int], row: int, end: tuple[int, Array]
) -> int:
    """Columns of a closure from which a universal joint is taken; end : the body of B, and the point in its axes."""
    scale = 1.0 / tables.mesh.length**2
    columns = [replace(c, kept=_kept(tables, c.v, tables.rows(1))) for c in columns]
    for v, at in zip(pair, (layout.SIZE, layout.SIZE_TOO), strict=True):
        c = next(c for c in columns if c.v == v)
        _write(tables, c, 0, 0)
        _sum(tables, c, own + int(at))
    others = sorted((c for c in columns if c.v not in pair), key=lambda c: c.v)
    free = [c for c in others if c.joint == end[0]] if int(tables.bodies.tree[end[0], 0]) == FREE else []
    for c in (c for c in others if c not in free):
        joint, entry = tables.bodies.tree[c.joint], tables.rows(1)
        pushes = int(joint[0]) == PRISMATIC
        to = tables.constant_size(scale)[0] if pushes else tables.rows(4)
        _write(tables, replace(c, how=layout.PUSHING, place=int(joint[2])) if pushes else c, to, entry)
        _sum(tables, c, to)
        _enter(tables, c.v, to, [(row, entry)])
    if free:
        if end[0] not in tables.held:
            tables.held[end[0]] = tables.rows(6 * len(tables.pairs))
        entry, (x, y, z) = tables.held[end[0]], end[1]
        tables.held[end[0]] += 6 * BLOCK
        sizes = tables.constant_size(*(scale * s for s in (1.0, 1.0, 1.0, y * y + z * z, x * x + z * z, x * x + y * y)))
        axes, own = free[0].axis - int(layout.AXES), int(tables.bodies.tree[end[0], 2])
        _write(tables, replace(free[0], how=layout.FLOATING, axis=axes, place=own), tables.numbers(end[1]), entry)
        for j, (c, size) in enumerate(zip(free, sizes, strict=True)):
            _sum(tables, c, size)
            _enter(tables, c.v, size, [(row, entry + j * BLOCK)])
    return 0


def _sum(tables: Tables, column: _Column, size: int) -> None:
    """Write what the sums of three positions, and of directions beside them, take of a column."""
    rate = int(tables.bodies.columns[tables.mesh.mechanism.nq + column.v])
    tables.sums.append(
        SumRecord(size, rate, column.kept, column.axis, int(column.how in (layout.TURNING, layout.SCREWING)))
    )


def _kept(tables: Tables, v: int, to: int) -> int:
    """Store a coordinate's acceleration at ``to``, in the plane for the kernels, in space for the sums; return ``to``."""
    m = tables.mesh.mechanism
    (tables.keeps if tables.plane else tables.summed).append((int(tables.bodies.columns[m.nq + m.nv + v]), to))
    return to


def _enter(tables: Tables, v: int, size: int, entries: list[tuple[int, int]]) -> None:
    tables.sizes.setdefault(v, []).append(size)
    for row, at in entries:
        tables.matrix[row, v] = at


def _coupling(tables: Tables, rows: Rows, row: int) -> None:
    """A coupling: its record, a column for each coordinate."""
    m, before, first = tables.mesh.mechanism, tables.counts(), tables.rows(layout.CLOSURE_ROWS, True)
    coupled = np.flatnonzero(rows.gear[row])
    for v in coupled:
        place, rate, second = (int(tables.bodies.columns[i]) for i in (rows.place[v], m.nq + v, m.nq + m.nv + v))
        to, kept = tables.rows(2), tables.rows(1)
        tables.keeps.append((second, kept))
        signs, entry = tables.numbers(rows.gear[row, v], 0.0, 0.0, 0.0), to + int(layout.ENTRIES)
        tables.columns.append(ColumnRecord(layout.GEARED, place, 0, to, rate, kept, signs, second, entry))
        _enter(tables, int(v), to, [(row, entry)])
    of_offset, bodies = tables.numbers(rows.offset[row]), before[0]
    record = ClosureRecord(layout.COUPLED, first, 0, 0, of_offset, 1, 0, before[1], len(coupled))
    tables.closures.append(record._replace(first_sum=before[2], first_body=bodies))
