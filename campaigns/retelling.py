"""Changes of a mechanism that change nothing: the same machine with another base, other frames, links, names, coordinates, root.

Each change is a function of a `RewrittenMechanism`: a mechanism with the way in which its coordinates and frames follow from
those of the machine that it was told from first:  q = sign q' + offset  of a scalar joint, and  X' = X F  of a link's frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from crosscheck.lifting.assembly import list_depth_first
from crosscheck.lifting.rigid import apply_placement, inverse, move_inertia, turned
from flexinv.model.links import describe_impossible_inertia
from flexinv.model.mechanism import (
    WORLD,
    Array,
    Attachment,
    Body,
    Closure,
    Inertia,
    Joint,
    Limits,
    Link,
    Mechanism,
    Placement,
)

Dice = np.random.Generator
HINGES = ("revolute", "continuous", "helical")
SCALARS = (*HINGES, "prismatic")
REVERSIBLE = (*SCALARS, "fixed")
LETTERS = "bcdfghkmnpqrstvwxz"
REACH = 0.5  # [m], by which frames and bases are moved


@dataclass(frozen=True)
class CoordinateMap:
    """How the coordinate of a joint counts: its name now, and  q = sign q' + offset [rad], [m]."""

    name: str
    sign: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class LinkFrame:
    """Where the frame of a link stands now: the link's name, and its frame in that of the link as it was first told [m]."""

    name: str
    frame: Placement = field(default_factory=Placement)


@dataclass(frozen=True)
class RewrittenMechanism:
    """A mechanism, and how it follows from the one that was told first.

    joints : by the joint's first name; links : by the link's first name; world : of the first in the one that is told now [m]
    """

    mechanism: Mechanism
    joints: Mapping[str, CoordinateMap]
    links: Mapping[str, LinkFrame]
    world: Placement = field(default_factory=Placement)

    @property
    def floats(self) -> bool:
        """Return True for a machine that one free joint carries."""
        return any(joint.kind == "free" for joint in self.mechanism.joints)


Change = Callable[[RewrittenMechanism, Dice], RewrittenMechanism]


def told_first(mechanism: Mechanism) -> RewrittenMechanism:
    """Return a mechanism as it is told first [-]."""
    joints = {joint.name: CoordinateMap(joint.name) for joint in mechanism.joints if joint.nv}
    return RewrittenMechanism(mechanism, joints, {link.name: LinkFrame(link.name) for link in mechanism.links})


def turn_base(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Turn the base about the vertical and move it; where all floats, that is where it begins [m]."""
    vertical = rewritten.mechanism.gravity / (np.linalg.norm(rewritten.mechanism.gravity) or 1.0)
    rotation = turned(vertical, dice.uniform(-np.pi, np.pi)) if vertical.any() else random_turn(dice)
    return base_moved(rewritten, Placement(dice.uniform(-REACH, REACH, 3), rotation))


def turn_quarter(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Turn the base about the vertical by quarters of a turn."""
    vertical = rewritten.mechanism.gravity / (np.linalg.norm(rewritten.mechanism.gravity) or 1.0)
    turn = Rotation.from_rotvec(vertical * (np.pi / 2 * dice.integers(1, 4))).as_matrix()
    return base_moved(rewritten, Placement(rotation=np.asarray(turn)))


def turn_world(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Turn the base and gravity with it: the axes of the world are others [m], [m/s^2]."""
    motion = Placement(dice.uniform(-REACH, REACH, 3), random_turn(dice))
    there = base_moved(rewritten, motion)
    gravity = motion.rotation @ rewritten.mechanism.gravity
    return replace(there, mechanism=replace(there.mechanism, gravity=gravity))


def base_moved(rewritten: RewrittenMechanism, motion: Placement) -> RewrittenMechanism:
    """Turn and move all that stands on the world [m]."""
    joints = [
        replace(j, placement=apply_placement(motion, j.placement)) if j.parent == WORLD else j
        for j in rewritten.mechanism.joints
    ]
    return replace(
        rewritten,
        mechanism=replace(rewritten.mechanism, joints=tuple(joints)),
        world=apply_placement(motion, rewritten.world),
    )


def move_frames(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Turn and move the frames of most links on their bodies: of a hinge's along its axis only [m]."""
    frames = {joint.child: _other_frame(joint, dice) for joint in rewritten.mechanism.joints if dice.random() < 0.7}
    return _reframed(rewritten, frames)


def _other_frame(joint: Joint, dice: Dice) -> Placement:
    way = dice.uniform(-REACH, REACH, 3) / 2
    if joint.kind in HINGES:
        way = joint.axis * way[0]
    if joint.kind in ("spherical", "universal"):
        way = np.zeros(3)
    quarters = np.asarray(Rotation.create_group("O")[dice.integers(24)].as_matrix())
    return Placement(way, quarters if dice.random() < 0.5 else random_turn(dice))


def _reframed(rewritten: RewrittenMechanism, frames: Mapping[str, Placement]) -> RewrittenMechanism:
    """Give links other frames, each stated in the one that it had [m]."""
    old, none = rewritten.mechanism, Placement()
    # The axes of a universal joint stand in the frame of its link, which therefore stays.
    kept = {j.child for j in old.joints if j.kind == "universal"}
    frames = {name: frame for name, frame in frames.items() if name not in kept}
    joints = []
    for joint in old.joints:
        own, carrier = frames.get(joint.child, none), frames.get(joint.parent, none)
        at = apply_placement(apply_placement(inverse(carrier), joint.placement), own)
        back = own.rotation.T
        joints.append(replace(joint, placement=at, axis=back @ joint.axis, second_axis=back @ joint.second_axis))
    links = tuple(_link_in(link, frames.get(link.name, none)) for link in old.links)
    closures = tuple(replace(c, first=_end_in(c.first, frames), second=_end_in(c.second, frames)) for c in old.closures)
    seats = {
        name: replace(seat, frame=apply_placement(seat.frame, frames.get(seat.name, none)))
        for name, seat in rewritten.links.items()
    }
    there = replace(old, links=links, joints=tuple(joints), closures=closures)
    return replace(rewritten, mechanism=there, links=seats)


def _link_in(link: Link, frame: Placement) -> Link:
    return replace(link, bodies=tuple(replace(b, inertia=move_inertia(inverse(frame), b.inertia)) for b in link.bodies))


def _end_in(end: Attachment, frames: Mapping[str, Placement]) -> Attachment:
    return replace(end, placement=apply_placement(inverse(frames.get(end.link, Placement())), end.placement))


def merge_links(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Merge half of the links that are fixed to others into them [kg]."""
    for joint in rewritten.mechanism.joints:
        if joint.kind == "fixed" and joint.parent != WORLD and dice.random() < 0.5:
            rewritten = _merged(rewritten, joint.name)
    return rewritten


def _merged(rewritten: RewrittenMechanism, name: str) -> RewrittenMechanism:
    old = rewritten.mechanism
    gone = old.joint_of[name]
    at = gone.placement
    bodies = [Body(f"{gone.child} {b.name}", move_inertia(at, b.inertia)) for b in old.link_of[gone.child].bodies]
    links = []
    for link in old.links:
        if link.name == gone.parent:
            bodies = [*link.bodies, *bodies]
            link = replace(link, bodies=(Body(link.name, whole([b.inertia for b in bodies])),) if bodies else ())
        if link.name != gone.child:
            links.append(link)
    joints = [
        replace(j, parent=gone.parent, placement=apply_placement(at, j.placement)) if j.parent == gone.child else j
        for j in old.joints
        if j is not gone
    ]
    seats = {key: seat for key, seat in rewritten.links.items() if seat.name != gone.child}
    return replace(rewritten, mechanism=replace(old, links=tuple(links), joints=list_depth_first(joints)), links=seats)


def split_links(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Split a third of the links in two that are fixed to each other [kg]."""
    for link in rewritten.mechanism.links:
        if len(link.bodies) == 1 and link.bodies[0].inertia.mass > 0.0 and dice.random() < 0.4:
            rewritten = _split(rewritten, link, dice)
    return rewritten


def _split(rewritten: RewrittenMechanism, link: Link, dice: Dice) -> RewrittenMechanism:
    """Take a share of a body, its centre a little off that of the rest, as far as both stay bodies.

    A body whose stated tensor no body can have stays whole: neither can its parts have theirs.
    """
    if describe_impossible_inertia(link.bodies[0].inertia.tensor):
        return rewritten
    body, share = link.bodies[0].inertia, float(dice.uniform(0.2, 0.8))
    least = max(0.0, float(np.linalg.eigvalsh(body.tensor)[0]))
    way = dice.uniform(-1.0, 1.0, 3) * 0.3 * np.sqrt(least / body.mass)
    parts = [
        Inertia.build_unchecked(share * body.mass, body.com + (1 - share) * way, share * body.tensor),
        Inertia.build_unchecked((1 - share) * body.mass, body.com - share * way, np.zeros((3, 3))),
    ]
    steiner = share * (1 - share) * body.mass * (float(way @ way) * np.eye(3) - np.outer(way, way))
    parts[1] = parts[1].replace_unchecked(tensor=(1 - share) * body.tensor - steiner)
    moments = np.linalg.eigvalsh(parts[1].tensor)
    if moments[0] < 0.0 or moments[0] + moments[1] < moments[2]:
        parts = [part.replace_unchecked(com=body.com) for part in parts]
        parts[1] = parts[1].replace_unchecked(tensor=(1 - share) * body.tensor)
    name = f"{link.name}_part"
    frame = Placement(dice.uniform(-0.2, 0.2, 3), random_turn(dice))
    made = Link(name, (Body(name, move_inertia(inverse(frame), parts[0])),))
    old = rewritten.mechanism
    links = [replace(k, bodies=(Body(k.name, parts[1]),)) if k is link else k for k in old.links]
    joint = Joint(f"{name}_weld", "fixed", link.name, name, frame, actuated=False)
    joints = list_depth_first([*old.joints, joint])
    return replace(rewritten, mechanism=replace(old, links=(*links, made), joints=joints))


def rename(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Give all joints and links names that say nothing."""
    old = rewritten.mechanism
    names: dict[str, str] = {WORLD: WORLD}
    for name in [*(j.name for j in old.joints), *(k.name for k in old.links)]:
        names[name] = names.get(name) or _token(dice, names)
    joints = tuple(replace(j, name=names[j.name], parent=names[j.parent], child=names[j.child]) for j in old.joints)
    links = tuple(
        replace(
            k, name=names[k.name], bodies=tuple(replace(b, name=names[k.name]) for b in k.bodies[:1]) + k.bodies[1:]
        )
        for k in old.links
    )
    closures = tuple(_renamed(c, names) for c in old.closures)
    counts = {key: replace(count, name=names[count.name]) for key, count in rewritten.joints.items()}
    seats = {key: replace(seat, name=names[seat.name]) for key, seat in rewritten.links.items()}
    return replace(
        rewritten, mechanism=replace(old, joints=joints, links=links, closures=closures), joints=counts, links=seats
    )


def _token(dice: Dice, taken: Mapping[str, str]) -> str:
    while True:
        made = "".join(dice.choice(list(LETTERS), 5))
        if made not in taken.values():
            return made


def _renamed(closure: Closure, names: Mapping[str, str]) -> Closure:
    ends = (replace(end, link=names[end.link]) for end in (closure.first, closure.second))
    factors = tuple((names[name], factor) for name, factor in closure.factors)
    return replace(closure, first=next(ends), second=next(ends), factors=factors)


def reorder(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Tell what a link carries in another order."""
    joints = [rewritten.mechanism.joints[k] for k in dice.permutation(len(rewritten.mechanism.joints))]
    return replace(rewritten, mechanism=replace(rewritten.mechanism, joints=list_depth_first(joints)))


def reverse_axes(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Let half of the coordinates count the other way, their limits, springs and couplings with them."""
    return recounted(rewritten, {n: (-1.0, 0.0) for n in _scalars(rewritten) if dice.random() < 0.5})


def move_zeros(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Move the zeros of half of the coordinates [rad], [m], limits, springs and couplings with them."""
    moves = {}
    for name in _scalars(rewritten):
        if dice.random() < 0.5:
            reach = 0.2 if rewritten.mechanism.joint_of[name].kind == "prismatic" else np.pi
            quarter = np.pi / 2 if reach == np.pi else 0.05
            step = float(quarter * dice.integers(-2, 3)) if dice.random() < 0.5 else float(dice.uniform(-reach, reach))
            moves[name] = (1.0, step)
    return recounted(rewritten, moves)


def _scalars(rewritten: RewrittenMechanism) -> list[str]:
    return [joint.name for joint in rewritten.mechanism.joints if joint.kind in SCALARS]


def recounted(rewritten: RewrittenMechanism, moves: Mapping[str, tuple[float, float]]) -> RewrittenMechanism:
    """Count joints by  q = sign q' + offset; moves : signs [-] and offsets [rad], [m] by joint."""
    old = rewritten.mechanism
    joints = tuple(_counted(j, *moves[j.name]) if j.name in moves else j for j in old.joints)
    closures = []
    for closure in old.closures:
        offset = closure.offset - sum(f * moves[n][1] for n, f in closure.factors if n in moves)
        factors = tuple((n, f * moves.get(n, (1.0, 0.0))[0]) for n, f in closure.factors)
        closures.append(replace(closure, factors=factors, offset=offset))
    counts = {}
    for key, count in rewritten.joints.items():
        sign, offset = moves.get(count.name, (1.0, 0.0))
        counts[key] = CoordinateMap(count.name, count.sign * sign, count.offset + count.sign * offset)
    return replace(rewritten, mechanism=replace(old, joints=joints, closures=tuple(closures)), joints=counts)


def _counted(joint: Joint, sign: float, offset: float) -> Joint:
    step = offset * joint.axis
    move = Placement(step) if joint.kind == "prismatic" else Placement(rotation=turned(joint.axis, offset))
    if joint.kind == "helical":
        move = Placement(joint.pitch * offset / (2 * np.pi) * joint.axis, move.rotation)
    lower, upper = sorted(((joint.limits.lower - offset) * sign, (joint.limits.upper - offset) * sign))
    limits = Limits(joint.limits.effort, joint.limits.velocity, lower, upper)
    rest = (joint.rest - offset) * sign if joint.stiffness else joint.rest
    at = apply_placement(joint.placement, move) if offset else joint.placement
    return replace(joint, placement=at, axis=sign * joint.axis, limits=limits, rest=rest)


def exchange_root(rewritten: RewrittenMechanism, dice: Dice) -> RewrittenMechanism:
    """Tell a machine that floats from another one of its links."""
    old = rewritten.mechanism
    base = next((j for j in old.joints if j.kind == "free" and j.parent == WORLD), None)
    if base is None or sum(j.parent == WORLD for j in old.joints) > 1:
        return rewritten
    ways = {j.child: _way(old, base.child, j.child) for j in old.joints if j is not base}
    known = {seat.name for seat in rewritten.links.values()}
    ends = [name for name, way in ways.items() if name in known and all(j.kind in REVERSIBLE for j in way)]
    ends = [name for name in ends if old.link_of[name].bodies]
    if not ends:
        return rewritten
    return _told_from(rewritten, base, ways[ends[int(dice.integers(len(ends)))]])


def _told_from(rewritten: RewrittenMechanism, base: Joint, way: list[Joint]) -> RewrittenMechanism:
    """Turn the joints of a way about: the frame of each link on it goes to the joint that now carries it."""
    old = rewritten.mechanism
    frames = {joint.parent: joint.placement for joint in way}
    names = {joint.name for joint in way}
    pose = base.placement
    for joint in way:
        pose = apply_placement(pose, joint.placement)
    joints = [replace(base, child=way[-1].child, placement=pose)]
    for joint in old.joints:
        if joint is base:
            continue
        if joint.name in names:
            at = inverse(frames.get(joint.child, Placement()))
            joints.append(replace(joint, parent=joint.child, child=joint.parent, placement=at, axis=-joint.axis))
        else:
            at = apply_placement(inverse(frames.get(joint.parent, Placement())), joint.placement)
            joints.append(replace(joint, placement=at))
    links = tuple(_link_in(link, frames.get(link.name, Placement())) for link in old.links)
    closures = tuple(replace(c, first=_end_in(c.first, frames), second=_end_in(c.second, frames)) for c in old.closures)
    seats = {
        name: replace(s, frame=apply_placement(s.frame, frames.get(s.name, Placement())))
        for name, s in rewritten.links.items()
    }
    there = replace(old, links=links, joints=list_depth_first(joints), closures=closures)
    return replace(rewritten, mechanism=there, links=seats)


def _way(mechanism: Mechanism, root: str, link: str) -> list[Joint]:
    carried = {joint.child: joint for joint in mechanism.joints}
    result: list[Joint] = []
    while link != root:
        result.append(carried[link])
        link = carried[link].parent
    return result[::-1]


def whole(parts: list[Inertia]) -> Inertia:
    """Return bodies of one frame as one [kg, m, kg m^2]."""
    mass = sum(part.mass for part in parts)
    com = sum((part.mass * part.com for part in parts), np.zeros(3)) / (mass or 1.0)
    tensor = np.zeros((3, 3))
    for part in parts:
        arm = part.com - com
        tensor = tensor + part.tensor + part.mass * (float(arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return Inertia.build_unchecked(float(mass), com, tensor)


def random_turn(dice: Dice) -> Array:
    """Return a rotation (3, 3) [-], all alike likely."""
    return np.asarray(Rotation.random(random_state=dice).as_matrix())


# In the order in which they are made; a pair is told by some of them.
CHANGES: dict[str, tuple[Change, ...]] = {
    "links split": (split_links,),
    "links merged": (merge_links,),
    "root": (exchange_root,),
    "axes": (reverse_axes,),
    "zeros": (move_zeros,),
    "frames": (move_frames,),
    "base": (turn_base, turn_quarter, turn_world),
    "names": (rename,),
    "order": (reorder,),
}
