"""Generalized-alpha on R^3 x SO(3): how velocities and accelerations follow from the increments of a step.

    d      = h u_n + h^2 (1/2 - beta) A_n + h^2 beta A_(n+1)            x_n + d,  R_n exp(d)
    u      = u_n + h (1 - gamma) A_n + h gamma A_(n+1)
    (1 - alpha_m) A_(n+1) + alpha_m A_n = (1 - alpha_f) u' + alpha_f u'_n

The equation of motion holds exactly at every t_n with the accelerations u', so that nodal forces and torques have no lag.
Source: Bruels, Cardona, Arnold, *Lie group generalized-alpha time integration of constrained flexible multibody
systems*, Mech. Mach. Theory 48, 2012, eqs. (11)-(15); parameters after Chung, Hulbert, 1993.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.assemble import passive_psi
from flexinv.compiled import jit_inner
from flexinv.errors import InputError
from flexinv.rotations import exp, inverse_tangent
from flexinv.vectors import add_to, apply, mat, mul, put_block, scale, vec, vec_at

DYNAMIC, STATIC, ACCELERATION = 0, 1, 2


# What Newton leaves by default: less than rounding.
EXACT = 1e-18
# A new linearisation leaves the square of its increment times this, or less: where axial stiffness meets bending.
SQUARED = 1e3
MOST_LEFT = 1e-6


class Scheme(NamedTuple):
    """What is solved for (DYNAMIC: a time step, STATIC: rest, ACCELERATION: u' at a given state) and with what.

    h [s]; cv = du/dd [1/s]; ca = du'/dd [1/s^2]; the rest dimensionless
    left : what Newton may leave of its unknowns, over the mechanism's length or in radians
    """

    mode: int
    h: float
    cv: float
    ca: float
    beta: float
    gamma: float
    alpha_m: float
    alpha_f: float
    left: float = EXACT


STATICS = Scheme(STATIC, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
# An infinitely short step: acceleration changes by ca y while y itself, and with it all stiffness, vanishes.
ACCELERATIONS = Scheme(ACCELERATION, 0.0, 0.0, 1e30, 0.0, 0.0, 0.0, 0.0)


def generalized_alpha(h: float, spectral_radius: float, left: float = EXACT) -> Scheme:
    """Return the scheme of step ``h`` [s] whose high frequencies shrink by ``spectral_radius`` [-] per step.

    alpha_m = (2 rho - 1)/(rho + 1), alpha_f = rho/(rho + 1), gamma = 1/2 + alpha_f - alpha_m, beta = (gamma + 1/2)^2 / 4.
    Second order for every rho; raises InputError outside 0 <= rho <= 1, for h <= 0, for ``left`` [-] outside 0 < left <= 1e-6.
    """
    rho = spectral_radius
    if not 0.0 <= rho <= 1.0:
        raise InputError(f"spectral_radius = {rho}: expected 0 (strong) to 1 (no numerical damping), for example 0.8")
    if not (h > 0.0 and np.isfinite(h)):
        raise InputError(f"step = {h} s: expected a positive number of seconds, for example step=1e-3")
    alpha_m, alpha_f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma = 0.5 + alpha_f - alpha_m
    beta = 0.25 * (gamma + 0.5) ** 2
    ca = (1 - alpha_m) / ((1 - alpha_f) * beta * h * h)
    if not 0.0 < left <= MOST_LEFT:
        raise InputError(
            f"tolerance = {left}: expected a part of the mechanism's length above 0 and at most {MOST_LEFT:g}, for example 1e-9"
        )
    return Scheme(DYNAMIC, h, gamma / (beta * h), ca, beta, gamma, alpha_m, alpha_f, left)


@jit_inner
def predict(c, s):
    """Start a step: pseudo acceleration kept, all else by the formulas at the head of the file [m, rad, s]."""
    for k in range(len(s.d)):
        s.d[k] = c.h * s.u0[k] + 0.5 * c.h * c.h * s.pseudo[k]
    follow(c, s)


@jit_inner
def pseudo_acceleration(c, s, k):
    """Return the auxiliary acceleration A_(n+1) of unknown k [m/s^2], [rad/s^2], from the increment of the step."""
    return (s.d[k] - c.h * s.u0[k] - c.h * c.h * (0.5 - c.beta) * s.pseudo[k]) / (c.h * c.h * c.beta)


@jit_inner
def follow(c, s):
    """Set velocities and accelerations that belong to the increments of the step [m, rad, s]."""
    for k in range(len(s.d)):
        pseudo = pseudo_acceleration(c, s, k)
        s.u[k] = s.u0[k] + c.h * ((1 - c.gamma) * s.pseudo[k] + c.gamma * pseudo)
        s.du[k] = ((1 - c.alpha_m) * pseudo + c.alpha_m * s.pseudo[k] - c.alpha_f * s.du0[k]) / (1 - c.alpha_f)


@jit_inner
def correct(t, c, s, y):
    """Apply Newton's increments y (unknowns,) [m], [rad]; rotation vectors by d += H(d)^-1 theta."""
    if c.mode == ACCELERATION:
        for k in range(len(y)):
            s.du[k] += c.ca * y[k]
        return
    for n in range(len(t.parent)):
        o = t.offset[t.block[n]]
        if t.independent[n]:
            add_to(s.d, o, vec_at(y, o))
            add_to(s.d, o + 3, apply(inverse_tangent(vec_at(s.d, o + 3)), vec_at(y, o + 3)))
        elif t.freedoms[n] > 0:
            first = o + t.column[n]
            turned = inverse_tangent(passive_psi(n, t, s, first))
            for k in range(t.freedoms[n] if t.triple[n] < 0 else t.triple[n]):
                s.d[first + k] += y[first + k]
            if t.triple[n] >= 0:
                at = first + t.triple[n]
                add_to(s.d, at, apply(turned, vec_at(y, at)))
    if c.mode == DYNAMIC:
        follow(c, s)


@jit_inner
def advance(t, c, s):
    """Finish a step: its end becomes the start of the next [m, rad, s]."""
    for n in range(len(t.parent)):
        o = t.offset[t.block[n]]
        if t.independent[n]:
            add_to(s.x[n], 0, vec_at(s.d, o))
            put_block(s.r[n], 0, 0, mul(mat(s.r[n]), exp(vec_at(s.d, o + 3))))
        elif t.freedoms[n] > 0:
            first = o + t.column[n]
            for k in range(t.freedoms[n]):
                add_to(s.x[n], 0, scale(s.d[first + k], vec(t.slide[n, k])))
            put_block(s.r[n], 0, 0, mul(mat(s.r[n]), exp(passive_psi(n, t, s, first))))
    for k in range(len(s.d)):
        if c.mode == DYNAMIC:
            s.pseudo[k], s.u0[k], s.du0[k] = pseudo_acceleration(c, s, k), s.u[k], s.du[k]
        s.place[k] += s.d[k]
        s.d[k] = 0.0


@jit_inner
def largest_increment(y, scale):
    """Return the largest increment relative to its scale [-]; not finite if one of them is not."""
    largest = 0.0
    for k in range(len(y)):
        size = abs(y[k]) / scale[k]
        if not size <= largest:
            largest = size
        if not np.isfinite(size):
            return size
    return largest
