"""PyElastica as an engine of crosscheck: one straight beam on a hub that turns as given, by explicit Cosserat rods.

    directors     rows z, -y, x of the beam's section frame: d3 is the tangent, and d1, d2, d3 are right-handed
    root          the rod begins half an element behind the hub, whose element 0 turns rigidly about its middle: second order
    torque        of the hub: the half element's own inertia, and what element 0 and node 1 need beside the rod's inner forces,
                  which PyElastica has at the middle of a step: the mean of the two beside a sample
    step          of Verlet's scheme: SAFE of what the fastest wave or shear of a section against its rotary inertia allows
    error bars    crosscheck asks for three meshes, each twice as fine; their steps are bound by stability and follow

Source: pyelastica 1.0.0; it has no inverse dynamics, so the torque is read at the root of a march in time.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from importlib import metadata
from typing import Any

import elastica
import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import sample_times
from crosscheck.engines.shared.prescribed import (
    describe_coupled_sections,
    missing_motion,
    passive_effort,
    rotor_effort,
)
from crosscheck.lifting.rigid import turned
from crosscheck.measures.record import Record, Series, series, torque_series, vector_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Beam, Joint, Mechanism

Array = NDArray[np.float64]
MESHES = (10, 20, 40)  # elements
SAFE = 0.9  # of the longest step that is stable
MOST_STEPS = 4_000_000  # of the finest mesh: some minutes
ACROSS = 1e-9  # cosine of axis and beam: a hub turns the beam about an axis across it
FAR = 3.0  # lengths of the beam: a rod whose tip is farther off has blown up
forkable = False  # Numba's threads
refines = True  # the option "refinement" k takes the mesh MESHES[k], or finer ones


class System(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):  # type: ignore[misc]
    """One rod with its hub and its weight."""


def version() -> str:
    """Return the version of PyElastica."""
    return metadata.version("pyelastica")


def abilities() -> str:
    """Return one sentence: what PyElastica can do here."""
    return "One straight uniform beam on a revolute joint, with shear and large bending, by explicit Cosserat rods."


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why PyElastica cannot do this case here, or None."""
    if len(mechanism.links) != 1 or len(mechanism.beams) != 1:
        return "explicit rods take one beam alone here: PyElastica has no exact joints between rods or bodies"
    (link,), (joint,) = mechanism.links, mechanism.joints
    assert link.beam is not None
    section = link.beam.section
    if joint.kind not in ("revolute", "continuous") or joint.parent != WORLD:
        return "the beam has to turn about a revolute joint on the world"
    if mechanism.closures or mechanism.springs or mechanism.forces or link.bodies or joint.stiffness:
        return "closures, springs, forces and bodies on the beam are not in this adapter"
    if (reason := describe_coupled_sections(mechanism, "the rods of this adapter")) is not None:
        return reason
    if np.ptp(section.stiffness, axis=0).any() or np.ptp(section.mass_per_length) or link.beam.curvature.any():
        return "a straight, uniform beam is what this adapter builds"
    if section.damping is not None and np.any(section.damping):
        return "PyElastica has no damping of strains (its dampers brake the turning as well)"
    if case.initial == "static":
        return "explicit rods begin undeformed: there is no equilibrium under gravity to begin with"
    along = abs(float(joint.axis @ link.beam.placement.rotation[:, 0]))
    if along > ACROSS or np.any(link.beam.placement.position):
        return "the beam has to begin at its joint and lie across its axis"
    steps = case.end / longest_step(link.beam, MESHES[-1])
    if steps > MOST_STEPS:
        return f"shear of so stiff a section against its rotary inertia asks for {steps:.2g} explicit steps"
    return missing_motion(mechanism, case)


def run(mechanism: Mechanism, case: Case, engine: str, options: Mapping[str, Any]) -> Record:
    """Return torque [N m], tip, deflection [m] and axial force [N] on the sample times, of one march.

    options : "refinement" k: of MESHES[0] times 2^k elements; the finest of MESHES without it
    """
    start = clock.perf_counter()
    count = MESHES[0] * 2 ** int(options["refinement"]) if "refinement" in options else MESHES[-1]
    made = marched(mechanism, case, count)
    (link,) = mechanism.beams
    assert link.beam is not None
    return Record(
        engine,
        version=version(),
        settings={"elements": count, "step [s]": longest_step(link.beam, count)},
        time=sample_times(case),
        series=made,
        wall_time=clock.perf_counter() - start,
    )


def longest_step(beam: Beam, count: int) -> float:
    """Return the step [s] that a mesh takes: SAFE of 2 / omega, omega [rad/s] above all frequencies of the mesh."""
    s, dx = beam.section, beam.length / (count - 0.5)
    ea, gy, gz, gj, ey, ez = s.stiffness[0]
    rho, (ix, iy, iz) = s.mass_per_length[0], s.rotary_inertia[0]
    moving = 4.0 * max(ea, gy, gz) / (rho * dx**2)
    turning = max((gy + 4.0 * ez / dx**2) / iz, (gz + 4.0 * ey / dx**2) / iy, 4.0 * gj / (dx**2 * ix))
    return float(SAFE * 2.0 / np.sqrt(moving + turning))


def marched(mechanism: Mechanism, case: Case, count: int) -> dict[str, Series]:
    """Return the series of a march with so many elements."""
    (link,), (joint,) = mechanism.links, mechanism.joints
    assert link.beam is not None
    times = sample_times(case)
    each = max(2, int(np.ceil(case.sample / longest_step(link.beam, count))))  # steps between two samples
    h = case.sample / each
    half = np.arange(2 * each * (times.size - 1) + 3) * (h / 2)
    places, rates, accelerations = case.motion.evaluate(mechanism, np.minimum(half, case.end))
    q, v, a = angle(places), rates[:, 0], accelerations[:, 0]
    hub = Hub(joint, link.beam, count)
    rod, system = built(hub, mechanism.gravity, (q, v), h)
    stepper = elastica.PositionVerlet()
    inner: list[Array] = []
    tips, efforts = [rod.position_collection[:, -1].copy()], []
    now = np.float64(0.0)
    for k in range(1, each * (times.size - 1) + 2):
        now = stepper.step(system, (k - 1) * h, h)
        if k % each == 0 and len(tips) < times.size:
            tips.append(rod.position_collection[:, -1].copy())
        if k % each in (0, 1):
            inner.append(np.append(rod.internal_torques[:, 0], rod.internal_forces[:, 1]))
        if k % each == 1:  # the steps before and behind a sample
            beside = inner[-1] if len(inner) == 1 else 0.5 * (inner[-1] + inner[-2])
            efforts.append(hub.efforts(beside, *(part[2 * (k - 1)] for part in (q, v, a)), mechanism.gravity))
    if not np.abs(np.array(tips) - joint.placement.position).max() < FAR * link.beam.length:
        raise RuntimeError(f"the rod has blown up with steps of {h:.3g} s at {now:.3g} s")
    return told(mechanism, case, hub, np.array(tips), np.array(efforts))


def told(mechanism: Mechanism, case: Case, hub: Hub, tips: Array, efforts: Array) -> dict[str, Series]:
    """Return the series: torque [N m] with what the drive carries, tip and deflection [m], axial force of the joint [N]."""
    (link,) = mechanism.links
    q, v, a = case.motion.evaluate(mechanism, sample_times(case))
    torque = efforts[:, :1] + passive_effort(mechanism, v) + rotor_effort(mechanism, a)
    axes = np.array([hub.axes(x) for x in angle(q)])
    local = np.einsum("sxa,sx->sa", axes, tips - hub.joint.placement.position)
    made = torque_series(mechanism, torque) | vector_series(f"tip/{link.name}", "m", tips)
    made |= vector_series(f"deflection/{link.name}", "m", local - np.array([hub.beam.length, 0.0, 0.0]))
    return made | series(f"axial/{link.name}", "N", efforts[:, 1])


def angle(q: Array) -> Array:
    """Return the angle of the hub (samples,) [rad]; q : angle, or its cosine and sine."""
    turn: Array = np.arctan2(q[:, 1], q[:, 0]) if q.shape[1] == 2 else q[:, 0]
    return turn


class Hub:
    """The hub's frame and what its half element weighs; dx : length of an element [m].

    A turn by q is linear in 1, cos q and sin q: axes and directors are sums of three matrices, as millions of steps ask for them.
    """

    def __init__(self, joint: Joint, beam: Beam, count: int) -> None:
        """Keep joint and beam; count : elements, the first of which is half behind the hub."""
        self.joint, self.beam, self.count = joint, beam, count
        self.dx = beam.length / (count - 0.5)
        self.axis = joint.placement.rotation @ joint.axis
        own = beam.placement.rotation.T @ joint.axis
        rho, across = beam.section.mass_per_length[0], 1.0 - own[0] ** 2
        lump = rho * across * (self.dx / 2) ** 3 / 3
        self.inertia = float(lump + self.dx / 2 * beam.section.rotary_inertia[0] @ own**2)
        ahead, aside, back = (
            joint.placement.rotation @ turned(joint.axis, quarter * np.pi / 2) @ beam.placement.rotation
            for quarter in range(3)
        )
        mean = (ahead + back) / 2
        self.columns = mean, (ahead - back) / 2, aside - mean
        self.rows = tuple(np.array([part[:, 2], -part[:, 1], part[:, 0]]) for part in self.columns)

    def axes(self, angle: float) -> Array:
        """Return the axes of the root section at an angle [rad], in columns (3, 3) [-]."""
        return along(self.columns, np.cos(angle), np.sin(angle))

    def directors(self, angle: float) -> Array:
        """Return PyElastica's directors of the root section (3, 3) [-], in rows."""
        return along(self.rows, np.cos(angle), np.sin(angle))

    def efforts(self, inner: Array, q: float, v: float, a: float, gravity: Array) -> Array:
        """Return torque of the hub [N m] and its force on the beam along x of the link's frame [N].

        inner : couple on element 0, in its directors, and force of the rod on node 1, (6,) [N m], [N]
        """
        e, rho = self.axes(q)[:, 0], self.beam.section.mass_per_length[0]
        couple, force = self.directors(q).T @ inner[:3], inner[3:]
        lump, arm = rho * self.dx / 2, self.dx / 2  # of element 1 at node 1, and as much of half element 0 up to there
        moved = arm * (a * np.cross(self.axis, e) - v**2 * e)  # acceleration of node 1
        needed = lump * (moved - gravity) - force
        torque = self.inertia * a + self.axis @ (np.cross(arm * e, needed) - couple)
        torque -= lump * arm / 2 * (self.axis @ np.cross(e, gravity))
        whole = needed + lump * (
            moved / 2 - gravity
        )  # and what half of element 0 needs, whose middle moves half as fast
        return np.array([torque, whole @ self.axes(q) @ self.beam.placement.rotation.T[:, 0]])


def along(parts: tuple[Array, ...], cosine: float, sine: float) -> Array:
    """Return the sum of the parts of a turn that are constant, in the cosine and in the sine of its angle."""
    return parts[0] + cosine * parts[1] + sine * parts[2]


def built(hub: Hub, gravity: Array, motion: tuple[Array, Array], h: float) -> tuple[Any, Any]:
    """Return the rod and its system; motion : angle [rad] and rate [rad/s] of the hub every half step h / 2 [s]."""
    q, v = motion
    e, _, z = hub.axes(q[0]).T
    s, radius = hub.beam.section, 0.02 * hub.beam.length
    origin = np.asarray(hub.joint.placement.position, dtype=float)
    rod = elastica.CosseratRod.straight_rod(
        hub.count,
        origin - 0.5 * hub.dx * e,
        e,
        z,
        hub.dx * hub.count,
        radius,
        s.mass_per_length[0] / (np.pi * radius**2),
        youngs_modulus=1e9,  # all matrices are set below
        shear_modulus=1e9,
    )
    ea, gy, gz, gj, ey, ez = s.stiffness[0]
    ix, iy, iz = s.rotary_inertia[0] * hub.dx
    rod.shear_matrix[:] = np.diag([gz, gy, ea])[:, :, None]
    rod.bend_matrix[:] = np.diag([ez, ey, gj])[:, :, None]
    rod.mass_second_moment_of_inertia[:] = np.diag([iz, iy, ix])[:, :, None]
    rod.inv_mass_second_moment_of_inertia[:] = np.diag([1 / iz, 1 / iy, 1 / ix])[:, :, None]
    rate = hub.directors(q[0]) @ (v[0] * hub.axis)
    rod.omega_collection[:] = rate[:, None]
    rod.velocity_collection[:] = np.cross(v[0] * hub.axis, (rod.position_collection - origin[:, None]).T).T

    cosine, sine, half = np.cos(q), np.sin(q), 0.5 * hub.dx
    spin = hub.directors(q[0]) @ hub.axis  # the same at every angle
    swing = tuple(half * np.cross(hub.axis, part[2]) for part in hub.rows)  # rate of node 1 by that of the hub

    class HubRotation(elastica.ConstraintBase):  # type: ignore[misc]
        """Nodes 0 and 1 and element 0 turn with the hub."""

        def __init__(self, **words: Any) -> None:
            super().__init__(**words)

        def constrain_values(self, system: Any, time: float) -> None:
            k = int(2.0 * time / h + 0.5)
            directors = along(hub.rows, cosine[k], sine[k])
            arm = half * directors[2]
            system.position_collection[:, 0], system.position_collection[:, 1] = origin - arm, origin + arm
            system.director_collection[:, :, 0] = directors

        def constrain_rates(self, system: Any, time: float) -> None:
            k = int(2.0 * time / h + 0.5) + 1  # Verlet's rates are those of the step's end
            rate = v[k] * along(swing, cosine[k], sine[k])
            system.velocity_collection[:, 0], system.velocity_collection[:, 1] = -rate, rate
            system.omega_collection[:, 0] = v[k] * spin

    system = System()
    system.append(rod)
    system.constrain(rod).using(HubRotation)
    if np.any(gravity):
        system.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=np.asarray(gravity, dtype=float))
    system.finalize()
    return rod, system
