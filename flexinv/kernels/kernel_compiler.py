"""Numba's compiler as kernels need it: records at their addresses, libraries of their own, and nothing done that serves nobody.

Half of Numba's time is its own, in Python.  It finds the types of every sum anew, and looks in every function for what kernels do
not have (closures, `with`, `literally`, whole arrays in one expression).
"""

from __future__ import annotations

from typing import Any, ClassVar

from numba import types
from numba.core import typed_passes, untyped_passes
from numba.core.compiler import Compiler, DefaultPassBuilder

from flexinv.kernels.inner_library import InnerLibrary, KernelLibrary, OuterLibrary
from flexinv.kernels.records import RecordType

UNUSED = {
    untyped_passes.WithLifting,
    untyped_passes.InlineClosureLikes,
    untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.FindLiterallyCalls,
    untyped_passes.LiteralUnroll,
    untyped_passes.RewriteDynamicRaises,
    typed_passes.NopythonRewrites,
}
# The types of arguments that say all about what a function of Numba's own makes of them.
PLAIN = types.Number, types.Boolean, types.Array, types.UniTuple


class RememberedTypes:
    """Numba's table of the types of calls, which remembers what it has found for its own functions and plain arguments."""

    found: ClassVar[dict[Any, Any]] = {}

    def __init__(self, table: Any) -> None:
        self.table = table

    def __getattr__(self, name: str) -> Any:
        return getattr(self.table, name)

    def resolve_function_type(self, function: Any, arguments: Any, by_name: Any) -> Any:
        """Return the signature [-] of a call with arguments of these types."""
        key = function, arguments
        if key in self.found and not by_name:
            return self.found[key]
        made = self.table.resolve_function_type(function, arguments, by_name)
        plain = isinstance(function, types.Function) and all(isinstance(one, PLAIN) for one in arguments)
        if plain and not by_name and made is not None:
            self.found[key] = made
        return made


def _compiler(library: type[KernelLibrary]) -> type[Compiler]:
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
                state.typingctx = RememberedTypes(state.typingctx)
                state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
                state.library.enable_object_caching()
                state.library.over_lanes = bool(state.flags.fastmath)
                state.library.stays_apart = getattr(state.func_id.func, "stays_apart", False)
                named = zip(state.func_id.arg_names, state.args, strict=False)
                state.library.records = frozenset(f"arg.{name}" for name, kind in named if isinstance(kind, RecordType))
            return super()._compile_bytecode()

    return KernelCompiler


InnerCompiler = _compiler(InnerLibrary)
OuterCompiler = _compiler(OuterLibrary)
