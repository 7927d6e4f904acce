"""Nights with planted changes: what moves values is told with what has changed, what moves none is silent.

    python campaigns/nights.py [--folder FOLDER] [--history URL] [--untouched 20] [--only 3,17]

A small project (two rods, and a strip that bends) is run by flexinv, Pinocchio, MuJoCo, Exudyn's beams and three engines of
its own, blessed, and then run night after night by ``crosscheck nightly``, all in processes of their own: first ``--untouched``
nights in which nothing has changed, then one for each of 40 planted changes, of models, of the version or the settings of an
engine, and of our own code (a copy of both packages), from 0.001 to 50 %.  After each of them everything is as before.

Expected: every engine of which a value has moved by three of its error bars or more is told, with what was changed; nothing is
told of an engine whose values have all moved by less than one bar.  The judge holds the saved series of the night against those
of the first night, sample by sample.  Exit code 1 where that fails.

``--history postgresql+psycopg://...`` keeps the history there; SQLite in the folder without it.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np

from crosscheck.measures.record import Series, read_record

ROOT = Path(__file__).resolve().parent.parent
ENGINES = "flexinv,pinocchio,mujoco,exudyn-ge,fine,middle,wide"
BARS = {"fine": 1e-7, "middle": 2e-3, "wide": 0.3}  # of the range: those of the engines of the project's own
UNKNOWN, ROUNDING = (
    1e-6,
    1e-9,
)  # of the range, as the page on nights says: bars that are not stated, and the least of all
TOLD, SILENT = 3.0, 1.0  # bars
OWN = """
import json
from dataclasses import replace
from pathlib import Path
import numpy as np
from crosscheck.engines.pinocchio import adapter

FILE = Path(__file__).with_name("own.json")

class Own:
    def __init__(self, name, bar):
        self.name, self.bar = name, bar
    def state(self):
        return json.loads(FILE.read_text())[self.name]
    def version(self):
        return self.state()["version"]
    def abilities(self):
        return "Trees of rigid links."
    def unsupported(self, mechanism, case, engine):
        return adapter.unsupported(mechanism, case, "pinocchio")
    def run(self, mechanism, case, engine, options):
        state = self.state()
        good = adapter.run(mechanism, case, "pinocchio", options)
        def moved(one):
            values = one.values * state["factor"]
            return replace(one, values=values, error=np.full(values.shape, self.bar * np.ptp(values)))
        series = {name: moved(one) for name, one in good.series.items()}
        return replace(good, engine=engine, series=series, settings={"gain": state["gain"]})

fine, middle, wide = Own("fine", 1e-7), Own("middle", 2e-3), Own("wide", 0.3)
"""
LIMIT = """
[[limits]]
quantity = "QUANTITY"
engines = ["*"]
maximum = 1.0
reason = "this campaign is about values, not about differences of engines"
"""
RODS = """
source = "a campaign of nights"

[cases.swing]
step_s = 5e-3
quantities = ["torque", "tip", "wrench"]

[cases.swing.motion]
duration_s = 0.5
hold_s = 0.25
joints.pivot = { from_deg = 0, to_deg = 90 }
joints.knee = { from_deg = 0, to_deg = -45 }
"""
STRIP = """
source = "a campaign of nights"

[cases.cycloid]
step_s = 2e-4
sample_s = 2e-3
quantities = ["torque", "tip", "deflection"]

[cases.cycloid.motion]
law = "cycloid"
duration_s = 0.2
hold_s = 0.1
joints.hub = { from_deg = 0, to_deg = 120 }
"""
WRAPPED = """


def _planted(plain):
    from dataclasses import replace as _replace
    def run(*words, **more):
        record = plain(*words, **more)
        return _replace(record, series={n: _replace(s, values=s.values * FACTOR) for n, s in record.series.items()})
    return run


run = _planted(run)
"""


@dataclass(frozen=True)
class Change:
    """A planted change: of a file below the project, and the words that have to be said of it."""

    name: str
    file: str
    edit: Callable[[str], str]
    words: str


@dataclass
class Project:
    """A project in a folder, its history, and the series of its first night by mechanism, case and engine."""

    folder: Path
    history: str
    first: dict[tuple[str, str, str], dict[str, Series]] = field(default_factory=dict)

    def call(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a command of crosscheck in the project, with its copy of both packages."""
        path = os.pathsep.join((str(self.folder / "code"), str(self.folder)))
        environment = {**os.environ, "PYTHONPATH": path, "CROSSCHECK_KEPT": "", "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "crosscheck", *words]
        return subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False)

    def night(self) -> tuple[int, dict[str, Any], str]:
        """Run one night; return its exit code, its results as plain values, and what it printed."""
        own = [word for name in BARS for word in ("--engine", f"own:{name}")]
        history = ["--history", self.history] if self.history else []
        done = self.call("nightly", "--engines", ENGINES, *own, "--studies", "", *history)
        file = self.folder / "reports" / "latest" / "results.json"
        return done.returncode, json.loads(file.read_text()), done.stdout + done.stderr

    def series(self, results: dict[str, Any]) -> dict[tuple[str, str, str], dict[str, Series]]:
        """Return the saved series of a night by mechanism, case and engine."""
        latest = self.folder / "reports" / "latest"
        runs = [run for run in results["runs"] if run["status"] == "ok"]
        return {(r["mechanism"], r["case"], r["engine"]): dict(read_record(latest / r["series"]).series) for r in runs}


def prepare(folder: Path, history: str) -> Project:
    """Write the project, run its first night and bless it."""
    for name in ("flexinv", "crosscheck"):
        shutil.copytree(ROOT / name, folder / "code" / name, copy_function=shutil.copy2)
    for name, cases in (("double_pendulum", RODS), ("flex_one_link", STRIP)):
        (folder / "models" / name).mkdir(parents=True)
        shutil.copy(ROOT / "models" / name / "mechanism.toml", folder / "models" / name)
        limits = [LIMIT.replace("QUANTITY", quantity) for quantity in ("torque", "tip", "wrench", "deflection")]
        (folder / "models" / name / "cases.toml").write_text(cases + "".join(limits))
    (folder / "own.py").write_text(OWN)
    state = {name: {"version": "1.0", "factor": 1.0, "gain": 1.0} for name in BARS}
    (folder / "own.json").write_text(json.dumps(state, indent=1))
    project = Project(folder, history)
    code, results, said = project.night()
    if code not in (0, 1):
        raise SystemExit(f"the first night failed ({code}):\n{said}")
    project.first = project.series(results)
    blessed = project.call("bless", "--reason", "the first night of a campaign")
    if blessed.returncode:
        raise SystemExit(f"the first night could not be blessed:\n{blessed.stdout}{blessed.stderr}")
    return project


def scale(pattern: str, factor: float) -> Callable[[str], str]:
    """Return an edit that multiplies the first number after a pattern."""

    def edit(text: str) -> str:
        match = re.search(pattern + r"(-?[\d.]+(?:e-?\d+)?)", text)
        if match is None:
            raise SystemExit(f"nothing in the file is like {pattern}")
        start, end = match.span(1)
        return f"{text[:start]}{float(match.group(1)) * factor!r}{text[end:]}"

    return edit


def set_own(name: str, **values: object) -> Callable[[str], str]:
    """Return an edit of what an engine of the project's own is."""

    def edit(text: str) -> str:
        state = json.loads(text)
        state[name] |= values
        return json.dumps(state, indent=1)

    return edit


def list_changes() -> list[Change]:
    """Return the 40 planted changes: sixteen of models, eight each of versions, of settings and of our own code."""
    rods, strip = "models/double_pendulum/", "models/flex_one_link/"
    model = [
        (rods + "mechanism.toml", r"mass_kg = "),
        (rods + "mechanism.toml", r"rod = \{ length_m = "),
        (rods + "mechanism.toml", r"gravity_m_per_s2 = \[0, 0, "),
        (rods + "cases.toml", r"to_deg = "),
        (rods + "cases.toml", r"joints.knee = \{ from_deg = 0, to_deg = "),
        (strip + "mechanism.toml", r"y = 13.7, z = "),
        (strip + "mechanism.toml", r"mass_per_length_kg_per_m = "),
        (strip + "cases.toml", r"to_deg = "),
    ]
    changes = []
    for k, size in enumerate(np.geomspace(1e-5, 0.5, 16)):
        file, pattern = model[(5 * k) % len(model)]
        _, mechanism, name = file.split("/")
        edit = scale(pattern, 1.0 + float(size))
        changes.append(Change(f"{file} {pattern} {size:+.2g}", file, edit, f"the model {mechanism} ({name})"))
    sizes = [float(size) for size in np.geomspace(1e-5, 0.5, 8)]
    for k, size in enumerate(sizes):
        engine = list(BARS)[k % len(BARS)]
        edit = set_own(engine, version="1.1", factor=1.0 + size)
        words = f"the version of {engine} (1.0 -> 1.1)"
        changes.append(Change(f"version of {engine} {size:+.2g}", "own.json", edit, words))
    for k, size in enumerate(sizes):
        engine = list(BARS)[(k + 1) % len(BARS)]
        edit = set_own(engine, gain=2.0, factor=1.0 - size)
        changes.append(Change(f"settings of {engine} {-size:+.2g}", "own.json", edit, f"the settings of {engine}"))
    for k, size in enumerate(sizes):
        engine = ("pinocchio", "mujoco", "flexinv", "exudyn")[k % 4]
        file = f"code/crosscheck/engines/{engine}/adapter.py"
        changes.append(Change(f"adapter of {engine} {size:+.2g}", file, append(size), "our own code (crosscheck)"))
    return changes


def append(size: float) -> Callable[[str], str]:
    """Return an edit of an adapter that multiplies all that its engine gives."""
    return lambda text: text + WRAPPED.replace("FACTOR", repr(1.0 + size))


def moved_by(before: dict[str, Series], after: dict[str, Series], quantities: list[str]) -> float:
    """Return how many error bars the values of an engine have moved at most [-], over all samples that are compared."""
    most = 0.0
    for name, old in before.items():
        if old.quantity not in quantities:
            continue
        new = after.get(name)
        if new is None or new.values.shape != old.values.shape:
            return np.inf
        size = max(float(np.ptp(old.values)), float(np.abs(old.values).max()))
        bars = np.full(old.values.shape, UNKNOWN * size) if old.error is None else old.error
        bars = np.maximum(bars, ROUNDING * size)
        if size > 0.0:
            most = max(most, float((np.abs(new.values - old.values) / bars).max()))
        elif np.abs(new.values).max() > 0.0:
            return np.inf
    return most


def judge(project: Project, words: str, code: int, results: dict[str, Any], text: str) -> tuple[list[str], str]:
    """Return what is wrong in a night, and a summary; words : what has to be said of what moved, "" where nothing was changed."""
    wrong = []
    after = project.series(results)
    quantities = {(c["mechanism"], c["case"]): c["quantities"] for c in results["cases"]}
    told: dict[tuple[str, str, str], set[str]] = {}
    for move in results["moves"]:
        told.setdefault((move["mechanism"], move["case"], move["engine"]), set()).add(move["reason"])
    counts = {"told": 0, "silent": 0, "between": 0}
    for place, before in project.first.items():
        if place not in after:
            wrong.append(f"{place} was not run")
            continue
        bars = moved_by(before, after[place], quantities[place[:2]])
        reasons = told.get(place, set())
        kind = "told" if bars >= TOLD else "silent" if bars < SILENT else "between"
        counts[kind] += 1
        if kind == "told" and not reasons:
            wrong.append(f"{' '.join(place)} moved by {bars:.3g} bars and nothing is told")
        if kind == "silent" and reasons:
            wrong.append(f"{' '.join(place)} moved by {bars:.3g} bars and is told: {reasons}")
        wrong += [f"{' '.join(place)}: '{reason}' in place of '{words}'" for reason in reasons if reason != words]
    if told and code != 1:
        wrong.append(f"exit code {code} in a night in which values moved")
    deviate = any(row["verdict"] not in ("within", "skipped") for row in results["comparisons"])
    if not told and not deviate and code != 0:
        wrong.append(f"exit code {code} in a silent night: {text[-300:]}")
    return wrong, ", ".join(f"{count} {kind}" for kind, count in counts.items())


def plant(project: Project, change: Change) -> tuple[list[str], str]:
    """Run a night with a change, judge it, and undo the change."""
    file = project.folder / change.file
    text = file.read_text()
    file.write_text(change.edit(text))
    try:
        return judge(project, change.words, *project.night())
    finally:
        file.write_text(text)


@click.command()
@click.option("--folder", type=click.Path(path_type=Path), help="Folder of the project; a temporary one without it.")
@click.option("--history", default="", help="URL of the history's database.")
@click.option("--untouched", default=20, help="Nights in which nothing has changed.")
@click.option("--only", default="", help="Numbers of changes, separated by commas.")
def main(folder: Path | None, history: str, untouched: int, only: str) -> None:
    """Run the nights and say what is wrong in them."""
    place = Path(tempfile.mkdtemp(prefix="nights-")) if folder is None else folder
    project = prepare(place, history)
    changes = list_changes()
    numbers = [int(word) for word in only.split(",")] if only else range(len(changes))
    bad = 0
    for k in range(untouched):
        wrong, summary = judge(project, "", *project.night())
        bad += bool(wrong)
        click.echo(f"untouched {k}: {summary} {'; '.join(wrong)}")
    for k in numbers:
        wrong, summary = plant(project, changes[k])
        bad += bool(wrong)
        click.echo(f"{k} {changes[k].name}: {summary} {'; '.join(wrong)}")
    click.echo(f"{untouched + len(numbers)} nights, {bad} wrong")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
