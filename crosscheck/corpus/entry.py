"""One case of the corpus as plain data: ``consensus.json`` of its kit, the same bytes for the same records."""

from __future__ import annotations

from collections import Counter
from typing import NotRequired, TypedDict, cast

from crosscheck.corpus.consensus import REACHED, SINGLE, CaseConsensus, Contribution, SeriesConsensus
from crosscheck.corpus.intervals import FLOOR
from crosscheck.corpus.notes import MechanismNote
from crosscheck.corpus.published import PublishedComparison
from crosscheck.kit.resolved import build_case_file
from crosscheck.measures.record import PlainCertificate, Record, Series
from crosscheck.verdicts.compare import compute_signal_range
from crosscheck.verdicts.results import make_slug
from flexinv.model.mechanism import Mechanism

FORMAT = "crosscheck-corpus/1"
CLASSES = ("rigid", "loops", "beams", "flexible loops")
FLOOR_REASON = (
    f"every bar is at least {FLOOR:g} of the largest value of its quantity and unit: a bar of closed formulas is what the last "
    "digits of the input change, which may be nothing, while another code rounds in another order (1e4 operations of 1e-16 each)"
)


class VoiceEntry(TypedDict):
    """One engine on one series; what is empty is left out; outside : share of samples [-]."""

    engine: str
    author: NotRequired[str]
    version: NotRequired[str]
    part: str
    outside: NotRequired[float]
    reason: NotRequired[str]


# Keys of ``consensus.json`` that are no names of Python stand in this form.  Sizes, half-widths and ranges [unit].
_BandEntry = TypedDict("_BandEntry", {"half-width": float, "range": float}, total=False)


class _CauseEntry(TypedDict, total=False):
    cause: str


class SeriesEntry(_BandEntry, _CauseEntry):
    """One series: status, size and band [unit], cause of a disagreement, and all engines that gave it."""

    name: str
    unit: str
    status: str
    size: float
    engines: list[VoiceEntry]


class _NoteEntry(TypedDict, total=False):
    note: str


class PublishedEntry(_NoteEntry):
    """A published number and what stands beside it; value, low, high, distance [unit]."""

    series: str
    when: str
    value: float
    unit: str
    source: str
    low: float | None
    high: float | None
    agrees: bool | None
    distance: float | None


class FloorEntry(TypedDict):
    """The least bar, as a share of the largest value [-], and why."""

    share: float
    reason: str


class _RecipeEntry(TypedDict, total=False):
    recipe: list[str]


_CaseEntry = TypedDict(
    "_CaseEntry",
    {
        "format": str,
        "id": str,
        "mechanism": str,
        "case": str,
        "title": str,
        "class": str,
        "status": str,
        "every series": bool,
        "counts": dict[str, int],
        "authors": list[str],
        "case.json": str,
        "source": str,
        "case source": str,
        "licence": str,
        "attribution": str,
        "redistribute": bool,
        "floor": FloorEntry,
        "series": list[SeriesEntry],
        "published": list[PublishedEntry],
    },
)


class CaseEntry(_CaseEntry, _RecipeEntry):
    """One case of a corpus: ``consensus.json``; recipe : steps to its kit, where that may not be passed on."""


def find_class(mechanism: Mechanism) -> str:
    """Return the class of a mechanism: rigid, loops, beams or flexible loops; a coupling of joints is a loop."""
    looped = bool(mechanism.closures)
    if mechanism.is_rigid:
        return "loops" if looped else "rigid"
    return "flexible loops" if looped else "beams"


def make_case_id(mechanism: str, case: str) -> str:
    """Return the id of a case: a name for files and links that changes only where mechanism or case is called otherwise."""
    return make_slug(f"{mechanism}-{case}")


def make_entry(case: CaseConsensus, note: MechanismNote, numbers: list[PublishedComparison]) -> CaseEntry:
    """Return one case of the corpus as plain data [units of its series]."""
    task = case.task
    counts = Counter(one.status for one in case.series)
    recipe: _RecipeEntry = {}
    if not note.redistribute:
        recipe["recipe"] = list_kit_steps(task.folder.name, task.case.name, note)
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
        **recipe,
        "floor": {"share": FLOOR, "reason": FLOOR_REASON},
        "series": [describe_series(one) for one in case.series],
        "published": [_describe_published(one) for one in numbers],
    }


def list_kit_steps(mechanism: str, case: str, note: MechanismNote) -> list[str]:
    """Return the steps that lead to a kit [-] whose data may not be passed on."""
    return [note.recipe or "Ask who made it.", f"crosscheck kit {mechanism} --case {case} --blind --out kit"]


def describe_series(one: SeriesConsensus) -> SeriesEntry:
    """Return a series of a case as plain data [unit of it]."""
    band: _BandEntry = {}
    if one.interval is not None:
        band["half-width"] = float(one.interval.half.max())
        band["range"] = compute_signal_range([one.interval.middle])
    cause: _CauseEntry = {"cause": one.cause} if one.cause else {}
    return {
        "name": one.name,
        "unit": one.unit,
        "status": one.status,
        "size": one.size,
        **band,
        **cause,
        "engines": [_describe_voice(v) for v in one.voices],
    }


def _describe_voice(voice: Contribution) -> VoiceEntry:
    plain = {
        "engine": voice.engine,
        "author": voice.author,
        "version": voice.version,
        "part": voice.part,
        "outside": voice.outside,
        "reason": voice.reason,
    }
    return cast(VoiceEntry, {key: value for key, value in plain.items() if value not in ("", None)})


def _describe_published(one: PublishedComparison) -> PublishedEntry:
    value = one.value
    note: _NoteEntry = {"note": value.note} if value.note else {}
    return {
        "series": value.series,
        "when": one.when,
        "value": value.value,
        "unit": value.unit,
        "source": value.source,
        **note,
        "low": one.low,
        "high": one.high,
        "agrees": one.agrees,
        "distance": one.distance,
    }


def make_expected_record(case: CaseConsensus, reference: Record | None) -> Record:
    """Return the consensus as a record: middle and half-width [unit of each series], with the reference's own certificate."""
    found = {
        one.name: Series(one.name, one.unit, one.interval.middle, one.interval.half)
        for one in case.series
        if one.status in REACHED and one.interval is not None
    }
    kept: PlainCertificate = {"problem": "no reference was run"}
    if reference is not None and reference.certificate:
        kept = reference.certificate
    return Record(engine="consensus", version=FORMAT, time=case.task.time, series=found, certificate=kept)


def list_single_author_series(case: CaseConsensus) -> list[Series]:
    """Return the values [unit] of series that one author alone gives: no consensus, and told apart from it."""
    return [one.sole for one in case.series if one.status == SINGLE and one.sole is not None]
