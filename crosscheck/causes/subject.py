"""Subjects: the input of an engine and the treatment of its answer, which a cause changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Beam, Body, Closure, Joint, Link, Mechanism
from flexinv.model.motion import Motion, evaluate_motion
from flexinv.typing import Array


@dataclass(frozen=True)
class States:
    """Joint motion at some samples: time (samples,) [s]; q (samples, nq), qd, qdd (samples, nv) [rad or m, s]."""

    time: Array
    q: Array
    qd: Array
    qdd: Array


StateChange = Callable[[Mechanism, States], States]
EffortChange = Callable[[Mechanism, States, Array], Array]


@dataclass(frozen=True)
class Subject:
    """A mechanism, its case, what the engine is told, and what happens to the efforts that it gives.

    options : of the engine's adapter
    effort : one after the other, of the mechanism, the joint motion and the efforts (samples, nv) [N m] or [N]
    dense : one of them needs every sample of the case (what was done to a signal), not some of them
    """

    mechanism: Mechanism
    case: Case
    options: Mapping[str, Any] = field(default_factory=dict)
    effort: tuple[EffortChange, ...] = ()
    dense: bool = False

    def replace_mechanism(self, **changes: Any) -> Subject:
        """Return the subject with another mechanism; it is no longer what a URDF file says."""
        return replace(self, mechanism=replace(self.mechanism, urdf=None, **changes))

    def replace_joint(self, name: str, change: Callable[[Joint], Joint]) -> Subject:
        """Return the subject with one joint changed."""
        return self.replace_mechanism(joints=tuple(change(j) if j.name == name else j for j in self.mechanism.joints))

    def replace_closures(self, change: Callable[[Closure], Closure]) -> Subject:
        """Return the subject with every closure changed."""
        return self.replace_mechanism(closures=tuple(map(change, self.mechanism.closures)))

    def replace_joints(self, change: Callable[[Joint], Joint]) -> Subject:
        """Return the subject with every joint changed."""
        return self.replace_mechanism(joints=tuple(map(change, self.mechanism.joints)))

    def replace_link(self, name: str, change: Callable[[Link], Link]) -> Subject:
        """Return the subject with one link changed."""
        return self.replace_mechanism(
            links=tuple(change(link) if link.name == name else link for link in self.mechanism.links)
        )

    def replace_links(self, change: Callable[[Link], Link]) -> Subject:
        """Return the subject with every link changed."""
        return self.replace_mechanism(links=tuple(map(change, self.mechanism.links)))

    def replace_body(self, target: str, change: Callable[[Body], Body]) -> Subject:
        """Return the subject with one body changed; target : see ``bodies``."""
        link, body = self.find_body(target)
        return self.replace_link(
            link, lambda one: replace(one, bodies=tuple(change(b) if b is body else b for b in one.bodies))
        )

    def replace_beam(self, name: str, change: Callable[[Beam], Beam]) -> Subject:
        """Return the subject with the beam of one link changed."""

        def update_link(link: Link) -> Link:
            assert link.beam is not None
            return replace(link, beam=change(link.beam))

        return self.replace_link(name, update_link)

    def add_state_change(self, change: StateChange) -> Subject:
        """Return the subject whose joint motion is changed before the engine gets it."""
        motion = ChangedMotion(self.case.motion.tracks, self.case.motion.duration, self.case.motion, change)
        return replace(self, case=replace(self.case, motion=motion))

    def add_effort_change(self, change: EffortChange, dense: bool = False) -> Subject:
        """Return the subject whose efforts are changed after the engine gave them; dense : it needs every sample."""
        return replace(self, effort=(*self.effort, change), dense=self.dense or dense)

    def update_options(self, **options: Any) -> Subject:
        """Return the subject whose engine is told something else."""
        return replace(self, options={**self.options, **options})

    def find_body(self, target: str) -> tuple[str, Body]:
        """Return link and body by name; of a link that was given another body, its first.  Raises InputError."""
        if target in self.bodies:
            return self.bodies[target]
        link = self.mechanism.link_of.get(target)
        if link is None or not link.bodies:
            raise InputError(f"no body is called {target!r} (any more); known: {', '.join(self.bodies)}")
        return target, link.bodies[0]

    @cached_property
    def bodies(self) -> dict[str, tuple[str, Body]]:
        """Link and body by "link" where it has one body, else "link/body"."""
        result = {}
        for link in self.mechanism.links:
            for body in link.bodies:
                result[link.name if len(link.bodies) == 1 and link.beam is None else f"{link.name}/{body.name}"] = (
                    link.name,
                    body,
                )
        return result


@dataclass(frozen=True, eq=False)
class ChangedMotion(Motion):
    """A motion that is changed where it is evaluated."""

    inner: Motion
    change: StateChange

    def evaluate(
        self, mechanism: Mechanism, time: ArrayLike, side: Literal["left", "right"] = "right"
    ) -> tuple[Array, Array, Array]:
        """Return q (samples, nq), qd and qdd (samples, nv) [rad or m, s], changed."""
        at = np.asarray(time, dtype=np.float64)
        # Benches and fits ask for the same times again and again; what is kept is not to be written into.
        given = (
            evaluate_motion(self.inner, mechanism, at) if side == "right" else self.inner.evaluate(mechanism, at, side)
        )
        states = self.change(mechanism, States(at, *(part.copy() for part in given)))
        return states.q, states.qd, states.qdd
