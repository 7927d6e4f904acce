"""Machine code of kernels for programs without Python: the text that Numba has optimised for a process, as an object file.

Nothing is compiled anew.  `kernel_objects` translates the final text of the kernels, which are the same for many mechanisms; here
are *entries* of one mechanism, small functions that take the block of `memory_image.MemoryImage` and call a kernel with what
stands there:

    int32_t NAME(char *block)           0, or not 0 where Numba would raise an exception
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from llvmlite import binding as llvm
from llvmlite import ir
from numba.core.registry import cpu_target

from flexinv.errors import FlexinvError, InputError
from flexinv.export.memory_image import MemoryImage, Operand
from flexinv.kernels.compiler.choice import is_plain
from flexinv.kernels.threads.atomics import COMPILED
from flexinv.validation import find_nearest_word, shown

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


@dataclass(frozen=True)
class Processor:
    """The processor that code is made for: triple, name and features, as LLVM calls them, and what makes it."""

    triple: str
    name: str
    features: str
    maker: Any

    @classmethod
    def build_for(cls, target: str) -> Processor:
        """Return the processor of a target, this one with all its own instructions.  Raises InputError for an unknown target."""
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        triple, name = TARGETS[check_target(target)]
        features = ""
        if target == NATIVE:
            triple = llvm.get_process_triple()
            name = llvm.get_host_cpu_name()
            features = llvm.get_host_cpu_features().flatten()
        kind = llvm.Target.from_triple(triple)
        maker = kind.create_target_machine(cpu=name, features=features, opt=3, reloc="pic", codemodel="small")
        return cls(triple, name, features, maker)

    def parse(self, text: str) -> Any:
        """Return the module [-] of a text for another processor; one of another family has no instruction to pause."""
        text = re.sub(r"^target (triple|datalayout) = .*$", "", text, flags=re.M)
        head = f'target triple = "{self.maker.triple}"\ntarget datalayout = "{self.maker.target_data}"\n'
        if not self.maker.triple.startswith("x86"):
            text = re.sub(rf"^.*call void @{re.escape(_PAUSE)}\(\).*$", "", text, flags=re.M)
        return llvm.parse_assembly(head + text)

    def write_code(self, module: Any) -> bytes:
        """Return the object file [-] of a module."""
        return bytes(self.maker.emit_object(module))


def check_compiler() -> None:
    """Raise InputError where kernels are not compiled by the compiler that lays records out at addresses."""
    if not COMPILED or is_plain():
        why = (
            "NUMBA_DISABLE_JIT is set" if not COMPILED else "kernels are compiled by plain Numba (FLEXINV_PLAIN_NUMBA)"
        )
        raise InputError(f"export: {why}, whose code knows no records at addresses; unset that variable and call again")


def check_target(target: str) -> str:
    """Return the name of a target [-]; raises InputError for one that is not known."""
    if not isinstance(target, str) or target not in TARGETS:
        near = find_nearest_word(target, TARGETS) if isinstance(target, str) else None
        write = near or NATIVE
        raise InputError(f"target = {shown(target)}: expected one of {', '.join(TARGETS)}; write target={write!r}")
    return str(target)


def add_entry(image: MemoryImage, call: KernelCall) -> Entry:
    """Lay the arguments of a call out in a block, and room for its result [any unit]."""
    overload = call.find_overload()
    kinds = overload.signature.args
    operands = [image.add_argument(*part) for part in zip(kinds, call.arguments, strict=True)]
    context = cpu_target.target_context
    size = context.get_abi_sizeof(context.get_value_type(overload.signature.return_type))
    return Entry(call, overload, operands, image.add_room(size))


def write_entries(
    entries: Sequence[Entry], constants: dict[str, bytes], processor: Processor, names: Mapping[str, str]
) -> bytes:
    """Return an object file [-] for a processor with the entries, and constant bytes by their names.

    names : of the functions that Numba has made -> those by which `kernel_objects` writes them
    """
    module = processor.parse(str(_write_entry_module(entries, constants, names)))
    module.verify()
    for one in (*module.functions, *module.global_variables):
        one.visibility = "hidden"  # seen by what is linked with it, and not beyond
    return processor.write_code(module)


def _write_entry_module(entries: Sequence[Entry], constants: dict[str, bytes], names: Mapping[str, str]) -> ir.Module:
    """The text of the entries, and of the constants."""
    module = ir.Module(name="flexinv.export")
    for name, data in constants.items():
        kind = ir.ArrayType(_BYTE, len(data))
        constant = ir.GlobalVariable(module, kind, name)
        constant.global_constant = True
        constant.initializer = kind(bytearray(data))
        constant.align = 64
    for one in entries:
        _write_entry(module, one, names[one.overload.fndesc.llvm_func_name])
    return module


def _write_entry(module: ir.Module, entry: Entry, name: str) -> None:
    """The function that reads the arguments of a kernel from a block, calls it, and leaves its result there."""
    context = cpu_target.target_context
    function_type = context.call_conv.get_function_type(
        entry.overload.signature.return_type, entry.overload.signature.args
    )
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


def check_needs(module: Any) -> None:
    """Raise FlexinvError for functions of a module that the system would have to bring beyond `NEEDED`, [-]."""
    called = {one.name for one in module.functions if one.is_declaration and not one.name.startswith("llvm.")}
    called |= {one.name for one in module.global_variables if one.is_declaration}
    if beyond := sorted(called - NEEDED):
        raise FlexinvError(
            f"export: the machine code needs {', '.join(beyond)}, which a C program does not have; where that is a library of "
            "vector mathematics (SVML), call again with NUMBA_DISABLE_INTEL_SVML=1"
        )
