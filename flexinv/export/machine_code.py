"""Machine code of kernels for programs without Python: the text that Numba has optimised for a process, as an object file.

Nothing is compiled anew.  The final text of every kernel is linked with *entries*, small functions that take the block of
`memory_image.MemoryImage` and call the kernel with what stands there:

    int32_t NAME(char *block)           0, or not 0 where Numba would raise an exception

Everything but the entries becomes internal, what nobody calls goes (Numba's wrappers for Python among it), and what is left is
translated.  For this processor that gives the machine code of the process itself, and so its digits.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from llvmlite import binding as llvm
from llvmlite import ir
from numba.core.registry import cpu_target

from flexinv.errors import FlexinvError, InputError
from flexinv.export.memory_image import MemoryImage, Operand
from flexinv.kernels.compiler.choice import is_plain
from flexinv.kernels.threads.atomics import COMPILED
from flexinv.validation import find_nearest_word

NATIVE = "native"
# Target -> triple and processor; `native` is this machine's.
TARGETS = {
    NATIVE: ("", ""),
    "x86-64-v2": ("x86_64-unknown-linux-gnu", "x86-64-v2"),
    "x86-64-v3": ("x86_64-unknown-linux-gnu", "x86-64-v3"),
    "x86-64-v4": ("x86_64-unknown-linux-gnu", "x86-64-v4"),
    "aarch64": ("aarch64-unknown-linux-gnu", "generic"),
}
# What an object may need of the system: functions of libm, and those of libc that move bytes.  None waits, none allocates.
NEEDED = frozenset({
    "acos", "asin", "atan", "atan2", "ceil", "cos", "exp", "fabs", "floor", "fmod", "ldexp", "log", "memcpy", "memmove", "memset",
    "pow", "rint", "round", "sin", "sincos", "sqrt", "tan", "tanh", "trunc",
})  # fmt: skip
_INTERNAL = {"linkonce_odr", "external", "common", "weak_odr"}
_PAUSE = "llvm.x86.sse2.pause"  # waiting for a helper thread, of which there is none
_BYTE = ir.IntType(8)
_WORD = ir.IntType(64)
_STATUS = ir.IntType(32)


@dataclass(frozen=True)
class KernelCall:
    """A kernel, the arguments that Python would call it with, and the name by which C calls it."""

    name: str
    kernel: Any
    arguments: tuple[Any, ...]

    def find_overload(self) -> Any:
        """Return the code that Numba has compiled [-] for arguments of these types, compiled now where it was not before."""
        kinds = tuple(self.kernel.typeof_pyval(one) for one in self.arguments)
        if kinds not in self.kernel.overloads:
            self.kernel.compile(kinds)
        return self.kernel.overloads[kinds]


@dataclass(frozen=True)
class Entry:
    """A call laid out: the machine arguments of each argument, and the offset [bytes] in the block where its result goes."""

    call: KernelCall
    overload: Any
    operands: list[list[Operand]]
    result: int

    def find_argument(self, number: int) -> int:
        """Return the offset [bytes] of the first word of an argument in the block."""
        return self.operands[number][0].offset


def check_compiler() -> None:
    """Raise InputError where kernels are not compiled by the compiler that lays records out at addresses."""
    if not COMPILED or is_plain():
        why = (
            "NUMBA_DISABLE_JIT is set" if not COMPILED else "kernels are compiled by plain Numba (FLEXINV_PLAIN_NUMBA)"
        )
        raise InputError(
            f"export_c: {why}, whose code knows no records at addresses; unset that variable and call again"
        )


def check_target(target: str) -> str:
    """Return the name of a target [-]; raises InputError for one that is not known."""
    if target not in TARGETS:
        near = find_nearest_word(target, TARGETS)
        write = near or NATIVE
        raise InputError(f"target = {target!r}: expected one of {', '.join(TARGETS)}; write target={write!r}")
    return target


def add_entry(image: MemoryImage, call: KernelCall) -> Entry:
    """Lay the arguments of a call out in a block, and room for its result [any unit]."""
    overload = call.find_overload()
    kinds = overload.signature.args
    operands = [image.add_argument(*part) for part in zip(kinds, call.arguments, strict=True)]
    context = cpu_target.target_context
    size = context.get_abi_sizeof(context.get_value_type(overload.signature.return_type))
    return Entry(call, overload, operands, image.add_room(size))


def write_object(entries: Sequence[Entry], constants: dict[str, bytes], target: str) -> bytes:
    """Return an object file [-] for a target with the entries, and constant bytes by their names.

    Raises FlexinvError where the code needs more of the system than `NEEDED`.
    """
    machine = _make_machine(target)
    whole = _join_modules(entries, constants, machine)
    _remove_all_but([*(one.call.name for one in entries), *constants], whole)
    check_needs(whole)
    return bytes(machine.emit_object(whole))


def _make_machine(target: str) -> Any:
    """The maker of code for a target, with the processor's own instructions where it is this one."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    triple, processor = TARGETS[check_target(target)]
    features = ""
    if target == NATIVE:
        triple = llvm.get_process_triple()
        processor = llvm.get_host_cpu_name()
        features = llvm.get_host_cpu_features().flatten()
    return llvm.Target.from_triple(triple).create_target_machine(
        cpu=processor, features=features, opt=3, reloc="pic", codemodel="small"
    )


def _join_modules(entries: Sequence[Entry], constants: dict[str, bytes], machine: Any) -> Any:
    """One module of the entries, the constants and the kernels."""
    kernels = {one.overload.library.name: one.overload.library for one in entries}
    texts = [str(one._get_module_for_linking()) for one in kernels.values()]
    texts.insert(0, str(_write_entries(entries, constants)))
    whole: Any = None
    for text in texts:
        module = llvm.parse_assembly(_replace_target(text, machine))
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    whole.verify()
    return whole


def _replace_target(text: str, machine: Any) -> str:
    """The text of a module for another machine; one that is not of this family has no instruction to pause."""
    text = re.sub(r"^target (triple|datalayout) = .*$", "", text, flags=re.M)
    head = f'target triple = "{machine.triple}"\ntarget datalayout = "{machine.target_data}"\n'
    if not machine.triple.startswith("x86"):
        text = re.sub(rf"^.*call void @{re.escape(_PAUSE)}\(\).*$", "", text, flags=re.M)
    return head + text


def _write_entries(entries: Sequence[Entry], constants: dict[str, bytes]) -> ir.Module:
    """The text of the entries, and of the constants."""
    module = ir.Module(name="flexinv.export")
    for name, data in constants.items():
        kind = ir.ArrayType(_BYTE, len(data))
        constant = ir.GlobalVariable(module, kind, name)
        constant.global_constant = True
        constant.initializer = kind(bytearray(data))
        constant.align = 64
    for one in entries:
        _write_entry(module, one)
    return module


def _write_entry(module: ir.Module, entry: Entry) -> None:
    """The function that reads the arguments of a kernel from a block, calls it, and leaves its result there."""
    context = cpu_target.target_context
    function_type = context.call_conv.get_function_type(
        entry.overload.signature.return_type, entry.overload.signature.args
    )
    name = entry.overload.fndesc.llvm_func_name
    kernel = module.globals.get(name) or ir.Function(module, function_type, name)
    function = ir.Function(module, ir.FunctionType(_STATUS, [_BYTE.as_pointer()]), entry.call.name)
    builder = ir.IRBuilder(function.append_basic_block())

    def find_place(offset: int, kind: Any) -> Any:
        return builder.bitcast(builder.gep(function.args[0], [_WORD(offset)]), kind)

    result, trouble, *kinds = function_type.args
    given = [find_place(entry.result, result), builder.alloca(trouble.pointee)]
    operands = [one for argument in entry.operands for one in argument]
    for one, kind in zip(operands, kinds, strict=True):
        given.append(
            find_place(one.offset, kind) if one.is_address else builder.load(find_place(one.offset, kind.as_pointer()))
        )
    builder.ret(builder.call(kernel, given))


def _remove_all_but(kept: Sequence[str], module: Any) -> None:
    """Leave in a module what the ``kept`` names need; those are seen by what is linked with it, and not beyond."""
    for one in (*module.functions, *module.global_variables):
        if one.name in kept:
            one.visibility = "hidden"
        elif not one.is_declaration and one.linkage.name in _INTERNAL:
            one.linkage = "internal"
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    machine = llvm.Target.from_default_triple().create_target_machine()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))


def check_needs(module: Any) -> None:
    """Raise FlexinvError for functions of a module that the system would have to bring beyond `NEEDED`, [-]."""
    called = {one.name for one in module.functions if one.is_declaration and not one.name.startswith("llvm.")}
    called |= {one.name for one in module.global_variables if one.is_declaration}
    if beyond := sorted(called - NEEDED):
        raise FlexinvError(
            f"export_c: the machine code needs {', '.join(beyond)}, which a C program does not have; where that is a library of "
            "vector mathematics (SVML), call again with NUMBA_DISABLE_INTEL_SVML=1"
        )
