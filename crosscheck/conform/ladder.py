"""The ladder: its rungs, and from the results of a run which of them an engine holds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NotRequired, TypedDict

from crosscheck.measures.limits import BY_DISCRETISATION, Verdict, find_worst_verdict
from crosscheck.report.words import format_short
from crosscheck.run.run_state import INTERRUPTED
from crosscheck.verdicts.compare import Comparison, compute_fraction
from crosscheck.verdicts.results import Results, RunRow, StudyRow, is_failing

VERSION = "crosscheck-ladder/1"
FOLDER = Path(__file__).with_name("ladder")
CERTIFICATE = "certificate"
# Folder of a rung, and what it asks for beside those before.
RUNGS = {
    "double_pendulum": "double pendulum",
    "tree": "tree with a branch, a slide and full inertia tensors",
    "free_base": "free base",
    "drives": "drives: rotors, gears, damping, dry friction, a spring",
    "loop": "closed loop",
    "gears": "couplings of joints in a loop",
    "redundant_drives": "more drives than freedoms",
    "phases": "closures that act for a while",
    "beam_at_rest": "beam at rest under gravity",
    "beam_moving": "beam that moves in a plane",
    "beam_in_space": "beam that moves in space",
    "damped_beam": "beam with damping",
}
# Of the limit of a rung: the widest error bars, of both engines together, that may explain a difference there.  A program that is
# ten times as coarse as what is asked for has not shown the rest.
WIDEST = 10.0
UNFINISHED = "not finished: the run was interrupted"
SAID = {"within": "holds", "explained": "holds within its error bars", "skipped": "not climbed"}
COLUMNS = (
    ("rung", "rung", ""),
    ("what", "what it asks for", ""),
    ("engine", "engine", ""),
    ("difference", "largest difference over the range", "-"),
    ("time", "its own time", "s"),
    ("message", "result", ""),
)


class RungNumbers(TypedDict, total=False):
    """Difference over the range [-] and time [s] of a rung, where there are any."""

    difference: float
    time: float


class RungRow(TypedDict):
    """A line of the table of rungs: difference over the range [-], time [s], where there are any."""

    rung: str
    what: str
    engine: str
    message: str
    difference: NotRequired[float]
    time: NotRequired[float]
    verdict: Verdict


@dataclass(frozen=True)
class Rung:
    """One rung of one engine: verdict, message, largest difference [-] and wall time [s], None where there is none."""

    name: str
    engine: str
    verdict: Verdict
    message: str
    difference: float | None = None
    time: float | None = None

    @property
    def holds(self) -> bool:
        """Return True if the engine agrees with the reference, perhaps within the error bars."""
        return self.verdict in ("within", "explained")


def list_rungs(results: Results, engine: str) -> Iterator[Rung]:
    """Yield the rungs of an engine, and the certificate over all of them."""
    for name in RUNGS:
        yield _judge_rung(results, name, engine)
    lines = [line for line in results.certificates if line.engine == engine and line.limit is not None]
    wrong = [
        f"{line.mechanism}: {line.what}" for line in results.certificates if line.engine == engine and is_failing(line)
    ]
    if wrong:
        yield Rung(CERTIFICATE, engine, "deviation", f"its own model differs in {', '.join(wrong)}")
    elif lines:
        yield Rung(
            CERTIFICATE,
            engine,
            "within",
            f"holds: {len(lines)} lines, on {len({x.mechanism for x in lines})} mechanisms",
        )
    else:
        yield Rung(CERTIFICATE, engine, "skipped", "not climbed: it says nothing of its own model")


def _judge_rung(results: Results, name: str, engine: str) -> Rung:
    runs = [run for run in results.runs if (run.mechanism, run.engine) == (name, engine)]
    rows = [row for row in results.comparisons if (row.mechanism, row.engine) == (name, engine)]
    if (unclimbed := _find_unclimbed_rung(results, name, engine, runs, rows)) is not None:
        return unclimbed
    rows = [_judge_within_bars(row) for row in rows]
    verdict = find_worst_verdict(row.verdict for row in rows)
    causes = [one.words for one in results.diagnoses if (one.mechanism, one.engine) == (name, engine)]
    said = _describe_climb(rows, verdict, causes)
    shares = [row.fraction for row in rows if row.fraction is not None]
    return Rung(name, engine, verdict, said, max(shares, default=None), sum(run.wall_time for run in runs))


def _find_unclimbed_rung(
    results: Results, name: str, engine: str, runs: Sequence[RunRow], rows: Sequence[Comparison]
) -> Rung | None:
    """Return a rung on which nothing can be judged, with the reason; None where there is something to judge."""
    if all(case.mechanism != name for case in results.cases):
        return Rung(name, engine, "skipped", "not asked for")
    if results.message and _is_interrupted(results, name, {engine, *(row.reference for row in rows)}):
        return Rung(name, engine, "error", UNFINISHED)
    if not runs or any(run.verdict == "error" for run in runs):
        said = _join_words(run.message for run in runs) or "it did not run"
        return Rung(name, engine, "error", said)
    return None


def _describe_climb(rows: Sequence[Comparison], verdict: Verdict, causes: Iterable[str]) -> str:
    """Return the outcome of a rung in words: messages of the worst comparisons, causes, the widest error bars."""
    message = _join_words(dict.fromkeys(row.message for row in rows if row.verdict == verdict))
    more = _join_words([message, *causes, _describe_widest_bars(rows)])
    words = SAID.get(verdict, "does not hold")
    return f"{words}: {more}" if more else words


def _join_words(words: Iterable[str]) -> str:
    """Join what is said; "" says nothing."""
    return "; ".join(filter(None, words))


def _judge_within_bars(row: Comparison) -> Comparison:
    """Return a comparison, one that wider error bars explain than a rung admits as a deviation."""
    bar = row.error_bar
    limit = row.limit
    if (
        row.verdict != "explained"
        or bar is None
        or limit is None
        or compute_fraction(bar, row.scale or 0.0) <= WIDEST * limit
    ):
        return row
    words = f"wider than the {format_short(WIDEST * limit)} that this rung admits: refine"
    return replace(row, verdict="deviation", message=f"{row.message.removeprefix(BY_DISCRETISATION)}, {words}")


def _describe_widest_bars(rows: Sequence[Comparison]) -> str:
    """Return the widest error bars of a rung over the range, in words; "" where nothing was compared."""
    found = [row for row in rows if row.maximum is not None]
    if not found:
        return ""
    parts = [
        f"{name} {_describe_bars([(row.engine_bar if ours else row.reference_bar, row.scale) for row in found])}"
        for name, ours in ((found[0].engine, True), (found[0].reference, False))
    ]
    stated = [(row.stated_bar, row.scale) for row in found if row.stated_bar is not None]
    told = f" (states {_describe_bars(stated)} by itself, unchecked)" if stated else ""
    return f"error bars: {parts[0]}{told}, {parts[1]} of the range"


def _describe_bars(bars: Sequence[tuple[float | None, float | None]]) -> str:
    shares = [compute_fraction(bar, scale or 0.0) for bar, scale in bars if bar is not None]
    return format_short(max(shares)) if shares else "none"


def _is_interrupted(results: Results, name: str, engines: set[str]) -> bool:
    """Return True if an interrupted run left the engine or what it is compared with without an answer, and neither failed."""
    runs = [run for run in results.runs if run.mechanism == name and run.engine in engines]
    said = [run.message.startswith(INTERRUPTED) for run in runs if run.verdict == "error"]
    return all(said) and (bool(said) or not runs)


def find_exit_code(climbed: Sequence[Rung]) -> int:
    """Return the exit code: 0 all that was climbed holds, and something was; 1 a rung does not hold; 2 the engine failed."""
    failed = [2 if rung.verdict == "error" else 1 for rung in climbed if not rung.holds and rung.verdict != "skipped"]
    return max(failed, default=0 if any(rung.holds for rung in climbed) else 1)


def make_ladder_table(results: Results, engines: tuple[str, ...], text: str) -> StudyRow:
    """Return the table of the ladder for a report; differences over the range [-]."""
    rows = [_make_row(rung) for engine in engines for rung in list_rungs(results, engine)]
    return StudyRow("conform", f"The ladder ({VERSION})", text=text, columns=COLUMNS, rows=tuple(rows))


def _make_row(rung: Rung) -> RungRow:
    numbers: RungNumbers = {}
    if rung.difference is not None:
        numbers["difference"] = rung.difference
    if rung.time is not None:
        numbers["time"] = rung.time
    return {
        "rung": rung.name.replace("_", " "),
        "what": RUNGS.get(rung.name, "what its own model says of itself, everywhere"),
        "engine": rung.engine,
        "message": rung.message,
        **numbers,
        "verdict": rung.verdict,
    }


def describe_engine(results: Results, engine: str, blind: str) -> str:
    """Return one line about an engine that may be quoted; blind : how it was asked, in words."""
    climbed = list(list_rungs(results, engine))
    held = [rung for rung in climbed if rung.holds]
    open_ = [rung for rung in climbed if rung.message == UNFINISHED]
    wrong = [rung for rung in climbed if rung not in open_ and not rung.holds and rung.verdict != "skipped"]
    versions = {run.version for run in results.runs if run.engine == engine and run.version}
    name = " ".join([engine, *sorted(versions)])
    size = max((rung.difference for rung in held if rung.difference is not None), default=None)
    apart = (
        "" if size is None else f", at most {format_short(size)} of the range apart from {_describe_reference(results)}"
    )
    rungs = _format_names(held) or "none"
    line = f"{name} holds {len(held)} of {len(climbed)} rungs of {VERSION}{blind}: {rungs}{apart}"
    more = [f"{what}: {_format_names(some)}" for what, some in (("not", wrong), ("not finished", open_)) if some]
    return "; ".join([line, *more])


def _format_names(rungs: Iterable[Rung]) -> str:
    return ", ".join(rung.name.replace("_", " ") for rung in rungs)


def _describe_reference(results: Results) -> str:
    return f"flexinv {results.versions.get('flexinv', '')}".strip()
