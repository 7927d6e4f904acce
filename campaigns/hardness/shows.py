"""The shows: each makes a program of its own around exported libraries, runs it, and prints a line of what came out."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from string import Template

from campaigns.hardness.first_torques import list_first_rows
from campaigns.hardness.fuzz_calls import write_calls
from campaigns.hardness.gallery import list_gallery_rows
from campaigns.hardness.instructions import list_instruction_rows
from campaigns.hardness.libraries import HERE, MACHINES, RIGID_ARM, RIGID_LOOPS, Library, open_library, run_command
from campaigns.hardness.processors import list_processor_rows
from campaigns.hardness.speed import list_sample_rows, list_step_rows
from flexinv.export.c_files import STATUSES
from flexinv.export.machine_code import NATIVE

STEPS = 10_000_000
CALLS = 1_000_000
CHECKED_STEPS = 300  # under valgrind
CHECKED_CALLS = 3_000
VALGRIND_TARGET = "x86-64-v3"  # valgrind 3.19 knows no AVX-512
SANITIZERS = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
CHECKED = (RIGID_ARM, RIGID_LOOPS, *MACHINES)  # a tree, loops whose closures come and go, beams, a humanoid


def show_memory(scale: float) -> Iterator[str]:
    """Yield lines about 1e7 steps of each kind: calls of malloc, under seccomp's strict mode, between guarded pages [-]."""
    for machine in CHECKED:
        with open_library(machine) as library:
            program = library.compile("steps.c", words=("-DCOUNT_MALLOC",))
            yield f"{machine.title}: {run_command([program, library.motion, int(scale * STEPS), 1]).strip()}"


def show_threads(scale: float) -> Iterator[str]:
    """Yield lines about two threads with a block each beside one after the other [-], with the thread sanitizer, too."""
    for machine in CHECKED:
        with open_library(machine) as library:
            for words in ((), ("-g", "-fsanitize=thread")):
                program = library.compile("steps.c", words=words)
                said = run_command([program, library.motion, int(scale * STEPS / 100), 2]).strip()
                yield f"{machine.title}{' (thread sanitizer)' if words else ''}: {said}"


def show_fuzz(scale: float) -> Iterator[str]:
    """Yield lines about 1e6 calls by lot of all functions, the C layer under the address and behaviour sanitizers [-]."""
    for machine in CHECKED:
        with open_library(machine) as library:
            program = compile_fuzz(library, NATIVE)
            calls = int(scale * CALLS)
            answers = [line.split() for line in run_command([program, library.motion, calls, 1]).splitlines()]
            functions = {one[0] for one in answers}
            refused = sum(int(one[2]) for one in answers if one[1] != "0")
            found = sorted({list(STATUSES)[int(one[1])] for one in answers})
            yield f"{machine.title}: {calls} calls of {len(functions)} functions, {refused} refused; statuses {', '.join(found)}"


def show_valgrind(scale: float) -> Iterator[str]:
    """Yield lines about kernels and C layer under memcheck (steps, calls by lot) and helgrind (two threads) [-]."""
    steps, calls = int(max(scale, 0.1) * CHECKED_STEPS), int(max(scale, 0.1) * CHECKED_CALLS)
    for machine in CHECKED:
        with open_library(machine, (VALGRIND_TARGET,)) as library:
            fuzz = compile_fuzz(library, VALGRIND_TARGET, sanitized=False)
            program = library.compile("steps.c", VALGRIND_TARGET, ("-g",))
            memcheck = ["valgrind", "-q", "--tool=memcheck", "--error-exitcode=9"]
            run_command([*memcheck, "--leak-check=full", fuzz, library.motion, calls, 1])
            run_command([*memcheck, program, library.motion, steps, 2])
            run_command(["valgrind", "-q", "--tool=helgrind", "--error-exitcode=9", program, library.motion, steps, 2])
            yield f"{machine.title}: memcheck ({calls} calls, 4 x {steps} steps) and helgrind (2 threads x {steps} steps) clean"


def show_alone(_: float) -> Iterator[str]:
    """Yield lines about the example of each folder in a root of its own, with libc, libm and the loader alone [-]."""
    for machine in CHECKED:
        with open_library(machine) as library, tempfile.TemporaryDirectory() as place:
            root = Path(place)
            program = library.compile("example.c")
            needed = re.findall(r"(/\S+) \(0x", run_command(["ldd", program]))
            for file in needed:
                (root / file[1:]).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(file, root / file[1:])
            shutil.copy(program, root / "example")
            run_command(["chroot", root, "/example"])
            yield f"{machine.title}: the example runs beside {', '.join(sorted(Path(file).name for file in needed))}"


def compile_fuzz(library: Library, target: str, sanitized: bool = True) -> Path:
    """Return the fuzz program [-], with a library's own checks as source under the sanitizers, or as they stand in it."""
    text = Template((HERE / "fuzz.c").read_text(encoding="utf-8")).safe_substitute(statuses=len(STATUSES))
    (library.folder / "fuzz.c").write_text(text, encoding="utf-8")
    (library.folder / "calls.h").write_text(write_calls(library), encoding="utf-8")
    if not sanitized:
        return library.compile("fuzz.c", target, ("-g",))
    checks = str(library.folder / "src" / f"{library.name}.c")
    return library.compile("fuzz.c", target, SANITIZERS, (checks,))


SHOWS: dict[str, Callable[[float], Iterator[str]]] = {
    "memory": show_memory, "threads": show_threads, "fuzz": show_fuzz, "valgrind": show_valgrind,
    "alone": show_alone,
    "instructions": list_instruction_rows, "processors": list_processor_rows, "gallery": list_gallery_rows,
    "samples": list_sample_rows, "steps": list_step_rows, "first": list_first_rows,
}  # fmt: skip
