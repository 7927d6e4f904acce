"""A mechanism prepared for inverse dynamics: all that does not depend on the motion is computed once."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from threading import Lock, local
from typing import Any

import numpy as np
from numba import types
from numpy.typing import ArrayLike

from flexinv.constraints.allocation import OPEN, OPEN_ACCELERATION, OPEN_RATE, PrescribedLoops
from flexinv.constraints.closures import build_constraint_rows
from flexinv.constraints.reactions import compute_closure_wrenches
from flexinv.dynamics.applied_wrenches import compute_applied_efforts
from flexinv.inverse import inverse_dynamics as nodal_dynamics
from flexinv.inverse.inverse_dynamics import check_constant, compute_applied_forces, compute_spring_efforts
from flexinv.kernels.memory import LINE, make_aligned_zeros
from flexinv.kernels.simd import BLOCK
from flexinv.kernels.threads.affinity import count_processors
from flexinv.kernels.threads.atomics import COMPILED
from flexinv.kernels.threads.worker_pool import CELLS
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import NodalMotion, compute_rigid_motion
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_owner_cache, make_read_only
from flexinv.rigid import joint_arrays
from flexinv.rigid.blocks import CALL_CELLS, HELPERS, OVERLAP, collect, compute_torque_blocks, run_helper
from flexinv.rigid.joint_arrays import Order, convert_to_sample_view
from flexinv.rnea import loop_layout as layout
from flexinv.rnea.body_table import Bodies, build_bodies
from flexinv.rnea.loop_layout import LoopPlan
from flexinv.rnea.loop_plan import NO_LOOPS, PLACES, list_closure_ends, plan_loops, sample_configurations
from flexinv.typing import Array, Unsigned
from flexinv.validation import ARRAY_TYPE, FLOAT_TYPE, check_flag, check_kind, check_whole_number

THREADS = "1 or more, or None for one per processor"
# Joints times samples that keep one thread busy for so long that help pays, of a helper that watches (which begins within
# 1 us) and of one that sleeps (within 30 us).
WORTH_HELP = 2_000
WORTH_WAKING = 16_000

_ONE = np.uint64(1)
_ONE_SAMPLE = np.ones((4, 2), dtype=np.uint64)
_NOBODY = np.zeros((0, CELLS), dtype=np.uint64)
_COMPILING = Lock()


class _ThreadData(local):
    """Data of one thread: a work space for itself and for each helper, and a counter of blocks.

    Rows of the work space begin with a line of the cache: else every vector of eight numbers meets two of them.
    """

    def __init__(self, threads: int, size: int) -> None:
        self.work = make_aligned_zeros(threads, size + -size % LINE)
        self.counter = np.zeros(CALL_CELLS + 1, dtype=np.uint64)
        # What `sample` needs, looked up at once: the data of a thread are slow to come by.
        self.of_sample = self.work, self.counter, memoryview(self.counter)  # type: ignore[arg-type]

    def prepare_cells(self, samples: int) -> Unsigned:
        """The counter, with a cell for every block."""
        if len(self.counter) < CALL_CELLS + samples // BLOCK + 1:
            self.counter = np.zeros(CALL_CELLS + samples // BLOCK + 1, dtype=np.uint64)
        return self.counter


@dataclass(frozen=True, eq=False)
class NodalResult(ByValue):
    """The motion and the forces of all nodes, of `TorqueFunction.nodal`.

    torque : (samples, nv) effort of every joint coordinate, as `TorqueFunction.torques` has it [N m], [N]
    motion : of all nodes, world frame (`NodalMotion`); forces : P, what acts on every node so that it moves as it does
    wrench : joint -> (samples, 6) force [N] and moment [N m] on the child, at the joint, in the child's link frame
    reaction : closure -> (samples, 6) the same on its second link, as `Solution.loops` has it; empty without closures
    node : link -> number of its link frame's node; body : (link, body) -> number of the node at its centre of mass
    """

    torque: Array
    motion: NodalMotion
    forces: nodal_dynamics.NodalForces
    wrench: dict[str, Array]
    reaction: dict[str, Array]
    node: dict[str, int]
    body: dict[tuple[str, str], int]


@dataclass(frozen=True, eq=False)
class TorqueFunction(ByValue):
    """The efforts of one rigid mechanism as a function of its motion, tau = L T P; made by `prepare`.

    Calls from several threads do not disturb each other: each has a work space of its own.
    passive : joint springs, damping and dry friction are part of the efforts; threads : most that work on one call [-]
    loops : of the closures, where there are some; loaded : springs and given forces come first, to be shared out, too
    """

    mechanism: Mechanism
    passive: bool
    threads: int
    mesh: Mesh = field(repr=False, compare=False)
    bodies: Bodies = field(repr=False, compare=False)
    _own: _ThreadData = field(repr=False, compare=False)
    plan: LoopPlan = field(default=NO_LOOPS, repr=False, compare=False)
    loops: PrescribedLoops | None = field(default=None, repr=False, compare=False)
    loaded: bool = field(default=False, compare=False)
    _widths: tuple[int, int] = field(
        default=(0, 0), repr=False, compare=False
    )  # of q, and of qd: `sample` has no time to count

    def torques(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, out: Array | None = None, order: Order = "samples"
    ) -> Array:
        """Return the effort of every joint coordinate [N m] or [N], see `joint_torques`.

        q : (samples, nq) [rad], [m]; qd, qdd : (samples, nv); with order = "coordinates" (nq, samples), (nv, samples); one
            sample may be a plain vector.  Arrays in either order of memory are read as they are, without a copy.
            Of a mechanism with closures they are the consistent motion of all joints; its drives share the efforts, of least
            (weighted) squares where they are redundant, and passive joints have none.
        out : where the efforts go, in the shape of qd, contiguous in either order; returned.  What lies in the same memory is
            copied before.
        Raises InputError: wrong shape, value that is not finite, a motion that the closures do not allow (see `allocation`).
        """
        mails = self._prepare_helpers(
            getattr(qdd, "size", 0)
        )  # first of all: what follows takes as long as waking somebody
        given = joint_arrays.convert_to_arrays(self.mechanism, (q, qd, qdd), order)
        tau = joint_arrays.make_output_array(out, given[1])
        if self.loaded and any(np.may_share_memory(a, tau) for a in given):
            given = [a.copy() for a in given]
        rows = [convert_to_sample_view(a, order) for a in (*given, tau)]
        if self.loaded:
            joint_arrays.check_arrays(self.mechanism, given, order)
            tau.fill(0.0)
            self._add_applied(rows[:3], rows[3])
        counter = self._run_blocks(rows, mails)
        if counter[1]:
            if counter[OVERLAP]:
                q, qd, qdd = (a.copy() for a in given)
                return self.torques(q, qd, qdd, out, order)
            joint_arrays.check_arrays(self.mechanism, given, order)
        if not self.loaded:
            self._add_applied(rows[:3], rows[3])
        if self.loops is not None:
            self._split_loop_efforts(self.loops, counter, rows)
        return tau

    def _run_blocks(self, rows: Sequence[Array], mails: Unsigned) -> Unsigned:
        """Compute the efforts of all samples of q, qd, qdd, tau, with the helpers in ``mails``; return the counter."""
        flat, strides = zip(*(_make_flat_view(a) for a in rows), strict=True)
        b = self.bodies
        loops = (self.plan.plan, self.plan.fixed)
        memory = self._own
        counter = memory.prepare_cells(len(rows[0]))
        call = np.uint64(len(rows[0])), memory.work, counter, mails
        try:
            ended = compute_torque_blocks(
                b.tree, b.numbers, b.columns, *loops, *flat, _make_stride_table(strides), *call
            )
            while not ended:
                time.sleep(0)  # the system holds a helper up
                ended = collect(*loops, *call)
        except BaseException:  # Ctrl-C: a helper may still write where memory is about to be given back
            while len(mails) and not collect(*loops, *call):
                pass
            raise
        return counter

    def nodal(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, order: Order = "samples") -> NodalResult:
        """Return motion [m, rad, s] and forces [N], [N m] of every node, the wrenches of the joints, and the efforts.

        q, qd, qdd, order : as for `torques`, which is many times as fast and needs none of this memory, some 50 numbers for
            every node and sample: many samples are best given in parts.
        Raises InputError as `torques` does.
        """
        m = self.mechanism
        mesh = self.mesh
        q, qd, qdd = joint_arrays.make_contiguous_states(m, (q, qd, qdd), order)
        motion = compute_rigid_motion(mesh, q, qd, qdd)
        acting = compute_applied_forces(mesh, motion, np.zeros(len(q)))
        second = nodal_dynamics.compute_inverse_dynamics(mesh, motion, qd, qdd, acting, self.passive)
        torque = second.torque + compute_spring_efforts(m, q, history=False) if self.passive else second.torque
        reaction: dict[str, Array] = {}
        if self.loops is not None:
            shares = self.loops.compute_shares(q, qd, qdd, torque)
            pushed, reaction = compute_closure_wrenches(mesh, motion, build_constraint_rows(mesh), shares.multipliers)
            second = nodal_dynamics.compute_inverse_dynamics(mesh, motion, qd, qdd, pushed + acting, self.passive)
            torque = shares.tau
        wrench = {name: second.wrenches[node] for name, node in mesh.joint_node.items()}
        node = {joint.child: mesh.joint_node[joint.name] for joint in m.joints}
        return NodalResult(torque, motion, second.forces, wrench, reaction, node, dict(mesh.body_node))

    def sample(self, q: Array, qd: Array, qdd: Array, out: Array) -> Array:
        """Write the efforts of one sample into ``out`` (nv,) [N m] or [N] and return it: for a controller's cycle.

        q : (nq,) [rad], [m]; qd, qdd : (nv,), contiguous arrays of floats of this machine; nothing is allocated.  All else goes
            the way of `torques`, which converts what are numbers, and refuses what are none.
        Raises InputError as `torques` does.
        """
        b = self.bodies
        m = self.mechanism
        nq, nv = self._widths
        # Numba's look at the arguments takes bytes of any order for floats of this machine, and masked arrays for their data.
        if self.loaded or not (type(q) is type(qd) is type(qdd) is type(out) is ARRAY_TYPE):
            return self.torques(q, qd, qdd, out)
        if not (q.dtype is qd.dtype is qdd.dtype is out.dtype is FLOAT_TYPE):
            return self.torques(q, qd, qdd, out)
        try:
            if len(q) != nq or not len(qd) == len(qdd) == len(out) == nv:
                joint_arrays.convert_to_arrays(m, (q, qd, qdd), "samples")
                joint_arrays.make_output_array(out, np.asarray(qd))
            work, counter, told = self._own.of_sample
            compute_torque_blocks(
                b.tree, b.numbers, b.columns, self.plan.plan, self.plan.fixed, q, qd, qdd, out, _ONE_SAMPLE, _ONE,
                work, counter, _NOBODY,
            )  # fmt: skip
        except TypeError:  # not contiguous, or in two dimensions
            return self.torques(q, qd, qdd, out)
        if told[1]:
            if told[OVERLAP]:
                return self.torques(q.copy(), qd.copy(), qdd.copy(), out)
            joint_arrays.check_arrays(m, (q, qd, qdd), "samples")
        if m.springs or m.forces:
            self._add_applied((q[None], qd[None], qdd[None]), out[None])
        if self.loops is not None:
            self._split_loop_efforts(self.loops, counter, (q[None], qd[None], qdd[None], out[None]))
        return out

    def __hash__(self) -> int:
        """Return the hash of the mechanism and what is asked of it [-]."""
        return hash((self.mechanism, self.passive, self.threads))

    def __reduce__(self) -> tuple[Any, ...]:
        """Prepared anew where it is sent: to another process [-]."""
        return prepare, (self.mechanism, self.passive, self.threads)

    def _split_loop_efforts(self, loops: PrescribedLoops, counter: Unsigned, rows: Sequence[Array]) -> None:
        """Share out what the kernel has left, and look at a motion that it finds in doubt."""
        if not len(self.plan.sizes):
            rows[3][:] = loops.compute_shares(*rows).tau
            return
        if counter[3]:
            loops.check(*rows[:3])
        if counter[2]:
            blocks = CALL_CELLS + (len(rows[0]) + BLOCK - 1) // BLOCK
            loops.apply_shares(np.repeat(counter[CALL_CELLS:blocks] > 0, BLOCK)[: len(rows[0])], *rows)

    def _prepare_helpers(self, size: int) -> Unsigned:
        """Mails of those who help with a call of so many efforts."""
        if self.threads == 1 or size < WORTH_HELP or not COMPILED:
            return _NOBODY
        prepare_helper_kernels()
        return HELPERS.prepare_mailboxes(self.threads - 1, size > WORTH_WAKING)

    def _add_applied(self, motion: Sequence[Array], tau: Array) -> None:
        """Add what joints give against springs between points and given forces."""
        m = self.mechanism
        if not (m.springs or m.forces):
            return
        tau += compute_applied_efforts(self.mesh, *motion)


def prepare(mechanism: Mechanism, passive: bool = True, threads: int | None = None) -> TorqueFunction:
    """Return the efforts of a rigid mechanism [N m], [N] as a function that is ready to be called in a loop.

    passive : joint springs, damping and dry friction are part of what the actuator must give (``rnea`` leaves them out)
    threads : most that work on one call [-], by default one for every processor; small batches are not shared out

    A mechanism with closures takes the consistent motion of all its joints.  Every sample stands for itself: the spring of a
    continuous joint, whose cosine and sine count no turns, is wound by -pi .. pi; `solve` follows its angle over whole turns.
    Raises InputError for a flexible mechanism, closures that act for a while, a force that depends on time (use `solve`).
    """
    try:
        return _build_torque_function(mechanism, passive, threads)
    except (TypeError, AttributeError):  # what cannot be looked up is none of these
        _check_asked(mechanism, passive, threads)
        raise


def _check_asked(mechanism: Mechanism, passive: bool, threads: int | None) -> int:
    """The number of threads."""
    check_kind("mechanism", mechanism, Mechanism)
    check_flag("passive", passive)
    return count_processors() if threads is None else check_whole_number("threads", threads, 1, THREADS)


@make_owner_cache(typed=True, frozen=False)
def _build_torque_function(mechanism: Mechanism, passive: bool, threads: int | None) -> TorqueFunction:
    most = _check_asked(mechanism, passive, threads)
    joint_arrays.check_rigid(mechanism)
    check_constant(mechanism)
    mesh = build(mechanism)
    prepare_array_kernels()
    loops = PrescribedLoops(mesh) if mechanism.closures else None
    table, plan = make_read_only(_build_loop_plan(mesh, passive))
    thread_data = _ThreadData(most, max(table.size, plan.size))
    loaded = bool(plan.plan[layout.APPLIED])
    widths = mechanism.nq, mechanism.nv
    return TorqueFunction(mechanism, bool(passive), most, mesh, table, thread_data, plan, loops, loaded, widths)


def _build_loop_plan(mesh: Mesh, passive: bool) -> tuple[Bodies, LoopPlan]:
    """The bodies, and how the kernel shares efforts out."""
    m = mesh.mechanism
    plain = build_bodies(mesh, passive)
    if not m.closures:
        return plain, NO_LOOPS
    rows = build_constraint_rows(mesh)

    def run(bodies: Bodies, plan: LoopPlan) -> Array:
        q = sample_configurations(m, PLACES)
        rest = np.zeros((3, PLACES * m.nv))
        work = np.zeros((1, plan.size))
        strides = _make_stride_table(((m.nq, 1), *[(m.nv, 1)] * 3))
        counter = np.zeros(CALL_CELLS + 1, dtype=np.uint64)
        motion = (q.ravel(), *rest[:3], strides, np.uint64(PLACES))
        loops = (plan.plan, plan.fixed)
        compute_torque_blocks(bodies.tree, bodies.numbers, bodies.columns, *loops, *motion, work, counter, _NOBODY)
        return work.ravel()

    candidates = plain, build_bodies(mesh, passive, list_closure_ends(mesh, rows))
    return plan_loops(mesh, candidates, rows, (OPEN, OPEN_RATE, OPEN_ACCELERATION), run) or (plain, NO_LOOPS)


_CELLS, _MAILS, _NUMBERS, _TABLE = (types.Array(kind, n, "C") for kind in (types.uint64, types.float64) for n in (1, 2))
# Of a mechanism, which all its callers share: nobody writes there.
_READ_CELLS, _READ_TREE, _READ_NUMBERS, _READ_TABLE = (
    types.Array(kind, n, "C", readonly=True) for kind in (types.uint64, types.float64) for n in (1, 2)
)


def _prepare_kernel(kernel: Any, *signature: types.Type) -> None:
    """Compile a kernel for these arguments and no others; threads that come first at the same time wait for each other."""
    with _COMPILING:
        if COMPILED and not kernel.signatures:
            kernel.compile(signature)
            kernel.disable_compile()


@cache
def prepare_array_kernels() -> None:
    """Compile the kernel, once: arrays [any unit] are contiguous, and those that it only reads may be read-only."""
    system = _READ_TREE, _READ_TABLE, _READ_CELLS, _READ_CELLS, _READ_NUMBERS
    motion = _READ_NUMBERS, _READ_NUMBERS, _READ_NUMBERS, _NUMBERS, _MAILS, types.uint64
    _prepare_kernel(compute_torque_blocks, *system, *motion, _TABLE, _CELLS, _MAILS)


@cache
def prepare_helper_kernels() -> None:
    """Compile what helpers do, once [-]."""
    _prepare_kernel(run_helper, _CELLS, types.int64)
    _prepare_kernel(collect, _READ_CELLS, _READ_NUMBERS, types.uint64, _TABLE, _CELLS, _MAILS)


def _make_flat_view(a: Array) -> tuple[Array, tuple[int, int]]:
    """The numbers of (samples, columns) as they stand in memory, and the strides of a sample and of a column in them."""
    flags = a.flags
    if flags.f_contiguous and not flags.c_contiguous:
        return a.ravel("F"), (1, len(a))
    return a.ravel(), (a.shape[1], 1)


@lru_cache(maxsize=256)
def _make_stride_table(strides: tuple[tuple[int, int], ...]) -> Unsigned:
    return np.array(strides, dtype=np.uint64)
