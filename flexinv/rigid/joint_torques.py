"""Joint torques of a rigid mechanism for given joint motion: exact kinematics, then the paper's inverse dynamics."""

from __future__ import annotations

from numpy.typing import ArrayLike

from flexinv.model.mechanism import Mechanism
from flexinv.rigid.joint_arrays import Order
from flexinv.rigid.prepare import prepare
from flexinv.typing import Array


def joint_torques(
    mechanism: Mechanism,
    q: ArrayLike,
    qd: ArrayLike,
    qdd: ArrayLike,
    passive: bool = True,
    out: Array | None = None,
    order: Order = "samples",
    threads: int | None = None,
) -> Array:
    """Return the effort of every joint coordinate, (samples, nv) [N m] or [N], of a rigid mechanism.

    tau = L T P, P = M (a - g), on exact kinematics: equal to recursive Newton-Euler to rounding.

    q : (samples, nq) [rad], [m], quaternions x, y, z, w; qd, qdd : (samples, nv) [rad/s], [m/s] and per second;
        Pinocchio's layout, in the order of ``mechanism.coordinate_names``; one sample may be given as a plain vector
    passive : joint springs, damping and dry friction are part of what the actuator must give (``rnea`` leaves them out)
    out : where the efforts go, in the shape of qd; order : "coordinates" for arrays (nq, samples), (nv, samples)
    threads : most that work on the call [-], by default one for every processor; small batches are not shared out

    For calls in a loop `prepare` the mechanism once.
    Raises InputError for a flexible mechanism (use `solve`), a wrong shape or a value that is not finite.
    """
    return prepare(mechanism, passive, threads).torques(q, qd, qdd, out, order)
