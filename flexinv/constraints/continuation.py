"""Rigid closed loops: passive coordinates from the closure equations.

Kinematics: given coordinates q_g follow the task; the others solve phi(q) = 0 (Newton, continued from sample to sample on the
branch that the start lies on), then G_u qd_u = -G_g qd_g and G_u qdd_u = -(phi'' with qdd_u = 0).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexinv.constraints import closures
from flexinv.constraints import continuation_kernel as kernel
from flexinv.constraints.allocation import REDUNDANT, count_ranks
from flexinv.constraints.closures import (
    Rows,
    build_constraint_rows,
    compute_coupling_residuals,
    evaluate_closures,
    list_coordinate_scales,
    list_velocity_scales,
)
from flexinv.constraints.continuation_kernel import Chain, Continuation, find_branch
from flexinv.constraints.open_loops import make_open_loops_error
from flexinv.constraints.singular_search import WORST_CONDITION, Branch, find_singular, find_within
from flexinv.errors import ConvergenceError, InputError
from flexinv.kernels.memory import make_contiguous
from flexinv.kernels.sparse_qr import FrontFactors
from flexinv.kinematics.configuration import build_nodes
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import JointHistory, compute_rigid_motion, integrate_configuration
from flexinv.model.joint_kinds import KINDS
from flexinv.model.owned_cache import make_read_only
from flexinv.typing import Array, Mask, Triple

# A branch that ends is followed to this near its end [s].
END_OF_BRANCH = 2e-10
# A way between two times of the search for singular positions that is too far for one step is gone in so many.
PARTS_OF_A_WAY = 16
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


def compute_mobility(mesh: Mesh, q: Array) -> Mobility:
    """Return the freedoms and the redundant constraints [-] of a mechanism, at t = 0 and a configuration q (nq,) closed then."""
    rank = _compute_rank(g := build_start_follower(mesh).evaluate_closures(q)[1])
    return Mobility(mesh.mechanism.nv - rank, len(g), len(g) - rank)


def find_closed_near(mesh: Mesh, guess: Array) -> Array:
    """Return a configuration (nq,) [rad], [m] closed at t = 0 near a guess (nq,): every coordinate may move, least squares.
    Raises ConvergenceError, which names the closure that stays open.
    """
    return build_start_follower(mesh).find_start(0.0, guess)


def _compute_rank(matrix: Array) -> int:
    return int(count_ranks(np.linalg.svd(matrix, compute_uv=False))) if matrix.size else 0


def solve_closed_motion(
    mesh: Mesh, history: JointHistory, time: Array, unknown: Mask, rows: Rows | None = None, start: Array | None = None,
    knots: tuple[float, ...] = (),
) -> Triple:  # fmt: skip
    """Return q (samples, nq), qd, qdd (samples, nv) [rad or m, s] with the unknown coordinates on the closures.

    history : time -> q, qd, qdd of the given coordinates (the unknown ones at their initial guess)
    unknown : (nv,) which velocity coordinates follow from the closures
    rows : constraints of the closures that act, all of them by default; those of a phase may repeat what the motion says
    start : (nq,) where the unknown coordinates stand at first, by default where ``history`` has them
    knots : times between which the motion is smooth [s]
    Raises InputError when the task gives more or fewer coordinates than the mechanism has freedoms, ConvergenceError at a
    singular configuration, when the loops cannot be closed, or when the branch is lost; each names the time.
    """
    given = history(time)
    follower = Follower(mesh, build_constraint_rows(mesh) if rows is None else rows, unknown)
    q = np.array(given[0])
    q[0] = follower.find_start(float(time[0]), q[0] if start is None else np.where(follower.owned, start, q[0]))
    follower.check_freedoms(q[0], float(time[0]), phase=rows is not None)
    chain, problem = follower.make_kernel_arguments()
    problem = problem._replace(before=np.zeros(len(problem.fronts.entry)), change=np.zeros(len(time)))
    qd, qdd = (np.where(unknown, 0.0, rate) for rate in given[1:])
    condition = np.empty(len(time))
    k = 1
    while (k := find_branch(chain, problem, np.array(time), q, qd, qdd, condition, k)) < len(time):
        try:
            q[k] = follower.find_next_configuration(history, q[k - 1], float(time[k - 1]), float(time[k]))
        except ConvergenceError:  # Newton may go a little beyond the end, or not quite up to it
            found = find_within(follower.build_branch(history, knots), time, q, problem.change, k - 1)
            if found is None:
                raise
            raise follower.end_of_branch(found, f"above {WORST_CONDITION:.0e}") from None
        k += 1
    follower.check_between((history, knots), time, (q, qd, qdd), condition, problem.change)
    _solve_doubtful_rates(follower, time, (q, qd, qdd), condition)
    return q, qd, qdd


def _solve_doubtful_rates(follower: Follower, time: Array, motion: Triple, condition: Array) -> None:
    """Solve for the unknown rates anew at samples whose condition numbers are too large, or not known."""
    doubtful = ~(condition < WORST_CONDITION)
    if doubtful.any():
        q, qd, qdd = motion
        one, two = (np.where(follower.unknown, 0.0, rate[doubtful]) for rate in (qd, qdd))
        qd[doubtful], qdd[doubtful] = follower.solve_doubtful_rates(q[doubtful], one, two, time[doubtful])


def solve_closed_start(
    mesh: Mesh, guess: Triple, time: float, unknown: Mask, rows: Rows, stated: Mask | None = None
) -> Triple:
    """Return one closed state q (nq,), qd, qdd (nv,) [rad or m, s] from which a mechanism with beams marches on.

    As `solve_closed_motion` at one time, but what the closures leave open stays at its start: it is free to move.
    guess : q, qd, qdd of all coordinates, the unknown ones (nv,) at their start
    stated : (nv,) unknown coordinates whose rates are kept where the others can close them
    Raises ConvergenceError when the loops cannot be closed.
    """
    follower = Follower(mesh, rows, unknown)
    if (closed := follower.find_closed_state(*guess)) is not None:
        return closed
    q = follower.find_start(time, guess[0])
    qd = guess[1].copy()
    qdd = guess[2].copy()
    sets = [unknown] if stated is None else [unknown & ~stated, unknown]
    close_rates(mesh, rows, q, qd, qdd, sets)
    return q, qd, qdd


def solve_closing_step(mesh: Mesh, rows: Rows, g: Array, opening: Array, free: Mask) -> Array:
    """Return the least step (nv,) [rad], [m] of ``free`` coordinates that closes an opening (rows,) [m], [-], or its rates.

    Least squares, lengths and slides over the mechanism's length; g : (rows, nv)
    """
    sizes = list_velocity_scales(mesh)
    a = (g * sizes / rows.scale[:, None])[:, free]
    step = np.zeros(len(free))
    step[free] = -sizes[free] * np.linalg.lstsq(a, opening / rows.scale, rcond=REDUNDANT)[0]
    return step


def close_rates(
    mesh: Mesh, rows: Rows, q: Array, qd: Array, qdd: Array, sets: Sequence[Mask], orders: tuple[int, ...] = (1, 2)
) -> None:
    """Change qd, then qdd (nv,) [rad or m, s] in place by as little as closes them at a closed q (nq,).

    sets : which coordinates (nv,) may change, in the order in which they are tried; of the last what is left open is left
    """
    scale = rows.scale
    for order in orders:
        rate = (qd, qdd)[order - 1]
        state = (q[None], qd[None], qdd[None])
        phi, (g,) = evaluate_closures(mesh, compute_rigid_motion(mesh, *state), rows)
        opening = phi[0, :, order] + compute_coupling_residuals(rows, *state)[order][0]
        bar = CLOSED_RATE * ((np.abs(g) @ np.abs(rate) + np.abs(opening)) / scale).max(initial=0.0)
        for free in sets:  # by least squares, lengths and slides over the mechanism's length
            step = solve_closing_step(mesh, rows, g, opening, free)
            if free is sets[-1] or (np.abs(opening + g @ step) <= bar * scale).all():
                rate += step
                break


@dataclass(frozen=True)
class Follower:
    """Newton on the closure equations ``rows``, in which the ``unknown`` velocity coordinates (nv,) move; continued in time."""

    mesh: Mesh
    rows: Rows
    unknown: Mask

    @cached_property
    def owned(self) -> Mask:
        """Mask (nq,) [-] of the coordinates of joints that move."""
        m = self.mesh.mechanism
        moves = [self.unknown[m.v_slices[j.name]].any() for j in m.joints]
        return np.repeat(np.array(moves, dtype=bool), [len(KINDS[j.kind].q) for j in m.joints])

    @cached_property
    def _chain(self) -> Chain:
        return Chain.build_for(build_nodes(self.mesh), self.rows)

    def make_kernel_arguments(self) -> tuple[Chain, Continuation]:
        """Return the arguments of `continuation_kernel` [m], [-]."""
        m = self.mesh.mechanism
        places = np.flatnonzero(self.unknown)
        fronts = self.rows.build_fronts(self.unknown)
        count = len(self.rows.closure)
        free = len(places)
        problem = Continuation(
            unknown=places,
            owner=self.owned,
            scale=self.rows.scale,
            sizes=list_coordinate_scales(self.mesh),
            g=np.zeros((count, m.nv)),
            fronts=fronts,
            qr=FrontFactors.build_for(fronts),
            y=np.zeros((count, 1)),
            x=np.zeros((free, 1)),
            sign=np.zeros((free, 1)),
            step=np.zeros(m.nv),
            guess=np.zeros(m.nq),
            rest=np.zeros(m.nv),
            measure=list_velocity_scales(self.mesh)[places],
        )
        return self._chain, problem

    def find_closed_state(self, q: Array, qd: Array, qdd: Array) -> Triple | None:
        """Return the closed state near one, compiled [rad or m, s]; None where closures leave something open or Newton fails."""
        chain, problem = self.make_kernel_arguments()
        anywhere = problem._replace(sizes=make_read_only(np.full(len(q), np.inf)))
        both = np.stack([q, q])
        condition = np.empty(2)
        first, second = (np.stack([rate, rate]) for rate in (np.where(self.unknown, 0.0, one) for one in (qd, qdd)))
        reached = find_branch(chain, anywhere, np.zeros(2), both, first, second, condition, 1)
        return (both[1], first[1], second[1]) if reached == 2 and condition[1] < WORST_CONDITION else None

    def solve_doubtful_rates(self, q: Array, qd: Array, qdd: Array, time: Array) -> tuple[Array, Array]:
        """Return exact rates (samples, nv) where singular values have to say whether they are determined [rad or m, s].

        qd, qdd : zero for unknown coordinates; they are set.
        Raises ConvergenceError where the closures do not determine them.
        """
        mesh = self.mesh
        rows = self.rows
        unknown = self.unknown
        sizes = list_velocity_scales(mesh)[unknown]
        _, g = evaluate_closures(mesh, compute_rigid_motion(mesh, q, qd, qdd), rows)
        g = g[:, :, unknown] * sizes / rows.scale[:, None]
        inverse = sizes[:, None] * np.linalg.pinv(g, rcond=REDUNDANT) / rows.scale
        condition = np.linalg.cond(g) if unknown.any() else np.zeros(len(g))
        if condition[worst := int(np.argmax(condition))] > WORST_CONDITION:
            raise self._make_singular_error(float(time[worst]), f"{condition[worst]:.1e}")
        for order, rate in ((1, qd), (2, qdd)):
            phi, _ = evaluate_closures(mesh, compute_rigid_motion(mesh, q, qd, qdd), rows)
            opening = phi[:, :, order] + compute_coupling_residuals(rows, q, qd, qdd)[order]
            rate[:, unknown] = -np.einsum("sur,sr->su", inverse, opening)
        return qd, qdd

    def _make_singular_error(self, time: float, condition: str) -> ConvergenceError:
        return ConvergenceError(
            f"mechanism '{self.mesh.mechanism.name}', t = {time:.10g} s: singular configuration (condition number {condition}): "
            "the closures do not determine the passive coordinates there; drive another joint, or keep the motion away from "
            "this position (a dead point)"
        )

    def check_between(
        self, given: tuple[JointHistory, tuple[float, ...]], time: Array, joints: Triple, condition: Array, change: Array,
    ) -> None:  # fmt: skip
        """Raise ConvergenceError with the instant where the motion passes a singular configuration between two samples.

        given : the motion and its knots [s]; joints : q (samples, nq), qd, qdd (samples, nv) at the samples [rad or m, s]
        condition, change : as in `find_singular`
        """
        if len(time) < 2 or not self.unknown.any():
            return
        way = self.compute_ways(time, joints)
        history, knots = given
        branch = self.build_branch(history, knots)
        if (singular := find_singular(branch, time, joints[0], condition, change, way)) is not None:
            raise self._make_singular_error(singular, f"above {WORST_CONDITION:.0e}")

    def compute_ways(self, time: Array, joints: Triple) -> tuple[Array, Array]:
        """Return the ways of all joints between samples by rates and by accelerations, as `find_singular` takes them [-].

        joints : q (samples, nq), qd, qdd (samples, nv) [rad or m, s] at ``time`` (samples,) [s]
        """
        # G does not change with other joints
        turning = self.rows.pattern[(self.rows.a >= 0) | (self.rows.b >= 0)].any(axis=0)
        rates, accelerations = (
            (np.abs(part) / list_velocity_scales(self.mesh))[:, turning].sum(axis=1) for part in joints[1:]
        )
        step = np.diff(time)
        way = step * np.maximum(rates[1:], rates[:-1])
        back = step**2 * np.maximum(accelerations[1:], accelerations[:-1])
        return way, back

    def build_branch(self, history: JointHistory, knots: tuple[float, ...]) -> Branch:
        """Return the branch on which a motion with knots at some times [s] moves, for the search between samples."""
        return Branch(
            lambda times, start: self._sample_branch(history, times, start),
            self.compute_passive_columns,
            knots,
            self._find_single_driver(history),
        )

    def _find_single_driver(self, history: JointHistory) -> Callable[[Array], Array] | None:
        """The one coordinate that the motion gives, as a function of time; None where it gives several, or no plain number."""
        m = self.mesh.mechanism
        given = [joint for joint in m.moving_joints if not self.unknown[m.v_slices[joint.name]].any()]
        if len(given) != 1 or given[0].nv != 1 or KINDS[given[0].kind].circle:
            return None
        columns = m.q_slices[given[0].name]
        return lambda times: history(times)[0][:, columns][:, 0]

    def compute_passive_columns(self, q: Array) -> Array:
        """Return G_u (samples, rows, unknown) [-] at q (samples, nq), over its scales."""
        rest = np.zeros((len(q), self.mesh.mechanism.nv))
        _, g = evaluate_closures(self.mesh, compute_rigid_motion(self.mesh, q, rest, rest), self.rows)
        return self.take_passive_columns(g)

    def take_passive_columns(self, g: Array) -> Array:
        """Return G_u (samples, rows, unknown) [-], over its scales, from G (samples, rows, nv) of all joints."""
        scales = list_velocity_scales(self.mesh)[self.unknown] / self.rows.scale[:, None]
        return np.asarray(g[:, :, self.unknown] * scales)

    def _sample_branch(self, history: JointHistory, times: Array, start: Array) -> Array:
        """Places (m, nq) of the branch at the m first times that it reaches, from one at the first (nq,).

        Where the way to the next time is too far for one step it is gone in parts, as `advance` does.
        """
        given = history(times)
        q = np.array(given[0])
        q[0] = start
        chain, problem = self.make_kernel_arguments()
        qd, qdd = (np.where(self.unknown, 0.0, rate) for rate in given[1:])
        reached = 1
        while (reached := find_branch(chain, problem, times, q, qd, qdd, np.empty(len(times)), reached)) < len(times):
            parts = np.linspace(times[reached - 1], times[reached], PARTS_OF_A_WAY + 1)
            between = history(parts)
            places = np.array(between[0])
            places[0] = q[reached - 1]
            rates = [np.where(self.unknown, 0.0, rate) for rate in between[1:]]
            if find_branch(chain, problem, parts, places, *rates, np.empty(len(parts)), 1) < len(parts):
                break
            q[reached] = places[-1]
            reached += 1
        return q[:reached]

    def evaluate_closures(self, q: Array) -> tuple[Array, Array]:
        """Return phi (rows,) [-] and its gradient (rows, nv) [-], lengths and slides over the mechanism's length."""
        scale = self.rows.scale
        rest = np.zeros(self.mesh.mechanism.nv)
        g = np.zeros((1, len(scale), len(rest)))
        kernel.fill_closure_equations(self._chain, make_contiguous(q), rest, g[0])
        g = closures.drop_rounding(self.mesh, self.rows.direction, g)
        return self._chain.phi[:, 0] / scale, g[0] * list_velocity_scales(self.mesh) / scale[:, None]

    def replace_unknown(self, unknown: Mask) -> Follower:
        """Return the same equations in which other coordinates (nv,) [rad], [m] move."""
        return replace(self, unknown=unknown)

    def solve(self, q: Array) -> Array | None:
        """Newton from a guess (nq,) [rad], [m]; None if the loops do not close."""
        sizes = list_velocity_scales(self.mesh)
        for _ in range(kernel.MOST_ITERATIONS):
            phi, g = self.evaluate_closures(q)
            if not np.isfinite(phi).all():
                return None
            step = np.zeros(self.mesh.mechanism.nv)
            step[self.unknown] = -np.linalg.lstsq(g[:, self.unknown], phi, rcond=REDUNDANT)[0]
            q = integrate_configuration(self.mesh.mechanism, q, sizes * step)
            if np.abs(step).max(initial=0.0) < kernel.LAST_INCREMENT:
                return q if np.abs(self.evaluate_closures(q)[0]).max(initial=0.0) < kernel.CLOSED else None
        return None

    def find_start(self, time: float, guess: Array) -> Array:
        """Return the closed configuration (nq,) [rad], [m] near a guess at a time [s]; OpenLoops names what stays open."""
        if (q := self.solve(guess)) is None:
            raise make_open_loops_error(self, time, guess)
        return q

    def check_freedoms(self, q: Array, time: float, phase: bool = False) -> None:
        """Raise InputError unless the task gives as many coordinates as the mechanism has freedoms [-] at q [rad], [m].

        In a phase it may give more, as the loops have closed on what it gives; the unknown ones must follow all the same.
        """
        m = self.mesh.mechanism
        _, g = self.evaluate_closures(q)
        if phase:
            if loose := int(self.unknown.sum()) - _compute_rank(g[:, self.unknown]):
                names = ", ".join(n for n, u in zip(m.velocity_names, self.unknown, strict=True) if u)
                raise InputError(
                    f"mechanism '{m.name}', t = {time:g} s: from here on {loose} of the coordinates without motion ({names}) "
                    "follow from no closure that acts; give their joints a motion, or a closure an interval (active_s) that "
                    "covers this time"
                )
            return
        free = m.nv - _compute_rank(g)
        asked = int((~self.unknown).sum())
        if asked != free:
            more = "more" if asked > free else "fewer"
            raise InputError(
                f"mechanism '{m.name}', t = {time:g} s: the motion gives {asked} of the coordinates, {more} than the mobility "
                f"of {free} ({m.nv} joint coordinates, {_compute_rank(g)} independent constraints); give a motion to exactly "
                f"{free} of " + ", ".join(m.velocity_names)
            )

    def find_next_configuration(self, history: JointHistory, q: Array, before: float, after: float) -> Array:
        """Follow the branch from one time to the next [s], in halves where the prediction is poor."""
        done = 0.0
        part = 1.0
        while done < 1.0:
            target = min(1.0, done + part)
            now, then = (before + share * (after - before) for share in (done, target))
            if (reached := self._solve_step(history, q, now, then)) is not None:
                q = reached
                done = target
                part = 2.0 * part
                continue
            part *= 0.5
            if part * (after - before) < END_OF_BRANCH:
                rest = self.evaluate_closures(q)[1][:, self.unknown]
                condition = np.linalg.cond(rest) if rest.size else np.inf
                raise self.end_of_branch(now, f"{condition:.1e}")
        return q

    def end_of_branch(self, time: float, condition: str) -> ConvergenceError:
        """Return the error of a branch that ends at a time [s]."""
        return ConvergenceError(
            f"mechanism '{self.mesh.mechanism.name}', t = {time:.10g} s: the branch of the closures cannot be followed "
            f"(condition number {condition}): a dead point, or the motion asks for a position that the loops cannot "
            "reach; drive another joint or shorten the motion"
        )

    def _solve_step(self, history: JointHistory, q: Array, before: float, after: float) -> Array | None:
        sizes = list_velocity_scales(self.mesh)
        given = history(np.array([after]))[0][0]
        _, g = self.evaluate_closures(q)
        rate = np.where(self.unknown, 0.0, history(np.array([before]))[1][0]) / sizes
        rate[self.unknown] = -np.linalg.lstsq(g[:, self.unknown], g @ rate, rcond=REDUNDANT)[0]
        guess = np.where(
            self.owned, integrate_configuration(self.mesh.mechanism, q, (after - before) * sizes * rate), given
        )
        solution = self.solve(guess)
        most = kernel.LARGEST_SURPRISE * list_coordinate_scales(self.mesh)
        return None if solution is None or (np.abs(solution - guess) > most).any() else solution


def build_start_follower(mesh: Mesh) -> Follower:
    """Return Newton on the closures that act at t = 0, in which all coordinates [rad], [m] move."""
    rows = build_constraint_rows(mesh).take_active(closures.find_acting_closures(mesh.mechanism, 0.0))
    return Follower(mesh, rows, np.ones(mesh.mechanism.nv, dtype=bool))
