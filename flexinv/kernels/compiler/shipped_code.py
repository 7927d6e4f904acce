"""Machine code that a wheel brings along: one folder per level of processor, chosen when the first kernel is called.

A folder serves if it was made by the same Python, Numba and llvmlite for a level that this processor has, and a kernel in it if
its sources are the same and the file is whole.  All else is compiled, and said once.  `write_shipped` makes a folder.
"""

from __future__ import annotations

import json
import pickle
import platform
import sys
import warnings
from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding as llvm
from numba.core import config
from numba.core.serialize import dumps

MACHINE_CODE = Path(__file__).resolve().parents[2] / "machine_code"
INDEX = "index.json"
# The levels of the x86-64 psABI, best first, by what the processor must have beyond the level below.
_V3 = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2", "xsave")
LEVELS = {
    "x86-64-v4": (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
    "x86-64-v3": _V3,
    "generic": ("neon",),  # aarch64
}


def list_processor_levels(features: Mapping[str, bool] | None = None) -> list[str]:
    """Return the levels [-] that a processor with these features has, this one's by default, best first."""
    have = llvm.get_host_cpu_features() if features is None else features
    return [level for level, needed in LEVELS.items() if all(have.get(name) for name in needed)]


def collect_compiler_versions() -> dict[str, str]:
    """Return the makers of machine code and their versions [-]."""
    made = {"python": sys.implementation.cache_tag, "numba": numba.__version__, "llvmlite": llvmlite.__version__}
    return made | {"system": f"{platform.system()} {platform.machine()}"}


def find_shipped_code(module: str, name: str, signature: str, stamp: str) -> tuple[Any, ...] | None:
    """Return the result of compiling a kernel for these types [-] from the disk, None where there is none that serves."""
    folder, kernels = _choose_folder(MACHINE_CODE)
    entry = kernels.get(_compute_key(module, name, signature))
    if entry is None:
        return None
    if entry["stamp"] != stamp:
        _warn_unusable("the sources of flexinv have been changed since it was made")
        return None
    try:
        data = (folder / entry["file"]).read_bytes()
        if sha256(data).hexdigest() == entry["digest"]:
            return tuple(pickle.loads(data))
    except OSError:
        pass
    _warn_unusable(f"{folder / entry['file']} is damaged: install flexinv again")
    return None


@cache
def _choose_folder(folder: Path) -> tuple[Path, dict[str, Any]]:
    """Folder and kernels for this processor; none where there is no folder, or none that serves."""
    nothing: tuple[Path, dict[str, Any]] = (folder, {})
    now: Any = config
    asked = now.CPU_NAME, now.CPU_FEATURES, now.OPT, now.ENABLE_AVX, now.BOUNDSCHECK, now.DEBUGINFO_DEFAULT
    if not folder.is_dir() or asked != (None, None, 3, True, None, 0):  # a user who sets these wants code of his own
        return nothing
    found = [folder / level for level in list_processor_levels() if (folder / level / INDEX).is_file()]
    if not found:
        _warn_unusable(f"it is for {', '.join(sorted(p.name for p in folder.glob('*/')))}, which this processor is not")
        return nothing
    try:
        index = json.loads((found[0] / INDEX).read_text(encoding="utf-8"))
        made = dict(index["maker"])
        kernels = dict(index["kernels"])
    except (OSError, ValueError, KeyError, TypeError):
        _warn_unusable(f"{found[0] / INDEX} is damaged: install flexinv again")
        return nothing
    for what, is_ in collect_compiler_versions().items():
        if made.get(what) != is_:
            _warn_unusable(f"it was made by {what} {made.get(what)}, and this is {is_}")
            return nothing
    return found[0], kernels


def _warn_unusable(reason: str) -> None:
    """Say once why kernels are compiled although machine code came along."""
    if not _told:
        _told.append(reason)
        said = f"the machine code that came with flexinv is not used: {reason}; kernels are compiled once and kept"
        warnings.warn(said, RuntimeWarning, stacklevel=2)


_told: list[str] = []


def _compute_key(module: str, name: str, signature: str) -> str:
    return sha256(f"{module}.{name}{signature}".encode()).hexdigest()


def write_shipped(folder: Path, kernels: Iterable[Any]) -> int:
    """Write what is kept of these kernels for the present processor's name into ``folder``; return how many files [-]."""
    folder.mkdir(parents=True, exist_ok=True)
    entries: dict[str, Any] = {}
    for kernel in kernels:
        cache_ = kernel._cache
        function = kernel.py_func
        machine = kernel.targetctx.codegen().magic_tuple()
        for (signature, made_for, *_), _file in sorted(cache_._cache_file._load_index().items(), key=str):
            if made_for != machine:
                continue
            kept = list(cache_._cache_file._load_data(_file))
            kept[6] = ""  # the annotated source, which nobody reads
            data = dumps(tuple(kept))
            file = f"{function.__module__}.{function.__qualname__}.{len(entries)}"
            (folder / file).write_bytes(data)
            key = _compute_key(function.__module__, function.__qualname__, str(signature))
            stamp = cache_._cache_file._source_stamp[1]
            entries[key] = {"file": file, "digest": sha256(data).hexdigest(), "stamp": stamp}
    text = json.dumps({"maker": collect_compiler_versions(), "kernels": entries}, indent=1)
    (folder / INDEX).write_text(text, encoding="utf-8")
    return len(entries)
