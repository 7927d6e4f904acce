"""
From a log to torques with bands
================================

Run A of a KUKA KR 300 is a public log of an industrial arm (MIT licence beside it): motor angles and motor torques. Most
of it identifies masses, inertias and friction; the rest is predicted, with bands, and compared with what was measured.
"""

# %%
import matplotlib.pyplot as plt

import crosscheck
from crosscheck.identification.logs.log import read_log

log = "models/kuka_kr300/run_A.csv.gz"
found = crosscheck.identify(
    "models/kuka_kr300", [f"{log}@0:6.9"], hold_out=[f"{log}@6.9:8.2"]
)
found

# %%
# The first three axes on the part that identified nothing. Grey: measured; blue: predicted, with 90 % bands.

held = read_log(f"{log}@6.9:8.2")
told = found.predict(held)
figure, rows = plt.subplots(3, 1, figsize=(9, 6), sharex=True, layout="constrained")
for k, axes in enumerate(rows):
    column = held.columns[f"axis{k + 1}_motor_torque_Nm"]
    axes.plot(held.time, column, color="0.7", linewidth=0.8)
    axes.plot(told.time, told.value[:, k], "C0")
    axes.fill_between(
        told.time, told.low[:, k], told.high[:, k], color="C0", alpha=0.25
    )
    axes.set(ylabel=f"axis {k + 1} [N m]")
rows[-1].set(xlabel="time [s]")
