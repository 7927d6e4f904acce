"""
How fast
========

Torques of a thousand and of a hundred thousand states of a UR5, and one cycle of a controller.
"""

# %%
import time

import matplotlib.pyplot as plt
import numpy as np

import flexinv

ur5 = flexinv.load_mechanism("models/ur5")
function = flexinv.prepare(ur5)
rng = np.random.default_rng(0)


def least(call, repeat=7):
    """Return the least time of several calls [s]: what else the machine does only adds to it."""
    times = []
    for _ in range(repeat):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return min(times)


counts, per_sample = (100, 1_000, 10_000, 100_000), []
for count in counts:
    q, qd, qdd = rng.uniform(-1, 1, (3, count, 6))
    tau = np.empty((count, 6))
    per_sample.append(
        least(
            lambda q=q, qd=qd, qdd=qdd, tau=tau: function.torques(q, qd, qdd, out=tau)
        )
        / count
    )

figure, axes = plt.subplots(figsize=(6, 3.4), layout="constrained")
axes.loglog(counts, [1e9 * t for t in per_sample], "o-")
axes.set(
    xlabel="samples in a call",
    ylabel="time of one sample [ns]",
    title="inverse dynamics of a UR5 on this machine",
)
axes.grid(alpha=0.3)

one, out = rng.uniform(-1, 1, (3, 6)), np.empty(6)
print(f"one sample by itself: {1e6 * least(lambda: function.sample(*one, out)):.1f} us")
