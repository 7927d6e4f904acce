"""One instant of the march: place all nodes, sum the wrenches on every block, and linearise both.

Residual of a block = inertia + elastic forces - loads on its independent node and along its passive freedoms; zero in motion.
The unknowns' increments are dx (world), theta (own frame) of independent nodes and dq of passive joints; velocities and
accelerations vary with them as the integrator says, dv = cv dx, da = ca dx (`generalized_alpha`).
"""

from __future__ import annotations

from flexinv.dynamics.point_rows import add_point_rows
from flexinv.elements.beam import compute_tangent_slope, fill_relative_poses, fill_relative_rates
from flexinv.elements.beam_element import (
    fill_damped_tangent,
    fill_element_forces,
    fill_element_gradient,
    fill_element_tangent,
)
from flexinv.elements.joint_law import (
    JointLaw,
    compute_effort_slope,
    compute_joint_effort,
    compute_smooth_direction,
    take_joint_law,
)
from flexinv.elements.points import fill_point_motion
from flexinv.elements.shapes import fill_shaped_motion, fill_shaped_variation, is_point_mass, turn_shapes
from flexinv.kernels import vec3
from flexinv.kernels.jit import jit_inner
from flexinv.kernels.so3 import coefficients, exp, inverse_tangent, log, tangent_with
from flexinv.kernels.vec3 import (
    EYE,
    ZERO,
    add,
    add_at,
    add_pair,
    add_scaled,
    add_to,
    apply,
    cross,
    dot,
    dot_pair,
    mat,
    pair,
    pair_at,
    put,
    put_pair,
    scale,
    tapply,
    vec,
    vec_at,
)
from flexinv.kinematics.tree import (
    add_parent_variation,
    add_wrench_to_parent,
    compute_child_motion,
    compute_wrench_effort,
    write_frame,
    write_joint,
)

# An element that turns more than this between its first and any other node is too coarse (log is singular at pi).
LARGEST_TURN = 2.5  # [rad]


@jit_inner
def run_forward_pass(topology, state, joints, frames, variation, work, factors, want_tangent):
    """Set ``frames`` and ``variation`` of all nodes from ``state`` and the prescribed motion of ``joints`` [m, rad, s].

    Point masses have no variation of their own (`point_rows`).  work : `system.Work`, of which ``moved`` and ``points``
    are set; factors : cv, ca
    """
    cv, ca = factors
    shapes = topology.shapes
    for n in range(len(topology.parent)):
        if is_point_mass(n, shapes):
            continue
        columns = topology.reach[n] if want_tangent else 0
        for k in range(columns):
            for by in (variation.x, variation.t, variation.v, variation.w, variation.a, variation.al):
                put(by[n, k], ZERO)
        if topology.independent[n]:
            _fill_section_motion(n, topology.first[n], columns, state, frames, variation, cv, ca)
        else:
            if topology.freedoms[n] > 0:
                _fill_passive_motion(n, topology, state, joints, variation, cv, ca, columns)
            elif shapes.part[n] >= 0:
                _fill_shaped_motion(n, topology, state, joints, variation, work.moved, factors, columns)
            compute_child_motion(n, topology.parent[n], frames, joints)
            add_parent_variation(n, topology.parent[n], columns, frames, joints, variation)
    for part in range(len(shapes.root)):
        first = topology.first[shapes.root[part]] + topology.amplitude[part]
        fill_point_motion(part, shapes, first, state, frames, joints, work.points, want_tangent)


@jit_inner
def _fill_section_motion(n, o, columns, state, frames, variation, cv, ca):
    psi = vec_at(state.d, o + 3)
    place = add(vec(state.x[n]), vec_at(state.d, o))
    turn = vec3.mul(mat(state.r[n]), exp(psi))
    v, w = pair_at(state.u, o)
    write_frame(n, frames, place, turn, v, w, *pair_at(state.du, o))
    if columns == 0:
        return
    for k in range(3):
        variation.x[n, k, k] = 1.0
        variation.v[n, k, k] = cv
        variation.a[n, k, k] = ca
        variation.t[n, 3 + k, k] = 1.0
    turned = vec3.transpose(inverse_tangent(psi))  # dpsi = H^-1 theta
    vec3.put_block(variation.w[n], 3, 0, vec3.mscale(cv, turned))
    vec3.put_block(variation.al[n], 3, 0, vec3.mscale(ca, turned))


@jit_inner
def compute_joint_rotation(n, topology, state, first):
    """Return the rotation vector [rad] that a passive joint has turned since the start of the step."""
    psi = ZERO
    for k in range(topology.freedoms[n]):
        psi = add_scaled(psi, state.d[first + k], vec(topology.turn[n, k]))
    return psi


@jit_inner
def _fill_passive_motion(n, topology, state, joints, variation, cv, ca, columns):
    """Relative motion of a passive joint, and with ``columns`` its variation."""
    first = topology.first[n] + topology.column[n]
    psi = compute_joint_rotation(n, topology, state, first)
    inverse = inverse_tangent(psi)
    p = vec(state.x[n])
    dp = ZERO
    ddp = ZERO
    w = ZERO
    al = ZERO
    for k in range(topology.freedoms[n]):
        slide = vec(topology.slide[n, k])
        turn = vec(topology.turn[n, k])
        p = add_scaled(p, state.d[first + k], slide)
        dp = add_scaled(dp, state.u[first + k], slide)
        w = add_scaled(w, state.u[first + k], turn)
        ddp = add_scaled(ddp, state.du[first + k], slide)
        al = add_scaled(al, state.du[first + k], turn)
        if columns > 0:
            at = topology.column[n] + k
            rate = apply(inverse, turn) if topology.triple[n] >= 0 else turn  # how the angular velocity follows
            put(variation.x[n, at], slide)
            put(variation.t[n, at], turn)
            put(variation.v[n, at], scale(cv, slide))
            put(variation.w[n, at], scale(cv, rate))
            put(variation.a[n, at], scale(ca, slide))
            put(variation.al[n, at], scale(ca, rate))
    write_joint(n, joints, p, dp, ddp, vec3.mul(mat(state.r[n]), exp(psi)), w, al)


@jit_inner
def _fill_shaped_motion(n, topology, state, joints, variation, moved, factors, columns):
    """Relative motion of a node of a meshed link, and with ``columns`` its variation."""
    shapes = topology.shapes
    column = topology.amplitude[shapes.part[n]]
    first = topology.first[n] + column
    motion = fill_shaped_motion(n, shapes, first, state, moved, joints)
    if columns > 0:
        fill_shaped_variation(n, shapes, (column, first), state, moved, motion, variation, factors)
    if shapes.turns[shapes.row[n]]:
        turn_shapes(n, shapes, motion, moved)


@jit_inner
def add_amplitude_forces(topology, state, work, moving, cv, want_tangent):
    """Begin the rows of all amplitudes with K y + D y' [N], and add what they store [J] and lose [W] to that of the elements.

    moving : False where velocities do not count, at rest
    """
    shapes = topology.shapes
    for part in range(len(shapes.root)):
        b = topology.block[shapes.root[part]]
        column = topology.amplitude[part]
        for k in range(shapes.size[part]):
            at = topology.offset[b] + column + k
            y = state.place[at] + state.d[at]
            stiffness = shapes.stiffness[part, k]
            drag = shapes.damping[part, k] * state.u[at] if moving else 0.0
            work.residual[0, at] = stiffness * y + drag
            work.energy[0] += 0.5 * stiffness * y * y
            work.energy[1] += (stiffness * y + drag) * state.u[at]
            work.energy[2] += drag * state.u[at]
            if want_tangent:
                work.diagonal[b, column + k, : topology.size[b]] = 0.0
                work.diagonal[b, column + k, column + k] = stiffness + (cv * shapes.damping[part, k] if moving else 0.0)


@jit_inner
def _compute_wrench_slope(n, m, k, system, frame, force):
    """Derivatives of the force on node n, along the axes ``frame`` of its parent m, and of its moment by unknown k."""
    dforce, dmoment = pair(system.work.dwrench[n, k])
    dforce = tapply(frame, dforce)
    if m >= 0:
        dforce = vec3.sub(dforce, cross(vec(system.variation.t[m, k]), force))
    return dforce, dmoment


@jit_inner
def _add_shaped_rows(n, columns, system, joints):
    """Add to the rows of a part's amplitudes what acts on one of its nodes, and with ``columns`` its derivatives."""
    work = system.work
    topology = system.topology
    shapes = topology.shapes
    m = topology.parent[n]
    b = topology.block[n]
    row = shapes.row[n]
    part = shapes.part[n]
    column = topology.amplitude[part]
    frame = mat(system.frames.r[m])
    force, moment = pair(work.wrench[n])
    force = tapply(frame, force)
    turns = shapes.turns[row]
    for k in range(shapes.size[part]):
        pushed = dot(vec(work.moved[row, k]), force)
        if turns:
            pushed += dot(vec_at(work.moved[row, k], 3), moment)
        work.residual[0, topology.offset[b] + column + k] += pushed
    for c in range(columns):
        dforce, dmoment = _compute_wrench_slope(n, m, c, system, frame, force)
        for k in range(shapes.size[part]):
            by = dot(vec(work.moved[row, k]), dforce)
            if turns:
                by += dot(vec_at(work.moved[row, k], 3), dmoment)
            work.diagonal[b, column + k, c] += by
    if columns > 0:
        _add_bent_rows(n, system, force)
        if turns:
            _add_turned_rows(n, system, joints, moment)


@jit_inner
def _add_bent_rows(n, system, force):
    """Add how the slides of a node vary with the amplitudes under its force in the frame of the part [N]."""
    topology = system.topology
    shapes = topology.shapes
    diagonal = system.work.diagonal[topology.block[n]]
    soft = shapes.soft[shapes.part[n]]
    column = topology.amplitude[shapes.part[n]]
    for k in range(soft):
        for c in range(soft):
            diagonal[column + k, column + c] += dot(vec(shapes.bend[shapes.row[n], k, c]), force)


@jit_inner
def _add_turned_rows(n, system, joints, moment):
    """Add how the turns of a frame by amplitudes, H(psi) T, vary with the amplitudes under its moment [N m]."""
    work = system.work
    topology = system.topology
    shapes = topology.shapes
    row = shapes.row[n]
    count = shapes.size[shapes.part[n]]
    column = topology.amplitude[shapes.part[n]]
    psi = log(mat(joints.r[n]))
    back = inverse_tangent(psi)
    q = coefficients(dot(psi, psi))
    along = tapply(tangent_with(psi, q), moment)
    soft = shapes.soft[shapes.part[n]]
    for k in range(count):
        turn = apply(back, vec_at(work.moved[row, k], 3))  # T(y), of H T(y)
        by = tapply(back, tapply(compute_tangent_slope(psi, turn, q, 1.0), moment))
        for c in range(count):
            added = dot(by, vec_at(work.moved[row, c], 3))
            if k < soft and c < soft:
                added += dot(along, vec(shapes.whirl[row, k, c]))
            work.diagonal[topology.block[n], column + k, column + c] += added


@jit_inner
def compute_node_wrenches(topology, frames, variation, level, work, want_tangent):
    """Set every node's own wrench P = m (a - g), Q = J al + w x J w, and its variation; ``level`` of g acts [N], [N m]."""
    gravity = scale(level, vec(topology.gravity))
    for n in range(len(topology.parent)):
        m = topology.mass[n]
        inertia = mat(topology.inertia[n])
        w = vec(frames.w[n])
        spin = apply(inertia, w)
        put_pair(
            work.wrench[n],
            scale(m, vec3.sub(vec(frames.a[n]), gravity)),
            add(apply(inertia, vec(frames.al[n])), cross(w, spin)),
        )
        if not want_tangent or is_point_mass(n, topology.shapes):
            continue
        for k in range(topology.reach[n], topology.width[n]):
            put_pair(work.dwrench[n, k], ZERO, ZERO)
        for k in range(topology.reach[n]):
            dw = vec(variation.w[n, k])
            gyro = add(cross(dw, spin), cross(w, apply(inertia, dw)))
            put_pair(
                work.dwrench[n, k], scale(m, vec(variation.a[n, k])), add(apply(inertia, vec(variation.al[n, k])), gyro)
            )


@jit_inner
def add_elements(topology, elements, frames, variation, work, moving, want_tangent):
    """Add internal forces of all elements to the wrenches; return -1, or the element that turns too much [rad].

    moving : False where velocities do not count, at rest
    """
    z = work.element
    energy = 0.0
    power = 0.0
    lost = 0.0
    damped = moving and len(elements.damping) > 0
    for k in range(len(elements.order)):
        count = elements.order[k] + 1
        nodes = elements.nodes[k]
        for i in range(count):
            put(z.x[i], vec(frames.x[nodes[i]]))
            vec3.put_mat(z.r[i], mat(frames.r[nodes[i]]))
        if not fill_relative_poses(count, z) <= LARGEST_TURN:
            return k
        if damped:
            for i in range(count):
                put(work.rates.v[i], vec(frames.v[nodes[i]]))
                put(work.rates.w[i], vec(frames.w[nodes[i]]))
            fill_relative_rates(count, z, work.rates)
            stored, gone = fill_element_gradient(k, count, elements, z, work.rates, work.internal[k], want_tangent)
        else:
            stored, gone = fill_element_gradient(k, count, elements, z, None, work.internal[k], want_tangent)
        energy = energy + stored
        lost = lost + gone
        fill_element_forces(count, z)
        power = _add_element_forces(count, nodes, z.forces, frames, work.wrench, power)
        if want_tangent:
            if damped:
                fill_damped_tangent(count, z, work.rates, nodes, variation, work.tangent[k])
            else:
                fill_element_tangent(count, z, work.tangent[k])
                work.tangent[k, :, 6 * elements.nodes.shape[1] :] = 0.0
            _add_diagonal(topology, variation, nodes, count, work.tangent[k], work.dwrench)
    put(work.energy, (energy, power, lost))
    return -1


@jit_inner
def _add_diagonal(topology, variation, nodes, count, tangent, dwrench):
    """Add what each node of an element feels of its own motion (and the root of its block's other unknowns)."""
    root = nodes[0]
    for k in range(topology.width[root]):
        for i in range(6):
            dwrench[root, k, i] += compute_root_derivative(tangent, i, root, k, variation)
    for node in range(1, count):
        for k in range(6):
            for i in range(6):
                dwrench[nodes[node], k, i] += tangent[6 * node + i, 6 * node + k]


@jit_inner
def compute_root_derivative(tangent, row, root, k, variation):
    """Return the derivative of an element's force by unknown k of its root's block, pose and velocity [N/m], [N], [N m]."""
    by = tangent[row]
    last = tangent.shape[1] - 6
    derivative = dot_pair(pair(by), (vec(variation.x[root, k]), vec(variation.t[root, k])))
    if tangent.shape[1] > tangent.shape[0]:
        derivative += dot_pair(pair_at(by, last), (vec(variation.v[root, k]), vec(variation.w[root, k])))
    return derivative


@jit_inner
def assemble_residual(system, joints, cv, ca, want_tangent):
    """Bring wrenches of dependent nodes back to their blocks: residual (unknowns,) [N], [N m] and diagonal blocks."""
    topology = system.topology
    work = system.work
    for part in range(len(topology.shapes.root)):
        add_point_rows(part, system, (cv, ca), want_tangent)
    for n in range(len(topology.parent) - 1, -1, -1):
        b = topology.block[n]
        m = topology.parent[n]
        columns = topology.size[b] if want_tangent else 0
        if is_point_mass(n, topology.shapes):
            add_wrench_to_parent(n, m, system.frames, joints, work.wrench)
            continue
        if topology.independent[n]:
            for i in range(6):
                work.residual[0, topology.offset[b] + i] = work.wrench[n, i]
                for k in range(columns):
                    work.diagonal[b, i, k] = work.dwrench[n, k, i]
            continue
        if topology.freedoms[n] > 0:
            _fill_passive_rows(n, columns, system, cv, ca)
        elif topology.shapes.part[n] >= 0:
            _add_shaped_rows(n, columns, system, joints)
        if m >= 0:
            add_wrench_to_parent(n, m, system.frames, joints, work.wrench)
            _add_variation_to_parent(n, m, columns, system, joints)


@jit_inner
def _add_variation_to_parent(n, m, columns, system, joints):
    """Add the variation of node n's wrench to its parent's; its pose there varies with the joint's own freedoms only."""
    topology = system.topology
    work = system.work
    p = vec(joints.p[n])
    rj = mat(joints.r[n])
    r = mat(system.frames.r[m])
    force, mu = pair(work.wrench[n])
    local = tapply(r, force)
    part = topology.shapes.part[n]
    own = topology.column[n] if part < 0 else topology.amplitude[part]
    count = topology.freedoms[n] if part < 0 else topology.shapes.size[part]
    for k in range(columns):
        i = k - own
        slide = ZERO
        turn = ZERO
        if 0 <= i < count:
            slide = vec(topology.slide[n, i]) if part < 0 else vec(work.moved[topology.shapes.row[n], i])
            turn = vec(topology.turn[n, i]) if part < 0 else vec_at(work.moved[topology.shapes.row[n], i], 3)
        dlocal, dmu = _compute_wrench_slope(n, m, k, system, r, local)
        add_to(work.dwrench[m, k], vec(work.dwrench[n, k]))
        turned = apply(rj, add(cross(turn, mu), dmu))
        add_at(work.dwrench[m, k], 3, add(add(cross(slide, local), cross(p, dlocal)), turned))


@jit_inner
def _add_element_forces(count, nodes, forces, frames, wrench, power):
    """Add the forces of an element to the wrenches of its nodes; return ``power`` with theirs [W]."""
    for i in range(count):
        n = nodes[i]
        force = pair(forces[i])
        add_pair(wrench[n], *force)
        power += dot_pair(force, (vec(frames.v[n]), vec(frames.w[n])))
    return power


@jit_inner
def _fill_passive_rows(n, columns, system, cv, ca):
    """Residual along passive freedoms: wrench on the axes + rotor, damping, friction and spring of the joint, less its drive."""
    # Work by itself: where formulas are inlined Numba takes writes into what a tuple of records was unpacked to for dead code.
    work = system.work
    topology = system.topology
    state = system.state
    loads = system.loads
    m = topology.parent[n]
    first = topology.first[n] + topology.column[n]
    frame = mat(system.frames.r[m]) if m >= 0 else EYE
    force, moment = pair(work.wrench[n])
    force = tapply(frame, force)
    level = loads.level[0]
    whole = take_joint_law(topology.drives, n)
    law = JointLaw(whole.rotor, whole.damping, whole.friction, level * whole.stiffness, whole.rest)
    for i in range(topology.freedoms[n]):
        k = first + i
        direction = compute_smooth_direction(state.u[k])
        joint_effort = compute_joint_effort(law, state.place[k] + state.d[k], state.u[k], state.du[k], direction)
        effort = compute_wrench_effort(topology, n, i, (force, moment))
        work.residual[0, k] = effort + joint_effort - level * loads.effort[k]
        if columns > 0:
            slope = compute_effort_slope(law, direction, cv, ca)
            _fill_passive_derivatives(n, i, columns, system, force, slope)


@jit_inner
def _fill_passive_derivatives(n, i, columns, system, force, slope):
    """Derivatives of the residual along passive freedom i; force : on the node in the parent's frame, slope : of the joint."""
    work = system.work
    topology = system.topology
    b = topology.block[n]
    m = topology.parent[n]
    row = topology.column[n] + i
    diagonal = work.diagonal[b]
    frame = mat(system.frames.r[m]) if m >= 0 else EYE
    for k in range(columns):
        diagonal[row, k] = compute_wrench_effort(topology, n, i, _compute_wrench_slope(n, m, k, system, frame, force))
    if topology.triple[n] >= 0 and i >= topology.triple[n]:  # the turn is unit vector number i - triple
        first = topology.offset[b] + topology.column[n]
        inverse = inverse_tangent(compute_joint_rotation(n, topology, system.state, first))
        add_at(
            diagonal[row],
            topology.column[n] + topology.triple[n],
            scale(slope, tapply(inverse, vec(topology.turn[n, i]))),
        )
    else:
        diagonal[row, row] += slope
