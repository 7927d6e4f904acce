"""Kernels within kernels: text for the machine's compiler, linked once into each kernel that Python calls.

Numba optimises and translates every function by itself, with all that it calls taken in: of a chain of ten calls the last one
ten times.  A kernel that Python never calls needs no machine code.  It stays as it was lowered, each function tidied by itself;
what Python calls links all of them, however deep, and is optimised and translated as one module.  That halves the time of
compiling; the march takes as long as before (tidying nothing first would make the module twice as slow to optimise).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class InnerLibrary(JITCodeLibrary):
    """The lowered text of one kernel, and the libraries that it calls; it has no address."""

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


class OuterLibrary(JITCodeLibrary):
    """The library of a kernel that Python calls: it links what is called at any depth."""

    def add_linking_library(self, library: Any) -> None:
        """Link a library, and those that a text within it calls."""
        waiting = [library]
        while waiting:
            one = waiting.pop()
            if one in self._linking_libraries:
                continue
            super().add_linking_library(one)
            if isinstance(one, InnerLibrary):
                waiting += one._linking_libraries


def _compiler(library: type[JITCodeLibrary]) -> type[Compiler]:
    """Numba's compiler with a library of another kind."""

    class WithLibrary(Compiler):
        def _compile_bytecode(self) -> Any:
            state = self.state
            if state.library is None:
                state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
                state.library.enable_object_caching()
            return super()._compile_bytecode()

    return WithLibrary


InnerCompiler = _compiler(InnerLibrary)
OuterCompiler = _compiler(OuterLibrary)
