"""Words and numbers of a report, the same in every format."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from crosscheck.engines import ENGINES
from crosscheck.measures.limits import VERDICTS, Verdict, find_worst_verdict
from crosscheck.report.explanations import (
    describe_causes,
    describe_diagnosis,
    describe_failing_lines,
    find_diagnosis,
    list_certificates,
)
from crosscheck.verdicts.bars import COARSE
from crosscheck.verdicts.baseline import HOW, UNBLESSED
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.results import CaseRow, Diagnosis, EngineRow, Results, RunRow, StudyRow, is_failing
from crosscheck.verdicts.signals import Move, format_apart

SIGNS: dict[str, str] = {
    "within": "✓",
    "deviation": "✗",
    "error": "!",
    "skipped": "–",
    "unjudged": "?",
    "explained": "≈",
}
MEANINGS: dict[str, str] = {
    "within": "compared, and within the stated limit",
    "deviation": "compared, and farther apart than the limit allows, or of another mechanism (its certificate does not hold)",
    "error": "an engine or the harness failed: nothing is shown",
    "explained": "beyond the limit, and the error bars of both engines, shown by refinements, cover it: the row says how wide",
    "unjudged": "compared, but no limit is stated (or it expired), nothing is blessed yet, or the reference is too coarse",
    "skipped": "the engine cannot do this, or no limit is stated and it says itself why its result differs; nothing is claimed",
}

SHOWN_MOVES = 8  # moved values of one change that a list shows
Trouble = tuple[Verdict, CaseRow | StudyRow, str, str]  # verdict, where, what, message
SHOWN_OF_WIDTH = 2  # digits of an interval's width that its ends show
MOST_DIGITS = 15  # that a number has
NAMED = 3  # models that a sentence names; the list below it has all, with the reasons


@dataclass(frozen=True)
class Cell:
    """One field of the matrix: what an engine is worth on one case; leading: the comparison nearest its limit.

    diagnosis : why its efforts deviate, where that was asked; certificate : what of its certificate does not hold
    """

    case: CaseRow
    engine: str
    verdict: Verdict | None
    leading: Comparison | None
    run: RunRow | None
    comparisons: tuple[Comparison, ...]
    diagnosis: Diagnosis | None = None
    certificate: str = ""

    @property
    def cause(self) -> str:
        """The names of what explains the deviation, "" where nothing does."""
        return describe_causes(self.diagnosis)

    @property
    def is_unclaimed(self) -> bool:
        """Return True where an engine itself says why it differs and no limit is stated: the number alone would be a claim."""
        return self.verdict == "skipped" and self.leading is not None and self.leading.fraction is not None

    @property
    def headline(self) -> str:
        """The words in the field."""
        if self.verdict is None:
            return ""
        if self.is_unclaimed:
            return "not judged"
        if self.leading is not None and self.leading.fraction is not None:
            return format_short(self.leading.fraction)
        if self.run is not None and self.run.status == "ok" and not self.comparisons:
            return "reference"
        if self.run is not None and self.run.status != "ok":
            return self.run.status
        return "no reference" if self.verdict == "error" else self.verdict

    @property
    def detail(self) -> str:
        """The words below it."""
        if self.leading is None or self.leading.fraction is None:
            return format_duration(self.run.wall_time) if self.run is not None and self.run.status == "ok" else ""
        if self.is_unclaimed:
            return f"{self.leading.quantity} {format_short(self.leading.fraction)} apart"
        limit = "no limit" if self.leading.limit is None else f"≤ {format_short(self.leading.limit)}"
        return f"{self.leading.quantity} {limit}"

    @property
    def title(self) -> str:
        """The words that explain it."""
        messages = [c.message for c in self.comparisons if c.verdict == self.verdict and c.message]
        if self.run is not None and self.run.message:
            messages.insert(0, self.run.message)
        if self.certificate and self.certificate not in "; ".join(messages):
            messages.append(f"certificate: {self.certificate}")
        if self.diagnosis is not None:
            messages.append(describe_diagnosis(self.diagnosis))
        if self.verdict is None:
            return "not run"
        return "; ".join(dict.fromkeys([MEANINGS[self.verdict], *messages]))[:500]


def make_cell(results: Results, case: CaseRow, engine: str) -> Cell:
    """Return the field of the matrix for one case and engine."""
    here = (case.mechanism, case.case, engine)
    rows = results.comparisons_of.get(here, ())
    run = next(iter(results.runs_of.get(here, ())), None)
    if run is None:
        return Cell(case, engine, None, None, None, rows)
    verdict = run.verdict if run.status != "ok" or not rows else find_worst_verdict(c.verdict for c in rows)
    certificate = describe_failing_lines(results, *here)
    if certificate and verdict in ("within", "explained", "skipped"):
        verdict = "deviation"
    measured = [c for c in rows if c.fraction is not None]
    leading = max(measured, key=make_sort_key, default=None)
    return Cell(case, engine, verdict, leading, run, rows, find_diagnosis(results, *here), certificate)


def has_taken_part(cells: Iterable[Cell]) -> bool:
    """Return True if an engine did anything in these cases: it ran or failed; only then it has a field in the matrix."""
    return any(one.run is not None and one.run.status != "skipped" for one in cells)


def list_absent_engines(results: Results, cases: Sequence[CaseRow]) -> list[tuple[str, list[str]]]:
    """Return the reasons of engines that have no field for a mechanism with these cases, each with the engines that gave it."""
    reasons: dict[str, list[str]] = {}
    for engine in results.engines:
        cells = [make_cell(results, case, engine.name) for case in cases]
        if not has_taken_part(cells):
            said = dict.fromkeys(one.run.message or "skipped" if one.run is not None else "not run" for one in cells)
            reasons.setdefault("; ".join(said), []).append(engine.name)
    return list(reasons.items())


def describe_scope(results: Results) -> str:
    """Return in words what was compared with what, "" for a run without cases."""
    cases = [case for case in results.cases if not case.problem]
    if not cases:
        return ""
    names = [e.name for e in results.engines if has_taken_part(make_cell(results, case, e.name) for case in cases)]
    scope = (
        f"{_count(len(split_by_mechanism(cases)), 'mechanism', 'mechanisms')}, {_count(len(cases), 'case', 'cases')}"
    )
    scope += f", in {_count(len(names), 'engine', 'engines')} ({', '.join(names)})." if names else ", in no engine."
    compared = dict.fromkeys(c.quantity for c in results.comparisons if c.maximum is not None)
    if compared:
        against = " and ".join(dict.fromkeys(c.reference for c in results.comparisons if c.maximum is not None))
        shared = [name for name in names if name in ENGINES and ENGINES[name].same_steps]
        but = f" but {', '.join(shared)}, which runs the kernels of flexinv in C," if shared else ""
        scope += f" Every engine{but} builds them by itself from the same data; compared with {against}: {', '.join(compared)}."
    return scope


def describe_group(moves: Sequence[Move]) -> list[str]:
    """Return a change of values in lines: how many moved and the reason, then the largest moves."""
    runs = {(move.mechanism, move.case, move.engine) for move in moves}
    reason = moves[0].reason
    head = f"changed since: {reason}" if reason else "nothing that is known has changed"
    counted = f"{_count(len(moves), 'signal', 'signals')} of {_count(len(runs), 'run', 'runs')} moved; {head}"
    left = len(moves) - SHOWN_MOVES
    more = [f"and {left} more"] if left > 0 else []
    return [counted, *(move.words for move in moves[:SHOWN_MOVES]), *more]


def describe_moved(moves: Sequence[Move]) -> str:
    """Return a change of values in one line: how many moved, the reason, the largest move, and what to do."""
    counted, largest = describe_group(moves)[:2]
    return f"{counted}: {largest}; mend the cause, or {HOW}"


def describe_gone(results: Results) -> list[str]:
    """Return lines about what is blessed and not measured any more: one for a case that is gone, else one for each engine."""
    known = {(case.mechanism, case.case) for case in results.cases}
    groups: dict[tuple[str, ...], list[Sequence[str]]] = {}
    for key in results.baseline.get("gone_keys", ()):
        groups.setdefault(tuple(key[:2] if (key[0], key[1]) not in known else key[:3]), []).append(key)
    return [_describe_gone_group(place, keys) for place, keys in groups.items()]


def _describe_gone_group(place: Sequence[str], keys: Sequence[Sequence[str]]) -> str:
    """Return the line about blessed comparisons of a case, or of an engine in a case, that are not measured any more."""
    counted = _count(len(keys), "comparison is blessed", "comparisons are blessed")
    which = ", ".join(dict.fromkeys(key[2 if len(place) == 2 else 4] for key in keys))
    said = "not there any more" if len(place) == 2 else f"{place[2]} is not compared any more"
    return f"{place[0]}/{place[1]}: {said}; {counted} ({which}); bring it back, or {HOW}"


def make_sort_key(row: Comparison) -> tuple[int, float]:
    """Return a key to sort comparisons by: graver verdicts first, then the part of the limit that is used."""
    share = row.fraction or 0.0
    return VERDICTS.index(row.verdict), share / row.limit if row.limit else share


def count_verdicts(results: Results) -> dict[Verdict, int]:
    """Return the number of comparisons by verdict."""
    return {v: sum(c.verdict == v for c in results.comparisons) for v in reversed(VERDICTS)}


def describe_unchanged(results: Results) -> str:
    """Return in words how many results are those of earlier runs, "" where all were computed now."""
    times = [run.kept for run in results.runs] + [study.kept for study in results.studies]
    kept = sorted(filter(None, times))
    if not kept:
        return ""
    words = f"{len(kept)} of {len(times)} results are of earlier runs, unchanged since, the oldest of {kept[0]}"
    return f"{words}; --fresh computes all"


def find_run_verdict(results: Results) -> Verdict:
    """Return the verdict that stands beside the summary of a run: "skipped" where all is well and nothing was judged."""
    if results.exit_code:
        return ("deviation", "error")[results.exit_code - 1]
    judged = [c.verdict for c in results.comparisons] + [s.verdict for s in results.studies]
    return "within" if any(verdict != "skipped" for verdict in judged) else "skipped"


def describe_run(results: Results) -> str:
    """Return the summary of a run that a reader has to know first."""
    gists = [study.gist for study in results.studies if study.gist]
    return " ".join([_describe_verdicts(results), *gists[:NAMED]])


def _describe_verdicts(results: Results) -> str:
    """Return the verdicts of a run in one sentence."""
    tally = count_verdicts(results)
    judged = sum(tally.values()) - tally["skipped"] - tally["explained"]
    wrong = [part for part in (*_count_comparison_troubles(results), *_count_other_troubles(results)) if part]
    if not wrong and results.finished and results.cases and not results.compared:
        return "Nothing was compared."
    if not wrong and results.exit_code == 0:
        return _describe_success(results, judged, tally["explained"])
    if not results.finished and not results.message:
        wrong.append("the run has not finished")
    if results.studies and not results.cases:  # of the selftest, of the benchmark
        done = sum(s.verdict in ("within", "skipped") for s in results.studies)
        said = _describe_some_within(done, len(results.studies), *_STUDIES)
    else:
        said = _describe_some_within(tally["within"], judged, *_COMPARISONS)
    return f"{said}; {', '.join(wrong)}."


def _count_comparison_troubles(results: Results) -> Iterator[str]:
    """Yield what is wrong with comparisons, each kind with its number; "" for what is not there."""
    tally = count_verdicts(results)
    broken = {(r.mechanism, r.case, r.engine) for r in results.runs if r.verdict == "error"}
    alone = [c for c in results.comparisons if c.verdict == "error" and not _find_runs(c) & broken]
    unjudged = [c for c in results.comparisons if c.verdict == "unjudged"]
    coarse = [c for c in unjudged if c.message.startswith(COARSE)]
    bare = [c for c in unjudged if UNBLESSED not in c.message and c not in coarse]
    new = len(unjudged) - len(bare) - len(coarse)
    yield _count(tally["deviation"], "comparison deviates", "comparisons deviate")
    yield _count(len(bare), "comparison has no limit", "comparisons have no limit")
    yield _count(len(coarse), "comparison needs a finer reference", "comparisons need a finer reference")
    yield _count(new, "comparison is not blessed yet", "comparisons are not blessed yet")
    yield _count(len(alone), "comparison is impossible", "comparisons are impossible")


def _count_other_troubles(results: Results) -> Iterator[str]:
    """Yield what is wrong with certificates, runs, models, studies and what was blessed; "" for what is not there."""
    others = {(line.mechanism, line.case, line.engine) for line in results.certificates if is_failing(line)}
    failed = sum(r.verdict == "error" for r in results.runs)
    off = sum(s.verdict not in ("within", "explained", "skipped") for s in results.studies)
    yield _count(len(others), "certificate does not hold", "certificates do not hold")
    yield _count(failed, "run failed", "runs failed")
    yield _describe_unread([c.mechanism for c in results.cases if c.problem])
    yield _count(off, "study is off", "studies are off")
    yield _count(len(results.moves_by_reason), "change moves blessed values", "changes move blessed values")
    yield _count(len(results.baseline.get("gone", ())), "blessed comparison is gone", "blessed comparisons are gone")
    yield results.message


def _describe_success(results: Results, judged: int, explained: int) -> str:
    """Return the sentence of a run in which all is well."""
    if judged:
        said = _describe_all_within(judged, *_COMPARISONS)
        covered = _count(
            explained, "more differs by what checked error bars cover", "more differ by what checked error bars cover"
        )
        return f"{said}; {covered}." if covered else f"{said}."
    if done := sum(s.verdict == "within" for s in results.studies):
        return _describe_all_within(done, *_STUDIES) + "."
    return "Nothing was judged." if results.studies and not results.cases else "Nothing was compared."


def _describe_unread(names: Sequence[str]) -> str:
    """Return the number of models that cannot be read, the first ones by name, in words; "" for none."""
    shown = ", ".join(names[:NAMED]) + (f" and {len(names) - NAMED} more" if len(names) > NAMED else "")
    return f"{_count(len(names), 'model cannot be read', 'models cannot be read')} ({shown})" if names else ""


def list_troubles(results: Results) -> list[Trouble]:
    """Return everything that is not as it should be: verdict, case or study, what, message; the gravest first."""
    rows = [trouble for case in results.cases for trouble in _list_case_troubles(results, case)]
    rows += _list_unblessed(results)
    rows += [
        (s.verdict, s, s.name, describe_study(s)) for s in results.studies if s.verdict not in ("within", "skipped")
    ]
    return sorted(rows, key=lambda row: -VERDICTS.index(row[0]))


def list_trouble_lines(results: Results) -> list[str]:
    """Return lines about everything that is not as it should be, moved and lost values among them, the gravest first."""
    rows = [(v, f"{format_place(where)} {what}: {said}") for v, where, what, said in list_troubles(results)]
    rows += [("deviation", describe_moved(moves)) for moves in results.moves_by_reason.values()]
    rows += [("deviation", line) for line in describe_gone(results)]
    return [f"{SIGNS[v]} {line}" for v, line in sorted(rows, key=lambda row: -VERDICTS.index(row[0]))]


def format_place(where: CaseRow | StudyRow) -> str:
    """Return the place of a trouble in words: its case, or its mechanism where that cannot be read, or "study"."""
    if isinstance(where, StudyRow):
        return "study"
    return f"{where.mechanism}/{where.case}" if where.case else where.mechanism


def _list_case_troubles(results: Results, case: CaseRow) -> Iterator[Trouble]:
    """Yield what is not as it should be in one case: its model, its runs, their certificates, their comparisons."""
    if case.problem:
        yield "error", case, "model", case.problem
    here = (case.mechanism, case.case)
    runs = [r for r in results.runs if (r.mechanism, r.case) == here and r.verdict == "error"]
    for run in runs:
        yield "error", case, run.engine, f"{run.status}: {run.message}"
    for sheet in list_certificates(results, case):
        if sheet.verdict == "deviation":
            yield "deviation", case, f"{sheet.engine} certificate", sheet.text
    failed = {r.engine for r in runs}
    for row in results.comparisons:
        if (row.mechanism, row.case) == here and not _is_said_elsewhere(row, failed):
            text = "; ".join(filter(None, [row.message, find_cause(results, row)]))
            yield row.verdict, case, _describe_comparison(results, row), text


def _is_said_elsewhere(row: Comparison, failed: Collection[str]) -> bool:
    """Return True if nothing is wrong with a comparison, or a row of its run, its certificate or its mechanism says it."""
    if row.verdict in ("within", "skipped", "explained") or row.engine in failed or row.reference in failed:
        return True
    return (row.verdict == "deviation" and row.message == row.uncertified) or _is_new(row)


def _is_new(row: Comparison) -> bool:
    """Return True if nothing else is said of a comparison than that nothing is blessed yet."""
    return row.verdict == "unjudged" and row.message.startswith(UNBLESSED)


def _describe_comparison(results: Results, row: Comparison) -> str:
    """Return engine and quantity of a comparison, with its unit where there are others of that quantity."""
    place = (row.mechanism, row.case, row.engine, row.reference, row.quantity)
    units = {c.unit for c in results.comparisons if place == (c.mechanism, c.case, c.engine, c.reference, c.quantity)}
    return f"{row.engine} {row.quantity}" + (f" [{row.unit}]" if len(units) > 1 else "")


def _list_unblessed(results: Results) -> list[Trouble]:
    """Return one row for each mechanism of which comparisons are not blessed yet: how many, of which engines."""
    rows: list[Trouble] = []
    for cases in split_by_mechanism(results.cases).values():
        new = [c for c in results.comparisons if c.mechanism == cases[0].mechanism and _is_new(c)]
        if new:
            first = next(case for case in cases if case.case == new[0].case)
            engines = ", ".join(dict.fromkeys(c.engine for c in new))
            count = _count(len(new), "comparison", "comparisons")
            rows.append(("unjudged", first, f"{count} ({engines})", new[0].message))
    return rows


def find_cause(results: Results, row: Comparison) -> str:
    """Return the named cause of a comparison of efforts that deviates; "" where none is named."""
    one = find_diagnosis(results, row.mechanism, row.case, row.engine) if row.quantity == "torque" else None
    return (
        f"cause: {describe_diagnosis(one)}" if one is not None and one.named and one.reference == row.reference else ""
    )


def describe_study(study: StudyRow) -> str:
    """Return one line about a study."""
    if study.status != "ok":
        return f"{study.status}: {study.message}"
    tally = {v: sum(row.get("verdict") == v for row in study.rows) for v in reversed(VERDICTS)}
    return ", ".join(f"{n} {v}" for v, n in tally.items() if n) + (f". {study.gist}" if study.gist else "")


def join_alike_comparisons(rows: Iterable[Comparison]) -> list[Comparison]:
    """Return the comparisons, those without numbers and with the same words in one row with all their quantities."""
    groups: dict[Any, list[Comparison]] = {}
    for k, row in enumerate(rows):
        place = (row.mechanism, row.case, row.engine, row.reference)
        same = (*place, row.verdict, row.message) if row.maximum is None else k
        groups.setdefault(same, []).append(row)
    return [
        replace(group[0], quantity=", ".join(dict.fromkeys(row.quantity for row in group)), unit="")
        if len(group) > 1
        else group[0]
        for group in groups.values()
    ]


def format_short(value: float | None) -> str:
    """Return a number in the fewest characters that a reader needs."""
    if value is None:
        return ""
    if value == 0.0:
        return "0"
    if not math.isfinite(value):
        return str(value).replace("inf", "∞")
    if 1e-3 <= abs(value) < 1e4:
        return f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"
    digits, exponent = f"{value:.1e}".split("e")
    return f"{digits.removesuffix('.0')}e{int(exponent)}"


def format_change(before: float | None, after: float | None) -> tuple[str, str]:
    """Return an old and a new number, each in the fewest characters that a reader needs to tell them apart."""
    texts = format_short(before), format_short(after)
    if texts[0] != texts[1] or before is None or after is None:
        return texts
    return format_apart(before, after, 2)


def format_by_width(value: float, width: float) -> str:
    """Return a number with as many digits as show two of an interval's width [unit of the number], and as short as that."""
    if not (math.isfinite(value) and math.isfinite(width) and value and width > 0.0):
        return format_short(value)
    size = math.floor(math.log10(abs(value)))
    digits = min(size - math.floor(math.log10(width)) + SHOWN_OF_WIDTH, MOST_DIGITS)
    if digits <= SHOWN_OF_WIDTH:
        return format_short(value)
    if -3 <= size < 4:
        return f"{value:.{max(digits - 1 - size, 0)}f}"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def format_interval(low: float, high: float) -> str:
    """Return an interval [any unit] in words, with as many digits as tell its ends apart."""
    return f"{format_by_width(low, high - low)} to {format_by_width(high, high - low)}"


def format_duration(seconds: float) -> str:
    """Return a time span [s] in words."""
    if seconds >= 100:
        return f"{int(seconds) // 60} min {int(seconds) % 60} s"
    return f"{seconds:.1f} s" if seconds >= 1 else f"{seconds * 1e3:.3g} ms"


def split_by_mechanism(cases: Iterable[CaseRow]) -> dict[str, list[CaseRow]]:
    """Return the cases of each mechanism."""
    groups: dict[str, list[CaseRow]] = {}
    for case in cases:
        groups.setdefault(case.mechanism, []).append(case)
    return groups


def join_alike_engines(rows: Iterable[EngineRow]) -> list[tuple[EngineRow, list[str]]]:
    """Return one engine of all that say the same of themselves, with the names of these."""
    groups: dict[EngineRow, list[str]] = {}
    for engine in rows:
        groups.setdefault(replace(engine, name=""), []).append(engine.name)
    return list(groups.items())


def _find_runs(row: Comparison) -> set[tuple[str, str, str]]:
    """Return the two runs that a comparison rests on."""
    return {(row.mechanism, row.case, engine) for engine in (row.engine, row.reference)}


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}" if number else ""


_COMPARISONS = ("comparison", "comparisons", "limit")
_STUDIES = ("study", "studies", "target")


def _describe_all_within(number: int, one: str, many: str, limit: str) -> str:
    return f"The {one} is within its {limit}" if number == 1 else f"All {number} {many} are within their {limit}s"


def _describe_some_within(good: int, number: int, one: str, many: str, limit: str) -> str:
    where = f"is within its {limit}" if 1 in (good, number) else f"are within their {limit}s"
    return f"{good} of {number} {one if number == 1 else many} {where}"
