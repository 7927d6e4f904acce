"""
A measured arm
==============

Quanser's two-link flexible arm was recorded while it moved: motor angles, motor currents, strain gauges (20 s, public,
MIT). Does a model with beams explain what its rigid twin does not?
"""

# %%
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import flexinv

figure, axes = plt.subplots(2, 1, figsize=(9, 5), sharex=True, layout="constrained")
for name, style in (("quanser_2dsfl", "-"), ("quanser_2dsfl_rigid", "--")):
    folder = f"models/{name}"
    arm = flexinv.load_mechanism(folder)
    case = next(iter(flexinv.load_cases(folder, arm).values()))
    solution = flexinv.solve(
        arm,
        case.motion,
        case.step,
        end=case.end,
        initial=case.initial,
        start=case.start,
    )
    measured = pd.read_csv(f"{folder}/measured.csv")
    for row, joint in zip(axes, ("shoulder", "elbow"), strict=True):
        label = f"torque/{joint} [N m]"
        k = next(
            k for k, one in enumerate(solution.torque_names) if one.startswith(joint)
        )
        seen = measured[label].to_numpy()
        at = measured["time [s]"].to_numpy()
        model = np.interp(at, solution.time, solution.torque[:, k])
        explained = 1 - ((seen - model) ** 2).sum() / ((seen - seen.mean()) ** 2).sum()
        if style == "-":
            row.plot(at, seen, color="0.6", linewidth=2.5, label="measured")
        row.plot(
            at,
            model,
            f"C0{style}" if style == "-" else f"C1{style}",
            label=f"{name}: {100 * explained:.1f} % explained",
        )
        row.set(ylabel=label)
        row.legend(fontsize="small")
axes[1].set(xlabel="time [s]")
