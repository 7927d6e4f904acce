"""Functions with more tokens or branches than the house allows, and why they stay; one that has shrunk comes off the list."""

from __future__ import annotations

# "path: function" -> reason
KEPT: dict[str, str] = {
    "flexinv/elements/planar_beam.py: _fill_block_gradients": "one loop over the lanes of a block, which is SIMD code as a whole",
    "flexinv/kinematics/tree.py: add_parent_variation": "the differential of one law, whose lines share vectors in registers",
}
