"""Plan of closed loops: what kernels read of them, its steps as records with names, and as text that a person reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.kernels.simd import BLOCK
from flexinv.rnea.loop_layout import PLANE, SIX, BodyKind, BodyRecord, ClosureKind, ClosureRecord, Operation
from flexinv.typing import Array


class Step(NamedTuple):
    """One step of a plan: what it does; where numbers stand in the work space [-], and pairs of such places."""

    operation: Operation
    first: int = 0
    second: int = 0
    third: int = 0
    pairs: Sequence[tuple[int, int]] = ()

    @property
    def words(self) -> tuple[int, ...]:
        """Return the step as kernels read it [-]."""
        places = self.first, self.second, self.third, *(at for pair in self.pairs for at in pair)
        return self.operation, len(self.pairs), *places


@dataclass(frozen=True, eq=False)
class LoopPlan:
    """Plan of the kernels: ``plan`` of whole numbers, ``fixed`` of others [any unit]; ``size`` of the whole work space [-].

    matrix : (rows, nv) where the entries of G stand, 0 where there are none; sizes : velocity coordinate -> of its columns
    constant : which of these are; effort : where efforts of the velocity coordinates stand
    bodies, closures, steps : the records of ``plan``; rows, coordinates : names of equations and of velocity coordinates
    """

    plan: NDArray[np.uint64]
    fixed: Array
    size: int
    matrix: NDArray[np.int64]
    sizes: dict[int, list[int]]
    constant: frozenset[int] = frozenset()
    effort: tuple[int, ...] = ()
    bodies: tuple[BodyRecord, ...] = ()
    closures: tuple[ClosureRecord, ...] = ()
    steps: tuple[Step, ...] = ()
    rows: tuple[str, ...] = ()
    coordinates: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return the plan as text: bodies, closures, and a line for every step, places by the names of what stands there."""
        names = _Names(self)
        bodies = [BodyKind(body.kind).name.lower().replace("_", " ") for body in self.bodies]
        closures = [ClosureKind(closure.kind).name.lower() for closure in self.closures]
        head = [
            f"{'plane' if self.plan[PLANE] else 'space'}, work space of {self.size // BLOCK} rows",
            f"bodies: {', '.join(bodies) or 'none'}",
            f"closures: {', '.join(closures) or 'none'}",
        ]
        return "\n".join([*head, *(f"{k:3d}  {names.line(step)}" for k, step in enumerate(self.steps, 1))])


class _Names:
    """Names of the places of a work space: G[row, coordinate], size[coordinate], tau[coordinate], and w1, w2 ... for others."""

    def __init__(self, plan: LoopPlan) -> None:
        self.of = {at: f"tau[{name}]" for at, name in zip(plan.effort, plan.coordinates, strict=True)}
        for v, places in plan.sizes.items():
            self.of |= dict.fromkeys(places, f"size[{plan.coordinates[v]}]" if plan.coordinates else f"size[{v}]")
        for r, row in enumerate(plan.matrix.tolist()):
            for v, at in enumerate(row):
                if at > 0 and plan.rows:
                    self.of[at] = f"G[{plan.rows[r]}, {plan.coordinates[v]}]"
        self.others = 0

    def name(self, place: int) -> str:
        if place not in self.of:
            self.others += 1
            self.of[place] = f"w{self.others}"
        return self.of[place]

    def line(self, step: Step) -> str:
        """One step as a line: its operation, and what it does."""
        name, pairs = self.name, step.pairs
        match step.operation:
            case Operation.PAIR:
                more = ", ".join(f"{name(a)} by {name(b)}" for a, b in pairs)
                text = f"{name(step.first)} is the pivot, {name(step.second)} -> 0; so {more or 'nothing else'}"
            case Operation.CHECK_PIVOT:
                text = f"{name(step.first)} is no rounding beside {name(step.second)}, else a rank is in doubt"
            case Operation.CHECK_EMPTY:
                text = f"{name(step.first)} is rounding beside {name(step.second)}, else a rank is in doubt"
            case Operation.SOLVE:
                multiplier = f"lambda = {name(step.second)} / {name(step.first)}, held against {name(step.third)}"
                text = "; ".join([multiplier, *(f"{name(b)} -= lambda {name(a)}" for a, b in pairs)])
            case Operation.NORM:
                text = f"s = sum of weight ({', '.join(name(a) for a, _ in pairs)})^2"
            case Operation.INNER:
                text = f"p = sum of weight {', '.join(f'{name(a)} {name(b)}' for a, b in pairs)}"
            case Operation.PROJECT:
                text = "; ".join(f"{name(b)} -= p / s {name(a)}" for a, b in pairs)
            case Operation.TAKE:
                text = "; ".join(f"{name(b)} -= {name(step.third)} {name(a)}" for a, b in pairs)
            case _:
                found = ", ".join(name(step.third + i * BLOCK) for i in range(SIX))
                text = f"{found}: six forces on the free body of {name(step.second)}"
        return f"{step.operation.name.lower():15}{text}"
