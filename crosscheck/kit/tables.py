"""The files of a case kit and of its answer as tables: ``case.json``, ``certificate.json``, ``meta.json``.

Everything is in SI units and radians.  A rotation of a frame is the matrix whose columns are its axes in the frame before it.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer

FORMAT: Literal["crosscheck-case/1"] = "crosscheck-case/1"
LONGEST = 4000  # [characters] of a text in an answer
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Row = Annotated[list[float], Field(min_length=6, max_length=6)]
SixBySix = Annotated[list[Row], Field(min_length=6, max_length=6)]
Words = Annotated[str, Field(max_length=LONGEST)]
Side = Literal["first", "second"]
JointKind = Literal["fixed", "revolute", "continuous", "prismatic", "helical", "universal", "spherical", "free"]
ClosureKind = Literal[
    "fixed", "revolute", "prismatic", "cylindrical", "universal", "spherical", "point-on-line", "coupling"
]
Impact = Literal["error", "plastic"]
Tie = Literal["rigid", "average"]
LawData = dict[str, Any]  # of one of two forms, which the schema says in words


def describe_key(words: str, **rules: Any) -> Any:
    """Declare a key of a table by its meaning [unit]."""
    return Field(description=words, **rules)


class Data(BaseModel):
    """A JSON object: no key is ignored, every number is finite."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, defer_build=True)


class Frame(Data):
    """A frame in another one: x_outer = position + rotation x_inner."""

    position: Vector = describe_key("origin [m]")
    rotation: Matrix = describe_key("rotation matrix by rows; its columns are the axes of the frame [-]")


class Sparing(Data):
    """A JSON object whose keys for meshed links are only there where there are any: others read as they always did."""

    @model_serializer(mode="wrap")
    def _drop_empty_keys(self, convert: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the keys of the table without those of meshed links that say nothing."""
        plain: dict[str, Any] = convert(self)
        return {key: value for key, value in plain.items() if value or key not in ("interface", "part")}


class BodyData(Sparing):
    """A rigid body that a link carries."""

    name: str
    station: float | None = describe_key(
        "on a beam the fraction 0..1 of its length, in whose section frame it is stated; else null"
    )
    interface: str = describe_key("on a meshed link the interface in whose frame it is stated", default="")
    mass: float = describe_key("[kg]")
    com: Vector = describe_key("centre of mass in the link frame (or section frame) [m]")
    inertia: Matrix = describe_key("about the centre of mass, along the axes of the same frame [kg m^2]")


class SectionData(Data):
    """Section of a beam along its length, linear between the stations (one station: uniform); forces in the section frame.

    A coupled section has matrices and leaves all other numbers empty, so that no program takes a diagonal for the whole.
    """

    station: list[float] = describe_key("fractions 0..1 of the length [-]")
    EA: list[float] = describe_key("axial stiffness [N]")
    GA_y: list[float] = describe_key("shear stiffness along y, shear factor included [N]")
    GA_z: list[float] = describe_key("shear stiffness along z, shear factor included [N]")
    GJ: list[float] = describe_key("torsional stiffness [N m^2]")
    EI_y: list[float] = describe_key("bending stiffness about y [N m^2]")
    EI_z: list[float] = describe_key("bending stiffness about z: bends the beam in its x-y plane [N m^2]")
    rho_A: list[float] = describe_key("mass per length [kg/m]")
    rho_I_x: list[float] = describe_key("rotary inertia per length about x [kg m]")
    rho_I_y: list[float] = describe_key("rotary inertia per length about y [kg m]")
    rho_I_z: list[float] = describe_key("rotary inertia per length about z [kg m]")
    damping: list[Row] = describe_key(
        "stress by rate of strain, in the order EA, GA_y, GA_z, GJ, EI_y, EI_z [N s], [N m^2 s], one row per station; "
        "empty: none"
    )
    stiffness_matrix: list[SixBySix] = describe_key(
        "of a coupled section, whose EA, GA, GJ, EI, rho_A, rho_I and damping are empty then: stress by strain in the same "
        "order [N], [N m], [N m^2], one matrix per station",
        default_factory=list,
    )
    mass_matrix: list[SixBySix] = describe_key(
        "of a coupled section: momentum by velocity, translations along x, y, z then rotations, about the beam's axis "
        "[kg/m], [kg], [kg m], one matrix per station",
        default_factory=list,
    )
    damping_matrix: list[SixBySix] = describe_key(
        "of a coupled section: stress by rate of strain [N s], [N m s], [N m^2 s], one matrix per station; empty: none",
        default_factory=list,
    )

    @model_serializer(mode="wrap")
    def _drop_empty_matrices(self, convert: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the keys of the table; matrices only where there are any, so that other sections read as they always did."""
        plain: dict[str, Any] = convert(self)
        return {key: value for key, value in plain.items() if value or not key.endswith("_matrix")}


class BeamData(Data):
    """A geometrically exact Timoshenko beam along the local x axis of its root frame."""

    length: float = describe_key("arc length [m]")
    root: Frame = describe_key("frame of the root section in the link frame")
    curvature: Vector = describe_key("initial twist, curvature about y and about z, constant along the length [1/m]")
    section: SectionData
    elements: int = describe_key("a hint: elements of the reference's mesh [-]")
    order: int = describe_key("a hint: polynomial order of each of them [-]")


class InterfaceData(Data):
    """A set of points of a mesh that is tied to a frame, whose axes are those of the link."""

    name: str
    origin: Vector = describe_key("of its frame in the link frame [m]")
    tie: Tie = describe_key(
        "rigid (RBE2): its points follow the frame; average (RBE3): the frame moves as they do on average"
    )


class CellsData(Data):
    """Cells of one kind and material."""

    kind: str = describe_key("tetra, tetra10, hexahedron, hexahedron20, hexahedron27, wedge; points in VTK's order")
    stiffness: SixBySix = describe_key("stress by strain, xx, yy, zz, yz, xz, xy, shears as angles [Pa]")
    density: float = describe_key("[kg/m^3]")
    name: str = describe_key("of the set")


class PartData(Data):
    """The finite-element mesh of a link: its root interface moves with the link frame, all the rest deforms a little."""

    arrays: str = describe_key("archive of its arrays, from the folder of this file")
    digest: str = describe_key("of these arrays")
    interfaces: list[InterfaceData]
    root: str = describe_key("the interface that moves with the link frame")
    tip: str = describe_key("the interface whose origin is series tip/LINK")
    cells: list[CellsData] = describe_key("empty where the matrices are all that is known")
    modes: int = describe_key("a hint: vibration modes of the reference beside six static shapes an interface [-]")
    frequency: float = describe_key("a hint: in place of a number, all modes up to this one [Hz]; 0: none")
    retardation: float = describe_key("damping: stiffness matrix times this [s]")
    drag: float = describe_key("damping: mass matrix times this [1/s], of the deformation alone")
    stiffening: bool = describe_key("true: loads along the part stiffen it against bending (geometric stiffness)")
    lumped: bool = describe_key("true: the mass of linear cells is in their points alone")


class LinkData(Sparing):
    """A link; its frame is the frame of the joint that carries it, moved by the joint."""

    name: str
    bodies: list[BodyData]
    beam: BeamData | None = describe_key("null: a rigid link, or a mesh")
    part: PartData | None = describe_key("the mesh of a link of any shape", default=None)
    tip: Vector = describe_key("point of a rigid link whose motion is series tip/LINK [m]; a beam reports its end")


class JointData(Sparing):
    """A joint: parent and child, where its frame is on the parent, and what its drive carries."""

    name: str
    kind: JointKind
    parent: str = describe_key("a link, or world")
    child: str
    frame: Frame = describe_key(
        "joint frame in the frame of the parent link (on a beam: of its section at the station)"
    )
    station: float | None = describe_key("on a beam parent the fraction 0..1 of its length; else null")
    interface: str = describe_key(
        "on a meshed parent the interface in whose frame the joint frame is stated", default=""
    )
    axis: Vector = describe_key("in the joint frame [-]")
    second_axis: Vector = describe_key("of a universal joint, which turns with the first axis [-]")
    pitch: float = describe_key(
        "of a helical joint: its way along the axis for a whole turn about it, below 0 where left-handed [m]"
    )
    rotor_inertia: float = describe_key("reflected to the joint: adds rotor_inertia qdd to the effort [kg m^2], [kg]")
    damping: float = describe_key("adds damping qd [N m s/rad], [N s/m]")
    friction: float = describe_key("adds friction sign(qd), nothing at rest [N m], [N]")
    stiffness: float = describe_key("adds stiffness (q - rest) [N m/rad], [N/m]")
    rest: float = describe_key("where the joint's spring has no effort [rad], [m]")
    actuated: bool = describe_key(
        "false: no drive, no effort; but a joint of an open tree that moves as given all the same (a free base) has the effort "
        "that would hold it"
    )
    weight: float = describe_key(
        "of the square of its effort where drives are redundant: sum weight tau^2 is the least [-]"
    )
    q: list[str] = describe_key("names of its coordinates")
    v: list[str] = describe_key("names of its velocities, which efforts belong to")


class End(Sparing):
    """A frame on a link or on the world."""

    link: str
    station: float | None = describe_key("on a beam the fraction 0..1 of its length; else null")
    interface: str = describe_key("on a meshed link the interface in whose frame this one is stated", default="")
    frame: Frame


class ClosureData(Data):
    """A joint that closes a loop: it ties the second frame to the first as a joint of its kind would."""

    name: str
    kind: ClosureKind
    first: End
    second: End
    axis: Vector = describe_key(
        "in both frames: the free axis, or the line (of the first frame) on which a point stays [-]"
    )
    second_axis: Vector = describe_key("of a universal closure, stays with the second frame [-]")
    active: list[Annotated[list[float], Field(min_length=2, max_length=2)]] = describe_key(
        "intervals in which it acts [s]; empty: always"
    )
    capture: bool = describe_key("true ties the frames where they stand when it begins to act")
    impact: Impact = describe_key("plastic: stops frames that move against each other when it begins to act")
    factors: dict[str, float] = describe_key("of a coupling: sum factor q = offset, by joint [-], [rad/m]")
    offset: float = describe_key("of a coupling [rad], [m]")


class SpringData(Data):
    """A spring and damper between two points: pulls with stiffness (l - rest) + damping dl/dt along their line."""

    name: str
    first: End
    second: End
    stiffness: float = describe_key("[N/m]")
    rest: float = describe_key("length without force [m]")
    damping: float = describe_key("[N s/m]")
    law: LawData | None = describe_key(
        "null: linear.  gas: pull force / (1 - (l - rest) / travel)^exponent in the place of stiffness (l - rest), "
        "force [N], travel [m], exponent [-]; table: length [m] and force [N], monotone cubics (PCHIP), straight beyond"
    )


class ForceData(Data):
    """A given force and moment on a point of a link, linear between its times."""

    name: str
    at: End
    time: list[float] = describe_key("[s]; one row: constant")
    wrench: list[Annotated[list[float], Field(min_length=6, max_length=6)]] = describe_key(
        "force [N], then moment [N m]"
    )
    follower: bool = describe_key("true: along the axes of the frame, which moves with the link; false: world axes")


class MechanismData(Data):
    """The mechanism, every default written out."""

    name: str
    title: str
    source: str
    gravity: Vector = describe_key("in the world frame [m/s^2]")
    links: list[LinkData]
    joints: list[JointData] = describe_key("depth-first, parents before children: the order of all coordinates")
    closures: list[ClosureData]
    springs: list[SpringData]
    forces: list[ForceData]
    notes: list[str]


class Coordinate(Data):
    """A coordinate or a velocity: its unit, and whether the motion gives it."""

    name: str
    unit: str
    given: bool = describe_key("true: a column of motion.csv; false: the mechanism finds it")


class Velocity(Coordinate):
    """A velocity, and the effort that belongs to it."""

    acceleration_unit: str
    effort_unit: str
    actuated: bool


class Asked(Data):
    """One quantity that is compared, and the series it consists of."""

    quantity: str
    series: dict[str, str] = describe_key("name -> unit; of quantities that an answer leaves out nothing is compared")
    meaning: str


class CaseData(Data):
    """The motion, the times, and what is compared."""

    name: str
    title: str
    source: str
    notes: list[str]
    step: float = describe_key("step of a time integration, and spacing of motion.csv where one is needed [s]")
    sample: float = describe_key("spacing of the answer [s]")
    end: float = describe_key("[s]")
    samples: int = describe_key("rows of the answer: 0, sample, ..., end")
    integrated: bool = describe_key("true: beams, or joints without a motion, have to be integrated in time")
    spectral_radius: float = describe_key("a hint: of the reference's time integration (generalised alpha) [-]")
    initial: Literal["consistent", "static"] = describe_key(
        "consistent: beams begin undeformed; static: in equilibrium under gravity and all loads, at rest"
    )
    start: dict[str, list[float]] = describe_key(
        "coordinates at time 0 of joints without a motion [rad], [m]; in a loop a guess that selects the branch"
    )
    jumps: list[float] = describe_key("times at which accelerations jump; motion.csv has the value after the jump [s]")
    refinement: int = describe_key("1; 2 and 4 ask the same with so many times finer steps and meshes, for error bars")
    coordinates: list[Coordinate] = describe_key("q, in order")
    velocities: list[Velocity] = describe_key("qd, qdd and efforts, in order")
    asked: list[Asked]


class CaseFile(Data):
    """``case.json``: everything about one comparison."""

    format: Literal["crosscheck-case/1"]
    digest: str = describe_key(
        "of the rest of this file; meta.json may repeat it, so that an answer is not taken for another's"
    )
    mechanism: MechanismData
    case: CaseData


class CertificateFile(Data):
    """``certificate.json``: what a model says of itself, at the configurations of ``probe.csv``; every key may be left out."""

    mass: float | None = describe_key("of all that moves [kg]", default=None)
    masses: dict[str, float] = describe_key(
        "by joint with a freedom: of all that it carries up to the next one [kg]", default_factory=dict
    )
    moments: dict[str, Vector] = describe_key(
        "of the same: first moment m c about the origin of the joint's child, along its axes [kg m]",
        default_factory=dict,
    )
    inertias: dict[str, Matrix] = describe_key(
        "of the same: about the origin of the joint's child [kg m^2]", default_factory=dict
    )
    beam_masses: dict[str, float] = describe_key("of straight beams alone [kg]", default_factory=dict)
    beam_moments: dict[str, float] = describe_key("about the root, along the axis [kg m]", default_factory=dict)
    com: list[Vector] | None = describe_key(
        "centre of mass of all that moves, one row per configuration [m]", default=None
    )
    mass_matrix: list[list[list[float]]] | None = describe_key(
        "joint-space mass matrix of the tree without closures, rotor inertia included [kg m^2], [kg]", default=None
    )
    gravity: list[list[float]] | None = describe_key(
        "efforts that hold the tree still, without springs and closures [N m], [N]", default=None
    )
    torque_by_place: list[list[list[float]]] | None = describe_key(
        "derivatives of the efforts of the tree by q, without springs, damping and rotors, at the rates and accelerations of "
        "probe_rates.csv [N m/rad], [N/m]",
        default=None,
    )
    torque_by_rate: list[list[list[float]]] | None = describe_key("the same by qd [N m s/rad], [N s/m]", default=None)
    axes: dict[str, list[Vector]] = describe_key(
        "by joint with one velocity: its axis in the world, one row per configuration [-]", default_factory=dict
    )
    order: list[str] = describe_key("joints with a freedom, in the order of the program", default_factory=list)
    stiffness: dict[str, float] = describe_key(
        "'LINK: EI_z' and so on, length over compliance [N], [N m^2]", default_factory=dict
    )
    part_stiffness: dict[str, float] = describe_key(
        "of meshed links held at the root, 'LINK: INTERFACE x' to 'rz': load over motion of the interface [N/m], [N m/rad]",
        default_factory=dict,
    )
    part_frequencies: dict[str, float] = describe_key(
        "of meshed links with twice their modes, 'LINK: held 1' and so on, held at the root; 'LINK: free 1', held nowhere [Hz]",
        default_factory=dict,
    )
    damping: dict[str, float] = describe_key("by joint [N m s/rad], [N s/m]", default_factory=dict)
    friction: dict[str, float] = describe_key("by joint [N m], [N]", default_factory=dict)
    springs: dict[str, float] = describe_key("'NAME: stiffness', 'NAME: rest', 'NAME: damping'", default_factory=dict)
    closure_points: dict[str, Vector] = describe_key(
        "'NAME: first', 'NAME: second': point on the link [m]", default_factory=dict
    )
    closure_axes: dict[str, Vector] = describe_key(
        "'NAME: first', 'NAME: second': axis on the link [-]", default_factory=dict
    )
    residual: float | None = describe_key("largest closure equation in the program's own motion [m], [-]", default=None)
    rank: int | None = describe_key("independent equations of the closures at the start", default=None)


class MetaFile(Data):
    """``meta.json``: what made an answer; every key may be left out."""

    tool: Words = describe_key("program or machine", default="")
    version: Words = describe_key("its version", default="")
    case: Words = describe_key("the digest of case.json that was answered", default="")
    mechanism: Words = describe_key("name of the mechanism that was answered", default="")
    name: Words = describe_key("name of the case that was answered", default="")
    formulation: Words = describe_key("method, in a line", default="")
    step: float | None = describe_key("[s]", default=None)
    mesh: Words = describe_key("of beams", default="")
    wall_time: Annotated[float, Field(ge=0)] = describe_key("of the computation alone [s]", default=0.0)
    skipped: Words = describe_key("why this case cannot be answered: then no series is expected", default="")
    notes: Words = describe_key("what a reader of results must know", default="")
