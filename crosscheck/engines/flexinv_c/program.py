"""A program in C around an exported library, run as a process of its own: questions go in over its pipe, answers come back.

A question is its number, that of the closures that act, and q, qd, qdd; an answer is the library's status and so many numbers
(`driver.c.in`).  The process has no Python, and knows nothing of the mechanism but what stands in the library.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from string import Template

import numpy as np
from numpy.typing import NDArray

from flexinv.errors import FlexinvError
from flexinv.export.acting_sets import has_phases
from flexinv.export.c_files import STATUSES
from flexinv.export.export_c import export_c
from flexinv.export.given_forces import list_moved_forces
from flexinv.export.link_library import C_OPTIONS, find_compiler
from flexinv.export.machine_code import NATIVE
from flexinv.export.memory_image import ALIGNMENT
from flexinv.export.names import C_COMPILERS, COMPILER_PACKAGE
from flexinv.kinematics.mesh import build
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]
NO_COMPILER = (
    f"there is no C compiler here to link the exported library with ({', '.join(C_COMPILERS)} with ar, or the wheel "
    f"{COMPILER_PACKAGE}); write apt-get install gcc, or python -m pip install {COMPILER_PACKAGE}"
)
# Kind of library -> question -> call; those of `COUNTS` answer so many numbers as C says, all others one for each rate.
QUESTIONS = {
    "rigid": {
        "torque": "torque(memory, q, qd, qdd, out)",
        "gravity": "gravity(memory, q, out)",
        "friction": "friction(memory, qd, out)",
        "springs": "springs(memory, q, out)",
        "mass_matrix": "mass_matrix(memory, q, out)",
    },
    "loops": {
        "torque": "torque(memory, q, qd, qdd, out)",
        "gravity": "gravity(memory, q, out)",
        "springs": "springs(memory, q, out)",
    },
    "flexible": {
        "last_torque": "last_torque(memory, out)",
        "step": "step(memory, q, qd, qdd, out)",
        "joint_wrench": "joint_wrench(memory, (size_t)qd[0], out)",  # of the joint with that number
    },
}
COUNTS = {"mass_matrix": "SQUARE", "joint_wrench": "6"}


@dataclass(frozen=True)
class LibrarySettings:
    """Settings with which a library is exported.

    start : position at rest in which beams begin, or near which rigid loops close [rad], [m], None for others
    step : of beams, between two calls [s]; initial, spectral_radius : as in `solve`
    """

    start: tuple[float, ...] | None = None
    step: float | None = None
    initial: str = "static"
    spectral_radius: float = 0.8


@dataclass(frozen=True)
class Question:
    """A question by its name, with q [rad], [m], qd and qdd [rad/s], [m/s^2]; what a call does not take is not looked at.

    wrenches : (forces, 6) of the given forces on links now [N], [N m], None for what they are at first
    phase : number of the set of closures that act (`flexinv.export.acting_sets`)
    """

    name: str
    q: Array
    qd: Array
    qdd: Array
    wrenches: Array | None = None
    phase: int = 0


@dataclass(frozen=True)
class Program:
    """A program that is linked: its bytes, so that no file of it is left behind, and the mechanism that it was made of.

    wrenches : (forces, 6) of the given forces on links at first [N], [N m]
    runner : words of the command that runs a program of another processor
    """

    mechanism: Mechanism
    kind: str
    data: bytes
    wrenches: Array
    runner: tuple[str, ...] = ()

    def ask(self, questions: Sequence[Question]) -> list[Array]:
        """Return the answers of one process to questions in their order [N m], [N], [kg m^2], [kg].

        Raises FlexinvError where the library refuses one: which, and the words of its status.
        """
        numbers = {name: k for k, name in enumerate(QUESTIONS[self.kind])}
        given = b"".join(
            np.array([numbers[one.name], one.phase], dtype=np.uint64).tobytes()
            + np.concatenate([one.q, one.qd, one.qdd, self._list_forces(one)]).tobytes()
            for one in questions
        )
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "driver"
            file.write_bytes(self.data)
            file.chmod(0o700)
            done = subprocess.run([*self.runner, file], input=given, capture_output=True, check=False)
        if done.returncode != 0:
            raise FlexinvError(f"the program around the exported library ended with {done.returncode}")
        return self._read_answers(questions, done.stdout)

    def _list_forces(self, question: Question) -> Array:
        return np.ravel(self.wrenches if question.wrenches is None else question.wrenches)

    def _read_answers(self, questions: Sequence[Question], data: bytes) -> list[Array]:
        nv = self.mechanism.nv
        answers = list[Array]()
        offset = 0
        for k, one in enumerate(questions):
            count = {"mass_matrix": nv * nv, "joint_wrench": 6}.get(one.name, nv)
            status = int(np.frombuffer(data, np.int64, 1, offset)[0])
            if status != 0:
                word, said = list(STATUSES.items())[status]
                raise FlexinvError(f"call {k} of the exported library, {one.name}: status {word}, {said}")
            answers.append(np.frombuffer(data, np.float64, count, offset + np.int64().itemsize))
            offset += np.int64().itemsize * (1 + count)
        return answers


def build_program(mechanism: Mechanism, settings: LibrarySettings) -> Program:
    """Return the program around the library [-] that `export_c` makes of a mechanism.

    Raises InputError where the mechanism cannot be exported, FlexinvError where the compiler fails.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "library"
        made = export_c(mechanism, folder, **asdict(settings))
        return make_linked_program(mechanism, folder, made.name)


def make_linked_program(
    mechanism: Mechanism, folder: Path, name: str, target: str = NATIVE, runner: tuple[str, ...] = ()
) -> Program:
    """Return the program around the static library [-] that stands in a folder by its name, for a processor.

    runner : words of the command that runs it, where that is another processor.  Raises FlexinvError.
    """
    kind = "flexible" if not mechanism.is_rigid else "loops" if mechanism.closures else "rigid"
    compiler = find_compiler(target)
    if compiler is None:
        raise FlexinvError(NO_COMPILER)
    source = folder / "driver.c"
    forces = list_moved_forces(build(apply_stated_ratio(mechanism)))
    source.write_text(_write_driver(name, kind, len(forces), has_phases(mechanism)), encoding="utf-8")
    out = folder / "driver"
    library = folder / "lib" / target / f"lib{name}.a"
    words = [*compiler.compile, *C_OPTIONS, f"-I{folder / 'include'}", source, library, "-lm", "-o", out]
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise FlexinvError(f"the driver of the exported library does not compile:\n{done.stderr.strip()}")
    first = np.array([force.wrench[0] for force in forces]).reshape(-1, 6)
    return Program(mechanism, kind, out.read_bytes(), first, runner)


def _write_driver(name: str, kind: str, forces: int, switches: bool) -> str:
    cases = [
        f"    case {k}: {f'*count = {COUNTS[word]}; ' if word in COUNTS else ''}return {name}_{call};"
        for k, (word, call) in enumerate(QUESTIONS[kind].items())
    ]
    template = resources.files("crosscheck.engines.flexinv_c") / "driver.c.in"
    give = (
        f"    for (size_t k = 0; k < {forces}; ++k) {name}_set_force(memory, k, wrenches + 6 * k);\n" if forces else ""
    )
    values = {
        "name": name, "NAME": name.upper(), "alignment": str(ALIGNMENT), "questions": "\n".join(cases), "forces": str(forces),
        "set_forces": give, "set_phase": f"    {name}_set_phase(memory, phase);\n" if switches else "",
    }  # fmt: skip
    return Template(template.read_text(encoding="utf-8")).substitute(values)
