"""Joint torques of a rigid mechanism for given joint motion: exact kinematics, then the paper's inverse dynamics."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flexinv.applied import applied_forces, check_constant, joint_springs
from flexinv.errors import InputError
from flexinv.inverse import inverse_dynamics
from flexinv.mechanism import Array, Mechanism
from flexinv.mesh import build
from flexinv.rigid import rigid_motion

# Samples handled at once: nodal histories of a block stay in the cache.
BLOCK = 512


def joint_torques(mechanism: Mechanism, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, passive: bool = True) -> Array:
    """Return the effort of every joint coordinate, (samples, nv) [N m] or [N], of a rigid mechanism.

    tau = L T P, P = M (a - g), on exact kinematics: equal to recursive Newton-Euler to rounding.

    q : (samples, nq) [rad], [m], quaternions x, y, z, w; qd, qdd : (samples, nv) [rad/s], [m/s] and per second;
        Pinocchio's layout, in the order of ``mechanism.coordinate_names``; one sample may be given as a plain vector
    passive : joint springs, damping and dry friction are part of what the actuator must give (``rnea`` leaves them out)

    Raises InputError for a flexible mechanism (use `solve`), a wrong shape or a value that is not finite.
    """
    if not mechanism.is_rigid:
        names = ", ".join(link.name for link in mechanism.beams)
        raise InputError(
            f"joint_torques: mechanism '{mechanism.name}' has beam links ({names}), whose deformation depends on the "
            "history of the motion; write flexinv.solve(mechanism, motion, step=...) instead"
        )
    if mechanism.closures:
        names = ", ".join(c.name for c in mechanism.closures)
        raise InputError(
            f"joint_torques: mechanism '{mechanism.name}' has closures ({names}), through which its drives share the work; "
            "write flexinv.solve(mechanism, motion, step=...) instead"
        )
    check_constant(mechanism)
    rows = _checked(mechanism, q, qd, qdd)
    mesh = build(mechanism)
    tau = np.empty((len(rows[0]), mechanism.nv))
    for start in range(0, len(tau), BLOCK):
        q_, qd_, qdd_ = (part[start : start + BLOCK] for part in rows)
        motion = rigid_motion(mesh, q_, qd_, qdd_)
        applied = applied_forces(mesh, motion, np.zeros(len(q_)))
        tau[start : start + BLOCK] = inverse_dynamics(mesh, motion, qd_, qdd_, applied, passive)
        if passive:
            tau[start : start + BLOCK] += joint_springs(mechanism, q_, history=False)
    return tau if np.ndim(q) == 2 else tau[0]


def _checked(mechanism: Mechanism, *arrays: ArrayLike) -> list[Array]:
    widths = (mechanism.nq, mechanism.nv, mechanism.nv)
    rows = []
    for label, width, given in zip(("q", "qd", "qdd"), widths, arrays, strict=True):
        a = np.asarray(given, dtype=float)
        if a.ndim not in (1, 2) or a.shape[-1] != width:
            names = mechanism.coordinate_names if label == "q" else mechanism.velocity_names
            raise InputError(
                f"joint_torques: {label} has shape {a.shape}, mechanism '{mechanism.name}' needs (samples, {width}): "
                + ", ".join(names)
            )
        if not np.isfinite(a).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(a))[0])
            raise InputError(f"joint_torques: {label}{list(where)} is {a[where]}, expected a finite number")
        rows.append(np.atleast_2d(a))
    if len({len(a) for a in rows}) > 1:
        raise InputError(f"joint_torques: q, qd, qdd have {[len(a) for a in rows]} samples, expected the same number")
    return rows
