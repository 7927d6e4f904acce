"""Kernels with a compiler, a cache and types of our own, under the names by which `choice` knows them."""

from __future__ import annotations

from flexinv.kernels.compiler.arrays import make_array_kernel
from flexinv.kernels.compiler.code_cache import KERNELS, begin_runtime, make_jit_decorator, resolve_compiled
from flexinv.kernels.compiler.record_types import find_record_class, list_member_types, prepare_record_class, read_field
from flexinv.kernels.compiler.shipped_code import write_shipped

__all__ = [
    "KERNELS",
    "begin_runtime",
    "find_record_class",
    "list_member_types",
    "make_array_kernel",
    "make_jit_decorator",
    "prepare_record_class",
    "read_field",
    "resolve_compiled",
    "write_shipped",
]
