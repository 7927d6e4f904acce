"""First torques of fresh processes: by `solve`, by `Controller`, and by an exported library that Python calls through ctypes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from campaigns.hardness.libraries import MACHINES, MODELS, Library, open_library
from flexinv.export.c_files import LAYOUT

ROOT = Path(__file__).resolve().parents[2]
END = """
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
used = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
print(json.dumps([sum(u.ru_utime + u.ru_stime for u in used), perf_counter() - start]))
"""
BEGIN = """
import json, sys
from time import perf_counter
start = perf_counter()
"""
IN_PYTHON = """
import flexinv
import numpy as np
robot = flexinv.load_mechanism(sys.argv[1])
case = next(iter(flexinv.load_cases(sys.argv[1], robot).values()))
"""
SOLVE = "flexinv.solve(robot, case.motion, step=case.step, start=case.start, initial=case.initial)\n"
CONTROLLER = """
q = np.array(json.loads(sys.argv[2]))
controller = flexinv.Controller.of(robot, step=1e-3)
still = np.zeros(robot.nv)
controller.start(q, still, still, initial=case.initial)
controller.step(q, still, still)
"""
LIBRARY = """
import ctypes
library, name, layout = sys.argv[1], sys.argv[2], int(sys.argv[3])
code = ctypes.CDLL(library)
size = getattr(code, name + "_size")
size.restype = ctypes.c_size_t
room = ctypes.create_string_buffer(size() + 64)
block = ctypes.c_void_p(ctypes.addressof(room) + -ctypes.addressof(room) % 64)
q = (ctypes.c_double * 64)()
still = (ctypes.c_double * 64)()
tau = (ctypes.c_double * 64)()
assert getattr(code, name + "_start")(block, ctypes.c_size_t(size()), layout) == 0
assert getattr(code, name + "_start_position")(q) == 0
assert getattr(code, name + "_step")(block, q, still, still, tau) == 0
"""


def list_first_rows(scale: float) -> Iterator[str]:
    """Yield lines about first torques [s]: processor time of cold processes, time by the clock of warm ones."""
    del scale
    for machine in (MACHINES[0], MACHINES[2], MACHINES[3]):
        with open_library(machine) as library:
            model = str(MODELS / machine.model)
            q = json.dumps(library.start.tolist())
            cold_solve, warm_solve = _run_twice(IN_PYTHON + SOLVE, [model])
            cold_steps, warm_steps = _run_twice(IN_PYTHON + CONTROLLER, [model, q])
            _, loaded = _run_twice(LIBRARY, _list_words(library))
            yield (
                f"{machine.title}: cold solve {cold_solve[0]:.1f} s of processor time, cold Controller {cold_steps[0]:.1f} s "
                f"({cold_steps[0] / cold_solve[0]:.2f}); by the clock, warm solve {warm_solve[1]:.2f} s, warm Controller "
                f"{warm_steps[1]:.2f} s, library by ctypes {loaded[1]:.3f} s"
            )


def _list_words(library: Library) -> list[str]:
    shared = library.folder / "lib" / "native" / f"lib{library.name}.so"
    return [str(shared), library.name, str(LAYOUT)]


def _run_twice(program: str, words: list[str]) -> list[list[float]]:
    """Processor time and time by the clock [s] of a process that finds nothing, and of the best of three after it."""
    command = [sys.executable, "-c", BEGIN + program + END, *words]
    with TemporaryDirectory() as kept:
        asked = {**os.environ, "NUMBA_CACHE_DIR": kept}
        runs = [
            json.loads(subprocess.run(command, env=asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
            for _ in range(4)
        ]
    return [runs[0], min(runs[1:], key=lambda one: one[1])]
