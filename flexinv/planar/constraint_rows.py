"""Constraints in a plane: the rows of `dynamics.constraint_rows` that say something there, a border beside the tree (compiled).

With S(theta) a turn in the plane, J (a, b) = (-b, a), arms r = S p and d = x_B + r_B - x_A - r_A, all in the plane's axes:

    position   phi = S_A u . d          direction   phi = S_A u . S_B w

and g the gradient of phi by x, y, theta of both nodes.  The border's factors last as long as the linearisation of the tree.
"""

from __future__ import annotations

from flexinv.dynamics.constraint_rows import DIRECTION, compute_border_factors
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.simd import cos_sin_unfused
from flexinv.kernels.vec3 import ZERO, dot, put_pair, vec, vec_at
from flexinv.planar.tree import read_node_motion
from flexinv.planar.tree_solver import solve_part


@jit_inner
def _read_angle(frames, n):
    """Cosine and sine of how far node n has turned."""
    return cos_sin_unfused(frames.pose[n, 2]) if n >= 0 else (1.0, 0.0)


@jit_inner
def _apply_rotation(angle, v):
    """A vector that is fixed in a node, in the plane's axes."""
    c, s = angle
    return c * v[0] - s * v[1], s * v[0] + c * v[1]


@jit_inner
def _compute_rates(r, spin, change):
    """A vector that turns, with its two rates: r, w J r, al J r - w^2 r."""
    square = spin * spin
    return r, (-spin * r[1], spin * r[0]), (-change * r[1] - square * r[0], change * r[0] - square * r[1])


@jit_inner
def _compute_gap(x, y, arm_a, arm_b, order):
    """d or one of its rates."""
    p = x[order]
    q = y[order]
    return q[0] + arm_b[order][0] - p[0] - arm_a[order][0], q[1] + arm_b[order][1] - p[1] - arm_a[order][1]


@jit_inner
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1]


@jit_inner
def evaluate_ties(constraints, frames, rated):
    """Set value and gradient of every constraint [m], [-]: phi, or where ``rated`` phi'' = u''.w + 2 u'.w' + u.w''."""
    on_a = (1.0, 0.0)
    on_b = (1.0, 0.0)
    for r in range(len(constraints.a)):
        if r == 0 or constraints.a[r] != constraints.a[r - 1] or constraints.b[r] != constraints.b[r - 1]:
            on_a = _read_angle(frames, constraints.a[r])
            on_b = _read_angle(frames, constraints.b[r])
        if not constraints.acting[r]:
            constraints.value[r] = 0.0
            put_pair(constraints.gradient[r], ZERO, ZERO)
            continue
        x = read_node_motion(frames, constraints.a[r])
        y = read_node_motion(frames, constraints.b[r])
        u = _compute_rates(_apply_rotation(on_a, constraints.u[r]), x[1][2], x[2][2])
        if constraints.kind[r] == DIRECTION:
            w = _compute_rates(_apply_rotation(on_b, constraints.w[r]), y[1][2], y[2][2])
            _write_direction_gradient(constraints.gradient[r], u[0], w[0])
        else:
            arm_a = _compute_rates(_apply_rotation(on_a, constraints.place_a[r]), x[1][2], x[2][2])
            arm_b = _compute_rates(_apply_rotation(on_b, constraints.place_b[r]), y[1][2], y[2][2])
            ends = x, y, arm_a, arm_b
            w = _compute_gap(*ends, 0), _compute_gap(*ends, 1), _compute_gap(*ends, 2)
            _write_position_gradient(constraints.gradient[r], u[0], w[0], arm_a[0], arm_b[0])
        constraints.value[r] = _dot(u[2], w[0]) + 2 * _dot(u[1], w[1]) + _dot(u[0], w[2]) if rated else _dot(u[0], w[0])


@jit_inner
def _write_direction_gradient(gradient, u, w):
    """Of u . w by both angles: J u . w."""
    across = u[0] * w[1] - u[1] * w[0]
    put_pair(gradient, (0.0, 0.0, across), (0.0, 0.0, -across))


@jit_inner
def _write_position_gradient(gradient, u, d, p, q):
    """Of u . d by the poses of both nodes, from which the arms p and q go to the points."""
    u1, u2 = u
    across = u1 * d[1] - u2 * d[0]
    put_pair(gradient, (-u1, -u2, across - (u2 * p[0] - u1 * p[1])), (u1, u2, u2 * q[0] - u1 * q[1]))


@jit_inner
def fill_right_sides(tree, constraints, frames, residual):
    """Put -A, less the gradients by the unknowns, into ``across`` and the right sides 1.. of the solve [-], [m]."""
    plan = constraints.layout
    for r in range(len(constraints.a)):
        side = constraints.across[r]
        gradient = constraints.gradient[r]
        for n in range(plan.first_part[r], plan.first_part[r + 1]):
            for i in range(plan.begin[n], plan.end[n]):
                side[i] = 0.0
        for n, g in ((constraints.a[r], vec(gradient)), (constraints.b[r], vec_at(gradient, 3))):
            for c in range(tree.width[n] if n >= 0 else 0):
                side[tree.first[n] + c] -= dot(g, vec(frames.by_pose[n, c]))
        for n in range(plan.first_part[r], plan.first_part[r + 1]):
            for i in range(plan.begin[n], plan.end[n]):
                residual[1 + r, i] = side[i]


@jit_inner
def compute_tie_factors(system):
    """Find K^-1 C, rows 1.. of work.y, and the factors of the border with a new linearisation [m/N], [rad/N]."""
    ties = system.ties
    plan = system.ties.layout
    work = system.work
    fill_right_sides(system.tree, ties, system.frames, work.residual)
    for part in range(len(plan.first_side) - 1):
        for side in plan.side[plan.first_side[part] + 1 : plan.first_side[part + 1]]:
            solve_part(system.tree, system.elements, system.factors, part, work.residual[side], work.y[side])
    compute_border_factors(ties, plan.blocks, work.y)
