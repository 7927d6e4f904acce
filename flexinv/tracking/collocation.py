"""All instants of a motion as one set of unknowns: poses on the manifold, their central differences, and the equations.

    delta+ = log(R_k^T R_(k+1)),   delta- = log(R_k^T R_(k-1)),   and likewise x_(k+1) - x_k, x_(k-1) - x_k
    u_k = (delta+ - delta-) / (2 h)           u'_k = (delta+ + delta-) / h^2           (at rest: zero, at both ends)

which is symmetric in time and of second order.  The equations of instant k, with efforts tau of the drives:

    r(y_k, u_k, u'_k) - S tau_k = 0,          c(y_k) = 0

Their linearisation is block tridiagonal in time: instant k feels k - 1 and k + 1 through its velocity and acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexinv.dynamics.dofs import ElementArrays
from flexinv.dynamics.initial_state import instant
from flexinv.dynamics.loads import load_table
from flexinv.dynamics.solver import Solver, Trajectory, by_unknown
from flexinv.kernels.dense import solve_tridiagonal
from flexinv.kernels.so3 import exp_so3, log_so3
from flexinv.kinematics.joint_motion import relative_motion
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.rigid_motion import rigid_motion
from flexinv.kinematics.tree import Joints
from flexinv.planar.detection import Plane, find_plane
from flexinv.tracking.collocation_kernel import Evaluated, Motion, evaluate_instants, inverse_tangents
from flexinv.tracking.frame_path import Poses
from flexinv.tracking.inverse_kinematics import Frame, Reach
from flexinv.typing import Array

# Instants that are linearised at once: their matrices stay in a few megabytes.
CHUNK = 128


@dataclass(frozen=True)
class Placed:
    """Poses at all instants in the march's unknowns.

    flat : (samples, unknowns) positions and scalar coordinates [m], [rad], zero where a rotation is meant
    turn : (samples, rotations, 3, 3), those of `Layout.triple`
    """

    flat: Array
    turn: Array


@dataclass(frozen=True)
class Layout:
    """Layout of the unknowns of a mechanism whose joints are all free.

    triple : (rotations,) first of three unknowns that are a rotation; node : (rotations,) whose it is
    pick : (rows, unknowns) what a mechanism in a plane leaves of them, the identity in space; planar : which of the two
    drives : (nv, unknowns) rows of the drives alone, by coordinate
    """

    solver: Solver
    joints: Joints
    triple: NDArray[np.int64]
    node: NDArray[np.int64]
    pick: Array
    planar: bool
    drives: Array

    @classmethod
    def of(cls, mesh: Mesh) -> Layout:
        """Return the unknowns of a mesh with every joint free [m], [rad]."""
        m = mesh.mechanism
        solver = Solver.of(mesh, {joint.name for joint in m.joints if joint.nv})
        t = solver.topology
        first = t.offset[t.block] + np.where(t.independent, 3, t.column + t.triple)
        node = np.flatnonzero(t.independent | (t.triple >= 0))
        zero = np.zeros(m.nv)
        springless = replace(m, joints=tuple(replace(j, stiffness=0.0) for j in m.joints))  # springs stay in the plane
        plane = find_plane(build(springless))
        pick = _in_plane(mesh, solver, plane) if isinstance(plane, Plane) else np.eye(len(t.scale))
        drives = by_unknown(mesh, t) * m.actuated[:, None]
        joints = instant(mesh, m.neutral, zero, zero)
        return cls(solver, joints, first[node], node, pick, isinstance(plane, Plane), drives[m.actuated])

    def undeformed(self, q: Array) -> Placed:
        """Return the poses of the stress-free mechanism at q (samples, nq) [rad], [m]."""
        mesh, t = self.solver.mesh, self.solver.topology
        zero = np.zeros((len(q), mesh.mechanism.nv))
        motion, rel = rigid_motion(mesh, q, zero, zero), relative_motion(mesh, q, zero, zero)
        flat = np.zeros((len(q), len(t.scale)))
        for n in np.flatnonzero(t.independent):
            o = t.offset[t.block[n]]
            flat[:, o : o + 3] = motion.x[:, n]
        for n in np.flatnonzero(t.freedoms):
            own = slice(t.offset[t.block[n]] + t.column[n], t.offset[t.block[n]] + t.column[n] + t.freedoms[n])
            slide, turn = t.slide[n, : t.freedoms[n]], t.turn[n, : t.freedoms[n]]
            flat[:, own] = (rel.p[:, n] - self.joints.p[n]) @ (slide * ~turn.any(axis=1, keepdims=True)).T
            if t.triple[n] < 0:
                angle = log_so3(self.joints.r[n].T @ rel.rotation[:, n]) @ turn.T  # (sample, freedom)
                flat[:, own] += np.unwrap(angle, axis=0) if len(q) > 1 else angle
        turned = [motion.rotation[:, n] if t.independent[n] else rel.rotation[:, n] for n in self.node]
        return Placed(flat, np.stack(turned, axis=1) if turned else np.zeros((len(q), 0, 3, 3)))

    def nodes(self, at: Placed) -> tuple[Array, Array]:
        """Return x (samples, nodes, 3) [m], r (samples, nodes, 3, 3) as the march's state has them."""
        t, size = self.solver.topology, len(at.flat)
        x, r = np.tile(self.joints.p, (size, 1, 1)), np.tile(self.joints.r, (size, 1, 1, 1))
        for n in np.flatnonzero(t.independent):
            o = t.offset[t.block[n]]
            x[:, n] = at.flat[:, o : o + 3]
        for n in np.flatnonzero(t.freedoms):
            first = t.offset[t.block[n]] + t.column[n]
            own = at.flat[:, first : first + t.freedoms[n]]
            x[:, n] += own @ t.slide[n, : t.freedoms[n]]
            if t.triple[n] < 0:
                r[:, n] = r[:, n] @ exp_so3(own @ t.turn[n, : t.freedoms[n]])
        for k, n in enumerate(self.node):
            r[:, n] = at.turn[:, k]
        return x, r

    def moved(self, at: Placed, y: Array) -> Placed:
        """Return the poses after increments y (samples, unknowns) [m], [rad], rotations in the node's own frame."""
        turns = self._turns(y)
        flat = at.flat + y
        for first in self.triple:
            flat[:, first : first + 3] = 0.0
        return Placed(flat, at.turn @ exp_so3(turns))

    def _turns(self, y: Array) -> Array:
        """(samples, rotations, 3) [rad] of vectors of unknowns."""
        return y[:, self.triple[:, None] + np.arange(3)]

    def differences(self, at: Placed, h: float) -> tuple[Array, Array, Array]:
        """Return u, u' (samples, unknowns) [m, rad, s], zero at the ends, and delta+ of rotations (samples - 1, rotations, 3)."""
        ahead = np.diff(at.flat, axis=0)
        delta = log_so3(np.swapaxes(at.turn[:-1], 2, 3) @ at.turn[1:])
        ahead[:, self.triple[:, None] + np.arange(3)] = delta
        u, du = np.zeros_like(at.flat), np.zeros_like(at.flat)
        u[1:-1] = (ahead[1:] + ahead[:-1]) / (2 * h)
        du[1:-1] = (ahead[1:] - ahead[:-1]) / h**2
        return u, du, delta


def _in_plane(mesh: Mesh, solver: Solver, plane: Plane) -> Array:
    """(rows, unknowns): components along the plane's axes, turns about its normal, and the joints' own coordinates."""
    t, rows = solver.topology, []
    for n in range(mesh.size):
        o = t.offset[t.block[n]]
        if t.independent[n]:
            own = np.zeros((3, len(t.scale)))
            own[:2, o : o + 3] = plane.axes.T[:2]
            own[2, o + 3 : o + 6] = plane.frames[n, 2]
            rows += list(own)
        elif t.freedoms[n]:
            rows.append(np.eye(len(t.scale))[o + t.column[n]])
    return np.array(rows).reshape(-1, len(t.scale))


@dataclass(frozen=True)
class Task:
    """Task of stable inversion: the poses of the frame, and joint motion where these leave the drives free.

    wanted : Poses; reach : of the rigid mechanism; length : that turns rotations into lengths [m]; duration : of the path [s]
    """

    frame: Frame
    wanted: Poses
    reach: Reach
    length: float
    duration: float


@dataclass(frozen=True)
class Linearised:
    """The equations at all instants: residuals and derivatives in the unknowns that are picked; trajectory as evaluated.

    residual : (samples, rows); k, c, m : (samples, rows, rows); missed, by : (samples, tasks), (samples, tasks, rows)
    """

    residual: Array
    k: Array
    c: Array
    m: Array
    missed: Array
    by: Array
    trajectory: Trajectory


class TurnedTooMuch(Exception):
    """An element turned too much at an instant while Newton was on its way."""


@dataclass(frozen=True)
class Horizon:
    """The space-time equations of one task on the instants ``time`` (samples,) [s], spaced by ``h`` [s]."""

    layout: Layout
    task: Task
    time: Array
    h: float

    def evaluate(self, at: Placed, stiffness: float = 1.0, want: bool = True) -> Linearised:
        """Return residuals and derivatives at the poses ``at`` [m], [rad], the beams ``stiffness`` times as stiff [-].

        Raises TurnedTooMuch.
        """
        u, du, _ = self.layout.differences(at, self.h)
        rows, mesh, size = len(self.layout.pick), self.layout.solver.mesh, len(self.time)
        tasks = self.task.reach.within.shape[2] + self.task.reach.idle.shape[2]
        shape = (size if want else 0, rows, rows)
        out = Linearised(
            np.zeros((size, rows)), np.zeros(shape), np.zeros(shape), np.zeros(shape),
            np.zeros((size, tasks)), np.zeros((size, tasks, rows)), Trajectory.empty(size, mesh),
        )  # fmt: skip
        e = self.layout.solver.elements
        beams = e._replace(stiffness=stiffness * e.stiffness)
        for first in range(0, size, CHUNK):
            self._chunk(slice(first, min(first + CHUNK, size)), at, u, du, beams, want, out)
        return out

    def _chunk(
        self, part: slice, at: Placed, u: Array, du: Array, beams: ElementArrays, want: bool, out: Linearised
    ) -> None:
        s, pick, unknowns = self.layout.solver, self.layout.pick, u.shape[1]
        x, r = self.layout.nodes(Placed(at.flat[part], at.turn[part]))
        count = len(x)
        own, wanted = out.trajectory.rows(part.start, part.stop), count if want else 0
        tangent, reach = np.zeros((wanted, 3, unknowns, unknowns)), np.zeros((wanted, 6, unknowns))
        now = Evaluated(np.zeros((count, unknowns)), tangent, reach, own.histories())
        joints = Joints(*(given.copy() for given in self.layout.joints))  # free ones are overwritten
        motion = Motion(x, r, at.flat[part], u[part], du[part], load_table(s.mesh, self.time[part]))
        system = s.system._replace(elements=beams)
        instant_, element = evaluate_instants(system, joints, motion, self.task.frame.node, now)
        if instant_ >= 0:
            raise TurnedTooMuch(f"t = {self.time[part.start + instant_]:g} s, element {element}")
        out.residual[part] = now.residual @ pick.T
        out.missed[part], by = self._missed(part, at, own, reach)
        if want:
            for which, whole_out in enumerate((out.k, out.c, out.m)):
                whole_out[part] = pick @ tangent[:, which] @ pick.T
            out.by[part] = by @ pick.T

    def _missed(self, part: slice, at: Placed, own: Trajectory, reach: Array) -> tuple[Array, Array]:
        """c(y) (samples, tasks) [m], [rad] and its derivative (samples, tasks, unknowns)."""
        task, drives = self.task, self.layout.drives
        now = task.frame.poses(own.motion)
        node = own.motion.rotation[:, task.frame.node]
        off, by = now.x - task.wanted.x[part], np.zeros((len(reach), 3, reach.shape[2]))
        if len(reach):
            spin = np.cross(np.swapaxes(reach[:, 3:], 1, 2), task.frame.point)  # (sample, unknown, xyz)
            by = reach[:, :3] + node @ np.swapaxes(spin, 1, 2)
        if task.wanted.rotation is not None and now.rotation is not None:
            turn = log_so3(np.swapaxes(task.wanted.rotation[part], 1, 2) @ now.rotation)
            off = np.hstack([off, task.length * turn])
            if len(reach):
                seen = task.length * inverse_tangents(turn) @ (task.frame.turn.T @ reach[:, 3:])
                by = np.concatenate([by, seen], axis=1)
        across = np.swapaxes(task.reach.within[part], 1, 2)  # (sample, direction, row)
        idle = np.swapaxes(task.reach.idle[part], 1, 2)  # (sample, self-motion, drive)
        away = at.flat[part] @ drives.T - self._drives[part]
        missed = np.hstack([np.einsum("str,sr->st", across, off), np.einsum("std,sd->st", idle, away)])
        return missed, np.concatenate([across @ by, idle @ drives], axis=1) if len(reach) else by

    @property
    def _drives(self) -> Array:
        """Drives of the rigid mechanism (samples, drives) [rad], [m]."""
        return self.layout.undeformed(self.task.reach.q).flat @ self.layout.drives.T

    def step(self, at: Placed, now: Linearised) -> tuple[Array, Array]:
        """Return Newton's increments y (samples, unknowns) [m], [rad] and the efforts tau (samples, drives) [N m], [N]."""
        below, own, above = self._blocks(at, now)
        efforts = -self.layout.pick @ self.layout.drives.T  # (row, drive)
        rows, drives = efforts.shape
        system = [np.zeros((len(self.time), rows + drives, rows + drives)) for _ in range(3)]
        for part, block in zip(system, (below, own, above), strict=True):
            part[:, :rows, :rows] = block
        system[1][:, :rows, rows:], system[1][:, rows:, :rows] = efforts, now.by
        right = -np.concatenate([now.residual, now.missed], axis=1)
        # unknowns of one size: lengths over that of the mechanism, efforts by the largest work of a motion of that size
        of_motion = np.sqrt(self.layout.pick**2 @ self.layout.solver.topology.scale**2)
        largest = np.abs(of_motion[:, None] * own * of_motion).max()
        scale = np.concatenate([of_motion, largest / (self.layout.drives @ self.layout.solver.topology.scale)])
        solved = solve_tridiagonal(system[0] * scale, system[1] * scale, system[2] * scale, right) * scale
        return solved[:, :rows] @ self.layout.pick, solved[:, rows:]

    def _blocks(self, at: Placed, now: Linearised) -> tuple[Array, Array, Array]:
        """Derivatives of each instant's equations of motion by the poses before, at and after it."""
        h = self.h
        ahead, back = now.m / h**2 + now.c / (2 * h), now.m / h**2 - now.c / (2 * h)
        for ends in (0, -1):  # at rest whatever comes after
            ahead[ends], back[ends] = 0.0, 0.0
        if self.layout.planar or not len(self.layout.triple):
            return back, now.k - ahead - back, ahead
        delta = self.layout.differences(at, h)[2]
        none = np.zeros((1, *delta.shape[1:]))
        after, before = np.concatenate([delta, none]), np.concatenate([none, -delta])
        own = now.k.copy()
        own -= self._through(ahead, after, True) + self._through(back, before, True)
        return self._through(back, before, False), own, self._through(ahead, after, False)

    def _through(self, block: Array, delta: Array, transposed: bool) -> Array:
        """A block times d(delta) by the increment of its other end (H^-1) or, ``transposed``, less that of its own (H^-T)."""
        out, inverse = block.copy(), inverse_tangents(delta)  # (sample, rotation, 3, 3)
        for k, first in enumerate(self.layout.triple):
            turn = np.swapaxes(inverse[:, k], 1, 2) if transposed else inverse[:, k]
            out[:, :, first : first + 3] = block[:, :, first : first + 3] @ turn
        return out

    def scaled(self, y: Array) -> float:
        """Return the largest increment relative to the mechanism's length, or in radians [-]."""
        return float(np.abs(y / self.layout.solver.topology.scale).max(initial=0.0))

    def at(self, sample: int) -> Horizon:
        """Return the equations of one instant alone, at rest, number ``sample`` [-]."""
        one = slice(sample, sample + 1) if sample >= 0 else slice(sample, None)
        w, r = self.task.wanted, self.task.reach
        turned = [None if part is None else part[one] for part in (w.rotation, w.omega, w.alpha)]
        wanted = Poses(w.x[one], w.v[one], w.a[one], *turned)
        reach = Reach(*(part[one] for part in (r.q, r.qd, r.qdd, r.within, r.idle)))
        return Horizon(self.layout, replace(self.task, wanted=wanted, reach=reach), self.time[one], self.h)
