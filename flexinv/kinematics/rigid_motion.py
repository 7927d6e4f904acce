"""Exact rigid kinematics: joint coordinates to the motion of every node (beams undeformed)."""

from __future__ import annotations

from flexinv.kernels.memory import together
from flexinv.kinematics.joint_motion import Relative, relative_motion
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Frames, Joints, carry_samples
from flexinv.typing import Array


def rigid_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> NodalMotion:
    """Return the nodal motion [m, rad, s] of the undeformed mechanism for q (samples, nq), qd, qdd (samples, nv).

    Each node's pose, velocity and acceleration follow from its parent's by the equations at the head of `kinematics.tree`.
    """
    return carried(mesh, relative_motion(mesh, q, qd, qdd))


def carried(mesh: Mesh, relative: Relative) -> NodalMotion:
    """Return the nodal motion [m, rad, s] of nodes that move so relative to their parents."""
    vector = (len(relative.p), mesh.size, 3)
    motion = NodalMotion(*together(vector, (*vector, 3), *4 * [vector]))
    world = Frames(motion.x, motion.rotation, motion.v, motion.omega, motion.a, motion.alpha)
    carry_samples(mesh.parent, world, Joints(*relative))
    return motion
