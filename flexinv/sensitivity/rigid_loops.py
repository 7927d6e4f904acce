"""Derivatives of rigid links in closed loops: of their motion from the closures, and of how drives share the work.

At every sample by itself, with G the gradients of the closures and B(v) the derivative of G v by the coordinates:

    G dq = -dphi/dp                     G dq' + B(q') dq = -dphi'/dp
    G dq'' + (dphi''/dq) dq + 2 B(q') dq' = -dphi''/dp

Efforts of the cut tree f, closures' forces included, are left to the drives, tau = f_a - G_a^T dlambda, and to no other joint,
0 = f_u - G_u^T dlambda.  Where drives are redundant tau^T W tau is least: nu = (-W tau, mu) is a motion of the loops, G nu = 0,

    G_a W G_a^T dlambda + G_u dmu = G_a (W f_a + dW tau) - B(nu) dq - d(G nu)/dp        G_u^T dlambda = f_u
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexinv.analysis.solution import Solution
from flexinv.constraints.allocation import OPEN, REDUNDANT
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism
from flexinv.sensitivity.closed_states import add_spring_forces, find_multipliers
from flexinv.sensitivity.march_states import (
    FreeSystem,
    build_free_system,
    build_march_states,
    build_varied_system,
    sample_forces,
)
from flexinv.sensitivity.parameters import ParameterVariation
from flexinv.sensitivity.tangent_records import ForceRecord, MarchStates, ParameterInputs
from flexinv.typing import Array, Mask


class RigidLoops:
    """The loops of a mechanism along a solution.

    system : all joints are unknowns; states : with the multipliers of the closures; given : (nv,) coordinates with a motion
    """

    system: FreeSystem
    states: MarchStates

    def __init__(
        self,
        mechanism: Mechanism,
        solution: Solution,
        parameters: Sequence[tuple[str, ParameterVariation]],
        given: Mask,
    ) -> None:
        """Record the closures and their multipliers, and those beside the parameters (name, variation)."""
        self.mechanism = mechanism
        self.solution = solution
        self.labels = [name for name, _ in parameters]
        self.variations = [variation for _, variation in parameters]
        self.changing = [k for k, variation in enumerate(self.variations) if variation.changes_mechanism]
        self.given = given
        self.names = mechanism.moving_names
        self.system = build_free_system(mechanism, self.names)
        states = add_spring_forces(self.system, self._build_states(self.system))
        self.record = sample_forces(self.system, states, slopes=True)
        self.gradient = self.record.gradient[:, :, self.system.unknown]
        friction = np.sign(solution.qd) * mechanism.drive_table[2]
        balance = np.empty_like(self.record.residual)
        balance[:, self.system.unknown] = friction - solution.torque_all
        balance += self.record.residual
        multiplier = find_multipliers(self.system, self.record, balance, np.arange(self.system.size))
        self.states = states._replace(multiplier=multiplier)
        self.varied = {k: self._sample_varied(k) for k in self.changing}

    def _build_states(self, system: FreeSystem) -> MarchStates:
        solution = self.solution
        return build_march_states(system, solution.nodes, (solution.q, solution.qd, solution.qdd), solution.time)

    def _sample_varied(self, k: int) -> list[ForceRecord]:
        """Forces and closures of the setups beside parameter k, with the present multipliers."""
        out = []
        for mechanism, _ in self.variations[k].setups:
            system = build_varied_system(self.system, mechanism, self.names)
            out.append(sample_forces(system, self._build_states(system)._replace(multiplier=self.states.multiplier)))
        return out

    def solve_motion(self, given: Array) -> Array:
        """Return the derivatives (3, samples, nv, parameters) of all coordinates [rad], [m], their rates and accelerations.

        given : the same of the joints with a motion, (3, samples, joints, parameters)
        Raises InputError for a parameter with which the loops do not stay closed.
        """
        samples, nv = self.solution.qd.shape
        out = np.zeros((3, samples, nv, given.shape[3]))
        out[:, :, self.given] = given
        free = ~self.given
        scale = self.system.solver.topology.scale[self.system.unknown]
        inverse = np.linalg.pinv(self.gradient[:, :, free] * scale[free], rcond=REDUNDANT)
        by_pose, by_rate = self.record.slopes[..., self.system.unknown]
        for order in range(3):
            opened = self._join_openings(order, given.shape[3]) + self.gradient @ out[order]
            if order == 1:
                opened += 0.5 * by_rate @ out[0]
            elif order == 2:
                opened += by_pose @ out[0] + by_rate @ out[1]
            out[order][:, free] = -scale[free, None] * (inverse @ opened)
            left = opened + self.gradient[:, :, free] @ out[order][:, free]
            if order == 0:
                self._check_closed(left, opened)
        return out

    def _join_openings(self, order: int, parameters: int) -> Array:
        """By how much parameters open the closures, or change a rate of that, (samples, rows, parameters)."""
        out = np.zeros((*self.record.closing.shape[1:], parameters))
        for k, records in self.varied.items():
            out[:, :, k] = self.variations[k].join_results(one.closing[order] for one in records)
        return out

    def _check_closed(self, left: Array, opened: Array) -> None:
        """Raise InputError where joints without a motion cannot close what a parameter opens."""
        off = np.abs(left).max(axis=(0, 1))
        worst = int(np.argmax(off)) if off.size else 0
        if off.size and off[worst] > OPEN * np.abs(opened[..., worst]).max():
            raise InputError(
                f"differentiate: the loops of '{self.mechanism.name}' do not stay closed where {self.labels[worst]!r} changes: "
                "all joints that could follow have a motion of their own; give the motion of the drives alone"
            )

    def compute_inputs(self, found: Array, friction: Array) -> ParameterInputs:
        """Return the effects of the parameters from outside [any unit], where all joints move as found by `solve_motion`.

        friction : (samples, nv, parameters) derivatives of dry friction
        """
        unknown = self.system.unknown
        given = np.empty_like(found)
        given[:, :, unknown] = found  # joints in the order of the unknowns, as `FreeSystem.make_freedoms` lists them
        samples = len(self.solution.time)
        shape = (samples, self.system.size, len(self.changing))
        pushed = np.zeros((2, *shape))
        shifted = np.zeros((samples, self.record.tip.shape[1], 3, len(self.changing)))
        for column, k in enumerate(self.changing):
            variation = self.variations[k]
            pushed[:, :, :, column] = variation.join_results(one.residual for one in self.varied[k])
            pushed[:, :, unknown, column] += friction[:, :, k]
            shifted[..., column] = variation.join_results(one.tip for one in self.varied[k])
        opened = np.zeros((2, samples, self.system.rows, len(self.changing)))
        return ParameterInputs(given, pushed, shifted, opened, np.array(self.changing, dtype=np.int64))

    def split_efforts(self, effort: Array, found: Array) -> tuple[Array, Array]:
        """Return the derivatives (samples, nv, parameters) of the drives' efforts from those of the cut tree [N m], [N].

        Second those of the multipliers of the closures (samples, rows, parameters).
        """
        driven = self.mechanism.actuated
        forces = effort
        g = self.gradient
        constraints = g.shape[1]
        weight = self.mechanism.weights[driven]
        g_a = g[:, :, driven]
        g_u = g[:, :, ~driven]
        tau = self.solution.torque_all[:, driven]
        right = g_a @ (weight[:, None] * forces[:, driven])
        if self.solution.loops is not None and self.solution.loops.preload.shape[2]:
            right += g_a @ (self._compute_weight_slopes(driven) * tau[..., None]) - self._turn_sharing(
                weight * tau, driven, found
            )
        passive = g_u.shape[2]
        whole = np.zeros((len(g), constraints + passive, constraints + passive))
        whole[:, :constraints, :constraints] = (g_a * weight) @ g_a.transpose(0, 2, 1)
        whole[:, :constraints, constraints:] = g_u
        whole[:, constraints:, :constraints] = g_u.transpose(0, 2, 1)
        sides = np.concatenate([right, forces[:, ~driven]], axis=1)
        multiplier = (np.linalg.pinv(whole, rcond=REDUNDANT, hermitian=True) @ sides)[:, :constraints]
        out = np.zeros_like(forces)
        out[:, driven] = forces[:, driven] - g_a.transpose(0, 2, 1) @ multiplier
        return out, multiplier

    def _compute_weight_slopes(self, driven: Mask) -> Array:
        """Derivatives (drives, parameters) of the drives' weights."""
        out = np.zeros((int(driven.sum()), len(self.variations)))
        for k in self.changing:
            variation = self.variations[k]
            out[:, k] = variation.join_results(mechanism.weights[driven] for mechanism, _ in variation.setups)
        return out

    def _turn_sharing(self, weighted: Array, driven: Mask, found: Array) -> Array:
        """B(nu) dq + d(G nu)/dp, (samples, rows, parameters); weighted : W tau (samples, drives)."""
        motion = np.zeros_like(self.solution.qd)
        motion[:, driven] = -weighted
        scale = self.system.solver.topology.scale[self.system.unknown][~driven]
        inverse = np.linalg.pinv(self.gradient[:, :, ~driven] * scale, rcond=REDUNDANT)
        pushed = np.einsum("srv,sv->sr", self.gradient[:, :, driven], weighted)
        motion[:, ~driven] = scale * np.einsum("sur,sr->su", inverse, pushed)
        record = self._sample_rates(self.system, motion)
        out: Array = 0.5 * record.slopes[1][..., self.system.unknown] @ found[0]
        for k in self.changing:
            variation = self.variations[k]
            systems = (build_varied_system(self.system, one, self.names) for one, _ in variation.setups)
            out[..., k] += variation.join_results(self._sample_rates(one, motion).closing[1] for one in systems)
        return out

    def _sample_rates(self, system: FreeSystem, rates: Array) -> ForceRecord:
        """Closures where the joints have other rates (samples, nv)."""
        states = self._build_states(system)
        turned = np.zeros_like(states.u)
        turned[:, system.unknown] = rates
        return sample_forces(system, states._replace(u=turned, du=np.zeros_like(states.du)), slopes=True)
