"""Numba's compiler as kernels need it: records at their addresses, libraries of their own, and nothing done that serves nobody.

Half of Numba's time is its own, in Python.  It finds the types of every sum anew, and looks in every function for what kernels do
not have (closures, `with`, `literally`, whole arrays in one expression).

Numba optimises and translates every function by itself, with all that it calls taken in: of a chain of ten calls the last one
ten times.  A kernel that Python never calls needs no machine code.  It stays as it was lowered; what Python calls links all of
them, however deep, and is optimised and translated as one module.  There nobody else can call them, and the machine's compiler
knows it: a kernel with one caller is taken in, others where they are small (`internal`).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar

from numba import types
from numba.core import typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, DefaultPassBuilder

from flexinv.kernels.compiler.record_types import RecordType

# Of a record: nobody writes there meanwhile, and its address is not kept: in words of LLVM 21, or else 20 (Numba 0.62).
NOT_WRITTEN = "noalias"
NOT_KEPT = "captures(none)"
NOT_KEPT_BEFORE = "nocapture"
# Loops over lanes are long, and take vectors of 512 bits where the processor has them.  For some (Intel's server processors,
# and x86-64-v4, for which wheels bring code) LLVM prefers 256: a batch of Panda's torques then takes 62.6 ns a sample instead of
# 45.5 (Emerald Rapids; with code for x86-64-v4 47.8 instead of 29.7 on a Zen 5).
WIDE = '"prefer-vector-width"="512"'


class KernelLibrary(JITCodeLibrary):
    """The lowered text of one kernel; records : how the text calls those of its arguments that are addresses of records.

    over_lanes : whether it loops over lanes; stays_apart : whether it is taken into no caller for being the only one
    """

    records: frozenset[str] = frozenset()
    over_lanes = stays_apart = False

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.own: set[str] = set()  # names of the functions that are defined here
        self.apart: set[str] = set()  # of those that stay apart, and of those in what they call

    def add_ir_module(self, ir_module: Any) -> None:
        """Add the text, with what is promised of the records that a kernel gets, and how wide its vectors may be."""
        for function in ir_module.functions:
            if function.blocks:
                self.own.add(function.name)
                self.apart |= {function.name} if self.stays_apart else set()
                if self.over_lanes:
                    set.add(function.attributes, WIDE)  # llvmlite knows no attributes with values
                for argument in function.args:
                    if argument.name in self.records:
                        _add_promises(argument)
        super().add_ir_module(ir_module)


def _add_promises(argument: Any) -> None:
    """Promise that nobody writes into a record meanwhile or keeps its address."""
    argument.add_attribute(NOT_WRITTEN)
    try:
        argument.add_attribute(NOT_KEPT)
    except ValueError:  # a word that this llvmlite does not know
        argument.add_attribute(NOT_KEPT_BEFORE)


class InnerLibrary(KernelLibrary):
    """The text of a kernel that only kernels call, and the libraries that it calls; it has no address."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave the text as it is: it is tidied once, where it is linked."""

    def finalize(self) -> None:
        """Close the text; what it calls is linked by whoever is translated."""
        self._raise_if_finalized()
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: nothing is translated here."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """Return a writer of addresses that writes none: an environment is nowhere until the text is linked."""
        return SimpleNamespace(set_env=lambda *_: None)


class OuterLibrary(KernelLibrary):
    """The library of a kernel that Python calls: it links what is called at any depth."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimise loops over lanes by themselves; all else is tidied once, with what it calls."""
        if self.over_lanes:
            super()._optimize_functions(ll_module)

    def add_linking_library(self, library: Any) -> None:
        """Link a library, and those that a text within it calls."""
        waiting = [library]
        while waiting:
            one = waiting.pop()
            if one in self._linking_libraries:
                continue
            super().add_linking_library(one)
            self.apart |= getattr(one, "apart", set())
            if isinstance(one, InnerLibrary):
                waiting += one._linking_libraries

    def _optimize_final_module(self) -> None:
        """Optimise the module as a whole, in one pass: Numba's first of two serves counting of references, which is none here."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.name not in self.own | self.apart:
                function.linkage = "internal"
        passes, options = self._codegen._module_pass_manager()
        passes.run(self._final_module, options)


UNUSED = {
    untyped_passes.WithLifting, untyped_passes.InlineClosureLikes, untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.FindLiterallyCalls, untyped_passes.LiteralUnroll, untyped_passes.RewriteDynamicRaises,
    typed_passes.NopythonRewrites,
}  # fmt: skip
# The types of arguments that say all about what a function of Numba's own makes of them.
PLAIN_TYPES = types.Number, types.Boolean, types.Array, types.UniTuple


class TypeCache:
    """Numba's table of the types of calls, which remembers what it has found for its own functions and plain arguments."""

    known_types: ClassVar[dict[Any, Any]] = {}

    def __init__(self, table: Any) -> None:
        self.table = table

    def __getattr__(self, name: str) -> Any:
        return getattr(self.table, name)

    def resolve_function_type(self, function: Any, arguments: Any, by_name: Any) -> Any:
        """Return the signature [-] of a call with arguments of these types."""
        key = function, arguments
        if key in self.known_types and not by_name:
            return self.known_types[key]
        function_type = self.table.resolve_function_type(function, arguments, by_name)
        plain = isinstance(function, types.Function) and all(isinstance(one, PLAIN_TYPES) for one in arguments)
        if plain and not by_name and function_type is not None:
            self.known_types[key] = function_type
        return function_type


def _make_compiler_class(library: type[KernelLibrary]) -> type[Compiler]:
    """Numba's compiler with a library of another kind."""

    class KernelCompiler(Compiler):
        def define_pipelines(self) -> Any:
            made = DefaultPassBuilder.define_nopython_pipeline(self.state)
            made.passes = [one for one in made.passes if one[0] not in UNUSED]
            made.finalize()
            return [made]

        def _compile_bytecode(self) -> Any:
            state = self.state
            if state.library is None:
                state.typingctx = TypeCache(state.typingctx)
                state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
                state.library.enable_object_caching()
                state.library.over_lanes = bool(state.flags.fastmath)
                state.library.stays_apart = getattr(state.func_id.func, "stays_apart", False)
                named = zip(state.func_id.arg_names, state.args, strict=False)
                state.library.records = frozenset(f"arg.{name}" for name, kind in named if isinstance(kind, RecordType))
            return super()._compile_bytecode()

    return KernelCompiler


InnerCompiler = _make_compiler_class(InnerLibrary)
OuterCompiler = _make_compiler_class(OuterLibrary)
