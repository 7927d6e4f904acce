"""Exact rigid kinematics: joint coordinates to the motion of every node (beams undeformed)."""

from __future__ import annotations

from flexinv.kernels.memory import plain, together
from flexinv.kinematics.configuration import motion_samples, nodes_of
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Frames, Joints
from flexinv.typing import Array


def rigid_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> NodalMotion:
    """Return the nodal motion [m, rad, s] of the undeformed mechanism for q (samples, nq), qd, qdd (samples, nv).

    Each node's pose, velocity and acceleration follow from its parent's by the equations at the head of `kinematics.tree`.
    """
    motion, one = NodalMotion.unwritten(len(q), mesh.size), (mesh.size, 3)
    joints = Joints(*together(*3 * [one], (*one, 3), *2 * [one]))
    motion_samples(nodes_of(mesh), plain(q), plain(qd), plain(qdd), joints, Frames(*motion.parts))
    return motion
