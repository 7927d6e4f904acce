"""A beam as MuJoCo's flex of dimension 1: the model.

The element is points joined by edges, with a bending force at every inner point (a discrete elastic rod),

    E = sum_i EI / (2 l_i) kappa_i^2,   l_i the mean length of the two edges that meet at point i,

no shear, no rotary inertia, and points that have no orientation.  What it takes to be the beam that is meant:

* ``flexcomp`` gives every point the same mass and drops the pinned one: here every point is a body of its own with two
  slides in the section's frame, mass rho A l, half of it at both ends.
* The clamp is an edge of length GHOST l before the root, both its points in the link: the bending force at the root
  is then that of half an edge, EI / (l / 2), as the rod asks.
* Stretching is not in the elasticity of a dimension-1 flex: it comes from ``edgestiffness`` = EA / l, with its full value.
* The joints carry an armature DRIVE; the force DRIVE q'' then moves them as given, whatever the rest weighs.

Source: mujoco 4.0.0, the compiled ``flex_bending`` and ``qfrc_passive``, see tests/crosscheck/engines/mujoco/test_flex.py.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from crosscheck.engines.mujoco.joints import BuiltModel
from crosscheck.engines.mujoco.model import FLOOR, build, convert_to_quaternion
from flexinv.errors import InputError
from flexinv.model.mechanism import WORLD, Beam, Body, Inertia, Link, Mechanism

GHOST = 1e-3  # of an edge: by this fraction the clamp is softer than half an edge
DRIVE = 1e4  # [kg m^2], [kg]; the joints' accelerations are off by their effort over this, their places not at all
NO_FRAME = "a flex of dimension 1 is points without orientation"
PARALLEL = 1e-9  # [-] two directions from decimals and rotations written in a file


@dataclass(frozen=True)
class Rod:
    """The beam as MuJoCo gets it.

    beam : its data; bent : 1 or 2, see ``find_bending_axis``; tip : point mass at the end [kg]; elements : number of edges
    """

    link: str
    beam: Beam
    bent: int
    tip: float
    elements: int

    @property
    def edge(self) -> float:
        """Length of an edge [m]."""
        return self.beam.length / self.elements

    @property
    def stiffness(self) -> tuple[float, float]:
        """EA [N] and the EI [N m^2] of the plane."""
        section = self.beam.section.check_independent("MuJoCo's flex")
        ea, _, _, _, ei_y, ei_z = (float(x) for x in section.stiffness[0])
        return ea, ei_z if self.bent == 1 else ei_y

    @property
    def section(self) -> tuple[float, float]:
        """Radius [m] and Young's modulus [Pa] of a circle that has EA and EI: r^2 = 4 EI / EA, E = EA / (pi r^2)."""
        ea, ei = self.stiffness
        radius = 2 * float(np.sqrt(ei / ea))
        return radius, ea / (np.pi * radius**2)

    @property
    def density(self) -> float:
        """Mass per length [kg/m]."""
        return float(self.beam.section.mass_per_length[0])

    @property
    def fastest(self) -> float:
        """Bound on the frequencies [rad/s]: stretch 2 / l sqrt(EA / rho A), bending 4 / l^2 sqrt(EI / rho A)."""
        ea, ei = self.stiffness
        stretch = 2 / self.edge * np.sqrt(ea / self.density)
        bending = 4 / self.edge**2 * np.sqrt(ei / self.density)
        return float(np.hypot(stretch, bending))

    def format_point_name(self, k: int) -> str:
        """Name of the body that carries point k [-], 1 the first after the root."""
        return f"{self.link}/point {k}"


def build_rod(mechanism: Mechanism, elements: int) -> Rod:
    """Return the only beam of a mechanism as a rod of ``elements`` edges; its end carries the point masses [kg].

    Raises InputError where motion or gravity leave the beam's plane, as they may in a model that was changed after it was taken.
    """
    (link,) = mechanism.beams
    bent = find_bending_axis(mechanism, link)
    if bent is None:
        raise InputError(f"mechanism '{mechanism.name}': {describe_spatial_bending(link)}")
    assert link.beam is not None
    tip = sum(body.inertia.mass for body in link.bodies if body.station == 1.0)
    return Rod(link.name, link.beam, bent, tip, elements)


def describe_spatial_bending(link: Link) -> str:
    """Return the reason why a flex cannot be the beam of a link that does not stay in a plane."""
    return f"{NO_FRAME}, so no twist: motion and gravity must stay in a plane of the section of {link.name}"


def find_bending_axis(mechanism: Mechanism, link: Link) -> int | None:
    """Return in which direction of its section the beam bends: 1 (y), 2 (z), None where it leaves a plane.

    With n the other direction: every turning axis lies along n, every sliding axis and gravity lie across n.
    """
    assert link.beam is not None
    frames = {WORLD: np.eye(3)}
    along = []
    across = [mechanism.gravity / max(1.0, float(np.linalg.norm(mechanism.gravity)))]
    for joint in mechanism.joints:
        frames[joint.child] = frames[joint.parent] @ joint.placement.rotation
        if joint.kind in ("revolute", "continuous"):
            along.append(frames[joint.child] @ joint.axis)
        elif joint.kind == "prismatic":
            across.append(frames[joint.child] @ joint.axis)
        elif joint.kind != "fixed":
            return None
    section = frames[link.name] @ link.beam.placement.rotation
    for bent, n in ((1, section[:, 2]), (2, section[:, 1])):
        off = [*(float(np.linalg.norm(np.cross(a, n))) for a in along), *(abs(float(a @ n)) for a in across)]
        if max(off) <= PARALLEL:
            return bent
    return None


def build_flexible_model(mechanism: Mechanism, rod: Rod, step: float) -> BuiltModel:
    """Return MuJoCo's model of the mechanism without drives, with a flex for the rod; step [s]."""
    return build(_build_rigid_part(mechanism, rod), extend=lambda spec: _add_rod(spec, rod, step))


def _build_rigid_part(mechanism: Mechanism, rod: Rod) -> Mechanism:
    """The mechanism without drives; of the beam what moves with its link: bodies at the root and half an edge's mass."""
    half = Body("half an edge", Inertia.build_unchecked(rod.density * rod.edge / 2), 0.0)
    links = []
    for link in mechanism.links:
        if link.beam is not None:
            bodies = (half, *(b for b in link.bodies if b.station in (None, 0.0)))
            link = replace(link, beam=None, bodies=tuple(_convert_to_link_frame(b, link.beam) for b in bodies))
        links.append(link)
    joints = (replace(j, rotor_inertia=0.0, damping=0.0, friction=0.0) for j in mechanism.joints)
    return replace(mechanism, links=tuple(links), joints=tuple(joints))


def _convert_to_link_frame(body: Body, beam: Beam) -> Body:
    """A body at the root section seen in the link's frame: c' = p + R c, I' = R I R^T."""
    place = beam.placement.position
    rotation = beam.placement.rotation
    inertia = body.inertia
    moved = Inertia.build_unchecked(
        inertia.mass, place + rotation @ inertia.com, rotation @ inertia.tensor @ rotation.T
    )
    return replace(body, station=None, inertia=moved)


def _add_rod(spec: Any, rod: Rod, step: float) -> None:
    for joint in spec.joints:
        joint.armature = DRIVE
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    for k in range(1, rod.elements + 1):
        _add_point(spec.body(rod.link), rod, k)
    _add_flex(spec, rod)


def _add_point(link: Any, rod: Rod, k: int) -> None:
    place = rod.beam.placement
    last = k == rod.elements
    point = link.add_body(
        name=rod.format_point_name(k),
        pos=place.position + place.rotation[:, 0] * (k * rod.edge),
        quat=convert_to_quaternion(place.rotation),
        mass=rod.density * rod.edge * (0.5 if last else 1.0) + (rod.tip if last else 0.0),
        inertia=np.full(3, FLOOR),
        ipos=np.zeros(3),
        explicitinertial=True,
    )
    for axis in (0, rod.bent):
        point.add_joint(
            name=f"{rod.format_point_name(k)}/{'xyz'[axis]}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=np.eye(3)[axis]
        )


def _add_flex(spec: Any, rod: Rod) -> None:
    root = rod.beam.placement.position
    axis = rod.beam.placement.rotation[:, 0]
    flex = spec.add_flex(name="rod", dim=1, contype=0, conaffinity=0)
    flex.vertbody = [rod.link, rod.link, *(rod.format_point_name(k) for k in range(1, rod.elements + 1))]
    flex.vert = [*(root - GHOST * rod.edge * axis), *root, *np.zeros(3 * rod.elements)]
    flex.elem = [i for k in range(rod.elements + 1) for i in (k, k + 1)]
    flex.section = mujoco.mjtFlexSection.mjFLEXSECTION_CIRCLE
    flex.radius, flex.young = rod.section
    flex.poisson = 0.0
    flex.edgestiffness = rod.stiffness[0] / rod.edge
