"""From M y'' + C y' + K y = S u to x' = A x + B u, where some of y has a given acceleration and some has no inertia.

y = T (p, eta, d, e):  p'' is given, eta has inertia, d has none and moves by its rate (dampers, gyroscopic terms), e follows,

    K_ee e = S_e u - K_e. (p, eta, d) - C_ep p' - C_ee' eta'

States are (p, eta, d, p', eta'); d' and eta'' are solved for from the rows of d and eta.

Some of e have terms in C among each other, that act in times too short for all that has inertia (`moved_by_rates`).  To the first
order in these times e is less by  K_ee^-1 F x',  F x' = C_ed d' + C_ee e',  which adds  - K_.e K_ee^-1 F x'  to the rows of d
and eta.  Of a motion x exp(s t) these rows are without the rest of  e = e_0 - s (K_ee + s C_ee)^-1 F x,

    s^2 (K_.e K_ee^-1 C_ee - C_.e) (K_ee + s C_ee)^-1 F x        (`LeftOut`: with K_ee^-1, and a bound of what C_ee adds to it)

Source: Guyan, *Reduction of stiffness and mass matrices*, AIAA J. 3(2), 1965, here for damping.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.errors import InputError
from flexinv.model.by_value import ByValue
from flexinv.typing import Array, Complex

# Of the largest entry of C, what rounding leaves of one that couples what follows.
ROUNDED_COUPLING = 1e-12
# How often a pole is moved by what its own move adds: each time by one more part of the move over its size.
POLE_MOVES = 3


@dataclass(frozen=True)
class Basis:
    """Right columns T and left columns W (unknowns, own) [m], [rad]; prescribed, massive, moved, held : how many of each kind."""

    right: Array
    left: Array
    prescribed: int
    massive: int
    moved: int = 0
    held: int = 0

    @property
    def states(self) -> int:
        """Number of states [-]."""
        return 2 * (self.prescribed + self.massive) + self.moved


@dataclass(frozen=True, eq=False)
class LeftOut(ByValue):
    """The terms that A lacks of motions without inertia that follow at once: x' = A x + matrix x'', and more of third order.

    matrix : (states, states) [s], in units of the states; lag : longest of the times in which they follow [s]
    """

    matrix: Array
    lag: float

    def move(self, root: Complex, along: Array) -> Array:
        """Return by how much poles (poles,) [1/s] move at most: |s|^2 |y^H matrix x| / |y^H x|, and 1 + |s| lag + ... of that.

        along : (poles,) |y^H matrix x| / |y^H x| [s].  s is the pole where it has moved to.  Of second order the vectors move,
        too, by the move over the distance to the next pole.  What is as fast as what follows at once is not known at all.
        """
        size = np.abs(root)
        move = np.zeros(len(root))
        for _ in range(POLE_MOVES):
            farther = size + move
            orders = 1.0 / np.maximum(1.0 - farther * self.lag, np.finfo(float).eps)
            move = np.minimum(farther * farther * along * orders, size)
        apart = np.abs(root[:, None] - root[None])
        apart[np.diag_indices(len(root))] = np.inf
        gap = np.maximum(apart.min(axis=1, initial=np.inf), np.finfo(float).tiny)
        return np.asarray(np.minimum(move * (1.0 + np.minimum(move / gap, 1.0)), size))


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B u; all of y = T (place x + direct u) and of its rates, T (rate x + direct_rate u) [m], [rad], [s].

    left_out : of second order in the times of what follows without inertia; None where nothing is
    """

    a: Array
    b: Array
    place: Array
    direct: Array
    rate: Array
    direct_rate: Array
    left_out: LeftOut | None = None


def build_state_space(basis: Basis, matrices: tuple[Array, Array, Array], efforts: Array) -> StateSpace:
    """Return the state space of M, C and K (unknowns, unknowns) [kg, N, m, s] with efforts (unknowns, inputs) [-].

    Inputs are the efforts, then the given accelerations.  Raises InputError where an effort acts on what follows it without
    inertia and damper, so that a rate would follow the effort's rate.
    """
    mass, damping, stiffness = (basis.left.T @ part @ basis.right for part in matrices)
    push = basis.left.T @ efforts
    g = basis.prescribed
    r = basis.massive
    d = basis.moved
    n = basis.states
    own = len(mass)
    inputs = push.shape[1] + g
    # each of y and of its rates by states x, by x' (rates of d and eta are among these) and by inputs u
    place = np.zeros((own, n))
    direct = np.zeros((own, inputs))
    place[: g + r + d, : g + r + d] = np.eye(g + r + d)
    velocity = np.zeros((g + r, n))
    velocity[:, g + r + d :] = np.eye(g + r)
    e = slice(g + r + d, own)
    if basis.held:
        by_state = stiffness[e, : g + r + d] @ place[: g + r + d] + damping[e, : g + r] @ velocity
        place[e] = -np.linalg.solve(stiffness[e, e], by_state)
        direct[e, : push.shape[1]] = np.linalg.solve(stiffness[e, e], push[e])
        _refuse_rates(direct[e], damping[: g + r + d, e], float(np.abs(damping).max()))
    rows = slice(g, g + r + d)
    unknown = [*range(g + r, g + r + d), *range(n - r, n)]  # d' and eta'' among x'
    known = np.zeros((n, n + inputs))  # p', eta' and p'' among x', by x and u
    known[: g + r, :n] = velocity
    known[g + r + d : 2 * g + r + d, n + push.shape[1] :] = np.eye(g)
    by_rates = damping[rows] @ place
    by_rates[:, g + r + d :] += mass[rows, : g + r]
    if basis.held:
        first = damping[e, e] @ place[e]
        first[:, g + r : g + r + d] += damping[e, g + r : g + r + d]
        later = np.linalg.solve(stiffness[e, e], first)
        by_rates -= stiffness[rows, e] @ later
    side = np.hstack([-stiffness[rows] @ place, -stiffness[rows] @ direct])
    side[:, n : n + push.shape[1]] += push[rows]
    known[unknown] = np.linalg.solve(by_rates[:, unknown], side - by_rates @ known)
    left_out = None
    if basis.held and later.any():
        times = np.linalg.solve(stiffness[e, e], damping[e, e])
        second = stiffness[rows, e] @ times @ later - damping[rows, e] @ later
        left_out = LeftOut(np.zeros((n, n)), float(np.abs(np.linalg.eigvals(times)).max()))
        left_out.matrix[unknown] = -np.linalg.solve(by_rates[:, unknown], second)
    rate = place @ known
    return StateSpace(known[:, :n], known[:, n:], place, direct, rate[:, :n], rate[:, n:], left_out)


def _refuse_rates(direct: Array, across: Array, largest: float) -> None:
    """Refuse what needs the rate of an effort; largest : entry of C [N m s]."""
    if np.abs(across @ direct).max(initial=0.0) > ROUNDED_COUPLING * largest * np.abs(direct).max(initial=0.0):
        raise InputError(
            "linear model: an effort acts on a freedom without inertia that gyroscopic terms couple, so that its rate would be "
            "an input; give its link an inertia"
        )
