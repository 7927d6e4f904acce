"""Generalized-alpha on R^3 x SO(3): velocities and accelerations as functions of the increments of a step.

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

from flexinv.dynamics.assembly import compute_joint_rotation
from flexinv.errors import InputError
from flexinv.kernels.jit import jit, jit_inner
from flexinv.kernels.records import send_by_address
from flexinv.kernels.so3 import exp, inverse_tangent
from flexinv.kernels.vec3 import add_at, add_to, apply, mat, mul, put_mat, scale, vec, vec_at
from flexinv.typing import Array, Indices

DYNAMIC = 0
STATIC = 1
ACCELERATION = 2
RESOLVED = 3

# A step does not resolve all accelerations of a start: a couple on a section of 1e-10 kg m^2 gives 1e8 rad/s^2, which last a
# microsecond.  What enters the integrator is found by as many Newton steps of a time step's linearisation, from the
# accelerations before (`initial_state.begin_step`): of the jump of a mode of frequency omega
# (x / (1 + x))^PASSES is left out, x = omega^2 / ca.  For omega h = 0.1 that is 2e-8, for omega h = 30 nearly all.
PASSES = 3
# A start is sudden where what is left out would move an unknown by more than SUDDEN in a step (over the length or in radians), or
# is more than DOMINANT times all that is resolved and above START_ROUNDING: at rest sections are known to 1e-3 rad/s^2.  Gravity
# on an undeformed arm is neither at steps of 1e-4 s (some 1e-7, as much as is resolved); couples on sections, however small, are
# some hundred times what is resolved.
SUDDEN = 1e-6
DOMINANT = 10.0
START_ROUNDING = 1e-9
# After a sudden start the first EARLY steps are made in SUBSTEPS parts each, with a spectral radius of 0, which forgets what was
# too fast in three parts: fewer parts or steps leave 2 % and more of the range where beams are damped
# (tests/flexinv/analysis/test_sudden.py).
EARLY = 4
SUBSTEPS = 16

# What Newton leaves by default: less than rounding.
EXACT = 1e-18
# A new linearisation leaves the square of its increment times this, or less: where axial stiffness meets bending.
SQUARED = 1e3
LARGEST_TOLERANCE = 1e-6


@send_by_address
class Scheme(NamedTuple):
    """Equations to solve and their coefficients.

    mode : DYNAMIC, a time step; STATIC, rest; ACCELERATION, u' at a given state; RESOLVED, u' as far as a step resolves it
    h [s]; cv = du/dd [1/s]; ca = du'/dd [1/s^2]; the rest dimensionless
    tolerance : of Newton's unknowns, over the mechanism's length or in radians
    """

    mode: int
    h: float
    cv: float
    ca: float
    beta: float
    gamma: float
    alpha_m: float
    alpha_f: float
    tolerance: float = EXACT


STATICS = Scheme(STATIC, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
# Poses and velocities stand still: the unknowns y are changes of the accelerations, and the masses alone resist them.
ACCELERATIONS = Scheme(ACCELERATION, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)


def build_generalized_alpha(step: float, spectral_radius: float, tolerance: float = EXACT) -> Scheme:
    """Return the scheme of one ``step`` [s] whose high frequencies shrink by ``spectral_radius`` [-] per step.

    alpha_m = (2 rho - 1)/(rho + 1), alpha_f = rho/(rho + 1), gamma = 1/2 + alpha_f - alpha_m, beta = (gamma + 1/2)^2 / 4.
    Second order for every rho; raises InputError outside 0 <= rho <= 1, for h <= 0, for a ``tolerance`` [-] outside 0 .. 1e-6.
    """
    rho = spectral_radius
    if not 0.0 <= rho <= 1.0:
        raise InputError(f"spectral_radius = {rho}: expected 0 (strong) to 1 (no numerical damping), for example 0.8")
    if not (step > 0.0 and np.isfinite(step)):
        raise InputError(f"step = {step} s: expected a positive number of seconds, for example step=1e-3")
    alpha_m = (2 * rho - 1) / (rho + 1)
    alpha_f = rho / (rho + 1)
    gamma = 0.5 + alpha_f - alpha_m
    beta = 0.25 * (gamma + 0.5) ** 2
    ca = (1 - alpha_m) / ((1 - alpha_f) * beta * step * step)
    if not 0.0 < tolerance <= LARGEST_TOLERANCE:
        raise InputError(
            f"tolerance = {tolerance}: expected a part of the mechanism's length above 0 and at most {LARGEST_TOLERANCE:g}, "
            "for example 1e-9"
        )
    return Scheme(DYNAMIC, step, gamma / (beta * step), ca, beta, gamma, alpha_m, alpha_f, tolerance)


def build_start_scheme(scheme: Scheme) -> Scheme:
    """Return the scheme [s] of the parts of the first steps after a sudden start."""
    return build_generalized_alpha(scheme.h / SUBSTEPS, 0.0, scheme.tolerance)


def list_early_times(time: Array) -> Array:
    """Return the ends [s] of all parts of the steps between the instants ``time`` (steps + 1,); every last one is an instant."""
    ends = time[:-1, None] + np.diff(time)[:, None] * (np.arange(1, SUBSTEPS + 1) / SUBSTEPS)
    ends[:, -1] = time[1:]
    return ends.reshape(-1)


def list_early_rows(row: Indices) -> Indices:
    """Return the rows of the histories for `list_early_times`, (parts,) [-], from those of the ends of the steps."""
    rows = np.full((len(row), SUBSTEPS), -1, dtype=np.int64)
    rows[:, -1] = row
    return rows.reshape(-1)


@jit
def is_sudden(scheme, scale, found, resolved):
    """Return True if a start is sudden; found, resolved: accelerations (unknowns,) [m/s^2], [rad/s^2]; scale [m], [-]."""
    left = 0.0
    kept = 0.0
    for k in range(len(scale)):
        left = max(left, scheme.h * scheme.h * abs(found[k] - resolved[k]) / scale[k])
        kept = max(kept, scheme.h * scheme.h * abs(resolved[k]) / scale[k])
    return left > SUDDEN or left > max(DOMINANT * kept, START_ROUNDING)


@jit_inner
def copy(values, to):
    """Copy the unknowns' quantities, or multipliers, to where they are set aside or back [any unit]."""
    for k in range(len(values)):
        to[k] = values[k]


@jit_inner
def prepare_step(scheme, state):
    """Start a step where auxiliary accelerations go on as a parabola (order 2), a line (1) or as they are (0) [m, rad, s]."""
    order = state.order[0]
    for k in range(len(state.d)):
        change = (state.trend[k] if order > 0 else 0.0) + (state.bend[k] if order > 1 else 0.0)
        state.d[k] = scheme.h * state.u0[k] + scheme.h * scheme.h * (0.5 * state.pseudo[k] + scheme.beta * change)
    update_rates(scheme, state)


@jit_inner
def compute_acceleration(scheme, state, k):
    """Return the auxiliary acceleration A_(n+1) of unknown k [m/s^2], [rad/s^2], from the increment of the step."""
    h = scheme.h
    beta = scheme.beta
    return (state.d[k] - h * state.u0[k] - h * h * (0.5 - beta) * state.pseudo[k]) / (h * h * beta)


@jit_inner
def update_rates(scheme, state):
    """Set velocities and accelerations that belong to the increments of the step [m, rad, s]."""
    for k in range(len(state.d)):
        pseudo = compute_acceleration(scheme, state, k)
        state.u[k] = state.u0[k] + scheme.h * ((1 - scheme.gamma) * state.pseudo[k] + scheme.gamma * pseudo)
        both = (1 - scheme.alpha_m) * pseudo + scheme.alpha_m * state.pseudo[k] - scheme.alpha_f * state.du0[k]
        state.du[k] = both / (1 - scheme.alpha_f)


@jit_inner
def apply_increment(topology, scheme, state, y):
    """Apply Newton's increments y (unknowns,) [m], [rad]; rotation vectors by d += H(d)^-1 theta."""
    if scheme.mode == ACCELERATION or scheme.mode == RESOLVED:
        for k in range(len(y)):
            state.du[k] += scheme.ca * y[k]
        return
    for n in range(len(topology.parent)):
        o = topology.first[n]
        if topology.independent[n]:
            add_at(state.d, o, vec_at(y, o))
            add_at(state.d, o + 3, apply(inverse_tangent(vec_at(state.d, o + 3)), vec_at(y, o + 3)))
        elif topology.freedoms[n] > 0:
            first = o + topology.column[n]
            turned = inverse_tangent(compute_joint_rotation(n, topology, state, first))
            for k in range(topology.freedoms[n] if topology.triple[n] < 0 else topology.triple[n]):
                state.d[first + k] += y[first + k]
            if topology.triple[n] >= 0:
                at = first + topology.triple[n]
                add_at(state.d, at, apply(turned, vec_at(y, at)))
    shapes = topology.shapes
    for part in range(len(shapes.root)):
        first = topology.first[shapes.root[part]] + topology.amplitude[part]
        for k in range(shapes.size[part]):
            state.d[first + k] += y[first + k]
    if scheme.mode == DYNAMIC:
        update_rates(scheme, state)


@jit_inner
def update_unknowns(scheme, state, scale):
    """Let the unknowns at the end of a step start the next [m, rad, s], with the order that would have predicted it.

    scale : (unknowns,) [m], [-], over which predictions are compared
    """
    still = 0.0
    line = 0.0
    parabola = 0.0
    for k in range(len(state.d) if scheme.mode == DYNAMIC else 0):
        pseudo = compute_acceleration(scheme, state, k)
        trend = pseudo - state.pseudo[k]
        bend = trend - state.trend[k]
        still = still + abs(trend) / scale[k]
        line = line + abs(bend) / scale[k]
        parabola += abs(bend - state.bend[k]) / scale[k]
        state.trend[k] = trend
        state.bend[k] = bend
        state.pseudo[k], state.u0[k], state.du0[k] = pseudo, state.u[k], state.du[k]
    if scheme.mode == DYNAMIC:
        state.order[0] = 0 if still < line else 1 if line < parabola else 2
    for k in range(len(state.d)):
        state.place[k] += state.d[k]
        state.d[k] = 0.0


@jit_inner
def end_step(topology, scheme, state):
    """Finish a step: its end becomes the start of the next [m, rad, s]."""
    for n in range(len(topology.parent)):
        o = topology.first[n]
        if topology.independent[n]:
            add_to(state.x[n], vec_at(state.d, o))
            put_mat(state.r[n], mul(mat(state.r[n]), exp(vec_at(state.d, o + 3))))
        elif topology.freedoms[n] > 0:
            first = o + topology.column[n]
            for k in range(topology.freedoms[n]):
                add_to(state.x[n], scale(state.d[first + k], vec(topology.slide[n, k])))
            put_mat(state.r[n], mul(mat(state.r[n]), exp(compute_joint_rotation(n, topology, state, first))))
    update_unknowns(scheme, state, topology.scale)


@jit_inner
def find_largest_increment(y, scale):
    """Return the largest increment relative to its scale [-]; not finite if one of them is not."""
    largest = 0.0
    for k in range(len(y)):
        size = abs(y[k]) / scale[k]
        if not size <= largest:
            largest = size
        if not np.isfinite(size):
            return size
    return largest
