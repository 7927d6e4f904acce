"""Compiled code and its algebra: Numba and its machine code on disk, threads, 3-vectors, rotations, solvers."""
