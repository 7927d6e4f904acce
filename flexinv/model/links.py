"""Links and frames on them as frozen data: rigid links are sets of bodies, flexible ones beams with bodies at their stations.

A beam link is a Timoshenko beam whose undeformed axis starts at ``beam.placement`` (in the link frame) and runs along local x.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from flexinv.errors import InputError
from flexinv.model import rules
from flexinv.model import section_matrices as matrices
from flexinv.model.frozen import Frozen
from flexinv.model.part import MeshedPart
from flexinv.typing import Array

WORLD = "world"


@dataclass(frozen=True, eq=False)
class Placement(Frozen):
    """A frame B in a frame A: ``x_A = position + rotation @ x_B``, position (3,) [m], rotation R_AB (3, 3) [-]."""

    position: Array = field(default_factory=lambda: rules.ORIGIN)
    rotation: Array = field(default_factory=lambda: rules.IDENTITY)

    RULES: ClassVar[rules.Rules] = {"position": rules.make_array_rule((3,), "m"), "rotation": rules.check_rotation}


STATION = rules.make_optional_rule(rules.make_real_rule("-", 0.0, most=1.0))


@dataclass(frozen=True, eq=False)
class Attachment(Frozen):
    """A frame on a link (or on the world): ``placement`` in the link frame, or in a beam's section at ``station``.

    interface : the one of a meshed link in whose frame the placement is; "" for the link frame
    """

    link: str
    placement: Placement = field(default_factory=Placement)
    station: float | None = None
    interface: str = ""

    RULES: ClassVar[rules.Rules] = {
        "link": rules.check_text,
        "placement": rules.make_kind_rule(Placement),
        "station": STATION,
        "interface": rules.check_text,
    }


# Relative to the largest moment: files carry about seven digits, so a thin plate's xx + yy = zz is met to 1e-6.
DIGITS = 1e-6


def describe_impossible_inertia(tensor: Array, unit: str = "kg m^2") -> str:
    """Return the reason against an inertia (3, 3) [kg m^2], or per length [kg m], ``""`` for one that a body can have.

    It is symmetric, its principal moments are p >= 0 and p_i + p_j >= p_k.
    """
    if (largest := float(np.abs(tensor).max())) == 0.0:
        return ""
    if np.abs(tensor - tensor.T).max() > DIGITS * largest:
        return "it is not symmetric"
    moments = np.linalg.eigvalsh(tensor)
    text = ", ".join(f"{p:.4g}" for p in moments)
    if moments[0] < -DIGITS * largest:
        return f"a principal moment is negative ({text} {unit})"
    if moments[0] + moments[1] < moments[2] * (1 - DIGITS):
        return f"one principal moment exceeds the sum of the others ({text} {unit})"
    return ""


@dataclass(frozen=True, eq=False)
class Inertia(Frozen):
    """Mass, centre of mass and inertia tensor of a rigid body.

    mass : scalar [kg]; com : (3,) [m], in the frame that carries the body
    tensor : (3, 3) [kg m^2], about the centre of mass, along that frame's axes
    Raises InputError for what no body can have; `stated` and `restated` take it over from somebody else's file.
    """

    mass: float
    com: Array = field(default_factory=lambda: np.zeros(3))
    tensor: Array = field(default_factory=lambda: np.zeros((3, 3)))

    RULES: ClassVar[rules.Rules] = {
        "mass": rules.make_real_rule("kg"),
        "com": rules.make_array_rule((3,), "m"),
        "tensor": rules.make_array_rule((3, 3), "kg m^2"),
    }

    def _check(self, where: str) -> None:
        if self.mass < 0.0:
            raise InputError(f"{where}mass = {self.mass:g}: expected a mass, 0 or more [kg]; write {-self.mass:g}")
        if reason := describe_impossible_inertia(self.tensor):
            expected = "the inertia of a body about its centre of mass [kg m^2]: symmetric, moments p1 + p2 >= p3 >= 0"
            advice = "the tensor about the centre of mass, not about the joint; check signs and order of its numbers"
            raise InputError(f"{where}tensor = {self.tensor.tolist()}: {reason}; expected {expected}; write {advice}")

    @classmethod
    def build_unchecked(cls, mass: float, com: Array | None = None, tensor: Array | None = None) -> Inertia:
        """Return finite numbers [kg], [m], [kg m^2] as they stand in a file, whether or not a body can have them."""
        made = object.__new__(cls)
        given = {"mass": mass, "com": np.zeros(3) if com is None else com}
        given["tensor"] = np.zeros((3, 3)) if tensor is None else tensor
        for name, value in given.items():
            object.__setattr__(made, name, cls.RULES[name](f"Inertia: {name}", value))
        return made

    def replace_unchecked(
        self, mass: float | None = None, com: Array | None = None, tensor: Array | None = None
    ) -> Inertia:
        """Return it with other numbers [kg], [m], [kg m^2], whether or not a body can have them."""
        place = self.com if com is None else com
        moments = self.tensor if tensor is None else tensor
        return Inertia.build_unchecked(self.mass if mass is None else mass, place, moments)


# What a body is called that stands in place of the one that a URDF states for its link.
REPLACED = "in place of the URDF's own"


@dataclass(frozen=True, eq=False)
class Body(Frozen):
    """A rigid body carried by a link: the link itself, a payload, a flange, a motor.

    station : None in the link frame; on a beam the fraction 0..1 of the length whose section frame carries the body
    interface : of a meshed link, whose frame carries the body; "" for the link frame
    """

    name: str
    inertia: Inertia
    station: float | None = None
    interface: str = ""

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text,
        "inertia": rules.make_kind_rule(Inertia),
        "station": STATION,
        "interface": rules.check_text,
    }


@dataclass(frozen=True, eq=False)
class Section(Frozen):
    """Stiffness and inertia per length along a beam, linear between the stations (one station: uniform).

    stations : (n,) [-], fraction 0..1 of the length, increasing; where two are equal the section steps
    stiffness : (n, 6): EA [N], GA_y [N], GA_z [N], GJ [N m^2], EI_y [N m^2], EI_z [N m^2]
        (shear stiffness with the shear factor already in it; EI_z bends the beam in its x-y plane)
        or coupled, (n, 6, 6) [N], [N m], [N m^2]: stress resultants by strains, symmetric and positive definite, in that order
    mass_per_length : (n,) [kg/m]
    rotary_inertia : (n, 3) [kg m]: rho I about x (polar), y, z; or (n, 3, 3); about the mass centre
    damping : (n, 6) [N s], [N m^2 s]: stress by rate of strain, in the order of ``stiffness``; or (n, 6, 6); None: none
    mass_centre : (n, 2) [m]: y and z of the mass centre from the axis; None: on the axis
    """

    stations: Array
    stiffness: Array
    mass_per_length: Array
    rotary_inertia: Array
    damping: Array | None = None
    mass_centre: Array | None = None

    RULES: ClassVar[rules.Rules] = {
        "stations": rules.make_array_rule((None,), "-", least=0.0),
        "stiffness": matrices.make_section_rule(
            6, "N, N m^2", matrices.describe_impossible_stiffness, "a symmetric, positive definite matrix"
        ),
        "mass_per_length": rules.make_array_rule((None,), "kg/m", least=0.0),
        "rotary_inertia": matrices.make_section_rule(3, "kg m"),
        "damping": rules.make_optional_rule(
            matrices.make_section_rule(6, "N s, N m^2 s", matrices.describe_impossible_damping)
        ),
        "mass_centre": rules.make_optional_rule(rules.make_array_rule((None, 2), "m")),
    }

    def _check(self, where: str) -> None:
        count = len(self.stations)
        for name in ("stiffness", "mass_per_length", "rotary_inertia", "damping", "mass_centre"):
            rows = getattr(self, name)
            if rows is not None and len(rows) != count:
                raise InputError(f"{where}{name} has {len(rows)} rows: expected {count}, one for each station")
        gaps = np.diff(self.stations)
        thrice = (gaps[1:] <= 0.0) & (gaps[:-1] <= 0.0)  # two equal ones are a step of the section, three are nothing
        if not count or self.stations.max() > 1.0 or (gaps < 0.0).any() or thrice.any():
            given = f"{where}stations = {self.stations.tolist()}"
            expected = "one or more fractions of the length, 0 to 1, increasing, two equal ones at a step [-]"
            raise InputError(f"{given}: expected {expected}")
        for k, one in enumerate(matrices.build_full_matrices(self.rotary_inertia) if self.has_coupled_mass else ()):
            if reason := describe_impossible_inertia(one, "kg m"):
                given = f"{where}rotary_inertia[{k}] = {self.rotary_inertia[k].tolist()}"
                raise InputError(f"{given}: {reason}; expected that of a mass about its own centre, p1 + p2 >= p3 >= 0")

    @property
    def has_coupled_strains(self) -> bool:
        """True where a strain has stress of another one [-]: stiffness or damping are matrices."""
        return self.stiffness.ndim == 3 or (self.damping is not None and self.damping.ndim == 3)

    @property
    def has_coupled_mass(self) -> bool:
        """True where the mass centre is off the axis or the inertia has products [-]."""
        return self.rotary_inertia.ndim == 3 or self.mass_centre is not None

    @property
    def is_coupled(self) -> bool:
        """True where six stiffnesses, a mass and three rotary inertias do not say all of the section [-]."""
        return self.has_coupled_strains or self.has_coupled_mass

    @property
    def stiffness_matrices(self) -> Array:
        """Stiffness of every station as matrices (n, 6, 6) [N], [N m], [N m^2]."""
        return matrices.build_full_matrices(self.stiffness)

    @property
    def damping_matrices(self) -> Array:
        """Damping of every station as matrices (n, 6, 6) [N s], [N m s], [N m^2 s], zero where there is none."""
        return (
            np.zeros((len(self.stations), 6, 6)) if self.damping is None else matrices.build_full_matrices(self.damping)
        )

    @property
    def mass_matrices(self) -> Array:
        """Mass of every station about the axis, (n, 6, 6) [kg/m], [kg], [kg m], for velocities in the order of strains."""
        centre = np.zeros((len(self.stations), 2)) if self.mass_centre is None else self.mass_centre
        inertia = matrices.build_full_matrices(self.rotary_inertia)
        parts = zip(self.mass_per_length, centre, inertia, strict=True)
        return np.array([matrices.build_mass_matrix(float(m), c, j) for m, c, j in parts])

    @classmethod
    def build_from_matrices(
        cls, stations: Array, stiffness: Array, mass: Array, damping: Array | None = None
    ) -> Section:
        """Return the section of matrices (n, 6, 6) about the axis: stiffness, mass, damping; diagonal ones become numbers.

        Units: [N], [N m], [N m^2]; [kg/m], [kg], [kg m]; [N s], [N m s], [N m^2 s]; order: axial, shear y, z, twist, bending y, z
        Raises InputError for matrices that no section has: not symmetric, not positive definite, a mass out of the section.
        """
        given = rules.make_array_rule((None, 6, 6), "kg/m, kg, kg m")("Section: mass", mass)
        parts = [matrices.split_mass_matrix(one, f"Section: mass[{k}]") for k, one in enumerate(given)]
        centre = np.array([part[1] for part in parts])
        inertia = np.array([part[2] for part in parts])
        for k, one in enumerate(inertia):
            if reason := describe_impossible_inertia(one, "kg m"):
                start = f"Section: mass[{k}] = {given[k].tolist()}: about the mass centre {reason}"
                raise InputError(f"{start}; expected principal moments p1 + p2 >= p3 >= 0 there")
        return cls(
            stations,
            matrices.take_diagonals("Section: stiffness", stiffness),
            np.array([part[0] for part in parts]),
            matrices.take_diagonals("Section: rotary_inertia", inertia),
            None if damping is None else matrices.take_diagonals("Section: damping", damping),
            centre if centre.any() else None,
        )

    def evaluate_inertia(self, at: float) -> Inertia:
        """Return mass [kg/m], its centre [m] and the inertia about it [kg m] per length at a fraction of the length [-]."""
        if self.has_coupled_mass:
            table = self.mass_matrices.reshape(-1, 36)
            matrix = np.array([np.interp(at, self.stations, column) for column in table.T]).reshape(6, 6)
            mass, centre, tensor = matrices.split_mass_matrix(matrix, "Section: mass")
            return Inertia(mass, np.array([0.0, *centre]), tensor)
        rotary = [np.interp(at, self.stations, column) for column in self.rotary_inertia.T]
        return Inertia.build_unchecked(
            float(np.interp(at, self.stations, self.mass_per_length)), np.zeros(3), np.diag(rotary)
        )

    def move_axis(self, y: float, z: float, angle: float = 0.0) -> Section:
        """Return the section of the same beam about another axis: at y, z [m] of this one, turned by ``angle`` about x [rad]."""
        back = np.linalg.inv(matrices.build_axis_change(y, z, angle))
        damping = None if self.damping is None else back.T @ self.damping_matrices @ back
        stiffness, mass = (back.T @ matrix @ back for matrix in (self.stiffness_matrices, self.mass_matrices))
        return Section.build_from_matrices(self.stations, stiffness, mass, damping)

    def check_independent(self, what: str) -> Section:
        """Return itself [-] if six stiffnesses, a mass and three rotary inertias say all of it.

        Raises InputError, which names ``what`` asks, for a coupled section.
        """
        if self.is_coupled:
            given = (
                "the section is coupled (matrices of stiffness or damping, an offset mass centre, products of inertia)"
            )
            raise InputError(f"{what}: {given}; expected a section of EA, GA, GJ, EI, mass and rotary inertia")
        return self


@dataclass(frozen=True, eq=False)
class Beam(Frozen):
    """A geometrically exact Timoshenko beam.

    length : scalar [m], arc length; elements : number of finite elements; order : polynomial order of each (1 is the paper's)
    curvature : (3,) [1/m], initial twist, curvature about y and about z, constant along the length
    placement : root cross-section frame in the link frame; the axis leaves along local x
    """

    length: float
    section: Section
    elements: int = 1
    order: int = 4
    curvature: Array = field(default_factory=lambda: np.zeros(3))
    placement: Placement = field(default_factory=Placement)

    RULES: ClassVar[rules.Rules] = {
        "length": rules.make_real_rule("m", 0.0, above=True),
        "section": rules.make_kind_rule(Section),
        "elements": rules.count(1),
        "order": rules.count(1),
        "curvature": rules.make_array_rule((3,), "1/m"),
        "placement": rules.make_kind_rule(Placement),
    }


@dataclass(frozen=True, eq=False)
class Link(Frozen):
    """One member of the mechanism: rigid when ``beam`` and ``part`` are None.

    part : the mesh of a link of any shape, in the link frame
    tip : (3,) [m], the point of a rigid link (link frame) whose motion is reported; a beam reports its end, a mesh its tip
    """

    name: str
    bodies: tuple[Body, ...] = ()
    beam: Beam | None = None
    tip: Array = field(default_factory=lambda: np.zeros(3))
    part: MeshedPart | None = None

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text,
        "bodies": rules.make_list_rule(rules.make_kind_rule(Body)),
        "beam": rules.make_optional_rule(rules.make_kind_rule(Beam)),
        "tip": rules.make_array_rule((3,), "m"),
        "part": rules.make_optional_rule(rules.make_kind_rule(MeshedPart)),
    }

    @property
    def is_rigid(self) -> bool:
        """True where the link is neither a beam nor a mesh [-]."""
        return self.beam is None and self.part is None

    def check_interface(self, name: str, what: str) -> None:
        """Raise InputError for an interface [-] that the link has not; ``what`` is on it."""
        known = [] if self.part is None else list(self.part.interface_of)
        if name and name not in known:
            expected = f"one of {', '.join(known)}" if known else "no interface: it is no mesh"
            raise InputError(f"{what}: interface {name!r} on link {self.name!r}, expected {expected}")

    def _check(self, where: str) -> None:
        if self.beam is not None and self.part is not None:
            raise InputError(f"{where}beam and part: expected one of both, or none for a rigid link")
        for body in self.bodies:
            self.check_interface(body.interface, f"{where}body {body.name!r}")
            if body.station is not None and self.beam is None:
                raise InputError(
                    f"{where}body {body.name!r} has station {body.station}, expected no station: the link is rigid"
                )
