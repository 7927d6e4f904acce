"""How a node hangs on its parent, as numbers that kernels know."""

from __future__ import annotations

RIGID, REVOLUTE, PRISMATIC, SPHERICAL, FREE, SECTION, CONTINUOUS = range(7)
