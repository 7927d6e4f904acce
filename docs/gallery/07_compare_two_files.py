"""
Compare two files of one robot
==============================

Do two descriptions say the same robot? Here the second one is a copy of a UR5's URDF in which somebody has changed a
mass and forgotten a sign. ``crosscheck.compare`` names both, with place, size and unit, and proves it: put into the first
file they give the second's torques.
"""

# %%
import re
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import crosscheck
import flexinv

first = flexinv.load_mechanism("models/ur5").urdf
text = first.read_text()

mass = text.index('<mass value="', text.index('<link name="forearm_link">'))
axis = text.index('<axis xyz="', text.index('<joint name="elbow_joint"'))
changed = text[:mass] + re.sub(r'"[^"]+"', '"3.2"', text[mass:], count=1)
axis += len(changed) - len(text) if mass < axis else 0
changed = changed[:axis] + re.sub(r'"[^"]+"', '"0 -1 0"', changed[axis:], count=1)
second = Path(tempfile.mkdtemp()) / "ur5_copy.urdf"
second.write_text(changed)

result = crosscheck.compare(first, second)
assert not result.equal
result

# %%
# The robot against itself is equal.

assert crosscheck.compare(first, first).equal

# %%
# The two differences, as sizes.

table = result.frame()[["cause", "place", "size", "unit"]]
figure, axes = plt.subplots(figsize=(8, 0.6 + 0.4 * len(table)), layout="constrained")
axes.axis("off")
cells = [
    [f"{cell:.4g}" if isinstance(cell, float) else str(cell)[:60] for cell in row]
    for row in table.to_numpy()
]
axes.table(cells, colLabels=list(table.columns), loc="center")
