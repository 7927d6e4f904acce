"""Named differences of two descriptions: a cause, its place, its size with unit, and the change that makes A agree with B."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypedDict

from flexinv.model.mechanism import Placement

# What is judged apart: rigid bodies and how they hang together, links that bend, what drives add, what engines do beside, how
# coordinates count, limits.
FAMILIES = ("rigid", "beam", "drive", "feature", "convention", "limits")
Change = tuple[int, str, Any]


class DifferenceEntry(TypedDict):
    """A difference as JSON values; size [unit], effect [N m], [N], share [-]."""

    family: str
    cause: str
    place: str
    size: float
    unit: str
    a: str
    b: str
    hints: list[str]
    effect: float | None
    share: float | None


@dataclass(frozen=True, eq=False)
class Difference:
    """One difference of B from A.

    family : one of ``FAMILIES``; cause : in the field's words; place : "link NAME" or "joint NAME" as A calls it
    size : of the difference [unit]; first, second : both values as text
    changes : fields of A's tree that become B's; hints : what the numbers look like
    effect : largest change of an effort when it alone is left out [N m], [N]; share : of that effort's range [-]
    motion : of all that stands on the world, where that is what differs [m]
    printed : half of the last digit that the files print of it [unit], 0 where they print all
    """

    family: str
    cause: str
    place: str
    size: float
    unit: str
    first: str
    second: str
    changes: tuple[Change, ...] = ()
    hints: tuple[str, ...] = ()
    effect: float | None = None
    share: float | None = None
    printed: float = 0.0
    structural: bool = False
    names: Mapping[str, str] = field(default_factory=dict)
    motion: Placement | None = None

    @property
    def words(self) -> str:
        """Return the difference in a line."""
        size = f" by {self.size:.6g} {self.unit}" if self.unit != "-" else ""
        values = f": {self.first} in A, {self.second} in B" if self.first or self.second else ""
        return f"{self.subject}{size if not values or self.size else ''}{values}"

    @property
    def subject(self) -> str:
        """Return cause and place in words: "position of joint elbow", "mass of link lower"."""
        kind = self.place.partition(" ")[0].removesuffix("s")
        return f"{self.cause.removesuffix(f' of {kind}')} of {self.place}"

    @property
    def plain(self) -> DifferenceEntry:
        """Return the difference as JSON values."""
        return {
            "family": self.family, "cause": self.cause, "place": self.place, "size": self.size, "unit": self.unit,
            "a": self.first, "b": self.second, "hints": list(self.hints), "effect": self.effect, "share": self.share,
        }  # fmt: skip
