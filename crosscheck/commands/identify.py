"""``crosscheck identify``: from logs to parameters with intervals, torques with bands, and what remains."""

from __future__ import annotations

import sys
import time as clock
from pathlib import Path
from typing import get_args

import click
import numpy as np
import pandas as pd
from rich.markup import escape
from rich.table import Table

from crosscheck import output_folder as owned
from crosscheck.commands.shared.terminal import MODELS, Console, Failure
from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.output.text import describe_repair
from crosscheck.identification.bands import ChannelJudgement
from crosscheck.identification.causes.cause import NOTHING_REMAINS
from crosscheck.identification.causes.detection_limits import describe_least_sizes
from crosscheck.identification.causes.name_causes import CauseFindings, find_remaining_causes
from crosscheck.identification.drives.report import DriveReport, find_drive_report, list_drive_words
from crosscheck.identification.estimation.combinations import count_narrowed_directions
from crosscheck.identification.estimation.days import DayRule, describe_days
from crosscheck.identification.excitation import find_exciting_motion
from crosscheck.identification.files import write_days, write_judged, write_motions, write_parameters, write_prediction
from crosscheck.identification.identified_file import write_identified
from crosscheck.identification.identify import Identification, identify, judge_blocks, read_machine, read_of
from crosscheck.identification.logs.log import read_columns, read_log
from crosscheck.identification.logs.meanings import choose_time_column
from crosscheck.identification.logs.motions import judge_motions
from crosscheck.identification.machine import Machine
from crosscheck.identification.page import write_page
from crosscheck.identification.propose import format_identify_toml
from crosscheck.identification.settings import FILE, IdentifyTable, move_efforts_behind_gears, read_settings
from crosscheck.identification.write_back.identified import check_new_file
from crosscheck.identification.write_back.mjcf import write_mjcf
from crosscheck.identification.write_back.mjcf_file import read_mjcf
from crosscheck.identification.write_back.urdf import write_urdf
from crosscheck.report.words import format_by_width, format_interval, format_short
from flexinv.errors import FlexinvError, InputError
from flexinv.files.header_words import find_time_unit
from flexinv.files.load_mechanism import load_mechanism
from flexinv.files.toml_tables import resolve_toml_file

TABLES = ("parameters.csv", "days.csv", "judged.csv", "motions.csv", "identified.toml")
FOLD = "Cut the window of the first log into so many blocks; each is judged by what the others tell."


@click.command("identify", short_help="Find the parameters of NAME in logs, with intervals.")
@click.argument("name")
@click.argument("first", nargs=-1, metavar="[LOG]...")
@MODELS
@click.option(
    "--log",
    "logs",
    multiple=True,
    help="Log that identifies, as LOG behind NAME (.csv, .csv.gz, .parquet, .mat, bag of ROS); LOG@START:END: these seconds. "
    "Repeatable.",
)
@click.option(
    "--payload",
    "loads",
    multiple=True,
    metavar="LINK=LOG",
    help="Log that identifies, too, with a payload on LINK that --log is without: it is told, with intervals. Repeatable.",
)
@click.option(
    "--days",
    "rule",
    type=click.Choice(get_args(DayRule)),
    default="files",
    show_default=True,
    help="What has friction and offsets of its own: each file, each log (parts of a file, too), or one day for all.",
)
@click.option(
    "--link-torques",
    "behind",
    is_flag=True,
    help="Efforts are those of torque sensors behind the gears: no rotor, no friction of motors.",
)
@click.option("--hold-out", multiple=True, help="Log that only judges. Repeatable.")
@click.option(
    "--predict", "wanted", multiple=True, help="Log whose efforts are predicted, its own not looked at. Repeatable."
)
@click.option("--blocks", "count", type=click.IntRange(min=2), help=FOLD)
@click.option(
    "--causes", "asked", is_flag=True, help="Name what the logs held out (else the first log) show beside the model."
)
@click.option(
    "--propose-motion",
    "seconds",
    type=click.FloatRange(min=1.0),
    metavar="SECONDS",
    help="Propose a motion that tells more.",
)
@click.option("--propose", is_flag=True, help="Write a first identify.toml from mechanism and header of the first log.")
@click.option(
    "--write-urdf",
    "urdf",
    type=click.Path(dir_okay=False, path_type=Path),
    help="New file: the mechanism's own URDF with the identified masses, damping and friction.",
)
@click.option(
    "--write-mjcf",
    "mjcf",
    nargs=2,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="OLD NEW",
    help="Your MJCF of the machine, and a new file: OLD with the identified masses, damping, friction, armature, stiffness.",
)
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), help="Folder; reports/identify/NAME by default."
)
def command(
    name: str,
    first: tuple[str, ...],
    models: Path,
    logs: tuple[str, ...],
    loads: tuple[str, ...],
    rule: DayRule,
    behind: bool,
    hold_out: tuple[str, ...],
    wanted: tuple[str, ...],
    count: int | None,
    asked: bool,
    seconds: float | None,
    propose: bool,
    urdf: Path | None,
    mjcf: tuple[Path, Path] | None,
    out: Path | None,
) -> None:
    """Identify parameters of mechanism NAME from logs, with intervals; predict other logs, with bands.

    identify.toml beside mechanism.toml says which column is what, which parameters are free, and what is known of them.

    Logs of several days share masses and all else that stays; each day has friction and offsets of its own:

        crosscheck identify my_arm --log monday.csv --log friday.csv --predict monday_next.csv

    A payload is the difference of two logs, one without and one with it: its mass, centre and inertia are told, with intervals.

        crosscheck identify my_arm --log empty.csv --payload forearm=loaded.csv
    """
    begun = clock.perf_counter()
    console = Console()
    folder = out or Path("reports") / "identify" / name
    source = models / name
    logs = _join_logs(name, *first, *logs)
    if propose:
        _write_proposed_settings(console, source, logs[0], behind)
        return
    try:
        with owned.open_report_folder(folder):
            owned.make_listed_folder(folder)  # what is written first is ours, too: the next run may write over it
            given = _resolve_log_paths(source, logs)
            held = _resolve_log_paths(source, hold_out)
            payloads = _resolve_payloads(source, loads)
            _check_robot_files(urdf, mjcf)
            settings = _read_settings(source, behind)
            identification = identify(source, given, held, settings, rule, payloads)
            _write_tables(identification, source, folder)
            _write_predictions(console, identification, _resolve_log_paths(source, wanted), folder)
            _write_parameters(console, identification)
            _write_robot_files(console, identification, folder, urdf, mjcf)
            doubtful = _list_logs_in_question(identification, given, held, asked)
            causes = _find_causes(console, identification, doubtful, asked)
            drives = find_drive_report(identification)
            _write_drives(console, drives)
            if count is not None:
                _write_blocks(console, read_machine(source, settings), given[0], count)
            if seconds is not None:
                _write_proposed_motion(console, identification, given[0], seconds, folder)
            took = clock.perf_counter() - begun
            results = write_page(identification, causes, " ".join(sys.argv[1:]), folder, took, mjcf and mjcf[0], drives)
    except (FlexinvError, OSError) as error:
        raise Failure(str(error)) from error
    console.print(f"page: {folder / 'index.html'}", highlight=False, soft_wrap=True)
    sys.exit(results.exit_code)


def _join_logs(name: str, *logs: str) -> tuple[str, ...]:
    """The logs that identify, as they stand behind the name and behind --log."""
    if not logs:
        raise Failure(f"identify: no log, expected one that identifies; write crosscheck identify {name} run.csv")
    return logs


def _write_proposed_settings(console: Console, source: Path, log: str, behind: bool) -> None:
    file = source / FILE
    try:
        if file.exists():
            raise InputError(f"{file} is there already: move it away, or mend it by hand")
        path = _resolve_log_paths(source, (log,))[0]
        time, doubt = choose_time_column(read_columns(path))
        unit, why = find_time_unit(time, read_log(path.partition("@")[0], time).spacing)
        words = "; ".join(filter(None, (doubt, why)))
        text = format_identify_toml(load_mechanism(source), read_log(path, time, unit), time, (unit, words), behind)
        file.write_text(text, encoding="utf-8")
    except (FlexinvError, OSError) as error:
        raise Failure(str(error)) from error
    console.print(f"proposed, read every line: {file}", highlight=False, soft_wrap=True)


def _read_settings(source: Path, behind: bool) -> IdentifyTable | None:
    """The settings of a machine whose efforts are measured behind its gears; None where the file says where they are."""
    return move_efforts_behind_gears(read_settings(source, load_mechanism(source))) if behind else None


def _write_drives(console: Console, drives: DriveReport) -> None:
    """Write what the logs say of friction, angles and couplings beside what is free."""
    words = list(list_drive_words(drives))
    if words:
        console.print("\n[bold]friction and gears[/bold]")
    for one in words:
        console.print(escape(one), highlight=False, soft_wrap=True)


def _write_proposed_motion(
    console: Console, identification: Identification, path: str, seconds: float, folder: Path
) -> None:
    """Write a motion that tells more than the logs so far [s], [rad], [m], bounded as that of a log."""
    log = read_of(identification.machine, path)
    proposal = find_exciting_motion(identification.machine, identification.fit, log, seconds)
    columns = {"time_s": proposal.time} | dict(zip(proposal.names, proposal.q.T, strict=True))
    pd.DataFrame(columns).to_csv(owned.add_to_folder_list(folder / "motion.csv"), index=False, float_format="%.9g")
    console.print("\n[bold]a motion that tells more[/bold]: motion.csv, angles [rad] and ways [m]")
    for words in proposal.words:
        console.print(escape(words), highlight=False, soft_wrap=True)


def _write_tables(identification: Identification, source: Path, folder: Path) -> None:
    """Write what was found and how well logs are explained [unit of each], and the mechanism with it."""
    files = {name: owned.add_to_folder_list(folder / name) for name in TABLES}
    write_parameters(identification.parameters, files["parameters.csv"])
    write_days(identification.of_days, files["days.csv"])
    write_judged(identification.seen, identification.judged, files["judged.csv"])
    runs = [*identification.shown, *identification.held]
    write_motions(judge_motions(identification.machine, runs), files["motions.csv"])
    write_identified(identification, resolve_toml_file(source, "mechanism.toml"), files["identified.toml"])


def _write_predictions(console: Console, identification: Identification, logs: list[str], folder: Path) -> None:
    """Write the prediction of each log [s, units of the channels]; of several, the files from the second on have a number."""
    for k, log in enumerate(logs, 1):
        file = folder / (f"prediction_{k}.csv" if k > 1 else "prediction.csv")
        told = identification.predict(read_of(identification.machine, log))
        write_prediction(identification.machine, told, owned.add_to_folder_list(file))
        console.print(f"prediction of {escape(Path(log).name)}: {file}", highlight=False, soft_wrap=True)


def _check_robot_files(urdf: Path | None, mjcf: tuple[Path, Path] | None) -> None:
    """Raise InputError, before anything is fitted, where a robot's file cannot be read, or one to be written is there already."""
    if urdf is not None:
        check_new_file("--write-urdf", urdf)
    if mjcf is not None:
        check_new_file("--write-mjcf", mjcf[1])
        read_mjcf(mjcf[0])


def _write_robot_files(
    console: Console, identification: Identification, folder: Path, urdf: Path | None, mjcf: tuple[Path, Path] | None
) -> None:
    """Write the user's own files with what was identified, say what they cannot, and hold them against identified.toml."""
    written = []
    if urdf is not None:
        written.append(("URDF", urdf, write_urdf(identification, urdf)))
    if mjcf is not None:
        written.append(("MJCF", mjcf[1], write_mjcf(identification, *mjcf)))
    for kind, file, left in written:
        console.print(
            f"\n[bold]{kind} with what was identified[/bold]: {escape(str(file))}", highlight=False, soft_wrap=True
        )
        for words in [*left, _describe_comparison(file, folder / "identified.toml")]:
            console.print(escape(words), highlight=False, soft_wrap=True, style="dim")


def _describe_comparison(file: Path, identified: Path) -> str:
    """Describe a written file beside identified.toml in the sentence of `crosscheck compare`."""
    try:
        found = compare(file, identified)
    except InputError as error:
        return f"it could not be compared with {identified}: {error}"
    return f"crosscheck compare {file} {identified}: {found.sentence} {describe_repair(found)}"


def _resolve_log_paths(folder: Path, logs: tuple[str, ...]) -> list[str]:
    """Return logs by their paths; one that is not there is looked for beside the mechanism."""
    return [
        str(folder / log)
        if not Path(log.partition("@")[0]).exists() and (folder / log.partition("@")[0]).exists()
        else log
        for log in logs
    ]


def _resolve_payloads(folder: Path, loads: tuple[str, ...]) -> dict[str, str]:
    """Return link -> path of the log with a payload on it.  Raises InputError: no LINK=LOG, or a link twice."""
    out: dict[str, str] = {}
    for text in loads:
        link, _, log = text.partition("=")
        if not (link and log) or link in out:
            given = "a second log of that link" if link in out else repr(text)
            raise InputError(
                f"--payload: {given}, expected LINK=LOG, once for a link; write --payload forearm=loaded.csv"
            )
        out[link] = _resolve_log_paths(folder, (log,))[0]
    return out


def _write_parameters(console: Console, identification: Identification) -> None:
    told = [row for row in identification.parameters if row.identifiable]
    console.print(
        f"{len(told)} of {len(identification.parameters)} parameters are told by the logs, which narrow "
        f"{count_narrowed_directions(identification.fit)} "
        "independent combinations of them; intervals hold 90 %",
        highlight=False,
        soft_wrap=True,
    )
    table = Table("parameter", "place", "value", "90 % interval", "before", "unit", box=None, header_style="dim")
    for row in told:
        value = format_by_width(row.value, row.high - row.low)
        interval = format_interval(row.low, row.high)
        table.add_row(row.parameter, row.place, value, interval, format_short(row.before), row.unit)
    console.print(table)
    console.print(describe_days(identification.days), highlight=False, soft_wrap=True, style="dim")
    _write_table(console, "logs that identify", identification.seen)
    if identification.judged:
        _write_table(console, "logs held out", identification.judged)
    for words in identification.words:
        console.print(escape(words), highlight=False, soft_wrap=True, style="dim")


def _list_logs_in_question(
    identification: Identification, given: list[str], held: list[str], asked: bool
) -> list[tuple[str, bool]]:
    """Return the logs whose causes are looked for, and whether each identified: the ones asked for, and those that failed."""
    logs = [(log, True) for log in given] + [(log, False) for log in held]
    chosen = [one for one in logs if not one[1]] or logs[:1]
    failed = {row.log for row in (*identification.seen, *identification.judged) if row.explained < 0.0}
    names = [run.name for run, _ in (*identification.shown[: len(given)], *identification.held)]
    worse = [one for one, name in zip(logs, names, strict=True) if name in failed]
    return list(dict.fromkeys([*(chosen if asked else ()), *worse]))


def _find_causes(
    console: Console, identification: Identification, logs: list[tuple[str, bool]], asked: bool
) -> list[tuple[str, CauseFindings]]:
    out = []
    for log, seen in logs:
        rest = find_remaining_causes(identification, read_of(identification.machine, log), seen, hidden=asked)
        console.print(f"\n[bold]what remains of {escape(Path(log).name)}[/bold]")
        for words in [one.words for one in rest.named] or [NOTHING_REMAINS]:
            console.print(escape(words), highlight=False, soft_wrap=True)
        for words in rest.untold:
            console.print(escape(words), highlight=False, soft_wrap=True, style="dim")
        if asked:
            console.print(
                "what is smaller than this would hide in that log (– : nothing that was tried would be seen):",
                style="dim",
            )
        for words in describe_least_sizes(rest.least):
            console.print(escape(words), highlight=False, soft_wrap=True, style="dim")
        out.append((Path(log).name, rest))
    return out


def _write_blocks(console: Console, machine: Machine, path: str, count: int) -> None:
    _write_table(console, f"{count} blocks in turn", judge_blocks(machine, read_of(machine, path), count))


def _write_table(console: Console, title: str, rows: list[ChannelJudgement]) -> None:
    heads = ("log", "channel", "explained", "all samples", "in 90 % band", "width / RMS", "RMS error")
    table = Table(box=None, padding=(0, 1, 0, 0))
    for head in heads:  # which log, and which joint of it, must not be cut off where the terminal is narrow
        table.add_column(head, no_wrap=head in ("channel", "explained"), overflow="fold")
    for r in rows:
        whole = f"{r.explained_all:.4f}" if np.isfinite(r.explained_all) else "–"  # of blocks only their window is told
        numbers = (
            f"{r.explained:.4f}",
            whole,
            f"{r.coverage:.1%}",
            f"{r.width:.2f}",
            f"{format_short(r.rms)} {r.unit}",
        )
        table.add_row(escape(r.log), r.channel, *numbers)
    console.print(f"\n[bold]{escape(title)}[/bold]")
    console.print(table)
