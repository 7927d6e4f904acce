"""differentiate: derivatives of the torques of a mechanism with beams, and of its tips, by numbers of motion and mechanism.

The march is differentiated itself (`tangent_kernel`): along the trajectory of `solve` one linear system a step gives the tangents
by all parameters.  What a parameter of the mechanism does to the forces at a given motion, dr/dp, is a difference of sixth
order, as is what one of the motion does to joints; rows of samples and of moves are sums, whose parts are evaluated themselves.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexinv.analysis.loops import make_closed_task
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.analysis.task import Start, build_joint_histories, check_settings, make_prescribed_task
from flexinv.constraints.loop_starts import build_joint_mask
from flexinv.dynamics.generalized_alpha import EARLY, EXACT, SUBSTEPS, Scheme, build_start_scheme, list_early_times
from flexinv.errors import ConvergenceError, InputError
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion, resolve_start_coordinates
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.sensitivity.closed_states import (
    add_spring_forces,
    build_closed_states,
    check_efforts,
    find_shown_multipliers,
)
from flexinv.sensitivity.given_slopes import GivenSlopes
from flexinv.sensitivity.march_start import (
    MarchStart,
    begin_march,
    close_start,
    collect_accelerations,
    integrate_parts,
)
from flexinv.sensitivity.march_states import (
    FreeSystem,
    build_free_system,
    build_march_states,
    build_massive_solver,
    build_turns,
    build_varied_system,
    compute_end_slopes,
    list_tip_nodes,
    make_histories,
    make_no_record,
    make_tangent_scratch,
    sample_forces,
    take_plane_freedoms,
)
from flexinv.sensitivity.nearby_results import NearbyResults, check_results
from flexinv.sensitivity.parameters import (
    Parameter,
    VariedSetup,
    build_variation,
    resolve_parameters,
)
from flexinv.sensitivity.rigid_loops import RigidLoops
from flexinv.sensitivity.sensitivities import Sensitivities
from flexinv.sensitivity.start_slopes import StartSlopes, find_start_basis
from flexinv.sensitivity.tangent_kernel import integrate_tangents
from flexinv.sensitivity.tangent_records import (
    ForceRecord,
    MarchStates,
    ParameterInputs,
    StepTangents,
    TangentHistories,
    TangentTask,
)
from flexinv.typing import Array, Mask, Triple
from flexinv.validation import check_kind


def differentiate(
    mechanism: Mechanism, motion: Motion, by: str | Parameter | Iterable[str | Parameter], step: float,
    end: float | None = None, spectral_radius: float = 0.8, initial: str = "consistent",
    start: Start = None, start_rate: Start = None, of: Collection[str] = (), order: int = 6,
) -> Sensitivities:  # fmt: skip
    """Return the derivatives of torques, tips and joint coordinates of `solve` by parameters of motion and mechanism.

    by : names of numbers, as "motion.elbow[1]", "motion.duration", "links.forearm.beam.length", "joints.elbow.damping",
        "gravity[2]" (`sensitivity.parameters`), or `Parameter` with a function of its own
    step, end, spectral_radius, initial, start, start_rate : as `solve` takes them; the steps stay where they are
    of : what is differentiated beside torques, tips and coordinates: "wrench", "internal", "root", "strain", "deflection" and
        "reaction", as a Solution has them, and "energy"; order : of the differences that give it, 6, or 2 in a third of the time,
        of which 1e-7 is left out
    The tangents are those of the march itself: the same as differences of `solve` with a vanishing change.
    Raises InputError as `solve`, for parameters that are none, closures that act for a while, meshed links, joints without one
    number for each coordinate, and accelerations that jump after the start; ConvergenceError as `solve`.
    """
    settings = {
        "step": step, "end": end, "spectral_radius": spectral_radius, "initial": initial, "start": start,
        "start_rate": start_rate,
    }  # fmt: skip
    return prepare_differentiation(mechanism, motion, by, settings, check_results(of, order), order).run_march()


def prepare_differentiation(
    mechanism: Mechanism, motion: Motion, by: str | Parameter | Iterable[str | Parameter], settings: Mapping[str, Any],
    of: Sequence[str] = (), order: int = 6,
) -> MarchDifferentiation:  # fmt: skip
    """Return the solution with all that its derivatives start from [any unit].

    settings : step and the like of `solve`; of, order : further results, and the order of their differences
    Raises InputError and ConvergenceError as `differentiate`.
    """
    check_kind("mechanism", mechanism, Mechanism)
    check_kind("motion", motion, Motion)
    parameters = resolve_parameters(by, mechanism, motion)
    _check_mechanism(mechanism)
    solution = solve(mechanism, motion, **settings)
    _check_jumps(motion, solution.time)
    started = settings["start"], settings["start_rate"]
    return MarchDifferentiation(mechanism, solution, motion, parameters, started, (of, order))


def _check_mechanism(mechanism: Mechanism) -> None:
    """Raise InputError for what has no tangents yet."""
    for closure in mechanism.closures:
        if closure.active or closure.capture:
            raise InputError(
                f"differentiate: closure '{closure.name}' of '{mechanism.name}' acts for a while; derivatives are given of "
                "closures that act all the time: take differences of flexinv.solve"
            )
    if mechanism.meshed:
        names = ", ".join(link.name for link in mechanism.meshed)
        raise InputError(
            f"differentiate: mechanism '{mechanism.name}' has links that are meshes ({names}); derivatives are given of rigid "
            "links and beams: take differences of flexinv.solve"
        )
    for joint in mechanism.joints:
        if joint.nv and not KINDS[joint.kind].scalar:
            raise InputError(
                f"differentiate: joint '{joint.name}' of '{mechanism.name}' is {joint.kind}; derivatives are given of joints "
                "with one number for each coordinate: take differences of flexinv.solve"
            )


def _check_jumps(motion: Motion, time: Array) -> None:
    """Raise InputError where accelerations jump after the start."""
    inside = [jump for jump in motion.jumps if time[0] < jump <= time[-1]]
    if inside:
        raise InputError(
            f"differentiate: accelerations jump at {inside[0]:g} s; write a law without jumps (cycloid, quintic, septic, nonic), "
            "or samples with rest=True"
        )


@dataclass(frozen=True)
class Leg:
    """Part of a march with equal steps: motion of nodes and joints at times [s], scheme, and the first pseudo accelerations.

    first : sample of the solution in which it begins; every : so many of its steps are one of the solution
    """

    nodes: NodalMotion
    joints: Triple
    time: Array
    scheme: Scheme
    pseudo: Array
    first: int = 0
    every: int = 1


class MarchDifferentiation:
    """Derivatives along one solution.

    prescribed : joints with a motion; given : (nv,) of which coordinates; system : the mechanism with all joints as unknowns
    """

    def __init__(
        self, mechanism: Mechanism, solution: Solution, motion: Motion, parameters: tuple[Parameter, ...],
        started: tuple[Start, Start], of: tuple[Sequence[str], int],
    ) -> None:  # fmt: skip
        """Prepare what all legs of the march share."""
        self.mechanism = mechanism
        self.solution = solution
        self.motion = motion
        self.parameters = parameters
        self.started = started
        self.of, self.order = of
        prescribed = motion.joints(mechanism)
        self.passive = set(mechanism.moving_names) - set(prescribed)
        self.prescribed = prescribed
        self.given = build_joint_mask(mechanism, prescribed)
        self.system = build_free_system(mechanism, prescribed)
        self.freedoms = self.system.make_freedoms(self.passive)
        self.variations = tuple(build_variation(parameter, mechanism, motion) for parameter in parameters)
        self.given_slopes = GivenSlopes(
            (mechanism, motion), parameters, self.variations, self.given, self._evaluate_motion
        )
        self.multiplier: Array | None = None  # of closures along the whole solution, where it is known
        self.starts_in_balance = False  # known of loops: else the first efforts are differences of starts
        self.changing = [k for k, one in enumerate(self.variations) if one.changes_mechanism]
        self.beside = {
            k: [build_varied_system(self.system, one, prescribed) for one, _ in self.variations[k].setups]
            for k in self.changing
        }
        set_up = solution.settings
        self.settings = check_settings(
            float(set_up["step"]), float(set_up["spectral_radius"]), EXACT, str(set_up["initial"])
        )

    def run_march(self) -> Sensitivities:
        """Return the derivatives along the whole march, or of rigid loops at every sample."""
        solution = self.solution
        time = solution.time
        out = self._make_histories(len(time))
        if self.mechanism.is_rigid and self.mechanism.closures:
            return self._assemble(out, *self._fill_rigid_loops(out))
        base = self.begin((self.mechanism, self.motion))
        tangents, first = self.make_start_tangents(base)
        legs = self.list_legs(base)
        for leg, task in legs:
            given = self.given_slopes.compute(leg.time)
            task = task._replace(inputs=task.inputs._replace(given=given))
            if leg.first:
                tangents.pseudo[:] = tangents.acceleration
            part = self._make_histories(len(leg.time))
            self._integrate_tangents(self.system, task, leg.scheme, tangents, part)
            for history, values in zip(out, part, strict=True):
                history[leg.first : leg.first + len(values[:: leg.every])] = values[:: leg.every]
        last = legs[-1][1].states
        end = compute_end_slopes(self.system, last, tangents, (solution.q[-1], solution.qd[-1], solution.qdd[-1]))
        effort = self.compute_friction(self.solution.qd[:, self.given], self.given) + out.effort
        if not self.starts_in_balance:
            effort[0] = first
        return self._assemble(out, self._fill_efforts(effort), end)

    def _fill_rigid_loops(self, out: TangentHistories) -> tuple[Array, NodalMotion]:
        """Fill tips and coordinates of rigid links in loops; return the efforts of all joints and the slopes of the end."""
        solution = self.solution
        names = (parameter.name for parameter in self.parameters)
        loops = RigidLoops(self.mechanism, solution, list(zip(names, self.variations, strict=True)), self.given)
        found = loops.solve_motion(self.given_slopes.compute(solution.time))
        inputs = loops.compute_inputs(found, self.compute_friction(solution.qd, np.ones_like(self.given)))
        system = loops.system
        whole = self._make_histories(len(solution.time), system.size)
        tangents = StepTangents(*np.zeros((5, system.size, len(self.parameters))))
        freedoms = system.make_freedoms(())
        task = TangentTask(
            loops.states,
            loops.states,
            build_turns(system, loops.states),
            inputs,
            freedoms,
            list_tip_nodes(system),
            False,
        )
        self._integrate_tangents(system, task, self.settings.scheme, tangents, whole)
        efforts, multiplier = loops.split_efforts(whole.effort, found)
        whole.multiplier[:] = multiplier[: len(whole.multiplier)]
        for history, part in zip(out[1:], whole[1:], strict=True):
            history[:] = part
        for part, last in zip(tangents, found[:, -1], strict=False):
            part[system.unknown] = last
        tangents.shown[:] = tangents.acceleration
        joints = solution.q[-1], solution.qd[-1], solution.qdd[-1]
        end = compute_end_slopes(system, loops.states, tangents, joints)
        self.multiplier = loops.states.multiplier
        return efforts, end

    def _make_histories(self, samples: int, joints: int | None = None) -> TangentHistories:
        """Room for the derivatives at so many samples, of the efforts of so many joints."""
        joints = len(self.freedoms.prescribed) if joints is None else joints
        return make_histories(self.system, samples, joints, len(self.parameters), rates=bool(self.of))

    def list_legs(self, base: MarchStart) -> list[tuple[Leg, TangentTask]]:
        """Return the parts of the march [m, rad, s], in their order: the first steps where these are made in parts, and the rest.

        The derivatives of joints with a motion are left out of their inputs.
        base : the start of the march, whose solver makes the first steps
        """
        solution = self.solution
        early = min(EARLY, len(solution.time) - 1) if base.sudden else 0
        pseudo = collect_accelerations(base, self.system)
        legs = []
        if early:
            first = self._make_early_leg(base, early)
            task = self._make_task(first)
            pseudo = np.asarray(task.states.du[-1])
            legs.append((first, task))
        joints = solution.q[early:], solution.qd[early:], solution.qdd[early:]
        nodes = solution.nodes.take_samples(slice(early, None))
        late = Leg(nodes, joints, solution.time[early:], self.settings.scheme, pseudo, early)
        return [*legs, (late, self._make_task(late))]

    def _make_early_leg(self, base: MarchStart, count: int) -> Leg:
        """The first steps, which are made in parts."""
        time = self.solution.time
        times = np.concatenate([time[:1], list_early_times(time[: count + 1])])
        joints = self._evaluate_motion((self.mechanism, self.motion), times)
        pseudo = collect_accelerations(base, self.system)
        nodes, joints = integrate_parts(base, joints, times, self.settings)
        return Leg(nodes, joints, times, build_start_scheme(self.settings.scheme), pseudo, 0, SUBSTEPS)

    def _make_task(self, leg: Leg) -> TangentTask:
        """A leg as a task of the tangents."""
        system = self.system
        shown = build_march_states(system, leg.nodes, leg.joints, leg.time)
        states = shown = add_spring_forces(system, shown)
        if self.mechanism.closures:
            closed = build_closed_states(system, shown, self.freedoms, leg.pseudo, leg.scheme)
            self.starts_in_balance = closed.massive
            states = closed.march
            shown = closed.shown
            self._check_efforts(closed.efforts, leg.time)
        inputs = self._compute_inputs(leg, states, shown)
        turns = build_turns(system, states)
        flat = not isinstance(find_plane(self.solution.mesh), NotPlanar)
        freedoms = take_plane_freedoms(
            system, self.freedoms, (one.mesh for part in self.beside.values() for one in part)
        )
        return TangentTask(states, shown, turns, inputs, freedoms, list_tip_nodes(system), flat)

    def _integrate_tangents(
        self, system: FreeSystem, task: TangentTask, scheme: Scheme, tangents: StepTangents, out: TangentHistories
    ) -> None:
        """March the tangents of a task.  Raises ConvergenceError."""
        scratch = make_tangent_scratch(system, len(task.freedoms.marched), len(self.parameters))
        solver = system.solver
        massive = build_massive_solver(solver)
        bad = integrate_tangents(
            solver.system, massive.system, task, scheme, tangents, scratch, out, make_no_record(system)
        )
        if bad >= 0:
            raise ConvergenceError(
                f"mechanism '{self.mechanism.name}', at sample {bad}: an element turns too much to be linearised; use more "
                "elements"
            )

    def _check_efforts(self, efforts: Array, time: Array) -> None:
        """Raise InputError where efforts from the multipliers are not those of the solution."""
        solution = self.solution
        rows = np.flatnonzero(np.isin(solution.time, time))
        friction = np.sign(solution.qd) * self.mechanism.drive_table[2]
        wanted = (solution.torque_all - friction)[rows][:, self.given]
        check_efforts(self.mechanism.name, efforts[np.isin(time, solution.time)], wanted)

    def _compute_inputs(self, leg: Leg, states: MarchStates, shown: MarchStates) -> ParameterInputs:
        """Compute what the parameters do from outside along given states: to joints with a motion, forces, tips and closures."""
        count = len(self.changing)
        tips = len(list_tip_nodes(self.system).node)
        pushed = np.zeros((2, len(leg.time), self.system.size, count))
        opened = np.zeros((2, len(leg.time), self.system.rows, count))
        shifted = np.zeros((len(leg.time), tips, 3, count))
        for column, k in enumerate(self.changing):
            variation = self.variations[k]
            found = [_sample_varied(varied, leg, (states, shown)) for varied in self.beside[k]]
            for which in (0, 1):
                pushed[which, :, :, column] = variation.join_results(one[which].residual for one in found)
                opened[which, :, :, column] = variation.join_results(one[which].closing[2 * which] for one in found)
            shifted[..., column] = variation.join_results(one[0].tip for one in found)
        changing = np.array(self.changing, dtype=np.int64)
        return ParameterInputs(np.zeros((3, 0, 0, 0)), pushed, shifted, opened, changing)

    def _evaluate_motion(self, setup: VariedSetup, time: Array) -> Triple:
        """Joint motion of a setup, passive joints where they start."""
        mechanism, motion = setup
        stated = resolve_start_coordinates(mechanism, self.passive, *self.started)
        return build_joint_histories(motion, mechanism, stated, self.settings, time)[1](time)

    def begin(self, setup: VariedSetup) -> MarchStart:
        """Return the start of the march of a setup [m, rad, s].  Raises ConvergenceError."""
        time = self.solution.time[:1]
        mechanism, motion = setup
        joints = self._evaluate_motion(setup, time)
        if mechanism.closures:
            steps = self.solution.time
            task = make_closed_task(make_prescribed_task(mechanism, motion, steps, self.settings, *self.started))
            joints = close_start(task, task.after(time))
        q, qd, qdd = (part[0] for part in joints)
        return begin_march(setup[0], self.passive, (q, qd, qdd), float(time[0]), self.settings)

    def make_start_tangents(self, base: MarchStart) -> tuple[StepTangents, Array]:
        """Return the tangents at the start, and the derivatives (joints, parameters) of the efforts there [any unit].

        A section without rotary inertia is out of balance there: what nodal accelerations ask for is not what its beam gives.
        Raises InputError where a small change of a parameter makes a start sudden, or not.
        """
        efforts = np.zeros((int(self.given.sum()), len(self.parameters)))
        out = StepTangents(*np.zeros((5, self.system.size, len(self.parameters))))
        static = self.settings.initial == "static"
        closed = bool(self.mechanism.closures)
        slopes = StartSlopes(self.begin, base, self.system, self.given, static, closed)
        given = self.given_slopes.compute(self.solution.time[:1])[:, 0]
        alone = [k for k in range(len(self.parameters)) if k not in self.changing]
        basis, shares = find_start_basis(given[..., alone])
        told = [alone[column] for column in basis]
        for k in [*self.changing, *told]:
            linear = k in told and not given[:2, :, k].any()
            differentiate_start = slopes.find_linear_slopes if linear else slopes.differentiate
            found, effort = differentiate_start(self.parameters[k], self.mechanism, self.motion)
            for part, value in zip(out, found, strict=False):
                part[:, k] = value
            efforts[:, k] = effort
        for part in (*out[:4], efforts):
            part[:, alone] = part[:, told] @ shares
        return out, efforts

    def _compute_result_slopes(self, out: TangentHistories) -> dict[str, dict[str, Array]]:
        """Derivatives of what else is asked for, by name, and by joint, beam, closure or kind."""
        if not self.of:
            return {}
        if self.multiplier is None:
            self.multiplier = self._find_multipliers()
        nearby = NearbyResults(self.system, self.solution, out, self.multiplier, self.of, self.order)
        return nearby.differentiate(self.variations, self.beside)

    def _find_multipliers(self) -> Array:
        """Multipliers of the closures (samples, rows) along the whole solution, with the forces of springs."""
        solution = self.solution
        joints = solution.q, solution.qd, solution.qdd
        states = add_spring_forces(self.system, build_march_states(self.system, solution.nodes, joints, solution.time))
        if self.mechanism.closures:
            return find_shown_multipliers(self.system, states, self.freedoms.marched)
        return np.asarray(states.multiplier)

    def _assemble(self, out: TangentHistories, effort: Array, end: NodalMotion) -> Sensitivities:
        """The result of the histories, of the efforts of all joints, and of the slopes in the last sample."""
        mechanism = self.mechanism
        return Sensitivities(
            solution=self.solution,
            parameters=tuple(parameter.name for parameter in self.parameters),
            values=np.array([parameter.value for parameter in self.parameters], dtype=float),
            torque=effort[:, mechanism.actuated],
            tip=dict(zip((joint.child for joint in mechanism.joints), out.tip.transpose(1, 0, 2, 3), strict=True)),
            q=out.pose[:, self.system.unknown],
            end=end,
            ends_alike=self.find_ends_alike(),
            results=self._compute_result_slopes(out),
        )

    def find_ends_alike(self) -> Mask:
        """Return a mask (parameters,) of those that leave the mechanism and its joints at the end as they are [-]."""
        alike: Mask = np.logical_not(self.given_slopes.compute(self.solution.time[-1:]).any(axis=(0, 1, 2)))
        alike[self.changing] = False
        return alike

    def _fill_efforts(self, effort: Array) -> Array:
        """Efforts (samples, nv, parameters) of all joints, zero where none has a motion."""
        out = np.zeros((len(effort), self.mechanism.nv, len(self.parameters)))
        out[:, self.given] = effort
        return out

    def compute_friction(self, rates: Array, joints: Mask) -> Array:
        """Return the derivatives (samples, joints, parameters) of the dry friction of some joints at rates [N m], [N]."""
        direction = np.sign(rates)
        out = np.zeros((*direction.shape, len(self.parameters)))
        for k in self.changing:
            friction = self.variations[k].join_results(
                mechanism.drive_table[2][joints] for mechanism, _ in self.variations[k].setups
            )
            out[:, :, k] = direction * friction
        return out


def _sample_varied(varied: FreeSystem, leg: Leg, states: tuple[MarchStates, MarchStates]) -> list[ForceRecord]:
    """Forces of another mechanism at the states of the march, and at those that are shown where these are others."""
    moved = build_march_states(varied, leg.nodes, leg.joints, leg.time)
    kept = [moved._replace(du=one.du, multiplier=one.multiplier) for one in states]
    if states[0] is states[1]:
        return 2 * [sample_forces(varied, kept[0])]
    return [sample_forces(varied, one) for one in kept]
