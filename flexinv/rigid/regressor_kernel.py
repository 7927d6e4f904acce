"""Torques of a rigid mechanism as a linear function of its inertial parameters, sample by sample (compiled).

Every link has ten parameters about the origin of its frame, along its axes: m, h = m c, and I.  With a' = R^T (a - g),

    F = m a' + al x h + w x (w x h)              M = h x a' + I al + w x (I w)

is what must act on the link at its origin.  A unit rate of a joint that carries the link moves its origin by p and turns it by t,
so that the joint's effort is

    p . F + t . M = m p . a' + h . (w x (w x p) - al x p + a' x t) + sum I_ij (t_i al_j + u_i w_j)            u = t x w
"""

from __future__ import annotations

from flexinv.kernels.jit import jit
from flexinv.kernels.vec3 import add, apply, cross, dot, madd, mat, outer, put_at, sub, tapply, vec

PARAMETERS = 10


@jit
def fill_regressor(joints, link_node, gravity, motion, out):
    """Fill out (samples, nv, 10 links), d tau / d parameter [m^2/s^2], [m/s^2], [1/s^2]; of a sliding joint per metre less.

    joints : `configuration.Nodes`; link_node : (links,) node of each link's frame; gravity : (3,) [m/s^2]
    motion : `kinematics.tree.Frames` with a leading sample axis
    """
    g = vec(gravity)
    for s in range(motion.x.shape[0]):
        for link in range(len(link_node)):
            n = link_node[link]
            rn = mat(motion.r[s, n])
            xn = vec(motion.x[s, n])
            w = vec(motion.w[s, n])
            al = vec(motion.al[s, n])
            a = tapply(rn, sub(vec(motion.a[s, n]), g))
            m = n
            while m >= 0:
                for i in range(joints.freedoms[m]):
                    rm = mat(motion.r[s, m])
                    arm = sub(xn, vec(motion.x[s, m]))
                    axis = apply(rm, vec(joints.turn[m, i]))
                    p = tapply(rn, add(apply(rm, vec(joints.slide[m, i])), cross(axis, arm)))
                    t = tapply(rn, axis)
                    effort = out[s, joints.v_index[m] + i, PARAMETERS * link :]
                    effort[0] = dot(p, a)
                    put_at(effort, 1, add(sub(cross(w, cross(w, p)), cross(al, p)), cross(a, t)))
                    x, y, z = madd(outer(t, al), outer(cross(t, w), w))
                    put_at(effort, 4, (x[0], x[1] + y[0], y[1]))
                    put_at(effort, 7, (x[2] + z[0], y[2] + z[1], z[2]))
                m = joints.parent[m]
