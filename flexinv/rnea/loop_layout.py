"""Layout and plan of closed loops: offsets in rows of the work space, records in the cells of the plan, and its steps as text."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from flexinv.kernels.jit import jit_lanes
from flexinv.kernels.simd import BLOCK, row
from flexinv.typing import Array

# Rows of a body of a loop: its axes and its place in those of the root; the direction of one that slides.
AXIS_Z = row(0)
AT = row(3)
AXES = row(6)
AXIS_Y = row(9)
SLIDING_AXIS = row(12)
BODY_ROWS = 15
CHAINED = AXES  # where rows of a body in a chain begin among those of its parent
# In the plane its motion, and its joint's acceleration, too.
PLANE_SPEED = row(15)
PLANE_SPIN = row(17)
PLANE_SPIN_RATE = row(18)
PLANE_ACCELERATION = row(19)
KEPT_ACCELERATION = row(21)
PLANE_ROWS = 22
# Rows of a closure: the point of B; d' of the gap; squares of phi, phi', phi''.
POINT = row(0)
GAP_RATE = row(3)
SQUARES = row(6)
SQUARES_TOO = row(7)
SQUARES_LAST = row(8)
# of some the gap d and d'', how its ends turn, or of a reduced one u, the force, and two sizes; then vectors e of rows.
GAP = row(9)
SECOND = row(12)
SPIN_A = row(15)
SPIN_B = row(18)
TURNING_RATE = row(21)
UNIT_FORCE = row(9)
JOINT_FORCE = row(12)
SIZE = row(15)
SIZE_TOO = row(16)
VECTORS = row(24)
CLOSURE_ROWS = 24
VECTOR = row(3)
# A column: the square of its size, then its entries, row by row; first what a unit rate moves the point of B by.
ENTRIES = row(1)
# Columns of three positions and directions beside them stand side by side, so many at most, sizes first, then row after row.
MOST_COLUMNS = 15
MOST_ROWS = 6  # of a closure
# Of a whole call: the largest squares of every lane; the largest sums, three numbers.
LARGEST = row(3)
LIMIT_ROWS = 4
# Where a block works: a multiplier, or the factor by which one row goes from another; a square, or whether they change places.
LAMBDA = row(0)
SQUARE = row(1)
SCRATCH_ROWS = 2
FACTOR = LAMBDA
CHANGED = SQUARE
# Six forces on a free body: their multipliers, and limits of the pivots in the last row.
SIX = 6
SIX_ROWS = 7
# The plan: a header of where its tables begin and how long they are, then the tables.
LIMITS = 0
SCRATCH = 1
KEEPS = 2
SUMMED = 4
ROOTS = 6
BODIES = 8
CLOSURE_RECORDS = 10
COLUMNS = 12
STEPS = 14
FILLS = 16
PLANE = 18
APPLIED = 19
HEADER = 20  # fmt: skip


class BodyKind(IntEnum):
    """Kinds of bodies, by their motion beside the one that carries them."""

    ROOT_TURN, TURN, TILT, SLIDE, FLOAT, SCREW, TWO_TURNS, CHAIN = range(8)


class ClosureKind(IntEnum):
    """Kinds of closures: three positions, fewer or directions, or a coupling."""

    WHOLE, PARTIAL, COUPLED = range(3)


class Operation(IntEnum):
    """Operations of the steps of a plan; the kernels take them as plain numbers."""

    PAIR, CHECK_PIVOT, CHECK_EMPTY, SOLVE, NORM, INNER, PROJECT, TAKE, ALL_SIX = range(9)


# The same as plain numbers, which compiled code compares fastest.
ROOT_TURN, TURN, TILT, SLIDE, FLOAT, SCREW, TWO_TURNS, CHAIN = (int(kind) for kind in BodyKind)
WHOLE, PARTIAL, COUPLED = (int(kind) for kind in ClosureKind)
PAIR, CHECK_PIVOT, CHECK_EMPTY, SOLVE, NORM, INNER, PROJECT, TAKE, ALL_SIX = (int(kind) for kind in Operation)
TURNING, SLIDING, FLOATING = range(3)  # joint of a column of G; FLOATING is of a whole joint
NO_GROUND, A_STANDS, B_STANDS = range(3)  # whether an end of the closure stands in the world


class BodyRecord(NamedTuple):
    """Body of a loop in the plan: its kind, and where its rows, those above, those of the recursion and its constants begin."""

    kind: int
    offset: int
    above: int
    rows: int
    constants: int
    place_above: int


class ClosureRecord(NamedTuple):
    """Closure in the plan.

    own, axes_a .. state_b : offsets of its rows, of both ends' axes, places and states; numbers : of its constants
    positions, directions : rows one by one; first, columns .. body_count : the first of its other records, their number
    stride : between entries of a column; reduced : a universal joint is taken from it; ground : the end that stands in the world
    """

    kind: int
    offset: int
    axes_a: int
    axes_b: int
    place_a: int
    place_b: int
    state_a: int
    state_b: int
    numbers: int
    positions: int
    directions: int
    first: int
    columns: int
    first_body: int
    body_count: int
    stride: int
    reduced: int
    ground: int


class ColumnRecord(NamedTuple):
    """Column of G in the plan: offsets of its joint's axis, place, rate and acceleration, of what it writes, of its constants."""

    kind: int
    axis: int
    joint: int
    to: int
    rate: int
    acceleration: int
    signs: int
    effort: int
    entry: int


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
        head = f"{'plane' if self.plan[PLANE] else 'space'}, work space of {self.size // BLOCK} rows"
        parts = f"bodies: {', '.join(bodies) or 'none'}", f"closures: {', '.join(closures) or 'none'}"
        return "\n".join(
            [head, *parts, *(f"{k:3d}  {names.format_step(step)}" for k, step in enumerate(self.steps, 1))]
        )


class _Names:
    """Names of the places of a work space: G[row, coordinate], size[coordinate], tau[coordinate], and w1, w2 ... for others."""

    def __init__(self, plan: LoopPlan) -> None:
        self.of = {at: f"tau[{name}]" for at, name in zip(plan.effort, plan.coordinates, strict=True)}
        for v, places in plan.sizes.items():
            self.of |= dict.fromkeys(places, f"size[{plan.coordinates[v]}]" if plan.coordinates else f"size[{v}]")
        for r, entries in enumerate(plan.matrix.tolist()):
            for v, at in enumerate(entries):
                if at > 0 and plan.rows:
                    self.of[at] = f"G[{plan.rows[r]}, {plan.coordinates[v]}]"
        self.others = 0

    def resolve_name(self, place: int) -> str:
        if place not in self.of:
            self.others += 1
            self.of[place] = f"w{self.others}"
        return self.of[place]

    def fill_pairs(self, pattern: str, step: Step) -> list[str]:
        """A pattern with the names of each pair of places (a, b) of a step, in the order in which it has them."""
        return [self._fill(pattern, a=a, b=b, third=step.third) for a, b in step.pairs]

    def _fill(self, pattern: str, **places: int) -> str:
        return re.sub(r"{(\w+)}", lambda place: self.resolve_name(places[place[1]]), pattern)

    def format_step(self, step: Step) -> str:
        """One step as a line: its operation, and what it does."""
        name = self.resolve_name
        match step.operation:
            case Operation.PAIR:
                more = ", ".join(self.fill_pairs("{a} by {b}", step)) or "nothing else"
                text = f"{name(step.first)} is the pivot, {name(step.second)} -> 0; so {more}"
            case Operation.CHECK_PIVOT:
                text = f"{name(step.first)} is no rounding beside {name(step.second)}, else a rank is in doubt"
            case Operation.CHECK_EMPTY:
                text = f"{name(step.first)} is rounding beside {name(step.second)}, else a rank is in doubt"
            case Operation.SOLVE:
                multiplier = f"lambda = {name(step.second)} / {name(step.first)}, held against {name(step.third)}"
                text = "; ".join([multiplier, *self.fill_pairs("{b} -= lambda {a}", step)])
            case Operation.NORM:
                text = f"s = sum of weight ({', '.join(self.fill_pairs('{a}', step))})^2"
            case Operation.INNER:
                text = f"p = sum of weight {', '.join(self.fill_pairs('{a} {b}', step))}"
            case Operation.PROJECT:
                text = "; ".join(self.fill_pairs("{b} -= p / s {a}", step))
            case Operation.TAKE:
                text = "; ".join(self.fill_pairs("{b} -= {third} {a}", step))
            case _:
                found = ", ".join(name(step.third + i * BLOCK) for i in range(SIX))
                text = f"{found}: six forces on the free body of {name(step.second)}"
        return f"{step.operation.name.lower():15}{text}"


def _make_record_reader(record: type[Any], table: int) -> Any:
    """The kernel that gives a record by its number in a table of the plan."""
    count = len(record._fields)

    @jit_lanes
    def read_record(plan, number):
        return record(*to_fixed_tuple(plan[plan[table] + number * np.uint64(count) :], count))  # type: ignore[call-arg]

    return read_record


body_at = _make_record_reader(BodyRecord, BODIES)
closure_at = _make_record_reader(ClosureRecord, CLOSURE_RECORDS)
column_at = _make_record_reader(ColumnRecord, COLUMNS)


def make_choice_of_four(make: Callable[[int], Any], first: int) -> Any:
    """Return the kernel that hands all but its first argument, a number of 0 to 3 [-], to ``make(first + number)``."""
    one, two, three, four = (make(first + number) for number in range(4))

    @jit_lanes
    def run_choice(number, *given):
        if number == 0:
            one(*given)
        elif number == 1:
            two(*given)
        elif number == 2:
            three(*given)
        else:
            four(*given)

    return run_choice
