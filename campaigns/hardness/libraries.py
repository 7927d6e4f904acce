"""Libraries that the shows are made with, their motions, and the C programs that are linked with them."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import flexinv
from flexinv.errors import FlexinvError
from flexinv.export.acting_sets import list_acting_sets
from flexinv.export.c_files import STATUSES
from flexinv.export.link_library import find_compiler
from flexinv.export.machine_code import NATIVE
from flexinv.export.memory_image import ALIGNMENT
from flexinv.export.rigid.closed_samples import list_closed_samples
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import integrate_configuration
from flexinv.model.mechanism import Mechanism
from flexinv.rnea.loop_plan import sample_configurations
from flexinv.typing import Array

HERE = Path(__file__).parent
MODELS = HERE.parents[1] / "models"
C_WORDS = ("-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror")


@dataclass(frozen=True)
class Machine:
    """A mechanism of models/ as it is exported.

    step : between two calls, of mechanisms with beams [s]; way : of every drive in its motion [rad], [m]
    payload : link that carries something that changes, with so much mass [kg]; jumps : whether accelerations jump
    """

    title: str
    model: str
    step: float | None = None
    way: float = 0.2
    payload: str = ""
    mass: float = 0.1
    jumps: bool = True


MACHINES = (
    Machine("one link", "flex_one_link", 1e-3, payload="link", mass=0.01),
    Machine("two links", "flex_two_link", 1e-3, payload="link2", mass=0.002),
    Machine("spatial arm", "spatial_arm", 1e-3, payload="forearm"),
    Machine("flexible four-bar", "four_bar_flexible", 1e-3, 0.1, "rocker"),
    Machine("Talos", "talos", payload="arm_left_7_link", mass=1.0),
)
RIGID_ARM = Machine("UR5", "ur5", payload="wrist_3_link", mass=1.0)
RIGID_LOOPS = Machine("two arms that grasp", "two_arms", payload="bar", mass=1.0)
BEND = 400  # rows of the motion of a mechanism that bends
SAMPLES = 100  # of a rigid one


@dataclass(frozen=True)
class Library:
    """A library in a folder, and the rows of q, qd, qdd [rad or m, s] that its programs are given.

    start : (nq,) where one that bends begins [rad], [m]
    """

    machine: Machine
    mechanism: Mechanism
    folder: Path
    name: str
    rows: Array
    start: Array

    @property
    def motion(self) -> Path:
        """The file of the rows."""
        return self.folder / "motion.bin"

    def compile(
        self, program: str, target: str = NATIVE, words: Sequence[str] = (), sources: Sequence[str] = ()
    ) -> Path:
        """Return a program [-] of this folder that is linked with the library for a target; FlexinvError where it fails.

        words : more options; sources : C files in the place of the static library's own checks, which they hold as source
        """
        out = self.folder / f"{Path(program).stem}-{target}{'-checked' if sources else ''}"
        place = self.folder / "lib" / target
        linked = [place / f"lib{self.name}.a"]
        if sources:
            linked = [place / f"{self.name}_entries.o", place / f"{self.name}_kernels.o"]
        compiler = find_compiler(target)
        if compiler is None:
            raise FlexinvError(f"there is no C compiler for {target}")
        source = self.folder / program if (self.folder / program).is_file() else HERE / program
        folders = [f"-I{self.folder / 'include'}", f"-I{self.folder}"]
        run_command([
            *compiler.compile, *C_WORDS, *folders, *words, source, *sources, *linked, "-lm", "-lpthread", "-o", out,
        ])  # fmt: skip
        return out


def open_library(machine: Machine, targets: Sequence[str] = (NATIVE,)) -> AbstractContextManager[Library]:
    """Give the library of a machine [-] in a folder that goes afterwards, with its motion and the header `arm.h`."""
    return open_library_of(flexinv.load_mechanism(MODELS / machine.model), machine, targets)


@contextmanager
def open_library_of(mechanism: Mechanism, machine: Machine, targets: Sequence[str] = (NATIVE,)) -> Iterator[Library]:
    """Give the library of a mechanism [-], which is treated as a machine's: `open_library`."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "library"
        payloads = (machine.payload,) if machine.payload and machine.step else ()
        start = _find_start(mechanism, machine)
        made = flexinv.export_c(mechanism, folder, targets, step=machine.step, start=start, payloads=payloads)
        rows = _list_rows(mechanism, machine, start)
        library = Library(machine, mechanism, folder, made.name, rows, mechanism.neutral if start is None else start)
        library.motion.write_bytes(np.ascontiguousarray(rows).tobytes())
        (folder / "arm.h").write_text(_write_words(library), encoding="utf-8")
        yield library


def run_command(words: Sequence[object], timeout: float = 3600.0) -> str:
    """Return what a command prints; FlexinvError with its words where it ends with another code than 0 [-]."""
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False, timeout=timeout)
    if done.returncode != 0:
        said = f"{done.stdout[-2000:]}\n{done.stderr[-4000:]}".strip()
        raise FlexinvError(f"{' '.join(map(str, words))} ended with {done.returncode}:\n{said}")
    return done.stdout


def find_place(library: Library, pattern: str) -> int | None:
    """Return an offset in the block [bytes] that stands in the library's source, None where it does not."""
    source = (library.folder / "src" / f"{library.name}.c").read_text(encoding="utf-8")
    found = re.search(pattern, source)
    return int(found[1]) if found else None


def _find_start(mechanism: Mechanism, machine: Machine) -> Array | None:
    """Where a mechanism that bends begins: of closed loops where its first case does."""
    if machine.step is None or not mechanism.closures:
        return None
    case = next(iter(flexinv.load_cases(MODELS / machine.model, mechanism).values()))
    start: Array = flexinv.solve(mechanism, case.motion, case.step, end=case.step, start=case.start).q[0]
    return start


def _list_rows(mechanism: Mechanism, machine: Machine, start: Array | None) -> Array:
    """Rows of q, qd, qdd: samples of a rigid mechanism, closed ones of loops; of one that bends a way there and back."""
    m = mechanism
    if machine.step is None and m.closures:
        closed = list_closed_samples(build(list_acting_sets(m)[0].mechanism), m.neutral)
        rows = [np.concatenate(row) for row in closed]
        return np.array([rows[k % len(rows)] for k in range(SAMPLES)])
    if machine.step is None:
        qd, qdd = np.random.default_rng(1).normal(size=(2, SAMPLES, m.nv))
        return np.hstack([sample_configurations(m, SAMPLES), qd, qdd])
    begins = m.neutral if start is None else start
    way = machine.way * m.actuated
    path = (list_bangs if machine.jumps else list_waves)(BEND, machine.step)
    q = [integrate_configuration(m, begins, s * way) for s, _, _ in path]
    return np.array([np.concatenate([at, v * way, a * way]) for at, (_, v, a) in zip(q, path, strict=True)])


def list_bangs(count: int, step: float) -> list[tuple[float, float, float]]:
    """Return s, s', s'' at the ends of steps of a path from 0 to 1 and back, whose acceleration jumps between two values [-, s].

    The last step ends where the first began, at rest, so that the path may be gone again.
    """
    period = count * step
    acceleration = 16.0 / period**2
    t = step * np.arange(1, count + 1)
    quarter = period / 4
    out = list[tuple[float, float, float]]()
    for now in t:
        if now <= quarter:
            out.append((0.5 * acceleration * now**2, acceleration * now, acceleration))
        elif now <= 3 * quarter:
            left = now - 2 * quarter
            out.append((1.0 - 0.5 * acceleration * left**2, -acceleration * left, -acceleration))
        else:
            left = period - now
            out.append((0.5 * acceleration * left**2, -acceleration * left, acceleration))
    return out


def list_waves(count: int, step: float) -> list[tuple[float, float, float]]:
    """Return s, s', s'' at the ends of the steps of a smooth path from 0 to 1 and back, at rest at its ends [-, s].

    s = (1 - cos u) / 2 with u = 2 pi (10 x^3 - 15 x^4 + 6 x^5) and x from 0 to 1.
    """
    x = np.arange(1, count + 1) / count
    period = count * step
    u = 2 * np.pi * x**3 * (10 - 15 * x + 6 * x**2)
    du = 2 * np.pi * 30 * x**2 * (1 - x) ** 2 / period
    ddu = 2 * np.pi * 60 * x * (1 - x) * (1 - 2 * x) / period**2
    parts = 0.5 * (1 - np.cos(u)), 0.5 * np.sin(u) * du, 0.5 * (np.cos(u) * du**2 + np.sin(u) * ddu)
    return [(float(s), float(v), float(a)) for s, v, a in zip(*parts, strict=True)]


def _write_words(library: Library) -> str:
    """The header that gives the programs short names for those of a library."""
    name, upper = library.name, library.name.upper()
    m = library.mechanism
    bends = library.machine.step is not None
    numbers = ["NQ", "NV", "SIZE", "LAYOUT", *STATUSES]
    lines = [f'#include "{name}.h"', f"#define ARM(word) {name}_##word", f"#define ARM_ALIGNMENT {ALIGNMENT}"]
    lines += [f"#define ARM_{word} {upper}_{word}" for word in numbers]
    lines += [f"#define ARM_CALL {name}_{'step' if bends else 'torque'}", f"#define ARM_RESTORES {int(bends)}"]
    # A rigid library has no memory; a march is converged anew after a refusal, to its tolerance.
    lines += [f"#define ARM_TOLERANCE {1e-6 if bends else 0.0}"]
    if library.machine.payload:
        number = 0 if bends else [link.name for link in m.links].index(library.machine.payload)
        lines += [f"#define ARM_PAYLOAD {number}", f"#define ARM_MASS {library.machine.mass}"]
    if bends and (at := find_place(library, r"name_march\(\*words_at\(memory, (\d+)\)\);\n    if \(status")):
        lines.append(f"#define ARM_ITERATIONS {at + 16}")  # behind status and instant
    return "\n".join(lines) + "\n"
