"""NodalMotion: the motion of every node, the interface between the two steps of the paper.

Rigid links get it from exact kinematics (`joint_motion`), flexible ones from the finite-element march (`trajectory`),
measurements could give it too; inverse dynamics (`inverse_dynamics`) never asks which.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.kernels.memory import plain, together
from flexinv.kinematics.tree import Frames
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
        zeros = [np.zeros((samples, nodes, 3)) for _ in range(5)]
        x, v, omega, a, alpha = zeros
        return cls(x, np.zeros((samples, nodes, 3, 3)), v, omega, a, alpha)

    def samples(self, span: slice) -> NodalMotion:
        """Return the samples of ``span``, not copied [m, rad, s]."""
        return NodalMotion(*(part[span] for part in self.parts))

    def repeated(self, times: int) -> NodalMotion:
        """Return every sample ``times`` [-] times, one after the other."""
        return NodalMotion(*(np.repeat(part, times, axis=0) for part in self.parts))
