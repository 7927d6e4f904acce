"""``crosscheck bisect``: the release of a package from which on a script, or a case of ours, gives something else."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import click
from rich.markup import escape
from rich.table import Table

from crosscheck import output_folder as owned
from crosscheck.bisect.answer import MOST_SHOWN, Answer
from crosscheck.bisect.bisection import REPEATS, Plan
from crosscheck.bisect.cases import (
    BESIDE,
    find_package,
    make_case_criterion,
    make_case_reading,
    resolve_engine,
    write_case_script,
)
from crosscheck.bisect.criteria import TOLERANCE, Criterion
from crosscheck.bisect.environments import GIGABYTE, find_store_folder
from crosscheck.bisect.installers import Index, choose_installer
from crosscheck.bisect.observations import Reading
from crosscheck.bisect.releases import ReleaseQuery
from crosscheck.bisect.reproduction import describe_others
from crosscheck.bisect.run_bisection import BisectionFiles, BisectionResult, Wish, run_bisection
from crosscheck.bisect.script import Script, check_script
from crosscheck.commands.shared.terminal import FOLDER, Console, Failure, Seconds, convert_sigterm, plan_of
from crosscheck.engines import ENGINES, describe_missing_package
from crosscheck.run.isolation import open_scratch_folder
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

MODELS_FOLDER = click.option(
    "--models", type=FOLDER, default=Path("models"), show_default=True, help="Folder of mechanisms, for MECHANISM/CASE."
)


@dataclass(frozen=True)
class BisectOptions:
    """Options of the command, under the names that click gives them."""

    range_: str
    words: tuple[str, ...]
    engine: str | None
    package: str | None
    beside: tuple[str, ...]
    with_: tuple[Path, ...]
    env: tuple[str, ...]
    number: str
    csv: str
    column: tuple[str, ...]
    bounds: str
    tolerance: float
    absolute: float
    changed: bool
    verdict: bool
    errors: str
    all_: bool
    each: bool
    repeats: int
    python: tuple[str, ...]
    pre: bool
    yanked: bool
    sources: bool
    installer: str
    index_url: str
    extra_index_url: tuple[str, ...]
    find_links: tuple[str, ...]
    no_index: bool
    environments: Path | None
    disk: float
    fresh: bool
    timeout: float
    models: Path
    out: Path | None


def _add_options(
    *options: Callable[[click.decorators.FC], click.decorators.FC],
) -> Callable[[click.decorators.FC], click.decorators.FC]:
    """Return a decorator that gives a command several options, in their order."""

    def add_to_command(command: click.decorators.FC) -> click.decorators.FC:
        for option in reversed(options):
            command = option(command)
        return command

    return add_to_command


WHAT = _add_options(
    click.option("--engine", help="Engine of ours whose package is bisected: mujoco, pinocchio, exudyn and their variants."),
    click.option("--package", help="Any other package, by its name on the index."),
    click.option("--beside", multiple=True, metavar="REQUIREMENT", help="Installed beside it, such as 'numpy<2'. Repeatable."),
    click.option(
        "--with", "with_", multiple=True, type=click.Path(path_type=Path), metavar="FILE",
        help="File or folder that is copied beside the script. Repeatable.",
    ),
    click.option("--env", multiple=True, metavar="NAME", help="Variable of yours that the script gets. Repeatable."),
)  # fmt: skip
HOW = _add_options(
    click.option("--number", default="", metavar="WORD", help="Judge by the last number behind WORD; 'last': by the last one."),
    click.option("--csv", default="", metavar="FILE", help="Judge by the columns of numbers of a CSV that the script writes."),
    click.option("--column", multiple=True, help="With --csv: only these columns. Repeatable."),
    click.option("--bounds", default="", metavar="LOW:HIGH", help="Good is what lies within.  [default: as the older end]"),
    click.option(
        "--tolerance", type=click.FloatRange(min=0.0), default=TOLERANCE, show_default=True,
        help="What still counts as the same, as a part of the number's size or of the column's range.",
    ),
    click.option(
        "--absolute", type=click.FloatRange(min=0.0), default=0.0, show_default=True,
        help="Difference of a number, or of a column, that never counts, in its own unit.",
    ),
    click.option("--changed", is_flag=True, help="Judge by every byte that is printed or written with --csv."),
    click.option("--verdict", is_flag=True, help="With MECHANISM/CASE: good is what is within the case's limit."),
    click.option(
        "--errors", type=click.Choice(["cannot-run", "bad"]), default="cannot-run", show_default=True,
        help="What an exception of the script is that is no AssertionError.",
    ),
    click.option("--all", "all_", is_flag=True, help="Find every change between the ends, not only the first."),
    click.option("--each", is_flag=True, help="Try each release of the range."),
    click.option(
        "--repeats", type=click.IntRange(min=1), default=REPEATS, show_default=True,
        help="Runs of both ends, and of both sides of a change, to see that it is repeatable.",
    ),
    click.option("--timeout", type=Seconds(), default=600.0, show_default=True, help="Seconds that one run may take."),
)  # fmt: skip
WHERE_FROM = _add_options(
    click.option("--python", multiple=True, help="Python by version or path; repeatable.  [default: this one]"),
    click.option("--pre", is_flag=True, help="Pre-releases, too."),
    click.option("--yanked", is_flag=True, help="Releases that their authors took back, too."),
    click.option("--sources", is_flag=True, help="Build releases without a wheel: their code runs then, and it takes long."),
    click.option(
        "--installer", type=click.Choice(["auto", "uv", "pip"]), default="auto", show_default=True,
        help="What makes environments; auto: uv where it is installed.",
    ),
    click.option("--index-url", default="", help="Index instead of that which pip is configured for."),
    click.option("--extra-index-url", multiple=True, help="Index beside it. Repeatable."),
    click.option("--find-links", multiple=True, help="Folder or page with files. Repeatable."),
    click.option("--no-index", is_flag=True, help="Only what --find-links names."),
    click.option("--environments", type=FOLDER, help="Folder of the environments.  [default: the user's cache]"),
    click.option("--disk", type=click.FloatRange(min=0.1), default=10.0, show_default=True, help="Gigabytes that they may take."),
    click.option("--fresh", is_flag=True, help="Forget what an earlier run of the same question has found."),
    click.option("--out", type=FOLDER, help="Folder of the answer.  [default: bisections/PACKAGE-SCRIPT]"),
)  # fmt: skip


@click.command("bisect", short_help="Find the release of a package that changed a result.")
@click.argument("range_", metavar="OLD..NEW")
@click.argument("words", nargs=-1, type=click.UNPROCESSED, metavar="MECHANISM/CASE | -- SCRIPT [ARGS]", required=True)
@WHAT
@HOW
@WHERE_FROM
@MODELS_FOLDER
def command(**options: object) -> NoReturn:
    """Find the release of a package from which on a script, or a case of ours, gives something else.

    \b
      crosscheck bisect --package mujoco 3.3.7..4.0.0 -- fall.py            good: exit code 0
      crosscheck bisect --package mujoco .. --number height -- fall.py      the number behind "height"
      crosscheck bisect --package scipy 1.11.0.. --csv out.csv -- solve.py  a CSV that it writes
      crosscheck bisect --engine mujoco 3.3.7..4.0.0 double_pendulum/swing  a case of ours

    Both ends are tried first, three times each: a script that gives something else each time is refused. Then the middle,
    and so on: ceil(log2 N) + 2 environments for N releases. They are made from wheels, kept, and taken again.

    \b
    What a release can be:
      good, bad     exit code 0, any other; an AssertionError is bad
      the same      its number or CSV is that of the older end, within --tolerance
      cannot run    exit code 125, any other exception, a crash, a hang, no wheel: passed over, as in git bisect skip

    The folder of the answer holds answer.json and, for each change, a reproduction: pins with hashes of both environments, the
    script, one command, a text for the tracker. Nothing is sent anywhere. After Ctrl-C the same command goes on.

    Packages and scripts run with your rights: in a process group of their own and without the tokens of your environment, but
    they can read and write your files. Bisect only what you would run yourself.

    \b
    Exit codes: 0  a release was found        1  both ends are alike
                2  refused or failed: a bad range, no network, a script that is not repeatable
    """
    asked = BisectOptions(**options)  # type: ignore[arg-type]
    console = Console(stderr=True)
    try:
        with convert_sigterm(), open_scratch_folder() as place:
            wish = _make_wish(asked, place)
            files = BisectionFiles(asked.out or _choose_folder(asked), asked.environments or find_store_folder())
            owned.check(files.out)
            with owned.open_report_folder(files.out), _open_status(console) as notify:
                owned.make_listed_folder(files.out)
                result = run_bisection(wish, files, notify)
    except KeyboardInterrupt:
        raise Failure("interrupted: what was found is kept, the same command goes on") from None
    except (InputError, OSError) as error:
        raise Failure(str(error)) from error
    _write_answer(Console(), result)
    sys.exit(0 if result.answer.found else 1)


def _make_wish(asked: BisectOptions, place: Path) -> Wish:
    """Return the wish of the user.  Raises InputError."""
    if (asked.engine is None) == (asked.package is None):
        raise InputError("write one of --engine NAME and --package NAME")
    index = Index(asked.index_url, asked.extra_index_url, asked.find_links, asked.no_index)
    wish = Wish(
        package=asked.package or find_package(resolve_engine(str(asked.engine))),
        range=asked.range_,
        beside=asked.beside,
        script=_make_script(asked),
        reading=Reading(asked.number, asked.csv),
        criterion=_make_criterion(asked),
        plan=Plan(asked.all_, asked.each, asked.repeats),
        pythons=asked.python,
        query=ReleaseQuery(asked.pre, asked.yanked, asked.sources),
        installer=choose_installer(asked.installer, index, asked.sources),
        disk=asked.disk * GIGABYTE,
        fresh=asked.fresh,
    )
    if _is_case(asked):
        return _add_case(asked, wish, place)
    if asked.verdict:
        raise InputError("--verdict judges a case of ours by its limit: write --engine NAME OLD..NEW MECHANISM/CASE")
    check_script(wish.script)
    return wish


def _make_script(asked: BisectOptions) -> Script:
    return Script(asked.words, asked.with_, asked.env, asked.errors == "cannot-run", asked.timeout)


def _check_options(asked: BisectOptions) -> None:
    """Raise InputError for options of judging that contradict each other."""
    if asked.number and asked.csv:
        raise InputError("--number and --csv judge by other things: write one of them")
    if asked.changed and (asked.number or asked.bounds):
        raise InputError("--changed judges by every byte: leave --number and --bounds out")
    if asked.column and not asked.csv:
        raise InputError("--column chooses columns of a CSV: write --csv FILE, too")
    if asked.bounds and not (asked.number or asked.csv):
        raise InputError("--bounds judges a number or a CSV: write --number WORD or --csv FILE, too")


def _make_criterion(asked: BisectOptions) -> Criterion:
    """Return the criterion of a script.  Raises InputError."""
    _check_options(asked)
    if asked.changed:
        return Criterion("changed")
    if asked.bounds:
        return Criterion("bounds", bounds=_read_bounds(asked.bounds), columns=asked.column)
    if asked.number or asked.csv:
        return Criterion("same", tolerance=asked.tolerance, absolute=asked.absolute, columns=asked.column)
    return Criterion("exit")


def _read_bounds(text: str) -> tuple[float, float]:
    """Return LOW:HIGH as two numbers [any unit], one left out is infinite.  Raises InputError."""
    low, colon, high = text.partition(":")
    try:
        bounds = (float(low or "-inf"), float(high or "inf"))
    except ValueError:
        bounds = (1.0, 0.0)
    if not colon or not bounds[0] <= bounds[1]:
        raise InputError(f"--bounds {text}: expected LOW:HIGH, such as 0.1:0.3; one of them may be left out")
    return bounds


def _is_case(asked: BisectOptions) -> bool:
    """Return True for a case of ours: one word MECHANISM/CASE of the folder of models that is no file."""
    if asked.engine is None or len(asked.words) != 1 or Path(asked.words[0]).is_file():
        return False
    return not asked.words[0].endswith(".py")


def _add_case(asked: BisectOptions, wish: Wish, place: Path) -> Wish:
    """Return the wish with the script that a case is exported as, and what judges it.  Raises InputError, Failure."""
    engine = ENGINES[resolve_engine(str(asked.engine))]
    if not asked.models.is_dir():
        raise InputError(
            f"there is no folder {asked.models}: write --models FOLDER, or -- SCRIPT for a script of your own"
        )
    if asked.number or asked.csv or asked.bounds or asked.changed:
        raise InputError("a case is judged by its efforts: leave --number, --csv, --bounds and --changed out")
    task = _find_task(asked.models, asked.words[0])
    if (reason := describe_missing_package(engine)) is not None:
        raise InputError(
            f"{engine.name} writes the script of the case, with the release that is installed here: {reason}"
        )
    made = write_case_script(task, engine, place / "case", asked.timeout)
    criterion = make_case_criterion(made, task, engine.name, asked.verdict, asked.tolerance)
    script = replace(made.script, passed=asked.env)
    return replace(
        wish,
        script=script,
        beside=(*BESIDE, *asked.beside),
        reading=make_case_reading(),
        criterion=criterion,
        case=(task, engine.name),
    )


def _find_task(models: Path, name: str) -> Task:
    """Return the task of MECHANISM/CASE, or of a mechanism with one case.  Raises InputError, Failure."""
    plan = plan_of(models, (name,))
    if plan.broken:
        raise InputError(f"{plan.broken[0][0]} cannot be read: {plan.broken[0][1]}")
    if len(plan.tasks) > 1:
        cases = ", ".join(task.case.name for task in plan.tasks)
        raise InputError(f"{name} has several cases: write {name.partition('/')[0]}/CASE with one of {cases}")
    return plan.tasks[0]


def _choose_folder(asked: BisectOptions) -> Path:
    """Return the folder of an answer: package or engine, and script or case."""
    what = Path(asked.words[0]).stem if asked.words[0].endswith(".py") else asked.words[0].strip("./").replace("/", "-")
    return Path("bisections") / f"{asked.package or asked.engine}-{what}"


@contextmanager
def _open_status(console: Console) -> Iterator[Callable[[str, str], None]]:
    """Give a function that shows what is done: one line that changes on a terminal, and a line for each release that is told."""
    with console.status("asking the index") as status:

        def update_status(release: str, words: str) -> None:
            if words.startswith("="):
                console.print(f"{escape(release):>12}  {escape(words[2:])}", highlight=False, soft_wrap=True)
            else:
                status.update(escape(f"{release}: {words}"))

        yield update_status


def _write_answer(console: Console, result: BisectionResult) -> None:
    """Print the answer, what else differs, what it took, and where the folder is."""
    answer = result.answer
    for words in answer.words:
        console.print(f"[bold]{escape(words)}[/]", highlight=False, soft_wrap=True)
    for change in answer.changes:
        console.print(f"[dim]between {change.before} and {change.after} also differ:[/]", highlight=False)
        for line in describe_others(change, MOST_SHOWN):
            console.print(f"  {escape(line)}", highlight=False, soft_wrap=True)
        if change.cause:
            console.print(escape(change.cause), highlight=False, soft_wrap=True)
    for note in answer.notes:
        console.print(f"[dim]{escape(note)}[/]", highlight=False, soft_wrap=True)
    console.print(_make_table(answer))
    console.print(escape(_describe_costs(answer)), highlight=False, soft_wrap=True)
    for folder in result.reproductions:
        console.print(f"reproduction: {folder}", highlight=False, soft_wrap=True)
    console.print(f"answer: {result.file}", highlight=False, soft_wrap=True)


def _make_table(answer: Answer) -> Table:
    """Return the releases that were tried as a table."""
    table = Table("release", "", "value", "s", box=None, header_style="dim")
    for row in answer.rows:
        table.add_row(row.release, escape(row.label), escape(row.value), f"{row.seconds:.1f}")
    return table


def _describe_costs(answer: Answer) -> str:
    """Return the costs of a search in a sentence."""
    costs = answer.costs
    return (
        f"{costs.environments} environments for {costs.releases} releases (at most {costs.bound} were expected), "
        f"{costs.made} made and {costs.reused} taken; {costs.processor:.0f} s of processor time; "
        f"all environments take {costs.disk:.2f} GB"
    )
