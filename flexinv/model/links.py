"""Links and frames on them as frozen data: rigid links are sets of bodies, flexible ones beams with bodies at their stations.

A beam link is a Timoshenko beam whose undeformed axis starts at ``beam.placement`` (in the link frame) and runs along local x.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexinv.typing import Array

T = TypeVar("T", bound=np.generic)
WORLD = "world"


class Frozen:
    """Base of frozen dataclasses with arrays: each instance holds copies of its own that nobody can write to.

    Meshes, solvers and prepared functions are kept for a mechanism by its identity, so it must not change.
    """

    def __post_init__(self) -> None:
        """Replace every array that can be written to by a copy that cannot."""
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray) and value.flags.writeable:
                object.__setattr__(self, name, read_only(value))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over what a pickle or a copy holds, and freeze it again."""
        self.__dict__.update(state)
        self.__post_init__()


def read_only(values: NDArray[T]) -> NDArray[T]:
    """Return a copy of an array [any unit] that cannot be written to."""
    copy = values.copy()
    copy.flags.writeable = False
    return copy


@dataclass(frozen=True)
class Placement(Frozen):
    """A frame B in a frame A: ``x_A = position + rotation @ x_B``, position (3,) [m], rotation R_AB (3, 3) [-]."""

    position: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Attachment:
    """A frame on a link (or on the world): ``placement`` in the link frame, or in a beam's section at ``station``."""

    link: str
    placement: Placement = field(default_factory=Placement)
    station: float | None = None


@dataclass(frozen=True)
class Inertia(Frozen):
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

    station : None on a rigid link (link frame); on a beam the fraction 0..1 of the length whose section frame carries the body
    """

    name: str
    inertia: Inertia
    station: float | None = None


@dataclass(frozen=True)
class Section(Frozen):
    """Stiffness and inertia per length along a beam, linear between the stations (one station: uniform).

    stations : (n,) [-], fraction 0..1 of the length, increasing; where two are equal the section steps
    stiffness : (n, 6): EA [N], GA_y [N], GA_z [N], GJ [N m^2], EI_y [N m^2], EI_z [N m^2]
        (shear stiffness with the shear factor already in it; EI_z bends the beam in its x-y plane)
    mass_per_length : (n,) [kg/m]; rotary_inertia : (n, 3) [kg m]: rho I about x (polar), y, z
    damping : (n, 6) [N s], [N m^2 s]: stress by rate of strain, in the order of ``stiffness``; None: none
    """

    stations: Array
    stiffness: Array
    mass_per_length: Array
    rotary_inertia: Array
    damping: Array | None = None


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class Link(Frozen):
    """One member of the mechanism: rigid when ``beam`` is None.

    tip : (3,) [m], the point of a rigid link (link frame) whose motion is reported; a beam reports its end
    """

    name: str
    bodies: tuple[Body, ...] = ()
    beam: Beam | None = None
    tip: Array = field(default_factory=lambda: np.zeros(3))
