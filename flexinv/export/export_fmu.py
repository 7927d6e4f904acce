"""export_fmu: dynamics of a mechanism as a Functional Mock-up Unit, from the kernels that Python uses."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path

from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.export.flexible.flexible_plan import MarchSettings
from flexinv.export.fmu.compile_fmu import (
    build_library,
    find_fmu_compiler,
    list_binary_folders,
    render_source,
)
from flexinv.export.fmu.description import FMI_VERSIONS, FmuHead, render_description, render_fmu_page
from flexinv.export.fmu.variables import (
    Interface,
    check_variable_names,
    list_forward_variables,
    list_inverse_variables,
)
from flexinv.export.forward.forward_plan import plan_forward_library
from flexinv.export.given_forces import replace_changing_forces
from flexinv.export.library_plan import LibraryPlan
from flexinv.export.machine_code import NATIVE, check_target
from flexinv.export.plan_library import (
    StartRequest,
    check_march_step,
    check_start_position,
    make_library_name,
    plan_inverse_library,
)
from flexinv.export.refusals import check_exportable, check_movable
from flexinv.export.written_files import read_licence, write_files
from flexinv.model.mechanism import Mechanism
from flexinv.validation import check_choice, check_flag, check_kind, check_names, check_path

KINDS_OF_FMU = {"inverse": "motion in, efforts out", "forward": "efforts in, motion out"}
ARCHIVE_DATE = (1980, 1, 1, 0, 0, 0)  # of every file in the archive: the same mechanism gives the same bytes
SAID_OF_KIND = {
    "rigid": "Inverse dynamics: motion in, effort of each drive out. The outputs of a communication step belong to the motion "
    "that was set before it: give the motion at the END of the step. All steps are of one length.",
    "flexible": "Inverse dynamics of a mechanism that bends: motion in, effort of each drive out. An input is the motion at the "
    "END of the communication step, and so are the outputs. It begins at rest.",
    "forward": "Forward dynamics: effort of each drive in, motion out. An input is the effort at the END of the communication "
    "step, linear in between, or with torque.held = 1 from its beginning on. It begins at rest.",
}


def export_fmu(
    mechanism: Mechanism, out: str | Path, fmi: str = "3.0", kind: str = "inverse", step: float | None = None,
    start: ArrayLike | None = None, initial: str = "static", spectral_radius: float = 0.8, payloads: Sequence[str] = (),
    target: str = NATIVE, overwrite: bool = False,
) -> Path:  # fmt: skip
    """Write the dynamics of a mechanism as a Functional Mock-up Unit for co-simulation; return the file [-].

    out : the file, NAME.fmu; fmi : version of the interface, "3.0" or "2.0"
    kind : "inverse", motion in, efforts out; "forward", the other way round, as `simulate`
    step : communication step [s], of a rigid inverse FMU by default the first that is made; others are refused
    spectral_radius : as in `Controller` [-]
    start : (nq,) the position [rad], [m] in which it begins at rest unless told another, by default the neutral one
    initial : in equilibrium ("static") or undeformed ("consistent")
    payloads : links that carry something that changes; target : a processor, of `machine_code.TARGETS`
    overwrite : the file may be there already
    Raises InputError before anything is written: as `export_c`, and for two variables of one name, or no C compiler.
    """
    check_kind("mechanism", mechanism, Mechanism)
    fmi = check_choice("fmi", fmi, FMI_VERSIONS)
    kind = check_choice("kind", kind, KINDS_OF_FMU)
    target = check_target(target)
    find_fmu_compiler(target)
    file = _check_file(Path(check_path("out", out, "a file")), check_flag("overwrite", overwrite))
    mechanism = replace_changing_forces(mechanism)
    if kind == "inverse":
        check_exportable(mechanism)
    else:
        check_movable(mechanism)
    prefix = make_library_name(mechanism)
    carried = tuple(check_names("payloads", payloads, "links"))
    marches = kind == "forward" or not mechanism.is_rigid  # a rigid library knows every link, and no time
    request = StartRequest(step if marches else None, start, initial, spectral_radius, carried if marches else ())
    plan, made = _plan_fmu(mechanism, prefix, request, kind, carried)
    check_variable_names(made)
    fixed = plan.step if marches or step is None else check_march_step(mechanism, step)
    token = _make_token(plan, made, kind, fixed)
    head = FmuHead(fmi, mechanism.name, prefix, token, SAID_OF_KIND[plan.kind], fixed)
    _write_archive(file, _collect_files(plan, head, made, target))
    return file


def _plan_fmu(
    mechanism: Mechanism, prefix: str, request: StartRequest, kind: str, payloads: Sequence[str]
) -> tuple[LibraryPlan, Interface]:
    """The library of a kind of FMU, and its variables."""
    if kind == "inverse":
        plan = plan_inverse_library(mechanism, prefix, request)
        return plan, list_inverse_variables(plan, payloads)
    step = check_march_step(mechanism, request.step)
    start = check_start_position(mechanism, request.start)
    settings = MarchSettings(step, start, request.initial, request.spectral_radius, request.payloads)
    plan = plan_forward_library(mechanism, prefix, settings)
    return plan, list_forward_variables(plan, payloads)


def _check_file(file: Path, overwrite: bool) -> Path:
    """The file, which may be written."""
    if file.suffix != ".fmu":
        raise InputError(f"{file}: an FMU is a file that ends with .fmu; write out={file.with_suffix('.fmu').name!r}")
    if file.exists() and (file.is_dir() or not overwrite):
        raise InputError(f"{file} is there already: write another name, or overwrite=True (--overwrite)")
    return file


def _make_token(plan: LibraryPlan, made: Interface, kind: str, step: float | None) -> str:
    """The digest of model and variables, which tells this FMU from others."""
    said = repr((kind, step, made)).encode() + plan.image.write_content()
    return f"{{{sha256(said).hexdigest()[:32]}}}"


def _collect_files(plan: LibraryPlan, head: FmuHead, made: Interface, target: str) -> Mapping[str, bytes]:
    """Path in the archive -> content."""
    name = head.identifier
    library = build_library(plan, render_source(plan, head, made), name, target)
    return {
        "modelDescription.xml": render_description(head, made).encode(),
        f"{list_binary_folders(head.fmi, target)}/{name}.so": library,
        "documentation/index.html": render_fmu_page(head, made).encode(),
        "documentation/licenses/license.txt": read_licence().encode(),
    }


def _write_archive(file: Path, files: Mapping[str, bytes]) -> None:
    """Write a zip file whose bytes do not depend on the clock."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in files.items():
            entry = zipfile.ZipInfo(path, ARCHIVE_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if path.endswith(".so") else 0o644) << 16
            archive.writestr(entry, data)
    write_files(file.parent, {file.name: whole.getvalue()})
