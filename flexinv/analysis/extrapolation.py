"""Extrapolation of trajectories to steps of no length, by Richardson: rotations in their Lie algebra, all else linearly.

    s(h) = s + c_2 h^2 + c_4 h^4 + ...,   s = sum_k w_k s(h / n_k) + O(h^(2 levels))
    w_k = prod_(j != k) n_k^2 / (n_k^2 - n_j^2)
    R = R_m exp(sum_k w_k log(R_m^T R_k))

The motion of the nodes is what is extrapolated; forces and torques follow by the second step: balances are the answer's own.
Sources: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I*, 1993, II.9; expansions in even powers belong to
symmetric schemes; at a spectral radius below 1 odd powers remain, whose coefficients were measured to be a few per cent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from flexinv.analysis.evaluation import FirstStep
from flexinv.kernels.so3 import exp_so3, log_so3
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array


def weights(finer: Sequence[int]) -> Array:
    """Return the weights [-] of results whose steps are 1/n of the coarsest, n in ``finer``: even powers of the step cancel."""
    squared = np.array(finer, dtype=float) ** 2
    return np.array([np.prod([n / (n - m) for m in squared if m != n]) for n in squared])


def compute_weighted_sum(parts: Sequence[Array], weight: Array) -> Array:
    """Return the weighted sum of arrays of the same shape [any unit]."""
    return np.asarray(sum(w * part for w, part in zip(weight, parts, strict=True)))


def compute_extrapolated_rotations(rotations: Sequence[Array], weight: Array) -> Array:
    """Return rotations (..., 3, 3) [-] extrapolated in the Lie algebra of the last of ``rotations``."""
    base = rotations[-1]
    if len(rotations) == 1:
        return base
    turned = [log_so3(np.swapaxes(base, -1, -2) @ other) for other in rotations[:-1]]
    return base @ exp_so3(compute_weighted_sum(turned, weight[:-1]))


def compute_extrapolated_step(mechanism: Mechanism, steps: Sequence[FirstStep], weight: Array) -> FirstStep:
    """Return the first step of the paper extrapolated from several with the same samples [m, rad, s, N], the finest last."""
    mixed: FirstStep = _apply_to_arrays(
        steps, lambda parts: compute_weighted_sum(parts, weight) if parts[-1].dtype == float else parts[-1]
    )
    trajectory = mixed.trajectory._replace(
        r=compute_extrapolated_rotations([one.trajectory.r for one in steps], weight)
    )
    q, qd, qdd = zip(*(one.joints for one in steps), strict=True)
    joints = (
        _compute_mixed_coordinates(mechanism, q, weight),
        compute_weighted_sum(qd, weight),
        compute_weighted_sum(qdd, weight),
    )
    return replace(mixed, trajectory=trajectory, time=steps[-1].time, joints=joints, brought=steps[-1].brought)


def _apply_to_arrays(records: Sequence[Any], of: Callable[[list[Array]], Array]) -> Any:
    """A record of what ``of`` makes of the arrays in ``records``, also those within other records; all else is the last's."""
    last = records[-1]
    made = dict[str, Any]()
    by_name = hasattr(last, "_fields")  # a named tuple
    for name in last._fields if by_name else [field.name for field in fields(last)]:
        values = [getattr(one, name) for one in records]
        if isinstance(values[-1], np.ndarray):
            made[name] = of(values)
        elif isinstance(values[-1], dict):
            made[name] = {key: of([one[key] for one in values]) for key in values[-1]}
        elif is_dataclass(values[-1]) or hasattr(values[-1], "_fields"):
            made[name] = _apply_to_arrays(values, of)
    return last._replace(**made) if by_name else replace(last, **made)


def _compute_mixed_coordinates(mechanism: Mechanism, parts: Sequence[Array], weight: Array) -> Array:
    """Coordinates (samples, nq): linear, and on the unit sphere for quaternions and angles as (cos, sin)."""
    out = compute_weighted_sum(parts, weight)
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        columns = mechanism.q_slices[joint.name]
        if kind.circle or kind.has_quaternion:
            ball = [part[:, columns.stop - (2 if kind.circle else 4) : columns.stop] for part in parts]
            value = compute_weighted_sum(
                [part * np.sign((part * ball[-1]).sum(axis=1, keepdims=True)) for part in ball], weight
            )
            out[:, columns.stop - value.shape[1] : columns.stop] = value / np.linalg.norm(value, axis=1, keepdims=True)
    return out


def take_every_sample(first: FirstStep, every: int) -> FirstStep:
    """Return every ``every``-th sample [-] of a first step [m, rad, s, N]; energies that closures bring are summed between."""
    if every == 1:
        return first
    samples = len(first.time)
    out: FirstStep = _apply_to_arrays(
        [first], lambda parts: parts[0][::every] if len(parts[0]) == samples else parts[0]
    )
    if first.brought is not None:
        out = replace(out, brought=np.diff(np.cumsum(first.brought)[::every], prepend=0.0))
    q, qd, qdd = (part[::every] for part in first.joints)
    return replace(out, joints=(q, qd, qdd))
