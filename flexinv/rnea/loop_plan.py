"""Closed loops as the plan that kernels follow, made once for a mechanism.

Entries of G are analytic functions of the coordinates: those that vanish where the joints stand anywhere vanish everywhere, and
so do whole rows, as those of a loop in the plane that keep it there.  They are found from the kernel's own numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexinv.constraints.allocation import ranks
from flexinv.constraints.closures import Rows, closed_rows, measures
from flexinv.kernels.simd import BLOCK
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.rigid_motion import rigid_motion
from flexinv.model.mechanism import Mechanism
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.body_table import Bodies, carriers
from flexinv.rnea.elimination_order import Elimination, order_of, sharing
from flexinv.rnea.loop_tables import CLEARLY, LoopPlan, tables
from flexinv.typing import Array

# An entry below this part of the largest one, at places where joints stand anywhere, is zero: rounding of some tens of sums.
ZERO = 1e-13
# Samples at which it is looked for.
PLACES = 4

NO_LOOPS = LoopPlan(np.zeros(layout.HEADER, dtype=np.uint64), np.zeros(4), 0, np.zeros((0, 0), dtype=np.int64), {})
Run = Callable[[Bodies, LoopPlan], Array]


def ends(mesh: Mesh, rows: Rows) -> frozenset[int]:
    """Return the nodes [-] whose bodies closures end at, -1 the world: how they accelerate is looked at (`loop_space`)."""
    closed = ~rows.gear.any(axis=1)
    nodes = np.concatenate([rows.a[closed], rows.b[closed]])
    return frozenset(int(carriers(mesh)[0][n]) if n >= 0 else -1 for n in nodes)


def planned(
    mesh: Mesh, candidates: tuple[Bodies, Bodies], rows: Rows, limits: tuple[float, float, float], run: Run
) -> tuple[Bodies, LoopPlan] | None:
    """Return the bodies and the plan [any unit] of a mechanism, None with too few drives or where none can be found.

    candidates : bodies for a mechanism in the plane, and those that keep how the `ends` of closures accelerate
    run : the work space of a block with `PLACES` samples, whose joints stand anywhere, after the kernel without steps
    """
    m = mesh.mechanism
    passive, drives = (np.flatnonzero(which).tolist() for which in (~m.actuated, m.actuated))
    first = tables(mesh, candidates[1], rows, limits, np.ones(len(rows), dtype=bool))
    unit = measures(mesh) / rows.scale[:, None]  # of lengths over the mechanism's
    g = _matrix(first, unit, lambda plan: run(candidates[1], plan))
    rank = int(ranks(np.linalg.svd(unit * g[0], compute_uv=False))) if g[0].size else 0
    if rank < len(passive) or not drives:
        return None
    unmoved = ~(first.matrix > 0).any(axis=1) | (rows.direction & ~g.any(axis=(0, 2)))
    if np.abs(_constant(mesh, rows)[unmoved]).max(initial=0.0) > CLEARLY * limits[0]:
        return None  # what no joint moves is not in the tables, and is open
    kept = np.asarray(g.any(axis=(0, 2)))
    flat = all(body.kind not in (layout.FLOAT, layout.SCREW) for body in first.bodies)
    b, pairs = candidates[0], dict[int, tuple[int, int]]()
    plan = tables(mesh, b, rows, limits, kept, plane=True) if flat else first
    if plan is first or not _is_plane(plan, CLEARLY * limits[0] * mesh.length):
        b, pairs = candidates[1], _pairs(m, rows, g)
        plan = tables(mesh, b, rows, limits, kept, pairs=pairs, order=order_of(g[0][kept], passive))
    taken = {v for pair in pairs.values() for v in pair}
    left = [v for v in passive if v not in taken], drives, min(rank - len(passive), len(drives) - 1)
    found = _with_steps(plan, _matrix(plan, unit, lambda plan: run(b, plan)), b, m, left)
    return None if found is None else (b, replace(found, rows=_row_names(m, rows)))


def _with_steps(
    plan: LoopPlan, g: Array, bodies: Bodies, mechanism: Mechanism, left: tuple[list[int], list[int], int]
) -> LoopPlan | None:
    """The plan with the order in which rows are combined; left : passive coordinates, drives, rows beyond."""
    where = np.abs(g).any(axis=0) & (plan.matrix > 0)
    size, fixed = plan.size, [*plan.fixed.tolist(), *mechanism.weights[mechanism.actuated].tolist()]

    def take(count: int) -> int:
        nonlocal size
        size += count * BLOCK
        return size - count * BLOCK

    patterns = [{int(c): int(plan.matrix[r, c]) for c in np.flatnonzero(where[r])} for r in range(len(g[0]))]
    e = Elimination(
        patterns, g[0].copy(), plan.matrix, plan.sizes, take, int(plan.plan[layout.SCRATCH]), constant=plan.constant
    )
    effort = [int(i) for i in bodies.columns[mechanism.nq + mechanism.nv :]]
    if not sharing(e, effort, *left, len(plan.fixed)):
        return None
    words, steps = plan.plan.copy(), [word for step in e.steps for word in step.words]
    words[layout.APPLIED] = 1 if mechanism.springs or mechanism.forces else 0
    words[layout.STEPS : layout.STEPS + 2] = len(words), len(e.steps)
    words[layout.FILLS : layout.FILLS + 2] = len(words) + len(steps), len(e.fills)
    whole = np.concatenate([words, np.array(steps + e.fills, dtype=np.uint64)])
    found = replace(plan, plan=whole, fixed=np.array(fixed), size=size, effort=tuple(effort))
    return replace(found, coordinates=mechanism.velocity_names, steps=tuple(e.steps))


def _row_names(mechanism: Mechanism, rows: Rows) -> tuple[str, ...]:
    """Names of the equations: that of the closure, and the number of the equation in it."""
    first = {int(c): int(np.argmax(rows.closure == c)) for c in np.unique(rows.closure)}
    return tuple(f"{mechanism.closures[int(c)].name}.{k - first[int(c)]}" for k, c in enumerate(rows.closure))


def _pairs(mechanism: Mechanism, rows: Rows, g: Array) -> dict[int, tuple[int, int]]:
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


def _constant(mesh: Mesh, rows: Rows) -> Array:
    """phi (rows,) over its scale [-], where the joints stand anywhere."""
    m = mesh.mechanism
    rest = np.zeros((1, m.nv))
    phi, _ = closed_rows(mesh, rigid_motion(mesh, anywhere(m, 1), rest, rest), rows)
    return np.asarray(phi[0, :, 0] / rows.scale)


def _is_plane(plan: LoopPlan, most: float) -> bool:
    """Return True if joints turn about z or slide across it and closures, at most ``most`` open along z [m], hold points."""
    words, height = [int(i) for i in plan.plan], dict[int, float]()
    for i in range(words[layout.ROOTS + 1]):
        height[words[words[layout.ROOTS] + 2 * i]] = 0.0
    for body in plan.bodies:
        r, p = plan.fixed[body.constants :][:9].reshape(3, 3).T, plan.fixed[body.constants + 9 :][:3]
        # what is not in the plane
        off = abs(r[2, 2]) if body.kind == layout.SLIDE else np.abs(r[2] - [0, 0, 1]).max()
        if body.kind not in (layout.ROOT_TURN, layout.TURN, layout.SLIDE) or off > ZERO:
            return False
        height[body.own] = height[body.above] + p[2]
    for c in plan.closures:
        if c.kind == layout.COUPLED:
            continue
        gap = height[c.axes_b] + plan.fixed[c.numbers + 5] - height[c.axes_a] - plan.fixed[c.numbers + 2]
        if c.kind != layout.WHOLE or c.directions or abs(gap) > most:
            return False
    return bool(height)


def _matrix(plan: LoopPlan, unit: Array, run: Callable[[LoopPlan], Array]) -> Array:
    """G (places, rows, nv), rounding taken for zero; unit : (rows, nv) what makes lengths numbers."""
    work = run(plan)
    g = np.stack([np.where(plan.matrix > 0, work[plan.matrix + k], 0.0) for k in range(PLACES)])
    size = np.abs(g) * unit
    return np.where(size > ZERO * size.max(initial=0.0), g, 0.0)


def anywhere(mechanism: Mechanism, count: int) -> Array:
    """Return coordinates (count, nq) [rad], [m] of joints that stand anywhere, the same ones every time."""
    random = np.random.default_rng(1)
    q = random.uniform(-1.0, 1.0, (count, mechanism.nq))
    for joint in mechanism.joints:
        own = q[:, mechanism.q_slices[joint.name]]
        if joint.kind in ("continuous", "spherical", "free"):
            turn = own[:, 3:] if joint.kind == "free" else own
            turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return q
