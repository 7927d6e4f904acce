"""Kinds of connection between a node and its parent, as numbers for kernels."""

from __future__ import annotations

RIGID, REVOLUTE, PRISMATIC, SPHERICAL, FREE, SECTION, CONTINUOUS = range(7)
