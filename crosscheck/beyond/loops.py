"""Mistakes with closures, couplings, springs, given forces, and which joints have the drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosscheck.beyond import edits
from crosscheck.beyond.fault import ALL, Chapter, Fault, Scene, Truth, pick
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Closure, Force, Mechanism, Placement

CHAPTER = Chapter("closures, springs and forces")


def _frames(scene: Scene) -> list[Closure]:
    return [c for c in scene.mechanism.closures if c.kind != "coupling"]


def _at(closure: Closure) -> tuple[str, ...]:
    return (closure.name, closure.first.link, closure.second.link)


@CHAPTER("closure point", 1e-8, 1e-4, 1e-3, 5e-3)
def point(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """A loop closes at another point of one of its links: off along the link or across it, in the closure's plane."""
    if (closure := pick(rng, _frames(scene))) is None:
        return None
    end = pick(rng, ["first", "second"])
    if getattr(closure, end).station is not None:
        end = "second" if end == "first" else "first"
    way = edits.across(closure.axis, rng)

    def change(one: Closure) -> Closure:
        seat: Attachment = getattr(one, end)
        seat = replace(seat, placement=edits.shifted(seat.placement, size * way))
        return replace(one, first=seat) if end == "first" else replace(one, second=seat)

    link = getattr(closure, end).link
    return Fault(
        f"closure {closure.name} {size:.3g} m off on {link}",
        ((Truth(("closure", "length"), _at(closure)),),),
        (Truth(("placement", "angle offset", "com", "length"), (link, *_at(closure))),),
        lambda m: edits.on_closure(m, closure.name, change),
    )


@CHAPTER("closure axis", 1e-7, 0.01)
def axis(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """The axis of a closure is out of square; a loop in a plane does not feel it or does not close."""
    known = [c for c in _frames(scene) if c.kind in ("revolute", "universal", "cylindrical")]
    if (closure := pick(rng, known)) is None:
        return None
    turn = edits.rotation(edits.across(closure.axis, rng), size)
    return Fault(
        f"axis of closure {closure.name} tilted by {size:.3g} rad",
        ((Truth(("closure", "axis tilt"), _at(closure)),),),
        (),
        lambda m: edits.on_closure(m, closure.name, lambda c: replace(c, axis=turn @ c.axis)),
    )


@CHAPTER("closure of another kind", 1.0)
def kind(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """A ball where a hinge closes the loop."""
    if (closure := pick(rng, [c for c in _frames(scene) if c.kind == "revolute"])) is None:
        return None
    return Fault(
        f"closure {closure.name} is a ball",
        ((Truth(("closure", "closure rank"), _at(closure)),),),
        (),
        lambda m: edits.on_closure(m, closure.name, lambda c: replace(c, kind="spherical")),
    )


@CHAPTER("gear ratio of a coupling", 1.02, 0.5, -1.0)
def coupling(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """A gear between two joints has another ratio."""
    if (closure := pick(rng, [c for c in scene.mechanism.closures if c.factors])) is None:
        return None
    joint, factor = closure.factors[0]
    new = ((joint, factor * size), *closure.factors[1:])
    names = (closure.name, *(name for name, _ in closure.factors))
    return Fault(
        f"gear {closure.name} x{size:.4g}",
        ((Truth(("closure", "gear ratio"), names),),),
        (Truth(("effort scale",), names),),
        lambda m: edits.on_closure(m, closure.name, lambda c: replace(c, factors=new)),
    )


@CHAPTER("drive on another joint", 1.0)
def drive(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """In a loop of one freedom the drive sits on another of its joints."""
    scalar = [j for j in scene.mechanism.joints if j.nv == 1]
    driven = [j for j in scalar if j.actuated]
    free = [j for j in scalar if not j.actuated]
    if not scene.closed or len(driven) != 1 or not free:
        return None
    mine = driven[0]
    other = pick(rng, free)

    def change(mechanism: Mechanism) -> Mechanism:
        mechanism = edits.on_joint(mechanism, mine.name, lambda j: replace(j, actuated=False))
        return edits.on_joint(mechanism, other.name, lambda j: replace(j, actuated=True))

    at = (mine.name, other.name)
    return Fault(
        f"the drive is on {other.name} instead of {mine.name}",
        ((Truth(("drive place", "effort order"), at),),),
        (Truth(("effort sign", "effort scale"), at),),
        change,
    )


@CHAPTER("weights of drives", 1.5, 4.0)
def weights(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """Redundant drives share the work by other weights."""
    driven = [j for j in scene.mechanism.joints if j.nv and j.actuated]
    if not scene.closed or len(driven) < 3:
        return None
    joint = pick(rng, driven)
    return Fault(
        f"weight of {joint.name} x{size:.3g}",
        ((Truth(("weights",), (joint.name,)),),),
        (Truth(("effort scale",), (joint.name,)),),
        lambda m: edits.on_joint(m, joint.name, lambda j: replace(j, weight=j.weight * size)),
    )


@CHAPTER("other branch", 1.0)
def branch(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """The loop is assembled on its other side: the guess of its start has the other sign."""
    if not scene.closed or not scene.case.start:
        return None

    def other(mechanism: Mechanism, case: Case) -> Case:
        return replace(case, start={name: -np.asarray(value) for name, value in case.start.items()})

    return Fault("the loop closes on its other side", ((Truth(("branch",)),),), (), case=other)


# ------------------------------------------------------------------------------------------------- springs and forces


@CHAPTER("stiffness of a spring", 1.001, 1.05, 0.0, 2.0)
def stiffness(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """A spring between points, or one in a joint, is stiffer, softer or not there."""
    springs = [("spring", s) for s in scene.mechanism.springs if s.stiffness]
    joints = [("joint", j) for j in scene.mechanism.joints if j.stiffness]
    if (found := pick(rng, [*springs, *joints])) is None:
        return None
    what, one = found
    words = f"stiffness of {one.name} x{size:.4g}"
    new = one.stiffness * size
    if what == "spring":
        truth = Truth(("spring stiffness",), (one.name,))
        ends = (one.name, one.first.link, one.second.link)
        return Fault(
            words,
            ((truth,),),
            (Truth(("spring rest", "spring damping", "force"), ends),),
            lambda m: edits.on_spring(m, one.name, lambda s: replace(s, stiffness=new)),
        )
    right = (Truth(("joint spring",), (one.name,)),)
    return Fault(words, (right,), (), lambda m: edits.on_joint(m, one.name, lambda j: replace(j, stiffness=new)))


@CHAPTER("rest of a spring", 1e-7, 1e-3, 1e-2)
def rest(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """A spring is without force elsewhere: off by so many metres or radians."""
    springs = [("spring", s) for s in scene.mechanism.springs if s.stiffness]
    joints = [("joint", j) for j in scene.mechanism.joints if j.stiffness]
    if (found := pick(rng, [*springs, *joints])) is None:
        return None
    what, one = found
    words = f"rest of {one.name} off by {size:.3g}"
    new = one.rest + size
    if what == "spring":
        ends = (one.name, one.first.link, one.second.link)
        return Fault(
            words,
            ((Truth(("spring rest",), (one.name,)),),),
            (Truth(("spring stiffness", "force"), ends),),
            lambda m: edits.on_spring(m, one.name, lambda s: replace(s, rest=new)),
        )
    right = (Truth(("joint spring", "angle offset"), (one.name,)),)
    return Fault(words, (right,), (), lambda m: edits.on_joint(m, one.name, lambda j: replace(j, rest=new)))


@CHAPTER("spring in a joint", 0.005, 0.05)
def joint_spring(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """A hose acts as a spring in a joint that has none in the other model."""
    free = [j for j in scene.driven if not j.stiffness]
    if (joint := pick(rng, free)) is None or joint.nq != 1:
        return None
    q = scene.case.motion.evaluate(scene.mechanism, scene.time)[0][:, scene.mechanism.q_slices[joint.name].start]
    value = size * scene.effort(joint.name) / float(np.abs(q - q[0]).max())
    return Fault(
        f"a spring of {value:.4g} in {joint.name}",
        ((Truth(("joint spring",), (joint.name,)),),),
        (),
        lambda m: edits.on_joint(m, joint.name, lambda j: replace(j, stiffness=value, rest=float(q[0]))),
    )


@CHAPTER("damping of a spring", 0.0, 2.0)
def damper(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """The damper beside a spring is left out or counted twice."""
    known = [s for s in scene.mechanism.springs if s.damping]
    if (spring := pick(rng, known)) is None:
        return None
    return Fault(
        f"damping of {spring.name} x{size:.3g}",
        ((Truth(("spring damping",), (spring.name,)),),),
        (Truth(("spring stiffness", "viscous"), (spring.name,)),),
        lambda m: edits.on_spring(m, spring.name, lambda s: replace(s, damping=s.damping * size)),
    )


@CHAPTER("force at a tip", 1e-7, 0.01, 0.1)
def force(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """A cable pulls at the tip of the last link, in a direction of the world: a part of the weight or of the effort."""
    links = [link for link in scene.mechanism.links if link.beam is None and link.tip.any()]
    if not links or any(scene.engine.startswith(e) for e in ("exudyn-ge", "exudyn-ancf", "mujoco-flex", "exudyn")):
        return None
    link = links[-1]
    way = rng.normal(size=3)
    arm = float(np.linalg.norm(link.tip))
    top = max(float(np.abs(s.values).max()) for s in scene.reference.series.values() if s.quantity == "torque")
    wrench = np.concatenate([size * top / arm * way / np.linalg.norm(way), np.zeros(3)])[None]
    seat = Placement(position=link.tip)
    pull = Force("pull", Attachment(link.name, seat), wrench)
    return Fault(
        f"a force of {np.linalg.norm(wrench):.3g} N at the tip of {link.name}",
        ((Truth(("force",), (link.name,)),),),
        (Truth(("payload", "gravity vector"), (link.name, ALL)),),
        lambda m: replace(edits.by_hand(m), forces=(*m.forces, pull)),
    )


@CHAPTER("given force", 0.0, 1.05, -1.0)
def given(scene: Scene, rng: np.random.Generator, size: float) -> Fault | None:
    """A force of the mechanism is left out, too large, or of the other sign."""
    if (one := pick(rng, scene.mechanism.forces)) is None:
        return None
    return Fault(
        f"force {one.name} x{size:.3g}",
        ((Truth(("force",), (one.name, one.at.link)),),),
        (Truth(("payload",), (one.at.link,)),),
        lambda m: edits.on_force(m, one.name, lambda f: replace(f, wrench=f.wrench * size)),
    )
