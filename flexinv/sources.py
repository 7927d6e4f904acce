"""Which sources are in the machine code of a kernel: it is thrown away when any of them changes.

Numba asks only whether the file of the function itself is the same, but its code holds that of all functions it calls.  The
family of a module is itself and what it imports; a module that joins the list changes only the families that import it.
"""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from pathlib import Path

# The modules whose text or constants are in machine code.
SOURCES = (
    "alike_march", "assemble", "atomics", "beam", "blocks", "border", "branch", "compiled", "coordinates", "damped_beam",
    "damped_plane", "differentiate", "eliminate", "instants", "integrate", "kinds", "lanes", "loads", "loop_columns",
    "loop_ground", "loop_lanes", "loop_layout", "loop_plane", "loop_reduce", "loop_rows", "loop_six", "loop_space",
    "loop_together", "march", "modes", "offers", "planar_beam", "planar_march", "planar_record", "planar_settle",
    "planar_solve", "planar_ties", "planar_tree", "projection", "pulls", "recursion", "regress", "rotations", "rows",
    "second_step", "settle", "stacks", "sums", "system", "ties", "tree", "tridiagonal", "vectors",
)  # fmt: skip
_IMPORT = re.compile(r"^from flexinv\.(\w+) import", re.MULTILINE)


def family(module: str, folder: Path) -> tuple[str, ...]:
    """Return the sources [-] that are in the kernels of a module: itself and what it imports of them, all where it is none."""
    if module not in SOURCES:
        return SOURCES
    found, ahead = {module}, [module]
    while ahead:
        names = set(_IMPORT.findall((folder / f"{ahead.pop()}.py").read_text(encoding="utf-8")))
        ahead += sorted(names.intersection(SOURCES) - found)
        found.update(ahead)
    return tuple(sorted(found))


@cache
def source_stamp(folder: Path, module: str) -> str:
    """Return a digest [-] of the sources in ``folder`` that are in the kernels of a module."""
    digest = sha256()
    for name in family(module, folder):
        digest.update((folder / f"{name}.py").read_bytes())
    return digest.hexdigest()
