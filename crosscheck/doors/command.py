"""A program as an engine: it gets a case kit and writes an answer, in any language.

The program runs in the folder of ``crosscheck.toml``, without a shell, in the process group of its child process: what the time
limit, Ctrl-C and the bound on files end there, they end here.  Its kit is blind.  With ``refine`` it runs three times, each with
twice the steps and elements of the run before, and the error bars follow (`crosscheck.measures.budget`).
"""

from __future__ import annotations

import ctypes
import os
import shlex
import signal
import subprocess
import sys
import time as clock
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from crosscheck.doors.config import accepts_case
from crosscheck.engines.base import Options
from crosscheck.engines.shared.export_files import NotExported
from crosscheck.kit.answer import read_answer
from crosscheck.kit.write import write
from crosscheck.measures.budget import Family, add_error_bars
from crosscheck.measures.record import Record
from crosscheck.measures.series_csv import write as write_series
from crosscheck.output_folder import remove_tree
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

LEVELS = (1, 2, 4)  # of a refinement: times as fine
TAIL = 4000  # [bytes] of what the program printed that a report keeps
PR_SET_PDEATHSIG = 1  # linux/prctl.h
OURS = ("flexinv", "crosscheck")
BLOCKED = 'raise ImportError("{name} is out of reach in a blind round")\n'


class ProgramError(RuntimeError):
    """A program that did not come to its end: how it ended, and what it said last."""


def open_adapter(name: str, mechanism: str, settings: Mapping[str, Any]) -> ProgramAdapter:
    """Return the adapter of a program; mechanism : its folder; settings : see `ProgramAdapter`."""
    return ProgramAdapter(name, Path(mechanism).name, settings)


class ProgramAdapter:
    """The adapter of one program.

    settings : command (words), folder (in which it runs), refine, cases, version, abilities, blind (nothing of ours in reach)
    """

    MESHES = True  # kits hold them

    def __init__(self, name: str, mechanism: str, settings: Mapping[str, Any]) -> None:
        """Keep name of the engine, name of the mechanism's folder, and settings."""
        self._name = name
        self._mechanism = mechanism
        self._settings = settings

    def version(self) -> str:
        """Return the version that crosscheck.toml states; an answer may state its own."""
        return str(self._settings.get("version", ""))

    def abilities(self) -> str:
        """Return one sentence: what it can do, or what is run."""
        said = str(self._settings.get("abilities", ""))
        return said or f"the program {shlex.join(self._settings['command'])}"

    def unsupported(self, mechanism: Mechanism, case: Case, engine: str) -> str | None:
        """Return the reason why it is not asked, or None where it is."""
        patterns = list(self._settings.get("cases", ["*"]))
        if accepts_case(patterns, self._mechanism or mechanism.name, case.name):
            return None
        return f"crosscheck.toml asks it for {', '.join(patterns)} only"

    def run(self, mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
        """Return its answer; with ``refine`` the finest of three, with error bars [units of the series].

        Raises ProgramError, and InputError where its answer is none.
        """
        refine = bool(self._settings.get("refine", False)) and bool(options.get("error", True))
        records = []
        for level in LEVELS if refine else LEVELS[:1]:
            records.append(self._run_level(mechanism, case, level))
            if records[-1].status != "ok":
                return records[-1]
        made = records[-1]
        if refine:
            series, budget = add_error_bars(made.series, [Family("step and mesh", [one.series for one in records])])
            made = replace(made, series=series, budget=budget, wall_time=sum(one.wall_time for one in records))
            made = replace(made, certificate=records[0].certificate)
        return replace(made, settings={**made.settings, "command": shlex.join(self._settings["command"])})

    def export(self, mechanism: Mechanism, case: Case, engine: str, effort: Any, folder: Path) -> None:
        """Write the kit that it was given, with the expected effort (samples, nv) [N m], [N], and the command to run."""
        if self._settings.get("blind"):
            raise NotExported("a blind round is not exported")
        write(mechanism, case, folder / "kit")
        from crosscheck.engines.base import sample_times
        from crosscheck.measures.record import torque_series

        write_series(folder / "expected.csv", sample_times(case), torque_series(mechanism, effort).values())
        words = shlex.join(fill_command(self._settings["command"], Path("kit"), Path("out")))
        (folder / "run.txt").write_text(f"{words}\n", encoding="utf-8")
        (folder / "out").mkdir()

    def _run_level(self, mechanism: Mechanism, case: Case, level: int) -> Record:
        """Return the answer of one run, ``level`` times as fine."""
        scratch = Path.cwd() / f"{self._name}-{level}"
        remove_tree(scratch)
        kit = scratch / "kit"
        out = scratch / "out"
        out.mkdir(parents=True)
        write(mechanism, case, kit, refinement=level)
        start = clock.perf_counter()
        self._run_program(kit, out, scratch)
        wall = clock.perf_counter() - start
        record = self._read_answer(out, mechanism, case)
        return record if record.wall_time else replace(record, wall_time=wall)

    def _read_answer(self, out: Path, mechanism: Mechanism, case: Case) -> Record:
        """Return the record of an answer [units of the series].

        Raises InputError with names of files in the answer, whose folder is gone when it is read, and with a way to the same.
        """
        try:
            record = read_answer(out, mechanism, case, self._name)
        except InputError as error:
            name = self._mechanism or mechanism.name
            again = f"crosscheck export {name} --case {case.name} --engine {self._name} makes its kit again"
            told = "" if self._settings.get("blind") else f"; the answer is not kept: {again}"
            raise InputError(f"{_format_within(out, str(error))}{told}") from error
        broken = record.certificate.get("broken")
        if broken is None:
            return record
        return replace(record, certificate={**record.certificate, "broken": _format_within(out, broken)})

    def _run_program(self, kit: Path, out: Path, scratch: Path) -> None:
        """Run the program.  Raises ProgramError unless it leaves with 0."""
        words = fill_command(self._settings["command"], kit, out)
        blind = bool(self._settings.get("blind", False))
        home = Path(self._settings["folder"])
        if os.sep in words[0] and not os.path.isabs(words[0]):
            words[0] = str(home / words[0])
        if blind:  # it runs elsewhere: a script that stands beside crosscheck.toml is named in full
            words = [str(home / word) if (home / word).is_file() else word for word in words]
        log = scratch / "printed.txt"
        try:
            with log.open("wb") as stream:
                done = subprocess.run(
                    words,
                    cwd=scratch if blind else home,
                    env=make_environment(scratch if blind else None),
                    stdin=subprocess.DEVNULL,
                    stdout=stream,
                    stderr=subprocess.STDOUT,
                    preexec_fn=_end_with_parent if sys.platform == "linux" else None,
                    check=False,
                )
        except OSError as error:
            raise ProgramError(f"{words[0]} cannot be run: {error.strerror or error}") from error
        printed = read_tail(log)
        os.write(sys.stdout.fileno(), printed.encode())  # to what the report keeps of its child process
        if done.returncode:
            raise ProgramError(describe_ending(done.returncode, printed))


def _format_within(folder: Path, words: str) -> str:
    """Return words in which files of a folder have their names in it."""
    return words.replace(f"{folder}{os.sep}", "").replace(str(folder), "the answer")


def fill_command(command: Iterable[str], kit: Path, out: Path) -> list[str]:
    """Return the words of a command with the folders of the kit and of the answer."""
    return [word.replace("{kit}", str(kit)).replace("{out}", str(out)) for word in command]


def describe_ending(code: int, printed: str) -> str:
    """Return the words for the end of a program, with the last line that it printed."""
    last = next((line for line in reversed(printed.splitlines()) if line.strip()), "")
    said = f": {last.strip()[:400]}" if last else ""
    if code > 0:
        return f"the program left with exit code {code}{said}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = "unknown"
    return f"the program was killed by signal {-code} ({name}){said}"


def read_tail(file: Path) -> str:
    """Return the end of what was printed, whatever bytes are in it."""
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - TAIL))
        return stream.read().decode("utf-8", errors="replace")


def make_environment(blind: Path | None = None) -> dict[str, str]:
    """Return the environment of a program: that of the user, without our own path.

    blind : a folder for modules that hide this project from Python, so that nothing of it can be imported
    """
    root = str(Path(__file__).resolve().parents[2])
    paths = [p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p and Path(p).resolve() != Path(root)]
    made = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "CROSSCHECK_HISTORY")}
    if blind is not None:
        for name in OURS:
            (blind / "hidden" / name).mkdir(parents=True, exist_ok=True)
            (blind / "hidden" / name / "__init__.py").write_text(BLOCKED.format(name=name), encoding="utf-8")
        paths = [str(blind / "hidden")]
        made = {n: v for n, v in made.items() if root not in v or n == "PATH"} | {"PWD": str(blind)}
        made.pop("OLDPWD", None)
    return made | ({"PYTHONPATH": os.pathsep.join(paths)} if paths else {})


def _end_with_parent() -> None:
    """Ask Linux to kill the program when its child process dies."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
