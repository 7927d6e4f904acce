"""Rows of meshed links' amplitudes: what the point masses of a part push along them, and the linearisation of that (compiled).

All of a part's points are in one link frame, which the first columns of its block move, if any.  With the force f = m (a - g) of
each along the axes of that frame, r its place and U its slides by the amplitudes (`elements.points`), the part adds

    sum f  and  sum r x f  to the wrench of the link frame,        sum U^T f  to the rows of the amplitudes,

and with the derivative df of each force by the unknowns of the block the same sums of df, beside U x f and B^T f.
Of an own amplitude it is

    df = m A U + m E B y' + m B y''        A = al x + w x w x + 2 cv w x + ca        E = 2 w x + 2 cv
"""

from __future__ import annotations

from flexinv.elements.points import add_scaled_row, find_point_entries, take_point, write_point
from flexinv.kernels.jit import jit_sums
from flexinv.kernels.vec3 import add, add_pair, add_scaled, apply, cross, mat, scale, sub, sum3, tapply, vec


@jit_sums
def add_point_rows(part, system, factors, want_tangent):
    """Add a part's points to the rows of its amplitudes, and with ``want_tangent`` to the linearisation [N], [N m].

    factors : cv, ca of the scheme; the points' motion and wrenches are set
    """
    work = system.work
    topology = system.topology
    points = topology.shapes.points
    root = topology.shapes.root[part]
    first = topology.first[root] + topology.amplitude[part]
    frame = mat(system.frames.r[root])
    row = points.row[part]
    stride = points.stride[part]
    for i in range(points.first[part + 1] - points.first[part]):
        wrench = work.wrench[points.node[points.first[part] + i]]
        write_point(work.points.force, row + i, stride, tapply(frame, vec(wrench)))
    force = work.points.force[row : row + 3 * stride]
    for c in range(topology.shapes.size[part]):
        work.residual[0, first + c] += _compute_product_sum(work.points.slide[c, row : row + 3 * stride], force)
    if want_tangent:
        law = _compute_own_law(part, system, factors)
        carried = topology.reach[root] > 0
        if carried or topology.shapes.soft[part] > 0:
            _fill_force_columns(part, system, law, factors)
        if carried:  # else nothing inboard moves, and nothing there asks how the wrench varies
            _add_to_frame(part, system)
        _add_amplitude_rows(part, system, law)


@jit_sums
def _compute_product_sum(one, other):
    """Sum the products of two rows [any unit]."""
    total = 0.0
    for i in range(len(one)):
        total += one[i] * other[i]
    return total


@jit_sums
def _compute_own_law(part, system, factors):
    """A: how the acceleration of a point follows its slide [1/s^2], three rows."""
    cv, ca = factors
    root = system.topology.shapes.root[part]
    w = vec(system.frames.w[root])
    across = add_scaled(vec(system.frames.al[root]), 2.0 * cv, w)
    level = ca - (w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    return (
        (w[0] * w[0] + level, w[0] * w[1] - across[2], w[0] * w[2] + across[1]),
        (w[1] * w[0] + across[2], w[1] * w[1] + level, w[1] * w[2] - across[0]),
        (w[2] * w[0] - across[1], w[2] * w[1] + across[0], w[2] * w[2] + level),
    )


@jit_sums
def _fill_force_columns(part, system, law, factors):
    """Set the derivatives of the points' forces along the axes of the link frame by the unknowns of the block.

    law : of `_compute_own_law`
    """
    topology = system.topology
    shapes = topology.shapes
    motion = system.work.points
    root = shapes.root[part]
    begin, end = find_point_entries(part, shapes.points)
    mass = shapes.points.mass[part]
    own = topology.amplitude[part]
    w = scale(2.0, vec(system.frames.w[root]))
    cv = 2.0 * factors[0]
    by_rate = ((cv, -w[2], w[1]), (w[2], cv, -w[0]), (-w[1], w[0], cv))
    for c in range(shapes.size[part]):
        column = motion.column[own + c, begin:end]
        column[:] = 0.0
        _add_turned(law, mass, motion.slide[c, begin:end], column)
        if c < shapes.soft[part]:
            _add_turned(by_rate, mass, motion.rate[c, begin:end], column)
            add_scaled_row(mass, motion.change[c, begin:end], column)
    for c in range(topology.reach[root]):
        _fill_carried_column(part, c, system, mass)


@jit_sums
def _add_turned(turn, mass, row, out):
    """Add m turn v of the vectors v in a row."""
    x, y, z = _split_coordinates(row)
    to_x, to_y, to_z = _split_coordinates(out)
    _add_three(scale(mass, turn[0]), x, y, z, to_x)
    _add_three(scale(mass, turn[1]), x, y, z, to_y)
    _add_three(scale(mass, turn[2]), x, y, z, to_z)


@jit_sums
def _split_coordinates(row):
    """Return the coordinates x, y and z of all points in a row."""
    stride = len(row) // 3
    return row[:stride], row[stride : 2 * stride], row[2 * stride :]


@jit_sums
def _add_three(factors, x, y, z, out):
    for i in range(len(out)):
        out[i] += factors[0] * x[i] + factors[1] * y[i] + factors[2] * z[i]


@jit_sums
def _fill_carried_column(part, c, system, mass):
    """Set the derivative of the points' forces by an unknown that moves the link frame."""
    topology = system.topology
    points = topology.shapes.points
    motion = system.work.points
    variation = system.variation
    root = topology.shapes.root[part]
    frame = mat(system.frames.r[root])
    w = vec(system.frames.w[root])
    gravity = scale(system.loads.level[0], vec(topology.gravity))
    start = tapply(frame, sub(vec(system.frames.a[root]), gravity))
    spin = vec(variation.w[root, c])
    turned = vec(variation.al[root, c])
    lifted = sub(tapply(frame, vec(variation.a[root, c])), cross(vec(variation.t[root, c]), start))
    stride = points.stride[part]
    for i in range(points.first[part + 1] - points.first[part]):
        at = points.row[part] + i
        place = take_point(motion.place, at, stride)
        swing = add_scaled(cross(w, place), 2.0, take_point(motion.drift, at, stride))
        swung = add(cross(spin, swing), cross(w, cross(spin, place)))
        write_point(motion.column[c], at, stride, scale(mass, sum3(lifted, cross(turned, place), swung)))


@jit_sums
def _add_to_frame(part, system):
    """Add the derivatives of the points' forces and moments to those of the link frame's wrench."""
    work = system.work
    topology = system.topology
    shapes = topology.shapes
    motion = work.points
    root = shapes.root[part]
    begin, end = find_point_entries(part, shapes.points)
    own = topology.amplitude[part]
    frame = mat(system.frames.r[root])
    place = motion.place[begin:end]
    force = motion.force[begin:end]
    total = _compute_vector_sum(force)
    for c in range(topology.reach[root]):
        column = motion.column[c, begin:end]
        pushed = add(_compute_vector_sum(column), cross(vec(system.variation.t[root, c]), total))
        add_pair(work.dwrench[root, c], apply(frame, pushed), _compute_moment_sum(place, column))
    for c in range(shapes.size[part]):
        column = motion.column[own + c, begin:end]
        moment = add(_compute_moment_sum(place, column), _compute_moment_sum(motion.slide[c, begin:end], force))
        add_pair(work.dwrench[root, own + c], apply(frame, _compute_vector_sum(column)), moment)


@jit_sums
def _compute_vector_sum(row):
    """Sum the vectors in a row."""
    x, y, z = _split_coordinates(row)
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    for i in range(len(x)):
        s0 += x[i]
        s1 += y[i]
        s2 += z[i]
    return s0, s1, s2


@jit_sums
def _compute_moment_sum(arms, forces):
    """Sum r x f of the vectors in two rows."""
    x, y, z = _split_coordinates(arms)
    fx, fy, fz = _split_coordinates(forces)
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    for i in range(len(x)):
        s0 += y[i] * fz[i] - z[i] * fy[i]
        s1 += z[i] * fx[i] - x[i] * fz[i]
        s2 += x[i] * fy[i] - y[i] * fx[i]
    return s0, s1, s2


@jit_sums
def _add_amplitude_rows(part, system, law):
    """Add U^T df and B^T f of a part's points to the rows of its amplitudes; ``law`` : of `_compute_own_law`.

    Of two shapes that do not bend the products are those of the undeformed points.
    """
    work = system.work
    topology = system.topology
    shapes = topology.shapes
    points = shapes.points
    motion = work.points
    b = topology.block[shapes.root[part]]
    own = topology.amplitude[part]
    count = shapes.size[part]
    soft = shapes.soft[part]
    begin, end = find_point_entries(part, points)
    for a in range(count):
        row = work.diagonal[b, own + a]
        slide = motion.slide[a, begin:end]
        for c in range(topology.reach[shapes.root[part]]):
            row[c] += _compute_product_sum(slide, motion.column[c, begin:end])
        for c in range(own, own + (count if a < soft else soft)):
            row[c] += _compute_product_sum(slide, motion.column[c, begin:end])
        if a >= soft:
            for i in range(3):
                for j in range(3):
                    add_scaled_row(law[i][j], points.product[part, a, i, j, soft:count], row[own + soft : own + count])
    force = motion.force[begin:end]
    for a in range(soft):
        for c in range(soft):
            work.diagonal[b, own + a, own + c] += _compute_product_sum(points.bend[a, c, begin:end], force)


@jit_sums
def add_point_masses(part, system):
    """Add the masses of a part's points to the mass matrix of its block, sum m B^T B [kg], [kg m], [kg m^2]."""
    topology = system.topology
    shapes = topology.shapes
    points = shapes.points
    motion = system.work.points
    root = shapes.root[part]
    b = topology.block[root]
    own = topology.amplitude[part]
    frame = mat(system.frames.r[root])
    begin = points.row[part]
    stride = points.stride[part]
    mass = points.mass[part]
    columns = topology.size[b]
    for c in range(columns):
        moved = tapply(frame, vec(system.variation.x[root, c]))
        turn = vec(system.variation.t[root, c])
        for i in range(points.first[part + 1] - points.first[part]):
            slide = add(moved, cross(turn, take_point(motion.place, begin + i, stride)))
            if own <= c < own + shapes.size[part]:
                slide = take_point(motion.slide[c - own], begin + i, stride)
            write_point(motion.column[c], begin + i, stride, slide)
    for a in range(columns):
        one = motion.column[a, begin : begin + 3 * stride]
        for c in range(columns):
            other = motion.column[c, begin : begin + 3 * stride]
            system.work.diagonal[b, a, c] += mass * _compute_product_sum(one, other)
