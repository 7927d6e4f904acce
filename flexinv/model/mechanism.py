"""Mechanisms as frozen data: a tree of links and joints, with closures, springs and forces attached.

A mechanism is a tree, which closures may tie into loops.  Every link hangs on one joint, where its frame sits; the joint's
parent is another link or ``"world"``.  SI units, radians, right-handed frames.

Everything here is *primary data* (lengths, masses, moduli, axes): other engines' models are built from these same numbers by
their own code.  Parts of it stand in `links`, `joints` and `attachments`, and are imported from here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexinv.display.card import Card, Shown
from flexinv.errors import InputError
from flexinv.model import rules
from flexinv.model.attachments import CLOSURES, GEARED, IMPACTS, Closure, Force, Spring
from flexinv.model.frozen import Frozen, read_only
from flexinv.model.joint_kinds import KINDS
from flexinv.model.joints import Drive, Joint, Limits
from flexinv.model.links import (
    WORLD,
    Attachment,
    Beam,
    Body,
    Inertia,
    Link,
    Placement,
    Section,
)  # fmt: skip
from flexinv.model.part import MeshedPart
from flexinv.typing import Array, Mask
from flexinv.validation import check_kind, check_whole_number

__all__ = [
    "CLOSURES", "GEARED", "IMPACTS", "WORLD",
    "Array", "Attachment", "Beam", "Body", "Closure", "Drive", "Force", "Inertia", "Joint", "Limits", "Link", "Mechanism",
    "Placement", "Section", "Spring",
]  # fmt: skip

# names of what an elastic drive adds: the gear's output and the spring to the link
GEAR = ".gear"
SPRING = ".spring"
# Kinds of joint that a drive may move, and of the spring between motor and link there.
SPRINGS = {name: "revolute" if k.circle else name for name, k in KINDS.items() if len(k.v) == 1}


@dataclass(frozen=True, eq=False)
class ModalDamping(Frozen):
    """Damping of all beams by the ratio of one natural mode, all joints held at zero.

    ratio : of critical damping [-]; mode : its number, 1 the lowest
    seconds : retardation time that follows from it [s], None until modes are computed (`linearized.modal_damping.damped`)
    """

    ratio: float
    mode: int = 1
    seconds: float | None = None

    RULES: ClassVar[rules.Rules] = {
        "ratio": rules.make_real_rule("-", 0.0),
        "mode": rules.count(1),
        "seconds": rules.make_optional_rule(rules.make_real_rule("s", 0.0)),
    }

    def __str__(self) -> str:
        """Return the stated ratio, and the time that follows from it [-], [s]."""
        stated = f"ratio {self.ratio:g} at mode {self.mode}"
        return stated if self.seconds is None else f"retardation time {self.seconds:.5g} s from {stated}"


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism(Shown, Frozen):
    """A tree of links and joints under gravity; ``joints`` is ordered depth-first, parents before children.

    closures : what ties links of the tree into loops; springs, forces : what else acts on them
    gravity : (3,) [m/s^2], world frame
    urdf : the URDF file the mechanism came from, if any (engines with a parser of their own read it again)
    packages : folders in which ``package://`` paths of that URDF are looked up
    notes : what a reader of results must know (mimic joints made independent, massless links, ...)
    modal_damping : of all beams by the ratio of one natural mode, data until a mesh is built; None where sections state it
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
    modal_damping: ModalDamping | None = None

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text,
        "links": rules.make_list_rule(rules.make_kind_rule(Link)),
        "joints": rules.make_list_rule(rules.make_kind_rule(Joint)),
        "gravity": rules.make_array_rule((3,), "m/s^2"),
        "closures": rules.make_list_rule(rules.make_kind_rule(Closure)),
        "springs": rules.make_list_rule(rules.make_kind_rule(Spring)),
        "forces": rules.make_list_rule(rules.make_kind_rule(Force)),
        "title": rules.check_text,
        "source": rules.check_text,
        "urdf": rules.make_optional_rule(rules.make_kind_rule(Path)),
        "packages": rules.make_list_rule(rules.make_kind_rule(Path)),
        "notes": rules.make_list_rule(rules.check_text),
        "modal_damping": rules.make_optional_rule(rules.make_kind_rule(ModalDamping)),
    }

    def _make_card(self) -> Card:
        from flexinv.model.mechanism_card import make_mechanism_card

        return make_mechanism_card(self)

    def _check(self, where: str) -> None:
        """Raise InputError unless links and joints are a tree, named once each, parents first, and attachments are on them."""
        self._check_names(where)
        self._check_tree(where)
        placed = {WORLD, *(link.name for link in self.links)}
        for end in self.attachments:
            if end.link not in placed:
                raise InputError(f"{where}something is attached to {end.link!r}, which is no link and not {WORLD!r}")
            if end.interface:
                self._check_interface(where, "an attachment", end.link, end.interface)
        for joint in self.joints:
            if joint.interface:
                self._check_interface(where, f"joint {joint.name!r}", joint.parent, joint.interface)

    def _check_interface(self, where: str, what: str, link: str, interface: str) -> None:
        """Raise InputError where something is attached to an interface that its link has not."""
        if link == WORLD:
            raise InputError(
                f"{where}{what}: interface {interface!r} of the world, expected no interface: it is no mesh"
            )
        self.link_of[link].check_interface(interface, f"{where}{what}")

    def _check_names(self, where: str) -> None:
        """Raise InputError where two of a kind, or two coordinates, have one name."""
        for kind in ("links", "joints", "closures", "springs", "forces"):
            names = [one.name for one in getattr(self, kind)]
            if twice := sorted(
                {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else ()
            ):
                raise InputError(f"{where}{kind} named twice: {', '.join(twice)}; expected a name of its own for each")
        for coordinates in (self.coordinate_names, self.velocity_names):
            if len(set(coordinates)) < len(coordinates):
                several = sorted({name for name in coordinates if coordinates.count(name) > 1})
                raise InputError(
                    f"{where}coordinates named twice: {', '.join(several)}; expected other names of joints"
                )

    def _check_tree(self, where: str) -> None:
        """Raise InputError unless each link is carried by one joint, which comes after those that carry its parent."""
        links = {link.name: link for link in self.links}
        placed = {WORLD}
        for joint in self.joints:
            if joint.child not in links or joint.child in placed:
                why = "which is no link" if joint.child not in links else "which another joint carries or the world is"
                raise InputError(
                    f"{where}joint {joint.name!r} carries {joint.child!r}, {why}; expected one joint for each link"
                )
            if joint.parent not in placed:
                expected = f"{WORLD!r} or a link of a joint before it: parents come first"
                raise InputError(f"{where}joint {joint.name!r} hangs on {joint.parent!r}, expected {expected}")
            placed.add(joint.child)
        if lost := [name for name in links if name not in placed]:
            raise InputError(f"{where}no joint carries {', '.join(lost)}; expected one joint for each link")

    @cached_property
    def link_of(self) -> dict[str, Link]:
        """Links by name."""
        return {link.name: link for link in self.links}

    @cached_property
    def joint_of(self) -> dict[str, Joint]:
        """Joints by name."""
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def moving_joints(self) -> tuple[Joint, ...]:
        """Joints that have coordinates, in their order."""
        return tuple(joint for joint in self.joints if joint.nv)

    @cached_property
    def moving_names(self) -> tuple[str, ...]:
        """Names of the joints that have coordinates, in their order."""
        return tuple(joint.name for joint in self.moving_joints)

    @cached_property
    def undriven_names(self) -> tuple[str, ...]:
        """Names of those that have coordinates and no actuator."""
        return tuple(joint.name for joint in self.moving_joints if not joint.actuated)

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Every frame that a closure, a spring or a force is attached to."""
        tied = (end for closure in self.closures for end in (closure.first, closure.second))
        pulled = (end for spring in self.springs for end in (spring.first, spring.second))
        return (*tied, *pulled, *(force.at for force in self.forces))

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the configuration coordinates q, in the order of every q array (Pinocchio's layout)."""
        return tuple(j.name + suffix for j in self.joints for suffix in KINDS[j.kind].q)

    @cached_property
    def velocity_names(self) -> tuple[str, ...]:
        """Names of the velocity coordinates, in the order of every qd, qdd and torque array."""
        return tuple(j.name + suffix for j in self.joints for suffix in KINDS[j.kind].v)

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
        """Return the slice of each joint's coordinates in a q array."""
        return _list_slices([(j.name, j.nq) for j in self.joints])

    @cached_property
    def v_slices(self) -> dict[str, slice]:
        """Return the slice of each joint's coordinates in a qd, qdd or torque array."""
        return _list_slices([(j.name, j.nv) for j in self.joints])

    @cached_property
    def actuated(self) -> Mask:
        """(nv,) which velocity coordinates have an actuator."""
        return read_only(np.array([j.actuated for j in self.joints for _ in range(j.nv)], dtype=np.bool_))

    @cached_property
    def weights(self) -> Array:
        """(nv,) weight of the square of each coordinate's effort among redundant drives [-]."""
        return read_only(np.array([j.weight for j in self.joints for _ in range(j.nv)], dtype=np.float64))

    @cached_property
    def drive_table(self) -> Array:
        """(5, nv) rotor inertia [kg m^2], damping [N m s], dry friction [N m], stiffness [N m/rad], rest [rad] of each drive."""
        rows = [[j.rotor_inertia, j.damping, j.friction, j.stiffness, j.rest] for j in self.joints for _ in range(j.nv)]
        return read_only(np.array(rows, dtype=np.float64).reshape(-1, 5).T)

    @property
    def is_rigid(self) -> bool:
        """True when no link is a beam or a mesh."""
        return all(link.is_rigid for link in self.links)

    @property
    def neutral(self) -> Array:
        """(nq,) configuration [rad], [m] with every joint at zero (identity quaternions, cos = 1)."""
        q = np.zeros(self.nq)
        for joint in self.joints:
            part = self.q_slices[joint.name]
            if KINDS[joint.kind].has_quaternion:
                q[part.stop - 1] = 1.0
            elif KINDS[joint.kind].circle:
                q[part.start] = 1.0
        return q

    @property
    def beams(self) -> tuple[Link, ...]:
        """The links that are beams, in the order of the mechanism."""
        return tuple(link for link in self.links if link.beam is not None)

    @property
    def flexible(self) -> tuple[Link, ...]:
        """The links that deform, beams and meshes, in the order of the mechanism."""
        return tuple(link for link in self.links if not link.is_rigid)

    @property
    def meshed(self) -> tuple[Link, ...]:
        """The links that are meshes, in the order of the mechanism."""
        return tuple(link for link in self.links if link.part is not None)

    def refined(self, elements: int = 1, order: int = 0) -> Mechanism:
        """Return the mechanism with ``elements`` times as many elements, each ``order`` higher [-]; twice the modes of meshes."""
        times = check_whole_number("elements", elements, 1)
        more = check_whole_number("order", order, 0)
        finer = self._replace_beams(lambda b: replace(b, elements=b.elements * times, order=b.order + more))
        return finer.add_modes(2) if times > 1 or more else finer

    def add_modes(self, times: int) -> Mechanism:
        """Return the mechanism with ``times`` as many vibration modes of every meshed link [-], two of each at least.

        Where a part has a finer mesh, it takes the place of the other.
        """
        more = check_whole_number("times", times, 1)

        def add_to_part(part: MeshedPart) -> MeshedPart:
            mesh = part if part.finer is None else part.finer
            law = {name: getattr(part, name) for name in ("retardation", "drag", "lumped", "stiffening")}
            return replace(mesh, modes=max(part.modes, 2) * more, frequency=part.frequency * more, **law)

        links = (link if link.part is None else replace(link, part=add_to_part(link.part)) for link in self.links)
        return replace(self, links=tuple(links)) if self.meshed else self

    def with_mesh(self, elements: int, order: int) -> Mechanism:
        """Return the mechanism with every beam meshed by ``elements`` elements of ``order`` [-]."""
        count = check_whole_number("elements", elements, 1)
        degree = check_whole_number("order", order, 1)
        return self._replace_beams(lambda b: replace(b, elements=count, order=degree))

    def with_body(self, link: str, body: Body) -> Mechanism:
        """Return the mechanism with one more body on a link: a payload [kg], at its station [-] where the link is a beam.

        Raises InputError for a link that the mechanism has not, and for a station that is missing or not meant.
        """
        check_kind("body", body, Body)
        owner = self.link_of.get(link) if isinstance(link, str) else None
        if owner is None:
            raise InputError(f"with_body: there is no link {link!r}; {self.name} has {', '.join(self.link_of)}")
        owner.check_interface(body.interface, f"with_body: body {body.name!r}")
        placed = body.station is None if owner.beam is None else body.station is not None and 0 <= body.station <= 1
        if not placed:
            expected = "a station from 0 to 1" if owner.beam is not None else "no station: the link is no beam"
            given = f"with_body: body {body.name!r} on link {link!r} has station {body.station}"
            raise InputError(f"{given}, expected {expected}")
        loaded = replace(owner, bodies=(*owner.bodies, body))
        return replace(self, links=tuple(loaded if one is owner else one for one in self.links))

    def _replace_beams(self, change: Callable[[Beam], Beam]) -> Mechanism:
        links = (link if link.beam is None else replace(link, beam=change(link.beam)) for link in self.links)
        return replace(self, links=tuple(links))


def _list_slices(sizes: list[tuple[str, int]]) -> dict[str, slice]:
    ends = np.cumsum([0] + [n for _, n in sizes])
    return {name: slice(int(a), int(b)) for (name, _), a, b in zip(sizes, ends, ends[1:], strict=False)}


def with_retardation(mechanism: Mechanism, seconds: ArrayLike) -> Mechanism:
    """Return the mechanism with damped beams, D = seconds C [N s], [N m^2 s]; a stated ratio is replaced.

    seconds : retardation time [s], one for all strains or six: axial, shear y, shear z, twist, bending y, bending z
    Raises InputError for negative times, and for six that differ where strains are coupled.
    """
    times = np.asarray(seconds, dtype=float)
    if times.shape not in ((), (6,)) or not np.isfinite(times).all() or (times < 0).any():
        raise InputError(f"retardation times {times.tolist()}: expected one number >= 0 or six [s], for example 1e-3")

    def apply_times(beam: Beam) -> Beam:
        section = beam.section
        if section.stiffness.ndim == 2:
            return replace(beam, section=replace(section, damping=times * section.stiffness))
        if np.ptp(times):
            given = f"retardation times {times.tolist()} of coupled strains"
            raise InputError(
                f"{given}: expected one number [s], or a damping matrix of the section; write {times.max():g}"
            )
        return replace(beam, section=replace(section, damping=float(times.flat[0]) * section.stiffness))

    return replace(mechanism._replace_beams(apply_times), modal_damping=None)


def build_drive_model(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism that the drives make [kg m^2], [N m/rad]: rotors in joints, springs where the motor is moved.

    rotor N^2 J, damping N^2 v, dry friction N c at the joint; the Stribeck part above c is the motor's alone (`motor_side`)
    Raises InputError for a drive on a joint without just one coordinate, or beside rotor, damping, friction or spring.
    """
    joints = []
    links = dict(mechanism.link_of)
    for joint in mechanism.joints:
        drive = joint.drive
        if drive is None or (drive.stiffness and drive.moves == "link"):
            joints.append(joint)
            continue
        if joint.kind not in SPRINGS:
            kinds = ", ".join(SPRINGS)
            raise InputError(f"joint {joint.name!r}: a drive moves one coordinate ({kinds}), the joint is {joint.kind}")
        if joint.rotor_inertia or joint.damping or joint.friction or joint.stiffness:
            beside = "rotor, damping, friction or spring beside a drive; state them in the drive"
            raise InputError(f"joint {joint.name!r}: {beside}")
        inertia = drive.ratio**2 * drive.rotor_inertia
        damping = drive.ratio**2 * drive.viscous
        motor = replace(joint, rotor_inertia=inertia, damping=damping, friction=drive.ratio * drive.coulomb)
        if not drive.stiffness:
            joints.append(motor)
            continue
        gear = Link(joint.name + GEAR)
        spring = replace(
            joint, name=joint.name + SPRING, kind=SPRINGS[joint.kind], parent=gear.name, station=None, interface="",
            placement=Placement(),
            stiffness=drive.stiffness, rest=0.0, damping=drive.damping, actuated=False, weight=1.0, limits=Limits(), drive=None,
        )  # fmt: skip
        links[gear.name] = gear
        joints += [replace(motor, child=gear.name), spring]
    return replace(mechanism, joints=tuple(joints), links=tuple(links[joint.child] for joint in joints))


def check_expanded(joint: Joint) -> None:
    """Raise InputError where a joint has a drive that its mechanism does not have: rotor, friction, spring [kg m^2], [N m]."""
    drive = joint.drive
    if drive is None or (drive.stiffness and drive.moves == "link"):
        return
    elastic = drive.stiffness and not joint.child.endswith(GEAR)
    passive = drive.rotor_inertia or drive.viscous or drive.coulomb
    if elastic or (passive and not (joint.rotor_inertia or joint.damping or joint.friction)):
        advice = "write flexinv.model.mechanism.build_drive_model(mechanism), which puts rotors into joints and springs between"
        raise InputError(f"joint {joint.name!r}: its drive is not part of the mechanism yet; {advice} motors and links")
