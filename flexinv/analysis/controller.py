"""Controller: torques while the motion comes in, one instant a call, for the cycle of a controller.

A rigid mechanism has no memory: every call is `TorqueFunction.sample`.  A flexible one carries its deformation on: every call is
one step of the march and then tau = L T P, so that the calls are `solve` cut into steps.  The torque that a call returns belongs
to the instant whose motion it was given; the march needs no later ones.  A controller that must have a torque before its instant
looks ahead: it gives the motion of an instant to come, as far ahead as its cycle asks, and keeps the torque until then.

Of a joint with an elastic drive whose link is moved the torque is that of its spring; what the motor does follows from its
derivatives (`motor_side.motor_side`), which no cycle has.  A drive whose motor is moved is a driven joint and a passive one,
which is carried on like the deformation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.initial_motion import begin_motion
from flexinv.constraints.closures import build_constraint_rows
from flexinv.constraints.continuation import solve_closed_start
from flexinv.dynamics.generalized_alpha import EARLY, SUBSTEPS, Scheme, build_generalized_alpha, build_start_scheme
from flexinv.dynamics.initial_state import begin_step, compute_joint_motion, end_early
from flexinv.dynamics.loaded_torques import build_instant_loads, evaluate_loaded_torques
from flexinv.dynamics.loads import build_load_table
from flexinv.dynamics.solver import Solver, make_solve_error
from flexinv.dynamics.stepper import CONVERGED, SUDDEN_START, integrate_instants
from flexinv.dynamics.system import Instants, System
from flexinv.errors import ConvergenceError, InputError
from flexinv.inverse.balance import (
    Instant,
    compute_carried_energy,
    compute_energy_rounding,
    evaluate_guarded_torques,
    find_excessive_energies,
)
from flexinv.inverse.inverse_dynamics import check_constant
from flexinv.inverse.nodal_sums import Drives, Masses
from flexinv.kernels.compiler.choice import NUMBA
from flexinv.kinematics.configuration import build_nodes, fill_given, fill_relative
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import sample_between_instants
from flexinv.kinematics.tree import Frames, Joints
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.planar.solver import PlanarMarch
from flexinv.planar.stepper import PlanarSystem, integrate_planar_motion
from flexinv.rigid.prepare import TorqueFunction, prepare
from flexinv.typing import Array
from flexinv.validation import (
    ARRAY_TYPE,
    FLOAT_TYPE,
    check_choice,
    check_kind,
    check_number,
    check_seconds,
    convert_to_floats,
)


class WorkSpaceSnapshot(NamedTuple):
    """A work space as steps have left it: its numbers [m, rad, s, N], and the rest as of `FlexibleState`."""

    numbers: list[Array]
    early_steps: int
    previous: list[Array]


def list_writable_arrays(part: Any) -> Iterator[Array]:
    """Yield the arrays [any unit] of records that can be written to, in the order of their fields."""
    if isinstance(part, np.ndarray):
        if part.flags.writeable:
            yield part
    elif isinstance(part, tuple):
        for one in part:
            yield from list_writable_arrays(one)
    elif is_dataclass(part):
        for field in fields(part):
            yield from list_writable_arrays(getattr(part, field.name))


def _build_drives(mesh: Mesh) -> Drives:
    """The laws of the joints at the nodes, with the freedoms of those that have a drive."""
    freedoms = mesh.freedoms.copy()
    moves = mesh.v_index >= 0
    freedoms[moves] *= mesh.mechanism.actuated[mesh.v_index[moves]]
    return Drives(freedoms, mesh.slide, mesh.turn, mesh.build_drive_table())


class FlexibleState:
    """State and work space of the time steps of a flexible mechanism, allocated once.

    march, arguments : the compiled march, and what follows the scheme
    loads : what acts beside the joints, None where nothing does; torques : compiled `evaluate_loaded_torques`, without loads
        `evaluate_guarded_torques`, and parts, loading : its arguments before and behind the motion
    tau : (nv,) the efforts of the last step [N m], [N]; early_steps : that are still to be made in parts after a sudden start [-]
    last : the efforts of the call before (nv,) [N m], [N]; previous : the motion at the last call
    """

    def __init__(self, mechanism: Mechanism, scheme: Scheme, tau: Array) -> None:
        """Allocate the arrays of a mechanism, its kernels compiled; efforts are written into ``tau`` (nv,) [N m], [N]."""
        mesh = build(apply_stated_ratio(mechanism))
        still = np.zeros(mechanism.nv)
        driven = mechanism.actuated.astype(float)
        self.mechanism = mechanism
        self.nq = mechanism.nq
        self.nv = mechanism.nv
        self.tau = tau
        self.passive = mechanism.undriven_names
        self.solver = Solver.build_for(mesh, self.passive)
        in_space = isinstance(find_plane(mesh), NotPlanar)
        self.flat = None if in_space else PlanarMarch.build_for(mesh, self.passive)
        self.joints = Joints(*(part.copy() for part in compute_joint_motion(mesh, mechanism.neutral, still, still)))
        self.frames = Frames(*(part[0] for part in self.solver.instant[:6]))
        self.instant = Instant(self.solver.instant.energy[0], driven, np.zeros((mesh.size, 6)), np.zeros(7))
        self.nodes = build_nodes(mesh)
        self.scheme = scheme
        self.early = build_start_scheme(scheme)
        self._prepare_march()
        self._prepare_torques(mesh)
        self.early_steps = 0
        self.previous = list[Array]()
        self.last = tau.copy()

    def _prepare_march(self) -> None:
        """Take the march in the plane, or that in space, and what it is called with."""
        self.system: System | PlanarSystem
        self.arguments: tuple[Any, ...]
        march_in: Any
        if self.flat is None:
            march_in = integrate_instants
            self.system = self.solver.system
            self.arguments = self._make_spatial_arguments()
        else:
            march_in = integrate_planar_motion
            self.system = self.flat.system
            self.prescribed = self.flat.model.tree.prescribed_column >= 0
            self.given = np.zeros((1, int(self.prescribed.sum()), 3))
            row = np.zeros(1, dtype=np.int64)
            self.arguments = np.zeros((0, 3)), False, self.given, row, self.solver.instant
        self.march = NUMBA.resolve_compiled(march_in, self.system, self.scheme, *self.arguments)

    def _prepare_torques(self, mesh: Mesh) -> None:
        """Take the kernel of the second step, with what acts beside the joints, and what it is called with."""
        m = self.mechanism
        driven = self.instant.driven
        masses = Masses(mesh.mass, mesh.inertia, self.solver.topology.gravity)
        self.parts = (self.nodes, _build_drives(mesh), masses, self.frames)
        now = (self.mechanism.neutral.copy(), driven, driven)
        winds = any(KINDS[j.kind].circle and j.stiffness and j.actuated for j in m.joints)
        acts = m.springs or m.forces or m.closures or winds
        self.loads = build_instant_loads(mesh, self.solver.instant.multipliers[0]) if acts else None
        self.loading = (self.instant,) if self.loads is None else (self.instant, self.loads)
        kernel = evaluate_guarded_torques if self.loads is None else evaluate_loaded_torques
        self.torques = NUMBA.resolve_compiled(kernel, *self.parts, now, *self.loading, driven)

    def _make_spatial_arguments(self) -> tuple[Any, ...]:
        """The arguments of the march in space behind its scheme: one instant without loads, and where it is written."""
        one = Joints(*(part[None] for part in self.joints))
        loads = build_load_table(self.solver.mesh, np.zeros(1)), np.empty((1, 0)), np.empty((1, 0, 3))
        return Instants(one, *loads), self.solver.increment, self.solver.instant

    def copy_state(self) -> WorkSpaceSnapshot:
        """Return a copy of all that a step changes [m, rad, s, N]."""
        numbers = [part.copy() for part in self._list_step_arrays()]
        return WorkSpaceSnapshot(numbers, self.early_steps, [part.copy() for part in self.previous])

    def replace_state(self, snapshot: WorkSpaceSnapshot) -> None:
        """Go on where another work space of the same mechanism was taken [m, rad, s, N]."""
        for array, part in zip(self._list_step_arrays(), snapshot.numbers, strict=True):
            array[...] = part
        self.early_steps = snapshot.early_steps
        self.previous = [part.copy() for part in snapshot.previous]

    def _list_step_arrays(self) -> Iterator[Array]:
        """The arrays that a step writes, always in one order, some of them parts of others."""
        flat = () if self.flat is None else (self.flat.system, self.given)
        yield from list_writable_arrays(
            (self.solver.system, self.solver.increment, self.solver.instant, self.joints, self.frames)
        )
        yield from list_writable_arrays((self.loading, flat, self.arguments, self.tau))

    def begin_motion(self, now: list[Array], initial: str) -> Array:
        """Begin at a motion q (nq,), qd, qdd (nv,) [m, rad, s] and return its torques (nv,) [N m], [N]."""
        if self.mechanism.closures:
            now = self._close_loops(now)
        if self.flat is not None and initial == "consistent":
            sudden = self._begin_in_plane(self.flat, now)
            self._begin_account(now)
        else:
            joints = begin_motion(self.solver, now, 0.0, initial, "at the start")
            self._begin_account(now)
            sudden = begin_step(self.solver, joints, self.scheme, "at the start")
            if self.flat is not None:
                self.flat.copy_from_space(self.solver.state, self.solver.border.ties)
        self.early_steps = EARLY * sudden
        self.previous = now
        return self.tau

    def _close_loops(self, now: list[Array]) -> list[Array]:
        """The motion with joints without drives where the undeformed loops close; what is given of them is a guess."""
        mesh = self.solver.mesh
        unknown = ~self.mechanism.actuated
        closed = solve_closed_start(mesh, (now[0], now[1], now[2]), 0.0, unknown, build_constraint_rows(mesh))
        self.solver.border.ties.multiplier[:] = 0.0
        return [np.array(part) for part in closed]

    def _begin_in_plane(self, flat: PlanarMarch, now: list[Array]) -> bool:
        """Begin undeformed in the plane, where kernels of space are not needed; return whether that is sudden."""
        q, qd, qdd = (part[None] for part in now)
        none = q[:0], qd[:0], qdd[:0]
        flat.system.ties.multiplier[:] = 0.0
        flat.system.masses.over[:] = flat.model.masses.over
        row = np.zeros(1, dtype=np.int64)
        arguments = flat.prepare_arguments(self.scheme, (q, qd, qdd), none, row, self.solver.instant)
        status, _, count, size = integrate_planar_motion(*arguments)
        if status not in (CONVERGED, SUDDEN_START):
            raise make_solve_error(self.solver.mesh, self.passive, (status, count, size), "at the start")
        return bool(status == SUDDEN_START)

    def _begin_account(self, now: list[Array]) -> None:
        """Set the torques of the start, and the account of energy [J] that steps are held against."""
        if self.loads is not None:
            self.loads.wound[:] = 0.0
        account = self.instant.account
        account[:] = 0.0
        _, holds, potential = self.torques(*self.parts, (now[0], now[1], now[2]), *self.loading, self.tau)
        nothing = compute_energy_rounding(
            self.solver.mesh
        )  # of an arm that rests undeformed: no step is in doubt for less
        account[:] = holds + nothing, potential, account[2], 0.0, 0.0, 0.0, self.scheme.h

    def integrate_step(self, scheme: Scheme, q: Array, qd: Array, qdd: Array) -> None:
        """Make one step, or a part of it, to the motion q (nq,), qd, qdd (nv,) of the joints [m, rad, s]."""
        if self.flat is not None:
            fill_given(self.nodes, q, qd, qdd, self.prescribed, self.given[0])
        else:
            fill_relative(self.nodes, q, qd, qdd, self.joints)
        status, _, count, size = self.march(self.system, scheme, *self.arguments)
        if status != CONVERGED:
            turned = (self.flat or self.solver).compute_section_turn(count)
            when = "in a step of the controller"
            raise make_solve_error(self.solver.mesh, self.passive, (status, count, size), when, self.scheme.h, turned)

    def integrate_in_parts(self, q: Array, qd: Array, qdd: Array) -> None:
        """Make a step soon after a sudden start, between two calls as values, rates and accelerations have it [m, rad, s]."""
        now = [q.copy(), qd.copy(), qdd.copy()]
        m = self.mechanism
        for joint in m.joints:
            if not joint.actuated:  # what is given of it is not looked at
                columns = m.q_slices[joint.name]
                rates = m.v_slices[joint.name]
                now[0][columns] = self.previous[0][columns]
                now[1][rates] = 0.0
                now[2][rates] = 0.0
        for part in sample_between_instants(m, self.previous, now, self.scheme.h, SUBSTEPS):
            self.integrate_step(self.early, *part)
        self.early_steps = self.early_steps - 1
        self.previous = now
        if self.early_steps == 0:
            end_early((self.flat or self.solver).system.state)

    def compute_checked_torques(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the torques (nv,) [N m], [N] of a step; raises ConvergenceError where its energy [J] comes from nowhere."""
        doubtful, holds, potential = self.torques(*self.parts, (q, qd, qdd), *self.loading, self.tau)
        if doubtful:
            self._judge(holds, potential, qd)
        return self.tau

    def _judge(self, holds: float, potential: float, qd: Array) -> None:
        """Raise ConvergenceError where more energy [J] is there than drives and loads have put in."""
        mesh = self.solver.mesh
        step = self.scheme.h
        held, at_start, _, work, worked, steps, _ = self.instant.account.tolist()
        from_nowhere = holds + potential - held - at_start - work
        most = (
            held + worked + abs(potential - at_start) + float(compute_carried_energy(mesh, qd[None], self.passive)[0])
        )
        if find_excessive_energies(mesh, from_nowhere, most):
            raise ConvergenceError(
                f"controller: mechanism '{mesh.mechanism.name}', at call {steps:.0f} after start (step {step:g} s): "
                f"kinetic and elastic energy are {holds:.3g} J, of which at most {most:.3g} J were put in, so that the march has "
                f"left the motion; write step = {step / 4:.3g}, or check forces, moments and stiffness.  The torques stay those "
                "of the call before; controller.start(q, qd, qdd) begins again"
            )


@dataclass(eq=False)
class Controller:
    """Torques of a mechanism call by call; with beams, joints without drives move as the dynamics have it.

    Only the instants of its calls are looked at: limits of joints, singular positions and dead points that the motion passes
    between two calls are not seen.  `flexinv.solve` and `flexinv.find_limits` of the same motion see them.

    A copy (`copy.copy`, `copy.deepcopy`) and a pickle go on from the instant at which they were made, each for itself.

    controller = Controller.of(arm, step=1e-3)      # step: the time between two calls [s]
    controller.start(q, qd, qdd)                    # once: where the motion begins, undeformed or in equilibrium
    tau = controller.step(q, qd, qdd)               # every cycle; (nv,) [N m], [N], the same array every time
    """

    mechanism: Mechanism
    tau: Array
    rigid: TorqueFunction | None
    flexible: FlexibleState | None
    begun: bool = False
    spectral_radius: float = 0.8

    @classmethod
    def of(cls, mechanism: Mechanism, step: float | None = None, spectral_radius: float = 0.8) -> Controller:
        """Return the controller of a mechanism, rigid (as `prepare`) or with beams, its kernels compiled.

        step : time between two calls [s], of a mechanism with beams; spectral_radius : as in `solve` [-]
        With springs between points or given forces beams are marched in space.
        Raises InputError: forces that depend on time, no step for beams, beams with closures that act for a while or couple
            joints.
        """
        check_kind("mechanism", mechanism, Mechanism)
        if step is not None:
            step = check_seconds("step", step, "the time between two calls in seconds, for example step=1e-3")
        radius = check_number(
            "spectral_radius", spectral_radius, "0 (strong) to 1 (no numerical damping), for example 0.8"
        )
        scheme = build_generalized_alpha(1.0 if step is None else step, radius)
        if mechanism.is_rigid:
            return cls(mechanism, np.zeros(mechanism.nv), prepare(mechanism, threads=1), None)
        check_constant(mechanism)
        _check_closures(mechanism)
        if step is None:
            why = (
                "whose deformation is carried on from call to call; write step = the time between two calls in seconds"
            )
            raise InputError(f"controller: mechanism '{mechanism.name}' has beams, {why}, for example step=1e-3")
        tau = np.zeros(mechanism.nv)
        flexible = FlexibleState(mechanism, scheme, tau)
        out = cls(mechanism, tau, None, flexible, spectral_radius=radius)
        if not mechanism.closures:  # which need not close at zero coordinates
            out._prepare_steps(flexible)
        return out

    def _prepare_steps(self, flexible: FlexibleState) -> None:
        """Begin and make one step at zero coordinates, so that kernels are compiled, and joints that nothing holds are found.

        The energy of that step is not judged: loads may be too sudden there.
        """
        still = self.mechanism.neutral, np.zeros(self.mechanism.nv), np.zeros(self.mechanism.nv)
        self.start(*still)
        flexible.integrate_step(flexible.scheme, *still)
        self.begun = False

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy and a pickle are made anew, as kernels write into parts of shared arrays, and go on where this one stands."""
        f = self.flexible
        step, taken = (None, None) if f is None else (f.scheme.h, f.copy_state())
        return _build_resumed_controller, (
            self.mechanism,
            step,
            self.spectral_radius,
            self.begun,
            self.tau.copy(),
            taken,
        )

    def start(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, initial: str = "consistent") -> Array:
        """Begin at a motion and return its torques (nv,) [N m], [N]; beams begin undeformed or ("static") in equilibrium.

        Joints without drives begin (with beams) where q and qd say, where the undeformed loops close next to that, or where the
        equilibrium has them.
        Raises InputError for wrong shapes or ``initial``, ConvergenceError where no equilibrium is found.
        """
        now = self._copy_checked_arrays(q, qd, qdd)
        check_choice("initial", initial, {"consistent": "undeformed", "static": "in equilibrium"})
        self.begun = True
        return self.step(*now) if self.flexible is None else self.flexible.begin_motion(now, initial)

    def step(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the torques (nv,) [N m], [N] of the next instant, always in the same array; nothing else is allocated.

        q : (nq,) [rad], [m]; qd, qdd : (nv,), contiguous arrays of floats; those of joints without drives are not looked at where
            there are beams, and their efforts are zero.
        Raises ConvergenceError where a step of the march fails, InputError for what is not finite or was not started.  The array
        then keeps the torques of the call before.  A step that found no solution leaves the state as it was, and the next call
        may go on; one whose energy comes from nowhere is over: `start` begins again.
        """
        if self.rigid is not None:
            return self.rigid.sample(q, qd, qdd, self.tau)
        f = self.flexible
        if f is None or not self.begun:
            write = "write controller.start(q, qd, qdd) once, where the motion begins, before step"
            raise InputError(f"controller: {write}")
        plain = f.early_steps == 0 and _is_plain(q, f.nq) and _is_plain(qd, f.nv) and _is_plain(qdd, f.nv)
        if not plain or not isfinite(
            q.dot(q) + qd.dot(qd) + qdd.dot(qdd)
        ):  # a number that is none spoils every step after it
            q, qd, qdd = self._copy_checked_arrays(q, qd, qdd)
        f.last[:] = self.tau
        if f.early_steps > 0:
            f.integrate_in_parts(q, qd, qdd)
        else:
            f.integrate_step(f.scheme, q, qd, qdd)
        try:
            return f.compute_checked_torques(q, qd, qdd)
        except ConvergenceError:  # the step is made, and those after it would go on from there
            self.tau[:] = f.last
            self.begun = False
            raise

    def _copy_checked_arrays(self, *given: ArrayLike) -> list[Array]:
        """Copies of q, qd, qdd as floats."""
        m = self.mechanism
        names = [f"controller: {name}" for name in ("q", "qd", "qdd")]
        now = []
        for name, part, size in zip(names, given, (m.nq, m.nv, m.nv), strict=True):
            numbers = np.array(convert_to_floats(name, part))
            if numbers.shape != (size,):
                raise InputError(f"{name} has shape {numbers.shape}, expected ({size},) numbers [rad], [m]")
            if not np.isfinite(numbers).all():
                raise InputError(f"{name} = {numbers.tolist()}: expected finite numbers [rad], [m]")
            now.append(numbers)
        return now


def _build_resumed_controller(
    mechanism: Mechanism, step: float | None, radius: float, begun: bool, tau: Array, snapshot: WorkSpaceSnapshot | None
) -> Controller:
    """A controller that goes on where another was taken."""
    resumed_controller = Controller.of(mechanism, step, radius)
    resumed_controller.begun = begun
    resumed_controller.tau[:] = tau
    if resumed_controller.flexible is not None and snapshot is not None:
        resumed_controller.flexible.replace_state(snapshot)
    return resumed_controller


def _check_closures(mechanism: Mechanism) -> None:
    """Raise InputError for closures that single steps of beams know nothing of."""
    passing = [c.name for c in mechanism.closures if c.active]
    coupling = [c.name for c in mechanism.closures if c.kind == "coupling"]
    for names, what in ((passing, "that acts for a while"), (coupling, "that couples joints")):
        if names:
            write = "which single steps do not know; write flexinv.solve(mechanism, motion, step=...) instead"
            raise InputError(
                f"controller: mechanism '{mechanism.name}' has beams and a closure {what} ({names[0]!r}), {write}"
            )


def _is_plain(a: Array, size: int) -> bool:
    return type(a) is ARRAY_TYPE and a.dtype is FLOAT_TYPE and a.shape == (size,) and a.flags.c_contiguous
