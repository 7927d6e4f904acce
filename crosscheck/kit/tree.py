"""The tree of a rigid mechanism in one line per moving joint: fixed joints merged, bodies of each joint made one.

For programs that want no JSON.  The link frame of a joint is its joint frame, moved by the joint; a frame is stated in the link
frame of the joint before (-1: the world).  Closures, springs and forces are in ``case.json``.
"""

from __future__ import annotations

from collections.abc import Iterator

from crosscheck.lifting.rigid import apply_placement, join_bodies, move_inertia
from flexinv.model.mechanism import WORLD, Inertia, Mechanism, Placement

AXES = ("x", "y", "z")
PAIRS = ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz")
HEADER = (
    "joint", "kind", "parent",
    *(f"p{a} [m]" for a in AXES),
    *(f"R{ab} [-]" for ab in PAIRS),
    *(f"axis {a} [-]" for a in AXES),
    *(f"second axis {a} [-]" for a in AXES),
    "rotor inertia", "damping", "friction", "stiffness", "rest", "actuated",
    "mass [kg]",
    *(f"c{a} [m]" for a in AXES),
    *(f"I{ab} [kg m^2]" for ab in PAIRS),
    *(f"gravity {a} [m/s^2]" for a in AXES),
    "pitch [m]",
)  # fmt: skip


def list_tree_rows(mechanism: Mechanism) -> Iterator[list[str]]:
    """Yield one row of ``tree.csv`` per moving joint, in the order of the coordinates; lengths [m], inertia about the centre."""
    carriers = find_carriers(mechanism)
    moving = [joint for joint in mechanism.joints if joint.nv]
    number = {joint.child: k for k, joint in enumerate(moving)}
    for joint in moving:
        carrier, place = carriers[joint.parent]
        frame = apply_placement(place, joint.placement)
        body = join_bodies(list_carried_bodies(mechanism, joint.child, carriers))
        drive = (joint.rotor_inertia, joint.damping, joint.friction, joint.stiffness, joint.rest, float(joint.actuated))
        numbers = [*frame.position, *frame.rotation.ravel(), *joint.axis, *joint.second_axis, *drive]
        numbers += [body.mass, *body.com, *body.tensor.ravel(), *mechanism.gravity, joint.pitch]
        yield [joint.name, joint.kind, str(number.get(carrier, -1)), *(repr(float(x)) for x in numbers)]


def find_carriers(mechanism: Mechanism) -> dict[str, tuple[str, Placement]]:
    """Return by link of a rigid mechanism the link that moves it (``world``: none does) and its pose in that link's frame [m]."""
    carriers: dict[str, tuple[str, Placement]] = {WORLD: (WORLD, Placement())}
    for joint in mechanism.joints:
        carrier, place = carriers[joint.parent]
        carriers[joint.child] = (
            (joint.child, Placement()) if joint.nv else (carrier, apply_placement(place, joint.placement))
        )
    return carriers


def list_carried_bodies(mechanism: Mechanism, carrier: str, seats: dict[str, tuple[str, Placement]]) -> list[Inertia]:
    """Return the bodies that move with a link [kg], [m], [kg m^2], in its frame."""
    return [
        move_inertia(seats[link.name][1], body.inertia)
        for link in mechanism.links
        if seats[link.name][0] == carrier
        for body in link.bodies
    ]
