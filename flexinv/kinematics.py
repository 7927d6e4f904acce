"""Kinematics, the paper's first step: a task gives the flexible trajectory, by the finite-element march with stiffness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexinv.assemble import Loads, State, Work
from flexinv.beam import Scratch
from flexinv.errors import ConvergenceError
from flexinv.integrate import ACCELERATIONS, STATICS, Scheme
from flexinv.joint import JointHistory, relative_motion
from flexinv.march import CONVERGED, NOT_FINITE, TURNED_TOO_MUCH, march
from flexinv.mechanism import Array
from flexinv.mesh import Mesh
from flexinv.nodal import NodalMotion
from flexinv.rigid import rigid_motion
from flexinv.system import ElementArrays, Topology, element_arrays, topology
from flexinv.ties import Ties, ties
from flexinv.tree import Frames, Joints, Variation, carry_samples

# Samples handed to the compiled loop at once: short enough for a live progress bar, long enough to cost nothing.
CHUNK = 256

# Times closer than this part of a step are the same instant.
SAME_TIME = 1e-6

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Trajectory:
    """The flexible trajectory and what holds it together.

    motion : NodalMotion of all nodes
    wrench : (samples, nodes, 6) force [N] (world) and moment [N m] (own frame) on every node of a rigid part from
        inertia, loads and the elastic reactions of the beams that start there
    internal : (samples, elements, points, 6) stress resultants in the section frame [N], [N m]
    energy : (samples, 2) elastic energy [J] and its rate [W]; iterations : (samples,) of Newton
    multipliers : (samples, rows) of the closures [N], [N m]
    """

    motion: NodalMotion
    wrench: Array
    internal: Array
    energy: Array
    multipliers: Array
    iterations: NDArray[np.int64]

    def histories(self) -> tuple[Array, ...]:
        """Return x, rotation, v, omega, a, alpha, wrench, internal, energy, multipliers [m, rad, s, N, J]."""
        m = self.motion
        return m.x, m.rotation, m.v, m.omega, m.a, m.alpha, self.wrench, self.internal, self.energy, self.multipliers

    def rows(self, first: int, last: int) -> Trajectory:
        """Return the samples from ``first`` to before ``last``, not copied [m, rad, s, N, J]."""
        parts = [part[first:last] for part in self.histories()]
        wrench, internal, energy, multipliers = parts[6:]
        motion = NodalMotion(*parts[:6])
        return Trajectory(motion, wrench, internal, energy, multipliers, self.iterations[first:last])

    @classmethod
    def empty(cls, samples: int, mesh: Mesh, rows: int = 0) -> Trajectory:
        """Return histories to be filled [m, rad, s, N, J]."""
        points = mesh.elements.weight.shape
        return cls(
            NodalMotion.empty(samples, mesh.size), np.zeros((samples, mesh.size, 6)), np.zeros((samples, *points, 6)),
            np.zeros((samples, 2)), np.zeros((samples, rows)), np.zeros(samples, dtype=np.int64),
        )  # fmt: skip


@dataclass
class Solver:
    """All arrays of the implicit solve of one mesh, allocated once."""

    mesh: Mesh
    topology: Topology
    elements: ElementArrays
    state: State
    frames: Frames
    variation: Variation
    work: Work
    loads: Loads
    increment: Array
    ties: Ties
    instant: Trajectory

    @classmethod
    def of(cls, mesh: Mesh, passive: set[str]) -> Solver:
        """Return the solver of a mesh with the named joints free."""
        t = topology(mesh, passive)
        unknowns, widest = len(t.scale), max(int(t.size.max(initial=0)), 1)
        state = State(
            np.zeros((mesh.size, 3)), np.tile(np.eye(3), (mesh.size, 1, 1)), *(np.zeros(unknowns) for _ in range(7))
        )
        vector = [np.zeros((mesh.size, 3)) for _ in range(5)]
        frames = Frames(vector[0], np.zeros((mesh.size, 3, 3)), *vector[1:])
        variation = Variation(*(np.zeros((mesh.size, widest, 3)) for _ in range(6)))
        loads = Loads(np.zeros((mesh.size, 6)), np.zeros((mesh.size, 6)))
        tied = ties(mesh, unknowns)
        sides = 1 + len(tied.a)
        work = _work(mesh, t, unknowns, widest, sides)
        increment, instant = np.zeros((sides, unknowns)), Trajectory.empty(1, mesh, len(tied.a))
        return cls(mesh, t, element_arrays(mesh), state, frames, variation, work, loads, increment, tied, instant)

    def march(self, scheme: Scheme, rel: Joints, out: Trajectory) -> tuple[int, int, int, float]:
        """Solve the instants of ``rel`` (samples, nodes, ...) one after the other [m, rad, s], filling ``out``.

        Return status, samples done, iterations or element, last relative increment [-].
        """
        status, sample, count, size = march(
            self.topology, self.elements, self.ties, scheme, ACCELERATIONS, self.state, self.frames, self.variation,
            self.loads, self.work, self.increment, rel, Frames(*out.histories()[:6]), out.wrench, out.internal, out.energy,
            out.multipliers, out.iterations,
        )  # fmt: skip
        return int(status), int(sample), int(count), float(size)

    def newton(self, scheme: Scheme, joints: Joints) -> tuple[int, int, float]:
        """Solve one instant; return status, iterations or element, last relative increment [-]."""
        status, _, count, size = self.march(scheme, Joints(*(part[None] for part in joints)), self.instant)
        return status, count, size

    def complain(self, status: int, count: int, size: float, when: str) -> ConvergenceError:
        """Return the error that says where and how the solve failed (``size`` [-] of the last increment) and what to try."""
        name = self.mesh.mechanism.name
        if status == TURNED_TOO_MUCH:
            e = self.mesh.elements
            link = self.mesh.mechanism.links[int(e.link[count])].name
            return ConvergenceError(
                f"mechanism '{name}', link '{link}', {when}: element {count} turns by more than 2.5 rad between its nodes; "
                "use more elements (elements = 2 or more on this link), or a smaller step if the motion diverged"
            )
        what = "is not a finite number" if status == NOT_FINITE else f"is still {size:.1e} after {count} iterations"
        return ConvergenceError(
            f"mechanism '{name}', {when}: Newton's increment (relative to the mechanism's length) {what}; "
            "try a smaller step, a smoother motion (law = 'quintic'), or check that the stiffness is what you mean"
        )


def _work(mesh: Mesh, t: Topology, unknowns: int, widest: int, sides: int) -> Work:
    elements, count = mesh.elements.nodes.shape if mesh.elements.nodes.size else (0, 1)
    rows = max((_rows(t, mesh, k) for k in range(elements)), default=0)
    return Work(
        wrench=np.zeros((mesh.size, 6)),
        dwrench=np.zeros((mesh.size, widest, 6)),
        residual=np.zeros((sides, unknowns)),
        diagonal=np.zeros((len(t.size), widest, widest)),
        tangent=np.zeros((elements, 6 * count, 6 * count)),
        internal=np.zeros((elements, max(count - 1, 0), 6)),
        energy=np.zeros(2),
        element=Scratch.of(count),
        own_x=np.zeros((widest, 3)),
        own_t=np.zeros((widest, 3)),
        system=np.zeros((max(rows, widest), max(rows, widest) + widest + sides)),
        solved=np.zeros((elements, rows, widest + sides)),
    )


def _rows(t: Topology, mesh: Mesh, element: int) -> int:
    nodes = mesh.elements.nodes[element]
    return int(sum(t.size[t.block[n]] for n in nodes[1:] if n >= 0))


def instant(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Joints:
    """Return the relative motion of all nodes at one instant, q (nq,), qd, qdd (nv,) [m, rad, s]."""
    rel = relative_motion(mesh, q[None], qd[None], qdd[None])
    return Joints(*(np.ascontiguousarray(part[0]) for part in rel))


def start_undeformed(solver: Solver, q: Array, qd: Array, qdd: Array) -> None:
    """Set the unknowns to the rigid motion of the stress-free mechanism at one instant [m, rad, s]."""
    motion = rigid_motion(solver.mesh, q[None], qd[None], qdd[None])
    joints = instant(solver.mesh, q, qd, qdd)
    _start(solver, motion, joints, qd, qdd)


def _start(solver: Solver, motion: NodalMotion, joints: Joints, qd: Array, qdd: Array) -> None:
    t, s = solver.topology, solver.state
    for n in range(solver.mesh.size):
        o = t.offset[t.block[n]]
        if t.independent[n]:
            s.x[n], s.r[n] = motion.x[0, n], motion.rotation[0, n]
            s.u[o : o + 6] = np.concatenate([motion.v[0, n], motion.omega[0, n]])
            s.du[o : o + 6] = np.concatenate([motion.a[0, n], motion.alpha[0, n]])
        elif t.freedoms[n]:
            s.x[n], s.r[n] = joints.p[n], joints.r[n]
            own = slice(o + t.column[n], o + t.column[n] + t.freedoms[n])
            v = int(solver.mesh.v_index[n])
            s.u[own], s.du[own] = _passive_rates(
                solver, n, joints, qd[v : v + t.freedoms[n]], qdd[v : v + t.freedoms[n]]
            )
    _accept(s)


def _passive_rates(solver: Solver, n: int, joints: Joints, qd: Array, qdd: Array) -> tuple[Array, Array]:
    """Rates of a passive joint in the march's own coordinates: a free joint's p' is taken in the joint frame."""
    t = solver.topology
    if t.triple[n] != 3:
        return qd, qdd
    placed = solver.mesh.rotation[n]
    return np.concatenate([placed.T @ joints.dp[n], qd[3:]]), np.concatenate([placed.T @ joints.ddp[n], qdd[3:]])


def _accept(s: State) -> None:
    s.u0[:], s.du0[:], s.pseudo[:] = s.u, s.du, s.du
    s.d[:] = 0.0


def consistent_accelerations(solver: Solver, joints: Joints, when: str) -> None:
    """Find the accelerations [m/s^2], [rad/s^2] that the present state of motion has, and start the integrator with them."""
    status, count, size = solver.newton(ACCELERATIONS, joints)
    if status != CONVERGED:
        raise solver.complain(status, count, size, when)
    _accept(solver.state)


# A load step is halved at most this often before the equilibrium is called unreachable.
MOST_HALVINGS = 12


def equilibrium(solver: Solver, q: Array, when: str) -> Joints:
    """Find the rest position under gravity and the solver's loads, raised from zero in steps as large as converge [N].

    The unknowns must hold a starting position; returns the relative motion (at rest) of the prescribed joints.
    Raises ConvergenceError, naming the part of the load that was reached.
    """
    nv = solver.mesh.mechanism.nv
    joints = instant(solver.mesh, q, np.zeros(nv), np.zeros(nv))
    full = Loads(solver.loads.dead.copy(), solver.loads.follower.copy())
    gravity, state = solver.topology.gravity.copy(), solver.state
    reached, part = 0.0, 1.0
    while reached < 1.0:
        target = min(1.0, reached + part)
        solver.loads.dead[:], solver.loads.follower[:] = target * full.dead, target * full.follower
        solver.topology.gravity[:] = target * gravity
        status, count, size = solver.newton(STATICS, joints)
        if status == CONVERGED:
            reached, part = target, 2 * part
            continue
        state.d[:] = 0.0
        part *= 0.5
        if part < 0.5**MOST_HALVINGS:
            raise solver.complain(status, count, size, f"{when}, {reached:.1%} of the load")
    return joints


def flexible_motion(
    mesh: Mesh,
    before: JointHistory,
    after: JointHistory,
    time: Array,
    scheme: Scheme,
    passive: set[str] | None = None,
    jumps: tuple[float, ...] = (),
    initial: str = "consistent",
    progress: Progress | None = None,
) -> Trajectory:
    """Return the flexible trajectory over a uniform grid ``time`` (samples,) [s] of prescribed joint motion.

    before, after : time -> q (samples, nq), qd, qdd (samples, nv) [rad or m, s], the left-hand and the right-hand limit
        where accelerations jump; passive joints start from the first sample
    initial : "consistent" (undeformed, accelerations solved for) or "static" (equilibrium under gravity first)
    jumps : times [s] at which accelerations jump; there the accelerations are solved anew (right-hand limit)

    Raises ConvergenceError with the time, the size of the increment and what to try.
    """
    solver = Solver.of(mesh, passive or set())
    out = Trajectory.empty(len(time), mesh, len(solver.ties.a))
    _begin(solver, after, time, initial, out)
    stops = _jump_samples(time, jumps)
    start = 1
    for stop in sorted({*stops, len(time) - 1}):
        for first in range(start, stop + 1, CHUNK):
            last = min(first + CHUNK, stop + 1)
            _march(solver, before, time[first:last], scheme, out, first)
            if progress is not None:
                progress(last - first)
        if stop in stops:
            _restart(solver, after, time, stop, out)
        start = stop + 1
    return out


def _begin(solver: Solver, history: JointHistory, time: Array, initial: str, out: Trajectory) -> None:
    q, qd, qdd = (part[0] for part in history(time[:1]))
    start_undeformed(solver, q, qd, qdd)
    joints = instant(solver.mesh, q, qd, qdd)
    when = f"at the start, t = {time[0]:g} s"
    if initial == "static":
        equilibrium(solver, q, when)
        _move_as_rigid(solver, joints, qd, qdd)
    consistent_accelerations(solver, joints, when)
    record_instant(solver, 0, out)


def _move_as_rigid(solver: Solver, joints: Joints, qd: Array, qdd: Array) -> None:
    """Give the deformed mechanism the velocities it has when it moves on without changing its deformation."""
    mesh, frames, t = solver.mesh, solver.frames, solver.topology
    shape = Joints(*(part.copy() for part in joints))
    for n in range(mesh.size):
        m = mesh.parent[n]
        if t.independent[n]:
            shape.p[n] = frames.r[m].T @ (frames.x[n] - frames.x[m])
            shape.r[n] = frames.r[m].T @ frames.r[n]
        elif t.freedoms[n]:
            shape.p[n], shape.r[n] = solver.state.x[n], solver.state.r[n]
    moving = NodalMotion.empty(1, mesh.size)
    _carry_all(mesh, moving, shape)
    _start(solver, moving, shape, qd, qdd)


def _carry_all(mesh: Mesh, motion: NodalMotion, joints: Joints) -> None:
    world = (motion.x, motion.rotation, motion.v, motion.omega, motion.a, motion.alpha)
    carry_samples(mesh.parent, *world, *(part[None] for part in joints))


def _jump_samples(time: Array, jumps: tuple[float, ...]) -> list[int]:
    """Samples after the first at which the acceleration jumps."""
    step = time[1] - time[0] if len(time) > 1 else 1.0
    found = {round((jump - time[0]) / step) for jump in jumps}
    return sorted(k for k in found if 0 < k < len(time) and _is_jump(time[k], jumps, step))


def _is_jump(t: float, jumps: tuple[float, ...], step: float) -> bool:
    return any(abs(t - jump) < SAME_TIME * step for jump in jumps)


def _march(solver: Solver, history: JointHistory, time: Array, scheme: Scheme, out: Trajectory, first: int) -> None:
    rel = Joints(*(np.ascontiguousarray(part) for part in relative_motion(solver.mesh, *history(time))))
    status, sample, count, size = solver.march(scheme, rel, out.rows(first, first + len(time)))
    if status != CONVERGED:
        raise solver.complain(status, count, size, f"at t = {time[sample]:g} s (step {scheme.h:g} s)")


def _restart(solver: Solver, history: JointHistory, time: Array, sample: int, out: Trajectory) -> None:
    """Solve the accelerations anew where those of the task jump, and record their right-hand limit."""
    s = solver.state
    s.u[:], s.du[:] = s.u0, s.du0
    q, qd, qdd = (part[0] for part in history(time[sample : sample + 1]))
    consistent_accelerations(solver, instant(solver.mesh, q, qd, qdd), f"at t = {time[sample]:g} s")
    record_instant(solver, sample, out)


def record_instant(solver: Solver, sample: int, out: Trajectory) -> None:
    """Copy the instant that was solved last into the histories [m, rad, s, N]."""
    for history, value in zip(out.histories(), solver.instant.histories(), strict=True):
        history[sample] = value[0]
