"""States of a march whose closures act: with the accelerations and multipliers of the march, and with those of index 1.

A solution has the poses, rates and accelerations of index 1.  The march goes on with its own accelerations, which follow from the
rates, as generalised-alpha makes these of them:

    A_n+1 = (u_n+1 - u_n - h (1 - gamma) A_n) / (h gamma)
    u'_n+1 = ((1 - alpha_m) A_n+1 + alpha_m A_n - alpha_f u'_n) / (1 - alpha_f)

Multipliers follow from the balance of what is marched, r = G^T lambda; those that repeat others are of least norm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.constraints.allocation import REDUNDANT
from flexinv.dynamics.generalized_alpha import Scheme
from flexinv.dynamics.index1 import MASSLESS, NO_INERTIA
from flexinv.dynamics.linearization import compute_matrices
from flexinv.errors import InputError
from flexinv.kinematics.tree import Joints
from flexinv.sensitivity.march_states import FreeSystem, sample_forces
from flexinv.sensitivity.tangent_records import ForceRecord, MarchedFreedoms, MarchStates
from flexinv.typing import Array, Indices, Mask

# Of the largest effort: what forces of closures are off by where they are no others than those of the march.
BALANCED = 1e-7


def add_spring_forces(system: FreeSystem, states: MarchStates) -> MarchStates:
    """Return the states with the forces of springs between points, closures without force [N]."""
    if system.rows == system.constraints:
        return states
    return states._replace(multiplier=sample_forces(system, states).pulls)


@dataclass(frozen=True)
class ClosedStates:
    """States of the march, and those of index 1 that are shown; efforts (samples, others) of what is not marched [N m], [N].

    massive : whether every motion has inertia, and nothing is out of balance
    """

    march: MarchStates
    shown: MarchStates
    efforts: Array
    massive: bool


def build_closed_states(
    system: FreeSystem, shown: MarchStates, freedoms: MarchedFreedoms, pseudo: Array, scheme: Scheme
) -> ClosedStates:
    """Return the states of the march and those of index 1, with their multipliers [N], [N m].

    shown : states with accelerations of index 1, closures without force; pseudo : (unknowns,) the integrator's own
    accelerations in the first sample [m/s^2], [rad/s^2]
    """
    marched = freedoms.marched
    du = shown.du.copy()
    du[:, marched] = compute_march_accelerations(shown.u[:, marched], pseudo[marched], scheme)
    first = sample_forces(system, shown)
    massless = find_massless(system, shown, marched)
    balanced = marched[~massless]
    states = shown._replace(du=du)
    second = sample_forces(system, states)
    inverse = compute_gradient_inverse(system, first, marched)
    marching = apply_inverse(inverse, second.residual[:, marched], second.pulls)
    if massless.any():
        inverse = compute_gradient_inverse(system, first, balanced)
    multipliers = apply_inverse(inverse, first.residual[:, balanced], first.pulls)
    others = freedoms.prescribed
    forces = np.einsum("sri,sr->si", first.gradient[:, :, others], multipliers)
    return ClosedStates(
        states._replace(multiplier=marching),
        shown._replace(multiplier=multipliers),
        first.residual[:, others] - forces,
        not massless.any(),
    )


def find_shown_multipliers(system: FreeSystem, shown: MarchStates, marched: Indices) -> Array:
    """Return the multipliers (samples, rows) of index 1 along states [N], [N m], closures of which are without force."""
    record = sample_forces(system, shown)
    return find_multipliers(system, record, record.residual, marched[~find_massless(system, shown, marched)])


def compute_march_accelerations(rates: Array, first: Array, scheme: Scheme) -> Array:
    """Return the accelerations (samples, unknowns) of a march [m/s^2], [rad/s^2] from its rates and its first accelerations."""
    out = np.empty_like(rates)
    out[0] = first
    pseudo = first
    h = scheme.h
    gamma = scheme.gamma
    am = scheme.alpha_m
    af = scheme.alpha_f
    for k in range(1, len(rates)):
        later = (rates[k] - rates[k - 1] - h * (1 - gamma) * pseudo) / (h * gamma)
        out[k] = ((1 - am) * later + am * pseudo - af * out[k - 1]) / (1 - af)
        pseudo = later
    return out


def find_multipliers(system: FreeSystem, record: ForceRecord, balance: Array, rows: Indices) -> Array:
    """Return the multipliers (samples, rows) of G^T lambda = balance [N], [N m] in some ``rows``, springs with their forces."""
    return apply_inverse(compute_gradient_inverse(system, record, rows), balance[:, rows], record.pulls)


def compute_gradient_inverse(system: FreeSystem, record: ForceRecord, rows: Indices) -> Array:
    """Return the inverse (samples, constraints, rows) of G^T in some ``rows`` [-], [1/m]; what repeats is of least norm."""
    scale = system.solver.topology.scale[rows]
    gradient = record.gradient[:, :, rows] * scale
    size = np.maximum(np.linalg.norm(gradient, axis=2), np.finfo(float).tiny)
    inverse = np.linalg.pinv(gradient / size[..., None], rcond=REDUNDANT).transpose(0, 2, 1)
    return np.asarray(inverse / size[..., None] * scale)


def apply_inverse(inverse: Array, balance: Array, pulls: Array) -> Array:
    """Return the multipliers (samples, constraints) that make a balance (samples, rows), beside forces of springs [N], [N m]."""
    return np.asarray(pulls + np.einsum("sri,si->sr", inverse, balance))


def find_massless(system: FreeSystem, states: MarchStates, marched: Indices) -> Mask:
    """Return a mask (marched,) of motions without inertia [-], as `dynamics.index1.add_mass_to_block` finds them.

    The system stands at the last state.
    """
    joints = Joints(*(part[-1].copy() for part in states.joints))
    mass = compute_matrices(system.solver, joints).mass.toarray()[np.ix_(marched, marched)]
    scale = system.solver.topology.scale[marched]
    largest = float(np.abs(mass * scale[:, None] * scale).max(initial=0.0))
    left = mass.copy()
    out = np.zeros(len(marched), dtype=bool)
    for k in range(len(marched) - 1, -1, -1):
        if not left[k, k] > max(NO_INERTIA * mass[k, k], MASSLESS * largest / scale[k] ** 2):
            out[k] = True
            continue
        left[:k, :k] -= np.outer(left[:k, k] / left[k, k], left[k, :k])
    return out


def check_efforts(name: str, found: Array, efforts: Array) -> None:
    """Raise InputError where efforts (samples, joints) that follow from multipliers are not those of the solution [N m], [N]."""
    off = np.abs(found - efforts)[1:].max(initial=0.0)
    largest = np.abs(efforts).max(initial=0.0)
    if not off <= BALANCED * largest:
        raise InputError(
            f"differentiate: the forces of the closures of '{name}' do not follow from the motion of its nodes (efforts are off "
            f"by {off / max(largest, np.finfo(float).tiny):.1e} of the largest): a closure turns a section that has no rotary "
            "inertia, or there are more drives than rigid links need; give sections a rotary inertia, or take differences of "
            "flexinv.solve"
        )
