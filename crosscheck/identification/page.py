"""Page of an identification: a study of the report, with bands over time, spectra of what remains, parameters and verdicts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from crosscheck import output_folder as owned
from crosscheck.identification.bands import ChannelJudgement, Prediction
from crosscheck.identification.card import describe_gist
from crosscheck.identification.causes.cause import NOTHING_REMAINS
from crosscheck.identification.causes.name_causes import CauseFindings
from crosscheck.identification.drives.report import (
    DriveReport,
    build_drive_tables,
    find_drive_report,
    list_drive_figures,
    list_drive_words,
)
from crosscheck.identification.estimation.base_parameters import list_base_rows
from crosscheck.identification.estimation.days import describe_days
from crosscheck.identification.figures import LogFigure
from crosscheck.identification.identify import Identification
from crosscheck.identification.logs.motions import PartJudgement, judge_motions, judge_over_time
from crosscheck.identification.machine import Machine
from crosscheck.identification.maker_values import build_maker_tables
from crosscheck.identification.parameters import Key
from crosscheck.identification.readings import Run
from crosscheck.identification.settings import LimitTable, list_matching_names
from crosscheck.identification.table import MACHINE, Row
from crosscheck.report.words import format_by_width, format_interval
from crosscheck.report.write_report import render
from crosscheck.verdicts.results import (
    Results,
    StudyRow,
    describe_machine,
    format_current_time,
    list_versions,
    make_slug,
    write,
)
from crosscheck.verdicts.study_table import Line, SideTable
from flexinv.display.curve_table import render_curves
from flexinv.typing import Array

POINTS = 800  # of a curve: what a screen shows
FREQUENCIES = 400
COLUMNS = (
    ("channel", "sensor", ""),
    ("log", "log", ""),
    ("part", "log is", ""),
    ("explained", "explained", ""),
    ("spread_explained", "less a constant", ""),
    ("explained_all", "all samples", ""),
    ("coverage", "in 90 % band", ""),
    ("width", "width / RMS", ""),
    ("rms", "RMS error", "unit"),
    ("unit", "unit", ""),
    ("samples", "samples", ""),
    ("message", "limit", ""),
)
TEXT = """{count} of {all} parameters are told by the logs: their own error is at most a third of what was known before; all
others are held by the prior. Values and bands are those of the readings behind the zero-phase low-pass at {bandwidth:g} Hz. Bands
hold 90 %. They are made of the uncertainty of the parameters and of what remains, calibrated on blocks of time that were left
out, and of what friction and offsets of another day differ by. Explained is the part of the variance, of a joint while it
slides; width is that of the band, and RMS the error's. {scatter}"""
SCATTER = (
    "From block to block the estimates scatter {:.2g} times what the formula says, in variance; intervals are widened."
)
STEADY = "From block to block the estimates scatter no more than the formula says."
WORST_SEEN = "Motion by motion: where the first log, which identified, is told worst"
MOSTLY = 0.7  # of the parts of a log in which a sensor counts: others have no curve over time
WIDER = 1.05  # times in variance: less is rounded away
UNJUDGED = "\n\nNo limit is stated, so that nothing is judged: write [[limits]] into identify.toml"
UNHELD = ", and give a log that is held out"


def write_page(
    identification: Identification,
    causes: Sequence[tuple[str, CauseFindings]],
    command: str,
    out: Path,
    elapsed: float,
    mjcf: Path | None = None,
    drives: DriveReport | None = None,
) -> Results:
    """Write index.html, the page of the study, results.json, junit.xml and summary.md into a folder; return the results [-].

    causes : name of a log and what it shows beside the model; elapsed : time that all of it took [s]
    mjcf : a file of the machine whose values stand beside those found; a URDF's do where the mechanism comes from one
    drives : what the logs say of friction and gears; it is asked where it is absent
    Raises InputError where such a file cannot be read.
    """
    drives = find_drive_report(identification) if drives is None else drives
    figures = _list_figures(identification, drives)
    study = build_study_row(identification, causes, build_maker_tables(identification, mjcf), drives, figures)
    results = Results(
        format_current_time(),
        command,
        finished=True,
        machine=describe_machine(),
        versions=list_versions(),
        studies=(study,),
        elapsed=elapsed,
    )
    write(results, out / "results.json")
    _write_figure_tables(figures, out / "data" / make_slug(study.name))
    render(results, out)
    return results


def build_study_row(
    identification: Identification,
    causes: Sequence[tuple[str, CauseFindings]],
    makers: Sequence[SideTable],
    drives: DriveReport,
    figures: Sequence[LogFigure],
) -> StudyRow:
    """Return all that the page shows [unit of each]; makers : tables of values that robot files say; figures : in their order."""
    name = identification.machine.mechanism.name
    told = sum(row.identifiable for row in identification.parameters)
    scatter = SCATTER.format(identification.fit.kappa) if identification.fit.kappa > WIDER else STEADY
    bandwidth = identification.machine.settings.bandwidth_Hz
    text = TEXT.format(count=told, all=len(identification.parameters), bandwidth=bandwidth, scatter=scatter)
    assumed = describe_days(identification.days)
    text = text.replace("\n", " ") + f"\n\n{assumed}" + _describe_missing_judges(identification)
    tables = [
        _build_told_table(identification.parameters),
        *makers,
        _build_base_table(identification),
        _build_motion_table(identification),
        _build_day_table(identification),
        _build_cause_table(causes),
        *build_drive_tables(drives),
        _build_doubt_table([*identification.words, *list_drive_words(drives), *_list_untold_words(causes)]),
        _build_untold_table(identification.parameters),
        _build_least_table(causes),
        _build_scatter_table(identification),
    ]
    return StudyRow(
        f"identify {name}",
        f"{name}, identified",
        text,
        COLUMNS,
        tuple(_list_channel_rows(identification)),
        figures=tuple(figure.build_drawing(k) for k, figure in enumerate(figures, 1)),
        tables=tuple(tables),
        heading="How well the logs are explained",
        gist=describe_gist(identification),
        assumed=assumed,
    )


def _describe_missing_judges(identification: Identification) -> str:
    """The words that say which judges are missing, "" where limits judge."""
    if identification.machine.settings.limits:
        return ""
    return f"{UNJUDGED}{'' if identification.held else UNHELD}."


def judge_channel(limits: Sequence[LimitTable], row: ChannelJudgement) -> tuple[str, str]:
    """Return verdict and message of a judged channel by the limits that are stated for it [-]."""
    matching = [limit for limit in limits if list_matching_names(limit.channel, [row.channel])]
    if not matching:
        return "skipped", "no limit is stated"
    broken = []
    for limit in matching:
        if limit.explained is not None and not row.explained >= limit.explained:
            broken.append(f"explains {row.explained:.4f}, expected {limit.explained:g} or more")
        if limit.coverage is not None and not limit.coverage[0] <= row.coverage <= limit.coverage[1]:
            broken.append(
                f"{row.coverage:.1%} inside the band, expected {limit.coverage[0]:g} to {limit.coverage[1]:g}"
            )
        if limit.width is not None and not row.width <= limit.width:
            broken.append(f"a band of {row.width:.3g} RMS errors, expected {limit.width:g} or less")
    return ("deviation", "; ".join(broken)) if broken else ("within", "")


def _list_channel_rows(identification: Identification) -> Iterator[Line]:
    limits = identification.machine.settings.limits
    for part, some in (("held out", identification.judged), ("identified from", identification.seen)):
        judges = part == "held out" or not identification.judged
        for row in some:
            word, message = judge_channel(limits, row) if judges else ("skipped", "other logs judge")
            yield vars(row) | {"part": part, "verdict": word, "message": message}


# ------------------------------------------------------------------------------------------------------------ figures


def _write_figure_tables(figures: Sequence[LogFigure], folder: Path) -> None:
    """Write the numbers of every figure as CSV, with all samples and all digits [unit in each header]."""
    for k, figure in enumerate(figures, 1):
        folder.mkdir(parents=True, exist_ok=True)
        owned.write(folder / f"{figure.build_table_name(k)}.csv", render_curves(figure.list_columns()))


def _list_figures(identification: Identification, drives: DriveReport) -> list[LogFigure]:
    """Figures of the logs held out, or of the first one: sensors and errors over time, friction, angles, spectra of the rest."""
    logs = identification.held or identification.shown[:1]
    bands = [figure for run, told in logs for figure in _list_band_figures(identification, run, told)]
    spectra = [
        _build_spectrum_figure(identification, run, told, run.measured)
        for run, told in logs
        if run.measured is not None
    ]
    times = [_build_time_figure(identification, run, told) for run, told in logs if run.measured is not None]
    return [*bands, *times, *list_drive_figures(identification, drives), *spectra]


def _list_band_figures(identification: Identification, run: Run, told: Prediction) -> Iterator[LogFigure]:
    held = "held out" if identification.held else "which identified"
    for c, channel in enumerate(identification.machine.channels):
        curves = {} if run.measured is None else {"measured": run.measured[:, c]}
        curves |= {"predicted": told.value[:, c], "low": told.low[:, c], "high": told.high[:, c]}
        title = f"{channel.name}: {run.name}, {held}"
        y = f"{channel.name} [{channel.unit}]"
        yield LogFigure(run.name, channel.name, title, "time [s]", y, run.time, curves, POINTS)


def _build_time_figure(identification: Identification, run: Run, told: Prediction) -> LogFigure:
    """RMS errors over time, each over the spread of what was measured."""
    rows = judge_over_time(identification.machine, [(run, told)])
    by_channel: dict[str, dict[float, float]] = {}
    for row in rows:
        by_channel.setdefault(row.channel, {})[0.5 * (row.start + row.end)] = row.left
    most = max((len(by_place) for by_place in by_channel.values()), default=0)
    shown = {name: by_place for name, by_place in by_channel.items() if len(by_place) > MOSTLY * most}
    places = sorted(set.intersection(*(set(by_place) for by_place in shown.values()))) if shown else []
    curves = {name: np.array([by_place[place] for place in places]) for name, by_place in shown.items()}
    title = f"How well each part of {run.name} is told"
    y = "RMS error over spread of the reading [-]"
    return LogFigure(run.name, "errors over time", title, "time [s]", y, np.array(places), curves, POINTS)


def _build_spectrum_figure(identification: Identification, run: Run, told: Prediction, measured: Array) -> LogFigure:
    """Amplitude spectra of what remains of a log, each over the RMS of what was measured."""
    spacing = float(run.time[1] - run.time[0])
    frequency = np.asarray(np.fft.rfftfreq(len(run.time), spacing), dtype=np.float64)
    kept = frequency <= 1.5 * identification.machine.settings.bandwidth_Hz
    curves = {}
    for c, channel in enumerate(identification.machine.channels):
        rest = np.where(run.counted[:, c], measured[:, c] - told.value[:, c], 0.0)
        whole = np.where(run.counted[:, c], measured[:, c], 0.0)
        amplitude = 2.0 * np.abs(np.fft.rfft(rest * np.hanning(len(rest)))) / max(1.0, 0.5 * run.counted[:, c].sum())
        curves[channel.name] = amplitude[kept] / (np.std(whole[run.counted[:, c]]) + 1e-300)
    title = f"What remains, by frequency: {run.name}"
    y = "amplitude over spread of the reading [-]"
    return LogFigure(run.name, "what remains", title, "frequency [Hz]", y, frequency[kept], curves, FREQUENCIES)


# ------------------------------------------------------------------------------------------------------------- tables


def _build_cause_table(causes: Sequence[tuple[str, CauseFindings]]) -> SideTable:
    rows: list[Line] = []
    for log, rest in causes:
        rows += [
            {"log": log, "name": one.name, "place": one.place, "size": one.size, "error": one.error or None,
             "unit": one.unit, "evidence": one.evidence}
            for one in rest.named
        ] or [{"log": log, "name": "none", "place": "", "size": None, "error": None, "unit": "",
               "evidence": NOTHING_REMAINS}]  # fmt: skip
    columns = [
        ("log", "log", ""), ("name", "cause", ""), ("place", "place", ""), ("size", "size", "unit"),
        ("error", "standard error", "unit"), ("unit", "unit", ""), ("evidence", "evidence", ""),
    ]  # fmt: skip
    return {"title": "Causes of what remains", "columns": columns, "rows": rows}


def _list_untold_words(causes: Sequence[tuple[str, CauseFindings]]) -> list[str]:
    """Return the stiffnesses that the encoders of logs do not tell, with the log's name."""
    return [f"{log}: {words}" for log, rest in causes for words in rest.untold]


def _build_least_table(causes: Sequence[tuple[str, CauseFindings]]) -> SideTable:
    rows = [
        {"log": log, "name": one.name, "place": one.place, "size": one.size if np.isfinite(one.size) else None, "unit": one.unit}
        for log, rest in causes
        for one in rest.least
    ]  # fmt: skip
    columns = [
        ("log", "log", ""), ("name", "cause", ""), ("place", "where", ""),
        ("size", "least size that would be seen", "unit"), ("unit", "unit", ""),
    ]  # fmt: skip
    return {
        "title": "What would hide: the least size of each cause that the log would show",
        "columns": columns,
        "rows": rows,
    }


def _build_told_table(table: Sequence[Row]) -> SideTable:
    """Return the parameters that the logs tell, with which the page opens: they are what was asked for."""
    told = [row for row in table if row.identifiable]
    return {**_build_parameter_table("Parameters before and after", told), "leads": True}


def _build_base_table(identification: Identification) -> SideTable:
    """Return the combinations of masses and rotors that torques can tell, with intervals: what the logs know of the links."""
    rows = [
        {
            "words": row.words,
            "value": format_by_width(row.value, row.high - row.low),
            "interval": format_interval(row.low, row.high),
            "before": row.before,
            "unit": row.unit,
            "told": "yes" if row.identifiable else "no",
        }
        for row in list_base_rows(identification.machine, identification.fit)
    ]
    columns = [
        ("words", "combination", ""), ("value", "value", "unit"), ("interval", "90 % interval", ""), ("before", "before", "unit"),
        ("unit", "unit", ""), ("told", "told by the logs", ""),
    ]  # fmt: skip
    return {"title": "Base parameters: what torques can tell of masses and rotors", "columns": columns, "rows": rows}


def _build_motion_table(identification: Identification) -> SideTable:
    """Return the motions of the logs that judge, or of the first log, each by the channel that it is told worst in."""
    some = identification.held or identification.shown[:1]
    worst: dict[tuple[str, int], PartJudgement] = {}
    for row in judge_motions(identification.machine, some):
        at = row.log, row.part
        if at not in worst or row.left > worst[at].left:
            worst[at] = row
    rows = [
        {"log": r.log, "part": r.part, "start": r.start, "end": r.end, "channel": r.channel, "left": r.left, "rms": r.rms,
         "unit": r.unit, "inside": r.inside}
        for r in worst.values()
    ]  # fmt: skip
    columns = [
        ("log", "log", ""), ("part", "motion", ""), ("start", "from", "s"), ("end", "to", "s"), ("channel", "worst sensor", ""),
        ("left", "RMS error over spread", ""), ("rms", "RMS error", "unit"), ("unit", "unit", ""),
        ("inside", "in 90 % band", ""),
    ]  # fmt: skip
    title = "Motion by motion: where the logs held out are told worst" if identification.held else WORST_SEEN
    return {"title": title, "columns": columns, "rows": rows if len(rows) > 1 else [], "summarised": True}


def _build_day_table(identification: Identification) -> SideTable:
    """Return the parameters that differ from day to day, with an interval for each day that identified and the machine's."""
    names = [*identification.days.logs, ""]
    rows: dict[Key, dict[str, str]] = {}
    for one in identification.of_days:
        row = rows.setdefault(
            (one.parameter, one.place), {"parameter": one.parameter, "place": one.place, "unit": one.unit}
        )
        value = format_by_width(one.value, one.high - one.low)
        row[f"day {names.index(one.day)}"] = f"{value} ({format_interval(one.low, one.high)})"
    days = [(f"day {k}", name or f"the machine: {MACHINE}", "") for k, name in enumerate(names)]
    columns = [("parameter", "parameter", ""), ("place", "place", ""), *days, ("unit", "unit", "")]
    return {"title": "From day to day: values and 90 % intervals", "columns": columns, "rows": list(rows.values())}


def _build_untold_table(table: Sequence[Row]) -> SideTable:
    """Return the parameters of which the logs say no more than was known before."""
    return _build_parameter_table(
        "Parameters that the logs do not tell", [row for row in table if not row.identifiable]
    )


def _build_parameter_table(title: str, table: Sequence[Row]) -> SideTable:
    columns = [
        ("parameter", "parameter", ""), ("place", "place", ""), ("value", "value", "unit"), ("unit", "unit", ""),
        ("interval", "90 % interval", ""), ("before", "before", "unit"), ("known", "90 % interval before", ""),
        ("ratio", "width over width before", "-"),
    ]  # fmt: skip
    rows = [
        {
            "parameter": row.parameter,
            "place": row.place,
            "value": format_by_width(row.value, row.high - row.low),
            "interval": format_interval(row.low, row.high),
            "before": row.before,
            "known": format_interval(row.before_low, row.before_high),
            "ratio": _compute_width_ratio(row),
            "unit": row.unit,
        }
        for row in table
    ]
    return {"title": title, "columns": columns, "rows": rows}


def _build_doubt_table(words: Sequence[str]) -> SideTable:
    return {
        "title": "What cannot be told, and what is doubtful",
        "columns": [("words", "in words", "")],
        "rows": [{"words": text} for text in words],
    }


def _build_scatter_table(identification: Identification) -> SideTable:
    """Mean and RMS error of every sensor in every log: how much runs differ beside what scatters inside of one."""
    rows: list[Line] = []
    for part, some in (("identified from", identification.shown), ("held out", identification.held)):
        for run, told in some:
            rows += list(_list_sensor_errors(identification.machine, part, run, told))
    columns = [
        ("log", "log", ""), ("part", "log is", ""), ("channel", "sensor", ""), ("mean", "mean error", "unit"),
        ("rms", "RMS error", "unit"), ("unit", "unit", ""),
    ]  # fmt: skip
    return {"title": "From run to run", "columns": columns, "rows": rows}


def _list_sensor_errors(machine: Machine, part: str, run: Run, prediction: Prediction) -> Iterator[Line]:
    if run.measured is None:
        return
    for c, channel in enumerate(machine.channels):
        error = (run.measured - prediction.value)[run.counted[:, c], c]
        if len(error):
            sizes = {"mean": float(error.mean()), "rms": float(np.sqrt(np.mean(error**2))), "unit": channel.unit}
            yield {"log": run.name, "part": part, "channel": channel.name} | sizes


def _compute_width_ratio(row: Row) -> float:
    """Width of the interval over that before the logs [-], of the logarithm where all ends are positive."""
    ends = np.array([row.low, row.high, row.before_low, row.before_high])
    low, high, before_low, before_high = np.log(ends) if (ends > 0.0).all() else ends
    return float((high - low) / max(before_high - before_low, 1e-300))
