"""Attachments of links beside their joints, as frozen data: closures of loops, springs between points, given forces.

Laws of springs give the pull, positive where the spring draws its ends together, and its slope.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import scipy  # its parts are loaded when they are asked for: reading a mechanism needs none
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.model import rules
from flexinv.model.frozen import Frozen
from flexinv.model.joint_kinds import KINDS
from flexinv.model.links import Attachment
from flexinv.typing import Array


@dataclass(frozen=True, eq=False)
class GasLaw(Frozen):
    """A polytropic gas behind a piston:  pull = force / (1 - (l - rest) / travel)^exponent.

    force : pull at the length ``rest`` of the spring [N]; travel : volume of the gas there over the piston's area [m]
    exponent : [-], 1 isothermal, 1.4 adiabatic (nitrogen); a strut that pushes has force and travel below zero
    """

    force: float
    travel: float
    exponent: float = 1.0

    RULES: ClassVar[rules.Rules] = {
        "force": rules.make_real_rule("N"),
        "travel": rules.make_real_rule("m"),
        "exponent": rules.make_real_rule("-", 0.0, above=True),
    }

    def _check(self, where: str) -> None:
        if self.travel == 0.0:
            raise InputError(f"{where}travel = 0: expected the volume of the gas over the piston's area, not zero [m]")

    def evaluate_pull(self, length: ArrayLike, rest: float) -> Array:
        """Return the pull [N] at lengths [m] (any shape)."""
        left = 1.0 - (np.asarray(length, dtype=np.float64) - rest) / self.travel
        return np.asarray(self.force * left**-self.exponent)

    def scale_forces(self, factor: float) -> GasLaw:
        """Return the law with all forces times a factor [-]."""
        return replace(self, force=self.force * factor)


@dataclass(frozen=True, eq=False)
class TableLaw(Frozen):
    """A table of pull over length, between its rows by monotone cubics (Fritsch and Carlson), beyond its ends straight.

    length : (rows,) [m], increasing; force : (rows,) [N], the pull there
    """

    length: Array
    force: Array

    RULES: ClassVar[rules.Rules] = {
        "length": rules.make_array_rule((None,), "m"),
        "force": rules.make_array_rule((None,), "N"),
    }

    def _check(self, where: str) -> None:
        if len(self.length) < 2 or (np.diff(self.length) <= 0.0).any():
            raise InputError(f"{where}length = {self.length.tolist()}: expected two lengths or more, increasing [m]")
        if len(self.force) != len(self.length):
            raise InputError(
                f"{where}force has {len(self.force)} numbers: expected {len(self.length)}, one for each length"
            )

    def list_pieces(self) -> Array:
        """Return start [m] and coefficients of falling powers of l - start [N/m^3], [N/m^2], [N/m], [N], (rows + 1, 5)."""
        inner = scipy.interpolate.PchipInterpolator(self.length, self.force)
        ends = inner.derivative()(self.length[[0, -1]])
        before = [-np.inf, 0.0, 0.0, ends[0], self.force[0]]
        after = [self.length[-1], 0.0, 0.0, ends[1], self.force[-1]]
        return np.vstack([before, np.column_stack([self.length[:-1], inner.c.T]), after])

    def evaluate_pull(self, length: ArrayLike, rest: float) -> Array:
        """Return the pull [N] at lengths [m] (any shape); the table's lengths are whole ones, ``rest`` has no part in it."""
        table = self.list_pieces()
        at = np.asarray(length, dtype=np.float64)
        piece = table[np.clip(np.searchsorted(table[:, 0], at, side="right") - 1, 0, len(table) - 1)]
        start, a, b, c, d = np.moveaxis(piece, -1, 0)
        x = at - np.where(np.isfinite(start), start, self.length[0])
        return np.asarray(((a * x + b) * x + c) * x + d)

    def scale_forces(self, factor: float) -> TableLaw:
        """Return the law with all forces times a factor [-]."""
        return TableLaw(self.length, self.force * factor)


SpringLaw = GasLaw | TableLaw


# closure kind -> number of constraints that it puts on the relative motion of its two frames
CLOSURES: dict[str, int] = {
    "fixed": 6, "revolute": 5, "prismatic": 5, "cylindrical": 4,
    "universal": 4, "spherical": 3, "point-on-line": 2, "coupling": 1,
}  # fmt: skip

# Joints that a coupling may tie: those whose coordinate is one number that counts whole turns.
GEARED = tuple(name for name, kind in KINDS.items() if kind.counts_turns)
COUPLED_JOINTS = f"{', '.join(GEARED[:-1])} and {GEARED[-1]} joints"  # in words

# What a closure does that begins to act on frames in relative motion: refuse, or stop it at once (perfectly plastic).
IMPACTS = ("error", "plastic")


_INSTANT = rules.make_real_rule("s", infinite=True)


@dataclass(frozen=True, eq=False)
class Closure(Frozen):
    """A joint that closes a loop: it ties the second frame to the first as a joint of its kind would; or a gear between joints.

    kind : a key of ``CLOSURES``; factors, offset : of a coupling, which ties coordinates of joints of `GEARED` and no
        frames (both on the world): sum factor q = offset, joint names and factors [-], [rad/m]; offset [rad] or [m]
    axis : (3,) [-], unit, in both frames: the free axis of a revolute, prismatic or cylindrical closure, the line of
        point-on-line (in the first frame), the axis of a universal closure that stays with the first frame
    second_axis : (3,) [-], universal: that of the second frame; active : intervals (start, end) [s] when it acts; empty: always
    capture : it ties the frames where they stand when it begins to act, as a hand that grasps; False: they must have met
    impact : what happens when it begins to act on frames that move against each other: one of ``IMPACTS``
    """

    name: str
    kind: str
    first: Attachment
    second: Attachment
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    second_axis: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    active: tuple[tuple[float, float], ...] = ()
    capture: bool = False
    impact: str = "error"
    factors: tuple[tuple[str, float], ...] = ()
    offset: float = 0.0

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text,
        "kind": rules.make_option_rule(CLOSURES),
        "first": rules.make_kind_rule(Attachment),
        "second": rules.make_kind_rule(Attachment),
        "axis": rules.check_unit_vector,
        "second_axis": rules.check_unit_vector,
        "active": rules.make_list_rule(rules.make_pair_rule(_INSTANT, _INSTANT)),
        "capture": rules.check_truth,
        "impact": rules.make_option_rule(IMPACTS),
        "factors": rules.make_list_rule(rules.make_pair_rule(rules.check_text, rules.make_real_rule("-"))),
        "offset": rules.make_real_rule("rad or m"),
    }

    def _check(self, where: str) -> None:
        for start, end in self.active:
            if not start < end:
                raise InputError(f"{where}active = {self.active}: expected intervals (start, end) with start < end [s]")


@dataclass(frozen=True, eq=False)
class Spring(Frozen):
    """A spring and damper between two points: it pulls with  stiffness (l - rest) + damping l'  along their line.

    stiffness : [N/m]; rest : [m], length without force; damping : [N s/m]
    law : of a spring that is not linear; its pull takes the place of  stiffness (l - rest), and stiffness is 0
    """

    name: str
    first: Attachment
    second: Attachment
    stiffness: float
    rest: float = 0.0
    damping: float = 0.0
    law: SpringLaw | None = None

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text,
        "first": rules.make_kind_rule(Attachment),
        "second": rules.make_kind_rule(Attachment),
        "stiffness": rules.make_real_rule("N/m", 0.0),
        "rest": rules.make_real_rule("m"),
        "damping": rules.make_real_rule("N s/m", 0.0),
        "law": rules.make_optional_rule(rules.make_kind_rule(GasLaw, TableLaw)),
    }

    def evaluate_pull(self, length: Array) -> Array:
        """Return the pull without its damping [N] at lengths [m] (any shape)."""
        return self.stiffness * (length - self.rest) if self.law is None else self.law.evaluate_pull(length, self.rest)


@dataclass(frozen=True, eq=False)
class Force(Frozen):
    """A force and a moment on a point of a link, constant or linear between the rows of a table.

    wrench : (n, 6) force [N] then moment [N m]; time : (n,) [s], one row and time 0 for a constant one
    follower : axes of the attachment's frame, which move with the link; else world axes
    """

    name: str
    at: Attachment
    wrench: Array
    time: Array = field(default_factory=lambda: np.zeros(1))
    follower: bool = False

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text, "at": rules.make_kind_rule(Attachment), "wrench": rules.make_array_rule((None, 6), "N, N m"),
        "time": rules.make_array_rule((None,), "s"), "follower": rules.check_truth,
    }  # fmt: skip

    def _check(self, where: str) -> None:
        if not len(self.time) or (np.diff(self.time) <= 0.0).any():
            raise InputError(f"{where}time = {self.time.tolist()}: expected one time or more, increasing [s]")
        if len(self.wrench) != len(self.time):
            raise InputError(f"{where}wrench has {len(self.wrench)} rows: expected {len(self.time)}, one for each time")
