"""Workspace of the implicit solver, allocated once; the solver fills the flexible trajectory."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexinv.constraints.closures import build_constraint_rows, compute_coupling_residuals
from flexinv.dynamics.assembly import LARGEST_TURN
from flexinv.dynamics.constraint_rows import Ties, build_border_rows
from flexinv.dynamics.dofs import Topology, build_topology
from flexinv.dynamics.generalized_alpha import Scheme
from flexinv.dynamics.loads import Loads, build_load_table, build_loads, build_pulls
from flexinv.dynamics.stepper import CONVERGED, NOT_FINITE, SLIPPED, TURNED_TOO_MUCH, apply_impact, integrate_instants
from flexinv.dynamics.system import Border, Instants, State, System, Trajectory, Work
from flexinv.elements.beam import Rates, Scratch
from flexinv.elements.beam_element import Elements
from flexinv.elements.points import PointMotion
from flexinv.errors import ConvergenceError, TooFewElements
from flexinv.kernels.so3 import log_so3
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.tree import Frames, Joints, Variation, make_room
from flexinv.typing import Array

# Efforts of the drives of torque-driven joints: time (samples,) [s], and whether the limit before a jump at that time is meant or
# the one after it -> (samples, nv) [N m], [N].
Efforts = Callable[[Array, bool], Array]


def build_coordinate_map(mesh: Mesh, topology: Topology) -> Array:
    """Return (nv, unknowns) [-]: 1 where an unknown of the march is a coordinate of a passive joint."""
    out = np.zeros((mesh.mechanism.nv, len(topology.scale)))
    for n in np.flatnonzero(topology.freedoms):
        k = np.arange(topology.freedoms[n])
        out[mesh.v_index[n] + k, topology.first[n] + topology.column[n] + k] = 1.0
    return out


def _find_widest_block(topology: Topology) -> int:
    """Unknowns of the largest block."""
    return max(int(topology.size.max(initial=0)), 1)


def _make_work(mesh: Mesh, topology: Topology, tied: Ties) -> Work:
    """Scratch of a step: one right side of the tree, and one for each row of the border."""
    widest = _find_widest_block(topology)
    elements, count = mesh.elements.nodes.shape if mesh.elements.nodes.size else (0, 1)
    size = np.append(topology.width, 0)  # of the block of each node, and of no node, -1
    rows = int(size[mesh.elements.nodes[:, 1:]].sum(axis=1).max(initial=0))
    damped = len(mesh.elements.damping) > 0
    sides = int(np.diff(tied.layout.first_side).max(initial=1))
    return Work(
        wrench=np.zeros((mesh.size, 6)),
        dwrench=np.zeros((mesh.size, widest, 6)),
        residual=np.zeros((1 + len(tied.a), len(topology.scale))),
        diagonal=np.zeros((len(topology.size), widest, widest)),
        tangent=np.zeros((elements, 6 * count, 6 * count + 6 * damped)),
        internal=np.zeros((elements, max(count - 1, 0), 6)),
        energy=np.zeros(3),
        element=Scratch.build_for(count),
        rates=Rates.build_for(count if damped else 0),
        system=np.zeros((max(rows, widest), max(rows, widest) + widest + sides)),
        solved=np.zeros((elements, rows, widest + sides)),
        projection=np.zeros((2, mesh.size, 6)),
        moved=np.zeros((*mesh.shapes.turn.shape[:2], 6)),
        points=PointMotion.build_for(mesh.shapes.points, widest),
    )


@dataclass
class Solver:
    """All arrays of the implicit solve of one mesh, allocated once."""

    mesh: Mesh
    topology: Topology
    elements: Elements
    state: State
    frames: Frames
    variation: Variation
    work: Work
    loads: Loads
    increment: Array
    border: Border
    instant: Trajectory
    efforts: Efforts | None = None

    @classmethod
    def build_for(cls, mesh: Mesh, passive: Collection[str], efforts: Efforts | None = None) -> Solver:
        """Return the solver of a mesh with the named joints free, moved by the ``efforts`` of their drives [N m], [N]."""
        topology = build_topology(mesh, frozenset(passive))
        unknowns = len(topology.scale)
        widest = _find_widest_block(topology)
        state = State.build_for(mesh.size, unknowns)
        state.r[:] = np.eye(3)
        tied = build_border_rows(mesh, topology, build_coordinate_map(mesh, topology))
        return cls(
            mesh=mesh,
            topology=topology,
            elements=mesh.elements,
            state=state,
            frames=make_room(Frames, mesh.size),
            variation=make_room(Variation, mesh.size, widest),
            work=_make_work(mesh, topology, tied),
            loads=build_loads(mesh, unknowns),
            increment=np.zeros((1 + len(tied.a), unknowns)),
            border=Border(tied, build_pulls(mesh, tied)),
            instant=Trajectory.make_zero(1, mesh, len(tied.a) - 3 * len(mesh.mechanism.springs)),
            efforts=efforts,
        )

    @property
    def passive(self) -> set[str]:
        """Return the names of the joints that are free."""
        free = self.topology.freedoms
        return {joint.name for joint in self.mesh.mechanism.joints if free[self.mesh.joint_node[joint.name]]}

    @property
    def system(self) -> System:
        """Return the arrays as the kernels take them."""
        s = self
        return System(s.topology, s.elements, s.border, s.state, s.frames, s.variation, s.loads, s.work)

    def prepare_arguments(self, scheme: Scheme, instants: Instants, out: Trajectory) -> tuple[Any, ...]:
        """Return the arguments [m, rad, s, N] of `stepper.march`, for callers that call it themselves."""
        return self.system, scheme, instants, self.increment, out

    def solve_newton(self, scheme: Scheme, joints: Joints) -> tuple[int, int, float]:
        """Solve one instant under the present loads; return status, iterations or element, last relative increment [-]."""
        status, _, count, size = integrate_instants(
            *self.prepare_arguments(scheme, self._make_instant(joints), self.instant)
        )
        return int(status), int(count), float(size)

    def solve_instant(self, scheme: Scheme, joints: Joints, when: str) -> int:
        """Solve one instant under the present loads; return the iterations [-].  Raises ConvergenceError (`make_solve_error`)."""
        status, count, size = self.solve_newton(scheme, joints)
        if status != CONVERGED:
            raise self.make_step_error(status, count, size, when)
        return count

    def evaluate(self, scheme: Scheme, joints: Joints) -> int:
        """Evaluate residual [N], [N m] and linearisation at the present unknowns and loads, as ``scheme`` varies them.

        The kernel is the march's own: a second one for this alone would take as long to compile.
        Return -1 or the element that turned too much.
        """
        return int(
            integrate_instants(self.system, scheme, self._make_instant(joints), self.increment[:0], self.instant)[2]
        )

    def _make_instant(self, joints: Joints) -> Instants:
        """One instant under the present loads."""
        one = Joints(*(part[None] for part in joints))
        wrench = self.loads.wrench[None].copy()
        return Instants(one, wrench, np.empty((1, 0)), np.empty((1, 0, 3)))

    def apply_impact(self, joints: Joints) -> Array:
        """Stop the velocities that the acting closures do not allow; return their impulses, (rows,) [N s], [N m s]."""
        apply_impact(self.system, joints, self.increment)
        return self.border.ties.step[: self.instant.multipliers.shape[1]].copy()

    def update_loads(self, time: float, q: Array, qd: Array, qdd: Array) -> None:
        """Set the given forces [N], [N m], the drives' efforts and the given part of couplings to what they are at a time [s].

        q (nq,), qd, qdd (nv,) of the joints with a motion [rad], [m], [1/s]
        """
        given = self.compute_coupling_terms(q[None], qd[None], qdd[None])[0]
        self.border.ties.coupling_terms[: len(given)] = given
        now = np.array([time])
        self.loads.wrench[:] = build_load_table(self.mesh, now)[0]
        if self.efforts is not None:
            self.loads.effort[:] = self.evaluate_drives(now, before=False)[0]

    def compute_coupling_terms(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the terms of prescribed joints in the equations of couplings, (samples, rows or 0, 3) [rad], [m] and rates.

        q : (samples, nq), qd, qdd : (samples, nv)
        """
        rows = build_constraint_rows(self.mesh)
        if not rows.gear.any():
            return np.empty((len(q), 0, 3))
        moved = build_coordinate_map(self.mesh, self.topology).any(axis=1)
        of_given = rows._replace(gear=np.where(moved, 0.0, rows.gear))
        return np.stack(compute_coupling_residuals(of_given, q, qd, qdd), axis=2)  # (sample, row, rate)

    def evaluate_drives(self, time: Array, before: bool = True) -> Array:
        """Return the drives' efforts at ``time`` (samples,) [s] by the unknowns, (samples, unknowns or 0) [N m], [N].

        before : where they jump, the limit that ends a step, or the one from which the next begins
        """
        if self.efforts is None:
            return np.empty((len(time), 0))
        return self.efforts(time, before) @ build_coordinate_map(self.mesh, self.topology)

    def make_step_error(self, status: int, count: int, size: float, when: str, step: float = 0.0) -> ConvergenceError:
        """Return the error that says where and how the solve failed, see `make_solve_error`; size [-], step [s]."""
        return make_solve_error(
            self.mesh, self.passive, (status, count, size), when, step, self.compute_section_turn(count)
        )

    def compute_section_turn(self, element: int) -> float:
        """Return by how much the sections of an element turn against each other [rad] where the last step has begun."""
        e = self.mesh.elements
        t = self.topology
        if not 0 <= element < len(e.order):
            return 0.0
        nodes = e.nodes[element, : e.order[element] + 1]
        rotation = [self.state.r[n] if t.independent[n] else self.frames.r[n] for n in nodes]
        return float(np.linalg.norm(log_so3(np.stack([rotation[0].T @ turn for turn in rotation])), axis=1).max())


# An element that has turned by more than this between its sections where a step begins needs more elements, not smaller steps.
BENT_TOO_FAR = LARGEST_TURN / 2  # [rad]


Failed = tuple[int, int, float]  # status, iterations or element, last relative increment [-]


def make_solve_error(
    mesh: Mesh, passive: Collection[str], failed: Failed, when: str, step: float = 0.0, turned: float = 0.0
) -> ConvergenceError:
    """Return the error that says where and how a solve failed and what to try.

    passive : the joints that were free
    step : of the march [s], 0 without; turned : of the element where the step has begun, `Solver.compute_section_turn` [rad]
    """
    from flexinv.dynamics.idle_joints import describe_idle_joints

    status, count, size = failed
    name = mesh.mechanism.name
    shorter = f"write step = {step / 4:.3g}, or " if step > 0.0 else ""
    if status in (TURNED_TOO_MUCH, SLIPPED):
        link = mesh.mechanism.links[int(mesh.elements.link[count])]
        where = f"mechanism '{name}', link '{link.name}', {when}: element {count} turns by more than"
        what = f"{LARGEST_TURN} rad between its nodes" if status == TURNED_TOO_MUCH else "pi in one step at a section"
        twice = 2 * (link.beam.elements if link.beam is not None else 1)
        bent = f"{where} {what}; it had bent by {turned:.2g} rad before"
        if turned > BENT_TOO_FAR:
            return TooFewElements(f"{bent}: use more elements (elements = {twice} on this link)")
        return ConvergenceError(
            f"{bent}, so that more elements would not help: "
            f"{shorter}check that forces, moments and stiffness are what you mean"
        )
    if status == NOT_FINITE and (idle := describe_idle_joints(mesh, frozenset(passive))):
        return ConvergenceError(f"mechanism '{name}', {when}: {idle}")
    what = "is not a finite number" if status == NOT_FINITE else f"is still {size:.1e} after {count} iterations"
    return ConvergenceError(
        f"mechanism '{name}', {when}: Newton's increment (relative to the mechanism's length) {what}; "
        f"{shorter}check that forces, moments and stiffness are what you mean"
    )


def write_instant(solver: Solver, sample: int, out: Trajectory) -> None:
    """Copy the instant that was solved last into the histories [m, rad, s, N]."""
    for history, value in zip(out[:-1], solver.instant[:-1], strict=True):  # not the iterations
        history[sample] = value[0]
