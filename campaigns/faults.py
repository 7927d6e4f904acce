"""Real faults for mechanisms: a mass, a place, an angle, a sign, a damper; each large enough to be felt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from retelling import Dice

from crosscheck.equivalence.difference import Difference
from crosscheck.lifting.rigid import turned
from flexinv.model.mechanism import WORLD, Array, Joint, Link, Mechanism, Placement

MASS, WAY, TURN, DAMPER = 0.01, 5e-3, np.radians(1.0), 0.25  # relative, [m], [rad], [N m s/rad]
SIZE = 0.02  # relative: how well a size has to be told
HINGES = ("revolute", "continuous")


@dataclass(frozen=True)
class Fault:
    """One planted fault: what it changed, of which element of the first machine, by how much [unit]; as : other names of it."""

    kind: str
    cause: str
    element: str
    size: float

    @property
    def words(self) -> str:
        """Return the fault in a line."""
        return f"{self.cause} of {self.element} by {self.size:.6g}"


Planted = tuple[Mechanism, Fault]


def plant(mechanism: Mechanism, dice: Dice) -> Planted | None:
    """Return the mechanism with a random fault, and the fault; None where it has nothing that could have it."""
    kinds = [KINDS[k] for k in dice.permutation(len(KINDS))]
    return next((made for kind in kinds if (made := kind(mechanism, dice)) is not None), None)


def fits(fault: Fault, difference: Difference) -> bool:
    """Return True if a difference names the fault: quantity, element, size."""
    words = (
        difference.place.removeprefix("link ").removeprefix("joint ").removeprefix("body ").partition(" (on link ")[0]
    )
    words = words.partition("/")[0]  # a writer of MJCF gives each body of a link one of its own, "link/body"
    return (
        difference.cause == fault.cause
        and words == fault.element
        and abs(difference.size - fault.size) <= SIZE * fault.size
    )


def _mass(mechanism: Mechanism, dice: Dice) -> Planted | None:
    link = _link(mechanism, dice)
    if link is None:
        return None
    body = link.bodies[0].inertia
    return _with_body(mechanism, link, mass=body.mass * (1 + MASS)), Fault(
        "1 % mass", "mass", link.name, body.mass * MASS
    )


def _com(mechanism: Mechanism, dice: Dice) -> Planted | None:
    link = _link(mechanism, dice)
    if link is None:
        return None
    way = WAY * _unit(dice)
    return _with_body(mechanism, link, com=link.bodies[0].inertia.com + way), Fault(
        "5 mm", "centre of mass", link.name, WAY
    )


def _place(mechanism: Mechanism, dice: Dice) -> Planted | None:
    """Move a joint on a link that moves, across its axis: along the axis it is the frame of what it carries."""
    joint = _joint(mechanism, dice)
    if joint is None:
        return None
    way = WAY * joint.placement.rotation @ _across(joint.axis, dice)
    made = replace(joint, placement=Placement(joint.placement.position + way, joint.placement.rotation))
    return _with_joint(mechanism, made), Fault("5 mm", "position of joint", joint.name, WAY)


def _turn(mechanism: Mechanism, dice: Dice) -> Planted | None:
    """Turn the frame of a joint across its axis."""
    joint = _joint(mechanism, dice)
    if joint is None:
        return None
    turn = joint.placement.rotation @ turned(_across(joint.axis, dice), float(TURN))
    made = replace(joint, placement=Placement(joint.placement.position, turn))
    return _with_joint(mechanism, made), Fault("1 degree", "orientation of joint", joint.name, float(TURN))


def _sign(mechanism: Mechanism, dice: Dice) -> Planted | None:
    """Give one entry of a centre of mass the other sign."""
    link = _link(mechanism, dice)
    if link is None:
        return None
    com = np.array(link.bodies[0].inertia.com)
    k = int(np.argmax(np.abs(com)))
    if abs(com[k]) < 1e-3:
        return None
    size = 2 * abs(float(com[k]))
    com[k] *= -1
    return _with_body(mechanism, link, com=com), Fault("a sign", "centre of mass", link.name, size)


def _damper(mechanism: Mechanism, dice: Dice) -> Planted | None:
    joints = [j for j in mechanism.joints if j.kind in (*HINGES, "prismatic")]
    if not joints:
        return None
    joint = joints[int(dice.integers(len(joints)))]
    return _with_joint(mechanism, replace(joint, damping=joint.damping + DAMPER)), Fault(
        "a damper", "damping", joint.name, DAMPER
    )


KINDS: tuple[Callable[[Mechanism, Dice], Planted | None], ...] = (_mass, _com, _place, _turn, _sign, _damper)


def _link(mechanism: Mechanism, dice: Dice) -> Link | None:
    """A link whose body carries on: one on a hinge that itself stands on a link that moves, heavy enough to be felt."""
    whole = sum(b.inertia.mass for k in mechanism.links for b in k.bodies)
    fit = []
    for joint in _far(mechanism):
        link = mechanism.link_of[joint.child]
        if len(link.bodies) == 1 and link.bodies[0].inertia.mass > 0.01 * whole and _is_round(link, joint) is False:
            fit.append(link)
    return fit[int(dice.integers(len(fit)))] if fit else None


def _joint(mechanism: Mechanism, dice: Dice) -> Joint | None:
    """A hinge on a link that moves, which carries a body that shows how it stands."""
    fit = [
        j for j in _far(mechanism) if mechanism.link_of[j.child].bodies and not _is_round(mechanism.link_of[j.child], j)
    ]
    return fit[int(dice.integers(len(fit)))] if fit else None


def _far(mechanism: Mechanism) -> list[Joint]:
    above = {joint.child: joint for joint in mechanism.joints}
    moving = [j for j in mechanism.joints if j.kind in HINGES and j.parent != WORLD]
    return [j for j in moving if _moves(above, j.parent)]


def _moves(above: dict[str, Joint], link: str) -> bool:
    while link != WORLD:
        if above[link].nv:
            return True
        link = above[link].parent
    return False


def _is_round(link: Link, joint: Joint) -> bool:
    body = link.bodies[0].inertia
    off = float(np.linalg.norm(np.cross(joint.axis, body.com)))
    return off < 1e-2 or float(np.linalg.norm(np.cross(joint.axis, body.tensor @ joint.axis))) < 1e-12


def _unit(dice: Dice) -> Array:
    axis = dice.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _across(axis: Array, dice: Dice) -> Array:
    across = np.cross(axis, _unit(dice))
    return np.asarray(across / np.linalg.norm(across))


def _with_joint(mechanism: Mechanism, joint: Joint) -> Mechanism:
    joints = tuple(joint if j.name == joint.name else j for j in mechanism.joints)
    return replace(mechanism, joints=joints)


def _with_body(mechanism: Mechanism, link: Link, **values: object) -> Mechanism:
    body = replace(link.bodies[0], inertia=link.bodies[0].inertia.replace_unchecked(**values))  # type: ignore[arg-type]
    links = tuple(replace(k, bodies=(body,)) if k.name == link.name else k for k in mechanism.links)
    return replace(mechanism, links=links)
