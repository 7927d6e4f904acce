"""All instants of a motion as one set of unknowns: poses on the manifold, their central differences, and the equations.

    delta+ = log(R_k^T R_(k+1)),   delta- = log(R_k^T R_(k-1)),   and likewise x_(k+1) - x_k, x_(k-1) - x_k
    u_k = (delta+ - delta-) / (2 h)           u'_k = (delta+ + delta-) / h^2           (at rest: zero, at both ends)

which is symmetric in time and of second order.  The equations of instant k, with efforts tau of the drives:

    r(y_k, u_k, u'_k) - S tau_k = 0,          c(y_k) = 0

Their linearisation is block tridiagonal in time: instant k feels k - 1 and k + 1 through its velocity and acceleration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexinv.dynamics.dofs import scale_modal_stiffness
from flexinv.dynamics.generalized_alpha import DYNAMIC, Scheme
from flexinv.dynamics.initial_state import compute_joint_motion
from flexinv.dynamics.linearization import fill_dense_matrices, move_system_to
from flexinv.dynamics.loads import build_load_table
from flexinv.dynamics.solver import Solver, build_coordinate_map
from flexinv.dynamics.stepper import evaluate, write_sample
from flexinv.dynamics.system import System, Trajectory
from flexinv.elements.beam_element import scale_stiffness
from flexinv.kernels.dense import solve_tridiagonal
from flexinv.kernels.jit import jit
from flexinv.kernels.records import send_by_address
from flexinv.kernels.so3 import exp_so3, inverse_tangent, log_so3
from flexinv.kernels.vec3 import put_mat, vec
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import compute_relative_motion, compute_rigid_motion
from flexinv.kinematics.tree import Joints
from flexinv.planar.detection import Plane, find_plane
from flexinv.tracking.frame_path import Poses
from flexinv.tracking.inverse_kinematics import PathMotion, RigidPath
from flexinv.typing import Array

# Instants that are linearised at once: their matrices stay in a few megabytes.
CHUNK = 128


@send_by_address
class FreeMotion(NamedTuple):
    """Motion of a mechanism whose joints are all free, as `dynamics.system.State` has it, and the loads.

    x : (samples, nodes, 3), r : (samples, nodes, 3, 3), place, u, du : (samples, unknowns); table : (samples, loads, 6)
    """

    x: Array
    r: Array
    place: Array
    u: Array
    du: Array
    table: Array


@send_by_address
class SampleEquations(NamedTuple):
    """Residuals (samples, unknowns) [N], [N m], derivatives (samples, 3, unknowns, unknowns) K, C, M, and histories.

    reach : (samples, 6, unknowns) of a frame's displacement (world), rotation (own frame)
    Derivatives and reach have no samples where they are not wanted.
    """

    residual: Array
    tangent: Array
    reach: Array
    histories: Trajectory


def _make_sample_equations(whole: Trajectory, part: slice, unknowns: int, want: bool) -> SampleEquations:
    """Zeros for some instants; their histories are written where they stand in those of all."""
    samples = part.stop - part.start
    wanted = samples if want else 0
    tangent = np.zeros((wanted, 3, unknowns, unknowns))
    reach = np.zeros((wanted, 6, unknowns))
    histories = whole.take_samples(part.start, part.stop)
    return SampleEquations(np.zeros((samples, unknowns)), tangent, reach, histories)


@jit
def evaluate_instants(system, joints, motion, frame, out):
    """Fill ``out`` (`SampleEquations`) [N, m], ``frame`` the node of its reach; return -1, -1 or instant and bad element."""
    state = system.state
    want = out.tangent.shape[0] > 0
    still = Scheme(DYNAMIC, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    block = system.topology.block[frame]
    first = system.topology.offset[block]
    size = system.topology.size[block]
    for k in range(motion.x.shape[0]):
        move_system_to(system, motion, k)
        bad = fill_dense_matrices(system, joints, out.tangent[k]) if want else evaluate(system, still, joints, False)
        if bad >= 0:
            return k, bad
        for i in range(len(state.d)):
            out.residual[k, i] = system.work.residual[0, i]
        write_sample(k, system.frames, system.work, out.histories)
        if want:
            out.reach[k] = 0.0
            for c in range(size):  # the frame's Jacobian by the unknowns of its block
                for i in range(3):
                    out.reach[k, i, first + c] = system.variation.x[frame, c, i]
                    out.reach[k, 3 + i, first + c] = system.variation.t[frame, c, i]
    return -1, -1


@jit
def _fill_inverse_tangents(psi, out):
    for i in range(psi.shape[0]):
        put_mat(out[i], inverse_tangent(vec(psi[i])))


def compute_inverse_tangents(psi: Array) -> Array:
    """Return H(psi)^-1, (..., 3, 3) [-], of rotation vectors (..., 3) [rad]: d log(R) = H^-1 times the body increment of R."""
    psi = np.array(psi, dtype=float, order="C")
    out = np.empty((*psi.shape, 3))
    _fill_inverse_tangents(psi.reshape(-1, 3), out.reshape(-1, 3, 3))
    return out


@dataclass(frozen=True)
class NodePoses:
    """Poses at all instants in the march's unknowns.

    flat : (samples, unknowns) positions and scalar coordinates [m], [rad], zero where a rotation is meant
    turn : (samples, rotations, 3, 3), those of `Layout.triple`
    last : (unknowns,) u' at the last instant, where something swings on [m, rad, s]; None at rest
    """

    flat: Array
    turn: Array
    last: Array | None = None


class FreeLayout:
    """Layout of the unknowns of a mechanism whose joints are all free.

    triple : (rotations, 3) unknowns that are a rotation; node : (rotations,) whose it is
    section : (sections,) nodes that are placed by themselves; place : (sections, 3) the unknowns of their positions
    pick : (rows, unknowns) what a mechanism in a plane leaves of them, the identity in space; planar : which of the two
    drives : (drives, unknowns) rows of the drives alone, by coordinate
    """

    def __init__(self, mesh: Mesh) -> None:
        """Lay out the unknowns of a mesh with every joint free [m], [rad]."""
        m = mesh.mechanism
        zero = np.zeros(mesh.mechanism.nv)
        self.solver = Solver.build_for(mesh, m.moving_names)
        self.joints, t = compute_joint_motion(mesh, m.neutral, zero, zero), self.solver.topology
        first = t.first + np.where(t.independent, 3, t.column + t.triple)
        self.node = np.flatnonzero(t.independent | (t.triple >= 0))
        self.section = np.flatnonzero(t.independent)
        starts = first[self.node], t.first[self.section]
        self.triple, self.place = (part[:, None] + np.arange(3) for part in starts)
        springless = replace(m, joints=tuple(replace(j, stiffness=0.0) for j in m.joints))  # springs stay in the plane
        plane = find_plane(build(springless))
        self.planar = isinstance(plane, Plane)
        self.pick = _build_planar_rows(mesh, self.solver, plane) if isinstance(plane, Plane) else np.eye(len(t.scale))
        self.drives = build_coordinate_map(mesh, t)[m.actuated]

    def compute_undeformed_poses(self, q: Array) -> NodePoses:
        """Return the poses of the stress-free mechanism at q (samples, nq) [rad], [m]."""
        mesh = self.solver.mesh
        t = self.solver.topology
        zero = np.zeros((len(q), mesh.mechanism.nv))
        motion = compute_rigid_motion(mesh, q, zero, zero)
        rel = compute_relative_motion(mesh, q, zero, zero)
        flat = np.zeros((len(q), len(t.scale)))
        flat[:, self.place] = motion.x[:, self.section]
        for n in np.flatnonzero(t.freedoms):
            columns = slice(t.first[n] + t.column[n], t.first[n] + t.column[n] + t.freedoms[n])
            slide = t.slide[n, : t.freedoms[n]]
            turn = t.turn[n, : t.freedoms[n]]
            flat[:, columns] = (rel.p[:, n] - self.joints.p[n]) @ (slide * ~turn.any(axis=1, keepdims=True)).T
            if t.triple[n] < 0:
                angle = log_so3(self.joints.r[n].T @ rel.r[:, n]) @ turn.T  # (sample, freedom)
                flat[:, columns] += np.unwrap(angle, axis=0) if len(q) > 1 else angle
        turned = [motion.rotation[:, n] if t.independent[n] else rel.r[:, n] for n in self.node]
        return NodePoses(flat, np.stack(turned, axis=1) if turned else np.zeros((len(q), 0, 3, 3)))

    def list_node_poses(self, at: NodePoses) -> tuple[Array, Array]:
        """Return x (samples, nodes, 3) [m], r (samples, nodes, 3, 3) as the march's state has them."""
        t = self.solver.topology
        size = len(at.flat)
        x = np.tile(self.joints.p, (size, 1, 1))
        r = np.tile(self.joints.r, (size, 1, 1, 1))
        x[:, self.section] = at.flat[:, self.place]
        for n in np.flatnonzero(t.freedoms):
            first = t.first[n] + t.column[n]
            values = at.flat[:, first : first + t.freedoms[n]]
            x[:, n] += values @ t.slide[n, : t.freedoms[n]]
            if t.triple[n] < 0:
                r[:, n] = r[:, n] @ exp_so3(values @ t.turn[n, : t.freedoms[n]])
        r[:, self.node] = at.turn
        return x, r

    def apply_increments(self, at: NodePoses, y: Array) -> NodePoses:
        """Return the poses after increments y (samples, unknowns) [m], [rad], rotations in the node's own frame."""
        flat = at.flat + y
        flat[:, self.triple] = 0.0
        return NodePoses(flat, at.turn @ exp_so3(y[:, self.triple]), at.last)

    def compute_differences(self, at: NodePoses, h: float) -> tuple[Array, Array, Array]:
        """Return u, u' (samples, unknowns) [m, rad, s], at rest at the ends, and delta+ (samples - 1, rotations, 3)."""
        ahead = np.diff(at.flat, axis=0)
        delta = log_so3(np.swapaxes(at.turn[:-1], 2, 3) @ at.turn[1:])
        ahead[:, self.triple] = delta
        u = np.zeros_like(at.flat)
        du = np.zeros_like(at.flat)
        u[1:-1] = (ahead[1:] + ahead[:-1]) / (2 * h)
        du[1:-1] = (ahead[1:] - ahead[:-1]) / h**2
        if at.last is not None:
            du[-1] = at.last
        return u, du, delta


def _build_planar_rows(mesh: Mesh, solver: Solver, plane: Plane) -> Array:
    """(rows, unknowns): components along the plane's axes, turns about its normal, and the joints' own coordinates."""
    t = solver.topology
    rows = []
    for n in range(mesh.size):
        o = t.first[n]
        if t.independent[n]:
            block = np.zeros((3, len(t.scale)))
            block[:2, o : o + 3] = plane.axes.T[:2]
            block[2, o + 3 : o + 6] = plane.frames[n, 2]
            rows += list(block)
        elif t.freedoms[n]:
            rows.append(np.eye(len(t.scale))[o + t.column[n]])
    return np.array(rows).reshape(-1, len(t.scale))


@dataclass(frozen=True)
class LinearisedEquations:
    """The equations at all instants: residuals and derivatives in the unknowns that are picked; trajectory as evaluated.

    residual : (samples, rows); tangent : (3, samples, rows, rows) K, C, M; missed, by : (samples, tasks), (samples, tasks, rows)
    """

    residual: Array
    tangent: Array
    missed: Array
    by: Array
    trajectory: Trajectory


class RotationTooLarge(Exception):
    """An element turned too much at an instant while Newton was on its way."""


@dataclass(frozen=True)
class Horizon:
    """The space-time equations of a frame on its path, at the instants ``time`` (samples,) [s], spaced by ``h`` [s].

    way : what follows what; reach : of the rigid mechanism, whose joints move so where the path leaves the drives free
    """

    layout: FreeLayout
    way: RigidPath
    reach: PathMotion
    time: Array
    h: float

    @cached_property
    def wanted(self) -> Poses:
        """Return the poses of the frame on its path [m, rad, s]."""
        return self.way.path.evaluate(self.time)

    @cached_property
    def rigid(self) -> NodePoses:
        """Return the poses of the rigid mechanism on the path [m], [rad]."""
        return self.layout.compute_undeformed_poses(self.reach.q)

    def evaluate(self, at: NodePoses, stiffness: float = 1.0, want: bool = True) -> LinearisedEquations:
        """Return residuals and derivatives at ``at`` [m, rad], beams ``stiffness`` times as stiff [-].  Raises TurnedTooMuch."""
        u, du, _ = self.layout.compute_differences(at, self.h)
        rows = len(self.layout.pick)
        mesh = self.layout.solver.mesh
        size = len(self.time)
        tasks = self.reach.within.shape[2] + self.reach.idle.shape[2]
        shapes = (size, rows), (3, size if want else 0, rows, rows), (size, tasks), (size, tasks, rows)
        residual, tangents, missed, derivatives = (np.zeros(shape) for shape in shapes)
        out = LinearisedEquations(residual, tangents, missed, derivatives, Trajectory.make_zero(size, mesh))
        solver = self.layout.solver
        pick = self.layout.pick
        system = solver.system._replace(
            elements=scale_stiffness(solver.elements, stiffness),
            topology=scale_modal_stiffness(solver.topology, stiffness),
        )
        for first in range(0, size, CHUNK):
            part = slice(first, min(first + CHUNK, size))
            motion = self._take_motion(at, u, du, part)
            now = _make_sample_equations(out.trajectory, part, u.shape[1], want)
            self._evaluate_part(system, motion, now, first)
            out.residual[part] = now.residual @ pick.T
            out.missed[part], by = self._compute_task_errors(part, at, now.histories, now.reach)
            if want:
                for which in range(3):
                    out.tangent[which, part] = pick @ now.tangent[:, which] @ pick.T
                out.by[part] = by @ pick.T
        return out

    def _take_motion(self, at: NodePoses, u: Array, du: Array, part: slice) -> FreeMotion:
        """Poses, velocities and accelerations of some instants, and what loads do then."""
        x, r = self.layout.list_node_poses(NodePoses(at.flat[part], at.turn[part]))
        loads = build_load_table(self.layout.solver.mesh, self.time[part])
        return FreeMotion(x, r, at.flat[part], u[part], du[part], loads)

    def _evaluate_part(self, system: System, motion: FreeMotion, now: SampleEquations, first: int) -> None:
        """Fill the equations of some instants, of which the ``first`` is known by its number."""
        free = Joints(*(given.copy() for given in self.layout.joints))  # they are overwritten
        instant, element = evaluate_instants(system, free, motion, self.way.frame.node, now)
        if instant >= 0:
            raise RotationTooLarge(f"t = {self.time[first + instant]:g} s, element {element}")

    def _compute_task_errors(
        self, part: slice, at: NodePoses, trajectory: Trajectory, reach: Array
    ) -> tuple[Array, Array]:
        """c(y) (samples, tasks) [m], [rad] and its derivative (samples, tasks, unknowns)."""
        wanted = self.wanted
        frame = self.way.frame
        drives = self.layout.drives
        length = self.way.mesh.length
        now = frame.compute_poses(trajectory.motion)
        node = trajectory.motion.rotation[:, frame.node]
        off = now.x - wanted.x[part]
        by = np.zeros((len(reach), 3, reach.shape[2]))
        if len(reach):
            spin = np.cross(np.swapaxes(reach[:, 3:], 1, 2), frame.point)  # (sample, unknown, xyz)
            by = reach[:, :3] + node @ np.swapaxes(spin, 1, 2)
        if wanted.rotation is not None and now.rotation is not None:
            turn = log_so3(np.swapaxes(wanted.rotation[part], 1, 2) @ now.rotation)
            off = np.hstack([off, length * turn])
            if len(reach):
                by = np.concatenate(
                    [by, length * compute_inverse_tangents(turn) @ (frame.turn.T @ reach[:, 3:])], axis=1
                )
        across, idle = (np.swapaxes(basis[part], 1, 2) for basis in (self.reach.within, self.reach.idle))
        away = (at.flat[part] - self.rigid.flat[part]) @ drives.T
        missed = np.hstack([np.einsum("str,sr->st", across, off), np.einsum("std,sd->st", idle, away)])
        return missed, np.concatenate([across @ by, idle @ drives], axis=1) if len(reach) else by

    def solve_increments(self, at: NodePoses, now: LinearisedEquations) -> Array:
        """Return Newton's increments y (samples, unknowns) [m], [rad]."""
        return self.build_linear_solver(at, now)(now.residual, now.missed) @ self.layout.pick

    def build_linear_solver(self, at: NodePoses, now: LinearisedEquations) -> Callable[[Array, Array], Array]:
        """Return the function of residual (samples, rows) and missed (samples, tasks) that gives y (samples, rows) [m], [rad]."""
        below, diagonal, above = self._compute_blocks(at, now)
        efforts = -self.layout.pick @ self.layout.drives.T  # (row, drive)
        rows, drives = efforts.shape
        system = [np.zeros((len(self.time), rows + drives, rows + drives)) for _ in range(3)]
        for part, block in zip(system, (below, diagonal, above), strict=True):
            part[:, :rows, :rows] = block
        system[1][:, :rows, rows:] = efforts
        system[1][:, rows:, :rows] = now.by
        # unknowns of one size: lengths over that of the mechanism, efforts by the largest work of a motion of that size
        of_motion = np.sqrt(self.layout.pick**2 @ self.layout.solver.topology.scale**2)
        largest = np.abs(of_motion[:, None] * diagonal * of_motion).max()
        scale = np.concatenate([of_motion, largest / (self.layout.drives @ self.layout.solver.topology.scale)])

        def solve(residual: Array, missed: Array) -> Array:
            right = -np.concatenate([residual, missed], axis=1)
            solved = solve_tridiagonal(system[0] * scale, system[1] * scale, system[2] * scale, right) * scale
            return np.asarray(solved[:, :rows])

        return solve

    def _compute_blocks(self, at: NodePoses, now: LinearisedEquations) -> tuple[Array, Array, Array]:
        """Derivatives of each instant's equations of motion by the poses before, at and after it."""
        h = self.h
        k, c, m = now.tangent
        ahead = m / h**2 + c / (2 * h)
        back = m / h**2 - c / (2 * h)
        for ends in (0, -1):  # at rest whatever comes after
            ahead[ends] = 0.0
            back[ends] = 0.0
        if self.layout.planar or not len(self.layout.triple):
            return back, k - ahead - back, ahead
        delta = self.layout.compute_differences(at, h)[2]
        none = np.zeros((1, len(self.layout.triple), 3))
        after = np.concatenate([delta, none])
        before = np.concatenate([none, -delta])
        diagonal = k - (self._apply_increment_map(ahead, after, True) + self._apply_increment_map(back, before, True))
        return self._apply_increment_map(back, before, False), diagonal, self._apply_increment_map(ahead, after, False)

    def _apply_increment_map(self, block: Array, delta: Array, transposed: bool) -> Array:
        """A block times d(delta) by the increment of its other end (H^-1) or, ``transposed``, less that of its own (H^-T)."""
        # (sample, rotation, 3, 3)
        out = block.copy()
        inverse = compute_inverse_tangents(delta)
        for k, triple in enumerate(self.layout.triple):
            out[:, :, triple] = block[:, :, triple] @ (
                np.swapaxes(inverse[:, k], 1, 2) if transposed else inverse[:, k]
            )
        return out

    def take_instant(self, sample: int) -> Horizon:
        """Return the equations of one instant alone, at rest, number ``sample`` [-]."""
        reach = PathMotion(*(part[[sample]] for part in vars(self.reach).values()))
        return Horizon(self.layout, self.way, reach, self.time[[sample]], self.h)
