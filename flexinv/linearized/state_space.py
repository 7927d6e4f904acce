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


@dataclass(frozen=True)
class _Equations:
    """M, C, K and the efforts in the columns of a basis, (own, own) and (own, efforts)."""

    basis: Basis
    mass: Array
    damping: Array
    stiffness: Array
    push: Array

    @property
    def inertial(self) -> int:
        """Columns that are prescribed or have inertia, the first ones."""
        return self.basis.prescribed + self.basis.massive

    @property
    def moving(self) -> int:
        """Columns that are states: these, and those that move by their rates; others follow."""
        return self.inertial + self.basis.moved

    @property
    def inputs(self) -> int:
        return int(self.push.shape[1]) + self.basis.prescribed

    @property
    def follows(self) -> slice:
        """Columns that follow the states."""
        return slice(self.moving, len(self.mass))

    @property
    def rows(self) -> slice:
        """Rows of eta and d, from which eta'' and d' are solved for."""
        return slice(self.basis.prescribed, self.moving)

    @property
    def unknown(self) -> list[int]:
        """Places of d' and eta'' among x'."""
        n = self.basis.states
        return [*range(self.inertial, self.moving), *range(n - self.basis.massive, n)]

    @property
    def velocity(self) -> Array:
        """(inertial, states) p' and eta' by the states."""
        velocity = np.zeros((self.inertial, self.basis.states))
        velocity[:, self.moving :] = np.eye(self.inertial)
        return velocity


def build_state_space(basis: Basis, matrices: tuple[Array, Array, Array], efforts: Array) -> StateSpace:
    """Return the state space of M, C and K (unknowns, unknowns) [kg, N, m, s] with efforts (unknowns, inputs) [-].

    Inputs are the efforts, then the given accelerations.  Raises InputError where an effort acts on what follows it without
    inertia and damper, so that a rate would follow the effort's rate.
    """
    mass, damping, stiffness = (basis.left.T @ part @ basis.right for part in matrices)
    equations = _Equations(basis, mass, damping, stiffness, basis.left.T @ efforts)
    n = basis.states
    efforts_end = n + equations.push.shape[1]
    place, direct = _compute_places(equations)
    known = np.zeros((n, n + equations.inputs))  # p', eta' and p'' among x', by x and u
    known[: equations.inertial, :n] = equations.velocity
    known[equations.moving : equations.moving + basis.prescribed, efforts_end:] = np.eye(basis.prescribed)
    by_rates = damping[equations.rows] @ place
    by_rates[:, equations.moving :] += mass[equations.rows, : equations.inertial]
    later = _find_delay(equations, place)
    if later is not None:
        by_rates -= stiffness[equations.rows, equations.follows] @ later
    side = np.hstack([-stiffness[equations.rows] @ place, -stiffness[equations.rows] @ direct])
    side[:, n:efforts_end] += equations.push[equations.rows]
    known[equations.unknown] = np.linalg.solve(by_rates[:, equations.unknown], side - by_rates @ known)
    left_out = None if later is None or not later.any() else _find_left_out(equations, by_rates, later)
    rate = place @ known
    return StateSpace(known[:, :n], known[:, n:], place, direct, rate[:, :n], rate[:, n:], left_out)


def _compute_places(equations: _Equations) -> tuple[Array, Array]:
    """Each of the own unknowns by the states (own, states) and by the inputs (own, inputs)."""
    place = np.zeros((len(equations.mass), equations.basis.states))
    direct = np.zeros((len(equations.mass), equations.inputs))
    ahead = equations.moving
    place[:ahead, :ahead] = np.eye(ahead)
    if equations.basis.held:
        e = equations.follows
        by_state = (
            equations.stiffness[e, :ahead] @ place[:ahead]
            + equations.damping[e, : equations.inertial] @ equations.velocity
        )
        place[e] = -np.linalg.solve(equations.stiffness[e, e], by_state)
        direct[e, : equations.push.shape[1]] = np.linalg.solve(equations.stiffness[e, e], equations.push[e])
        _refuse_rates(direct[e], equations.damping[:ahead, e], float(np.abs(equations.damping).max()))
    return place, direct


def _find_delay(equations: _Equations, place: Array) -> Array | None:
    """K_ee^-1 F: what follows is less by so much of the rates of the states; None where nothing follows."""
    if not equations.basis.held:
        return None
    e = equations.follows
    moved = slice(equations.inertial, equations.moving)
    first = equations.damping[e, e] @ place[e]
    first[:, moved] += equations.damping[e, moved]
    return np.asarray(np.linalg.solve(equations.stiffness[e, e], first))


def _find_left_out(equations: _Equations, by_rates: Array, later: Array) -> LeftOut:
    """The terms of second order in the times of what follows; by_rates : of the rows of eta and d, later : `_find_delay`."""
    e = equations.follows
    n = equations.basis.states
    times = np.linalg.solve(equations.stiffness[e, e], equations.damping[e, e])
    second = equations.stiffness[equations.rows, e] @ times @ later - equations.damping[equations.rows, e] @ later
    left_out = LeftOut(np.zeros((n, n)), float(np.abs(np.linalg.eigvals(times)).max()))
    left_out.matrix[equations.unknown] = -np.linalg.solve(by_rates[:, equations.unknown], second)
    return left_out


def _refuse_rates(direct: Array, across: Array, largest: float) -> None:
    """Refuse what needs the rate of an effort; largest : entry of C [N m s]."""
    if np.abs(across @ direct).max(initial=0.0) > ROUNDED_COUPLING * largest * np.abs(direct).max(initial=0.0):
        raise InputError(
            "linear model: an effort acts on a freedom without inertia that gyroscopic terms couple, so that its rate would be "
            "an input; give its link an inertia"
        )
