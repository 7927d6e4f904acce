"""Rigid closed loops: passive coordinates from the closure equations.

Kinematics: given coordinates q_g follow the task; the others solve phi(q) = 0 (Newton, continued from sample to sample on the
branch that the start lies on), then G_u qd_u = -G_g qd_g and G_u qdd_u = -(phi'' with qdd_u = 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from flexinv.constraints.allocation import REDUNDANT, ranks
from flexinv.constraints.closures import (
    Rows,
    closure_fronts,
    constraint_jacobian,
    constraint_rows,
    coupling_residuals,
    measures,
    residuals,
    row_arrays,
    row_scales,
    sizes_of,
    without_rounding,
)
from flexinv.constraints.continuation_kernel import (
    CLOSED,
    LARGEST_SURPRISE,
    LAST_INCREMENT,
    MOST_ITERATIONS,
    Chain,
    Problem,
    closure_equations,
    continue_branch,
)
from flexinv.constraints.phases import acting
from flexinv.errors import ConvergenceError, InputError
from flexinv.kernels.memory import plain
from flexinv.kernels.sparse_qr import FrontFactors
from flexinv.kinematics.configuration import nodes_of
from flexinv.kinematics.configuration_arrays import moved
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import JointHistory, rigid_motion
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

# A configuration whose passive coordinates are this badly determined is singular: eight digits of the torque are lost.
WORST_CONDITION = 1e8
MOST_HALVINGS = 10
# Rates that leave less than this open, relative to what the joints bring, are closed: rounding, over the worst condition that
# configurations have which are not singular to the eye.
CLOSED_RATE = 1e-11


@dataclass(frozen=True)
class Mobility:
    """Mobility of closed loops at one configuration: degrees of freedom, constraints, redundant constraints.

    freedoms : nv - rank(G) [-]; constraints : rows of G; redundant : rows - rank
    """

    freedoms: int
    constraints: int
    redundant: int


def mobility(mesh: Mesh, q: Array) -> Mobility:
    """Return the freedoms and the redundant constraints [-] of a mechanism, at t = 0 and a configuration q (nq,) closed then."""
    rest = np.zeros((1, mesh.mechanism.nv))
    rows = constraint_rows(mesh).of(acting(mesh.mechanism, 0.0))
    g = constraint_jacobian(mesh, rigid_motion(mesh, q[None], rest, rest), rows)[0]
    rank = _rank(g * measures(mesh) / row_scales(mesh, rows)[:, None])
    return Mobility(mesh.mechanism.nv - rank, len(rows), len(rows) - rank)


def closed_near(mesh: Mesh, guess: Array) -> Array:
    """Return a configuration (nq,) [rad], [m] closed at t = 0 near a guess (nq,): every coordinate may move, least squares.

    Raises ConvergenceError, which names the closure that stays open.
    """
    return standing(mesh, guess).start(0.0, guess)


def _rank(matrix: Array) -> int:
    return int(ranks(np.linalg.svd(matrix, compute_uv=False))) if matrix.size else 0


def closed_motion(
    mesh: Mesh,
    history: JointHistory,
    time: Array,
    unknown: NDArray[np.bool_],
    rows: Rows | None = None,
    start: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Return q (samples, nq), qd, qdd (samples, nv) [rad or m, s] with the unknown coordinates on the closures.

    history : time -> q, qd, qdd of the given coordinates (the unknown ones at their initial guess)
    unknown : (nv,) which velocity coordinates follow from the closures
    rows : constraints of the closures that act, all of them by default; those of a phase may repeat what the motion says
    start : (nq,) where the unknown coordinates stand at first, by default where ``history`` has them

    Raises InputError when the task gives more or fewer coordinates than the mechanism has freedoms, ConvergenceError at a
    singular configuration, when the loops cannot be closed, or when the branch is lost; each names the time.
    """
    phase, rows = rows is not None, constraint_rows(mesh) if rows is None else rows
    given = history(time)
    follower = Follower(mesh, rows, history, unknown)
    q = np.array(given[0])
    state = follower.start(float(time[0]), given[0][0] if start is None else follower.mixed(given[0][0], start))
    q[0] = state
    follower.check_freedoms(state, float(time[0]), phase)
    chain, problem = _compiled(mesh, rows, unknown)
    qd, qdd = (np.where(unknown, 0.0, rate) for rate in given[1:])
    condition, k = np.empty(len(time)), 1
    while (k := continue_branch(chain, problem, np.array(time), q, qd, qdd, condition, k)) < len(time):
        q[k] = follower.advance(q[k - 1], float(time[k - 1]), float(time[k]))
        k += 1
    doubtful = ~(condition < WORST_CONDITION)
    if doubtful.any():
        one, two = (np.where(unknown, 0.0, rate[doubtful]) for rate in (qd, qdd))
        qd[doubtful], qdd[doubtful] = _doubtful_rates(mesh, rows, q[doubtful], one, two, unknown, time[doubtful])
    return q, qd, qdd


def closed_start(
    mesh: Mesh,
    history: JointHistory,
    time: float,
    unknown: NDArray[np.bool_],
    rows: Rows,
    stated: NDArray[np.bool_] | None = None,
) -> tuple[Array, Array, Array]:
    """Return one closed state q (nq,), qd, qdd (nv,) [rad or m, s] from which a mechanism with beams marches on.

    As `closed_motion` at one time, but what the closures leave open stays at its start: it is free to move.
    stated : (nv,) unknown coordinates whose rates are kept where the others can close them
    Raises ConvergenceError when the loops cannot be closed.
    """
    q, qd, qdd = (part[0].copy() for part in history(np.array([time])))
    if _close(mesh, rows, unknown, q, qd, qdd):
        return q, qd, qdd
    q = Follower(mesh, rows, history, unknown).start(time, q)
    sets = [unknown] if stated is None else [unknown & ~stated, unknown]
    close_rates(mesh, rows, q, qd, qdd, sets)
    return q, qd, qdd


def close_rates(
    mesh: Mesh,
    rows: Rows,
    q: Array,
    qd: Array,
    qdd: Array,
    sets: Sequence[NDArray[np.bool_]],
    orders: tuple[int, ...] = (1, 2),
) -> None:
    """Change qd, then qdd (nv,) [rad or m, s] in place by as little as closes them at a closed q (nq,).

    sets : which coordinates (nv,) may change, in the order in which they are tried; of the last what is left open is left
    """
    for order in orders:
        rate, motion = (qd, qdd)[order - 1], rigid_motion(mesh, q[None], qd[None], qdd[None])
        g = constraint_jacobian(mesh, motion, rows)[0]
        opening = (residuals(motion, rows)[order] + coupling_residuals(rows, q[None], qd[None], qdd[None])[order])[0]
        scale = row_scales(mesh, rows)
        bar = CLOSED_RATE * ((np.abs(g) @ np.abs(rate) + np.abs(opening)) / scale).max(initial=0.0)
        for free in sets:
            step = -least_step(mesh, rows, g, opening, free)
            if free is sets[-1] or (np.abs(opening + g @ step) <= bar * scale).all():
                rate += step
                break


def least_step(mesh: Mesh, rows: Rows, g: Array, opening: Array, free: NDArray[np.bool_]) -> Array:
    """Return the least step (nv,) [rad or m, s] of the ``free`` coordinates with G step = opening, by least squares.

    G (rows, nv) and the opening (rows,) in metres are taken over the mechanism's length, as are the steps of slides.
    """
    scale, sizes, step = row_scales(mesh, rows), measures(mesh), np.zeros(g.shape[1])
    a = (g * sizes / scale[:, None])[:, free]
    step[free] = sizes[free] * np.linalg.lstsq(a, opening / scale, rcond=REDUNDANT)[0]
    return step


def _close(mesh: Mesh, rows: Rows, unknown: NDArray[np.bool_], q: Array, qd: Array, qdd: Array) -> bool:
    """Close one state in place, compiled; False, and all as it was, where closures leave something open or Newton fails."""
    chain, problem = _compiled(mesh, rows, unknown)
    anywhere = problem._replace(sizes=np.full(len(q), np.inf))
    both, condition = np.stack([q, q]), np.empty(2)
    first, second = (np.stack([rate, rate]) for rate in (np.where(unknown, 0.0, qd), np.where(unknown, 0.0, qdd)))
    reached = continue_branch(chain, anywhere, np.zeros(2), both, first, second, condition, 1)
    if reached < 2 or not condition[1] < WORST_CONDITION:
        return False
    q[:], qd[:], qdd[:] = both[1], first[1], second[1]
    return True


def _doubtful_rates(
    mesh: Mesh, rows: Rows, q: Array, qd: Array, qdd: Array, unknown: NDArray[np.bool_], time: Array
) -> tuple[Array, Array]:
    """Exact rates of the unknown coordinates where singular values have to say whether they are determined."""
    motion = rigid_motion(mesh, q, qd, qdd)
    scale, sizes = row_scales(mesh, rows), measures(mesh)[unknown]
    g = constraint_jacobian(mesh, motion, rows)[:, :, unknown] * sizes / scale[:, None]
    inverse = sizes[:, None] * np.linalg.pinv(g, rcond=REDUNDANT) / scale
    _check_condition(mesh.mechanism, g, time)
    rate = residuals(motion, rows)[1] + coupling_residuals(rows, q, qd, qdd)[1]
    qd[:, unknown] = -np.einsum("sur,sr->su", inverse, rate)
    second = residuals(rigid_motion(mesh, q, qd, qdd), rows)[2] + coupling_residuals(rows, q, qd, qdd)[2]
    qdd[:, unknown] = -np.einsum("sur,sr->su", inverse, second)
    return qd, qdd


def _compiled(mesh: Mesh, rows: Rows, unknown: NDArray[np.bool_]) -> tuple[Chain, Problem]:
    """Return the arguments of `continuation_kernel`."""
    m, places = mesh.mechanism, np.flatnonzero(unknown)
    owner = np.zeros(m.nq, dtype=bool)
    for joint in m.joints:
        owner[m.q_slices[joint.name]] = unknown[m.v_slices[joint.name]].any()
    count, free, fronts = len(rows), len(places), closure_fronts(mesh, rows, unknown)
    problem = Problem(
        unknown=places, owner=owner, scale=row_scales(mesh, rows), sizes=sizes_of(mesh), g=np.zeros((count, m.nv)),
        fronts=fronts, qr=FrontFactors.of(fronts), y=np.zeros((count, 1)), x=np.zeros((free, 1)), sign=np.zeros((free, 1)),
        step=np.zeros(m.nv), guess=np.zeros(m.nq), rest=np.zeros(m.nv), measure=measures(mesh)[places],
    )  # fmt: skip
    return Chain.of(nodes_of(mesh), row_arrays(rows)), problem


def _check_condition(mechanism: Mechanism, g: Array, time: Array) -> None:
    """Raise ConvergenceError where the closures do not determine the unknown coordinates."""
    if g.shape[2] == 0:
        return
    values = np.linalg.svd(g, compute_uv=False)
    condition = values[:, 0] / np.maximum(values[:, g.shape[2] - 1], np.finfo(float).tiny)
    worst = int(np.argmax(condition))
    if condition[worst] > WORST_CONDITION:
        raise ConvergenceError(
            f"mechanism '{mechanism.name}', t = {time[worst]:g} s: singular configuration (condition number "
            f"{condition[worst]:.1e}): the closures do not determine the passive coordinates there; drive another joint, or keep "
            "the motion away from this position (a dead point)"
        )


@dataclass(frozen=True)
class Follower:
    """Newton on the closure equations, continued in time."""

    mesh: Mesh
    rows: Rows
    history: JointHistory
    unknown: NDArray[np.bool_]

    def closures(self, q: Array) -> tuple[Array, Array]:
        """Return phi (rows,) [-] and its gradient (rows, nv) [-], lengths and slides over the mechanism's length."""
        chain, scale, rest = self._chain
        phi, g = np.empty(len(scale)), np.zeros((1, len(scale), len(rest)))
        closure_equations(chain, plain(q), rest, phi, g[0])
        g = without_rounding(self.mesh, self.rows.direction, g)
        return phi / scale, g[0] * measures(self.mesh) / scale[:, None]

    @cached_property
    def _chain(self) -> tuple[Chain, Array, Array]:
        """Return the chain of the closures, the scales of their rows, and rates of rest (nv,)."""
        made = Chain.of(nodes_of(self.mesh), row_arrays(self.rows))
        return made, row_scales(self.mesh, self.rows), np.zeros(self.mesh.mechanism.nv)

    def solve(self, q: Array) -> Array | None:
        """Newton from a guess (nq,) [rad], [m]; None if the loops do not close."""
        sizes = measures(self.mesh)
        for _ in range(MOST_ITERATIONS):
            phi, g = self.closures(q)
            if not np.isfinite(phi).all():
                return None
            step = np.zeros(self.mesh.mechanism.nv)
            step[self.unknown] = -np.linalg.lstsq(g[:, self.unknown], phi, rcond=REDUNDANT)[0]
            q = moved(self.mesh.mechanism, q, sizes * step)
            if np.abs(step).max(initial=0.0) < LAST_INCREMENT:
                return q if np.abs(self.closures(q)[0]).max(initial=0.0) < CLOSED else None
        return None

    def start(self, time: float, guess: Array) -> Array:
        """Return the closed configuration (nq,) [rad], [m] near a guess at a time [s]; ConvergenceError names what stays open."""
        q = self.solve(guess)
        if q is None:
            m = self.mesh.mechanism
            phi = np.abs(self.closures(guess)[0])
            worst = m.closures[int(self.rows.closure[int(np.argmax(phi))])].name
            asked = int((~self.unknown).sum())
            fewer = (
                f", or if the loops leave fewer freedoms a motion of fewer than {asked} coordinates"
                if asked > 1
                else ""
            )
            raise ConvergenceError(
                f"mechanism '{m.name}', t = {time:g} s: the loops do not close from this start (closure '{worst}' is open by "
                f"{phi.max():.2g}); give a better guess of the passive joints: start = {{...}}{fewer}"
            )
        return q

    def mixed(self, given: Array, start: Array) -> Array:
        """Return the given coordinates with the unknown ones from ``start``, (nq,) [rad], [m]."""
        m, out = self.mesh.mechanism, given.copy()
        for joint in m.joints:
            if self.unknown[m.v_slices[joint.name]].any():
                out[m.q_slices[joint.name]] = start[m.q_slices[joint.name]]
        return out

    def check_freedoms(self, q: Array, time: float, phase: bool = False) -> None:
        """Raise InputError unless the task gives as many coordinates as the mechanism has freedoms [-] at q [rad], [m].

        In a phase it may give more, as the loops have closed on what it gives; the unknown ones must follow all the same.
        """
        m = self.mesh.mechanism
        _, g = self.closures(q)
        if phase:
            loose = int(self.unknown.sum()) - _rank(g[:, self.unknown])
            if loose:
                names = ", ".join(n for n, u in zip(m.velocity_names, self.unknown, strict=True) if u)
                raise InputError(
                    f"mechanism '{m.name}', t = {time:g} s: from here on {loose} of the coordinates without motion ({names}) "
                    "follow from no closure that acts; give their joints a motion, or a closure an interval (active_s) that "
                    "covers this time"
                )
            return
        free, asked = m.nv - _rank(g), int((~self.unknown).sum())
        if asked != free:
            more = "more" if asked > free else "fewer"
            raise InputError(
                f"mechanism '{m.name}', t = {time:g} s: the motion gives {asked} of the coordinates, {more} than the mobility "
                f"of {free} ({m.nv} joint coordinates, {_rank(g)} independent constraints); give a motion to exactly {free} of "
                + ", ".join(m.velocity_names)
            )

    def advance(self, q: Array, before: float, after: float) -> Array:
        """Follow the branch from one time to the next [s], in halves where the prediction is poor."""
        done, part = 0.0, 1.0
        while done < 1.0:
            target = min(1.0, done + part)
            reached = self._step(q, before + done * (after - before), before + target * (after - before))
            if reached is not None:
                q, done = reached, target
                continue
            part *= 0.5
            if part < 0.5**MOST_HALVINGS:
                self._lost(q, before + done * (after - before))
        return q

    def _step(self, q: Array, before: float, after: float) -> Array | None:
        first, last = (tuple(part[0] for part in self.history(np.array([t]))) for t in (before, after))
        m = self.mesh.mechanism
        _, g = self.closures(q)
        dt = after - before
        rate = np.where(self.unknown, 0.0, first[1]) / measures(self.mesh)
        rate[self.unknown] = -np.linalg.lstsq(g[:, self.unknown], g @ rate, rcond=REDUNDANT)[0]
        guess = moved(m, q, dt * measures(self.mesh) * rate)
        for joint in m.joints:
            if not self.unknown[m.v_slices[joint.name]].any():
                guess[m.q_slices[joint.name]] = last[0][m.q_slices[joint.name]]
        found = self.solve(guess)
        if found is None or (np.abs(found - guess) > LARGEST_SURPRISE * sizes_of(self.mesh)).any():
            return None
        return found

    def _lost(self, q: Array, time: float) -> NoReturn:
        m = self.mesh.mechanism
        _, g = self.closures(q)
        values = np.linalg.svd(g[:, self.unknown], compute_uv=False)
        condition = values[0] / max(values[int(self.unknown.sum()) - 1], np.finfo(float).tiny)
        raise ConvergenceError(
            f"mechanism '{m.name}', t = {time:g} s: the branch of the closures cannot be followed (condition number "
            f"{condition:.1e}): a dead point, or the motion asks for a position that the loops cannot reach; drive another joint "
            "or shorten the motion"
        )


def standing(mesh: Mesh, q: Array) -> Follower:
    """Return Newton on the closures that act at t = 0, all coordinates free, that stand still at q (nq,) [rad], [m]."""
    rest = np.zeros((1, mesh.mechanism.nv))
    rows = constraint_rows(mesh).of(acting(mesh.mechanism, 0.0))
    return Follower(mesh, rows, lambda time: (q[None], rest, rest), np.ones(mesh.mechanism.nv, dtype=bool))
