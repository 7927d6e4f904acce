"""Digits: what the printed digits of two files leave open of a joint's place, of a link's body, of a joint's zero.

A file prints a joint's place in the frame of the link before it.  Where fixed links lie between two that move, each of them adds
its own half digits, and a turn that is printed adds its arm's length times as much to a place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from crosscheck.equivalence.tree import Member, Tree

Halves = Mapping[tuple[str, str], float]
FINE = 5e-3  # relative: half the last of three digits; what is printed less finely shows no angle
ROUNDED = 1e-3  # of how far a slide stands from its carrier: its zero is not rounded where it is farther off
VECTOR = float(np.sqrt(3.0))  # of three numbers, each off by half a digit


@dataclass(frozen=True)
class PrintedDigits:
    """One file's half digits by (element, quantity), and the tree that it describes, with all of its fixed links."""

    tree: Tree
    halves: Halves = field(default_factory=dict)

    def compute_half_digit(self, element: str, quantity: str) -> float:
        """Return the half digit of a number [any unit]; 0 where none is printed."""
        return self.halves.get((element, quantity), 0.0)

    def turn(self, joint: str) -> float:
        """Return the open part of a joint's orientation to the link before it that moves [rad]."""
        return sum((self._compute_frame_half_digit(k, "rotation") for k in self._list_fixed_chain(joint)), 0.0)

    def compute_place_rounding(self, joint: str) -> float:
        """Return the open part of a joint's position on the link before it that moves [m]."""
        return sum(
            (
                self._compute_frame_half_digit(k, "position")
                + self._compute_frame_half_digit(k, "rotation") * self._compute_longest_arm(k)
                for k in self._list_fixed_chain(joint)
            ),
            0.0,
        )

    def compute_zero_rounding(self, joint: str) -> float:
        """Return the open part of the zero of a hinge's coordinate [rad], by its own frame and by all that its link carries."""
        k = self._number.get(joint)
        if k is None:
            return 0.0
        member = self.tree.members[k]
        seen = [
            self.turn(self.tree.members[m].joint)
            for m in (*self.tree.list_moving_children(k), *self._list_fixed_children(k))
        ]
        points = [(self.compute_body_rounding(member, "com"), member.com)]
        points += [
            (self.compute_place_rounding(m.joint), m.placement.position)
            for m in (self.tree.members[n] for n in self.tree.list_children(k))
        ]
        arms = [(open_, float(np.linalg.norm(np.cross(member.axis, point)))) for open_, point in points]
        return self.turn(joint) + max(
            [*seen, *(open_ / arm for open_, arm in arms if 0 < open_ <= FINE * arm)], default=0.0
        )

    def compute_body_rounding(self, member: Member, quantity: str) -> float:
        """Return the open part of a body that is made up of links: mass [kg], com [m] or tensor [kg m^2]."""
        names = [name for name, _ in member.parts] or [member.name]
        if len(names) == 1:
            return self.compute_half_digit(names[0], quantity)
        moved = {name: self._compute_carrier_rounding(name) for name in names}
        total = 0.0
        for name, body in member.parts:
            way, turn = moved[name]
            size = float(np.abs(body.tensor).max(initial=0.0))
            more = {"com": way, "tensor": 2.0 * turn * size + 2.0 * body.mass * way * float(np.linalg.norm(body.com))}
            total += self.compute_half_digit(name, quantity) + more.get(quantity, 0.0)
        return total

    @cached_property
    def _number(self) -> dict[str, int]:
        return {member.joint: k for k, member in enumerate(self.tree.members)}

    @cached_property
    def _links(self) -> dict[str, int]:
        return {member.name: k for k, member in enumerate(self.tree.members)}

    def _compute_frame_half_digit(self, k: int, quantity: str) -> float:
        """The half digit of a member's own frame, under the name of its joint or, where that has none, of its link."""
        member = self.tree.members[k]
        return self.compute_half_digit(member.joint, quantity) or self.compute_half_digit(member.name, quantity)

    def _compute_longest_arm(self, k: int) -> float:
        """Largest distance from a member to its children's places, within one moving link [m]."""
        ways = [float(np.linalg.norm(self.tree.members[m].placement.position)) for m in self.tree.list_children(k)]
        return max(ways, default=0.0) if self.tree.members[k].kind == "fixed" else 0.0

    def _list_fixed_chain(self, joint: str) -> list[int]:
        """A joint's member and the fixed ones between it and the member before it that moves."""
        k = self._number.get(joint, -1)
        fixed_chain = [k] if k >= 0 else []
        while k >= 0 and (k := self.tree.members[k].parent) >= 0 and self.tree.members[k].kind == "fixed":
            fixed_chain.append(k)
        return fixed_chain

    def _list_fixed_children(self, k: int) -> list[int]:
        """The fixed members that a member carries."""
        fixed = [m for m in self.tree.list_children(k) if self.tree.members[m].kind == "fixed"]
        return [*fixed, *(deep for m in fixed for deep in self._list_fixed_children(m))]

    def _compute_carrier_rounding(self, link: str) -> tuple[float, float]:
        """Open part of a fixed link's frame on the link that moves: position [m], orientation [rad]; 0 of that itself."""
        k = self._links.get(link, -1)
        if k < 0 or self.tree.members[k].kind != "fixed":
            return 0.0, 0.0
        joint = self.tree.members[k].joint
        return self.compute_place_rounding(joint), self.turn(joint)


@dataclass(frozen=True)
class PairedDigits:
    """Half digits of both files: of two numbers that should be one the coarser counts."""

    first: PrintedDigits
    second: PrintedDigits

    def compute_joint_rounding(self, one: Member, two: Member, quantity: str) -> float:
        """Return the open part of a joint: "position", "shift" of its zero [m], "rotation", "zero" [rad], or a stated number."""
        sides = ((self.first, one.joint), (self.second, two.joint))
        if quantity in ("position", "shift"):
            rounding = VECTOR * max(sheet.compute_place_rounding(name) for sheet, name in sides)
            return (
                rounding
                if quantity == "position"
                else min(rounding, ROUNDED * float(np.linalg.norm(one.placement.position)))
            )
        if quantity in ("rotation", "zero"):
            return VECTOR * max(
                sheet.turn(name) if quantity == "rotation" else sheet.compute_zero_rounding(name)
                for sheet, name in sides
            )
        return max(sheet.compute_half_digit(name, quantity) for sheet, name in sides)

    def compute_body_rounding(self, one: Member, two: Member, quantity: str) -> float:
        """Return the open part of a body: "mass" [kg], "com" [m], "tensor" [kg m^2]."""
        return max(self.first.compute_body_rounding(one, quantity), self.second.compute_body_rounding(two, quantity))
