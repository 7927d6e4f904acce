"""Planted faults: a user's mistake, its place, and the answers that somebody who knows mechanics would accept."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from crosscheck.engines.base import Options, sample_times
from crosscheck.measures.record import Record, Series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.typing import Array

ALL = "all"  # a place: every joint, every body, the whole mechanism
RESTING = 1e-12  # of the fastest joint's rate: a joint that turns no faster is held


@dataclass(frozen=True)
class CorrectAnswer:
    """An answer that is right: one of these quantities, at one of these places (no place: anywhere).

    kinds : keys of `judge.KINDS`; places : names of joints, links, bodies, closures, springs, or ``ALL``
    """

    kinds: tuple[str, ...]
    places: tuple[str, ...] = ()


@dataclass(frozen=True)
class FaultScenario:
    """Scene of planted faults: a mechanism, its motion, the engine that has the fault, and the reference's sizes.

    reference : the unharmed reference's record, from which faults take their sizes
    """

    mechanism: Mechanism
    case: Case
    engine: str
    reference: Record

    @property
    def time(self) -> Array:
        """The sample times [s]."""
        return sample_times(self.case)

    @property
    def rigid(self) -> bool:
        """Return True if no link bends."""
        return self.mechanism.is_rigid

    @property
    def closed(self) -> bool:
        """Return True if links are tied into loops."""
        return bool(self.mechanism.closures)

    @property
    def driven(self) -> list[Joint]:
        """Joints with one coordinate that the motion moves, each with an effort of its own."""
        rates = self.rates
        given = set(self.case.motion.joints(self.mechanism))
        top = max(rates.values(), default=0.0)
        joints = [j for j in self.mechanism.joints if j.nv == 1 and j.actuated and j.name in given]
        return [j for j in joints if rates[j.name] > RESTING * top]

    @property
    def rates(self) -> dict[str, float]:
        """The largest rate of every joint with one coordinate [rad/s] or [m/s], zero where the motion leaves it out."""
        qd = self.case.motion.evaluate(self.mechanism, self.time)[1]
        return {
            j.name: float(np.abs(qd[:, self.mechanism.v_slices[j.name]]).max())
            for j in self.mechanism.joints
            if j.nv == 1
        }

    def find_largest_effort(self, joint: str) -> float:
        """Return the largest effort of a joint with one coordinate [N m] or [N], of all where its own is nothing."""
        peaks = {n: float(np.abs(s.values).max()) for n, s in self.reference.series.items() if s.quantity == "torque"}
        return peaks.get(f"torque/{joint}", 0.0) or max(peaks.values())


def copy_mechanism(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism as it is."""
    return mechanism


def copy_case(mechanism: Mechanism, case: Case) -> Case:
    """Return the case as it is."""
    return case


def copy_record(record: Record, mechanism: Mechanism, case: Case) -> Record:
    """Return the record as it is."""
    return record


def copy_series(series: Mapping[str, Series]) -> dict[str, Series]:
    """Return the series as they are."""
    return dict(series)


@dataclass(frozen=True)
class Fault:
    """One mistake, or two at once, as changes of what one engine is given, builds or returns.

    words : for the reader; parts : for each mistake the answers that are right; near : those that are half right
    same : several things that together are the same as the mistake (a wider strip: more mass and more stiffness): an answer
        that gives all of them at once is right as well
    mechanism, case, options : what the engine is given instead; record : what becomes of what it returns
    raw : what becomes of the series of every single run inside the engine, before its error bars are made
    built : what becomes of the engine's own model once it is built (Pinocchio's and MuJoCo's ``BuiltModel``)
    bars : whether the engine's own error bars tell of the fault, as of a coarse mesh: then they count as bars
    """

    words: str
    parts: tuple[tuple[CorrectAnswer, ...], ...]
    near: tuple[CorrectAnswer, ...] = ()
    mechanism: Callable[[Mechanism], Mechanism] = copy_mechanism
    case: Callable[[Mechanism, Case], Case] = copy_case
    record: Callable[[Record, Mechanism, Case], Record] = copy_record
    raw: Callable[[Mapping[str, Series]], dict[str, Series]] | None = None
    built: Callable[[Any, Mechanism], None] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    bars: bool = False
    same: tuple[tuple[CorrectAnswer, ...], ...] = ()


def join_faults(first: Fault, second: Fault) -> Fault:
    """Return two faults at once; of their engine options the second's count."""

    def update_model(model: Any, mechanism: Mechanism) -> None:
        for one in (first, second):
            if one.built is not None:
                one.built(model, mechanism)

    def update_case(mechanism: Mechanism, motion: Case) -> Case:
        return second.case(mechanism, first.case(mechanism, motion))

    def update_record(one: Record, mechanism: Mechanism, motion: Case) -> Record:
        return second.record(first.record(one, mechanism, motion), mechanism, motion)

    return Fault(
        words=f"{first.words}; and {second.words}",
        parts=(*first.parts, *second.parts),
        near=(*first.near, *second.near),
        mechanism=lambda m: second.mechanism(first.mechanism(m)),
        case=update_case,
        record=update_record,
        raw=second.raw or first.raw,
        built=update_model if first.built or second.built else None,
        options={**first.options, **second.options},
        bars=first.bars or second.bars,
    )


Draw = Callable[[FaultScenario, np.random.Generator, float], Fault | None]


@dataclass(frozen=True)
class Recipe:
    """A kind of mistake: how one is drawn for a scene, and in which sizes it is made, from hardly seen to gross.

    draw : of a scene, a generator and a size gives the fault, or None where the scene has nothing to get wrong so
    """

    name: str
    topic: str
    sizes: tuple[float, ...]
    draw: Draw


class RecipeTopic:
    """The recipes of one topic: ``chapter("name", sizes)`` adds the function below it."""

    def __init__(self, topic: str) -> None:
        """Begin a topic without recipes."""
        self.topic = topic
        self.recipes: list[Recipe] = []

    def __call__(self, name: str, *sizes: float) -> Callable[[Draw], Draw]:
        """Return a decorator that adds a function as a recipe; sizes [-] mean what the function makes of them."""

        def add(draw: Draw) -> Draw:
            self.recipes.append(Recipe(name, self.topic, sizes or (1.0,), draw))
            return draw

        return add


def draw_one(rng: np.random.Generator, things: Any) -> Any:
    """Return one of the things by lot, None where there is none."""
    known = list(things)
    return known[int(rng.integers(len(known)))] if known else None


def join_options(options: Options, fault: Fault) -> dict[str, Any]:
    """Return the engine's options as the user with the fault gives them."""
    return {**options, **fault.options}


def replace_words(fault: Fault, words: str) -> Fault:
    """Return the fault with other words."""
    return replace(fault, words=words)
