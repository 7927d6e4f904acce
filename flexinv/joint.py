"""One joint: relative pose, velocity and acceleration from its coordinates, for all samples at once.

With the joint frame A fixed in the parent and the child's frame B,

    x_B = x_A + R_A p          R_B = R_A R_j
    v_B = v_A + R_A (w_A x p + p')              w_B = R_j^T w_A + w_j
    a_B = a_A + R_A (al_A x p + w_A x (w_A x p) + 2 w_A x p' + p'')
    al_B = R_j^T al_A + al_j + (R_j^T w_A) x w_j

(angular quantities in the frame they are named for, positions in the world).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.mechanism import Array
from flexinv.mesh import CONTINUOUS, FREE, PRISMATIC, REVOLUTE, SPHERICAL
from flexinv.rotations import about_axis, about_axis_cs, from_quaternion


@dataclass(frozen=True)
class JointMotion:
    """Motion of the child's frame relative to the joint frame.

    p, dp, ddp : (samples, 3) [m], [m/s], [m/s^2] in the joint frame
    rotation : (samples, 3, 3); rate, acceleration : (samples, 3) [rad/s], [rad/s^2] in the child's frame
    """

    p: Array
    dp: Array
    ddp: Array
    rotation: Array
    rate: Array
    acceleration: Array


def joint_motion(kind: int, axis: Array, q: Array, qd: Array, qdd: Array) -> JointMotion:
    """Return the relative motion of one joint from q (samples, nq), qd, qdd (samples, nv) [rad or m, s].

    ``axis`` (3,) is the unit axis of a revolute, continuous or prismatic joint.  The velocity of a free joint is
    linear [m/s] then angular [rad/s], both in the child's frame: p' = R_j v, p'' = R_j (v' + w x v).
    """
    samples = len(q)
    zero = np.zeros((samples, 3))
    still = np.broadcast_to(np.eye(3), (samples, 3, 3))
    if kind == REVOLUTE:
        return JointMotion(zero, zero, zero, about_axis(axis, q[:, 0]), qd * axis, qdd * axis)
    if kind == CONTINUOUS:
        return JointMotion(zero, zero, zero, about_axis_cs(axis, q[:, 0], q[:, 1]), qd * axis, qdd * axis)
    if kind == PRISMATIC:
        return JointMotion(q * axis, qd * axis, qdd * axis, still, zero, zero)
    if kind == SPHERICAL:
        return JointMotion(zero, zero, zero, from_quaternion(q), qd, qdd)
    if kind == FREE:
        rotation = from_quaternion(q[:, 3:])
        v, w = qd[:, :3], qd[:, 3:]
        dp = np.einsum("sij,sj->si", rotation, v)  # (sample, xyz)
        ddp = np.einsum("sij,sj->si", rotation, qdd[:, :3] + np.cross(w, v))
        return JointMotion(q[:, :3], dp, ddp, rotation, w, qdd[:, 3:])
    return JointMotion(zero, zero, zero, still, zero, zero)


def joint_effort(kind: int, axis: Array, force: Array, moment: Array) -> Array:
    """Return the components of a wrench along the joint's coordinates, (samples, nv) [N m] or [N].

    ``force`` [N] and ``moment`` [N m], (samples, 3), act on the child at its link frame, in that frame's axes.
    """
    if kind in (REVOLUTE, CONTINUOUS):
        return (moment @ axis)[:, None]
    if kind == PRISMATIC:
        return (force @ axis)[:, None]
    if kind == SPHERICAL:
        return moment
    if kind == FREE:
        return np.concatenate([force, moment], axis=1)
    return np.empty((len(force), 0))
