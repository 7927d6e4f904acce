"""Source of an FMU, and its library: the exported C file, the layer of FMI below it, and the objects of the kernels."""

from __future__ import annotations

import platform
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from flexinv.errors import InputError
from flexinv.export.c_files import fill_template, make_constants, render_sources
from flexinv.export.fmu.description import FmuHead
from flexinv.export.fmu.variables import INPUT_ROLE, PARAMETER_ROLE, Interface
from flexinv.export.kernel_objects import make_kernel_object
from flexinv.export.library_plan import LibraryPlan
from flexinv.export.link_library import C_OPTIONS, Compiler, find_compiler, run_commands
from flexinv.export.machine_code import NATIVE, TARGETS, Processor, write_entries
from flexinv.export.memory_image import ALIGNMENT
from flexinv.export.names import COMPILER_PACKAGE, format_numbers, format_string
from flexinv.export.written_files import write_files

NO_FMU_COMPILER = (
    "export_fmu: an FMU holds a library, and no C compiler was found to link one; install gcc or clang, or the wheel "
    f"{COMPILER_PACKAGE} (python -m pip install {COMPILER_PACKAGE}), and call again"
)


def find_fmu_compiler(target: str) -> Compiler:
    """Return the compiler [-] for a target; InputError where there is none, or where the system has other libraries."""
    if target == NATIVE and sys.platform != "linux":
        raise InputError(
            f"export_fmu: FMUs are made for Linux, and this is {sys.platform}; write target='x86-64-v3' with the wheel ziglang "
            "installed, or export the FMU on Linux"
        )
    compiler = find_compiler(target)
    if compiler is None:
        raise InputError(NO_FMU_COMPILER)
    return compiler


def list_binary_folders(fmi: str, target: str) -> str:
    """Return the folder of an FMU for the library of a processor [-]."""
    machine = TARGETS[target][0].partition("-")[0] or platform.machine().lower().replace("amd64", "x86_64")
    return "binaries/linux64" if fmi == "2.0" and machine == "x86_64" else f"binaries/{machine}-linux"


def render_source(plan: LibraryPlan, head: FmuHead, made: Interface) -> tuple[str, str]:
    """Return the header of the library, and the one C file of the FMU [-]."""
    name = head.identifier
    header, source = render_sources(plan, name)
    values = _collect_values(plan, head, made)
    layers = ["fmu", f"fmu_{plan.kind}", f"fmi{head.fmi[0]}"]
    below = "".join(fill_template(f"{layer}.c", values) for layer in layers)
    return header, source + below


def build_library(plan: LibraryPlan, source: tuple[str, str], name: str, target: str) -> bytes:
    """Return the shared library of an FMU [-] for a processor; FlexinvError with the compiler's words where it fails."""
    processor = Processor.build_for(target)
    compiler = find_fmu_compiler(target)
    kernels = make_kernel_object(plan.entries, processor)
    entries = write_entries(plan.entries, make_constants(plan, name), processor, kernels.names)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        files = {
            f"{name}.h": source[0].encode(),
            "fmu.c": source[1].encode(),
            "kernels.o": kernels.code,
            "entries.o": entries,
        }
        write_files(folder, files)
        words = [
            *compiler.compile,
            *C_OPTIONS,
            "-fvisibility=hidden",
            "-I.",
            "-shared",
            "fmu.c",
            "entries.o",
            "kernels.o",
        ]
        run_commands(folder, [[*words, "-lm", "-o", "fmu.so"]])
        return (folder / "fmu.so").read_bytes()


def _collect_values(plan: LibraryPlan, head: FmuHead, made: Interface) -> Mapping[str, str]:
    """Name in the templates of the layers -> text."""
    m = plan.mechanism
    letters = {INPUT_ROLE: "i", PARAMETER_ROLE: "p"}
    starts = [one.start or 0.0 for one in made.variables]
    places: dict[str, list[int]] = {
        "q_at": [],
        "qd_at": [],
        "qdd_at": [],
        "tau_at": [],
        "deflection_at": [],
        "tip_at": [],
    } | made.places
    return {
        "name": head.identifier, "NAME": head.identifier.upper(), "token": format_string(head.token),
        "alignment": str(ALIGNMENT), "fixed_step": repr(head.step or 0.0), "variable_count": str(len(made.variables)),
        "group_count": str(len(made.groups)), "groups": ", ".join(made.groups), "starts": format_numbers(starts),
        "roles": format_string("".join(letters.get(one.role, "o") for one in made.variables)),
        "has_payloads": str(int(any("PAYLOAD" in group for group in made.groups))),
        "has_damping": str(int("damping" in plan.parts)), "has_phases": str(int("phases" in plan.parts)),
        "has_readings": str(int(bool(places["tip_at"]))),
        "held_at": str(made.held), "starts_anywhere": str(int("rest" in plan.parts)),
        "beam_count": str(len(m.beams)), "link_count": str(len(m.links)),
        **{name: _list_places(part, name in ("deflection_at", "tip_at")) for name, part in places.items()},
    }  # fmt: skip


def _list_places(places: list[int], goes_on: bool) -> str:
    """Value references as C lists them, where something ``goes_on`` behind them with a comma."""
    return "".join(f"{one}, " for one in places) if goes_on else ", ".join(map(str, places))
