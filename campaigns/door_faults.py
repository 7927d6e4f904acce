"""Faults of outside engines, planted in their answers, through the three doors: record, command, package.

    python campaigns/door_faults.py [--only f001,f002] [--folder FOLDER]

``data/door_faults/faults.csv`` holds a line per fault: machine, door, fault, its size, which column or body, the bars with
which it is answered (``door_program.py`` explains them), what is expected (refused: neither within nor explained; within), and
the names that a diagnosis may give it, as a regular expression.  *Unknown* is always allowed.  Whoever wrote the list had not
read the causes that crosscheck names, nor more of its rules for verdicts than the page for users.  Only noise is drawn, of
fixed seeds.

Exit code 1 where an answer is accepted that is expected to be refused, refused that is expected to be accepted, or named wrongly.
"""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import click
import door_package
import door_program
import door_sources

from crosscheck.kit.write import write
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

HERE = Path(__file__).resolve().parent
DATA = HERE / "data" / "door_faults"
RIGID = HERE.parent / "tests" / "shared" / "kit_programs" / "rigid.py"
PROGRAM = ("door_program.py", "door_package.py", "signal_faults.py", "rigid_faults.py")
ACCEPTED = ("within", "explained")
CASE = "move"
PARTS = ("comparisons", "runs", "diagnoses")


@dataclass(frozen=True)
class Result:
    """What a run says of one answer: of its torque the verdict and the difference [of the range], and the names of the cause."""

    fault: dict[str, str]
    bars: str
    verdict: str
    difference: float
    limit: float
    names: tuple[str, ...]
    message: str

    @property
    def problem(self) -> str:
        """Return what is wrong with the judgement, "" where nothing is."""
        expected = self.fault["expected"]
        settled = self.bars in door_program.FALLS and expected == "within"
        if expected == "refused" and self.verdict in ACCEPTED:
            return f"accepted: {self.verdict}"
        if expected == "refused" and self.verdict not in ("deviation", "unjudged"):
            return f"not judged: {self.verdict} {self.message}"
        if expected == "within" and self.verdict not in (ACCEPTED if settled else ("within",)):
            return f"false alarm: {self.verdict}"
        pattern = self.fault["names"] or "$^"
        wrong = [name for name in self.names if not re.search(pattern, name, re.IGNORECASE)]
        return f"wrong name: {'; '.join(wrong)}" if wrong else ""


def read_faults(only: tuple[str, ...] = ()) -> list[dict[str, str]]:
    """Return the lines of the list, in its order."""
    with (DATA / "faults.csv").open(newline="") as stream:
        return [row for row in csv.DictReader(stream) if not only or row["id"] in only]


def answers(faults: list[dict[str, str]]) -> list[tuple[dict[str, str], str]]:
    """Return each fault with each of its bars."""
    return [(row, bars) for row in faults for bars in row["bars"].split()]


def make_project(faults: list[dict[str, str]], folder: Path) -> Path:
    """Write models, records, programs and ``crosscheck.toml`` into a folder, and return it."""
    machines = sorted({row["machine"] for row in faults})
    for machine in machines:
        shutil.copytree(DATA / machine, folder / "models" / machine)
    for name in PROGRAM:
        shutil.copy(HERE / name, folder)
    shutil.copy(RIGID, folder / "rigid.py")
    shutil.copy(DATA / "faults.csv", folder)
    door_sources.write_sources(folder, machines)
    door_program.HERE = folder
    tables = []
    for row, bars in answers(faults):
        name = f"{row['id']}-{bars}"
        if row["door"] == "record":
            write_record(folder, row, bars)
        elif row["door"] == "command":
            words = json.dumps([sys.executable, "./door_program.py", "{kit}", "{out}", row["id"], bars])
            refine = str(bars in door_package.REFINED).lower()
            tables.append(f'[engines.{name}]\ncommand = {words}\ncases = ["{row["machine"]}/*"]\nrefine = {refine}\n')
        else:
            tables.append(
                f'[engines.{name}]\npython = "door_package:{row["id"]}_{bars}"\ncases = ["{row["machine"]}/*"]\n'
            )
    (folder / "crosscheck.toml").write_text("\n".join(tables))
    return folder


def write_record(folder: Path, row: dict[str, str], bars: str) -> None:
    """Answer a case once, and put the answer where records lie."""
    mechanism = load_mechanism(folder / "models" / row["machine"])
    case = load_cases(folder / "models" / row["machine"], mechanism)[CASE]
    kit = folder / "kits" / row["machine"]
    if not kit.exists():
        write(mechanism, case, kit)
    place = folder / "models" / row["machine"] / "records" / f"{row['id']}-{bars}" / CASE
    door_program.answer(kit, place, door_program.planted(row["id"]), bars)


def run(folder: Path, faults: list[dict[str, str]]) -> list[Result]:
    """Run crosscheck once over all answers, and return what it says of each."""
    words = [
        sys.executable,
        "-m",
        "crosscheck",
        "run",
        "--models",
        "models",
        "--trust-commands",
        "--studies",
        "",
        "--jobs",
        "1",
    ]
    words += ["--engines", ",".join(["flexinv", *(f"{row['id']}-{bars}" for row, bars in answers(faults))])]
    surroundings = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(folder)}
    told = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "encoding": "utf-8"}
    with (
        subprocess.Popen([*words, "--out", "report"], cwd=folder, env=surroundings, **told) as child,
        (folder / "run.log").open("w", encoding="utf-8") as log,
        click.progressbar(length=len(answers(faults)), label="answers; then their causes", file=sys.stderr) as bar,
    ):
        for line in child.stdout or ():
            log.write(line)
            bar.update(int(f"/{CASE} f" in line and not line.startswith("–")))
    return read_results(folder, faults)


def read_results(folder: Path, faults: list[dict[str, str]]) -> list[Result]:
    """Return what the report in a folder says of each answer."""
    result = json.loads((folder / "report" / "results.json").read_text())
    return [judge(row, bars, result) for row, bars in answers(faults)]


def judge(row: dict[str, str], bars: str, found: dict) -> Result:
    """Return what a report says of one answer."""
    name = f"{row['id']}-{bars}"
    about = {
        part: [one for one in found[part] if one["engine"] == name and one["mechanism"] == row["machine"]]
        for part in PARTS
    }
    mine = [one for one in about["comparisons"] if one["quantity"] == "torque"]
    names = tuple(words for one in about["diagnoses"] for words in named(one))
    if not mine or mine[0]["maximum"] is None:
        runs = [*about["runs"], {"status": "no run", "message": ""}]
        return Result(row, bars, runs[0]["status"], 0.0, 0.0, names, runs[0]["message"])
    (one,) = mine
    return Result(
        row, bars, one["verdict"], one["maximum"] / (one["scale"] or 1.0), one["limit"] or 0.0, names, one["message"]
    )


def named(diagnosis: dict) -> tuple[str, ...]:
    """Return what a diagnosis names, in one text for causes that the motion cannot tell apart; () where it names nothing."""
    words = [f"{one['cause']} {one['target']}: {one['words']}" for one in diagnosis["named"]]
    return (" | ".join(words),) if words else ()


def table(results: list[Result]) -> str:
    """Return the table of all answers, and the counts."""
    lines = [
        f"{'answer':16} {'machine':9} {'door':8} {'fault':14} {'size':>8} {'difference':>10} {'verdict':10} named / problem"
    ]
    for one in results:
        row = one.fault
        said = ", ".join(one.names) + (f"  ** {one.problem}" if one.problem else "")
        first = f"{row['id'] + '-' + one.bars:16} {row['machine']:9} {row['door']:8} {row['fault']:14} {row['size']:>8}"
        lines.append(f"{first} {one.difference:10.2e} {one.verdict:10} {said}")
    counts = Counter(one.problem.partition(":")[0] or "right" for one in results)
    kinds = len({one.fault["id"] for one in results})
    lines.append(
        f"{kinds} faults, {len(results)} answers: " + ", ".join(f"{n} {what}" for what, n in sorted(counts.items()))
    )
    return "\n".join(lines)


@click.command()
@click.option("--only", default="", help="Faults, separated by commas.")
@click.option(
    "--folder",
    type=click.Path(path_type=Path),
    help="Folder of the project; kept, and judged again where it has a report.",
)
def main(only: str, folder: Path | None) -> None:
    """Plant faults in answers behind three doors, and say how they are judged."""
    faults = read_faults(tuple(filter(None, only.split(","))))
    with tempfile.TemporaryDirectory() as spare:
        folder = folder or Path(spare)
        folder.mkdir(parents=True, exist_ok=True)
        again = (folder / "report" / "results.json").exists()
        results = read_results(folder, faults) if again else run(make_project(faults, folder), faults)
    click.echo(table(results))
    sys.exit(int(any(one.problem for one in results)))


if __name__ == "__main__":
    main()
