"""Libraries for other processors, run where they can be: aarch64 under qemu, levels of x86-64 here; and how large they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from campaigns.hardness.libraries import MACHINES, RIGID_ARM, Library, open_library, run_command
from flexinv.export.machine_code import NATIVE, TARGETS
from flexinv.typing import Array

RIGID = 1e-12  # of the largest effort: sums fuse in another order, and sines of another libm differ in the last digit
MARCHED = 1e-9  # beams are rounded alike by all; of meshed links products and sums fuse, and what that makes marches on
LARGEST = 1_000_000  # bytes of a stripped library
STRIPS = {"aarch64": "aarch64-linux-gnu-strip"}
RUNS = {"aarch64": ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu")}


def list_processor_rows(scale: float) -> Iterator[str]:
    """Yield lines about the efforts of other processors beside this one's [-], and sizes of stripped libraries [bytes]."""
    del scale
    for machine in (RIGID_ARM, *MACHINES):
        with open_library(replace(machine, jumps=False), tuple(TARGETS)) as library:
            yield from _compare_processors(library)


def _compare_processors(library: Library) -> Iterator[str]:
    answers = {target: run_answers(library, target) for target in TARGETS}
    expected = answers[NATIVE]
    allowed = RIGID if library.machine.step is None else MARCHED
    apart = {
        t: float(np.abs(one - expected).max() / np.abs(expected).max()) for t, one in answers.items() if t != NATIVE
    }
    sizes = {target: measure_stripped_size(library, target) for target in TARGETS}
    wrong = [target for target, one in apart.items() if not one <= allowed]
    wrong += [target for target, size in sizes.items() if size > LARGEST]
    said = ", ".join(f"{target} {one:.1e}" for target, one in apart.items())
    sized = ", ".join(f"{target} {size // 1000} kB" for target, size in sizes.items())
    yield f"{library.machine.title}: {said}; {sized}{'; WRONG: ' + ', '.join(wrong) if wrong else ''}"


def run_answers(library: Library, target: str) -> Array:
    """Return the efforts (rows, nv) [N m], [N] of a library's motion on a processor."""
    program = library.compile("answers.c", target)
    out = library.folder / f"answers-{target}.bin"
    run_command([*RUNS.get(target, ()), program, library.motion, out])
    run_command([*RUNS.get(target, ()), library.folder / "lib" / target / "selftest"])
    return np.fromfile(out).reshape(len(library.rows), -1)


def measure_stripped_size(library: Library, target: str) -> int:
    """Return the size of a shared library without its names [bytes]."""
    file = library.folder / "lib" / target / f"lib{library.name}.so"
    out = file.with_suffix(".stripped")
    run_command([STRIPS.get(target, "strip"), file, "-o", out])
    return out.stat().st_size
