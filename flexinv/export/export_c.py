"""export_c: inverse dynamics of a mechanism as a C library, from the kernels that Python uses."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.export.c_files import make_constants, render_files
from flexinv.export.given_forces import replace_changing_forces
from flexinv.export.kernel_objects import make_kernel_object
from flexinv.export.library_plan import LibraryPlan
from flexinv.export.link_library import find_compiler, list_link_commands, list_linked_files, run_commands
from flexinv.export.machine_code import NATIVE, Processor, check_target, write_entries
from flexinv.export.plan_library import StartRequest, make_library_name, plan_inverse_library
from flexinv.export.refusals import check_exportable
from flexinv.export.written_files import LICENCE_FILE, read_licence, remove_on_failure, write_files
from flexinv.model.mechanism import Mechanism
from flexinv.validation import check_flag, check_kind, check_names, check_path


@dataclass(frozen=True)
class ExportedLibrary:
    """A library that `export_c` has written.

    folder, name : of the library; files : paths in the folder
    to_link : commands for the targets for which no compiler was found here, to be run in the folder
    """

    folder: Path
    name: str
    files: tuple[str, ...]
    to_link: tuple[str, ...]


def export_c(
    mechanism: Mechanism, out: str | Path, targets: Sequence[str] = (NATIVE,), overwrite: bool = False,
    step: float | None = None, start: ArrayLike | None = None, initial: str = "static", spectral_radius: float = 0.8,
    payloads: Sequence[str] = (),
) -> ExportedLibrary:  # fmt: skip
    """Write the inverse dynamics of a mechanism as a C library into a folder; return what was written [-].

    out : the folder, which is made; targets : processors, of `machine_code.TARGETS`
    overwrite : the folder may have files in it already
    step : of a mechanism with beams, the time between two calls [s]; spectral_radius : as in `Controller` [-]
    start : (nq,) the position [rad], [m] in which it begins at rest, by default the neutral one; of closed loops of rigid links
        one near which they close, for the self-test
    initial : in equilibrium ("static") or undeformed ("consistent")
    payloads : links of a mechanism with beams that carry something that changes; of a rigid one all may
    Raises InputError before anything is written: for what cannot be exported, names that are one in C, an unknown target.
    """
    check_kind("mechanism", mechanism, Mechanism)
    chosen = [check_target(target) for target in check_names("targets", targets, "processors")]
    if not chosen:
        raise InputError("export_c: targets is empty; write targets=('native',)")
    mechanism = replace_changing_forces(mechanism)
    check_exportable(mechanism)
    folder = check_out_folder(out, overwrite)
    prefix = make_library_name(mechanism)
    carried = tuple(check_names("payloads", payloads, "links"))
    plan = plan_inverse_library(mechanism, prefix, StartRequest(step, start, initial, spectral_radius, carried))
    return _write_library(plan, prefix, folder, chosen)


def check_out_folder(out: str | Path, overwrite: bool) -> Path:
    """Return the folder [-] that may be written into.  Raises InputError for one with files in it, unless told otherwise."""
    folder = Path(check_path("out", out, "a folder"))
    check_flag("overwrite", overwrite)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; write the name of a folder")
    if folder.is_dir() and any(folder.iterdir()) and not overwrite:
        raise InputError(f"{folder} has files in it already: write another folder, or overwrite=True (--overwrite)")
    return folder


def _write_library(plan: LibraryPlan, prefix: str, folder: Path, targets: Sequence[str]) -> ExportedLibrary:
    """Write all files, first those that may still fail to be made."""
    constants = make_constants(plan, prefix)
    texts = render_files(plan, prefix, targets) | {LICENCE_FILE: read_licence()}
    objects = dict[str, bytes]()
    for target in targets:
        processor = Processor.build_for(target)
        kernels = make_kernel_object(plan.entries, processor)
        objects[f"lib/{target}/{prefix}_kernels.o"] = kernels.code
        objects[f"lib/{target}/{prefix}_entries.o"] = write_entries(plan.entries, constants, processor, kernels.names)
    contents = {path: text.encode() for path, text in texts.items()} | objects
    linked = [path for target in targets for path in list_linked_files(prefix, target)]
    with remove_on_failure(folder, [*contents, *linked]):
        write_files(folder, contents)
        left = _make_libraries(folder, prefix, targets)
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    return ExportedLibrary(folder, prefix, tuple(files), tuple(left))


def _make_libraries(folder: Path, prefix: str, targets: Sequence[str]) -> list[str]:
    """Make the libraries of all targets; return the commands of those for which there is no compiler."""
    left = list[str]()
    for target in targets:
        compiler = find_compiler(target)
        commands = list_link_commands(prefix, target, compiler)
        if compiler is None:
            left += map(shlex.join, commands)
        else:
            run_commands(folder, commands)
    return left
