"""Causes in the terms of the equation of motion M q'' + C(q, q') q' + g - G^T lambda: one is missing, for all or for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosscheck.causes.cause import Cause, list_bodies, list_closed_target, list_moving_tree_target
from crosscheck.causes.model import Model, is_tree, open_tree
from crosscheck.causes.rows.bodies import TURN, add_parallel_axis_term, list_eccentric_bodies, remove_body
from crosscheck.causes.subject import States, Subject
from flexinv.constraints.allocation import REDUNDANT, count_ranks
from flexinv.constraints.closures import build_constraint_rows, compute_constraint_jacobian
from flexinv.inverse.inverse_dynamics import NodalForces, compute_projected_efforts
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import Link, Mechanism
from flexinv.typing import Array, Indices, Mask

SPEED = "the same path at twice the speed"
REST = "holding still at several places"


def compute_quadratic_terms(mechanism: Mechanism, states: States, qd: Array) -> Array:
    """Return the efforts of squares and products of rates ``qd`` (samples, nv), (samples, nv) [N m] or [N].

    They are the part of tau(q, q', 0) that is even in q', less tau(q, 0, 0): damping and dry friction are odd.
    """
    still = 0.0 * states.qdd
    ahead = open_tree(mechanism, replace(states, qd=qd, qdd=still))
    back = open_tree(mechanism, replace(states, qd=-qd, qdd=still))
    return 0.5 * (ahead + back) - open_tree(mechanism, replace(states, qd=still, qdd=still))


def compute_centrifugal_terms(mechanism: Mechanism, states: States) -> Array:
    """Return sum_j c_ijj q'_j^2, (samples, nv) [N m] or [N]: what each joint's rate does alone."""
    alone = (states.qd * unit for unit in np.eye(mechanism.nv))
    return np.asarray(np.sum([compute_quadratic_terms(mechanism, states, qd) for qd in alone], axis=0))


def compute_gyroscopic_efforts(mechanism: Mechanism, states: States) -> Array:
    """Return the efforts of w x J w of all bodies about their centres of mass, (samples, nv) [N m] or [N]."""
    mesh = build(mechanism)
    motion = compute_rigid_motion(mesh, states.q, states.qd, states.qdd)
    momentum = np.einsum("nij,snj->sni", mesh.inertia, motion.omega)  # (sample, node, xyz)
    moment = np.einsum("snij,snj->sni", motion.rotation, np.cross(motion.omega, momentum))
    return compute_projected_efforts(mesh, motion, NodalForces(np.zeros_like(moment), moment))


def compute_closure_jacobian(mechanism: Mechanism, states: States) -> Array:
    """Return G of all closures with G q' = 0, (samples, rows, nv) [m], [-] per unit of each coordinate."""
    mesh = build(mechanism)
    motion = compute_rigid_motion(mesh, states.q, states.qd, states.qdd)
    return compute_constraint_jacobian(mesh, motion, build_constraint_rows(mesh))


def compute_closure_efforts(mechanism: Mechanism, states: States, effort: Array, closure: str) -> Array:
    """Return the share of one closure's force in the efforts, G_k^T lambda_k (samples, nv) [N m] or [N].

    All shares together are what the efforts (samples, nv) lack of those of the open tree:  tau_tree - tau = G^T lambda.
    It is one number where `list_single_closures` has the closure.
    """
    g = compute_closure_jacobian(mechanism, states)
    whole = open_tree(mechanism, states) - effort
    multipliers = np.einsum("srv,sv->sr", np.linalg.pinv(g.transpose(0, 2, 1), rcond=REDUNDANT), whole)
    mine = _find_closure_rows(mechanism, closure)
    return np.asarray(np.einsum("srv,sr->sv", g[:, mine], multipliers[:, mine]))


def _find_closure_rows(mechanism: Mechanism, closure: str) -> Mask:
    number = [c.name for c in mechanism.closures].index(closure)
    return np.asarray(build_constraint_rows(build(mechanism)).closure == number)


def _drop_closure_force(subject: Subject, target: str, size: Array) -> Subject:
    closure, where = target.rsplit(AT, 1)

    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        lost = float(size[0]) * compute_closure_efforts(mechanism, states, effort, closure)
        return np.asarray(effort + (lost if where == EVERYWHERE else np.where(mechanism.actuated, lost, 0.0)))

    return subject.add_effort_change(update_effort)


def _drop_centrifugal_terms(subject: Subject, target: str, size: Array) -> Subject:
    return subject.add_effort_change(lambda m, states, effort: effort - compute_centrifugal_terms(m, states))


def _drop_coriolis_terms(subject: Subject, target: str, size: Array) -> Subject:
    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        whole = compute_quadratic_terms(mechanism, states, states.qd)
        return np.asarray(effort - (whole - compute_centrifugal_terms(mechanism, states)))

    return subject.add_effort_change(update_effort)


def _drop_gyroscopic_moments(subject: Subject, target: str, size: Array) -> Subject:
    return subject.add_effort_change(lambda m, states, effort: effort - compute_gyroscopic_efforts(m, states))


def _drop_weight_of_body(subject: Subject, target: str, size: Array) -> Subject:
    def update_effort(mechanism: Mechanism, states: States, effort: Array) -> Array:
        still = 0.0 * states.qdd
        at_rest = replace(states, qd=still, qdd=still)
        lighter = remove_body(replace(subject, mechanism=mechanism), target, size).mechanism
        return np.asarray(effort - (open_tree(mechanism, at_rest) - open_tree(lighter, at_rest)))

    return subject.add_effort_change(update_effort)


def _update_parallel_axis_terms(subject: Subject, target: str, size: Array) -> Subject:
    sign = -1.0 if target == FORGOTTEN else 1.0

    def update_link(link: Link) -> Link:
        bodies = (replace(b, inertia=add_parallel_axis_term(b.inertia, sign * float(size[0]))) for b in link.bodies)
        return replace(link, bodies=tuple(bodies))

    return subject.replace_links(update_link)


AT = ": "
EVERYWHERE = "at all joints"
AT_DRIVES = "at the drives"
FORGOTTEN = "are forgotten (inertias about the centres of mass are taken for those about the frames' origins)"
TWICE = "count twice (inertias about the frames' origins are taken for those about the centres of mass)"


def _list_eccentric_targets(model: Model) -> list[str]:
    """Return both mistakes where more than one body has them: of one body the table of bodies knows."""
    return [FORGOTTEN, TWICE] if len(list_eccentric_bodies(model)) > 1 else []


def list_single_closures(model: Model) -> list[str]:
    """Return the closures of a rigid mechanism whose forces no others can take over, where there are several.

    Those are independent of all others along the motion: rank G = rank G_k + rank of the other rows.  Of one closure
    "soft constraint" knows.
    """
    mechanism = model.base.mechanism
    if not list_closed_target(model) or len(mechanism.closures) < 2:
        return []
    g = compute_closure_jacobian(mechanism, model.states)
    rows = {c.name: _find_closure_rows(mechanism, c.name) for c in mechanism.closures}
    return [name for name, mine in rows.items() if (_count(g) == _count(g[:, mine]) + _count(g[:, ~mine])).all()]


def _count(g: Array) -> Indices:
    return count_ranks(np.linalg.svd(g, compute_uv=False))


def _list_closure_targets(model: Model) -> list[str]:
    return [f"{closure}{AT}{where}" for closure in list_single_closures(model) for where in (EVERYWHERE, AT_DRIVES)]


def _list_scalar_tree_target(model: Model) -> list[str]:
    """Return the one target of moving trees whose joints have one coordinate: only there are rates those of coordinates."""
    joints = [j for j in model.base.mechanism.joints if j.nv]
    return list_moving_tree_target(model) if all(j.nv == j.nq == 1 for j in joints) else []


def _list_weighty_bodies(model: Model) -> list[str]:
    """Return the bodies of a tree under gravity, where there are several: of one the weight of all is missing."""
    bodies = list_bodies(model)
    return bodies if is_tree(model.base) and model.base.mechanism.gravity.any() and len(bodies) > 1 else []


ROWS = (
    Cause(
        "Coriolis terms dropped",
        "terms with products of two joints' rates (Coriolis) are missing",
        _drop_coriolis_terms,
        _list_scalar_tree_target,
        0,
        shows="two joints moved at once, and twice as quickly",
    ),
    Cause(
        "centrifugal terms dropped",
        "terms with squares of the joints' rates (centrifugal) are missing",
        _drop_centrifugal_terms,
        _list_scalar_tree_target,
        0,
        shows="one joint moved at a time, and twice as quickly",
    ),
    Cause(
        "gyroscopic moments dropped",
        "the gyroscopic moments w x J w of the bodies are missing",
        _drop_gyroscopic_moments,
        list_moving_tree_target,
        0,
        shows=TURN,
    ),
    Cause(
        "weight of a body dropped",
        "gravity does not act on {target}",
        _drop_weight_of_body,
        _list_weighty_bodies,
        0,
        unsaid=("gravity torque",),
        shows=REST,
    ),
    Cause(
        "closure force dropped",
        "the force of one closure is missing in the efforts by the fraction {size} ({target})",
        _drop_closure_force,
        _list_closure_targets,
        unsaid=("rank of the closures", "closure residual"),
        shows="any motion: efforts at joints without a drive",
    ),
    Cause(
        "parallel axis terms",
        "the terms m (|c|^2 1 - c c^T) of all bodies {target}",
        _update_parallel_axis_terms,
        _list_eccentric_targets,
        0,
        shows=TURN,
    ),
)
