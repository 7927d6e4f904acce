"""Torques of a rigid mechanism as a linear function of its inertial parameters, sample by sample (compiled).

Every link has ten parameters about the origin of its frame, along its axes: m, h = m c, and I.  With a' = R^T (a - g),

    F = m a' + al x h + w x (w x h)              M = h x a' + I al + w x (I w)

is what must act on the link at its origin; each parameter's share of it goes down to every joint that carries the link.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import by_address
from flexinv.kernels.vec3 import ZERO, add, apply, cross, dot, mat, sub, tapply, vec
from flexinv.typing import Array

PARAMETERS = 10
UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@by_address
class JointAxes(NamedTuple):
    """Joints of the nodes: parent, v_index, freedoms (nodes,); slide, turn (nodes, 6, 3) their axes in the node's frame [-]."""

    parent: NDArray[np.int64]
    v_index: NDArray[np.int64]
    freedoms: NDArray[np.int64]
    slide: Array
    turn: Array


@jit_inner
def _times_unit(k, v):
    """E_k v of the inertia's parameter number k: xx, xy, yy, xz, yz, zz."""
    x, y, z = v
    if k == 0:
        return x, 0.0, 0.0
    if k == 1:
        return y, x, 0.0
    if k == 2:
        return 0.0, y, 0.0
    if k == 3:
        return z, 0.0, x
    if k == 4:
        return 0.0, z, y
    return 0.0, 0.0, z


@jit_inner
def _unit_wrench(parameter, acceleration, omega, alpha):
    """F and M (own frame) of one parameter alone, of unit size."""
    if parameter == 0:
        return acceleration, ZERO
    if parameter <= 3:
        h = UNIT[parameter - 1]
        return add(cross(alpha, h), cross(omega, cross(omega, h))), cross(h, acceleration)
    return ZERO, add(_times_unit(parameter - 4, alpha), cross(omega, _times_unit(parameter - 4, omega)))


@jit
def regressor_samples(joints, link_node, gravity, motion, out):
    """Fill out (samples, nv, 10 links), d tau / d parameter [m^2/s^2], [m/s^2], [1/s^2]; of a sliding joint per metre less.

    joints : JointAxes; link_node : (links,) node of each link's frame; gravity : (3,) [m/s^2]
    motion : `kinematics.tree.Frames` with a leading sample axis
    """
    g = vec(gravity)
    for s in range(motion.x.shape[0]):
        for link in range(len(link_node)):
            n = link_node[link]
            rn, xn = mat(motion.r[s, n]), vec(motion.x[s, n])
            wn, aln = vec(motion.w[s, n]), vec(motion.al[s, n])
            an = tapply(rn, sub(vec(motion.a[s, n]), g))
            for k in range(PARAMETERS):
                own_force, own_moment = _unit_wrench(k, an, wn, aln)
                force, moment = apply(rn, own_force), apply(rn, own_moment)
                m = n
                while m >= 0:
                    if joints.freedoms[m] > 0:
                        rm = mat(motion.r[s, m])
                        here = tapply(rm, force)
                        turning = tapply(rm, add(moment, cross(sub(xn, vec(motion.x[s, m])), force)))
                        for i in range(joints.freedoms[m]):
                            effort = dot(vec(joints.slide[m, i]), here) + dot(vec(joints.turn[m, i]), turning)
                            out[s, joints.v_index[m] + i, PARAMETERS * link + k] = effort
                    m = joints.parent[m]
