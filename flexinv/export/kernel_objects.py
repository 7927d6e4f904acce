"""The kernels of libraries as objects, which are translated once for all mechanisms that need the same ones, and kept.

Everything but the kernels becomes internal, what nobody calls goes (Numba's wrappers for Python among it), and the rest is
translated.  For this processor that gives the machine code of the process itself, and so its digits.  A program may be linked
with libraries of several mechanisms: names of kernels bear a digest of what they are made of, so that one name is one code.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from llvmlite import binding as llvm

from flexinv.export.machine_code import NEEDED, Entry, Processor, check_needs

NAME_DIGITS = 20  # of a digest, in names
_SEEN_OUTSIDE = {"linkonce_odr", "external", "common", "weak_odr"}


@dataclass(frozen=True)
class KernelObject:
    """Kernels as an object file, and the names in it by those that Numba has given them."""

    code: bytes
    names: Mapping[str, str]


def make_kernel_object(entries: Sequence[Entry], processor: Processor) -> KernelObject:
    """Return the kernels that entries call, translated for a processor or as they are kept, [-].

    Raises FlexinvError where the code needs more of the system than `machine_code.NEEDED`.
    """
    kernels = {one.overload.library.name: one.overload.library for one in entries}
    modules = [kernels[name]._get_module_for_linking() for name in sorted(kernels)]
    digest = _compute_digest(modules, processor)
    called = sorted({one.overload.fndesc.llvm_func_name for one in entries})
    names = {name: f"flexinv_{digest[:NAME_DIGITS]}_{number}" for number, name in enumerate(called)}
    place = _find_place(entries, processor)
    code = _read_kept(place, digest)
    if code is None:
        code = _make_object(modules, names, processor)
        _write_kept(place, digest, code)
    return KernelObject(code, names)


def _compute_digest(modules: Sequence[Any], processor: Processor) -> str:
    """The digest of all that an object is made of: its modules, the processor, the compiler, this source, what may be needed."""
    made_for = (processor.triple, processor.name, processor.features)
    made_by = (llvm.llvm_version_info, Path(__file__).read_text(encoding="utf-8"), sorted(NEEDED))
    out = sha256(repr((made_for, made_by)).encode())
    for one in modules:
        out.update(one.as_bitcode())
    return out.hexdigest()


def _make_object(modules: Sequence[Any], names: Mapping[str, str], processor: Processor) -> bytes:
    """The object file of modules, with the functions of these names under their new ones."""
    whole: Any = None
    for one in modules:
        module = processor.parse(str(one))
        _replace_names(names, module)
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    whole.verify()
    _remove_all_but(names.values(), whole)
    check_needs(whole)
    return processor.write_code(whole)


def _replace_names(names: Mapping[str, str], module: Any) -> None:
    """Give the kernels of a module their new names; libraries that are linked share them, and what is linked sees no others."""
    for one in [one for one in module.functions if one.name in names]:
        one.name = names[one.name]
        if not one.is_declaration:
            one.linkage = "weak_odr"
            one.visibility = "hidden"


def _remove_all_but(kept: Collection[str], module: Any) -> None:
    """Leave in a module what the functions of these names need."""
    for one in (*module.functions, *module.global_variables):
        if one.name not in kept and not one.is_declaration and one.linkage.name in _SEEN_OUTSIDE:
            one.linkage = "internal"
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    machine = llvm.Target.from_default_triple().create_target_machine()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))


def _find_place(entries: Sequence[Entry], processor: Processor) -> Path | None:
    """The file for the object of these kernels and this processor, beside their machine code; None where none is kept."""
    folder = getattr(entries[0].call.kernel._cache, "cache_path", None)
    if not folder:
        return None
    kernels = sorted({f"{one.call.kernel.py_func.__qualname__} {one.overload.signature}" for one in entries})
    wanted = sha256(repr((kernels, processor.triple, processor.name)).encode()).hexdigest()
    return Path(folder) / f"export-{wanted[:NAME_DIGITS]}.o"


def _read_kept(place: Path | None, digest: str) -> bytes | None:
    """The object that is kept, None where there is none or one that was made of something else."""
    if place is None:
        return None
    try:
        kept = place.read_bytes()
    except OSError:
        return None
    code = kept[2 * len(digest) :]
    return code if kept == _add_digests(digest, code) else None


def _write_kept(place: Path | None, digest: str, code: bytes) -> None:
    """Write an object behind its digests, for the next export: a disk that is full costs the time of translating again."""
    if place is None:
        return
    with suppress(OSError), tempfile.TemporaryDirectory(dir=place.parent, prefix=place.stem) as folder:
        whole = Path(folder) / place.name
        whole.write_bytes(_add_digests(digest, code))
        os.replace(whole, place)


def _add_digests(digest: str, code: bytes) -> bytes:
    """A file of an object: the digest of what it is made of, that of the code, the code."""
    return digest.encode() + sha256(code).hexdigest().encode() + code
