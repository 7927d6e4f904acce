"""Numba behind one seam: the decorators of kernels and the types of records, with Numba's private parts or without them.

A compiler, a cache and types of our own (`kernel_compiler`, `code_cache`, `record_types`) halve the time of compilation and make
kernels faster.  They subclass what Numba keeps for itself, which any version of it may change.  So `choice` compiles one small
kernel and holds its number against Python's before any other kernel is made, once for each version of Numba and of our sources.
Where a name is gone or the number is wrong, kernels are compiled by what Numba promises to everybody (`plain`): that takes
longer, runs slower, gives the same numbers, and is said once.  ``FLEXINV_PLAIN_NUMBA=1`` in the environment asks for it.
"""
