"""Closed loops as the tables that kernels read (`loop_lanes`, `loop_rows`), made once for a mechanism.

Entries of G are analytic functions of the coordinates: those that vanish where the joints stand anywhere vanish everywhere, and
so do whole rows, as those of a loop in the plane that keep it there.  They are found from the kernel's own numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexinv.bodies import TURNING as TURNS
from flexinv.bodies import Bodies, carriers
from flexinv.closures import Rows, residuals
from flexinv.kinds import FREE, PRISMATIC, SPHERICAL
from flexinv.lanes import BLOCK
from flexinv.loop_lanes import (
    AT,
    AXES,
    AXIS_Y,
    AXIS_Z,
    BODIES,
    BODY_ROWS,
    CLOSURE_CELLS,
    CLOSURE_ROWS,
    CLOSURES,
    COLUMN_CELLS,
    COLUMNS,
    COUPLED,
    DIRECTION,
    FILLS,
    FLOAT,
    GEARED,
    HEADER,
    KEEPS,
    KEPT,
    KEPT_TURNING,
    LIMIT_ROWS,
    LIMITS,
    PARTIAL,
    PLANE,
    ROOT_TURN,
    ROOTS,
    SCRATCH,
    SCRATCH_ROWS,
    SLIDE,
    SLIDING,
    STEPS,
    TURN,
    TURNING,
    WHOLE,
)
from flexinv.loop_rows import ENTRIES
from flexinv.loop_steps import Elimination, sharing
from flexinv.mechanism import Array, Mechanism
from flexinv.mesh import Mesh
from flexinv.rigid import rigid_motion

# An entry below this part of the largest one, at places where joints stand anywhere, is zero: rounding of some tens of sums.
ZERO = 1e-13
# Samples at which it is looked for.
PLACES = 4
# The limits of `given` over those of a closure's squares: axes of the root for those of the closure's own make a factor of
# sqrt(3) in the sums, and rows of a closure that is open by as much as is allowed differ by less than the rest.
CLEARLY = 0.5


@dataclass(frozen=True, eq=False)
class LoopPlan:
    """What kernels read: ``plan`` of whole numbers and ``fixed`` of others [any unit]; ``size`` of the whole work space [-].

    matrix : (rows, nv) where the entries of G stand, 0 where there are none; sizes : velocity coordinate -> of its columns
    """

    plan: NDArray[np.uint64]
    fixed: Array
    size: int
    matrix: NDArray[np.int64]
    sizes: dict[int, list[int]]


NO_LOOPS = LoopPlan(np.zeros(HEADER, dtype=np.uint64), np.zeros(4), 0, np.zeros((0, 0), dtype=np.int64), {})


@dataclass
class _Tables:
    """The tables while they are made."""

    mesh: Mesh
    bodies: Bodies
    size: int
    fixed: list[float]
    own: dict[tuple[int, int], int] = field(default_factory=dict)  # (root, body) -> its rows
    turned: dict[tuple[int, int], Array] = field(default_factory=dict)  # its axes as taken here, constant in its own
    keeps: list[int] = field(default_factory=list)
    roots: list[int] = field(default_factory=list)
    moved: list[int] = field(default_factory=list)
    closures: list[int] = field(default_factory=list)
    columns: list[int] = field(default_factory=list)
    matrix: dict[tuple[int, int], int] = field(default_factory=dict)
    sizes: dict[int, list[int]] = field(default_factory=dict)

    def rows(self, count: int) -> int:
        """Room for so many rows."""
        self.size += count * BLOCK
        return self.size - count * BLOCK

    def numbers(self, *parts: Array | float) -> int:
        """Where constants stand."""
        at = len(self.fixed)
        for part in parts:
            self.fixed += np.ravel(part).tolist()
        return at


def tables(mesh: Mesh, b: Bodies, rows: Rows, limits: tuple[float, float, float], kept: NDArray[np.bool_]) -> LoopPlan:
    """Return the tables [any unit] without steps: with the rows ``kept`` (rows,) only, positions always.

    limits : (3,) of `given` [-], on phi, phi', phi''
    """
    t = _Tables(mesh, b, b.size, [])
    t.numbers(CLEARLY * limits[0], *(CLEARLY / np.sqrt(3.0) * limit for limit in limits[1:]), mesh.length)
    limit_rows, scratch = t.rows(LIMIT_ROWS), t.rows(SCRATCH_ROWS)
    for closure in np.unique(rows.closure):
        own = np.flatnonzero(rows.closure == closure)
        if rows.gear[own].any():
            _coupling(t, rows, int(own[0]))
        else:
            _closure(t, rows, own[kept[own] | ~rows.direction[own]])
    lists = ((KEEPS, t.keeps, 2), (ROOTS, t.roots, 2), (BODIES, t.moved, 5), (CLOSURES, t.closures, int(CLOSURE_CELLS)))
    plan = _packed((*lists, (COLUMNS, t.columns, int(COLUMN_CELLS))), {LIMITS: limit_rows, SCRATCH: scratch})
    first = int(plan[COLUMNS])
    for i in range(int(plan[CLOSURES + 1])):  # columns of a closure: their number in the list, now where they stand
        cell = int(plan[CLOSURES]) + i * int(CLOSURE_CELLS) + 7
        plan[cell] = first + int(COLUMN_CELLS) * int(plan[cell])
    matrix = np.zeros((len(rows), mesh.mechanism.nv), dtype=np.int64)
    for (row, column), at in t.matrix.items():
        matrix[row, column] = at
    return LoopPlan(plan, np.array(t.fixed), t.size, matrix, t.sizes)


def _packed(lists: tuple[tuple[int, list[int], int], ...], single: dict[int, int]) -> NDArray[np.uint64]:
    """A header and the lists behind it: where each begins, and how many records it has."""
    header, words = np.zeros(HEADER, dtype=np.uint64), list[int]()
    for at, value in single.items():
        header[at] = value
    for at, own, cells in lists:
        header[at], header[at + 1] = HEADER + len(words), len(own) // cells
        words += own
    return np.concatenate([header, np.array(words, dtype=np.uint64)])


def _path(parents: NDArray[np.uint64], body: int) -> list[int]:
    """A body and all before it, the world last."""
    out = [body]
    while out[-1]:
        out.append(int(parents[out[-1]]))
    return out


def _seated(t: _Tables, node: int) -> tuple[int, Array, Array]:
    """The body that carries a node (-1: the world), R_body,node and the node's place in the body's frame."""
    if node < 0:
        return 0, np.eye(3), np.zeros(3)
    carrier, turn, place = carriers(t.mesh)
    body = int(np.flatnonzero(t.bodies.node == carrier[node])[0])
    axes = t.bodies.axes[body].T
    return body, axes @ turn[node], axes @ place[node]


def _first_axis(b: Bodies, ways: tuple[list[int], ...]) -> Array:
    """The axis, in the root, of the first joint of a loop that turns; slides before it turn nothing."""
    axes = []
    for way in ways:
        turn = np.eye(3)
        for body in way[::-1]:
            turn = turn @ _seat(b, body)[0]
            axes.append((int(b.tree[body, 0]) == PRISMATIC, turn[:, 2]))
            if not axes[-1][0]:
                break
    axis: Array = min(axes, key=lambda one: one[0])[1]
    return axis


def _root(t: _Tables, root: int, ways: tuple[list[int], ...]) -> int:
    """Rows of a root, its axes so that z is that of the first joint of the loop that turns."""
    if (root, root) not in t.own:
        z = _first_axis(t.bodies, ways)
        x = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = x - (x @ z) * z
        x /= np.linalg.norm(x)
        basis = np.stack([x, np.cross(z, x), z])  # rows: the root's axes z and two at right angles
        t.own[root, root], t.turned[root, root] = t.rows(BODY_ROWS), basis
        t.roots += [t.own[root, root], t.numbers(np.eye(3))]
    return t.own[root, root]


def _seat(b: Bodies, i: int) -> tuple[Array, Array]:
    """R_parent,body at the coordinate's zero but for the turn about z, and p."""
    n = b.numbers[i]
    (c, s) = n[27:29]
    return n[:9].reshape(3, 3) @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), n[9:12]


def _moving(t: _Tables, root: int, body: int) -> int:
    """Rows of a body of a loop, made with those of its parents."""
    if (root, body) in t.own:
        return t.own[root, body]
    parent = int(t.bodies.tree[body, 1])
    above = _moving(t, root, parent)
    own = t.own[root, body] = t.rows(BODY_ROWS)
    (r, p), kind = (t.turned[root, parent] @ x for x in _seat(t.bodies, body)), int(t.bodies.tree[body, 0])
    t.turned[root, body] = r if kind == PRISMATIC else np.eye(3)  # one that slides has its parent's axes
    how = (
        ROOT_TURN
        if parent == root and kind in TURNS
        else {PRISMATIC: SLIDE, SPHERICAL: FLOAT, FREE: FLOAT}.get(kind, TURN)
    )
    t.moved += [how, own, above, int(t.bodies.tree[body, 2]), t.numbers(r.T, p)]
    m, first = t.mesh.mechanism, int(t.mesh.v_index[t.bodies.node[body]])
    for j, to in enumerate(_kept(kind)):
        t.keeps += [int(t.bodies.columns[m.nq + m.nv + first + j]), own + to]
    return own


def _kept(kind: int) -> list[int]:
    """Where, in a body's rows, the accelerations of its joint are kept."""
    linear, turning = ([int(at) + j * BLOCK for j in range(3)] for at in (KEPT, KEPT_TURNING))
    return {SPHERICAL: turning, FREE: linear + turning}.get(kind, linear[:1])


def _closure(t: _Tables, rows: Rows, own: NDArray[np.int64]) -> None:
    """A closure of two ends: the bodies between them, its record, its columns."""
    k = own[0]
    (a, ra, xa), (b, rb, xb) = _seated(t, int(rows.a[k])), _seated(t, int(rows.b[k]))
    parents = t.bodies.tree[:, 1]
    way_a, way_b = _path(parents, a), _path(parents, b)
    root = next(i for i in way_a if i in way_b)
    way_a, way_b = way_a[: way_a.index(root)], way_b[: way_b.index(root)]
    if not (way_a or way_b):
        return  # both ends on one body: nothing moves
    _root(t, root, (way_b, way_a))
    ends = [t.own[root, root] if i == root else _moving(t, root, i) for i in (a, b)]
    ra, xa = (t.turned[root, a] @ x for x in (ra, xa))
    rb, xb = (t.turned[root, b] @ x for x in (rb, xb))
    positions = [r for r in own if not rows.direction[r]]
    directions = [r for r in own if rows.direction[r]]
    whole = len(positions) == 3
    vectors = [] if whole else [ra @ rows.u[r] for r in positions]
    vectors += [v for r in directions for v in (ra @ rows.u[r], rb @ rows.w[r])]
    scale = 1.0 / t.mesh.length**2 if whole else 1.0 / t.mesh.length
    places = xa + ra @ rows.place_a[k], xb + rb @ rows.place_b[k]
    first = t.rows(CLOSURE_ROWS + 3 * (len(directions) + (0 if whole else len(positions))))
    fixed, columns = t.numbers(*places, scale, *vectors), len(t.columns) // int(COLUMN_CELLS)
    counts = (0 if whole else len(positions), len(directions))
    for way, sign in ((way_a, -1.0), (way_b, 1.0)):
        signs = t.numbers(sign / t.mesh.length, sign)
        for body in way:
            _columns_of(t, t.own[root, body], body, first, counts, signs, [*positions, *directions])
    count = len(t.columns) // int(COLUMN_CELLS) - columns
    t.closures += [WHOLE if whole else PARTIAL, first, *ends, fixed, *counts, columns, count]


def _columns_of(
    t: _Tables, body: int, number: int, closure: int, counts: tuple[int, int], signs: int, rows: list[np.int64]
) -> None:
    """The columns of one joint; ``body`` : where its rows stand."""
    kind, m = int(t.bodies.tree[number, 0]), t.mesh.mechanism
    axes = [body + int(at) for at in (AXES, AXIS_Y, AXIS_Z)]
    slides, turns = [(SLIDING, at) for at in axes], [(TURNING, at) for at in axes]
    single = {PRISMATIC: [(SLIDING, body + int(DIRECTION))], SPHERICAL: turns, FREE: slides + turns}.get(
        kind, turns[2:]
    )
    kept = _kept(kind)
    for j, (how, axis) in enumerate(single):
        v = int(t.mesh.v_index[t.bodies.node[number]]) + j
        to = t.rows(1 + len(rows))
        rate = int(t.bodies.columns[m.nq + v])
        t.columns += [how, axis, body + int(AT), closure, to, *counts, rate, body + kept[j], signs]
        _enter(t, v, to, rows)


def _enter(t: _Tables, v: int, to: int, rows: list[np.int64]) -> None:
    t.sizes.setdefault(v, []).append(to)
    for i, row in enumerate(rows):
        t.matrix[int(row), v] = to + int(ENTRIES) + i * BLOCK


def _coupling(t: _Tables, rows: Rows, row: int) -> None:
    """A coupling: its record, a column for each coordinate."""
    m, columns, first = t.mesh.mechanism, len(t.columns) // int(COLUMN_CELLS), t.rows(CLOSURE_ROWS)
    coupled = np.flatnonzero(rows.gear[row])
    for v in coupled:
        place, rate, second = (int(t.bodies.columns[i]) for i in (rows.place[v], m.nq + v, m.nq + m.nv + v))
        to, kept = t.rows(2), t.rows(1)
        t.keeps += [second, kept]
        t.columns += [GEARED, place, 0, first, to, 0, 0, rate, kept, t.numbers(rows.gear[row, v], 0.0)]
        _enter(t, int(v), to, [np.int64(row)])
    t.closures += [COUPLED, first, first, first, t.numbers(rows.offset[row]), 1, 0, columns, len(coupled)]


def planned(
    mesh: Mesh, b: Bodies, rows: Rows, limits: tuple[float, float, float], run: Callable[[LoopPlan], Array]
) -> LoopPlan | None:
    """Return the plan [any unit] of a mechanism, None where drives are too few or none can be found.

    run : the work space of a block with `PLACES` samples, whose joints stand anywhere, after the kernel without steps
    """
    m = mesh.mechanism
    passive, drives = (np.flatnonzero(which).tolist() for which in (~m.actuated, m.actuated))
    every = np.ones(len(rows), dtype=bool)
    kept = np.asarray(_matrix(tables(mesh, b, rows, limits, every), run).any(axis=(0, 2)))
    plan = tables(mesh, b, rows, limits, kept)
    g = _matrix(plan, run)
    where = np.abs(g).any(axis=0) & (plan.matrix > 0)
    rank = int(np.linalg.matrix_rank(g[0])) if g[0].size else 0
    if rank < len(passive) or not drives:
        return None
    size, fixed = plan.size, [*plan.fixed.tolist(), *m.weights[m.actuated].tolist()]

    def take() -> int:
        nonlocal size
        size += BLOCK
        return size - BLOCK

    unmoved = ~(plan.matrix > 0).any(axis=1)
    if np.abs(_constant(mesh, rows)[unmoved]).max(initial=0.0) > CLEARLY * limits[0]:
        return None  # what no joint moves is not in the tables, and is open
    patterns = [{int(c): int(plan.matrix[r, c]) for c in np.flatnonzero(where[r])} for r in range(len(rows))]
    e = Elimination(patterns, g[0].copy(), plan.sizes, take)
    effort = [int(i) for i in b.columns[m.nq + m.nv :]]
    beyond = min(rank - len(passive), len(drives) - 1)
    if not sharing(e, effort, passive, drives, beyond, len(plan.fixed)):
        return None
    words = plan.plan.copy()
    words[PLANE] = 1 if _is_plane(plan, CLEARLY * limits[0] * mesh.length) else 0
    words[STEPS], words[STEPS + 1] = len(words), e.count
    words[FILLS], words[FILLS + 1] = len(words) + len(e.words), len(e.fills)
    whole = np.concatenate([words, np.array(e.words + e.fills, dtype=np.uint64)])
    return LoopPlan(whole, np.array(fixed), size, plan.matrix, plan.sizes)


def _constant(mesh: Mesh, rows: Rows) -> Array:
    """phi (rows,) over its scale [-], where the joints stand anywhere."""
    m = mesh.mechanism
    rest = np.zeros((1, m.nv))
    phi: Array = residuals(rigid_motion(mesh, anywhere(m, 1), rest, rest), rows)[0][0]
    return phi / np.where(rows.direction, 1.0, mesh.length)


def _is_plane(plan: LoopPlan, most: float) -> bool:
    """Whether joints of loops turn about z or slide across it, closures keep three positions, open by so much along z [m]."""
    words, height = [int(i) for i in plan.plan], dict[int, float]()
    for i in range(words[ROOTS + 1]):
        height[words[words[ROOTS] + 2 * i]] = 0.0
    for i in range(words[BODIES + 1]):
        how, own, above, _, at = words[words[BODIES] + 5 * i :][:5]
        r, p = plan.fixed[at : at + 9].reshape(3, 3).T, plan.fixed[at + 9 : at + 12]
        off = abs(r[2, 2]) if how == SLIDE else np.abs(r[2] - [0, 0, 1]).max()  # what is not in the plane
        if how not in (ROOT_TURN, TURN, SLIDE) or off > ZERO:
            return False
        height[own] = height[above] + p[2]
    for i in range(words[CLOSURES + 1]):
        kind, _, a, b, at, _, directions = words[words[CLOSURES] + int(CLOSURE_CELLS) * i :][:7]
        if kind == COUPLED:
            continue
        gap = height[b] + plan.fixed[at + 5] - height[a] - plan.fixed[at + 2]
        if kind != WHOLE or directions or abs(gap) > most:
            return False
    return bool(height)


def _matrix(plan: LoopPlan, run: Callable[[LoopPlan], Array]) -> Array:
    """G (places, rows, nv), rounding taken for zero."""
    work = run(plan)
    g = np.stack([np.where(plan.matrix > 0, work[plan.matrix + k], 0.0) for k in range(PLACES)])
    return np.where(np.abs(g) > ZERO * np.abs(g).max(initial=0.0), g, 0.0)


def anywhere(m: Mechanism, count: int) -> Array:
    """Return coordinates (count, nq) [rad], [m] of joints that stand anywhere, the same ones every time."""
    random = np.random.default_rng(1)
    q = random.uniform(-1.0, 1.0, (count, m.nq))
    for joint in m.joints:
        own = q[:, m.q_slices[joint.name]]
        if joint.kind in ("continuous", "spherical", "free"):
            turn = own[:, 3:] if joint.kind == "free" else own
            turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return q
