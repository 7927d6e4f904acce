"""
Bring your own engine
=====================

An engine of your own is a module with four functions. This one knows a single formula, the torque of rigid pendulums in
a plane, and ``crosscheck conform`` says which rungs of its ladder that holds. The tutorial "Bring your own engine" goes
on with programs in other languages.
"""

# %%
# A case kit says everything about one comparison to a program that has never heard of crosscheck.

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

folder = Path(tempfile.mkdtemp())
subprocess.run(
    [sys.executable, "-m", "crosscheck", "kit", "double_pendulum", "--case", "swing", "--out", folder / "kit"],
    check=True,
)
print(*sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()), sep="\n")

# %%
# The mechanism is in ``case.json`` with every default written out, the motion in ``motion.csv``, and what flexinv
# found in ``expected``.

kit = next(folder.rglob("case.json")).parent
case = json.loads((kit / "case.json").read_text())
motion = pd.read_csv(kit / "motion.csv")
expected = pd.read_csv(next(kit.glob("expected/*.csv")))
print(case["format"], "-", ", ".join(motion.columns[:4]), "...")

# %%
# Any program may answer. Here is what it shall find.

torques = [name for name in expected.columns if name.startswith("torque/") and "error" not in name]
expected.plot(x="time [s]", y=torques, figsize=(9, 3), ylabel="torque [N m]", grid=True)
plt.tight_layout()
