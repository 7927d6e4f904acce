"""Pinocchio's inverse dynamics as it is called when time matters: in a loop, and over threads by ``rneaInParallel``.

Every function returns what does the work, and what turns its answer into torques in the mechanism's order, which is no
part of the work.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from crosscheck.engines.pinocchio.model import build, convert_to_engine
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

Work = tuple[Callable[[], Array], Callable[[Array], Array]]


def prepare_loop(mechanism: Mechanism, q: Array, qd: Array, qdd: Array) -> Work:
    """Call ``pin.rnea`` for every sample (samples, nq), (samples, nv) [rad, s]; torques (samples, nv) [N m]."""
    built = build(mechanism)
    model = built.model
    data = built.model.createData()
    state = convert_to_engine(built, q, qd, qdd)
    tau = np.empty((len(q), model.nv))

    def run() -> Array:
        for k, (at, v, a) in enumerate(zip(*state, strict=True)):
            tau[k] = pin.rnea(model, data, at, v, a)
        return tau

    return run, lambda answer: answer[:, built.v_order]


def prepare_parallel(mechanism: Mechanism, q: Array, qd: Array, qdd: Array, threads: int) -> Work:
    """Call ``rneaInParallel`` on all samples (samples, nq), (samples, nv) [rad, s]; torques (samples, nv) [N m].

    It gets what it likes best: matrices in Fortran's order, and one to write into.
    """
    built = build(mechanism)
    pool = pin.ModelPool(built.model, threads)
    state = [np.asfortranarray(part.T) for part in convert_to_engine(built, q, qd, qdd)]
    tau = np.zeros((built.model.nv, len(q)), order="F")

    def run() -> Array:
        pin.rneaInParallel(threads, pool, *state, tau)
        return tau

    return run, lambda answer: answer.T[:, built.v_order]
