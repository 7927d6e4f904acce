"""Libraries of machine code: kernels that only others call are linked into them, and optimised there, once.

Numba optimises every function, makes machine code of it, and does both again in each of its callers.  Here a function that
Python cannot call stays in LLVM's language, simplified; machine code is made of the kernels that Python calls, each with all
that it calls as one text.  Arguments that nobody uses, such as the shape of an array whose data alone are read, are dropped.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from llvmlite import binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

SPEED = 3  # LLVM's level of optimisation, as Numba's


def _passes(codegen: Any) -> Any:
    """Return LLVM's pass builder [-]: loops in vectors, as Numba asks for by default."""
    options = llvm.create_pipeline_tuning_options(SPEED)
    options.loop_vectorization, options.slp_vectorization = True, False
    return llvm.create_pass_builder(codegen._tm, options)


class KernelLibrary(JITCodeLibrary):
    """A kernel that Python calls, with all that it calls."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Simplify functions as they come from Python [-]; the rest follows when the text is whole."""
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = llvm.create_new_function_pass_manager(), _passes(self._codegen)
        passes.add_sroa_pass()
        passes.add_simplify_cfg_pass()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def finalize(self) -> None:
        """Link every function that is called, directly or not, once, and make machine code [-]."""
        inner, others = _reached(self._linking_libraries)
        for library in inner:
            self._final_module.link_in(library.text, preserve=True)
        self._linking_libraries = others
        super().finalize()

    def _optimize_final_module(self) -> None:
        """Optimise the whole text [-], in which nothing but the kernel itself is seen from outside."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.linkonce_odr:
                function.linkage = llvm.Linkage.internal
        builder, first = _passes(self._codegen), llvm.create_new_module_pass_manager()
        first.add_global_dead_code_eliminate_pass()
        first.add_dead_arg_elimination_pass()
        first.add_ipsccp_pass()
        first.run(self._final_module, builder)
        builder.getModulePassManager().run(self._final_module, builder)


class InnerLibrary(KernelLibrary):
    """A kernel that other kernels call: text to be linked, never machine code."""

    @property
    def codegen(self) -> Any:
        """Return the code generator [-] for what has no address."""
        return _WithoutAddress(self._codegen)

    @property
    def text(self) -> Any:
        """Return the function [-] without those that it calls."""
        return self._final_module

    def finalize(self) -> None:
        """Let several callers have a copy each [-]; nothing else is done here."""
        self._raise_if_finalized()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = llvm.Linkage.linkonce_odr
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return the function with all that it calls [-], for a kernel of another library."""
        self._ensure_finalized()
        if self._shared_module is None:
            whole = self._final_module.clone()
            inner, others = _reached(self._linking_libraries)
            for part in [library.text for library in inner] + [library._get_module_for_linking() for library in others]:
                whole.link_in(part, preserve=True)
            self._shared_module = whole
        return self._shared_module

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0 [-]: there is none."""
        self._ensure_finalized()
        return 0


def _reached(libraries: Iterable[Any]) -> tuple[list[InnerLibrary], list[Any]]:
    """Inner libraries that are called from these, directly or by others of them, and the rest, each once."""
    ahead, inner, others = list(libraries), dict[InnerLibrary, None](), dict[Any, None]()
    while ahead:
        library = ahead.pop()
        if not isinstance(library, InnerLibrary):
            others[library] = None
        elif library not in inner:
            library._ensure_finalized()
            inner[library] = None
            ahead += library._linking_libraries
    return list(inner), list(others)


class _WithoutAddress:
    """A code generator that does not look for the environment of a kernel that Python cannot call."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def set_env(self, name: str, env: Any) -> None:
        """Do nothing [-]."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)


class KernelCompiler(Compiler):
    """Numba's compiler, with the library for kernels that Python calls."""

    library = KernelLibrary

    def compile_extra(self, function: Any) -> Any:
        """Compile a function into such a library [-]."""
        library = self.library(self.state.targetctx.codegen(), function.__qualname__)
        library.enable_object_caching()
        self.state.library = library
        return super().compile_extra(function)


class InnerCompiler(KernelCompiler):
    """The same for kernels that only other kernels call."""

    library = InnerLibrary
