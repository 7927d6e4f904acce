"""Script of the user: a program with its arguments and the files that it needs, run in a folder of its own each time."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import shutil
import signal
import subprocess
import sys
import threading
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from crosscheck.bisect.surroundings import make_script_environment
from crosscheck.run.isolation import open_scratch_folder
from crosscheck.run.processes import (
    MARK,
    apply_file_size_limit,
    end_marked_processes,
    end_process_group,
    end_process_tree,
    end_with_parent,
)
from flexinv.errors import InputError

CANNOT_RUN = 125  # exit code, as of `git bisect run`
LAUNCHER = Path(__file__).with_name("launcher.py.txt")
FLOOD = 16_000_000  # [bytes] of what a script may print
KEPT = 100_000  # [bytes] of the end of what it printed that are kept
LARGEST_FOLDER = 1e9  # [bytes] of what is copied for each run
TRACEBACK = "Traceback (most recent call last):"
LONGEST_WORDS = 300  # [characters] of what a script said last that an answer repeats
GLANCE = 0.05  # [s] between two looks at a script that runs


@dataclass(frozen=True)
class Script:
    """A program and its arguments; files : what is copied beside it; passed : variables of the caller that it gets.

    judges : whether an exception that is no AssertionError says that it cannot run; timeout : [s]
    """

    words: tuple[str, ...]
    files: tuple[Path, ...] = ()
    passed: tuple[str, ...] = ()
    judges: bool = True
    timeout: float = 600.0

    @property
    def program(self) -> Path | None:
        """The script itself where it is a file of the user's, None where it is a program on the path."""
        path = Path(self.words[0])
        return path if path.is_file() else None

    @property
    def names(self) -> tuple[str, ...]:
        """The words with the script's name in the place of its path."""
        return self.words if self.program is None else (self.program.name, *self.words[1:])

    @property
    def sources(self) -> list[Path]:
        """Files that are copied for each run: the script and the files beside it."""
        return [*([self.program] if self.program else []), *self.files]

    def compute_digest(self) -> str:
        """Return a digest of the script, its arguments and files: other ones are another question."""
        state = hashlib.sha256(repr((self.names, sorted(self.passed), self.judges)).encode())
        for source in self.sources:
            for file in sorted(source.rglob("*")) if source.is_dir() else [source]:
                if file.is_file():
                    state.update(file.name.encode() + file.read_bytes())
        return state.hexdigest()


@dataclass(frozen=True)
class ScriptEnd:
    """End of a script: exit code (negative: a signal), what it printed, and the times that it took [s].

    trouble : why it was ended before, "" where it ended by itself
    """

    code: int
    out: str
    errors: str
    wall: float
    processor: float
    trouble: str = ""

    @property
    def reason(self) -> str:
        """Reason why it could not run, "" where it has judged."""
        if self.trouble:
            return self.trouble
        if self.code < 0:
            return f"ended by signal {-self.code} ({_format_signal(-self.code)})"
        if self.code == CANNOT_RUN:
            return find_last_words(self.errors) or f"exit code {CANNOT_RUN}"
        return ""


def find_last_words(printed: str) -> str:
    """Return the last words of a script in one line: name and message of an exception of Python, else the last line."""
    _, frames, after = printed.rpartition(TRACEBACK)
    lines = [line for line in (after if frames else printed).splitlines() if line.strip()]
    if not frames:
        return lines[-1].strip()[:LONGEST_WORDS] if lines else ""
    message = list(itertools.dropwhile(lambda line: line.startswith(" "), lines))
    return " ".join(" ".join(message).split())[:LONGEST_WORDS]


def check_script(script: Script) -> None:
    """Raise InputError for a script or a file that is not there, or more than may be copied for each run."""
    first = script.words[0]
    if script.program is None and (os.sep in first or first.endswith(".py")):
        raise InputError(f"there is no script {first}: write its path, its arguments behind it")
    for file in script.files:
        if not file.exists():
            raise InputError(f"--with {file}: there is no such file or folder")
    size = sum(_compute_size(source) for source in script.sources)
    if size > LARGEST_FOLDER:
        raise InputError(
            f"script and files take {size / 1e9:.1f} GB, expected at most {LARGEST_FOLDER / 1e9:g} GB: they are copied for each "
            "run; write --with for what is needed"
        )


def _compute_size(source: Path) -> int:
    """Return the size of a file or of a folder with all that is in it [bytes]."""
    files = source.rglob("*") if source.is_dir() else [source]
    return sum(file.stat().st_size for file in files if file.is_file())


@contextlib.contextmanager
def run_script(
    script: Script, python: str, as_python: bool = False, stop: threading.Event | None = None
) -> Iterator[tuple[ScriptEnd, Path]]:
    """Run a script in a fresh copy of its files; give its end and the folder, which is gone afterwards.

    python : of the environment; programs beside it come first on the path; as_python : whatever the name of the script ends in
    stop : ends it where it is set meanwhile, by another thread
    """
    with open_scratch_folder() as place:
        work = place / "work"
        work.mkdir()
        copy_files(script, work)
        launcher = place / "launcher.py"
        shutil.copyfile(LAUNCHER, launcher)
        command = _make_command(script, python, launcher, as_python)
        begun = clock.perf_counter()
        code, trouble, processor = _run_command(script, command, python, place, stop)
        wall = clock.perf_counter() - begun
        out = _read_end(place / "out.txt")
        errors = _read_end(place / "errors.txt")
        yield ScriptEnd(code, out, errors, wall, processor, trouble), work


def copy_files(script: Script, folder: Path) -> None:
    """Copy a script and the files beside it into a folder."""
    for source in script.sources:
        if source.is_dir():
            shutil.copytree(source, folder / source.resolve().name, dirs_exist_ok=True)
        else:
            shutil.copy2(source, folder / source.name)


def _make_command(script: Script, python: str, launcher: Path, as_python: bool) -> list[str]:
    """Return the command: by the environment's Python for a script of Python, else as it stands."""
    first, *arguments = script.words
    program = script.program
    if program is None:
        return [first, *arguments]
    if program.suffix != ".py" and not as_python:
        return [f".{os.sep}{program.name}", *arguments]
    return [python, *([str(launcher)] if script.judges else []), program.name, *arguments]


def _run_command(
    script: Script, command: Sequence[str], python: str, place: Path, stop: threading.Event | None
) -> tuple[int, str, float]:
    """Return exit code, trouble and processor time [s] of a command in a process group of its own."""
    folder = Path(python).parent
    surroundings = make_script_environment(script.passed)
    path = os.pathsep.join([str(folder), surroundings.get("PATH", "")])
    mark = {MARK: str(place), "PATH": path, "VIRTUAL_ENV": str(folder.parent)}
    with (place / "out.txt").open("wb") as out, (place / "errors.txt").open("wb") as errors:
        try:
            process = subprocess.Popen(
                command,
                cwd=place / "work",
                env=surroundings | mark,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=errors,
                start_new_session=True,
                preexec_fn=_apply_bounds if sys.platform == "linux" else None,
            )
        except OSError as error:
            raise InputError(
                f"{command[0]} cannot be run: {error.strerror or error}; write the path of a program"
            ) from error
        try:
            trouble = _wait_for_end(process, script.timeout, [place / "out.txt", place / "errors.txt"], stop)
        finally:
            if process.returncode is None:
                end_process_tree(process.pid)
            end_process_group(process.pid)
            processor = _collect_process(process)
            end_marked_processes(str(place))
    return process.returncode or 0, trouble, processor


def _apply_bounds() -> None:
    """Bound the files of a script, and let it end with this process."""
    apply_file_size_limit()
    end_with_parent()


def _wait_for_end(
    process: subprocess.Popen[bytes], timeout: float, files: Sequence[Path], stop: threading.Event | None
) -> str:
    """Wait until a script has ended; return why it has to be ended before, "" where it has not.  timeout : [s]"""
    until = clock.monotonic() + timeout
    while _is_running(process):
        if stop is not None and stop.is_set():
            return "it was stopped: the run was interrupted"
        if clock.monotonic() > until:
            return f"it hangs: stopped after the time limit of {timeout:g} s"
        if sum(file.stat().st_size for file in files) > FLOOD:
            return f"it floods: stopped after it had printed {FLOOD / 1e6:.0f} MB"
        clock.sleep(GLANCE)
    return ""


def _is_running(process: subprocess.Popen[bytes]) -> bool:
    """Return True while a process runs; it is not collected, so that its times can be asked for."""
    if not hasattr(os, "waitid"):
        return process.poll() is None
    return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None


def _collect_process(process: subprocess.Popen[bytes]) -> float:
    """Collect a process that has ended, and return its processor time [s]; 0 where the system does not tell it."""
    if process.returncode is not None or not hasattr(os, "wait4"):
        process.wait()
        return 0.0
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_utime + usage.ru_stime


def _read_end(file: Path) -> str:
    """Return the end of what was printed, whatever bytes are in it."""
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - KEPT))
        return stream.read().decode("utf-8", errors="replace")


def _format_signal(number: int) -> str:
    """Return the name of a signal."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return "unknown"
