"""Response of a mechanism alone to a measured motion, by the free parameters: efforts of joints, readings of all sensors.

Rigid trees: tau = (Y + x Y_x + y Y_y) pi + f tau_spring, Y by `flexinv.torque_regressor`, Y_x, Y_y its derivatives by a tilt of
gravity about the world's axes x and y, pi (links x 10) by log-Cholesky.  Loops and beams: `flexinv.solve`; for rigid loops with
the columns of pi by differences, which are exact because the torque is linear in them; masses of links that measured joints alone
carry by `carried_links`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.identification.parameters import KINDS, MASS, Key, ParameterSpace, apply_values, make_load_place
from crosscheck.identification.points import PointMotion, add_sensor_bodies, build_point_motion, list_point_sensors
from crosscheck.identification.pseudo_inertia import COLUMNS, NAMES, ROWS, move_mass_properties
from crosscheck.identification.responses.carried_links import CarriedLinks, build_carried_links, list_marched_masses
from crosscheck.identification.settings import GaugeTable, IdentifyTable
from flexinv.analysis.solution import Solution
from flexinv.analysis.solve import solve
from flexinv.errors import InputError
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.attachments import Spring
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.motion import Motion
from flexinv.model.owned_cache import make_owner_cache
from flexinv.model.parallel_axis import compute_parallel_axis_term
from flexinv.rigid.joint_torques import joint_torques
from flexinv.rigid.torque_regressor import compute_link_parameters, torque_regressor
from flexinv.typing import Array

Told = tuple[Array, Array, Array]
State = tuple[Array, Array, Array]
Response = Callable[[Mapping[Key, float]], Told]
PARAMETERS = len(NAMES)
TILT = 1e-3  # [rad]; the torque is linear in gravity, so the difference quotient errs by its square
KEPT = 64  # responses that are remembered: one for each parameter that needs a solution of its own


@dataclass(frozen=True)
class MeasuredMotion:
    """Motion of the joints that a log measures.

    time : (samples,) [s], from 0; names : of the joints; q, qd, qdd : (samples, joints) [rad], [m] and per second
    warmth : (samples, joints) [K] by which drives are warmer than their references; None where it is not logged
    """

    time: Array
    names: tuple[str, ...]
    q: Array
    qd: Array
    qdd: Array
    warmth: Array | None = None


@make_owner_cache(most=4)
def remove_rotors_and_friction(mechanism: Mechanism, names: tuple[str, ...]) -> Mechanism:
    """Return the mechanism without rotors and friction [kg m^2], [N m] of measured joints, which are laws of their own."""

    def remove_drive(joint: Joint) -> Joint:
        if joint.name not in names:
            return joint
        return replace(joint, rotor_inertia=0.0, damping=0.0, friction=0.0, drive=None)

    return replace(mechanism, joints=tuple(remove_drive(j) for j in mechanism.joints))


def compute_link_inertias(space: ParameterSpace, mechanism: Mechanism, values: Mapping[Key, float]) -> Array:
    """Return m, h, I (links, 10) [kg], [kg m], [kg m^2] of all rigid links; zeros for beams."""
    out = np.zeros((len(mechanism.links), PARAMETERS))
    loads = space.loads
    for k, link in enumerate(mechanism.links):
        if link.name in space.factors:
            out[k] = _compute_free_masses(space, link.name, values) + space.more.get(link.name, 0.0)
        elif link.beam is None:
            out[k] = compute_link_parameters(link)
        if link.name in loads and (MASS, f"{make_load_place(link.name)}.{NAMES[0]}") in values:
            out[k] += _compute_free_masses(space, make_load_place(link.name), values)
    return out


def _compute_free_masses(space: ParameterSpace, place: str, values: Mapping[Key, float]) -> Array:
    """The m, h, I (10,) [kg], [kg m], [kg m^2] of a link or payload whose mass properties are free."""
    x = np.array([values.get((MASS, f"{place}.{n}"), 0.0) for n in NAMES])
    return _move_mass_properties(space.factors[place].tobytes(), x.tobytes())


@lru_cache(maxsize=256)  # a difference quotient by one parameter leaves most links as they were
def _move_mass_properties(factor: bytes, x: bytes) -> Array:
    return move_mass_properties(np.frombuffer(factor).reshape(4, 4), np.frombuffer(x))


def make_body(name: str, ten: Array) -> Body:
    """Return the body of m, h, I (10,) [kg], [kg m], [kg m^2]: its tensor about its centre of mass by Steiner's theorem."""
    mass = float(ten[0])
    com = ten[1:4] / mass
    tensor = np.zeros((3, 3))
    tensor[ROWS, COLUMNS] = tensor[COLUMNS, ROWS] = ten[4:]
    return Body(name, Inertia.build_unchecked(mass, com, tensor - compute_parallel_axis_term(mass, com)))


def replace_masses(mechanism: Mechanism, masses: Mapping[str, Array]) -> Mechanism:
    """Return the mechanism whose links carry one body each with m, h, I (10,) [kg], [kg m], [kg m^2]."""
    links = tuple(
        replace(k, bodies=(make_body(k.name, masses[k.name]),)) if k.name in masses else k for k in mechanism.links
    )
    return replace(mechanism, links=links)


def turn_gravity(gravity: Array, x: float, y: float) -> Array:
    """Return gravity (3,) [m/s^2] turned by small angles x, y [rad] about the world's axes."""
    return np.array(
        [gravity[0] + y * gravity[2], gravity[1] - x * gravity[2], gravity[2] + x * gravity[1] - y * gravity[0]]
    )


def _compute_tilted_gravity(gravity: Array, values: Mapping[Key, float]) -> Array:
    return turn_gravity(gravity, *(values.get((f"gravity tilt {axis}", "world"), 0.0) for axis in "xy"))


def build_response(
    mechanism: Mechanism, space: ParameterSpace, settings: IdentifyTable, motion: MeasuredMotion, once: bool = False
) -> Response:
    """Return the function from values to efforts (samples, joints) [N m], [N], root moments (samples, gauges) [N m] and the
    signals of points (samples, sensors) [m], [m/s^2].

    once : one set of values is asked for, so that no regressor pays: torques are computed as they are
    Raises InputError: a joint of a rigid tree that no column moves.
    """
    alone = remove_rotors_and_friction(mechanism, motion.names)
    passive = any(j.nv and j.name not in motion.names and not j.actuated for j in mechanism.joints)
    solved = any(KINDS[p.kind].solved for p in space.parameters)
    if mechanism.is_rigid and not mechanism.closures and not settings.gauges and not passive and not solved:
        return _build_tree_response(alone, space, settings, motion, once)
    return _build_solver_response(alone, space, settings, motion, once)


def _build_tree_response(
    mechanism: Mechanism, space: ParameterSpace, settings: IdentifyTable, motion: MeasuredMotion, once: bool
) -> Response:
    if still := [j.name for j in mechanism.joints if j.nv and j.name not in motion.names]:
        raise InputError(
            f"joint {still[0]} moves and no column says how; write [joints.{still[0]}] with angle = {{ column = ... }} in "
            f"identify.toml, or stands.{still[0]} = {{ deg = 0 }} where it stands during all logs"
        )
    q, qd, qdd = _build_states(mechanism, motion)
    rows = [mechanism.v_slices[name].start for name in motion.names]

    points = PointMotion.make_empty(len(q))
    if list_point_sensors(settings):
        mesh = build(add_sensor_bodies(mechanism, settings))
        points = build_point_motion(settings, mesh, compute_rigid_motion(mesh, q, qd, qdd))
    torques = _DirectTorques if once else _RegressorTorques.build
    return _TreeResponse(torques(mechanism, space, (q, qd, qdd), rows), points, np.asarray(mechanism.gravity))


@dataclass(frozen=True)
class _TreeResponse:
    """Response of a rigid tree: its efforts (samples, joints) [N m], [N] at any values, and how its points move."""

    torques: Callable[[Mapping[Key, float]], Array]
    points: PointMotion
    gravity: Array

    def __call__(self, values: Mapping[Key, float]) -> Told:
        """Return the readings of the sensors at values [unit of each], as `build_response` has them."""
        efforts = self.torques(values)
        tilted = _compute_tilted_gravity(self.gravity, values)
        return efforts, np.zeros((len(efforts), 0)), self.points.compute_readings(tilted)


@dataclass(frozen=True)
class _DirectTorques:
    """The efforts of a tree at any values, each from the motion anew; rows : of the measured joints."""

    mechanism: Mechanism
    space: ParameterSpace
    state: State
    rows: list[int]

    def __call__(self, values: Mapping[Key, float]) -> Array:
        """Return the efforts (samples, joints) [N m], [N] at values [unit of each]."""
        ten = compute_link_inertias(self.space, self.mechanism, values)
        forces = tuple(values.get(("spring force", s.name), 1.0) for s in self.mechanism.springs)
        tilts = _compute_tilted_gravity(np.asarray(self.mechanism.gravity), values)
        changed = _apply_changes(self.mechanism, self.space.changed_links, ten.tobytes(), tilts.tobytes(), forces)
        return joint_torques(changed, *self.state)[:, self.rows]


@make_owner_cache(most=4)
def _apply_changes(
    mechanism: Mechanism, free: tuple[str, ...], masses: bytes, gravity: bytes, forces: tuple[float, ...]
) -> Mechanism:
    """The mechanism with the masses of links that are free, gravity and springs of so many times the force."""
    ten = np.frombuffer(masses).reshape(-1, PARAMETERS)
    changed = {link.name: ten[k] for k, link in enumerate(mechanism.links) if link.name in free}
    springs = tuple(_scale_spring(s, factor) for s, factor in zip(mechanism.springs, forces, strict=True))
    return replace(replace_masses(mechanism, changed), gravity=np.frombuffer(gravity), springs=springs)


def _scale_spring(spring: Spring, factor: float) -> Spring:
    return replace(spring, stiffness=spring.stiffness * factor, law=spring.law and spring.law.scale_forces(factor))


@dataclass(frozen=True)
class _RegressorTorques:
    """The efforts of a tree at any values, by matrices of the motion that are made once.

    level : Y (samples, joints, 10 links); slopes : its derivatives by each tilt of gravity that is free; held : of given forces
    pulls : of each spring between points (samples, joints) [N m], [N]
    """

    mechanism: Mechanism
    space: ParameterSpace
    level: Array
    slopes: dict[str, Array]
    held: Array
    pulls: dict[str, Array]

    @classmethod
    def build(cls, mechanism: Mechanism, space: ParameterSpace, state: State, rows: list[int]) -> _RegressorTorques:
        """Build the matrices of a motion [rad], [m] and per second."""
        known = {p.key for p in space.parameters}
        free_tilts = [f"gravity tilt {axis}" for axis in "xy" if (f"gravity tilt {axis}", "world") in known]
        level = torque_regressor(mechanism, *state).matrix[:, rows]
        slopes = {tilt: _compute_tilt_slope(mechanism, state, rows, level, tilt[-1]) for tilt in free_tilts}
        alone, forced, sprung = _split_mechanism(mechanism)
        free = joint_torques(alone, *state, passive=False)
        held = joint_torques(forced, *state)[:, rows] - free[:, rows]
        pulls = {name: (joint_torques(one, *state, passive=False) - free)[:, rows] for name, one in sprung.items()}
        return cls(mechanism, space, level, slopes, held, pulls)

    def __call__(self, values: Mapping[Key, float]) -> Array:
        """Return the efforts (samples, joints) [N m], [N] at values [unit of each]."""
        tilts = tuple(values[kind, "world"] for kind in self.slopes)
        forces = tuple(values.get(("spring force", name), 1.0) for name in self.pulls)
        masses = compute_link_inertias(self.space, self.mechanism, values)
        return self._compute_from_numbers(masses.tobytes(), tilts, forces)

    @make_owner_cache(most=4)  # friction and sensors leave it as it was
    def _compute_from_numbers(self, masses: bytes, tilts: tuple[float, ...], forces: tuple[float, ...]) -> Array:
        pi = np.frombuffer(masses)
        out = self.level @ pi + self.held
        for tilt, slope in zip(tilts, self.slopes.values(), strict=True):
            if tilt:
                out = out + tilt * (slope @ pi)
        for force, pull in zip(forces, self.pulls.values(), strict=True):
            out = out + force * pull
        return np.asarray(out)


def _compute_tilt_slope(mechanism: Mechanism, state: State, rows: list[int], level: Array, axis: str) -> Array:
    """The derivative of the regressor (samples, joints, parameters) by a tilt of gravity about one of the world's axes."""
    tilted = turn_gravity(np.asarray(mechanism.gravity), *(TILT * np.eye(2)["xy".index(axis)]))
    return (torque_regressor(replace(mechanism, gravity=tilted), *state).matrix[:, rows] - level) / TILT


@make_owner_cache()
def _split_mechanism(mechanism: Mechanism) -> tuple[Mechanism, Mechanism, dict[str, Mechanism]]:
    """The mechanism without springs between points and given forces, with the forces, and with each of the springs."""
    alone = replace(mechanism, springs=(), forces=())
    sprung = {s.name: replace(mechanism, springs=(s,), forces=()) for s in mechanism.springs}
    return alone, replace(mechanism, springs=()), sprung


def _build_states(mechanism: Mechanism, motion: MeasuredMotion) -> tuple[Array, Array, Array]:
    q = np.tile(mechanism.neutral, (len(motion.time), 1))
    qd, qdd = np.zeros((2, len(motion.time), mechanism.nv))
    for k, name in enumerate(motion.names):
        part = mechanism.q_slices[name]
        row = mechanism.v_slices[name].start
        angle = motion.q[:, k : k + 1]
        q[:, part] = angle if part.stop - part.start == 1 else np.hstack([np.cos(angle), np.sin(angle)])
        qd[:, row] = motion.qd[:, k]
        qdd[:, row] = motion.qdd[:, k]
    return q, qd, qdd


@dataclass(frozen=True)
class SolverModel:
    """A mechanism that the solver follows along the measured motion, at any values of the parameters.

    mechanism : with the mesh of the settings; given : the motion; rows : of the measured joints among all velocities
    """

    mechanism: Mechanism
    settings: IdentifyTable
    given: Motion
    time: Array
    rows: list[int]

    @classmethod
    def build(cls, mechanism: Mechanism, settings: IdentifyTable, motion: MeasuredMotion) -> SolverModel:
        """Build the model of a mechanism without rotors and friction [kg m^2], [N m] of its measured joints."""
        coarse = mechanism.with_mesh(*settings.mesh) if settings.mesh and mechanism.beams else mechanism
        given = Motion.from_samples(motion.time, {name: motion.q[:, k] for k, name in enumerate(motion.names)})
        rows = [coarse.v_slices[name].start for name in motion.names]
        return cls(coarse, settings, given, motion.time, rows)

    def apply(self, values: Mapping[Key, float], ten: Mapping[str, Array]) -> Mechanism:
        """Return the mechanism with values [unit of each], masses m, h, I (10,) [kg], [kg m], [kg m^2] and sensors."""
        changed = add_sensor_bodies(replace_masses(apply_values(self.mechanism, values), ten), self.settings)
        springs = tuple(_scale_spring(s, values.get(("spring force", s.name), 1.0)) for s in changed.springs)
        return replace(changed, gravity=_compute_tilted_gravity(np.asarray(changed.gravity), values), springs=springs)

    def solve_in_time(self, values: Mapping[Key, float], ten: Mapping[str, Array]) -> tuple[Told, State]:
        """Return the readings of joints, gauges and points [N m], [N], [m], [m/s^2], and the states that the solver found."""
        changed = self.apply(values, ten)
        every = self.settings.every or 1
        step = float(self.time[1] - self.time[0]) / every
        start = {name: table.value for name, table in self.settings.start.items()}
        whole = bool(changed.closures) and not changed.is_rigid  # of which the solver keeps every step
        apart = 1 if whole else every
        solution = solve(changed, self.given, step, every=apart, initial=self.settings.initial, start=start or None)
        moments = [_compute_gauge_moment(solution, gauge) for gauge in self.settings.gauges.values()]
        points = build_point_motion(self.settings, solution.mesh, solution.nodes)
        kept = slice(None, None, every // apart)
        told = (
            solution.torque_all[kept, self.rows],
            np.column_stack([np.zeros((len(solution.time), 0)), *moments])[kept],
            points.compute_readings(np.asarray(changed.gravity))[kept],
        )
        return told, (solution.q[kept], solution.qd[kept], solution.qdd[kept])

    def compute_efforts(self, values: Mapping[Key, float], ten: Mapping[str, Array], state: State) -> Array:
        """Return the efforts (samples, joints) [N m], [N] in states that were found with other masses."""
        try:
            return joint_torques(self.apply(values, ten), *state)[:, self.rows]
        except InputError:  # forces over time, closures that act for a while
            return self.solve_in_time(values, ten)[0][0]


def _compute_gauge_moment(solution: Solution, gauge: GaugeTable) -> Array:
    """The moment about z (samples,) [N m] that bends a beam where its gauge is: at its root that of the joint there.

    Elsewhere it is linear between the Gauss points, and beyond them.
    """
    if gauge.station is None:
        return np.asarray(-solution.wrench[gauge.joint][:, 5])
    points = solution.internal_stations[gauge.beam]
    if len(points) == 1:
        return np.asarray(solution.internal[gauge.beam][:, 0, 5])
    line = scipy.interpolate.make_interp_spline(points, solution.internal[gauge.beam][:, :, 5], k=1, axis=1)
    return np.asarray(line(gauge.station))


def _build_solver_response(
    mechanism: Mechanism, space: ParameterSpace, settings: IdentifyTable, motion: MeasuredMotion, once: bool
) -> Response:
    model = SolverModel.build(mechanism, settings, motion)
    solved = [p.key for p in space.parameters if KINDS[p.kind].solved or p.kind.startswith(("gravity", "spring"))]
    masses = [p.key for p in space.parameters if p.kind == MASS]
    if masses and not once and _is_linear_in_masses(mechanism, motion):
        return _build_linear_response(mechanism, space, solved, model)
    known = compute_link_inertias(space, mechanism, {})
    carried = None if once else build_carried_links(mechanism, space, model.given, motion.time, motion.names, known)
    return _SolvedResponse(model, space, tuple(solved + list_marched_masses(masses, mechanism, carried)), carried)


@dataclass(frozen=True)
class _SolvedResponse:
    """Response of a mechanism that is marched along the motion; asked : parameters that need a march of their own.

    carried : links whose masses need none
    """

    model: SolverModel
    space: ParameterSpace
    asked: tuple[Key, ...]
    carried: CarriedLinks | None = None
    kept: dict[tuple[float, ...], Told] = field(default_factory=dict)

    def __call__(self, values: Mapping[Key, float]) -> Told:
        """Return the readings of the sensors at values [unit of each], as `build_response` has them."""
        at = tuple(values.get(k, np.inf) for k in self.asked)  # a payload that is not there is none of any size
        mechanism = self.model.mechanism
        ten = compute_link_inertias(self.space, mechanism, values)
        if at not in self.kept:
            marched = self.carried.replace_by_known(ten) if self.carried else ten
            links = enumerate(mechanism.links)
            changed = {link.name: marched[k] for k, link in links if link.name in self.space.changed_links}
            if len(self.kept) >= KEPT:
                self.kept.pop(next(iter(self.kept)))
            self.kept[at] = self.model.solve_in_time(values, changed)[0]
        efforts, moments, points = self.kept[at]
        return efforts + self.carried.compute_added_efforts(ten) if self.carried else efforts, moments, points


def is_marched(response: Response) -> bool:
    """Return True for a response whose error depends on the steps in time [-]."""
    return isinstance(response, _SolvedResponse)


def _is_linear_in_masses(mechanism: Mechanism, motion: MeasuredMotion) -> bool:
    """Return True if masses do not change how a mechanism moves: rigid, and no joint swings on a spring or freely."""
    moved = [j for j in mechanism.joints if j.nv and j.name not in motion.names]
    swings = any(j.stiffness for j in moved) or (bool(moved) and not mechanism.closures)
    return mechanism.is_rigid and not swings


def _build_linear_response(
    mechanism: Mechanism, space: ParameterSpace, solved: list[Key], model: SolverModel
) -> Response:
    known = {
        name: move_mass_properties(space.factors[name], np.zeros(PARAMETERS))
        if name in space.factors
        else compute_link_parameters(mechanism.link_of[name])
        for name in space.changed_links
    }
    return _LinearResponse(model, space, tuple(solved), known)


@dataclass(frozen=True)
class _LinearResponse:
    """Rigid loops: tau = tau_0 + Y (pi - pi_0), columns by differences, kept for each set of the other values.

    The loops are followed once, as masses do not move them.  known : pi_0 of each link (10,) [kg], [kg m], [kg m^2]
    """

    model: SolverModel
    space: ParameterSpace
    solved: tuple[Key, ...]
    known: dict[str, Array]
    kept: dict[tuple[float, ...], Told] = field(default_factory=dict)

    def __call__(self, values: Mapping[Key, float]) -> Told:
        """Return the readings of the sensors at values [unit of each], as `build_response` has them."""
        at = tuple(values[k] for k in self.solved)
        if at not in self.kept:
            self.kept[at] = self._compute_columns(values)
        level, matrix, points = self.kept[at]
        mechanism = self.model.mechanism
        ten = compute_link_inertias(self.space, mechanism, values)
        number = {link.name: k for k, link in enumerate(mechanism.links)}
        change = np.concatenate([ten[number[name]] - first for name, first in self.known.items()])
        return level + matrix @ change, np.zeros((len(level), 0)), points

    def _compute_columns(self, values: Mapping[Key, float]) -> Told:
        (level, _, points), state = self.model.solve_in_time(values, self.known)
        base = self.model.compute_efforts(values, self.known, state)
        out = []
        for name, ten in self.known.items():
            for k in range(PARAMETERS):
                size = max(abs(float(ten[k])), 1e-3 * float(ten[0]))
                changed = ten.copy()
                changed[k] += size
                efforts = self.model.compute_efforts(values, {**self.known, name: changed}, state)
                out.append((efforts - base) / size)
        return level, np.stack(out, axis=-1), points  # (sample, joint), (sample, joint, parameter), (sample, sensor)
