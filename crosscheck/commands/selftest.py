"""``crosscheck selftest``: plant every cause, and see that it is named."""

from __future__ import annotations

import importlib
import sys
import sysconfig
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

import click
from rich.markup import escape
from rich.table import Table

from crosscheck import output_folder as owned
from crosscheck.causes.fault_benches import BENCHES
from crosscheck.checkout import open_checkout_module
from crosscheck.commands.shared.terminal import COLOURS, JOBS, Console, Failure, Seconds, convert_sigterm, open_progress
from crosscheck.commands.shared.terminal import make_out_option as out_option
from crosscheck.measures.limits import Verdict
from crosscheck.report.words import SIGNS
from crosscheck.report.write_report import render
from crosscheck.run.run_state import RESULTS
from crosscheck.run.runner import run
from crosscheck.run.work import Event, Options, Work
from crosscheck.secrets import format_command_line
from crosscheck.studies.selftest import ALONE, build_summary, judge_targets, list_studies
from crosscheck.verdicts import results as store
from crosscheck.verdicts.plan import Plan
from crosscheck.verdicts.results import StudyRow
from flexinv.errors import InputError

INSTALLED = Path(sysconfig.get_path("data")) / "share" / "flexinv" / "models"  # see pyproject.toml


@click.command("selftest", short_help="Plant every known cause, and demand that it is named.")
@click.argument("names", nargs=-1)
@click.option(
    "--models",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder of the mechanisms of the benches.  [default: models here, else those that were installed]",
)
@out_option("reports/selftest")
@JOBS
@click.option(
    "--timeout",
    type=Seconds(),
    default=3600.0,
    show_default=True,
    help="Seconds that one bench may take: some hundred runs of an engine.",
)
@click.option(
    "--beyond", "outside", is_flag=True, help="In a checkout: plant mistakes of users that no cause was written for."
)
@click.option(
    "--campaign",
    type=click.Choice(["first", "second"]),
    default="first",
    show_default=True,
    help="With --beyond: which mechanisms and seed.",
)
@click.option("--seed", type=click.IntRange(min=0), help="With --beyond: another seed than the campaign's own.")
@click.option("--count", type=click.IntRange(min=1), help="With --beyond: another number of faults.")
@click.option("--mechanisms", default="", help="With --beyond: names, separated by commas, to be left with; '': all.")
@click.option("--only", default="", help="With --beyond: numbers of faults, separated by commas, to be left with.")
def command(
    names: tuple[str, ...], models: Path | None, out: Path, jobs: int, timeout: float, outside: bool, **asked: Any
) -> NoReturn:
    """Plant every known cause in an engine's model and demand that it is named.

    NAMES are mechanisms of the benches; without names all of them.  The unharmed mechanisms demand silence.  The
    matrix planted x named is printed and stands in the report, with a table of every fault per bench.

    With --beyond, in a checkout, mistakes that users make with real engines are planted instead, from a seed: beyond.json and
    beyond.txt in the folder of the report say what became of each.

    \b
    Exit codes: 0  95 % of the faults that matter are named, and nothing on the unharmed mechanisms; without NAMES, every
                   cause is named alone somewhere
                   with --beyond: nothing is named wrongly or accepted above the bars, half of the rest is named
                1  not so
                2  an engine, a model or the harness failed
    """
    if outside:
        _run_campaign_and_end(names, models, out, jobs, asked)
    known = [bench.mechanism for bench in BENCHES]
    if unknown := [n for n in names if n not in known]:
        raise Failure(f"no bench is called {unknown[0]!r}; known: {', '.join(dict.fromkeys(known))}")
    wanted = dict.fromkeys(name for name in known if not names or name in names)
    folder = find_model_folder(wanted, models)
    try:
        with owned.open_report_folder(out):
            with convert_sigterm(), open_progress(Console(stderr=True)) as notify:
                line = format_command_line(sys.argv[1:])
                results = run(
                    Work(Plan(()), {}, list_studies(folder, names), Options(timeout, jobs)), out, notify, line
                )
            whole = build_summary(results.studies, whole=not names)
            results = replace(results, studies=(whole, *results.studies))
            store.write(results, out / RESULTS)
            render(results, out)
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    met = judge_targets(results.studies[1:], whole=not names)
    _write_matrix(whole, met)
    Console(stderr=True).print(f"report: {out / 'index.html'}", highlight=False)
    if not results.finished:
        Console(stderr=True).print(escape(results.message), soft_wrap=True)
    failed = not results.finished or any(table.status != "ok" for table in results.studies)
    sys.exit(2 if failed else int(any(line["verdict"] != "within" for line in met)))


def find_model_folder(names: Iterable[str], path: Path | None) -> Path:
    """Return the folder that has all these mechanisms: the one that was said, else models here, else those installed.

    Raises Failure where none has.
    """
    names = list(names)
    places = [path] if path is not None else [Path("models"), INSTALLED]
    absent = [[n for n in names if not (place / n / "mechanism.toml").is_file()] for place in places]
    if [] in absent:
        return places[absent.index([])]
    lacks = "; ".join(f"{place} has no {', '.join(few)}" for place, few in zip(places, absent, strict=True))
    raise Failure(f"the benches need flexinv's own models: {lacks}; write --models with the folder of them")


def _run_campaign_and_end(
    names: tuple[str, ...], path: Path | None, out: Path, jobs: int, asked: Mapping[str, Any]
) -> NoReturn:
    """Run a campaign of faults beyond the dictionary, print its sums, and leave with its exit code."""
    try:
        beyond = open_checkout_module("campaigns.beyond.campaign", "crosscheck selftest --beyond")
    except InputError as error:
        raise Failure(str(error)) from error
    shown = importlib.import_module("campaigns.beyond.shown")
    bad = importlib.import_module("campaigns.beyond.judge").BAD
    chosen = beyond.CAMPAIGNS[asked["campaign"]]
    chosen = replace(chosen, seed=asked["seed"] if asked["seed"] is not None else chosen.seed)
    chosen = replace(chosen, count=asked["count"] or chosen.count)
    mechanisms = (*names, *_split_list(asked["mechanisms"]))
    known = dict.fromkeys(bench.mechanism for bench in chosen.benches)
    if unknown := [name for name in mechanisms if name not in known]:
        raise Failure(f"campaign {chosen.name} has no mechanism {unknown[0]!r}; it has: {', '.join(known)}")
    models = find_model_folder((bench.mechanism for bench in chosen.benches if not bench.in_package), path)
    only = _parse_numbers(asked["only"])
    console = Console(stderr=True)
    with convert_sigterm(), open_progress(console) as notify:

        def write_progress(done: int, total: int, row: Mapping[str, Any]) -> None:
            verdict: Verdict = "deviation" if row["outcome"] in bad else "within"
            notify(Event(shown.describe_fault(row), verdict, "", done, total))

        try:
            results = beyond.run(beyond.CampaignRequest(chosen, models, out, jobs, mechanisms, only), write_progress)
        except RuntimeError as error:
            raise Failure(str(error)) from error
    _write_campaign(shown, results, out)
    sys.exit(int(not results["met"]))


def _write_campaign(shown: ModuleType, results: Mapping[str, Any], out: Path) -> None:
    """Write what a campaign found into a text beside its data, and its sums onto the terminal."""
    (out / "beyond.txt").write_text("\n".join(shown.describe_campaign(results)) + "\n", encoding="utf-8")
    for key in ("by topic", "by mechanism", "by engine", "by newness"):
        Console().print(shown.make_outcome_table(results, key))
    console = Console(stderr=True)
    console.print(shown.describe_verdict(results), highlight=False)
    console.print(f"every fault: {out / 'beyond.json'}, {out / 'beyond.txt'}", highlight=False)


def _split_list(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _parse_numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(map(int, _split_list(text)))
    except ValueError:
        raise Failure(f"--only {text!r}: expected numbers of faults, such as --only 3,17") from None


def _write_matrix(whole: StudyRow, met: Sequence[Mapping[str, Any]]) -> None:
    """Print the matrix with numbered columns, where each cause is named alone, and the targets."""
    console = Console()
    benches = [key for key, _, _ in whole.columns[1:-1]]
    matrix = whole.rows[: -len(met)]
    table = Table("planted", box=None, header_style="dim", padding=(0, 1, 0, 0))
    for k in range(len(benches)):
        table.add_column(str(k + 1), no_wrap=True, min_width=2)
    where = Table("cause", "named alone on", box=None, header_style="dim")
    for row in matrix:
        table.add_row(row["cause"], *(row[b] for b in benches))
        where.add_row(row["cause"], row[ALONE])
    console.print(table)
    for k, bench in enumerate(benches):
        console.print(f"{k + 1:2d}  {bench}", highlight=False)
    console.print(where)
    for paragraph in whole.text.split("\n\n"):
        console.print(paragraph, highlight=False)
    for line in met:
        verdict = line["verdict"]
        sign = SIGNS.get(verdict, "✓")
        console.print(f"[{COLOURS[verdict]}]{sign}[/] {line['cause']}: {line[ALONE]}", highlight=False, soft_wrap=True)
