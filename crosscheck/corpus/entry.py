"""One case of the corpus as plain data: ``consensus.json`` of its kit, the same bytes for the same records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from crosscheck.corpus.consensus import REACHED, SINGLE, CaseConsensus, Contribution, SeriesConsensus
from crosscheck.corpus.intervals import FLOOR
from crosscheck.corpus.notes import MechanismNote
from crosscheck.corpus.published import PublishedComparison
from crosscheck.kit.resolved import build_case_file
from crosscheck.measures.record import Record, Series
from crosscheck.verdicts.compare import compute_signal_range
from crosscheck.verdicts.results import make_slug
from flexinv.model.mechanism import Mechanism

FORMAT = "crosscheck-corpus/1"
CLASSES = ("rigid", "loops", "beams", "flexible loops")
FLOOR_REASON = (
    f"every bar is at least {FLOOR:g} of the largest value of its quantity and unit: a bar of closed formulas is what the last "
    "digits of the input change, which may be nothing, while another code rounds in another order (1e4 operations of 1e-16 each)"
)


def find_class(mechanism: Mechanism) -> str:
    """Return the class of a mechanism: rigid, loops, beams or flexible loops; a coupling of joints is a loop."""
    looped = bool(mechanism.closures)
    if mechanism.is_rigid:
        return "loops" if looped else "rigid"
    return "flexible loops" if looped else "beams"


def make_case_id(mechanism: str, case: str) -> str:
    """Return the id of a case: a name for files and links that changes only where mechanism or case is called otherwise."""
    return make_slug(f"{mechanism}-{case}")


def make_entry(case: CaseConsensus, note: MechanismNote, numbers: list[PublishedComparison]) -> dict[str, Any]:
    """Return one case of the corpus as plain data [units of its series]."""
    task = case.task
    counts = Counter(one.status for one in case.series)
    return {
        "format": FORMAT,
        "id": make_case_id(task.folder.name, task.case.name),
        "mechanism": task.folder.name,
        "case": task.case.name,
        "title": task.case.title or task.mechanism.title,
        "class": find_class(task.mechanism),
        "status": case.status,
        "every series": case.whole,
        "counts": dict(sorted(counts.items())),
        "authors": sorted({v.author for one in case.series for v in one.voices if v.part == "agrees"}),
        "case.json": build_case_file(task.mechanism, task.case).digest,
        "source": task.mechanism.source,
        "case source": task.case.source,
        "licence": note.licence,
        "attribution": note.attribution,
        "redistribute": note.redistribute,
        **({} if note.redistribute else {"recipe": list_kit_steps(task.folder.name, task.case.name, note)}),
        "floor": {"share": FLOOR, "reason": FLOOR_REASON},
        "series": [_describe_series(one) for one in case.series],
        "published": [_describe_published(one) for one in numbers],
    }


def list_kit_steps(mechanism: str, case: str, note: MechanismNote) -> list[str]:
    """Return the steps that lead to a kit [-] whose data may not be passed on."""
    return [note.recipe or "Ask who made it.", f"crosscheck kit {mechanism} --case {case} --blind --out kit"]


def _describe_series(one: SeriesConsensus) -> dict[str, Any]:
    where = one.interval
    known: dict[str, Any] = {} if where is None else {"half-width": float(where.half.max())}
    return {
        "name": one.name,
        "unit": one.unit,
        "status": one.status,
        "size": one.size,
        **known,
        **({"range": compute_signal_range([where.middle])} if where is not None else {}),
        **({"cause": one.cause} if one.cause else {}),
        "engines": [_describe_voice(v) for v in one.voices],
    }


def _describe_voice(voice: Contribution) -> dict[str, Any]:
    plain = {
        "engine": voice.engine,
        "author": voice.author,
        "version": voice.version,
        "part": voice.part,
        "outside": voice.outside,
        "reason": voice.reason,
    }
    return {key: value for key, value in plain.items() if value not in ("", None)}


def _describe_published(one: PublishedComparison) -> dict[str, Any]:
    value = one.value
    said = {"series": value.series, "when": one.when, "value": value.value, "unit": value.unit, "source": value.source}
    why = {"note": value.note} if value.note else {}
    return {**said, **why, "low": one.low, "high": one.high, "agrees": one.agrees, "distance": one.distance}


def make_expected_record(case: CaseConsensus, reference: Record | None) -> Record:
    """Return the consensus as a record: middle and half-width [unit of each series], with the reference's own certificate."""
    found = {
        one.name: Series(one.name, one.unit, one.interval.middle, one.interval.half)
        for one in case.series
        if one.status in REACHED and one.interval is not None
    }
    told: Mapping[str, Any] = {} if reference is None else reference.certificate
    kept = told or {"problem": "no reference was run"}
    return Record(engine="consensus", version=FORMAT, time=case.task.time, series=found, certificate=kept)


def list_single_author_series(case: CaseConsensus) -> list[Series]:
    """Return the values [unit] of series that one author alone gives: no consensus, and told apart from it."""
    return [one.sole for one in case.series if one.status == SINGLE and one.sole is not None]
