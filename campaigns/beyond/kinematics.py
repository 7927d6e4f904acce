"""Mistakes with gravity, frames, axes, lengths and angles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from campaigns.beyond import edits
from campaigns.beyond.fault import CorrectAnswer, Fault, FaultScenario, RecipeTopic, draw_one
from campaigns.beyond.motions import replace_motion
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Joint, Mechanism
from flexinv.typing import Array

CHAPTER = RecipeTopic("gravity and kinematics")
DEGREE = np.pi / 180.0


def _make_gravity_fault(words: str, kinds: tuple[str, ...], new: Array) -> Fault:
    return Fault(
        words,
        ((CorrectAnswer(kinds),),),
        (CorrectAnswer(("gravity size", "gravity vector", "base pose")),),
        lambda m: replace(edits.drop_urdf(m), gravity=new),
    )


@CHAPTER("size of gravity", 9.80665, 9.8, 10.0, 9.78, 1.62, 981.0)
def make_gravity_size_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Another number for g: the standard's, a rounded one, another place's, one in other units."""
    old = scenario.mechanism.gravity
    if not old.any():
        return None
    new = old / np.linalg.norm(old) * size
    return _make_gravity_fault(f"g = {size:.6g} m/s^2", ("gravity size", "gravity vector"), new)


@CHAPTER("no gravity", 0.0)
def make_gravity_off_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Gravity is switched off, or was never switched on."""
    if not scenario.mechanism.gravity.any():
        return None
    return _make_gravity_fault("gravity is off", ("gravity size", "gravity vector"), np.zeros(3))


@CHAPTER("gravity left on", 1.0)
def make_gravity_on_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The engine's own gravity was left on where the mechanism has none."""
    if scenario.mechanism.gravity.any():
        return None
    new = np.array(draw_one(rng, [[0.0, 0.0, -9.81], [0.0, -9.81, 0.0]]))
    return _make_gravity_fault(f"gravity {new.tolist()} left on", ("gravity size", "gravity vector"), new)


@CHAPTER("gravity upward", 1.0)
def make_gravity_sign_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Gravity is of the other sign: an acceleration of the base, not of the field."""
    if not scenario.mechanism.gravity.any():
        return None
    return _make_gravity_fault(
        "gravity of the other sign", ("gravity size", "gravity vector"), -scenario.mechanism.gravity
    )


@CHAPTER("gravity tilted", 1e-7, 0.3 * DEGREE, DEGREE, 5 * DEGREE, np.pi / 2)
def make_tilted_gravity_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The base does not stand level, or y is up where z was meant."""
    old = scenario.mechanism.gravity
    if not old.any():
        return None
    turn = edits.compute_rotation(edits.draw_normal_vector(old, rng), size)
    return _make_gravity_fault(
        f"gravity tilted by {size / DEGREE:.3g} degrees", ("gravity vector", "base pose"), turn @ old
    )


def _draw_joint(scenario: FaultScenario, rng: np.random.Generator) -> Joint | None:
    joint: Joint | None = draw_one(rng, [j for j in scenario.mechanism.joints if j.kind in ("revolute", "prismatic")])
    return joint


def _make_joint_change(name: str, change: Callable[[Joint], Joint]) -> Callable[[Mechanism], Mechanism]:
    return lambda m: edits.replace_joint(m, name, change)


@CHAPTER("axis sign", 1.0)
def make_axis_sign_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """An axis points the other way; the numbers of the motion are the same."""
    if (joint := _draw_joint(scenario, rng)) is None:
        return None
    return Fault(
        f"axis of {joint.name} the other way",
        ((CorrectAnswer(("axis sign",), (joint.name,)),),),
        (CorrectAnswer(("effort sign", "axis tilt"), (joint.name,)),),
        _make_joint_change(joint.name, lambda j: replace(j, axis=-j.axis)),
    )


@CHAPTER("axis tilted", 1e-7, 0.1 * DEGREE, DEGREE, 10 * DEGREE)
def make_tilted_axis_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """An axis is out of square by a little."""
    if (joint := _draw_joint(scenario, rng)) is None or scenario.closed:
        return None
    turn = edits.compute_rotation(edits.draw_normal_vector(joint.axis, rng), size)
    return Fault(
        f"axis of {joint.name} tilted by {size / DEGREE:.3g} degrees",
        ((CorrectAnswer(("axis tilt",), (joint.name,)),),),
        (CorrectAnswer(("orientation", "gravity vector", "angle offset"), (joint.name, joint.child)),),
        _make_joint_change(joint.name, lambda j: replace(j, axis=turn @ j.axis)),
    )


@CHAPTER("orientation of a joint", 1e-7, 0.2 * DEGREE, 2 * DEGREE)
def make_orientation_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A joint's frame is turned in its parent, in any direction."""
    if (joint := _draw_joint(scenario, rng)) is None or scenario.closed:
        return None
    axis = rng.normal(size=3)
    base = joint.parent == WORLD
    return Fault(
        f"frame of {joint.name} turned by {size / DEGREE:.3g} degrees",
        (
            (
                CorrectAnswer(
                    ("orientation", *(("base pose",) if base else ())), (joint.name, joint.child, joint.parent)
                ),
            ),
        ),
        (CorrectAnswer(("axis tilt", "angle offset", "gravity vector", "base pose")),),
        _make_joint_change(joint.name, lambda j: replace(j, placement=edits.turn_placement(j.placement, axis, size))),
    )


@CHAPTER("angle offset", 1e-7, 0.1 * DEGREE, DEGREE, 5 * DEGREE, np.pi / 2)
def make_zero_offset_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The zero of a joint is elsewhere: a calibration that was not read."""
    joint = draw_one(rng, [j for j in scenario.mechanism.joints if j.kind == "revolute"])
    if joint is None:
        return None
    return Fault(
        f"zero of {joint.name} off by {size / DEGREE:.3g} degrees",
        ((CorrectAnswer(("angle offset",), (joint.name, joint.child)),),),
        (CorrectAnswer(("orientation", "base pose", "gravity vector", "axis tilt")),),
        _make_joint_change(joint.name, lambda j: replace(j, placement=edits.turn_placement(j.placement, j.axis, size))),
    )


@CHAPTER("length of a link", 1e-7, 0.002, 0.01, 0.05)
def make_link_length_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The next joint stands a part farther out: the link is longer; its body is as it was."""
    if (
        joint := draw_one(rng, [j for j in scenario.mechanism.joints if np.linalg.norm(j.placement.position) > 1e-6])
    ) is None:
        return None
    return Fault(
        f"{joint.parent} x{1 + size:.5g} as long up to {joint.name}",
        ((CorrectAnswer(("placement", "length"), (joint.name, joint.parent, joint.child)),),),
        (CorrectAnswer(("payload", "com", "angle offset", "closure"), (joint.parent, joint.child)),),
        _make_joint_change(
            joint.name,
            lambda j: replace(j, placement=replace(j.placement, position=j.placement.position * (1.0 + size))),
        ),
    )


@CHAPTER("place of a joint", 1e-8, 2e-4, 1e-3, 1e-2)
def make_joint_position_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A joint stands elsewhere on its parent, in any direction."""
    if (joint := _draw_joint(scenario, rng)) is None:
        return None
    way = rng.normal(size=3)
    if scenario.closed:  # a loop that is moved out of its plane does not close
        way -= joint.axis * (way @ joint.axis) if joint.kind == "revolute" else way * (1.0 - np.abs(joint.axis))
    by = size * way / np.linalg.norm(way)
    return Fault(
        f"{joint.name} stands {size:.3g} m elsewhere",
        ((CorrectAnswer(("placement", "length"), (joint.name, joint.parent, joint.child)),),),
        (CorrectAnswer(("com", "closure"), (joint.parent, joint.child)),),
        _make_joint_change(joint.name, lambda j: replace(j, placement=edits.move_placement(j.placement, by))),
    )


@CHAPTER("joints in another order", 1.0)
def make_joint_order_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Two joints get each other's motion: the engine's order of joints is another."""
    driven = [j for j in scenario.driven if j.nq == 1]
    if len(driven) < 2 or scenario.closed:
        return None
    a, b = (driven[int(k)] for k in rng.choice(len(driven), 2, replace=False))
    at = (a.name, b.name)

    def update_case(mechanism: Mechanism, case: Case) -> Case:
        def apply_exchange(mechanism: Mechanism, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
            out = q.copy(), qd.copy(), qdd.copy()
            for new, old, where in zip(out, (q, qd, qdd), ("q_slices", "v_slices", "v_slices"), strict=True):
                one, two = (getattr(mechanism, where)[n].start for n in at)
                new[:, [one, two]] = old[:, [two, one]]
            return out

        return replace_motion(case, apply_exchange)

    return Fault(
        f"{a.name} and {b.name} get each other's motion",
        ((CorrectAnswer(("coordinate order",), at),),),
        (CorrectAnswer(("effort order",), at),),
        case=update_case,
    )


@CHAPTER("tip elsewhere", 1e-3)
def make_tip_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The point that is reported is another one; no effort depends on it."""
    link = draw_one(rng, [link for link in scenario.mechanism.links if link.beam is None and link.tip.any()])
    if link is None or "tip" not in scenario.case.quantities:
        return None
    by = size * rng.normal(size=3)
    return Fault(
        f"tip of {link.name} elsewhere",
        ((CorrectAnswer(("tip", "length"), (link.name,)),),),
        (),
        lambda m: edits.replace_link(m, link.name, lambda one: replace(one, tip=one.tip + by)),
    )
