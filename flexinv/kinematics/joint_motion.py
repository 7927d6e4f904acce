"""Joints: relative pose, velocity and acceleration of every node in its parent's frame, for all samples at once.

``p``, ``p'``, ``p''`` are taken in the parent node's frame, rotation rates in the node's own frame; what a
node's placement and its joint do together is one relative motion, so that one rule walks the tree (`kinematics.tree.carry`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flexinv.kernels.memory import plain, together
from flexinv.kinematics.configuration import nodes_of, relative_samples
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.tree import Joints
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint
from flexinv.typing import Array

# Joint motion as a function of time: time (samples,) [s] -> q (samples, nq), qd, qdd (samples, nv) [rad or m, s].
JointHistory = Callable[[Array], tuple[Array, Array, Array]]


class Relative(NamedTuple):
    """Motion of nodes relative to their parents.

    p, dp, ddp : (samples, nodes, 3) [m], [m/s], [m/s^2] in the parent's frame
    rotation : (samples, nodes, 3, 3), R_parent,node; rate, acceleration : (samples, nodes, 3) [rad/s], [rad/s^2], own frame
    """

    p: Array
    dp: Array
    ddp: Array
    rotation: Array
    rate: Array
    acceleration: Array


def relative_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Relative:
    """Return the motion of every node in its parent's frame [m, rad, s] for q (samples, nq), qd, qdd (samples, nv).

    Velocity of a free joint is linear then angular, both in the child's frame: p' = R_j v, p'' = R_j (v' + w x v).
    """
    vector = (len(q), mesh.size, 3)
    p, dp, ddp, rotation, rate, acceleration = together(*3 * [vector], (*vector, 3), *2 * [vector])
    out = Relative(p, dp, ddp, rotation, rate, acceleration)
    relative_samples(nodes_of(mesh), plain(q), plain(qd), plain(qdd), Joints(*out))
    return out


def scalar_coordinate(joint: Joint, q: Array, history: bool = True) -> Array:
    """Return the coordinate (samples,) [rad], [m] of a joint that has one, from its own columns of q (samples, nq).

    history : q is a motion, along which the angle of a continuous joint is followed over whole turns; else it is in -pi .. pi
    """
    if not KINDS[joint.kind].circle:
        return q[:, 0]
    angle = np.arctan2(q[:, 1], q[:, 0])
    return np.unwrap(angle) if history else angle
