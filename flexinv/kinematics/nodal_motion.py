"""NodalMotion: the motion of every node, the interface between the two steps of the paper; and exact rigid kinematics.

Rigid links get it from exact kinematics (`rigid_motion`), flexible ones from the finite-element march (`trajectory`),
measurements could give it too; inverse dynamics (`inverse_dynamics`) never asks which.

Of relative motion ``p``, ``p'``, ``p''`` are taken in the parent node's frame, rotation rates in the node's own frame; what a
node's placement and its joint do together is one relative motion, so that one rule walks the tree (`kinematics.tree.carry`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexinv.errors import InputError
from flexinv.kernels.memory import plain, together
from flexinv.kernels.so3 import log_so3
from flexinv.kinematics.configuration import motion_samples, nodes_of, relative_samples
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.tree import Frames, Joints
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint
from flexinv.typing import Array


@dataclass(frozen=True)
class NodalMotion:
    """Poses, velocities and accelerations of all nodes at all samples.

    x, v, a : (samples, nodes, 3) [m], [m/s], [m/s^2] in the world frame
    rotation : (samples, nodes, 3, 3), R_W,node
    omega, alpha : (samples, nodes, 3) [rad/s], [rad/s^2] in the node's own frame
    """

    x: Array
    rotation: Array
    v: Array
    omega: Array
    a: Array
    alpha: Array

    @property
    def parts(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """The arrays in their order [m, rad, s]."""
        return self.x, self.rotation, self.v, self.omega, self.a, self.alpha

    @property
    def frames(self) -> Frames:
        """The motion as kernels take it, all samples [m, rad, s]."""
        return Frames(*(plain(part) for part in self.parts))

    @classmethod
    def unwritten(cls, samples: int, nodes: int) -> NodalMotion:
        """Return arrays to be filled [m, rad, s]; nothing is in them."""
        vector = (samples, nodes, 3)
        return cls(*together(vector, (*vector, 3), *4 * [vector]))

    @classmethod
    def empty(cls, samples: int, nodes: int) -> NodalMotion:
        """Return arrays to be filled, zero motion [m, rad, s]."""
        x, v, omega, a, alpha = (np.zeros((samples, nodes, 3)) for _ in range(5))
        return cls(x, np.zeros((samples, nodes, 3, 3)), v, omega, a, alpha)

    def samples(self, span: slice) -> NodalMotion:
        """Return the samples of ``span``, not copied [m, rad, s]."""
        return NodalMotion(*(part[span] for part in self.parts))

    def repeated(self, times: int) -> NodalMotion:
        """Return every sample ``times`` [-] times, one after the other."""
        return NodalMotion(*(np.repeat(part, times, axis=0) for part in self.parts))


ORDER = 2  # of the formulas of `differenced`, in the step
FEWEST_SAMPLES = 4  # that the formulas at the ends need


def check_samples(samples: int, step: float) -> None:
    """Raise InputError if there are too few samples of ``step`` [s] for the difference formulas."""
    if samples < FEWEST_SAMPLES:
        raise InputError(
            f"the incremental mode needs at least {FEWEST_SAMPLES} samples, step = {step:g} s gives {samples}: "
            "write a smaller step"
        )


def differenced(motion: NodalMotion, step: float) -> NodalMotion:
    """Return the motion with v, a, omega, alpha from differences of poses over ``step`` [s], the paper's incremental mode.

    Second-order formulas, so the torque error falls with the square of the step:
        inside   x'_n = (x_(n+1) - x_(n-1)) / 2h,      x''_n = (x_(n+1) - 2 x_n + x_(n-1)) / h^2
        ends     x'_0 = (-3 x_0 + 4 x_1 - x_2) / 2h,   x''_0 = (2 x_0 - 5 x_1 + 4 x_2 - x_3) / h^2
    and for rotations the increments phi_n = log(R_n^T R_(n+1)) / h, which are mid-step angular velocities in the body frame:
        w_n = (phi_n + phi_(n-1)) / 2,                 al_n = (phi_n - phi_(n-1)) / h     (linear extrapolation at the ends).
    Raises InputError with fewer than four samples.
    """
    check_samples(len(motion.x), step)
    v = np.gradient(motion.x, step, axis=0, edge_order=2)
    a = _extended(np.diff(motion.x, 2, axis=0) / step**2)
    turn = np.einsum("snji,snjk->snik", motion.rotation[:-1], motion.rotation[1:])
    phi = log_so3(turn) / step  # (step, node, xyz)
    first, last = 1.5 * phi[:1] - 0.5 * phi[1:2], 1.5 * phi[-1:] - 0.5 * phi[-2:-1]
    omega = np.concatenate([first, 0.5 * (phi[1:] + phi[:-1]), last])
    return NodalMotion(motion.x, motion.rotation, v, omega, a, _extended(np.diff(phi, axis=0) / step))


def _extended(inner: Array) -> Array:
    """Values inside with one more at each end, linear from the two next to it: of differences again of second order."""
    return np.concatenate([2 * inner[:1] - inner[1:2], inner, 2 * inner[-1:] - inner[-2:-1]])


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
