"""Samples of closed loops: configurations that keep the closures, with rates and accelerations that do, for self-tests."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexinv.constraints.closures import build_constraint_rows
from flexinv.constraints.continuation import close_rates, find_closed_near
from flexinv.errors import ConvergenceError
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import integrate_configuration
from flexinv.typing import Array, Triple

SPREADS = (0.0, 0.1, 0.3, 1.0)  # how far around a guess loops are closed [rad], of the length [-]
ATTEMPTS = 6  # for each of these


def list_closed_samples(mesh: Mesh, guess: Array) -> Iterator[Triple]:
    """Yield closed samples q (nq,), qd, qdd (nv,) [rad or m, s] around a guess (nq,), the same ones every time."""
    m = mesh.mechanism
    random = np.random.default_rng(2)
    rows = build_constraint_rows(mesh)
    every = [np.ones(m.nv, dtype=bool)]
    for spread in SPREADS:
        for _ in range(ATTEMPTS):
            away = integrate_configuration(m, guess, spread * random.uniform(-1.0, 1.0, m.nv))
            qd, qdd = random.uniform(-1.0, 1.0, (2, m.nv))
            try:
                q = find_closed_near(mesh, away)
            except ConvergenceError:
                continue
            close_rates(mesh, rows, q, qd, qdd, every)
            yield q, qd, qdd
