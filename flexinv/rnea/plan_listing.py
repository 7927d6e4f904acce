"""Listing of a plan of closed loops: its steps as records with names, and as text that a person reads."""

from __future__ import annotations

from dataclasses import dataclass

from flexinv.kernels.simd import BLOCK
from flexinv.rnea.loop_layout import (
    BODIES,
    BODY_CELLS,
    BOTH,
    CLOSURE_CELLS,
    CLOSURES,
    INVERTED,
    PLANE,
    STEPS,
    TOGETHER,
    BodyKind,
    ClosureKind,
    Operation,
)
from flexinv.rnea.loop_tables import LoopPlan


@dataclass(frozen=True)
class Step:
    """One step of a plan.

    operation : what it does; side_by_side : entries before the pivot's that TOGETHER and BOTH combine in one pass [-]
    inverted : it leaves 1 / pivot; first, second, third : where numbers stand in the work space [-]; pairs : of such places
    """

    operation: Operation
    first: int
    second: int
    third: int
    pairs: tuple[tuple[int, int], ...] = ()
    side_by_side: int = 0
    inverted: bool = False


def steps(plan: LoopPlan) -> tuple[Step, ...]:
    """Return the steps of a plan [-], in the order in which the kernel does them."""
    words, out = [int(word) for word in plan.plan], list[Step]()
    at = words[STEPS]
    for _ in range(words[STEPS + 1]):
        kind, count, *places = words[at : at + 5]
        cells = words[at + 5 : at + 5 + 2 * count]
        at += 5 + 2 * count
        inverted = kind >= TOGETHER + INVERTED
        kind -= INVERTED * inverted
        base = BOTH if kind >= BOTH else TOGETHER if kind >= TOGETHER else kind
        beside = kind - base + 1 if kind >= TOGETHER else 0
        pairs = tuple(zip(cells[::2], cells[1::2], strict=True))
        out.append(Step(Operation(base), places[0], places[1], places[2], pairs, beside, inverted))
    return tuple(out)


def listing(plan: LoopPlan) -> str:
    """Return a plan as text: bodies, closures, and a line for every step, places by the names of what stands there."""
    words, names = [int(word) for word in plan.plan], _Names(plan)
    bodies = _kinds(words, BODIES, int(BODY_CELLS), BodyKind)
    closures = _kinds(words, CLOSURES, int(CLOSURE_CELLS), ClosureKind)
    head = [
        f"{'plane' if words[PLANE] else 'space'}, work space of {plan.size // BLOCK} rows",
        f"bodies: {', '.join(bodies) or 'none'}",
        f"closures: {', '.join(closures) or 'none'}",
    ]
    return "\n".join([*head, *(f"{k:3d}  {names.line(step)}" for k, step in enumerate(steps(plan), 1))])


def _kinds(words: list[int], table: int, cells: int, kinds: type[BodyKind] | type[ClosureKind]) -> list[str]:
    first, count = words[table], words[table + 1]
    return [kinds(words[first + cells * i]).name.lower().replace("_", " ") for i in range(count)]


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

    def names(self, first: int, count: int) -> list[str]:
        return [self.name(first + i * BLOCK) for i in range(count)]

    def line(self, step: Step) -> str:
        """One step as a line: its operation, and what it does."""
        one, other, name, pairs = self.name, self.name, self.name, step.pairs
        inverse = "; 1 / pivot is left" if step.inverted else ""
        match step.operation:
            case Operation.PAIR:
                more = ", ".join(f"{one(a)} by {other(b)}" for a, b in pairs)
                text = f"{name(step.first)} is the pivot, {name(step.second)} -> 0; so {more or 'nothing else'}"
            case Operation.TOGETHER | Operation.BOTH:
                rows = [step.first, step.second, *([step.third] if step.operation is Operation.BOTH else [])]
                entries = [self.names(at, step.side_by_side + 1) for at in rows]
                zeros = " and ".join(f"{row[-1]} -> 0" for row in entries[1:])
                more = ", ".join(
                    f"{a} by {b}" for row in entries[1:] for a, b in zip(entries[0], row[:-1], strict=False)
                )
                text = f"{entries[0][-1]} is the pivot, {zeros}; so {more}{inverse}"
            case Operation.CHECK_PIVOT:
                text = f"{name(step.first)} is no rounding beside {name(step.second)}, else a rank is in doubt"
            case Operation.CHECK_EMPTY:
                text = f"{name(step.first)} is rounding beside {name(step.second)}, else a rank is in doubt"
            case Operation.SOLVE | Operation.SOLVE_INVERTED:
                multiplier = f"lambda = {name(step.second)} / {name(step.first)}, held against {name(pairs[0][0])}"
                text = "; ".join([multiplier, *(f"{name(b)} -= lambda {name(a)}" for a, b in pairs[1:])])
            case Operation.NORM:
                text = f"s = sum of weight ({', '.join(name(a) for a, _ in pairs)})^2"
            case Operation.INNER:
                text = f"p = sum of weight {', '.join(f'{name(a)} {name(b)}' for a, b in pairs)}"
            case Operation.PROJECT:
                text = "; ".join(f"{name(b)} -= p / s {name(a)}" for a, b in pairs)
            case Operation.TAKE:
                text = "; ".join(f"{name(b)} -= {name(step.third)} {name(a)}" for a, b in pairs)
            case Operation.UNDO:
                text = f"multipliers {name(step.first)}, {name(step.second)} of the combined rows -> of the rows as they were"
            case _:
                text = f"{', '.join(self.names(step.third, 6))}: six forces on the free body of {name(step.second)}"
        return f"{step.operation.name.lower():15}{text}"
