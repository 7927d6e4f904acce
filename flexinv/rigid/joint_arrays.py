"""Arguments of prepared functions: arrays of joint motion and of efforts, their shapes checked before a call.

Numbers are looked at where the kernel has found something wrong in them (`check_arrays`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.kernels.simd import ASTRAY
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import ARRAY_TYPE, FLOAT_TYPE, check_kind, convert_to_floats, shown

Order = Literal["samples", "coordinates"]
LABELS = ("q", "qd", "qdd")


def convert_to_states(mechanism: Mechanism, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> list[Array]:
    """Return q (samples, nq), qd, qdd (samples, nv) [rad], [m], [1/s] of a rigid tree as floats, checked for `joint_torques`."""
    check_rigid(check_kind("mechanism", mechanism, Mechanism))
    if mechanism.closures:
        names = ", ".join(c.name for c in mechanism.closures)
        raise InputError(
            f"mechanism '{mechanism.name}' has closures ({names}), through which its drives share the work; "
            "write flexinv.solve(mechanism, motion, step=...) instead"
        )
    return make_contiguous_states(mechanism, (q, qd, qdd), "samples")


def make_contiguous_states(mechanism: Mechanism, arrays: Sequence[ArrayLike], order: Order) -> list[Array]:
    """Return q (samples, nq), qd, qdd (samples, nv) [rad], [m], [1/s] as contiguous floats, their numbers checked, too."""
    given = convert_to_arrays(mechanism, arrays, order)
    check_arrays(mechanism, given, order)
    return [np.ascontiguousarray(convert_to_sample_view(a, order)) for a in given]


def check_rigid(mechanism: Mechanism) -> None:
    """Raise InputError for a mechanism with beams, or with closures that act for a while: no time is known here."""
    if not mechanism.is_rigid:
        names = ", ".join(link.name for link in mechanism.flexible)
        kind = "links that bend" if mechanism.meshed else "beam links"
        raise InputError(
            f"joint_torques: mechanism '{mechanism.name}' has {kind} ({names}), whose deformation depends on the "
            "history of the motion; write flexinv.solve(mechanism, motion, step=...) instead"
        )
    switched = [c.name for c in mechanism.closures if c.active or c.capture]
    if switched:
        raise InputError(
            f"joint_torques: mechanism '{mechanism.name}' has closures that act for a while ({', '.join(switched)}), and here no "
            "time is known; write flexinv.solve(mechanism, motion, step=...) instead"
        )


def convert_to_arrays(mechanism: Mechanism, arrays: Sequence[ArrayLike], order: Order) -> list[Array]:
    """Return q, qd and qdd [rad], [m], [1/s] as floats; arrays of floats are themselves.

    order : "samples" for (samples, columns), "coordinates" for (columns, samples); a plain vector is one sample
    Raises InputError: an order that there is not, a wrong number of columns, numbers of samples that differ.
    """
    if not isinstance(order, str) or order not in ("samples", "coordinates"):
        raise InputError(f"joint_torques: order = {shown(order)}, expected 'samples' or 'coordinates'")
    axis = 0 if order == "coordinates" else -1  # of the columns; -1 - axis is that of the samples
    result = []
    for label, width, given in zip(LABELS, (mechanism.nq, mechanism.nv, mechanism.nv), arrays, strict=True):
        ready = type(given) is ARRAY_TYPE and given.dtype is FLOAT_TYPE and given.flags.aligned
        a: Array = given if ready else convert_to_floats(f"joint_torques: {label}", given)  # type: ignore[assignment]
        if a.ndim not in (1, 2) or a.shape[axis] != width:
            raise _make_shape_error(mechanism, label, a, order)
        result.append(a)
    counts = [a.shape[-1 - axis] if a.ndim == 2 else 1 for a in result]
    if len(set(counts)) > 1:
        raise InputError(f"joint_torques: q, qd, qdd have {counts} samples, expected the same number")
    return result


def _make_shape_error(mechanism: Mechanism, label: str, given: Array, order: Order) -> InputError:
    """The complaint about an array with a wrong number of columns."""
    names = mechanism.coordinate_names if label == "q" else mechanism.velocity_names
    shape = f"({len(names)}, samples)" if order == "coordinates" else f"(samples, {len(names)})"
    needs = f"mechanism '{mechanism.name}' needs {shape}: {', '.join(names)}"
    return InputError(f"joint_torques: {label} has shape {given.shape}, {needs}")


def make_output_array(out: Array | None, like: Array) -> Array:
    """Return the array for efforts [N m], [N]: ``out``, or one in the shape and the memory order of the rates, ``like``.

    Raises InputError: not float64, another shape than ``like``, not contiguous or not writeable.
    """
    if out is None:
        return np.empty_like(like, subok=False)
    plain = isinstance(out, ARRAY_TYPE) and not isinstance(out, np.ma.MaskedArray)
    if not plain or out.shape != like.shape or out.dtype != FLOAT_TYPE:
        given = f"an array of {out.dtype}, shape {out.shape}" if plain else shown(out)
        raise InputError(f"joint_torques: out is {given}, expected an array of float64, shape {like.shape}")
    flags = out.flags
    if not flags.writeable or not flags.aligned or not (flags.c_contiguous or flags.f_contiguous):
        raise InputError("joint_torques: out cannot be written to in one piece, expected a contiguous, writeable array")
    return out


def convert_to_sample_view(a: Array, order: Order) -> Array:
    """Return a view (samples, columns) of an array [any unit] in either order, or of a plain vector."""
    return a[None] if a.ndim == 1 else a.T if order == "coordinates" else a


def check_arrays(mechanism: Mechanism, arrays: Sequence[Array], order: Order) -> None:
    """Raise InputError at the first number [any unit] that is not finite; efforts that overflow are the caller's.

    So it is at the first quaternion of q that is zero, or cosine and sine [-] that no angle has.
    """
    for label, a in zip(LABELS, arrays, strict=True):
        if not np.isfinite(a).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(a))[0])
            raise InputError(f"joint_torques: {label}{list(where)} is {a[where]}, expected a finite number")
    q = convert_to_sample_view(arrays[0], order)
    for joint in mechanism.joints:
        coordinates = q[:, mechanism.q_slices[joint.name]]
        if KINDS[joint.kind].circle:
            off = np.abs((coordinates**2).sum(axis=1) - 1.0) > ASTRAY
            if off.any():
                sample = int(np.argmax(off))
                cosine, sine = coordinates[sample]
                raise InputError(
                    f"joint_torques: q of joint '{joint.name}' at sample {sample} has cosine and sine {cosine:g}, {sine:g}, "
                    f"whose squares sum to {cosine**2 + sine**2:g}; expected those of its angle (neutral: 1, 0)"
                )
        if KINDS[joint.kind].has_quaternion:
            none = ~coordinates[:, -4:].any(axis=1)
            if none.any():
                raise InputError(
                    f"joint_torques: q of joint '{joint.name}' at sample {int(np.argmax(none))} has the quaternion 0, 0, 0, 0; "
                    "expected x, y, z, w of norm 1 (neutral: 0, 0, 0, 1)"
                )
