"""Inverse dynamics of rigid trees, one sample a lane: motion outboard, wrenches inboard, all in the bodies' own frames.

With R = R_parent,body of the placement and the joint together, p the joint's place in the parent's frame and c = R^T w_parent:

    w = c + w_j               al = R^T al_parent + al_j + c x w_j
    a = R^T (a_parent + al_parent x p + w_parent x (w_parent x p)) + 2 c x v_j + v_j' + w_j x v_j,     a_world = -g
    F = m a + S h             N = h x a + axial(S Sigma)                S = skew(al) + skew(w)^2   (see `body_table`)

and from the leaves to the root  F_parent += R F,  N_parent += R N + p x R F.  A joint's effort is the component of F or N
along its axis, which is z, with what its rotor, damper, friction and spring take.

Along a chain the frames lie so that R = Rx(tilt) Rz(zero + q), as Denavit and Hartenberg's (`body_table`); where a branch begins
a constant rotation stands before that.  The *state* (w, al, a) is carried on in place: what body i leaves is that of the place p
of its last child's joint, a + S p; other children begin with a copy.

The tree is data: one machine code serves all mechanisms.  Each body has a few rows in the work space; its coordinates come in
there, its efforts go out of there.
"""

from __future__ import annotations

import math

import numpy as np

from flexinv.elements.joint_law import JointLaw, compute_joint_effort, compute_moving_effort, compute_resisting_effort
from flexinv.kernels import simd
from flexinv.kernels.jit import jit_lane, jit_lanes, jit_pass
from flexinv.kernels.simd import (
    LANES,
    apply_rotation_x,
    apply_rotation_z,
    into,
    plus,
    plus_cross,
    plus_out_of,
    put_vec,
    row,
    times,
    vec_of,
)
from flexinv.kernels.vec3 import mat_at, vec, vec_at
from flexinv.model.joint_kinds import CONTINUOUS, FREE, HELICAL, PRISMATIC, REVOLUTE, SPHERICAL

# Columns of the tables of bodies, and how many there are: see `body_table.Bodies`.
TREE_KIND, TREE_PARENT, TREE_ROWS, TREE_STATE, TREE_BEGINS, TREE_SOURCE, TREE = *range(6), np.uint64(6)
BODY_R = 0
BODY_P = 9
BODY_MASS = 12
BODY_MOMENT = 13
BODY_SECOND = 16
BODY_OFF_SECOND = 19
BODY_LAW = 22
BODY_TILT = 27
BODY_ZERO = 29
BODY_CHILD = 31
BODY_STEP = 34
BODY_LEAD = 37
NUMBERS = np.uint64(38)
# Rows of every body: force and moment that its parent exerts on it, and all beyond it, at its origin.
FORCE = row(0)
MOMENT = row(3)
MOMENT_Z = row(5)
# of a body that turns or slides: coordinate, its cosine and sine, rate; acceleration, which becomes the effort
PLACE = row(6)
COS = row(7)
SIN = row(8)
RATE = row(9)
EFFORT = row(10)
SCALAR_ROWS = 11
# of a spherical or free one: R_j (its quaternion, before), position, rates v, w, accelerations, which become the efforts
TURN_OF = row(6)
TURN_Y = row(9)
TURN_Z = row(12)
SHIFT = row(15)
QUATERNION = TURN_OF
SCALAR_OF_QUATERNION = row(9)
RATES_FREE = row(18)
RATES_TURNING = row(21)
EFFORTS_FREE = row(24)
EFFORTS_TURNING = row(27)
FREE_ROWS = 30
# rows of a state
SPIN = row(0)
SPIN_RATE = row(3)
ACCELERATION_ROW = row(6)
STATE_ROWS = 9
_NONE = (0.0, 0.0, 0.0)
# How a body's state begins: where its parent left it, the same turned by a constant rotation, a turned copy, in the world.
ON, TURNED, COPIED, FROM_WORLD = range(4)


@jit_lanes
def _sign(x):
    return (1.0 if x > 0.0 else 0.0) - (1.0 if x < 0.0 else 0.0)


@jit_lanes
def _read_inertia(body):
    """m, h, Sigma: (xx, yy, zz), (xy, xz, yz), and p of the last child's joint, of a body as `body_table.Bodies` has it."""
    h = vec_at(body, BODY_MOMENT)
    child = vec_at(body, BODY_CHILD)
    return body[BODY_MASS], h, vec_at(body, BODY_SECOND), vec_at(body, BODY_OFF_SECOND), child


@jit_lanes
def _read_joint_law(body):
    a = BODY_LAW
    return JointLaw(body[a], body[a + 1], body[a + 2], body[a + 3], body[a + 4])


@jit_lanes
def _read_tilt(body):
    return body[BODY_TILT], body[BODY_TILT + 1]


@jit_lanes
def _read_zero(body):
    return body[BODY_ZERO], body[BODY_ZERO + 1]


@jit_lanes
def read_state(state, k):
    """Return w, al and a [rad/s], [rad/s^2], [m/s^2]."""
    return vec_of(state, SPIN, k), vec_of(state, SPIN_RATE, k), vec_of(state, ACCELERATION_ROW, k)


@jit_lanes
def compute_acceleration_at(w, al, a, arm):
    """Return a + al x arm + w x (w x arm) [m/s^2]: the acceleration of another point of the same body."""
    return plus_cross(plus_cross(a, al, arm), w, plus_cross(_NONE, w, arm))


@jit_lanes
def _write_state_and_wrench(state, rows, k, w, al, a, leaving):
    """Leave the state of the place ``onward``, and F = m a + S h, N = h x a + axial(S Sigma) in the body's rows."""
    m, h, (sxx, syy, szz), (sxy, sxz, syz), onward = leaving
    xx = w[0] * w[0]
    yy = w[1] * w[1]
    zz = w[2] * w[2]
    x = (-yy - zz, w[0] * w[1] - al[2], w[0] * w[2] + al[1])  # rows of S
    y = (w[0] * w[1] + al[2], -xx - zz, w[1] * w[2] - al[0])
    z = (w[0] * w[2] - al[1], w[1] * w[2] + al[0], -xx - yy)
    force = plus_out_of(times(m, a), (x, y, z), h)
    n = plus_cross(_NONE, h, a)
    moment = (  # axial(S Sigma) = (zy - yz, xz - zx, yx - xy) of the product
        n[0] + z[0] * sxy + z[1] * syy + z[2] * syz - y[0] * sxz - y[1] * syz - y[2] * szz,
        n[1] + x[0] * sxz + x[1] * syz + x[2] * szz - z[0] * sxx - z[1] * sxy - z[2] * sxz,
        n[2] + y[0] * sxx + y[1] * sxy + y[2] * sxz - x[0] * sxy - x[1] * syy - x[2] * syz,
    )
    put_vec(state, SPIN, k, w)
    put_vec(state, SPIN_RATE, k, al)
    put_vec(state, ACCELERATION_ROW, k, plus_out_of(a, (x, y, z), onward))
    put_vec(rows, FORCE, k, force)
    put_vec(rows, MOMENT, k, moment)


@jit_lanes
def _compute_angles(rows, lanes):
    """Cosine and sine of the coordinate."""
    far = 0
    for k in range(lanes):
        angle = rows[PLACE + k]
        rows[COS + k], rows[SIN + k] = simd.cos_sin(angle)
        far += 1 if abs(angle) > simd.FAR_ANGLE else 0
    if far:
        for k in range(lanes):
            rows[COS + k], rows[SIN + k] = math.cos(rows[PLACE + k]), math.sin(rows[PLACE + k])


@jit_pass
def _turn_outboard(state, rows, lanes, body):
    """A body that turns about z."""
    ct, st = _read_tilt(body)
    c0, s0 = _read_zero(body)
    leaving = _read_inertia(body)
    law = _read_joint_law(body)
    for k in range(lanes):
        w, al, a = read_state(state, k)
        rate = rows[RATE + k]
        acceleration = rows[EFFORT + k]
        c = c0 * rows[COS + k] - s0 * rows[SIN + k]
        s = s0 * rows[COS + k] + c0 * rows[SIN + k]
        rows[COS + k] = c
        rows[SIN + k] = s
        w = apply_rotation_z(c, -s, apply_rotation_x(ct, -st, w))
        al = apply_rotation_z(c, -s, apply_rotation_x(ct, -st, al))
        a = apply_rotation_z(c, -s, apply_rotation_x(ct, -st, a))
        al = (al[0] + w[1] * rate, al[1] - w[0] * rate, al[2] + acceleration)  # + c x w_j + al_j, w_j = rate z
        w = (w[0], w[1], w[2] + rate)
        _write_state_and_wrench(state, rows, k, w, al, a, leaving)
        rows[EFFORT + k] = compute_moving_effort(law, rate, acceleration)


@jit_lanes
def _compute_slide_acceleration(w, al, a, place, rate, acceleration):
    """The acceleration where a slide ends: that of the point, + 2 c x v_j + v_j', v_j = rate z."""
    a = compute_acceleration_at(w, al, a, (0.0, 0.0, place))
    return a[0] + 2.0 * w[1] * rate, a[1] - 2.0 * w[0] * rate, a[2] + acceleration


@jit_pass
def _compute_slide_outboard(state, rows, lanes, body):
    """A body that slides along z."""
    leaving = _read_inertia(body)
    law = _read_joint_law(body)
    for k in range(lanes):
        w, al, a = read_state(state, k)
        rate = rows[RATE + k]
        acceleration = rows[EFFORT + k]
        a = _compute_slide_acceleration(w, al, a, rows[PLACE + k], rate, acceleration)
        _write_state_and_wrench(state, rows, k, w, al, a, leaving)
        rows[EFFORT + k] = compute_moving_effort(law, rate, acceleration)


@jit_lanes
def _apply_screw_advance(state, rows, lanes, body):
    """The advance of a screw along z, before it turns: the slide h q of a massless body, h = pitch / (2 pi)."""
    lead = body[BODY_LEAD]
    for k in range(lanes):
        a = _compute_slide_acceleration(
            *read_state(state, k), lead * rows[PLACE + k], lead * rows[RATE + k], lead * rows[EFFORT + k]
        )
        put_vec(state, ACCELERATION_ROW, k, a)


@jit_lanes
def _compute_orientations(rows, lanes, floats):
    """R_j of the quaternion, normalised first; a ball joint has no position and no linear rates."""
    for k in range(lanes):
        x, y, z = vec_of(rows, QUATERNION, k)
        w = rows[SCALAR_OF_QUATERNION + k]
        unit = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
        x = unit * x
        y = unit * y
        z = unit * z
        w = unit * w
        put_vec(rows, TURN_OF, k, (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)))
        put_vec(rows, TURN_Y, k, (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)))
        put_vec(rows, TURN_Z, k, (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
    if not floats:
        for k in range(lanes):
            put_vec(rows, SHIFT, k, _NONE)
            put_vec(rows, RATES_FREE, k, _NONE)
            put_vec(rows, EFFORTS_FREE, k, _NONE)


@jit_lanes
def read_orientation(rows, k):
    """Return R_j by rows [-]."""
    return vec_of(rows, TURN_OF, k), vec_of(rows, TURN_Y, k), vec_of(rows, TURN_Z, k)


@jit_pass
def _compute_float_outboard(state, rows, lanes, body):
    """A body that turns about its origin, which moves too; rates and accelerations are in its own frame."""
    leaving = _read_inertia(body)
    law = _read_joint_law(body)
    for k in range(lanes):
        rj = read_orientation(rows, k)
        v = vec_of(rows, RATES_FREE, k)
        wj = vec_of(rows, RATES_TURNING, k)
        dv = vec_of(rows, EFFORTS_FREE, k)
        alj = vec_of(rows, EFFORTS_TURNING, k)
        w, al, a = read_state(state, k)
        a = compute_acceleration_at(w, al, a, vec_of(rows, SHIFT, k))
        c = into(rj, w)
        al = plus_cross(plus(into(rj, al), alj), c, wj)
        a = plus_cross(plus(into(rj, a), dv), plus(times(2.0, c), wj), v)
        _write_state_and_wrench(state, rows, k, plus(c, wj), al, a, leaving)
    for j in range(6):
        rate = RATES_FREE + np.uint64(j) * LANES
        effort = EFFORTS_FREE + np.uint64(j) * LANES
        for k in range(lanes):
            v = rows[rate + k]
            rows[effort + k] = compute_joint_effort(law, law.rest, v, rows[effort + k], _sign(v))


@jit_lanes
def _add(above, k, p, force, moment):
    """Add to the parent what a wrench at the place p is at its origin."""
    put_vec(above, FORCE, k, plus(vec_of(above, FORCE, k), force))
    put_vec(above, MOMENT, k, plus_cross(plus(vec_of(above, MOMENT, k), moment), p, force))


@jit_pass
def _turn_inboard(rows, lanes, body):
    """The effort, and the wrench in the frame before the joint."""
    ct, st = _read_tilt(body)
    for k in range(lanes):
        c = rows[COS + k]
        s = rows[SIN + k]
        rows[EFFORT + k] += rows[MOMENT_Z + k]
        put_vec(rows, FORCE, k, apply_rotation_x(ct, st, apply_rotation_z(c, s, vec_of(rows, FORCE, k))))
        put_vec(rows, MOMENT, k, apply_rotation_x(ct, st, apply_rotation_z(c, s, vec_of(rows, MOMENT, k))))


@jit_pass
def _turn_on_inboard(rows, above, lanes, body):
    """The effort, and the wrench that the parent takes in its own frame."""
    ct, st = _read_tilt(body)
    p = vec_at(body, BODY_P)
    for k in range(lanes):
        c = rows[COS + k]
        s = rows[SIN + k]
        rows[EFFORT + k] += rows[MOMENT_Z + k]
        force = apply_rotation_x(ct, st, apply_rotation_z(c, s, vec_of(rows, FORCE, k)))
        _add(above, k, p, force, apply_rotation_x(ct, st, apply_rotation_z(c, s, vec_of(rows, MOMENT, k))))


@jit_pass
def _add_axial_effort(rows, lanes, lead):
    """Add the force along z to the effort of a slide or a screw, and bring the moment to where it begins."""
    for k in range(lanes):
        force = vec_of(rows, FORCE, k)
        moment = vec_of(rows, MOMENT, k)
        rows[EFFORT + k] += lead * force[2]
        put_vec(rows, MOMENT, k, plus_cross(moment, (0.0, 0.0, lead * rows[PLACE + k]), force))


@jit_pass
def _compute_float_inboard(rows, lanes):
    """The efforts, and the wrench before the joint."""
    for k in range(lanes):
        force = vec_of(rows, FORCE, k)
        moment = vec_of(rows, MOMENT, k)
        rj = read_orientation(rows, k)
        put_vec(rows, EFFORTS_FREE, k, plus(vec_of(rows, EFFORTS_FREE, k), force))
        put_vec(rows, EFFORTS_TURNING, k, plus(vec_of(rows, EFFORTS_TURNING, k), moment))
        force = plus_out_of(_NONE, rj, force)
        moment = plus_out_of(_NONE, rj, moment)
        put_vec(rows, FORCE, k, force)
        put_vec(rows, MOMENT, k, plus_cross(moment, vec_of(rows, SHIFT, k), force))


@jit_pass
def _add_wrench_to_parent(rows, above, lanes, body):
    """The wrench before the joint, which the parent takes in its own frame."""
    r = mat_at(body, BODY_R)
    p = vec_at(body, BODY_P)
    for k in range(lanes):
        force = vec_of(rows, FORCE, k)
        moment = vec_of(rows, MOMENT, k)
        _add(above, k, p, plus_out_of(_NONE, r, force), plus_out_of(_NONE, r, moment))


@jit_lanes
def _add_joint_resistance(rows, lanes, kind, body):
    """Add what the actuator gives against dry friction and a spring in the joint, friction sign(qd) + stiffness (q - rest)."""
    c0, s0 = _read_zero(body)
    law = _read_joint_law(body)
    for k in range(lanes):
        # of zero + q: a joint that turns without end has no other coordinate
        c = rows[COS + k]
        s = rows[SIN + k]
        place = math.atan2(c0 * s - s0 * c, c0 * c + s0 * s) if kind == CONTINUOUS else rows[PLACE + k]
        rows[EFFORT + k] += compute_resisting_effort(law, place, _sign(rows[RATE + k]))


@jit_lane
def _turn_state(state, k, r, d, motion):
    """Leave a parent's state, turned, of the place d."""
    w, al, a = motion
    put_vec(state, SPIN, k, into(r, w))
    put_vec(state, SPIN_RATE, k, into(r, al))
    put_vec(state, ACCELERATION_ROW, k, into(r, compute_acceleration_at(w, al, a, d)))


@jit_lanes
def _begin(how, source, state, work, lanes, body, g):
    """The state before the joint: at rest in the world, or the parent's, turned by the constant rotation."""
    if how == ON:
        return
    r = mat_at(body, BODY_R)
    d = vec_at(body, BODY_STEP)
    if how == FROM_WORLD:
        a = into(r, (-g[0], -g[1], -g[2]))
        for k in range(lanes):
            put_vec(state, SPIN, k, _NONE)
            put_vec(state, SPIN_RATE, k, _NONE)
            put_vec(state, ACCELERATION_ROW, k, a)
        return
    if how == COPIED:  # a loop of its own: that it reads other rows than it writes is known only here
        parent = work[source:]
        for k in range(lanes):
            _turn_state(state, k, r, d, read_state(parent, k))
        return
    for k in range(lanes):
        _turn_state(state, k, r, d, read_state(state, k))


@jit_pass
def run_outboard_pass(tree, numbers, work, lanes):
    """Carry the motion from the root to the leaves; leave in every body the force [N] and moment [N m] that it takes.

    Returns in how many lanes a joint's cosine and sine are those of no angle.
    """
    g = vec(numbers[0])
    lost = 0
    for i in range(1, tree.shape[0]):
        kind = tree[i, TREE_KIND]
        first = tree[i, TREE_ROWS]
        at = tree[i, TREE_STATE]
        how = tree[i, TREE_BEGINS]
        source = tree[i, TREE_SOURCE]
        state = work[at:]
        rows = work[first:]
        body = numbers[i]
        _begin(how, source, state, work, lanes, body, g)
        if kind == PRISMATIC:
            _compute_slide_outboard(state, rows, lanes, body)
        elif kind in (REVOLUTE, CONTINUOUS, HELICAL):
            if kind == CONTINUOUS:
                lost += simd.count_non_unit_lanes(rows, COS, lanes)
            else:
                _compute_angles(rows, lanes)
            if kind == HELICAL:
                _apply_screw_advance(state, rows, lanes, body)
            _turn_outboard(state, rows, lanes, body)
        else:
            _compute_orientations(rows, lanes, kind == FREE)
            _compute_float_outboard(state, rows, lanes, body)
        if kind not in (SPHERICAL, FREE) and (body[BODY_LAW + 2] != 0.0 or body[BODY_LAW + 3] != 0.0):
            _add_joint_resistance(rows, lanes, kind, body)
    return lost


@jit_lanes
def _count_non_finite_lanes(rows, lanes):
    """Count the lanes in which a wrench is not finite: 0 x infinity is NaN, and nothing ends one."""
    count = 0
    for k in range(lanes):
        force = vec_of(rows, FORCE, k)
        moment = vec_of(rows, MOMENT, k)
        total = (force[0] + force[1] + force[2]) + (moment[0] + moment[1] + moment[2])
        count += 0 if total - total == 0.0 else 1
    return count


@jit_pass
def run_inboard_pass(tree, numbers, work, lanes):
    """Sum forces [N] and moments [N m] from the leaves to the root; what lies along a joint's axis is its effort.

    Returns in how many lanes the world takes a wrench that is not finite, as it does of every coordinate, rate and acceleration
    that is not.
    """
    spoilt = 0
    for back in range(1, tree.shape[0]):
        i = tree.shape[0] - back
        kind = tree[i, TREE_KIND]
        parent = tree[i, TREE_PARENT]
        first = tree[i, TREE_ROWS]
        how = tree[i, TREE_BEGINS]
        rows = work[first:]
        above = work[tree[parent, TREE_ROWS] :]
        body = numbers[i]
        if how == ON:
            _turn_on_inboard(rows, above, lanes, body)
            continue
        if kind == PRISMATIC:
            _add_axial_effort(rows, lanes, 1.0)
        elif kind in (REVOLUTE, CONTINUOUS, HELICAL):
            _turn_inboard(rows, lanes, body)
            if kind == HELICAL:
                _add_axial_effort(rows, lanes, body[BODY_LEAD])
        else:
            _compute_float_inboard(rows, lanes)
        if how == FROM_WORLD:
            spoilt += _count_non_finite_lanes(rows, lanes)
        else:
            _add_wrench_to_parent(rows, above, lanes, body)
    return spoilt
