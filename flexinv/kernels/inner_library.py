"""Kernels within kernels: text for the machine's compiler, linked once into each kernel that Python calls.

Numba optimises and translates every function by itself, with all that it calls taken in: of a chain of ten calls the last one
ten times.  A kernel that Python never calls needs no machine code.  It stays as it was lowered; what Python calls links all of
them, however deep, and is optimised and translated as one module.  There nobody else can call them, and the machine's compiler
knows it: a kernel with one caller is taken in, others where they are small (`internal`).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from numba.core.codegen import JITCodeLibrary

# What is promised of a record: nobody writes there while the kernel runs, and its address is not kept.
PROMISES = "noalias", "captures(none)"
# Loops over lanes are long, and take vectors of 512 bits where the processor has them.  For some (Intel's server processors,
# and x86-64-v4, for which wheels bring code) LLVM prefers 256: a batch of Panda's torques then takes 62.6 ns a sample instead of
# 45.5 (Emerald Rapids; with code for x86-64-v4 47.8 instead of 29.7 on a Zen 5).
WIDE = '"prefer-vector-width"="512"'


class KernelLibrary(JITCodeLibrary):
    """The lowered text of one kernel; records : how the text calls those of its arguments that are addresses of records.

    over_lanes : whether it loops over lanes; stays_apart : whether it is taken into no caller for being the only one
    """

    records: frozenset[str] = frozenset()
    over_lanes = False
    stays_apart = False

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
                        for promise in PROMISES:
                            argument.add_attribute(promise)
        super().add_ir_module(ir_module)


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
