"""Refinement of the reference on demand: which steps and meshes it takes where its bar is too wide for a comparison to be judged.

Bars of second order fall to a quarter with half the step, so that the refinement is chosen at once:

    k = log2(bar / wanted) / 2    times half the step or the mesh width

It is bounded: `MOST` halvings of each, and as long as one engine may take for a case.  What is still open then is not judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import BudgetLine, Record
from crosscheck.verdicts.bars import COARSE, PART
from crosscheck.verdicts.baseline import make_comparison_key
from crosscheck.verdicts.compare import Comparison

MOST = {
    "step": 3,
    "mesh": 1,
}  # halvings; a mesh of twice the order takes some four times as long, and its error falls far faster
LONGER = {"step": 2.0, "mesh": 4.0}  # times as long with each of them [-]


@dataclass(frozen=True)
class RefinementHalvings:
    """Halvings of the reference's step and of its mesh width [-]."""

    step: int = 0
    mesh: int = 0

    @property
    def options(self) -> dict[str, int]:
        """Return the options of the reference's adapter."""
        return {"finer_step": self.step, "finer_mesh": self.mesh}

    @property
    def longer(self) -> float:
        """Return the factor by which a run takes longer, roughly [-]."""
        return LONGER["step"] ** self.step * LONGER["mesh"] ** self.mesh


def is_open(row: Comparison) -> bool:
    """Return True if a comparison is not judged because the reference is too coarse."""
    return row.verdict == "unjudged" and row.reference == REFERENCE and row.message.startswith(COARSE)


def find_wanted_refinement(
    rows: Iterable[Comparison], reference: Record, had: RefinementHalvings
) -> RefinementHalvings | None:
    """Return the refinement with which open comparisons of one case may be judged, None where none is left that would help.

    reference : its record with the refinement that it had
    """
    more = {"step": had.step, "mesh": had.mesh}
    for row in filter(is_open, rows):
        names = [n for n, one in reference.series.items() if (one.quantity, one.unit) == (row.quantity, row.unit)]
        for name in names:
            _add_halvings(more, had, reference.budget.get(name, {}), PART * (row.limit or 0.0) * (row.scale or 0.0))
    refinement_halvings = RefinementHalvings(**more)
    return refinement_halvings if refinement_halvings != had else None


def _add_halvings(more: dict[str, int], had: RefinementHalvings, line: BudgetLine, allowed: float) -> None:
    """Add the halvings that a series needs; line : of its budget; allowed : of its bar [unit]."""
    bars = {**line.get("bars", {}), **line.get("left", {})}
    for family, bar in bars.items():
        if family in MOST and allowed > 0.0 and bar > allowed / len(bars):
            halvings = math.ceil(math.log2(bar * len(bars) / allowed) / 2)
            more[family] = max(more[family], min(MOST[family], getattr(had, family) + halvings))


def update_open_rows(rows: Iterable[Comparison], fresh: Iterable[Comparison]) -> list[Comparison]:
    """Return comparisons, open ones as a finer reference judges them."""
    found = {make_comparison_key(row): row for row in fresh}
    return [found.get(make_comparison_key(row), row) if is_open(row) else row for row in rows]
