"""What a mechanism is: links, joints, bodies and sections as frozen data, nothing computed.

A mechanism is a tree, which closures may tie into loops.  Every link hangs on one joint; the joint's parent is another
link or ``"world"``.  The link frame sits at that joint.  A rigid link is a set of bodies; a beam link is a Timoshenko beam whose
undeformed axis starts at ``beam.placement`` (in the link frame) and runs along local x, plus bodies at its stations.

Everything here is *primary data* (lengths, masses, moduli, axes): other engines' models are built from these
same numbers by their own code.  SI units, radians, right-handed frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexinv.drive import Drive as Drive
from flexinv.errors import InputError

Array = NDArray[np.float64]
WORLD = "world"

# joint kind -> names of its configuration coordinates (q) and of its velocity coordinates (v).
# The layout is Pinocchio's: a continuous joint is (cos, sin), a rotation is a quaternion x, y, z, w,
# a free joint is position then quaternion, and its velocity is linear then angular, in the child's frame.
COORDINATES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "fixed": ((), ()),
    "revolute": (("",), ("",)),
    "prismatic": (("",), ("",)),
    "continuous": ((".cos", ".sin"), ("",)),
    "universal": ((".1", ".2"), (".1", ".2")),
    "spherical": ((".qx", ".qy", ".qz", ".qw"), (".wx", ".wy", ".wz")),
    "free": (
        (".x", ".y", ".z", ".qx", ".qy", ".qz", ".qw"),
        (".vx", ".vy", ".vz", ".wx", ".wy", ".wz"),
    ),
}


@dataclass(frozen=True)
class Placement:
    """A frame B in a frame A: ``x_A = position + rotation @ x_B``.

    position : (3,) [m]; rotation : (3, 3) [-], R_AB
    """

    position: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Inertia:
    """Mass, centre of mass and inertia tensor of a rigid body.

    mass : scalar [kg]; com : (3,) [m], in the frame that carries the body
    tensor : (3, 3) [kg m^2], about the centre of mass, along that frame's axes
    """

    mass: float
    com: Array = field(default_factory=lambda: np.zeros(3))
    tensor: Array = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True)
class Body:
    """A rigid body carried by a link: the link itself, a payload, a flange, a motor.

    station : None on a rigid link (the frame is the link frame); on a beam the fraction 0..1 of the length
        whose cross-section frame carries the body (0 the root, 1 the tip)
    """

    name: str
    inertia: Inertia
    station: float | None = None


@dataclass(frozen=True)
class Section:
    """Stiffness and inertia per length along a beam, linear between the stations (one station: uniform).

    stations : (n,) [-], fraction 0..1 of the length, increasing
    stiffness : (n, 6): EA [N], GA_y [N], GA_z [N], GJ [N m^2], EI_y [N m^2], EI_z [N m^2]
        (shear stiffness with the shear factor already in it; EI_z bends the beam in its x-y plane)
    mass_per_length : (n,) [kg/m]
    rotary_inertia : (n, 3) [kg m]: rho I about x (polar), y, z
    damping : (n, 6) [N s], [N m^2 s]: stress by rate of strain, in the order of ``stiffness``; None: none
    """

    stations: Array
    stiffness: Array
    mass_per_length: Array
    rotary_inertia: Array
    damping: Array | None = None


@dataclass(frozen=True)
class Beam:
    """A geometrically exact Timoshenko beam.

    length : scalar [m], arc length; section : Section along it
    elements : number of finite elements; order : polynomial order of each (1 is the paper's element)
    curvature : (3,) [1/m], initial twist, curvature about y and about z, constant along the length
    placement : root cross-section frame in the link frame; the axis leaves along local x
    """

    length: float
    section: Section
    elements: int = 1
    order: int = 4
    curvature: Array = field(default_factory=lambda: np.zeros(3))
    placement: Placement = field(default_factory=Placement)


@dataclass(frozen=True)
class Link:
    """One member of the mechanism: rigid when ``beam`` is None.

    tip : (3,) [m], the point of a rigid link (link frame) whose motion is reported; a beam reports its end
    """

    name: str
    bodies: tuple[Body, ...] = ()
    beam: Beam | None = None
    tip: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Limits:
    """What the drive of a joint can give; infinite when not stated.

    effort : [N m] or [N]; velocity : [rad/s] or [m/s]; lower, upper : [rad] or [m]
    """

    effort: float = np.inf
    velocity: float = np.inf
    lower: float = -np.inf
    upper: float = np.inf


@dataclass(frozen=True)
class Joint:
    """The joint that carries ``child``; its frame is ``placement`` in the frame of ``parent``.

    kind : a key of ``COORDINATES``
    station : on a beam parent the fraction 0..1 of the length whose section frame carries the joint, else None
    axis : (3,) [-], unit, in the joint frame (first axis of a universal joint); second_axis : (3,), universal
    rotor_inertia : [kg m^2] or [kg], reflected to the joint; damping : [N m s/rad] or [N s/m];
    friction : [N m] or [N], dry: one number, the same for every velocity coordinate of the joint
    stiffness : [N m/rad] or [N/m] of a spring in the joint, without effort at ``rest`` [rad] or [m] (scalar joints)
    actuated : False leaves the joint to the dynamics, or its effort to ``Solution.unactuated``
    weight : [-] of the square of its effort where drives are redundant: the minimum of sum weight tau^2 is taken
    drive : motor, gear and elastic joint (`drives`)
    """

    name: str
    kind: str
    parent: str
    child: str
    placement: Placement = field(default_factory=Placement)
    station: float | None = None
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    second_axis: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    rotor_inertia: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    actuated: bool = True
    weight: float = 1.0
    limits: Limits = field(default_factory=Limits)
    drive: Drive | None = None

    @property
    def nq(self) -> int:
        """Number of configuration coordinates [-]."""
        return len(COORDINATES[self.kind][0])

    @property
    def nv(self) -> int:
        """Number of velocity coordinates [-]."""
        return len(COORDINATES[self.kind][1])


# closure kind -> number of constraints that it puts on the relative motion of its two frames
CLOSURES: dict[str, int] = {
    "fixed": 6,
    "revolute": 5,
    "prismatic": 5,
    "cylindrical": 4,
    "universal": 4,
    "spherical": 3,
    "point-on-line": 2,
    "coupling": 1,
}

# Joints that a coupling may tie: those whose coordinate is one number that counts whole turns.
COUPLED = ("revolute", "prismatic")


@dataclass(frozen=True)
class Attachment:
    """A frame on a link (or on the world): ``placement`` in the link frame, or in a beam's section at ``station``."""

    link: str
    placement: Placement = field(default_factory=Placement)
    station: float | None = None


@dataclass(frozen=True)
class Closure:
    """A joint that closes a loop: it ties the second frame to the first as a joint of its kind would; or a gear between joints.

    kind : a key of ``CLOSURES``; factors, offset : of a coupling, which ties coordinates of revolute and prismatic joints and
        no frames (both on the world): sum factor q = offset, joint names and factors [-], [rad/m]; offset [rad] or [m]
    axis : (3,) [-], unit, in both frames: the free axis of a revolute, prismatic or cylindrical closure, the line of
        point-on-line (in the first frame), the axis of a universal closure that stays with the first frame
    second_axis : (3,) [-], universal: the axis that stays with the second frame
    active : intervals (start, end) [s] in which it acts; empty: always
    capture : it ties the frames where they stand when it begins to act, as a hand that grasps; False: they must have met
    impact : what happens when it begins to act on frames that move against each other: a key of ``IMPACTS``
    """

    name: str
    kind: str
    first: Attachment
    second: Attachment
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    second_axis: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    active: tuple[tuple[float, float], ...] = ()
    capture: bool = False
    impact: str = "error"
    factors: tuple[tuple[str, float], ...] = ()
    offset: float = 0.0


# What a closure does that begins to act on frames in relative motion: refuse, or stop it at once (perfectly plastic).
IMPACTS = ("error", "plastic")


@dataclass(frozen=True)
class Spring:
    """A spring and damper between two points: it pulls with  stiffness (l - rest) + damping l'  along their line.

    stiffness : [N/m]; rest : [m], length without force; damping : [N s/m]
    """

    name: str
    first: Attachment
    second: Attachment
    stiffness: float
    rest: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True)
class Force:
    """A force and a moment on a point of a link, constant or linear between the rows of a table.

    wrench : (n, 6) force [N] then moment [N m]; time : (n,) [s], one row and time 0 for a constant one
    follower : axes of the attachment's frame, which move with the link; else world axes
    """

    name: str
    at: Attachment
    wrench: Array
    time: Array = field(default_factory=lambda: np.zeros(1))
    follower: bool = False


@dataclass(frozen=True, eq=False)  # identity: a mechanism is the key under which its mesh is kept
class Mechanism:
    """A tree of links and joints under gravity; ``joints`` is ordered depth-first, parents before children.

    closures : what ties links of the tree into loops; springs, forces : what else acts on them
    gravity : (3,) [m/s^2], world frame
    urdf : the URDF file the mechanism came from, if any (an engine with a URDF parser of its own reads it again)
    packages : folders in which ``package://`` paths of that URDF are looked up
    notes : what a reader of results must know (mimic joints made independent, massless links, ...)
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    closures: tuple[Closure, ...] = ()
    springs: tuple[Spring, ...] = ()
    forces: tuple[Force, ...] = ()
    title: str = ""
    source: str = ""
    urdf: Path | None = None
    packages: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()

    @cached_property
    def link_of(self) -> dict[str, Link]:
        """Links by name."""
        return {link.name: link for link in self.links}

    @cached_property
    def joint_of(self) -> dict[str, Joint]:
        """Joints by name."""
        return {joint.name: joint for joint in self.joints}

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Every frame that a closure, a spring or a force is attached to."""
        tied = (end for closure in self.closures for end in (closure.first, closure.second))
        pulled = (end for spring in self.springs for end in (spring.first, spring.second))
        return (*tied, *pulled, *(force.at for force in self.forces))

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the configuration coordinates q, in the order of every q array (Pinocchio's layout)."""
        return tuple(j.name + suffix for j in self.joints for suffix in COORDINATES[j.kind][0])

    @cached_property
    def velocity_names(self) -> tuple[str, ...]:
        """Names of the velocity coordinates, in the order of every qd, qdd and torque array."""
        return tuple(j.name + suffix for j in self.joints for suffix in COORDINATES[j.kind][1])

    @property
    def nq(self) -> int:
        """Number of configuration coordinates [-]."""
        return len(self.coordinate_names)

    @property
    def nv(self) -> int:
        """Number of velocity coordinates [-]."""
        return len(self.velocity_names)

    @cached_property
    def q_slices(self) -> dict[str, slice]:
        """Where each joint's coordinates stand in a q array."""
        return _slices([(j.name, j.nq) for j in self.joints])

    @cached_property
    def v_slices(self) -> dict[str, slice]:
        """Where each joint's coordinates stand in a qd, qdd or torque array."""
        return _slices([(j.name, j.nv) for j in self.joints])

    @cached_property
    def actuated(self) -> NDArray[np.bool_]:
        """(nv,) which velocity coordinates have an actuator."""
        return np.array([j.actuated for j in self.joints for _ in range(j.nv)], dtype=bool)

    @cached_property
    def weights(self) -> Array:
        """(nv,) weight of the square of each coordinate's effort among redundant drives [-]."""
        return np.array([j.weight for j in self.joints for _ in range(j.nv)], dtype=float)

    @cached_property
    def drive_table(self) -> Array:
        """(3, nv) rotor inertia [kg m^2], [kg], damping [N m s], [N s/m], dry friction [N m], [N] of velocity coordinates."""
        rows = [[j.rotor_inertia, j.damping, j.friction] for j in self.joints for _ in range(j.nv)]
        return np.array(rows, dtype=float).reshape(-1, 3).T

    @property
    def is_rigid(self) -> bool:
        """True when no link is a beam."""
        return all(link.beam is None for link in self.links)

    @property
    def neutral(self) -> Array:
        """(nq,) configuration [rad], [m] with every joint at zero (identity quaternions, cos = 1)."""
        q = np.zeros(self.nq)
        for joint in self.joints:
            part = self.q_slices[joint.name]
            if joint.kind in ("spherical", "free"):
                q[part.stop - 1] = 1.0
            elif joint.kind == "continuous":
                q[part.start] = 1.0
        return q

    @property
    def beams(self) -> tuple[Link, ...]:
        """The flexible links, in the order of the mechanism."""
        return tuple(link for link in self.links if link.beam is not None)

    def refined(self, elements: int = 1, order: int = 0) -> Mechanism:
        """Return the mechanism with ``elements`` times as many elements, each ``order`` higher [-]."""
        return self._with_beams(lambda b: replace(b, elements=b.elements * elements, order=b.order + order))

    def with_mesh(self, elements: int, order: int) -> Mechanism:
        """Return the mechanism with every beam meshed by ``elements`` elements of ``order`` [-]."""
        if elements < 1 or order < 1:
            raise InputError(f"a mesh needs elements >= 1 and order >= 1, not {elements} and {order}")
        return self._with_beams(lambda b: replace(b, elements=elements, order=order))

    def _with_beams(self, change: Callable[[Beam], Beam]) -> Mechanism:
        links = tuple(link if link.beam is None else replace(link, beam=change(link.beam)) for link in self.links)
        return replace(self, links=links)


def _slices(sizes: list[tuple[str, int]]) -> dict[str, slice]:
    ends = np.cumsum([0] + [n for _, n in sizes])
    return {name: slice(int(a), int(b)) for (name, _), a, b in zip(sizes, ends, ends[1:], strict=False)}
