"""Hostile files through every command that reads foreign files, and hostile answers through every door.

    python campaigns/hostile.py [files] [answers] [--only ID,ID] [--found FOLDER]

``data/hostile/files.csv`` holds a line per file: id, maker (a function of ``hostile_files.py``, ``hostile_robots.py`` or
``hostile_meshes.py``), the command that reads it, the exit code and words (a regular expression) that are expected.
``data/hostile/answers.csv`` holds a line per answer: id, door (command, record, package), kind (of ``hostile_program.py`` or
``hostile_package.py``), the status of the engine's row, and words in it.  What makers draw is drawn from SEED and their names.

A command must end within its limit, leave with its exit code, say its words, print no traceback, and leave no process behind.
``--found`` writes what was found as tables of the same form.  Exit code 1 where anything is not as expected.
"""

from __future__ import annotations

import csv
import importlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time as clock
import uuid
from dataclasses import dataclass
from pathlib import Path

import click
import hostile_meshes
import hostile_package
import hostile_program
import hostile_robots
from hostile_files import MAKERS

from crosscheck.kit.write import write
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "tests" / "shared"))
logged_arm = importlib.import_module("logged_arm")
DATA = HERE / "data" / "hostile"
GOOD = HERE / "data" / "two_links.urdf"
ARM = HERE / "data" / "door_faults" / "arm"
RIGID = HERE.parent / "tests" / "shared" / "kit_programs" / "rigid.py"
SEED = 20261127
TIMEOUT = 60.0  # [s] that a command is told
LIMIT = 300.0  # [s] of a whole command, which may read several times, on a machine that has other work
ANSWER_TIMEOUT = 20.0  # [s] of one engine
ANY = "*"  # a status that hangs on who is quicker
MARK = "CROSSCHECK_HOSTILE"
TRACEBACK = "Traceback (most recent call last)"
FILE_COLUMNS = ("id", "file", "command", "code", "words")
ANSWER_COLUMNS = ("id", "door", "kind", "status", "words")
assert hostile_meshes.shaped.__module__ in sys.modules  # makers are entered when their modules are imported
assert hostile_robots.xacro.__name__ in MAKERS


@dataclass(frozen=True)
class CommandEnd:
    """How a command ended: exit code (None: it was killed at the limit), what it printed, what it left, and seconds."""

    code: int | None
    printed: str
    leftover_files: tuple[str, ...]
    seconds: float


def read_table(name: str, only: tuple[str, ...] = ()) -> list[dict[str, str]]:
    """Return the lines of a table, in its order."""
    with (DATA / name).open(newline="", encoding="utf-8") as stream:
        return [row for row in csv.DictReader(stream) if not only or row["id"] in only]


def write_table(file: Path, columns: tuple[str, ...], rows: list[dict[str, str]]) -> None:
    """Write a table."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def find_marked(mark: str) -> list[tuple[int, str]]:
    """Return the processes that were started with a mark, with their command lines."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and f"{MARK}={mark}".encode() in (entry / "environ").read_bytes().split(b"\0"):
                found.append((int(entry.name), (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()[:200]))
        except OSError:
            continue
    return found


def call(words: list[str], folder: Path, limit: float = LIMIT) -> CommandEnd:
    """Run a command in a folder, its input a pipe that nobody writes into."""
    mark = uuid.uuid4().hex
    surroundings = os.environ | {MARK: mark, "OMP_NUM_THREADS": "1", "COLUMNS": "2000", "PYTHONPATH": str(folder)}
    surroundings |= {"XDG_CONFIG_HOME": str(folder / "config"), "CROSSCHECK_KEPT": ""}
    begun = clock.monotonic()
    with (folder / "printed.txt").open("wb") as log:
        child = subprocess.Popen(
            words, cwd=folder, env=surroundings, stdin=subprocess.PIPE, stdout=log, stderr=log, start_new_session=True
        )
        try:
            code: int | None = child.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
    seconds = clock.monotonic() - begun
    left = wait_for_none(mark) if code is not None else find_marked(mark)
    for process, _ in left:
        os.kill(process, signal.SIGKILL)
    child.wait()
    assert child.stdin is not None
    child.stdin.close()
    printed = (folder / "printed.txt").read_text(encoding="utf-8", errors="replace")
    return CommandEnd(code, printed, tuple(words for _, words in left) if code is not None else (), seconds)


def wait_for_none(mark: str, patience: float = 3.0) -> list[tuple[int, str]]:
    """Return the marked processes that are left after a moment, in which those that were killed end."""
    ahead = clock.monotonic() + patience
    while (left := find_marked(mark)) and clock.monotonic() < ahead:
        clock.sleep(0.05)
    return left


# Files.


def command_of(row: dict[str, str], file: Path, folder: Path) -> list[str]:
    """Return the command line that reads a file."""
    crosscheck = [sys.executable, "-m", "crosscheck"]
    limits = ["--timeout", f"{TIMEOUT:g}"]
    lines = {
        "lint": [*crosscheck, "lint", str(file), *limits],
        "compare": [*crosscheck, "compare", str(file), str(GOOD), *limits],
        "readers": [*crosscheck, "compare", str(file), "--readers", "all", *limits],
        "mujoco": [*crosscheck, "compare", f"{file}@mujoco", str(GOOD), *limits],
        "info": [sys.executable, "-m", "flexinv", "info", str(file)],
        "run": [*crosscheck, "run", "--models", str(file.parent), "--engines", "flexinv,pinocchio", "--studies", ""],
        "identify": [*crosscheck, "identify", "arm", "--models", str(folder / "models"), "--log", str(file)],
    }
    return lines[row["command"]]


def run_file(row: dict[str, str]) -> CommandEnd:
    """Write a file into a folder of its own, and let its command read it."""
    draw = random.Random(f"{SEED} {row['file']}")
    with tempfile.TemporaryDirectory(prefix="hostile-", ignore_cleanup_errors=True) as spare:
        folder = Path(spare) / "work"
        place = folder / "files"
        place.mkdir(parents=True)
        if row["command"] == "identify":
            logged_arm.write_arm(folder / "models" / "arm")
        file = MAKERS[row["file"]](place, draw)
        return call(command_of(row, file, folder), folder)


def judge_file(row: dict[str, str], ended: CommandEnd) -> str:
    """Return what is wrong with how a command ended, "" where nothing is."""
    if ended.code is None:
        return f"it hangs: killed after {ended.seconds:.0f} s"
    if TRACEBACK in ended.printed:
        return "a traceback"
    if ended.leftover_files:
        return f"it left {ended.leftover_files[0]}"
    if str(ended.code) != row["code"]:
        return f"exit code {ended.code}, expected {row['code']}: {one_line(ended.printed)[-200:]}"
    if not re.search(row["words"], one_line(ended.printed)):
        return f"other words: {one_line(ended.printed)[-300:]}"
    return ""


def one_line(printed: str) -> str:
    """Return what was printed without frames of tables and breaks of lines."""
    return " ".join(re.sub(r"[\u2500-\u257f]", " ", printed).split())


def run_files(only: tuple[str, ...], path: Path | None) -> int:
    """Run all files, say how each ended, and return the number of failures."""
    rows = read_table("files.csv", only)
    failures = 0
    seen = []
    for row in rows:
        ended = run_file(row)
        problem = judge_file(row, ended)
        failures += bool(problem)
        click.echo(f"{row['id']} {row['file']:24} {row['command']:8} {ended.seconds:5.1f} s  {problem or 'right'}")
        seen.append({**row, "code": str(ended.code), "words": one_line(ended.printed)[-400:]})
    if path is not None:
        write_table(path / "files.csv", FILE_COLUMNS, seen)
    click.echo(f"{len(rows)} files: {len(rows) - failures} right, {failures} not")
    return failures


# Answers.


def make_project(rows: list[dict[str, str]], folder: Path) -> None:
    """Write a project whose engines give the answers: programs, records and objects of Python."""
    shutil.copytree(ARM, folder / "models" / "arm")
    for module in (hostile_program, hostile_package):
        shutil.copy(Path(module.__file__), folder)
    shutil.copy(RIGID, folder / "rigid.py")
    mechanism = load_mechanism(ARM)
    write(mechanism, load_cases(ARM, mechanism)["move"], folder / "kit")
    subprocess.run([sys.executable, "rigid.py", "kit", "answer"], cwd=folder, check=True)
    (folder / "answer" / "certificate.json").unlink(missing_ok=True)
    tables = []
    for row in rows:
        if row["door"] == "record":
            place = folder / "models" / "arm" / "records" / row["id"] / "move"
            place.parent.mkdir(parents=True)
            words = [sys.executable, "hostile_program.py", row["kind"], "kit", str(place), "answer"]
            subprocess.run(words, cwd=folder, check=False)
        elif row["door"] == "command":
            words = [sys.executable, "./hostile_program.py", row["kind"], "{kit}", "{out}", str(folder / "answer")]
            tables.append(f"[engines.{row['id']}]\ncommand = {json.dumps(words)}\n")
        else:
            tables.append(f'[engines.{row["id"]}]\npython = "hostile_package:{row["kind"]}"\n')
    (folder / "crosscheck.toml").write_text("\n".join(tables), encoding="utf-8")


def run_answers(only: tuple[str, ...], path: Path | None, folder: Path) -> int:
    """Run all answers in one run, say how each is told, and return the number of failures."""
    rows = read_table("answers.csv", only)
    make_project(rows, folder)
    words = [sys.executable, "-m", "crosscheck", "run", "--models", "models", "--trust-commands", "--studies", ""]
    words += ["--engines", ",".join(["flexinv", *(row["id"] for row in rows)]), "--timeout", f"{ANSWER_TIMEOUT:g}"]
    ended = call([*words, "--jobs", "2", "--out", "report"], folder, 3600.0)
    problems = judge_run(ended, folder)
    report = read_report(folder)
    seen = []
    for row in rows:
        status, said = report.get(row["id"], ("no row", ""))
        problem = judge_answer(row, status, said)
        click.echo(f"{row['id']} {row['door']:8} {row['kind']:22} {status:9} {problem or 'right'}")
        problems += [problem] if problem else []
        seen.append({**row, "status": status, "words": said[:300]})
    if path is not None:
        write_table(path / "answers.csv", ANSWER_COLUMNS, seen)
    for line in problems:
        click.echo(line[:600])
    click.echo(f"{len(rows)} answers in {ended.seconds:.0f} s, exit code {ended.code}: {len(problems)} problems")
    return len(problems)


def judge_run(ended: CommandEnd, folder: Path) -> list[str]:
    """Return what is wrong with the run as a whole."""
    problems = judge_file({"code": "2", "words": "engine|deviat"}, ended)
    if problems:
        return [problems]
    page = "".join(file.read_text(encoding="utf-8") for file in (folder / "report").rglob("*.html"))
    if hostile_program.HTML in page or hostile_package.HTML in page:
        return ["a page of the report has HTML of an answer in it"]
    return ["the terminal is sent sequences of an answer"] if "\x1b" in ended.printed else []


def read_report(folder: Path) -> dict[str, tuple[str, str]]:
    """Return the status and the words of each engine, the verdict of its torque where it has answered."""
    file = folder / "report" / "results.json"
    if not file.exists():
        return {}
    results = json.loads(file.read_text(encoding="utf-8"))
    report = {row["engine"]: (row["status"], row["message"]) for row in results["runs"]}
    for row in results["comparisons"]:
        if row["quantity"] == "torque" and report[row["engine"]][0] == "ok":
            report[row["engine"]] = (row["verdict"], row["message"])
    return report


def judge_answer(row: dict[str, str], status: str, text: str) -> str:
    """Return what is wrong with the row of an engine, "" where nothing is."""
    if row["status"] not in (ANY, status):
        return f"{status}, expected {row['status']}: {text[:200]}"
    return "" if re.search(row["words"], " ".join(text.split())) else f"other words: {text[:300]}"


@click.command()
@click.argument("parts", nargs=-1, type=click.Choice(["files", "answers"]))
@click.option("--only", default="", help="Ids, separated by commas.")
@click.option("--found", type=click.Path(path_type=Path), help="Folder for what was found, as tables.")
def main(parts: tuple[str, ...], only: str, found: Path | None) -> None:
    """Run hostile files and answers, and judge how each ended."""
    chosen = tuple(filter(None, only.split(",")))
    if found is not None:
        found.mkdir(parents=True, exist_ok=True)
    failures = 0
    if "files" in parts or not parts:
        failures += run_files(chosen, found)
    if "answers" in parts or not parts:
        with tempfile.TemporaryDirectory(prefix="hostile-", ignore_cleanup_errors=True) as folder:
            failures += run_answers(chosen, found, Path(folder))
    sys.exit(int(failures > 0))


if __name__ == "__main__":
    main()
