"""Stamps of sources: a digest of all text and constants that are in the machine code of a module's kernels.

Numba asks only whether the file of the function itself is the same, but its code holds that of all functions it calls.  So code
bears the stamp of a module's family, which is itself and what it imports; it is discarded when any of these sources changes.
"""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
# What a module imports whose text or constants are in machine code, and the modules without these imports that are in it too.
_HAS_KERNELS = re.compile(r"^from flexinv\.kernels\.(jit|records) import", re.MULTILINE)
ALSO = (
    "kernels.jit",
    "kernels.compiler.plain",
    "kernels.compiler.probe",
    "kernels.records",
    "kernels.threads.atomics",
    "model.joint_kinds",
)
# What all machine code is made by.
MAKERS = tuple(f"kernels.compiler.{name}" for name in ("arrays", "code_cache", "kernel_compiler", "record_types"))
_IMPORT = re.compile(r"^from flexinv\.([\w.]+) import (.*)", re.MULTILINE)


def list_sources(folder: Path) -> tuple[str, ...]:
    """Return the modules [-], as they are called in the package, whose text or constants are in machine code."""
    every = (path.relative_to(folder).with_suffix("").parts for path in sorted(folder.rglob("*.py")))
    return tuple(module for module in map(".".join, every) if _is_source(folder, module))


def list_family(module: str, folder: Path) -> tuple[str, ...]:
    """Return the sources [-] that are in the kernels of a module: itself and what it imports of them, all where it is none."""
    if not _is_source(folder, module):
        return list_sources(folder)
    found = {module, *MAKERS}
    ahead = [module]
    while ahead:
        ahead += [name for name in _list_imported_sources(folder, ahead.pop()) if name not in found]
        found.update(ahead)
    return tuple(sorted(found))


@cache
def compute_source_stamp(folder: Path, module: str) -> str:
    """Return a digest [-] of the sources in the package's ``folder`` that are in the kernels of a module."""
    return sha256("".join(_read_text(folder, name) for name in list_family(module, folder)).encode()).hexdigest()


@cache
def _list_imported_sources(folder: Path, module: str) -> tuple[str, ...]:
    """Return the sources that a module imports itself."""
    imports = _IMPORT.findall(_read_text(folder, module))
    names = {f"{package}.{one}".rstrip(".") for package, line in imports for one in ("", *re.findall(r"\w+", line))}
    return tuple(sorted(name for name in names if _is_source(folder, name)))


@cache
def _is_source(folder: Path, module: str) -> bool:
    return module in ALSO + MAKERS or _HAS_KERNELS.search(_read_text(folder, module)) is not None


@cache
def _read_text(folder: Path, module: str) -> str:
    """The text of a module, nothing where there is none."""
    path = folder.joinpath(*module.split(".")).with_suffix(".py")
    return path.read_text(encoding="utf-8") if path.is_file() else ""
