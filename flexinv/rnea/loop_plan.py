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
from numpy.typing import NDArray

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
from flexinv.typing import Array

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
    passive, drives = (np.flatnonzero(which).tolist() for which in (~m.actuated, m.actuated))
    first = build_loop_tables(mesh, candidates[1], rows, limits, np.ones(len(rows.closure), dtype=bool))
    unit = list_velocity_scales(mesh) / rows.scale[:, None]  # of lengths over the mechanism's
    g = _compute_scaled_jacobian(first, unit, lambda plan: run(candidates[1], plan))
    rank = int(count_ranks(np.linalg.svd(unit * g[0], compute_uv=False))) if g[0].size else 0
    if rank < len(passive) or not drives:
        return None
    unmoved = ~(first.matrix > 0).any(axis=1) | (rows.direction & ~g.any(axis=(0, 2)))
    rest = np.zeros((1, m.nv))
    phi = (
        evaluate_closures(mesh, compute_rigid_motion(mesh, sample_configurations(m, 1), rest, rest), rows)[0][0, :, 0]
        / rows.scale
    )
    if np.abs(phi[unmoved]).max(initial=0.0) > CLEARLY * limits[0]:
        return None  # what no joint moves is not in the tables, and is open
    kept = np.asarray(g.any(axis=(0, 2)))
    flat = all(body.kind in FLAT for body in first.bodies)
    b = candidates[0]
    pairs = dict[int, tuple[int, int]]()
    plan = build_loop_tables(mesh, b, rows, limits, kept, plane=True) if flat else first
    if plan is first or not _is_plane(plan, CLEARLY * limits[0] * mesh.length):
        b = candidates[1]
        pairs = _find_universal_pairs(m, rows, g)
        plan = build_loop_tables(mesh, b, rows, limits, kept, pairs=pairs)
    taken = {v for pair in pairs.values() for v in pair}
    left = [v for v in passive if v not in taken], drives, min(rank - len(passive), len(drives) - 1)
    found = _add_steps(plan, _compute_scaled_jacobian(plan, unit, lambda plan: run(b, plan)), b, m, left)
    first_row = {int(c): int(np.argmax(rows.closure == c)) for c in np.unique(rows.closure)}
    names = (f"{m.closures[c].name}.{k - first_row[c]}" for k, c in enumerate(rows.closure.tolist()))
    return None if found is None else (b, replace(found, rows=tuple(names)))


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
        own = rows.closure == closure
        if own.sum() != 3 or rows.direction[own].any() or rows.gear[own].any():
            continue
        for joint in mechanism.joints:
            if joint.kind == "universal" and not joint.actuated:
                one = mechanism.v_slices[joint.name].start
                both = [one, one + 1]
                if g[:, own][:, :, both].any(axis=(0, 1)).all() and not g[:, ~own][:, :, both].any():
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


def _compute_scaled_jacobian(plan: LoopPlan, unit: Array, run: Callable[[LoopPlan], Array]) -> Array:
    """G (places, rows, nv), rounding taken for zero; unit : (rows, nv) what makes lengths numbers."""
    work = run(plan)
    g = np.stack([np.where(plan.matrix > 0, work[plan.matrix + k], 0.0) for k in range(PLACES)])
    size = np.abs(g) * unit
    return np.where(size > ZERO_ENTRY * size.max(initial=0.0), g, 0.0)


def sample_configurations(mechanism: Mechanism, count: int) -> Array:
    """Return coordinates (count, nq) [rad], [m] of joints that stand anywhere, the same ones every time."""
    random = np.random.default_rng(1)
    q = random.uniform(-1.0, 1.0, (count, mechanism.nq))
    for joint in mechanism.joints:
        own = q[:, mechanism.q_slices[joint.name]]
        if joint.kind in ("continuous", "spherical", "free"):
            turn = own[:, 3:] if joint.kind == "free" else own
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
    places: NDArray[np.int64]
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
    e = elimination
    left = [r for r, row in enumerate(elimination.rows) if row]
    if not beyond and _is_six_by_six(e, left, passive, effort):
        at = e.take(SIX_ROWS)
        sizes = [(e.sizes[c][0], 0) for c in passive]
        e.steps.append(Step(Operation.ALL_SIX, e.rows[left[0]][passive[0]], effort[passive[0]], at, sizes))
        for i, r in enumerate(left):
            driven = [(entry, effort[c]) for c, entry in sorted(e.rows[r].items()) if c in drives]
            e.steps.append(Step(Operation.TAKE, third=at + i * BLOCK, pairs=driven))
        return True
    order = sorted(passive, reverse=True)
    solved = list[tuple[int, int]]()
    against = list[int]()
    while order:
        column = min(order, key=lambda c: _compute_pivot_cost(e, left, c))
        pivot = e.plan_elimination(column, left)
        if pivot is None:
            return False
        order.remove(column)
        left.remove(pivot)
        solved.append((column, pivot))
    for _ in range(beyond):
        column = max(drives, key=lambda c: float(np.abs(e.numbers[left, c]).max(initial=0.0)))
        pivot = e.plan_elimination(column, left)
        if pivot is None:
            return False
        left.remove(pivot)
        against.append(pivot)
        e.steps.append(Step(Operation.CHECK_PIVOT, e.rows[pivot][column], e.sizes[column][0]))
    for r in left:
        for c, entry in e.rows[r].items():
            for size in e.sizes[c]:
                e.steps.append(Step(Operation.CHECK_EMPTY, entry, size))
    for column, pivot in solved:
        others = [(entry, effort[c]) for c, entry in sorted(e.rows[pivot].items()) if c != column]
        e.steps.append(Step(Operation.SOLVE, e.rows[pivot][column], effort[column], e.sizes[column][0], others))
    _plan_projection(e, effort, against, drives, weights)
    return True


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
    own = [elimination.rows[r] for r in left if column in elimination.rows[r]]
    return len(own), sum(len(row) for row in own)


def _plan_projection(
    elimination: Elimination, effort: Sequence[int], against: list[int], drives: list[int], weights: int
) -> None:
    """Take from the efforts, row by row, what drives do against each other; Gram's and Schmidt's modified order."""
    e = elimination
    rows = [elimination.rows[r] for r in against]
    for row in rows:
        row.update({c: e.add_zero_entry() for c in drives if c not in row})
    targets = [[row[c] for c in drives] for row in rows]
    for i, own in enumerate(targets):
        e.steps.append(Step(Operation.NORM, second=weights, pairs=[(at, at) for at in own]))
        for target in ([effort[c] for c in drives], *targets[i + 1 :]):
            pairs = list(zip(own, target, strict=True))
            e.steps.append(Step(Operation.INNER, second=weights, pairs=pairs))
            e.steps.append(Step(Operation.PROJECT, pairs=pairs))
