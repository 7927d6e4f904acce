"""What is given to prepared functions, looked at where the kernel has found something wrong in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexinv.errors import InputError
from flexinv.lanes import ASTRAY
from flexinv.mechanism import Array, Mechanism

LABELS = ("q", "qd", "qdd")


def check_finite(arrays: Sequence[Array]) -> None:
    """Raise InputError at the first number [any unit] that is not finite; efforts that overflow are the caller's."""
    for label, a in zip(LABELS, arrays, strict=True):
        if not np.isfinite(a).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(a))[0])
            raise InputError(f"joint_torques: {label}{list(where)} is {a[where]}, expected a finite number")


def check_turns(mechanism: Mechanism, q: Array) -> None:
    """Raise InputError at the first quaternion of q (samples, nq) that is zero, or cosine and sine [-] that no angle has."""
    for joint in mechanism.joints:
        if joint.kind == "continuous":
            own = q[:, mechanism.q_slices[joint.name]]
            off = np.abs((own**2).sum(axis=1) - 1.0) > ASTRAY
            if off.any():
                sample = int(np.argmax(off))
                raise InputError(
                    f"joint_torques: q of joint '{joint.name}' at sample {sample} has cosine and sine {own[sample, 0]:g}, "
                    f"{own[sample, 1]:g}, whose squares sum to {(own[sample] ** 2).sum():g}; expected those of its angle "
                    "(neutral: 1, 0)"
                )
        if joint.kind in ("spherical", "free"):
            none = ~q[:, mechanism.q_slices[joint.name]][:, -4:].any(axis=1)
            if none.any():
                raise InputError(
                    f"joint_torques: q of joint '{joint.name}' at sample {int(np.argmax(none))} has the quaternion 0, 0, 0, 0; "
                    "expected x, y, z, w of norm 1 (neutral: 0, 0, 0, 1)"
                )
