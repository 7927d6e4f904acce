"""Result of a comparison: whether two descriptions are the same machine, what differs, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

from crosscheck.equivalence.difference import FAMILIES, Difference, DifferenceEntry
from crosscheck.equivalence.judge import Judgement
from crosscheck.equivalence.proof import LOST, UNPROVEN, Proof
from crosscheck.measures.certificate import Check
from flexinv.display.card import Card, Shown

if TYPE_CHECKING:
    import pandas as pd

JUDGED = FAMILIES
WORDS = {
    "rigid": "rigid bodies",
    "beam": "links that bend",
    "drive": "drive data",
    "feature": "engines' own features",
    "convention": "conventions",
    "limits": "limits",
}
EQUAL = "equal"
DIFFERENT = "different"
INCOMPARABLE = "not comparable"
NOT_PROVEN = "not proven"
CODES = {EQUAL: 0, DIFFERENT: 1, INCOMPARABLE: 2, NOT_PROVEN: 2}
REPAIRED = 1e-9  # of range: what a repair may leave


class ProofEntry(TypedDict):
    """Outcome of holding a mechanism against its reader's own model."""

    state: str
    words: str


class CertificateLine(TypedDict):
    """A line of the certificate; error, scale [unit]."""

    what: str
    unit: str
    holds: bool
    error: float | None
    scale: float | None
    words: str


class AdviceEntry(TypedDict):
    """Lines to write at a place."""

    place: str
    write: list[str]


class ComparisonEntry(TypedDict):
    """A comparison as JSON values: the fields of `Comparison`, efforts over their range [-]."""

    format: str
    a: str
    b: str
    equal: bool
    state: str
    tolerance: float
    doubts: list[str]
    ignored: list[str]
    unproven: bool
    proofs: dict[str, ProofEntry]
    verdicts: dict[str, str]
    matched: str
    effort_before: float
    effort_after: float
    rounding_effort: float
    causes: list[DifferenceEntry]
    conventions: list[DifferenceEntry]
    limits: list[DifferenceEntry]
    rounding: list[DifferenceEntry]
    unseen: list[DifferenceEntry]
    certificate: list[CertificateLine]
    advice: list[AdviceEntry]
    notes: list[str]
    dropped: dict[str, list[str]]


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """Two descriptions, compared.

    first, second : what they are called; matched : how joints were matched, in words
    judged : the differences, sorted; certificate : line by line, B against A; notes : conventions that change no coordinate,
    and what was dropped when the files were lifted, by side
    tolerance : relative to the range of an effort [-]; families : of differences that count; bends : one of them has beams
    proofs : by label, what came of holding each mechanism against its reader's own model; unproven : none is needed
    ignored : what of the features is left out, in words; featured : one of them has features
    """

    first: str
    second: str
    matched: str
    judged: Judgement
    certificate: tuple[Check, ...] = ()
    notes: tuple[str, ...] = ()
    dropped: tuple[tuple[str, tuple[str, ...]], ...] = ()
    advice: tuple[tuple[str, tuple[str, ...]], ...] = ()
    tolerance: float = 1e-6
    families: tuple[str, ...] = JUDGED
    strict: bool = False
    elapsed: float = 0.0
    bends: bool = False
    proofs: tuple[tuple[str, Proof], ...] = ()
    unproven: bool = False
    ignored: tuple[str, ...] = ()
    featured: bool = False

    def _make_card(self) -> Card:
        from crosscheck.equivalence.card import make_comparison_card

        return make_comparison_card(self)

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Return every difference that counts, causes first."""
        found = [*self.judged.causes, *self.judged.conventions, *self.judged.limits]
        if self.strict:
            found += [*self.judged.unseen, *self.judged.rounding]
        return tuple(d for d in found if d.family in self.families)

    @property
    def state(self) -> str:
        """Return "equal", "different", "not comparable" or "not proven" [-].

        What a mechanism does not reproduce of its reader's own model comes first: no list of differences is whole then.
        """
        if any(proof.state == LOST for _, proof in self.proofs):
            return INCOMPARABLE
        if self.differences or self.unexplained:
            return DIFFERENT
        return NOT_PROVEN if self.doubts and not self.unproven else EQUAL

    @property
    def code(self) -> int:
        """Return the exit code [-]: 0 the same, 1 different, 2 not comparable or not proven."""
        return CODES[self.state]

    @property
    def equal(self) -> bool:
        """Return True if nothing that counts differs, efforts agree within the tolerance, and both mechanisms are proven."""
        return self.state == EQUAL

    @property
    def doubts(self) -> tuple[str, ...]:
        """Return in words what is not reproduced or not proven of either description."""
        return tuple(f"{label}: {proof.words}" for label, proof in self.proofs if proof.state in (LOST, UNPROVEN))

    @property
    def grounds(self) -> tuple[str, ...]:
        """Return in words the model that each mechanism was held against, and what is left out."""
        held = tuple(f"{label}: {proof.words}" for label, proof in self.proofs)
        return (*held, *self.ignored)

    @property
    def unexplained(self) -> bool:
        """Return True if efforts differ by more than the tolerance although every named difference is put right."""
        return self.judged.after > self.tolerance

    @property
    def told(self) -> tuple[str, ...]:
        """Return the families of which there is something to tell: links that bend only where there are any."""
        absent = {"beam"} if not self.bends else set()
        absent |= {"feature"} if not self.featured else set()
        return tuple(family for family in JUDGED if family not in absent)

    def verdict(self, family: str) -> str:
        """Return "equal" or "different" for one family of differences."""
        every = [*self.judged.causes, *self.judged.conventions, *self.judged.limits]
        return "different" if any(d.family == family for d in every) else "equal"

    @property
    def sentence(self) -> str:
        """Return the result in a sentence."""
        parts = [f"{WORDS[family]} {self.verdict(family)}" for family in self.told]
        if self.unexplained:
            parts.append(f"{self.judged.after:.2g} of the range of an effort is not explained")
        parts += self.ignored
        head = {EQUAL: "The same machine", DIFFERENT: "Different", NOT_PROVEN: "Not proven to be the same machine"}
        if self.state == INCOMPARABLE:
            return f"Not comparable in {'; '.join(self.doubts)}. As lifted: {', '.join(parts)}."
        doubts = f" {'; '.join(self.doubts)}." if self.doubts else ""
        return f"{head[self.state]}: " + ", ".join(parts) + "." + doubts

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
    def plain(self) -> ComparisonEntry:
        """Return the result as JSON values."""
        return {
            "format": "crosscheck-compare/1", "a": self.first, "b": self.second, "equal": self.equal, "state": self.state,
            "tolerance": self.tolerance, "doubts": list(self.doubts), "ignored": list(self.ignored), "unproven": self.unproven,
            "proofs": {label: {"state": proof.state, "words": proof.words} for label, proof in self.proofs},
            "verdicts": {family: self.verdict(family) for family in self.told}, "matched": self.matched,
            "effort_before": self.judged.before, "effort_after": self.judged.after,
            "rounding_effort": self.judged.rounding_effort,
            "causes": [d.plain for d in self.judged.causes], "conventions": [d.plain for d in self.judged.conventions],
            "limits": [d.plain for d in self.judged.limits], "rounding": [d.plain for d in self.judged.rounding],
            "unseen": [d.plain for d in self.judged.unseen],
            "certificate": [
                {"what": c.what, "unit": c.unit, "holds": c.holds, "error": c.error, "scale": c.scale, "words": c.words}
                for c in self.certificate
            ],
            "advice": [{"place": place, "write": list(lines)} for place, lines in self.advice],
            "notes": list(self.notes), "dropped": {side: list(lines) for side, lines in self.dropped},
        }  # fmt: skip
