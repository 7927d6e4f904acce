"""
Bring your own engine
=====================

A case kit says everything about one comparison to a program that has never heard of crosscheck; values on which engines of
two authors agree say whether its answer is right. Here the engine is a page of NumPy. The tutorial "Bring your own engine"
goes on with other languages.
"""

# %%
# A corpus of one case: its kit, and the interval in which the error bars of flexinv and Pinocchio meet.

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

folder = Path(tempfile.mkdtemp())
crosscheck = [sys.executable, "-m", "crosscheck"]
case = [
    "corpus",
    "double_pendulum/swing",
    "--engines",
    "flexinv,pinocchio",
    "--out",
    folder / "corpus",
]
subprocess.run(crosscheck + case, check=True, capture_output=True)
kit = folder / "corpus" / "kits" / "double_pendulum-swing"
print(
    *sorted(
        path.relative_to(kit).as_posix() for path in kit.rglob("*") if path.is_file()
    ),
    sep="\n",
)

# %%
# The engine knows one formula, two rods in a plane. It is a program of its own, reads two files of the kit, and writes one.

ENGINE = """
import sys
import numpy as np
import pandas as pd

kit, out = sys.argv[1:]
upper, lower = (row for _, row in pd.read_csv(f"{kit}/tree.csv").iterrows())
time, q1, q2, v1, v2, a1, a2 = pd.read_csv(f"{kit}/motion.csv").to_numpy().T
length, g = lower["px [m]"], -upper["gravity z [m/s^2]"]
m1, c1, i1 = upper[["mass [kg]", "cx [m]", "Iyy [kg m^2]"]]
m2, c2, i2 = lower[["mass [kg]", "cx [m]", "Iyy [kg m^2]"]]

couple, swing = m2 * length * c2 * np.cos(q2), m2 * length * c2 * np.sin(q2)
m22 = i2 + m2 * c2**2
m12 = m22 + couple
m11 = i1 + m1 * c1**2 + m2 * length**2 + m22 + 2 * couple
weight = m2 * c2 * g * np.sin(q1 + q2)
knee = m12 * a1 + m22 * a2 + swing * v1**2 + weight
pivot = m11 * a1 + m12 * a2 - swing * (2 * v1 + v2) * v2 + (m1 * c1 + m2 * length) * g * np.sin(q1) + weight
table = {"time [s]": time, "torque/pivot [N m]": pivot, "torque/knee [N m]": knee}
pd.DataFrame(table).to_csv(f"{out}/series.csv", index=False)
"""

answers = folder / "answers"
(answers / kit.name).mkdir(parents=True)
(folder / "engine.py").write_text(ENGINE)
subprocess.run(
    [sys.executable, folder / "engine.py", kit, answers / kit.name], check=True
)

# %%
# The corpus judges the answer from its own files: no engine runs.

judge = ["corpus", "--judge", answers, "--against", folder / "corpus"]
print(
    subprocess.run(
        crosscheck + judge, check=True, capture_output=True, text=True
    ).stdout
)

# %%
# The torques, and below them how far the answer is from the middle of the consensus, against its half-width (dashed).

answer = pd.read_csv(answers / kit.name / "series.csv")
consensus = pd.read_csv(kit / "expected" / "series.csv")
figure, (above, below) = plt.subplots(
    2, 1, figsize=(9, 5), sharex=True, layout="constrained"
)
for name, colour in (("torque/pivot", "C0"), ("torque/knee", "C1")):
    mine, middle, half = (
        answer[f"{name} [N m]"],
        consensus[f"{name} [N m]"],
        consensus[f"{name} error [N m]"],
    )
    above.plot(answer["time [s]"], mine, colour, label=name)
    below.semilogy(answer["time [s]"], abs(mine - middle).clip(lower=1e-18), colour)
    below.semilogy(answer["time [s]"], half, f"{colour}--")
above.set(ylabel="torque [N m]")
above.legend()
below.set(xlabel="time [s]", ylabel="difference [N m]", ylim=(1e-18, None))
