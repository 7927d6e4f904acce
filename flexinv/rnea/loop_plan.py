"""Closed loops as the plan that kernels follow, made once for a mechanism.

Entries of G are analytic functions of the coordinates: those that vanish where the joints stand anywhere vanish everywhere, and
so do whole rows, as those of a loop in the plane that keep it there.  They are found from the kernel's own numbers.

Rows of G are combined in an order that is the same for all samples (`loop_allocation`).  Passive coordinates go one after the
other, first those in fewest rows; the pattern of what may be other than zero is carried along, with the numbers of one sample
beside it, which say where a pivot can be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from flexinv.constraints.allocation import count_ranks
from flexinv.constraints.closures import Rows, evaluate_closures, list_velocity_scales
from flexinv.kernels.simd import BLOCK
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import Mechanism
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.body_table import Bodies, find_carrier_nodes
from flexinv.rnea.loop_layout import SIX, SIX_ROWS, LoopPlan, Operation, Step
from flexinv.rnea.loop_tables import CLEARLY, build_loop_tables
from flexinv.typing import Array, Indices, Mask

# An entry below this part of the largest one, at places where joints stand anywhere, is zero: rounding of some tens of sums.
ZERO_ENTRY = 1e-13
PLACES = 4  # samples at which it is looked for
# A pivot of the sample, whose joints stand anywhere, is above this part of the largest entry; without one there is no order.
PIVOT = 1e-6
# Bodies of joints that turn about one axis or slide: the formulas of the plane may know them.
FLAT = (layout.ROOT_TURN, layout.TURN, layout.TILT, layout.CHAIN, layout.TWO_TURNS, layout.SLIDE)

NO_LOOPS = LoopPlan(np.zeros(layout.HEADER, dtype=np.uint64), np.zeros(4), 0, np.zeros((0, 0), dtype=np.int64), {})
Run = Callable[[Bodies, LoopPlan], Array]


def list_closure_ends(mesh: Mesh, rows: Rows) -> frozenset[int]:
    """Return the nodes [-] whose bodies closures end at, -1 the world: how they accelerate is looked at (`loop_space`)."""
    closed = ~rows.gear.any(axis=1)
    nodes = np.concatenate([rows.a[closed], rows.b[closed]])
    return frozenset(int(find_carrier_nodes(mesh)[0][n]) if n >= 0 else -1 for n in nodes)


def plan_loops(
    mesh: Mesh, candidates: tuple[Bodies, Bodies], rows: Rows, limits: tuple[float, float, float], run: Run
) -> tuple[Bodies, LoopPlan] | None:
    """Return the bodies and the plan [any unit] of a mechanism, None with too few drives or where none can be found.

    candidates : bodies for a mechanism in the plane, and those that keep how the `list_closure_ends` of closures accelerate
    run : the work space of a block with `PLACES` samples, whose joints stand anywhere, after the kernel without steps
    """
    m = mesh.mechanism
    passive = np.flatnonzero(~m.actuated).tolist()
    drives = np.flatnonzero(m.actuated).tolist()
    first = build_loop_tables(mesh, candidates[1], rows, limits, np.ones(len(rows.closure), dtype=bool))
    unit = list_velocity_scales(mesh) / rows.scale[:, None]  # of lengths over the mechanism's
    g = _compute_scaled_jacobian(first, candidates[1], unit, run)
    rank = int(count_ranks(np.linalg.svd(unit * g[0], compute_uv=False))) if g[0].size else 0
    if rank < len(passive) or not drives:
        return None
    unmoved = ~(first.matrix > 0).any(axis=1) | (rows.direction & ~g.any(axis=(0, 2)))
    if _compute_largest_gap(mesh, rows, unmoved) > CLEARLY * limits[0]:
        return None  # what no joint moves is not in the tables, and is open
    bodies, plan, pairs = _choose_tables(mesh, candidates, rows, limits, (first, g))
    taken = {v for pair in pairs.values() for v in pair}
    left = [v for v in passive if v not in taken], drives, min(rank - len(passive), len(drives) - 1)
    found = _add_steps(plan, _compute_scaled_jacobian(plan, bodies, unit, run), bodies, m, left)
    return None if found is None else (bodies, replace(found, rows=_list_row_names(m, rows)))


def _add_steps(
    plan: LoopPlan, g: Array, bodies: Bodies, mechanism: Mechanism, left: tuple[list[int], list[int], int]
) -> LoopPlan | None:
    """The plan with the order in which rows are combined; left : passive coordinates, drives, rows beyond."""
    where = np.abs(g).any(axis=0) & (plan.matrix > 0)
    size = plan.size
    fixed = [*plan.fixed.tolist(), *mechanism.weights[mechanism.actuated].tolist()]

    def take(count: int) -> int:
        nonlocal size
        size += count * BLOCK
        return size - count * BLOCK

    patterns = [{int(c): int(plan.matrix[r, c]) for c in np.flatnonzero(where[r])} for r in range(len(g[0]))]
    e = Elimination(patterns, g[0].copy(), plan.matrix, plan.sizes, take, plan.constant)
    effort = [int(i) for i in bodies.columns[mechanism.nq + mechanism.nv :]]
    if not plan_effort_steps(e, effort, *left, len(plan.fixed)):
        return None
    words = plan.plan.copy()
    steps = [word for step in e.steps for word in step.words]
    words[layout.APPLIED] = 1 if mechanism.springs or mechanism.forces else 0
    words[layout.STEPS : layout.STEPS + 2] = len(words), len(e.steps)
    words[layout.FILLS : layout.FILLS + 2] = len(words) + len(steps), len(e.fills)
    whole = np.concatenate([words, np.array(steps + e.fills, dtype=np.uint64)])
    found = replace(plan, plan=whole, fixed=np.array(fixed), size=size, effort=tuple(effort))
    return replace(found, coordinates=mechanism.velocity_names, steps=tuple(e.steps))


def _find_universal_pairs(mechanism: Mechanism, rows: Rows, g: Array) -> dict[int, tuple[int, int]]:
    """For closures that hold a point and nothing else the two coordinates of a universal joint in no other, without a drive."""
    out = {}
    for closure in np.unique(rows.closure):
        members = rows.closure == closure
        if members.sum() != 3 or rows.direction[members].any() or rows.gear[members].any():
            continue
        for joint in mechanism.joints:
            if joint.kind == "universal" and not joint.actuated:
                one = mechanism.v_slices[joint.name].start
                both = [one, one + 1]
                if g[:, members][:, :, both].any(axis=(0, 1)).all() and not g[:, ~members][:, :, both].any():
                    out[int(closure)] = (one, one + 1)
    return out


def _is_plane(plan: LoopPlan, most: float) -> bool:
    """Return True if joints turn about z or slide across it and closures, at most ``most`` open along z [m], hold points."""
    first, count = plan.plan[layout.ROOTS : layout.ROOTS + 2].tolist()
    height = dict.fromkeys(plan.plan[first : first + 2 * count : 2].tolist(), 0.0)
    for body in plan.bodies:
        r = plan.fixed[body.constants :][:9].reshape(3, 3).T
        p = plan.fixed[body.constants + 9 :][:3]
        off = abs(r[2, 2]) if body.kind == layout.SLIDE else np.abs(r[2] - [0, 0, 1]).max()  # out of the plane
        if off > ZERO_ENTRY:
            return False
        height[body.offset] = height[body.above] + p[2]
    for c in plan.closures:
        if c.kind == layout.COUPLED:
            continue
        gap = height[c.axes_b] + plan.fixed[c.numbers + 5] - height[c.axes_a] - plan.fixed[c.numbers + 2]
        if c.kind != layout.WHOLE or c.directions or abs(gap) > most:
            return False
    return bool(height)


def _compute_largest_gap(mesh: Mesh, rows: Rows, some: Mask) -> float:
    """The largest gap of some rows where joints stand anywhere [-]."""
    q = sample_configurations(mesh.mechanism, 1)
    rest = np.zeros((1, mesh.mechanism.nv))
    phi = evaluate_closures(mesh, compute_rigid_motion(mesh, q, rest, rest), rows)[0][0, :, 0] / rows.scale
    return float(np.abs(phi[some]).max(initial=0.0))


def _choose_tables(
    mesh: Mesh,
    candidates: tuple[Bodies, Bodies],
    rows: Rows,
    limits: tuple[float, float, float],
    first: tuple[LoopPlan, Array],
) -> tuple[Bodies, LoopPlan, dict[int, tuple[int, int]]]:
    """Bodies and tables of the plane where all lies in one, else those of space, and the universal joints taken from closures.

    first : the tables of space with all rows, and G (places, rows, nv)
    """
    tables, g = first
    kept = np.asarray(g.any(axis=(0, 2)))
    if all(body.kind in FLAT for body in tables.bodies):
        plan = build_loop_tables(mesh, candidates[0], rows, limits, kept, plane=True)
        if _is_plane(plan, CLEARLY * limits[0] * mesh.length):
            return candidates[0], plan, {}
    pairs = _find_universal_pairs(mesh.mechanism, rows, g)
    return candidates[1], build_loop_tables(mesh, candidates[1], rows, limits, kept, pairs=pairs), pairs


def _list_row_names(mechanism: Mechanism, rows: Rows) -> tuple[str, ...]:
    """Names of the rows: those of their closures, and their number in it."""
    first = {int(c): int(np.argmax(rows.closure == c)) for c in np.unique(rows.closure)}
    return tuple(f"{mechanism.closures[c].name}.{k - first[c]}" for k, c in enumerate(rows.closure.tolist()))


def _compute_scaled_jacobian(plan: LoopPlan, bodies: Bodies, unit: Array, run: Run) -> Array:
    """G (places, rows, nv), rounding taken for zero; unit : (rows, nv) what makes lengths numbers."""
    work = run(bodies, plan)
    g = np.stack([np.where(plan.matrix > 0, work[plan.matrix + k], 0.0) for k in range(PLACES)])
    size = np.abs(g) * unit
    return np.where(size > ZERO_ENTRY * size.max(initial=0.0), g, 0.0)


def sample_configurations(mechanism: Mechanism, count: int) -> Array:
    """Return coordinates (count, nq) [rad], [m] of joints that stand anywhere, the same ones every time."""
    random = np.random.default_rng(1)
    q = random.uniform(-1.0, 1.0, (count, mechanism.nq))
    for joint in mechanism.joints:
        coordinates = q[:, mechanism.q_slices[joint.name]]
        if joint.kind in ("continuous", "spherical", "free"):
            turn = coordinates[:, 3:] if joint.kind == "free" else coordinates
            turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return q


@dataclass
class Elimination:
    """Rows as they are combined.

    rows : for each row, velocity coordinate -> where its entry stands in the work space [-]; numbers : (rows, nv) of a sample
    places : (rows, nv) where entries stand, those among them that are zero; 0 where there are none
    sizes : for each coordinate, where the squares of its column stand; constant : those of them that are
    take : finds room for so many rows more; steps : so far; fills : entries that are zero at first
    """

    rows: list[dict[int, int]]
    numbers: Array
    places: Indices
    sizes: dict[int, list[int]]
    take: Callable[[int], int]
    constant: frozenset[int] = frozenset()
    steps: list[Step] = field(default_factory=list)
    fills: list[int] = field(default_factory=list)

    def plan_elimination(self, column: int, among: list[int]) -> int | None:
        """Combine the rows ``among`` that have an entry in a column, until one of them has; return it [-], None without one.

        It is held against all sizes of the column but the first one, which is left to who solves for it.
        """
        candidates = sorted((r for r in among if column in self.rows[r]), key=lambda r: len(self.rows[r]))
        if not candidates or not np.abs(self.numbers[candidates, column]).max() > PIVOT * np.abs(self.numbers).max():
            return None
        pivot = candidates[0]
        one = self.rows[candidates[0]]
        n = self.numbers
        for other in candidates[1:]:
            two = self.rows[other]
            for row, missing, there in ((pivot, one, two), (other, two, one)):
                for c in there.keys() - missing.keys():
                    missing[c] = int(self.places[row, c]) or self.add_zero_entry()
            pairs = [(one[c], two[c]) for c in sorted(one, key=lambda c: one[c]) if c != column]
            self.steps.append(Step(Operation.PAIR, one[column], two.pop(column), pairs=pairs))
            if abs(n[other, column]) > abs(n[pivot, column]):
                n[[pivot, other]] = n[[other, pivot]]
            if n[pivot, column] != 0.0:
                n[other] -= n[other, column] / n[pivot, column] * n[pivot]
            n[other, column] = 0.0
        for size in self.sizes[column][1:]:
            self.steps.append(Step(Operation.CHECK_PIVOT, one[column], size))
        return pivot

    def add_zero_entry(self) -> int:
        """Return room for an entry that is zero at first [-]."""
        self.fills.append(self.take(1))
        return self.fills[-1]


def plan_effort_steps(
    elimination: Elimination, effort: Sequence[int], passive: list[int], drives: list[int], beyond: int, weights: int
) -> bool:
    """Write the steps [-] that share efforts out; return whether there are any that do.

    effort : (nv,) where efforts stand; beyond : how many rows drives have against each other; weights : where theirs stand
    """
    left = [r for r, row in enumerate(elimination.rows) if row]
    if not beyond and _is_six_by_six(elimination, left, passive, effort):
        _plan_six_forces(elimination, effort, left, passive, drives)
        return True
    solved = _plan_passive_rows(elimination, left, passive)
    if solved is None:
        return False
    against = _plan_drive_rows(elimination, left, drives, beyond)
    if against is None:
        return False
    e = elimination
    for r in left:
        for c, entry in e.rows[r].items():
            e.steps += [Step(Operation.CHECK_EMPTY, entry, size) for size in e.sizes[c]]
    for column, pivot in solved:
        others = [(entry, effort[c]) for c, entry in sorted(e.rows[pivot].items()) if c != column]
        e.steps.append(Step(Operation.SOLVE, e.rows[pivot][column], effort[column], e.sizes[column][0], others))
    _plan_projection(e, effort, against, drives, weights)
    return True


def _plan_six_forces(
    elimination: Elimination, effort: Sequence[int], left: list[int], passive: list[int], drives: list[int]
) -> None:
    """Solve for six forces on a free body at once, and take from the drives what these do."""
    e = elimination
    at = e.take(SIX_ROWS)
    sizes = [(e.sizes[c][0], 0) for c in passive]
    e.steps.append(Step(Operation.ALL_SIX, e.rows[left[0]][passive[0]], effort[passive[0]], at, sizes))
    for i, r in enumerate(left):
        driven = [(entry, effort[c]) for c, entry in sorted(e.rows[r].items()) if c in drives]
        e.steps.append(Step(Operation.TAKE, third=at + i * BLOCK, pairs=driven))


def _plan_passive_rows(elimination: Elimination, left: list[int], passive: list[int]) -> list[tuple[int, int]] | None:
    """Combine rows until each passive coordinate has one, which ``left`` loses: pairs (coordinate, row); None without one."""
    order = sorted(passive, reverse=True)
    solved = list[tuple[int, int]]()
    while order:
        column = min(order, key=lambda c: _compute_pivot_cost(elimination, left, c))
        pivot = elimination.plan_elimination(column, left)
        if pivot is None:
            return None
        order.remove(column)
        left.remove(pivot)
        solved.append((column, pivot))
    return solved


def _plan_drive_rows(elimination: Elimination, left: list[int], drives: list[int], beyond: int) -> list[int] | None:
    """Combine rows until so many say what drives do against each other, which ``left`` loses; None without one."""
    e = elimination
    against = list[int]()
    for _ in range(beyond):
        column = max(drives, key=lambda c: float(np.abs(e.numbers[left, c]).max(initial=0.0)))
        pivot = e.plan_elimination(column, left)
        if pivot is None:
            return None
        left.remove(pivot)
        against.append(pivot)
        e.steps.append(Step(Operation.CHECK_PIVOT, e.rows[pivot][column], e.sizes[column][0]))
    return against


def _is_six_by_six(elimination: Elimination, left: list[int], passive: list[int], effort: Sequence[int]) -> bool:
    """Return True if six rows and efforts of six passive coordinates are contiguous, constant in size, not singular."""
    sizes = [elimination.sizes[c] for c in passive]
    if not len(left) == len(passive) == SIX or any(len(s) != 1 or s[0] not in elimination.constant for s in sizes):
        return False
    first = elimination.rows[left[0]].get(passive[0], 0)
    entries = [elimination.rows[r].get(c, 0) - first for r in left for c in passive]
    efforts = [effort[c] - effort[passive[0]] for c in passive]
    values = np.linalg.svd(elimination.numbers[np.ix_(left, passive)], compute_uv=False)
    contiguous = (BLOCK * np.arange(SIX * SIX)).tolist()
    return entries == contiguous and efforts == contiguous[:SIX] and bool(values[-1] > PIVOT * values[0])


def _compute_pivot_cost(elimination: Elimination, left: list[int], column: int) -> tuple[int, int]:
    """Rows that have an entry in a column, and their entries."""
    filled_rows = [elimination.rows[r] for r in left if column in elimination.rows[r]]
    return len(filled_rows), sum(len(row) for row in filled_rows)


def _plan_projection(
    elimination: Elimination, effort: Sequence[int], against: list[int], drives: list[int], weights: int
) -> None:
    """Take from the efforts, row by row, what drives do against each other; Gram's and Schmidt's modified order."""
    e = elimination
    rows = [elimination.rows[r] for r in against]
    for row in rows:
        row.update({c: e.add_zero_entry() for c in drives if c not in row})
    targets = [[row[c] for c in drives] for row in rows]
    for i, source in enumerate(targets):
        e.steps.append(Step(Operation.NORM, second=weights, pairs=[(at, at) for at in source]))
        for target in ([effort[c] for c in drives], *targets[i + 1 :]):
            pairs = list(zip(source, target, strict=True))
            e.steps.append(Step(Operation.INNER, second=weights, pairs=pairs))
            e.steps.append(Step(Operation.PROJECT, pairs=pairs))
