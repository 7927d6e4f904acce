"""Layout and plan of closed loops: offsets in rows of the work space, records in the cells of the plan, and its steps as text."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from flexinv.kernels.jit import jit_lanes
from flexinv.kernels.simd import BLOCK, row
from flexinv.typing import Array, Indices, Unsigned


class RowLayout:
    """Rows of a record: each name has its own, one after the other, so that none lies over another.

    A record of several kinds has a layout for each, over the rows that all of them share; only these kinds lie over one another.
    size : rows of the whole record [-]
    """

    def __init__(self, shared: RowLayout | None = None, /, **sizes: int) -> None:
        """Lay out names with so many rows each [-], after those of a layout that is shared.

        Raises ValueError for a name that the shared layout has, and for one without rows.
        """
        self.first: dict[str, int] = dict(shared.first) if shared else {}
        self.size: int = shared.size if shared else 0
        for name, size in sizes.items():
            if name in self.first:
                raise ValueError(f"row {name} is laid out twice; give the second another name")
            if size < 1:
                raise ValueError(f"row {name} has {size} rows, expected 1 or more")
            self.first[name] = self.size
            self.size += size

    def __getitem__(self, name: str) -> np.uint64:
        """Return the offset of the first row of a name in the record [-]."""
        return row(self.first[name])


# A body of a loop: its axes and its place in those of the root, the direction of one that slides.
_BODY = RowLayout(axis_z=3, at=3, axes=3, axis_y=3, sliding_axis=3)
AXIS_Z = _BODY["axis_z"]
AT = _BODY["at"]
AXES = _BODY["axes"]
AXIS_Y = _BODY["axis_y"]
SLIDING_AXIS = _BODY["sliding_axis"]
BODY_ROWS = _BODY.size
CHAINED = AXES  # where rows of a body in a chain begin among those of its parent, whose axes nobody asks for then
# In the plane its motion, and its joint's acceleration, too.
_PLANE_BODY = RowLayout(_BODY, speed=2, spin=1, spin_rate=1, acceleration=2, kept_acceleration=1)
PLANE_SPEED = _PLANE_BODY["speed"]
PLANE_SPIN = _PLANE_BODY["spin"]
PLANE_SPIN_RATE = _PLANE_BODY["spin_rate"]
PLANE_ACCELERATION = _PLANE_BODY["acceleration"]
KEPT_ACCELERATION = _PLANE_BODY["kept_acceleration"]
PLANE_ROWS = _PLANE_BODY.size
# A closure of any kind: the point of B; d' of the gap; squares of phi, phi', phi''.
_CLOSURE = RowLayout(point=3, gap_rate=3, squares=1, squares_too=1, squares_last=1)
POINT = _CLOSURE["point"]
GAP_RATE = _CLOSURE["gap_rate"]
SQUARES = _CLOSURE["squares"]
SQUARES_TOO = _CLOSURE["squares_too"]
SQUARES_LAST = _CLOSURE["squares_last"]
# One of positions and directions: the gap d and d'', how its ends turn.
_GAP_CLOSURE = RowLayout(_CLOSURE, gap=3, second=3, spin_a=3, spin_b=3, turning_rate=3)
GAP = _GAP_CLOSURE["gap"]
SECOND = _GAP_CLOSURE["second"]
SPIN_A = _GAP_CLOSURE["spin_a"]
SPIN_B = _GAP_CLOSURE["spin_b"]
TURNING_RATE = _GAP_CLOSURE["turning_rate"]
# A reduced one, from which a universal joint is taken: the force of a unit, that of the joint's efforts, and two sizes.
_REDUCED_CLOSURE = RowLayout(_CLOSURE, unit_force=3, joint_force=3, size_of_first=1, size_of_second=1)
UNIT_FORCE = _REDUCED_CLOSURE["unit_force"]
JOINT_FORCE = _REDUCED_CLOSURE["joint_force"]
SIZE = _REDUCED_CLOSURE["size_of_first"]
SIZE_TOO = _REDUCED_CLOSURE["size_of_second"]
# A coupling: phi, phi', phi''.
_COUPLED_CLOSURE = RowLayout(_CLOSURE, coupling=3)
COUPLING_ROWS = _COUPLED_CLOSURE["coupling"]
# After the rows of the largest kind the vectors e of its equations.
CLOSURE_ROWS = max(kind.size for kind in (_GAP_CLOSURE, _REDUCED_CLOSURE, _COUPLED_CLOSURE))
VECTORS = row(CLOSURE_ROWS)
VECTOR = row(3)
# A column: the square of its size, then its entries, row by row; first what a unit rate moves the point of B by.
ENTRIES = row(1)
# Columns of three positions and directions beside them stand side by side, so many at most, sizes first, then row after row.
MOST_COLUMNS = 15
MOST_ROWS = 6  # of a closure
# Of a whole call: the largest square of every lane, and the largest sums, three numbers.
_LIMITS = RowLayout(squares=3, largest=1)
LARGEST = _LIMITS["largest"]
LIMIT_ROWS = _LIMITS.size
# Where a block works: in one step a multiplier and a square, in another the factor by which one row goes from another and whether
# they change places.
_SCRATCH = RowLayout(multiplier=1, square=1)
_EXCHANGE = RowLayout(factor=1, changed=1)
LAMBDA = _SCRATCH["multiplier"]
SQUARE = _SCRATCH["square"]
FACTOR = _EXCHANGE["factor"]
CHANGED = _EXCHANGE["changed"]
SCRATCH_ROWS = max(_SCRATCH.size, _EXCHANGE.size)
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

    offset, axes_a .. state_b : offsets of its rows, of both ends' axes, places and states; numbers : of its constants
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

    plan: Unsigned
    fixed: Array
    size: int
    matrix: Indices
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


def make_choice_of_four(make: Callable[[int], Any]) -> Any:
    """Return the kernel that hands all but its first argument, a number of 0 to 3 [-], to ``make(number)``."""
    one, two, three, four = map(make, range(4))

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
