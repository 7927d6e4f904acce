"""Alignment of two machines: which frame, zero and sign of B is which of A, and where B stands: what is told is shortest."""
