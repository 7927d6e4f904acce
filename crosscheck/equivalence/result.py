"""Result of a comparison: whether two descriptions are the same machine, what differs, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from crosscheck.equivalence.difference import FAMILIES, Difference
from crosscheck.equivalence.judge import Judged
from crosscheck.measures.certificate import Check

if TYPE_CHECKING:
    import pandas as pd

JUDGED = FAMILIES
WORDS = {
    "rigid": "rigid bodies",
    "beam": "links that bend",
    "drive": "drive data",
    "convention": "conventions",
    "limits": "limits",
}
REPAIRED = 1e-9  # of range: what a repair may leave


@dataclass(frozen=True)
class Comparison:
    """Two descriptions, compared.

    first, second : what they are called; matched : how joints were matched, in words
    judged : the differences, sorted; certificate : line by line, B against A; notes : conventions that change no coordinate,
    and what was dropped when the files were lifted, by side
    tolerance : relative to the range of an effort [-]; families : of differences that count; bends : one of them has beams
    """

    first: str
    second: str
    matched: str
    judged: Judged
    certificate: tuple[Check, ...] = ()
    notes: tuple[str, ...] = ()
    dropped: tuple[tuple[str, tuple[str, ...]], ...] = ()
    advice: tuple[tuple[str, tuple[str, ...]], ...] = ()
    tolerance: float = 1e-6
    families: tuple[str, ...] = JUDGED
    strict: bool = False
    elapsed: float = 0.0
    bends: bool = False

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Return every difference that counts, causes first."""
        found = [*self.judged.causes, *self.judged.conventions, *self.judged.limits]
        if self.strict:
            found += [*self.judged.unseen, *self.judged.rounding]
        return tuple(d for d in found if d.family in self.families)

    @property
    def equal(self) -> bool:
        """Return True if nothing that counts differs, and efforts agree within the tolerance."""
        return not self.differences and not self.unexplained

    @property
    def unexplained(self) -> bool:
        """Return True if efforts differ by more than the tolerance although every named difference is put right."""
        return self.judged.after > self.tolerance

    @property
    def told(self) -> tuple[str, ...]:
        """Return the families of which there is something to tell: links that bend only where there are any."""
        return tuple(family for family in JUDGED if family != "beam" or self.bends)

    def verdict(self, family: str) -> str:
        """Return "equal" or "different" for one family of differences."""
        every = [*self.judged.causes, *self.judged.conventions, *self.judged.limits]
        return "different" if any(d.family == family for d in every) else "equal"

    @property
    def sentence(self) -> str:
        """Return the result in a sentence."""
        parts = [f"{WORDS[family]} {self.verdict(family)}" for family in self.told]
        head = "The same machine" if self.equal else "Different"
        if self.unexplained:
            parts.append(f"{self.judged.after:.2g} of the range of an effort is not explained")
        return f"{head}: " + ", ".join(parts) + "."

    @property
    def suspects(self) -> str:
        """Return in a sentence how many numbers of either description look wrong by themselves; "" where none do."""
        counts = {
            side: sum(line.startswith(f"mend {side}") for _, lines in self.advice for line in lines) for side in "AB"
        }
        if not any(counts.values()):
            return ""
        words = [f"{count} of {side}'s" for side, count in counts.items() if count]
        return f"Of the numbers that differ {' and '.join(words)} look wrong by themselves: see what to write."

    def frame(self) -> pd.DataFrame:
        """Return the differences as a table: family, cause, place, size, unit, values, effect [N m], share [-]."""
        import pandas as pd

        columns = ["family", "cause", "place", "size", "unit", "a", "b", "effect", "share", "hints"]
        return pd.DataFrame([d.plain for d in self.differences], columns=columns)

    @property
    def plain(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        groups = ("causes", "conventions", "limits", "rounding", "unseen")
        return {
            "format": "crosscheck-compare/1", "a": self.first, "b": self.second, "equal": self.equal, "tolerance": self.tolerance,
            "verdicts": {family: self.verdict(family) for family in self.told}, "matched": self.matched,
            "effort_before": self.judged.before, "effort_after": self.judged.after,
            "rounding_effort": self.judged.rounding_effort,
            **{name: [d.plain for d in getattr(self.judged, name)] for name in groups},
            "certificate": [
                {"what": c.what, "unit": c.unit, "holds": c.holds, "error": c.error, "scale": c.scale, "words": c.words}
                for c in self.certificate
            ],
            "advice": [{"place": place, "write": list(lines)} for place, lines in self.advice],
            "notes": list(self.notes), "dropped": {side: list(lines) for side, lines in self.dropped},
        }  # fmt: skip
