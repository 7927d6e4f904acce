"""Stamp of the sources in the machine code of a kernel, which is discarded when any of them changes.

Numba asks only whether the file of the function itself is the same, but its code holds that of all functions it calls.  The
family of a module is itself and what it imports; a module that joins the list changes only the families that import it.
"""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from pathlib import Path

# The modules, as they are called in the package, whose text or constants are in machine code.
SOURCES = (
    "analysis.batch_kernel", "constraints.allocation_kernel", "constraints.continuation_kernel", "constraints.equations",
    "dynamics.assembly", "dynamics.constraint_rows", "dynamics.dofs", "dynamics.generalized_alpha", "dynamics.index1",
    "dynamics.linearization", "dynamics.loads", "dynamics.spring_rows", "dynamics.stepper", "dynamics.system",
    "dynamics.tree_solver", "elements.beam", "elements.beam_element", "elements.joint_law", "elements.planar_beam",
    "inverse.balance", "inverse.nodal_sums", "inverse.trajectory_pass", "kernels.block_elimination",
    "kernels.block_tridiagonal", "kernels.code_cache", "kernels.dense", "kernels.fronts", "kernels.inner_library",
    "kernels.jit", "kernels.kernel_compiler", "kernels.pivoted_qr", "kernels.record_stack", "kernels.records", "kernels.simd",
    "kernels.so3", "kernels.sparse_qr", "kernels.threads.atomics", "kernels.threads.mailbox", "kernels.vec3",
    "kinematics.configuration", "kinematics.tree", "linearized.natural_modes", "model.joint_kinds", "planar.constraint_rows",
    "planar.history", "planar.index1", "planar.stepper", "planar.tree", "planar.tree_solver", "rigid.blocks",
    "rigid.derivative_kernel", "rigid.regressor_kernel", "rnea.loop_allocation", "rnea.loop_bodies",
    "rnea.loop_layout", "rnea.loop_plane", "rnea.loop_space", "rnea.recursion",
    "tracking.collocation_kernel",
)  # fmt: skip
_IMPORT = re.compile(r"^from flexinv\.([\w.]+) import (\w*)", re.MULTILINE)


def family(module: str, folder: Path) -> tuple[str, ...]:
    """Return the sources [-] that are in the kernels of a module: itself and what it imports of them, all where it is none."""
    if module not in SOURCES:
        return SOURCES
    found, ahead = {module}, [module]
    while ahead:
        found_imports = _IMPORT.findall(_file(folder, ahead.pop()).read_text(encoding="utf-8"))
        names = {name for package, one in found_imports for name in (package, f"{package}.{one}")}
        ahead += sorted(names.intersection(SOURCES) - found)
        found.update(ahead)
    return tuple(sorted(found))


@cache
def source_stamp(folder: Path, module: str) -> str:
    """Return a digest [-] of the sources in the package's ``folder`` that are in the kernels of a module."""
    digest = sha256()
    for name in family(module, folder):
        digest.update(_file(folder, name).read_bytes())
    return digest.hexdigest()


def _file(folder: Path, module: str) -> Path:
    return folder.joinpath(*module.split(".")).with_suffix(".py")
