"""Exact rigid kinematics of joints: motion of every node in its parent's frame and in the world, for all samples at once.

``p``, ``p'``, ``p''`` are taken in the parent node's frame, rotation rates in the node's own frame; what a
node's placement and its joint do together is one relative motion, so that one rule walks the tree (`kinematics.tree.carry`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexinv.kernels.memory import plain, together
from flexinv.kinematics.configuration import motion_samples, nodes_of, relative_samples
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Frames, Joints
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint
from flexinv.typing import Array

# Joint motion as a function of time: time (samples,) [s] -> q (samples, nq), qd, qdd (samples, nv) [rad or m, s].
JointHistory = Callable[[Array], tuple[Array, Array, Array]]


def relative_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Joints:
    """Return the motion of every node in its parent's frame [m, rad, s], (samples, nodes, ...), for q (samples, nq), qd, qdd.

    Velocity of a free joint is linear then angular, both in the child's frame: p' = R_j v, p'' = R_j (v' + w x v).
    """
    out = _joints((len(q), mesh.size, 3))
    relative_samples(nodes_of(mesh), plain(q), plain(qd), plain(qdd), out)
    return out


def _joints(vector: tuple[int, ...]) -> Joints:
    return Joints(*together(*3 * [vector], (*vector, 3), *2 * [vector]))


def joint_effort(mesh: Mesh, node: int, force: Array, moment: Array) -> Array:
    """Return the components S^T (force, moment) of a wrench along a joint's freedoms, (samples, nv) [N m] or [N].

    ``force`` [N] and ``moment`` [N m], (samples, 3), act on the joint's ``node`` at its origin, in its own axes.
    """
    count = mesh.freedoms[node]
    return np.asarray(force @ mesh.slide[node, :count].T + moment @ mesh.turn[node, :count].T)


def scalar_coordinate(joint: Joint, q: Array, history: bool = True) -> Array:
    """Return the coordinate (samples,) [rad], [m] of a joint that has one, from its own columns of q (samples, nq).

    history : q is a motion, along which the angle of a continuous joint is followed over whole turns; else it is in -pi .. pi
    """
    if not KINDS[joint.kind].circle:
        return q[:, 0]
    angle = np.arctan2(q[:, 1], q[:, 0])
    return np.unwrap(angle) if history else angle


def rigid_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> NodalMotion:
    """Return the nodal motion [m, rad, s] of the undeformed mechanism for q (samples, nq), qd, qdd (samples, nv).

    Each node's pose, velocity and acceleration follow from its parent's by the equations at the head of `kinematics.tree`.
    """
    motion = NodalMotion.unwritten(len(q), mesh.size)
    motion_samples(nodes_of(mesh), plain(q), plain(qd), plain(qdd), _joints((mesh.size, 3)), Frames(*motion.parts))
    return motion
