"""Mistakes with what drives carry: friction, damping, rotors, gears, and the units of all of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from campaigns.beyond import edits
from campaigns.beyond.fault import ALL, CorrectAnswer, Fault, FaultScenario, RecipeTopic, draw_one
from crosscheck.measures.record import Record, Series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.typing import Array

CHAPTER = RecipeTopic("drives")
SLOW = 0.05  # of the largest rate: where Stribeck's bump ends, where a smoothed sign has turned
UNITS = {"per degree": 180.0 / np.pi, "per rpm": 30.0 / np.pi, "in degrees": np.pi / 180.0}


def list_place_names(scenario: FaultScenario, joint: Joint, have: list[Joint] | None = None) -> tuple[str, ...]:
    """Return the names of a joint's place; where no other joint has the same thing, "all" is one of them."""
    alone = (ALL,) if have is not None and len(have) == 1 else ()
    return (joint.name, *alone)


def make_joint_change(name: str, **values: float) -> Callable[[Mechanism], Mechanism]:
    """Return a change of a mechanism that gives a joint other values."""
    return lambda m: edits.replace_joint(m, name, lambda j: replace(j, **values))  # type: ignore[arg-type]


def make_added_effort(
    name: str, effort: Callable[[Array, Array, Array], Array]
) -> Callable[[Record, Mechanism, Case], Record]:
    """Return a change of a record that adds an effort, of rate, acceleration and the effort itself, to one joint's own.

    effort : of rate (samples,) [rad/s], acceleration and effort (samples,) [N m] gives what is added [N m]
    """

    def update_record(record: Record, mechanism: Mechanism, case: Case) -> Record:
        _, qd, qdd = case.motion.evaluate(mechanism, record.time)
        k = mechanism.v_slices[name].start
        old = record.series[f"torque/{name}"]
        new = replace(old, values=old.values + effort(qd[:, k], qdd[:, k], old.values))
        return replace(record, series={**record.series, old.name: new})

    return update_record


def _list_joints_with(scenario: FaultScenario, field: str) -> list[Joint]:
    """Joints with one coordinate that have a value there."""
    return [j for j in scenario.mechanism.joints if j.nv == 1 and getattr(j, field)]


def _make_factor_recipe(
    field: str, kind: str, word: str
) -> Callable[[FaultScenario, np.random.Generator, float], Fault | None]:
    """A recipe: what a joint has is so many times as large."""

    def draw(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
        have = _list_joints_with(scenario, field)
        if (joint := draw_one(rng, have)) is None:
            return None
        return Fault(
            f"{word} of {joint.name} x{size:.4g}",
            ((CorrectAnswer((kind,), list_place_names(scenario, joint, have)),),),
            (CorrectAnswer(("rotor", "viscous", "dry friction"), list_place_names(scenario, joint)),),
            make_joint_change(joint.name, **{field: getattr(joint, field) * size}),
        )

    return draw


def _make_addition_recipe(
    field: str, kind: str, word: str, power: int
) -> Callable[[FaultScenario, np.random.Generator, float], Fault | None]:
    """A recipe: a joint has more than in the other model, so much that it makes a part of the joint's largest effort."""

    def draw(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
        if (joint := draw_one(rng, scenario.driven)) is None:
            return None
        rate = scenario.rates[joint.name]
        value = size * scenario.find_largest_effort(joint.name) / rate**power
        return Fault(
            f"{word} of {joint.name} +{value:.4g}",
            ((CorrectAnswer((kind,), list_place_names(scenario, joint)),),),
            (CorrectAnswer(("viscous", "dry friction", "quadratic drag"), list_place_names(scenario, joint)),),
            make_joint_change(joint.name, **{field: getattr(joint, field) + value}),
        )

    return draw


CHAPTER("viscous damping", 1.02, 2.0, 0.0, 0.5, -1.0)(_make_factor_recipe("damping", "viscous", "viscous damping"))
CHAPTER("dry friction", 1.02, 1.5, 0.0, -1.0)(_make_factor_recipe("friction", "dry friction", "dry friction"))
CHAPTER("rotor", 1.02, 3.0, 0.0, 0.01, 0.5)(_make_factor_recipe("rotor_inertia", "rotor", "rotor inertia"))
CHAPTER("viscous damping added", 1e-6, 0.005, 0.05, 0.3)(
    _make_addition_recipe("damping", "viscous", "viscous damping", 1)
)
CHAPTER("dry friction added", 1e-6, 0.01, 0.1)(_make_addition_recipe("friction", "dry friction", "dry friction", 0))


@CHAPTER("rotor added", 1e-6, 0.01, 0.1)
def make_rotor_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A rotor that the other model does not have: so much that it makes a part of the joint's largest effort."""
    if (joint := draw_one(rng, scenario.driven)) is None:
        return None
    qdd = scenario.case.motion.evaluate(scenario.mechanism, scenario.time)[2]
    top = float(np.abs(qdd[:, scenario.mechanism.v_slices[joint.name]]).max())
    value = size * scenario.find_largest_effort(joint.name) / top
    return Fault(
        f"rotor inertia of {joint.name} +{value:.4g}",
        ((CorrectAnswer(("rotor",), list_place_names(scenario, joint)),),),
        (CorrectAnswer(("inertia", "mass"), edits.list_body_names(scenario.mechanism, joint.child)),),
        make_joint_change(joint.name, rotor_inertia=joint.rotor_inertia + value),
    )


@CHAPTER("damping in other units", 1.0)
def make_damping_unit_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Damping per degree or per rpm taken for damping per radian, in one joint."""
    have = _list_joints_with(scenario, "damping")
    if (joint := draw_one(rng, have)) is None:
        return None
    unit = draw_one(rng, UNITS)
    return Fault(
        f"viscous damping of {joint.name} {unit}",
        ((CorrectAnswer(("viscous",), list_place_names(scenario, joint, have)),),),
        (),
        make_joint_change(joint.name, damping=joint.damping * UNITS[unit]),
    )


def _make_exchange_recipe(
    field: str, kind: str, word: str
) -> Callable[[FaultScenario, np.random.Generator, float], Fault | None]:
    """A recipe: what belongs to one joint stands in another; each alone explains a part, both together all of it."""

    def draw(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
        joint = draw_one(rng, _list_joints_with(scenario, field))
        other = draw_one(rng, [j for j in scenario.driven if joint is not None and j.name != joint.name])
        if joint is None or other is None:
            return None
        a = getattr(joint, field)
        b = getattr(other, field)
        places = (joint.name, other.name)
        return Fault(
            f"{word} of {joint.name} and {other.name} exchanged",
            ((CorrectAnswer((f"{kind} exchanged", "mix-up"), places),),),
            (CorrectAnswer((kind,), places),),
            lambda m: make_joint_change(other.name, **{field: a})(make_joint_change(joint.name, **{field: b})(m)),
            same=tuple((CorrectAnswer((kind,), (name,)),) for name in places),
        )

    return draw


CHAPTER("damping in another joint")(_make_exchange_recipe("damping", "viscous", "viscous damping"))
CHAPTER("friction in another joint")(_make_exchange_recipe("friction", "dry friction", "dry friction"))
CHAPTER("rotor in another joint")(_make_exchange_recipe("rotor_inertia", "rotor", "rotor inertia"))


def _make_all_joints_recipe(
    field: str, kind: str, word: str
) -> Callable[[FaultScenario, np.random.Generator, float], Fault | None]:
    """A recipe: what all joints have is so many times as large; none, where the size is zero."""

    def draw(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
        have = _list_joints_with(scenario, field)
        if not have:
            return None
        alone = tuple(j.name for j in have) if len(have) == 1 else ()
        return Fault(
            f"{word} of all joints x{size:.4g}",
            ((CorrectAnswer((kind,), (ALL, *alone)),),),
            (CorrectAnswer((kind,), tuple(j.name for j in have)),),
            lambda m: edits.replace_all_joints(m, lambda j: replace(j, **{field: getattr(j, field) * size})),
        )

    return draw


CHAPTER("all damping", 0.0, 2.0)(_make_all_joints_recipe("damping", "viscous", "viscous damping"))
CHAPTER("all friction", 0.0, 1.3)(_make_all_joints_recipe("friction", "dry friction", "dry friction"))
CHAPTER("all rotors", 0.0, 3.0, 1e-4)(_make_all_joints_recipe("rotor_inertia", "rotor", "rotor inertia"))


def _make_friction_fault(
    scenario: FaultScenario,
    rng: np.random.Generator,
    kinds: tuple[str, ...],
    word: str,
    effort: Callable[[FaultScenario, Joint], Array],
) -> Fault | None:
    """A friction that no engine has: what it makes is added to one joint's effort."""
    if (joint := draw_one(rng, scenario.driven)) is None:
        return None
    more = effort(scenario, joint)
    return Fault(
        f"{word} of {joint.name}",
        ((CorrectAnswer(kinds, list_place_names(scenario, joint)),),),
        (
            CorrectAnswer(
                ("viscous", "dry friction", "effort scale", "quadratic drag"), list_place_names(scenario, joint)
            ),
        ),
        record=make_added_effort(joint.name, lambda qd, qdd, tau: more),
    )


def _evaluate_rate(scenario: FaultScenario, joint: Joint) -> Array:
    qd = scenario.case.motion.evaluate(scenario.mechanism, scenario.time)[1]
    return np.asarray(qd[:, scenario.mechanism.v_slices[joint.name].start])


@CHAPTER("stribeck", 0.01, 0.1)
def make_stribeck_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Stribeck's bump at slow rates: a part of the largest effort, beside what friction there is."""

    def evaluate_friction(scenario: FaultScenario, joint: Joint) -> Array:
        rate = _evaluate_rate(scenario, joint)
        slow = SLOW * scenario.rates[joint.name]
        return np.asarray(
            size * scenario.find_largest_effort(joint.name) * np.exp(-((rate / slow) ** 2)) * np.sign(rate)
        )

    return _make_friction_fault(
        scenario, rng, ("stribeck",), f"Stribeck friction of {size:.3g} of the effort", evaluate_friction
    )


@CHAPTER("smoothed friction", 0.05)
def make_smoothed_friction_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Dry friction by a hyperbolic tangent instead of a sign, where there is dry friction."""
    have = [j for j in scenario.driven if j.friction]
    if (joint := draw_one(rng, have)) is None:
        return None
    slow = size * scenario.rates[joint.name]
    return Fault(
        f"dry friction of {joint.name} smoothed below {slow:.3g}",
        ((CorrectAnswer(("stribeck", "smoothed friction", "dry friction"), list_place_names(scenario, joint)),),),
        (CorrectAnswer(("viscous",), list_place_names(scenario, joint)),),
        record=make_added_effort(joint.name, lambda qd, qdd, tau: joint.friction * (np.tanh(qd / slow) - np.sign(qd))),
    )


@CHAPTER("quadratic drag", 0.01, 0.1)
def make_quadratic_drag_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A drag that grows with the square of the rate."""

    def evaluate_friction(scenario: FaultScenario, joint: Joint) -> Array:
        rate = _evaluate_rate(scenario, joint) / scenario.rates[joint.name]
        return np.asarray(size * scenario.find_largest_effort(joint.name) * rate * np.abs(rate))

    return _make_friction_fault(
        scenario, rng, ("quadratic drag",), f"quadratic drag of {size:.3g} of the effort", evaluate_friction
    )


@CHAPTER("friction by load", 0.01, 0.1)
def make_load_friction_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Friction of a gear: a part of the effort itself, against the motion."""

    def evaluate_friction(scenario: FaultScenario, joint: Joint) -> Array:
        tau = scenario.reference.series[f"torque/{joint.name}"].values
        return np.asarray(size * np.abs(tau) * np.sign(_evaluate_rate(scenario, joint)))

    return _make_friction_fault(
        scenario, rng, ("load friction", "gear efficiency"), f"friction of {size:.3g} of the load", evaluate_friction
    )


@CHAPTER("ripple", 0.005, 0.05)
def make_cogging_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Cogging of a motor: an effort that goes round with the angle."""
    if (joint := draw_one(rng, scenario.driven)) is None:
        return None
    q = scenario.case.motion.evaluate(scenario.mechanism, scenario.time)[0]
    if joint.nq != 1:
        return None
    teeth = int(rng.integers(6, 24))
    angle = q[:, scenario.mechanism.q_slices[joint.name].start]
    more = size * scenario.find_largest_effort(joint.name) * np.sin(teeth * angle)
    return Fault(
        f"cogging of {joint.name}, {size:.3g} of its effort",
        ((CorrectAnswer(("ripple",), list_place_names(scenario, joint)),),),
        (),
        record=make_added_effort(joint.name, lambda qd, qdd, tau: more),
    )


def is_effort(series: Series) -> bool:
    """Return True if a series is a drive's effort."""
    return series.quantity == "torque"
