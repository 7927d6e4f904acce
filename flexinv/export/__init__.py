"""Inverse dynamics as a C library: the kernels that Python calls as objects, and the memory that they work on as data."""
