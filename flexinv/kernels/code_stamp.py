"""Stamp of the sources in the machine code of a kernel, which is discarded when any of them changes.

Numba asks only whether the file of the function itself is the same, but its code holds that of all functions it calls.  The
family of a module is itself and what it imports; a module that joins the list changes only the families that import it.
"""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from pathlib import Path

# What a module imports whose text or constants are in machine code, and the modules without these imports that are in it too.
_HAS_KERNELS = re.compile(r"^from flexinv\.kernels\.(jit|records) import", re.MULTILINE)
ALSO = "kernels.jit", "kernels.kernel_compiler", "kernels.records", "kernels.threads.atomics", "model.joint_kinds"
_IMPORT = re.compile(r"^from flexinv\.([\w.]+) import (\w*)", re.MULTILINE)


def sources(folder: Path) -> tuple[str, ...]:
    """Return the modules [-], as they are called in the package, whose text or constants are in machine code."""
    every = (path.relative_to(folder).with_suffix("").parts for path in sorted(folder.rglob("*.py")))
    return tuple(module for module in map(".".join, every) if _is_source(folder, module))


def family(module: str, folder: Path) -> tuple[str, ...]:
    """Return the sources [-] that are in the kernels of a module: itself and what it imports of them, all where it is none."""
    if not _is_source(folder, module):
        return sources(folder)
    found, ahead = {module}, [module]
    while ahead:
        imports = _IMPORT.findall(_text(folder, ahead.pop()))
        names = {name for package, one in imports for name in (package, f"{package}.{one}".rstrip("."))}
        ahead += [name for name in names - found if _is_source(folder, name)]
        found.update(ahead)
    return tuple(sorted(found))


@cache
def source_stamp(folder: Path, module: str) -> str:
    """Return a digest [-] of the sources in the package's ``folder`` that are in the kernels of a module."""
    return sha256("".join(_text(folder, name) for name in family(module, folder)).encode()).hexdigest()


def _is_source(folder: Path, module: str) -> bool:
    return module in ALSO or _HAS_KERNELS.search(_text(folder, module)) is not None


@cache
def _text(folder: Path, module: str) -> str:
    """The text of a module, nothing where there is none."""
    path = folder.joinpath(*module.split(".")).with_suffix(".py")
    return path.read_text(encoding="utf-8") if path.is_file() else ""
