"""Benches for planted faults: mechanisms and motions that between them show every cause, each in one engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.causes.rows import beams as beam_rows
from crosscheck.causes.rows import bodies as body_rows
from crosscheck.causes.rows import conventions as convention_rows
from crosscheck.causes.rows import friction as friction_rows
from crosscheck.causes.rows import joints as joint_rows
from crosscheck.causes.rows import meshes as mesh_rows
from crosscheck.causes.rows import mixups as mixup_rows
from crosscheck.causes.rows import scales as scale_rows
from crosscheck.causes.rows import signals as signal_rows
from crosscheck.causes.rows import terms as term_rows
from crosscheck.causes.separate import TRIALS
from crosscheck.causes.single_samples import NAME as SINGLE
from crosscheck.causes.subject import Subject
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Beam, Body, Force, Inertia, Joint, Link, Mechanism, Placement
from flexinv.model.motion import Motion

BASIC = (joint_rows, body_rows, convention_rows, beam_rows)
Moved = Callable[[Mechanism, Case], Case]
Shaped = Callable[[Mechanism], Mechanism]


@dataclass(frozen=True)
class Bench:
    """A case of a mechanism, the engine that gets the faults, and what it is told.

    causes : only these, else those of the tables BASIC; more : others, planted once; steps : of a march, per sample
    motion : in the place of the case's own, and its name
    shape : what becomes of the mechanism first, and its name
    """

    mechanism: str
    case: str
    engine: str
    options: Mapping[str, Any] | None = None
    causes: tuple[str, ...] = ()
    steps: int = 2
    motion: tuple[str, Moved] | None = None
    shape: tuple[str, Shaped] | None = None
    more: tuple[str, ...] = ()

    @property
    def planted(self) -> tuple[str, ...]:
        """Names of the causes that are planted here."""
        return (*(self.causes or (cause.name for table in BASIC for cause in table.ROWS)), *self.more)

    @property
    def label(self) -> str:
        """Mechanism, motion and engine."""
        shape = f" ({self.shape[0]})" if self.shape else ""
        return f"{self.mechanism}{shape}/{self.motion[0] if self.motion else self.case} in {self.engine}"

    def make_bench_case(self, mechanism: Mechanism, case: Case) -> tuple[Mechanism, Case]:
        """Return mechanism and case as this bench has them."""
        mechanism = self.shape[1](mechanism) if self.shape else mechanism
        return mechanism, self.motion[1](mechanism, case) if self.motion else case


def _make_quick_case(mechanism: Mechanism, case: Case) -> Case:
    """All joints quickly, each at a rhythm of its own: the trial motion that the report proposes to tell inertias apart."""
    trial = TRIALS["all joints moved quickly, each at a rhythm of its own"]
    return Subject(mechanism, case).add_state_change(lambda harmed, given: trial(harmed, given.time)).case


def _turn(angle: float, duration: float, hold: float) -> Moved:
    """Return a turn of all joints by an angle [rad], then rest [s]: a stroke that leaves short waves ringing."""

    def make_turn_case(mechanism: Mechanism, case: Case) -> Case:
        joints = [joint.name for joint in mechanism.joints if joint.nv]
        there = dict.fromkeys(joints, angle)
        motion = Motion.point_to_point(dict.fromkeys(joints, 0.0), there, duration, hold=hold, law="quintic")
        sample = (duration + hold) / 300
        return replace(case, motion=motion, end=motion.duration, step=sample / 20, sample=sample)

    return make_turn_case


def _make_beam_change(change: Callable[[Beam], Beam]) -> Shaped:
    """Return the change of a mechanism that changes all its beams."""

    def update_mechanism(mechanism: Mechanism) -> Mechanism:
        links = (x if x.beam is None else replace(x, beam=change(x.beam)) for x in mechanism.links)
        return replace(mechanism, links=tuple(links))

    return update_mechanism


def _add_rotors(mechanism: Mechanism) -> Mechanism:
    """Rotors behind gears, no two alike: half a kg m^2 at the first joint, a tenth less at each that follows."""
    joints = (replace(j, rotor_inertia=ROTOR * 0.9**k if j.nv == 1 else 0.0) for k, j in enumerate(mechanism.joints))
    return replace(mechanism, joints=tuple(joints))


def _add_friction(mechanism: Mechanism) -> Mechanism:
    """Dry friction and damping in every joint, no two alike: a newton metre, and one per radian a second, and less."""
    joints = (
        replace(j, friction=RUB * 0.8**k, damping=RUB * 0.7**k) if j.nv == 1 else j
        for k, j in enumerate(mechanism.joints)
    )
    return replace(mechanism, joints=tuple(joints))


def _add_springs_and_force(mechanism: Mechanism) -> Mechanism:
    """A spring in every joint, and a force that goes with the last link."""
    joints = (replace(j, stiffness=RUB * 0.8**k, rest=0.1) if j.nv == 1 else j for k, j in enumerate(mechanism.joints))
    last = mechanism.joints[-1].child
    at = Attachment(last, Placement(mechanism.link_of[last].tip))
    force = Force("push", at, np.array([[1.0, 0.6, 0.3, 0.0, 0.0, 0.1]]), follower=True)
    return replace(mechanism, joints=tuple(joints), forces=(force,))


def _add_beam_loads(mechanism: Mechanism) -> Mechanism:
    """A body half-way along every beam, half as heavy as the beam."""
    links = []
    for link in mechanism.links:
        if link.beam is not None:
            mass = float(0.5 * link.beam.length * link.beam.section.mass_per_length.mean())
            link = replace(link, bodies=(*link.bodies, Body("load", Inertia(mass), station=0.5)))
        links.append(link)
    return replace(mechanism, links=tuple(links))


def _add_closure_tools(mechanism: Mechanism) -> Mechanism:
    """A tool on every hinge that closes a loop, held by the link on its other side: frames that may be turned."""
    tools = []
    hinges = []
    held = []
    for closure in mechanism.closures:
        name = f"{closure.name}_tool"
        tools.append(Link(name, bodies=(Body("tool", TOOL),)))
        second = closure.second
        hinges.append(Joint(name, "revolute", second.link, name, second.placement, axis=closure.axis, actuated=False))
        held.append(replace(closure, kind="fixed", second=Attachment(name, Placement())))
    return replace(
        mechanism,
        links=(*mechanism.links, *tools),
        joints=(*mechanism.joints, *hinges),
        closures=tuple(held),
    )


def _add_spring_dampers(mechanism: Mechanism) -> Mechanism:
    """Springs between points with dampers beside them that take some per cent of what they give."""
    springs = (replace(s, damping=DAMPER * s.stiffness) for s in mechanism.springs)
    return replace(mechanism, springs=tuple(springs))


def _make_thick_beam(beam: Beam) -> Beam:
    """THICKER times as thick with the same area: bending, twist and rotary inertia grow with the square of that."""
    section = beam.section.check_independent("the bench of thick beams")
    stiffness = section.stiffness.copy()
    stiffness[:, 3:] *= THICKER**2
    return replace(
        beam, section=replace(section, stiffness=stiffness, rotary_inertia=section.rotary_inertia * THICKER**2)
    )


def _make_tube_beam(beam: Beam) -> Beam:
    """A round tube with the area and the bending stiffness along y of a section, a fifth of its radius thick, nu = 0.3."""
    section = beam.section.check_independent("the bench of tubes")
    nu = 0.3
    m = 0.8
    shear = 1.0 / (2.0 * (1.0 + nu))  # G / E
    square = (1.0 + m**2) ** 2
    factor = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * m**2)  # Cowper's
    stiffness = section.stiffness.copy()
    stiffness[:, 1:3] = factor * shear * stiffness[:, :1]
    stiffness[:, 4] = stiffness[:, 5]
    stiffness[:, 3] = 2.0 * shear * stiffness[:, 5]
    return replace(beam, section=replace(section, stiffness=stiffness))


def _make_curved_beam(beam: Beam) -> Beam:
    """An arc of a radian in the plane of the motion."""
    return replace(beam, curvature=np.array([0.0, 0.0, 1.0 / beam.length]))


RUB = 1.0  # [N m], [N m s/rad], [N m/rad]
DAMPER = 1e-4  # [s]
ROTOR = 0.5  # [kg m^2]: 5e-5 kg m^2 on the motor's side of a gear of 100
TOOL = Inertia(0.2, np.array([0.05, 0.08, 0.0]), 1e-4 * np.eye(3))  # [kg], [m], [kg m^2]: its weight is on one side
THICKER = 30.0  # a strip of 1.95 mm, 0.4 m long, is then 15 % as thick as long
QUICK = ("quick", _make_quick_case)
FLICK = ("flick", _turn(0.1, 0.02, 0.13))
SNAP = ("snap", _turn(0.01, 0.001, 0.0065))
TUBE = ("tube", _make_beam_change(_make_tube_beam))
STOUT = ("stout", _make_beam_change(_make_thick_beam))
ARC = ("arc", _make_beam_change(_make_curved_beam))
GEARED = ("geared", _add_rotors)
# Flexible ones at half their usual fineness: hundreds of runs, and error bars that know of it.
COARSE = {"elements": 8, "error": False}
FINE = {"elements": 16, "error": False}  # where waves are short
OF_THE_BASE = ("base acceleration convention", "base acceleration convention (spatial)")
OF_INERTIA = (
    "inertial frame rotated",
    "inertia about the origin",
    "inertia about the wrong point",
    "rotary inertia dropped",
    "fixed joint fused wrongly",
    "centre of mass shifted",
)
OF_DRIVES = ("rotor inertia", "rotor inertia dropped", "rotor inertia scale", "rotor inertia exchanged")
OF_FRICTION = (
    "dry friction exchanged",
    "viscous damping exchanged",
    "friction dropped",
    "friction scale",
    "damping dropped",
    "damping scale",
    "smoothed friction",
    "implicit damping",
)
OF_SPRINGS = ("spring stiffness", "spring rest length", "spring damping", "spring missing", "spring end misplaced")
OF_FORCES = ("rest of a joint spring", "given force", "given force missing", "axes of a given force", "joint stiffness")
OF_GEARS = ("coupling ratio", "coupling offset")
OF_CLOSURES = ("closure force dropped",)
OF_WAVES = ("time step", "numerical damping", "beam damping", "lumped mass", "section stiffness")
SLID = ("body along the beam",)
OF_DAMPING = ("beam damping", "beam damping dropped")
OF_SECTIONS = ("section stiffness", "shear factor", "rotary inertia of the section", "beam mass")
OF_JOINTS = tuple(cause.name for cause in friction_rows.ROWS)
OF_MESHES = tuple(cause.name for cause in mesh_rows.ROWS)
OF_BODIES = tuple(cause.name for cause in mixup_rows.ROWS)
OF_UNITS = tuple(cause.name for cause in scale_rows.ROWS)
OF_SIGNALS = tuple(cause.name for cause in signal_rows.ROWS)
OF_TERMS = tuple(cause.name for cause in term_rows.ROWS)
OF_PLACES = ("link length", "joint frame turned", "force at the tip")
OF_MATERIAL = (
    "modulus of elasticity",
    "shear modulus",
    "density",
    "cross-section area",
    "section width",
    "section height",
    "section size",
)
OF_CLAMPS = ("clamp misplaced", "clamp turned")
BENCHES = (
    Bench("double_pendulum", "swing", "pinocchio", more=(*OF_JOINTS, *OF_SIGNALS, SINGLE)),
    Bench("rigid_3r", "quintic", "exudyn", more=(*OF_BODIES, *OF_UNITS, *OF_PLACES)),
    Bench("ur5", "reach", "mujoco", more=("bodies exchanged", "force at the tip")),
    Bench("ur5", "reach", "pinocchio", causes=OF_INERTIA, motion=QUICK, more=OF_TERMS),
    Bench("ur5", "reach", "pinocchio", causes=OF_DRIVES, shape=GEARED),
    Bench("ur5", "reach", "mujoco", causes=(*OF_FRICTION, "spring in a joint"), shape=("rubbing", _add_friction)),
    Bench("ur5", "reach", "pinocchio", causes=OF_FORCES, shape=("sprung", _add_springs_and_force)),
    Bench(
        "andrews_squeezer",
        "turn",
        "pinocchio",
        causes=(*OF_SPRINGS, *OF_CLOSURES),
        shape=("with a damper", _add_spring_dampers),
    ),
    Bench("geared_four_bar", "turn", "mujoco", causes=(*OF_GEARS, *OF_CLOSURES)),
    Bench("five_bar_redundant", "reach", "pinocchio", causes=("weight of a drive",)),
    Bench("panda", "pick", "mujoco"),
    Bench("panda", "pick", "exudyn", causes=OF_INERTIA, motion=QUICK, more=("sign of products of inertia",)),
    Bench("talos_arm", "wave", "pinocchio"),
    Bench("talos", "squat", "pinocchio", causes=OF_THE_BASE),
    Bench("four_bar", "turn", "mujoco", more=("closure point misplaced",)),
    Bench(
        "four_bar", "turn", "pinocchio", causes=("closure frame turned",), shape=("holding a tool", _add_closure_tools)
    ),
    Bench("five_bar", "reach", "pinocchio", more=("closure point misplaced", SINGLE)),
    Bench("bricard", "fold", "pinocchio"),
    Bench("flex_one_link", "cycloid", "exudyn-ge", COARSE, steps=8),
    Bench("flex_one_link", "bang_bang", "exudyn-ge", FINE, OF_WAVES, steps=20, motion=FLICK),
    Bench(
        "flex_one_link", "bang_bang", "exudyn-ge", FINE, SLID, steps=20, motion=FLICK, shape=("loaded", _add_beam_loads)
    ),
    Bench("flex_one_link", "bang_bang", "exudyn-ge", FINE, OF_SECTIONS, steps=20, motion=SNAP, shape=STOUT),
    Bench("flex_two_link", "cycloid", "exudyn-ge", FINE, ("density",), steps=20, motion=SNAP, shape=STOUT),
    Bench("flex_one_link", "cycloid", "exudyn-ge", FINE, ("curvature dropped",), steps=8, shape=ARC),
    Bench("flex_one_link", "cycloid", "exudyn-ge", COARSE, ("wall thickness",), steps=8, shape=TUBE),
    Bench("flex_one_link_damped", "cycloid", "exudyn-ge", COARSE, OF_DAMPING, steps=8),
    Bench("flex_two_link", "cycloid", "exudyn-ge", FINE, ("initial curvature",), steps=8),
    Bench("flex_two_link", "cycloid", "exudyn-ancf", COARSE, steps=8, more=(*OF_MATERIAL, *OF_CLAMPS)),
    Bench("spatial_arm", "reach", "exudyn-ge", COARSE, more=(*OF_MATERIAL, *OF_CLAMPS)),
    Bench("meshed_arm", "reach", "exudyn-ge", COARSE, OF_MESHES, steps=8),
)
