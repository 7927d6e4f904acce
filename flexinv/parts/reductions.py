"""Reductions of meshed parts, made once: kept by the part itself, and in a folder of the user by the digest of its data.

The folder is ``flexinv/parts`` in ``XDG_CACHE_HOME`` (``~/.cache``).  A file that is torn, or of another release, is made anew.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.model.owned_cache import make_owner_cache
from flexinv.model.part import MeshedPart
from flexinv.parts.craig_bampton import Reduction, compute_reduction

# Changes with whatever changes numbers of a reduction.
RELEASE = "3"
# Parts whose points are fewer are reduced in less time than a file takes.
FEW_POINTS = 300
# Data of a part on which its reduction does not depend.
NOT_REDUCED = ("source", "tip", "retardation", "drag", "finer")
# Files that are kept: the oldest go first.
MOST_FILES = 200


@make_owner_cache(frozen=False)
def find_reduction(part: MeshedPart) -> Reduction:
    """Return the reduction of a part [kg], [N/m], from the folder where it is kept, or made now and kept there."""
    if len(part.points) < FEW_POINTS:
        return compute_reduction(part)
    file = find_cache_folder() / f"{compute_digest(part)}.npz"
    with contextlib.suppress(Exception):  # whatever is wrong with a kept file, the part is at hand
        return _read_reduction(file)
    reduced = compute_reduction(part)
    with contextlib.suppress(OSError):  # a folder that cannot be written to costs time alone
        _write_reduction(file, reduced)
    return reduced


def find_cache_folder() -> Path:
    """Return the folder [-] of kept reductions, which need not be there yet."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(stated) if stated else Path.home() / ".cache") / "flexinv" / "parts"


def compute_digest(part: MeshedPart) -> str:
    """Return the digest of all data of a part [-] from which its reduction follows."""
    digest = sha256(f"{RELEASE} {np.__version__} {scipy.__version__}".encode())
    _add_to_digest(digest, [getattr(part, f.name) for f in fields(part) if f.name not in NOT_REDUCED])
    return digest.hexdigest()[:32]


def _add_to_digest(digest: Any, value: Any) -> None:
    if isinstance(value, np.ndarray):
        digest.update(f"{value.shape}{value.dtype}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, tuple | list):
        digest.update(f"({len(value)}".encode())
        for part in value:
            _add_to_digest(digest, part)
    elif hasattr(value, "__dataclass_fields__"):
        _add_to_digest(digest, [getattr(value, f.name) for f in fields(value)])
    else:
        digest.update(f"{type(value).__name__}{value!r};".encode())


def _read_reduction(file: Path) -> Reduction:
    with file.open("rb") as stream, np.load(stream, allow_pickle=False) as kept:
        parts = {f.name: kept[f.name] for f in fields(Reduction) if f.name not in ("mass", "left_out")}
        count = len(parts["points"])
        mass = scipy.sparse.csr_array(
            (kept["mass_data"], kept["mass_indices"], kept["mass_indptr"]), shape=(count, count)
        )
        return Reduction(mass=mass, left_out=float(kept["left_out"]), **parts)


def _write_reduction(file: Path, reduced: Reduction) -> None:
    """Write a file whole or not at all, and remove the oldest of many."""
    file.parent.mkdir(parents=True, exist_ok=True)
    parts = {f.name: getattr(reduced, f.name) for f in fields(reduced) if f.name != "mass"}
    mass = reduced.mass.tocsr()
    parts |= {f"mass_{name}": getattr(mass, name) for name in ("data", "indices", "indptr")}
    with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".tmp", delete=False) as stream:
        np.savez(stream, **parts)
    os.replace(stream.name, file)
    others = sorted(file.parent.glob("*.npz"), key=lambda one: one.stat().st_mtime)
    for old in others[: max(len(others) - MOST_FILES, 0)]:
        with contextlib.suppress(OSError):
            old.unlink()
