"""Interrupts at random moments in run, nightly, identify, bless and selftest: nothing is lost, and the next run starts at once.

    python campaigns/interrupts.py [--count 40] [--seed 20261127] [--only COMMAND,COMMAND]

SIGINT or SIGTERM goes to the process group of the command, as a terminal sends it, at a moment that is drawn between its first
line of Python and the end that it needs undisturbed.  The seed draws signals and moments; the machine's load moves what they hit.
Afterwards: the command ends within PATIENCE, without a traceback and with nothing left running; a report that was begun is whole
and says that it was interrupted; the blessed night is the old one or the new one, whole; the same command then runs to its end.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time as clock
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click
from hostile import ARM, HERE, MARK, TRACEBACK, logged_arm, wait_for_none

from crosscheck.verdicts import baseline
from crosscheck.verdicts.results import read as read_results

SEED = 20261127
COUNT = 40
PATIENCE = 30.0  # [s] that a command may take to end, on a machine that has other work
LONGEST = 25.0  # [s]: interrupts of commands that take longer are drawn from their first part
LONG = ("selftest",)  # minutes: the next interrupted one shows that it starts at once
BEGUN = "begun\n"
PROGRAM = f"import sys; from crosscheck.start import main; sys.stderr.write({BEGUN!r}); sys.stderr.flush(); main()"
TWO = ["--engines", "flexinv,pinocchio", "--studies", "", "--jobs", "1"]
COMMANDS = {
    "run": ["run", *TWO, "--out", "reports/run"],
    "nightly": ["nightly", *TWO],
    "identify": [
        "identify",
        "logged",
        "--log",
        "log.csv",
        "--hold-out",
        "other.csv",
        "--causes",
        "--out",
        "reports/identify",
    ],
    "bless": ["bless", "--reason", "REASON", "--from", "reports/blessed", "--baseline", "reports/baseline"],
    "selftest": ["selftest", "rigid_3r", "--jobs", "1", "--out", "reports/selftest"],
}


@dataclass(frozen=True)
class CommandEnd:
    """How a command ended: its exit code (None: it did not), what it printed, what it left, and seconds after the signal."""

    code: int | None
    printed: str
    leftover_files: tuple[str, ...]
    seconds: float


def make_project(folder: Path) -> None:
    """Write models, logs, and a run whose values may be blessed."""
    shutil.copytree(ARM, folder / "models" / "arm")
    shutil.copytree(HERE.parent / "models" / "rigid_3r", folder / "models" / "rigid_3r")
    logged_arm.write_arm(folder / "logged" / "logged")
    for seed, name in enumerate(("log.csv", "other.csv")):
        logged_arm.frame(folder / "logged", seed).to_csv(folder / name, index=False)
    ended = call([*COMMANDS["run"][:-1], "reports/blessed"], folder)
    assert ended.code in (0, 1), ended.printed


def call(words: list[str], folder: Path, after: float | None = None, number: int = 0) -> CommandEnd:
    """Run a command; ``after`` so many seconds from its first line send a signal to its group."""
    mark = uuid.uuid4().hex
    if words[0] == "identify":
        words = [*words, "--models", "logged"]
    surroundings = os.environ | {MARK: mark, "OMP_NUM_THREADS": "1", "CROSSCHECK_KEPT": "", "NO_COLOR": "1"}
    surroundings["PYTHONPATH"] = str(HERE.parent)
    log = folder / "printed.txt"
    with log.open("wb") as stream:
        child = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *words], cwd=folder, env=surroundings, stdin=subprocess.DEVNULL,
            stdout=stream, stderr=stream, start_new_session=True,
        )  # fmt: skip
        while child.poll() is None and BEGUN not in log.read_text(encoding="utf-8", errors="replace"):
            clock.sleep(0.01)
        begun = clock.monotonic()
        if after is not None:
            try:
                child.wait(after)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, number)
                begun = clock.monotonic()
        try:
            code: int | None = child.wait(PATIENCE if after is not None else 900.0)
        except subprocess.TimeoutExpired:
            code = None
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    seconds = clock.monotonic() - begun
    left = tuple(words for _, words in wait_for_none(mark))
    return CommandEnd(code, log.read_text(encoding="utf-8", errors="replace"), left, seconds)


def judge(ended: CommandEnd) -> str:
    """Return what is wrong with an end, "" where nothing is: of every command."""
    if ended.code is None:
        return f"it did not end within {PATIENCE:g} s"
    if TRACEBACK in ended.printed:
        return "a traceback: " + ended.printed.strip().splitlines()[-1][:200]
    if ended.leftover_files:
        return f"it left {ended.leftover_files[0]}"
    if ended.code not in (0, 1, 2):
        return f"exit code {ended.code}"
    if ended.code == 2 and "interrupted" not in ended.printed:
        return f"exit code 2, and it does not say why: {ended.printed[-200:]!r}"
    return ""


def judge_report(folder: Path) -> str:
    """Return what is wrong with a report: one that was begun can be read, and says what has been finished."""
    file = folder / "results.json"
    if not file.exists():
        return ""
    try:
        results = read_results(file)
    except (OSError, ValueError) as error:
        return f"{file.name} cannot be read: {error}"
    if not results.finished and "interrupted" not in results.message:
        return f"the report does not say that it was interrupted: {results.message!r}"
    return "" if (folder / "index.html").exists() else "a report without its page"


def judge_run(folder: Path) -> str:
    """Judge the report of a run."""
    return judge_report(folder / "reports" / "run")


def judge_night(folder: Path) -> str:
    """Judge the reports of all nights."""
    reports = [file.parent for file in sorted((folder / "reports").glob("20*/results.json"))]
    return next(filter(None, map(judge_report, reports)), "")


def judge_selftest(folder: Path) -> str:
    """Judge the report of a self-test."""
    return judge_report(folder / "reports" / "selftest")


def judge_identified(folder: Path) -> str:
    """Judge the tables of an identification: each is whole."""
    for file in (folder / "reports" / "identify").glob("*.csv"):
        with file.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.reader(stream))
        if len(rows) < 2 or len({len(row) for row in rows}) != 1:
            return f"{file.name} is torn"
    return ""


def judge_blessed(folder: Path) -> str:
    """Judge the blessed night: all of its files are of one blessing."""
    place = folder / "reports" / "baseline"
    if not place.exists():
        return ""
    try:
        baseline.read(place)
    except ValueError as error:
        return f"the baseline cannot be read: {error}"
    known = json.loads((folder / "known.json").read_text(encoding="utf-8"))
    return "" if digest(place) in known else "the baseline is neither the old one nor the new one"


def digest(place: Path) -> str:
    """Return the digest of all files of a folder, apart from the reason of a blessing."""
    total = hashlib.sha256()
    for file in sorted(place.iterdir()):
        text = file.read_bytes()
        if file.name == baseline.BLESSED:
            text = json.dumps(json.loads(text) | {"reason": ""}).encode()
        total.update(file.name.encode() + text)
    return total.hexdigest()


JUDGES: dict[str, Callable[[Path], str]] = {
    "run": judge_run, "nightly": judge_night, "identify": judge_identified, "bless": judge_blessed, "selftest": judge_selftest,
}  # fmt: skip


def prepare_blessings(folder: Path) -> None:
    """Make two runs that are blessed in turn, and note what each blessing gives."""
    results = folder / "reports" / "blessed"
    shutil.copytree(results, folder / "reports" / "blessed-other")
    (folder / "models" / "arm" / "mechanism.toml").write_text(heavier(folder), encoding="utf-8")
    call([*COMMANDS["run"][:-1], "reports/blessed-other"], folder)
    known = []
    for source in ("blessed", "blessed-other"):
        shutil.rmtree(folder / "reports" / "baseline", ignore_errors=True)
        call(blessing(source), folder)
        known.append(digest(folder / "reports" / "baseline"))
    (folder / "known.json").write_text(json.dumps(known), encoding="utf-8")
    assert len(set(known)) == 2


def heavier(folder: Path) -> str:
    """Return the arm with another mass."""
    text = (folder / "models" / "arm" / "mechanism.toml").read_text(encoding="utf-8")
    before = next(line for line in text.splitlines() if line.startswith("mass_kg"))
    return text.replace(before, f"mass_kg = {float(before.partition('=')[2]) + 0.5}", 1)


def blessing(source: str) -> list[str]:
    """Return the command that blesses one of the two runs."""
    words = [word.replace("REASON", "campaign") for word in COMMANDS["bless"]]
    return [word.replace("reports/blessed", f"reports/{source}") for word in words]


def interrupt(name: str, count: int, draw: random.Random, folder: Path) -> list[str]:
    """Interrupt one command so many times, then let it run to its end; return the problems."""
    if name == "bless":
        prepare_blessings(folder)
    words = COMMANDS[name] if name != "bless" else blessing("blessed")
    whole = None if name in LONG else call(words, folder)
    longest = LONGEST if whole is None else min(whole.seconds, LONGEST)
    problems = []
    if whole is not None and whole.code not in (0, 1):
        problems.append(f"{name}: undisturbed it fails: {whole.printed[-300:]}")
    for k in range(count):
        after = draw.uniform(0.0, longest)
        number = draw.choice((signal.SIGINT, signal.SIGTERM))
        if name == "bless":
            words = blessing(("blessed-other", "blessed")[k % 2])
        ended = call(words, folder, after, number)
        problem = judge(ended) or JUDGES[name](folder)
        told = f"{name:9} {signal.Signals(number).name:8} after {after:5.2f} s: ends {ended.seconds:5.2f} s later"
        click.echo(f"{told} with {ended.code}  {problem or 'right'}")
        problems += [f"{name}: {problem}"] if problem else []
    if whole is None:
        return problems
    last = call(words, folder)
    if last.code != whole.code or JUDGES[name](folder):
        problems.append(f"{name}: afterwards it ends with {last.code}, before with {whole.code}: {last.printed[-300:]}")
    return problems


@click.command()
@click.option("--count", type=click.IntRange(min=1), default=COUNT, show_default=True, help="Interrupts in all.")
@click.option("--seed", type=int, default=SEED, show_default=True, help="What draws signals and moments.")
@click.option("--only", default="", help="Commands, separated by commas.")
def main(count: int, seed: int, only: str) -> None:
    """Interrupt commands at random moments, and say what became of each."""
    names = [name for name in COMMANDS if not only or name in only.split(",")]
    problems: list[str] = []
    with tempfile.TemporaryDirectory(prefix="interrupts-", ignore_cleanup_errors=True) as spare:
        folder = Path(spare)
        make_project(folder)
        for k, name in enumerate(names):
            share = count // len(names) + (k < count % len(names))
            problems += interrupt(name, share, random.Random(f"{seed} {name}"), folder)
    for problem in problems:
        click.echo(problem)
    click.echo(f"{count} interrupts, seed {seed}: {len(problems)} problems")
    sys.exit(int(bool(problems)))


if __name__ == "__main__":
    main()
