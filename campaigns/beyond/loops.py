"""Mistakes with closures, couplings, springs, given forces, and which joints have the drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from campaigns.beyond import edits
from campaigns.beyond.fault import ALL, CorrectAnswer, Fault, FaultScenario, RecipeTopic, draw_one
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Closure, Force, Mechanism, Placement

CHAPTER = RecipeTopic("closures, springs and forces")


def _list_frame_closures(scenario: FaultScenario) -> list[Closure]:
    return [c for c in scenario.mechanism.closures if c.kind != "coupling"]


def _list_place_names(closure: Closure) -> tuple[str, ...]:
    return (closure.name, closure.first.link, closure.second.link)


@CHAPTER("closure point", 1e-8, 1e-4, 1e-3, 5e-3)
def make_closure_point_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A loop closes at another point of one of its links: off along the link or across it, in the closure's plane."""
    if (closure := draw_one(rng, _list_frame_closures(scenario))) is None:
        return None
    end = draw_one(rng, ["first", "second"])
    if getattr(closure, end).station is not None:
        end = "second" if end == "first" else "first"
    way = edits.draw_normal_vector(closure.axis, rng)

    def update_closure(one: Closure) -> Closure:
        attachment: Attachment = getattr(one, end)
        attachment = replace(attachment, placement=edits.move_placement(attachment.placement, size * way))
        return replace(one, first=attachment) if end == "first" else replace(one, second=attachment)

    link = getattr(closure, end).link
    return Fault(
        f"closure {closure.name} {size:.3g} m off on {link}",
        ((CorrectAnswer(("closure", "length"), _list_place_names(closure)),),),
        (CorrectAnswer(("placement", "angle offset", "com", "length"), (link, *_list_place_names(closure))),),
        lambda m: edits.replace_closure(m, closure.name, update_closure),
    )


@CHAPTER("closure axis", 1e-7, 0.01)
def make_closure_axis_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The axis of a closure is out of square; a loop in a plane does not feel it or does not close."""
    known = [c for c in _list_frame_closures(scenario) if c.kind in ("revolute", "universal", "cylindrical")]
    if (closure := draw_one(rng, known)) is None:
        return None
    turn = edits.compute_rotation(edits.draw_normal_vector(closure.axis, rng), size)
    return Fault(
        f"axis of closure {closure.name} tilted by {size:.3g} rad",
        ((CorrectAnswer(("closure", "axis tilt"), _list_place_names(closure)),),),
        (),
        lambda m: edits.replace_closure(m, closure.name, lambda c: replace(c, axis=turn @ c.axis)),
    )


@CHAPTER("closure of another kind", 1.0)
def make_closure_kind_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A ball where a hinge closes the loop."""
    if (closure := draw_one(rng, [c for c in _list_frame_closures(scenario) if c.kind == "revolute"])) is None:
        return None
    return Fault(
        f"closure {closure.name} is a ball",
        ((CorrectAnswer(("closure", "closure rank"), _list_place_names(closure)),),),
        (),
        lambda m: edits.replace_closure(m, closure.name, lambda c: replace(c, kind="spherical")),
    )


@CHAPTER("gear ratio of a coupling", 1.02, 0.5, -1.0)
def make_gear_ratio_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A gear between two joints has another ratio."""
    if (closure := draw_one(rng, [c for c in scenario.mechanism.closures if c.factors])) is None:
        return None
    joint, factor = closure.factors[0]
    new = ((joint, factor * size), *closure.factors[1:])
    names = (closure.name, *(name for name, _ in closure.factors))
    return Fault(
        f"gear {closure.name} x{size:.4g}",
        ((CorrectAnswer(("closure", "gear ratio"), names),),),
        (CorrectAnswer(("effort scale",), names),),
        lambda m: edits.replace_closure(m, closure.name, lambda c: replace(c, factors=new)),
    )


@CHAPTER("drive on another joint", 1.0)
def make_drive_joint_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """In a loop of one freedom the drive sits on another of its joints."""
    scalar = [j for j in scenario.mechanism.joints if j.nv == 1]
    driven = [j for j in scalar if j.actuated]
    free = [j for j in scalar if not j.actuated]
    if not scenario.closed or len(driven) != 1 or not free:
        return None
    mine = driven[0]
    other = draw_one(rng, free)

    def update_mechanism(mechanism: Mechanism) -> Mechanism:
        mechanism = edits.replace_joint(mechanism, mine.name, lambda j: replace(j, actuated=False))
        return edits.replace_joint(mechanism, other.name, lambda j: replace(j, actuated=True))

    at = (mine.name, other.name)
    return Fault(
        f"the drive is on {other.name} instead of {mine.name}",
        ((CorrectAnswer(("drive place", "effort order"), at),),),
        (CorrectAnswer(("effort sign", "effort scale"), at),),
        update_mechanism,
    )


@CHAPTER("weights of drives", 1.5, 4.0)
def make_drive_weight_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Redundant drives share the work by other weights."""
    driven = [j for j in scenario.mechanism.joints if j.nv and j.actuated]
    if not scenario.closed or len(driven) < 3:
        return None
    joint = draw_one(rng, driven)
    return Fault(
        f"weight of {joint.name} x{size:.3g}",
        ((CorrectAnswer(("weights",), (joint.name,)),),),
        (CorrectAnswer(("effort scale",), (joint.name,)),),
        lambda m: edits.replace_joint(m, joint.name, lambda j: replace(j, weight=j.weight * size)),
    )


@CHAPTER("other branch", 1.0)
def make_assembly_branch_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The loop is assembled on its other side: the guess of its start has the other sign."""
    if not scenario.closed or not scenario.case.start:
        return None

    def update_case(mechanism: Mechanism, case: Case) -> Case:
        return replace(case, start={name: -np.asarray(value) for name, value in case.start.items()})

    return Fault("the loop closes on its other side", ((CorrectAnswer(("branch",)),),), (), case=update_case)


# ------------------------------------------------------------------------------------------------- springs and forces


@CHAPTER("stiffness of a spring", 1.001, 1.05, 0.0, 2.0)
def make_spring_stiffness_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A spring between points, or one in a joint, is stiffer, softer or not there."""
    springs = [("spring", s) for s in scenario.mechanism.springs if s.stiffness]
    joints = [("joint", j) for j in scenario.mechanism.joints if j.stiffness]
    if (found := draw_one(rng, [*springs, *joints])) is None:
        return None
    what, one = found
    words = f"stiffness of {one.name} x{size:.4g}"
    new = one.stiffness * size
    if what == "spring":
        truth = CorrectAnswer(("spring stiffness",), (one.name,))
        ends = (one.name, one.first.link, one.second.link)
        return Fault(
            words,
            ((truth,),),
            (CorrectAnswer(("spring rest", "spring damping", "force"), ends),),
            lambda m: edits.replace_spring(m, one.name, lambda s: replace(s, stiffness=new)),
        )
    right = (CorrectAnswer(("joint spring",), (one.name,)),)
    return Fault(words, (right,), (), lambda m: edits.replace_joint(m, one.name, lambda j: replace(j, stiffness=new)))


@CHAPTER("rest of a spring", 1e-7, 1e-3, 1e-2)
def make_spring_rest_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A spring is without force elsewhere: off by so many metres or radians."""
    springs = [("spring", s) for s in scenario.mechanism.springs if s.stiffness]
    joints = [("joint", j) for j in scenario.mechanism.joints if j.stiffness]
    if (found := draw_one(rng, [*springs, *joints])) is None:
        return None
    what, one = found
    words = f"rest of {one.name} off by {size:.3g}"
    new = one.rest + size
    if what == "spring":
        ends = (one.name, one.first.link, one.second.link)
        return Fault(
            words,
            ((CorrectAnswer(("spring rest",), (one.name,)),),),
            (CorrectAnswer(("spring stiffness", "force"), ends),),
            lambda m: edits.replace_spring(m, one.name, lambda s: replace(s, rest=new)),
        )
    right = (CorrectAnswer(("joint spring", "angle offset"), (one.name,)),)
    return Fault(words, (right,), (), lambda m: edits.replace_joint(m, one.name, lambda j: replace(j, rest=new)))


@CHAPTER("spring in a joint", 0.005, 0.05)
def make_joint_spring_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A hose acts as a spring in a joint that has none in the other model."""
    free = [j for j in scenario.driven if not j.stiffness]
    if (joint := draw_one(rng, free)) is None or joint.nq != 1:
        return None
    q = scenario.case.motion.evaluate(scenario.mechanism, scenario.time)[0][
        :, scenario.mechanism.q_slices[joint.name].start
    ]
    value = size * scenario.find_largest_effort(joint.name) / float(np.abs(q - q[0]).max())
    return Fault(
        f"a spring of {value:.4g} in {joint.name}",
        ((CorrectAnswer(("joint spring",), (joint.name,)),),),
        (),
        lambda m: edits.replace_joint(m, joint.name, lambda j: replace(j, stiffness=value, rest=float(q[0]))),
    )


@CHAPTER("damping of a spring", 0.0, 2.0)
def make_damper_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The damper beside a spring is left out or counted twice."""
    known = [s for s in scenario.mechanism.springs if s.damping]
    if (spring := draw_one(rng, known)) is None:
        return None
    return Fault(
        f"damping of {spring.name} x{size:.3g}",
        ((CorrectAnswer(("spring damping",), (spring.name,)),),),
        (CorrectAnswer(("spring stiffness", "viscous"), (spring.name,)),),
        lambda m: edits.replace_spring(m, spring.name, lambda s: replace(s, damping=s.damping * size)),
    )


@CHAPTER("force at a tip", 1e-7, 0.01, 0.1)
def make_cable_force_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A cable pulls at the tip of the last link, in a direction of the world: a part of the weight or of the effort."""
    links = [link for link in scenario.mechanism.links if link.beam is None and link.tip.any()]
    if not links or any(scenario.engine.startswith(e) for e in ("exudyn-ge", "exudyn-ancf", "mujoco-flex", "exudyn")):
        return None
    link = links[-1]
    way = rng.normal(size=3)
    arm = float(np.linalg.norm(link.tip))
    top = max(float(np.abs(s.values).max()) for s in scenario.reference.series.values() if s.quantity == "torque")
    wrench = np.concatenate([size * top / arm * way / np.linalg.norm(way), np.zeros(3)])[None]
    placement = Placement(position=link.tip)
    pull = Force("pull", Attachment(link.name, placement), wrench)
    return Fault(
        f"a force of {np.linalg.norm(wrench):.3g} N at the tip of {link.name}",
        ((CorrectAnswer(("force",), (link.name,)),),),
        (CorrectAnswer(("payload", "gravity vector"), (link.name, ALL)),),
        lambda m: replace(edits.drop_urdf(m), forces=(*m.forces, pull)),
    )


@CHAPTER("given force", 0.0, 1.05, -1.0)
def make_prescribed_force_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A force of the mechanism is left out, too large, or of the other sign."""
    if (one := draw_one(rng, scenario.mechanism.forces)) is None:
        return None
    return Fault(
        f"force {one.name} x{size:.3g}",
        ((CorrectAnswer(("force",), (one.name, one.at.link)),),),
        (CorrectAnswer(("payload",), (one.at.link,)),),
        lambda m: edits.replace_force(m, one.name, lambda f: replace(f, wrench=f.wrench * size)),
    )
