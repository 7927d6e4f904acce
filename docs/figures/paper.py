"""Draw the figures of the paper anew: ``python docs/figures/paper.py 6`` writes paper_6.png and paper_6.csv beside itself.

Several numbers draw several figures, none draws all.  What the paper states of a figure is printed beside what comes out.
"""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable

import numpy as np
from make_figures import ONE, ROOT, STEP, TWO, save, solved, stroboscope, torques
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import flexinv
from flexinv import Solution
from flexinv.typing import Array

STEPS = (10, 20, 50, 100)  # in the second of figure 3
CALLS = 2000  # of each scheme in figure 4
SHARES = np.linspace(0.01, 0.99, 99)


def rigid_arm() -> tuple[flexinv.Mechanism, flexinv.Motion]:
    """The paper's example 1: three rigid links in a vertical plane, 1 s."""
    arm = flexinv.load_mechanism(ROOT / "models" / "rigid_3r")
    return arm, flexinv.load_cases(ROOT / "models" / "rigid_3r", arm)["cycloid"].motion


def rigid_link() -> Solution:
    """Example 3 with a rigid link."""
    return flexinv.solve(flexinv.load_mechanism(ROOT / "models" / "rigid_one_link"), ONE, STEP)


def accuracy() -> tuple[Figure, str]:
    """Figure 3: torques of the exact equation, and of the incremental scheme at 10 to 100 steps a second."""
    arm, motion = rigid_arm()
    exact = flexinv.solve(arm, motion, 1e-3)
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    panels = figure.subplots(1, 3)
    errors = []
    for steps in STEPS:
        found = flexinv.solve(arm, motion, 1 / steps, incremental=True)
        errors.append(abs(found.torque - exact.torque[:: 1000 // steps]).max() / np.ptp(exact.torque))
        for k, axes in enumerate(panels):
            axes.plot(found.time, found.torque[:, k], linewidth=0.9, label=f"{steps} steps")
    for k, axes in enumerate(panels):
        axes.plot(exact.time, exact.torque[:, k], "k--", linewidth=1.2, label="exact")
        axes.set(xlabel="time [s]", ylabel="torque [N m]", title=exact.torque_names[k])
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize="small")
    told = ", ".join(f"{error:.1e} at {steps}" for steps, error in zip(STEPS, errors, strict=True))
    return figure, f"largest error over the range: {told} steps a second; the paper: 50 to 100 suffice"


def timing() -> tuple[Figure, str]:
    """Figure 4: the time of one instant by the nodal scheme and by the recursion over bodies, on this machine."""
    arm, motion = rigid_arm()
    call, out = flexinv.prepare(arm), np.empty(3)
    state = [np.ascontiguousarray(part[0]) for part in motion.evaluate(arm, np.array([0.3]))]
    rows = [part[None] for part in state]
    taken = {
        "P = M (a - g), tau = L T P": list_times(lambda: call.nodal(*rows)),
        "recursion over bodies": list_times(lambda: call.sample(*state, out)),
    }
    figure, axes = empty()
    for name, times in taken.items():
        axes.semilogx(times, SHARES, linewidth=1.2, label=name)
    axes.set(xlabel="time of one instant, called from Python [µs]", ylabel="share of calls that take less [-]")
    axes.legend(fontsize="small")
    parts = ", ".join(f"{name} {np.median(times):.3g} µs" for name, times in taken.items())
    return figure, f"medians: {parts}; the paper: far below a sampling time of 10 ms"


def list_times(call: Callable[[], object]) -> Array:
    """Times of a call [µs] that `SHARES` of many calls do not exceed."""
    times = []
    for _ in range(CALLS):
        begin = clock.perf_counter()
        call()
        times.append(clock.perf_counter() - begin)
    return np.quantile(1e6 * np.array(times), SHARES)


def one_link_path() -> tuple[Figure, str]:
    """Figure 5: a flexible link turns by 180 degrees in 0.2 s."""
    found = solved("flex_one_link", ONE)
    figure = Figure(figsize=(5, 3.4), layout="constrained")
    stroboscope(figure.add_subplot(), found, until=0.2, every=0.02)
    return figure, f"largest deflection of the tip {1e3 * abs(found.deflection['link']).max():.1f} mm"


def one_link_torque() -> tuple[Figure, str]:
    """Figure 6: the torque of the joint, rigid and flexible."""
    found, rigid = solved("flex_one_link", ONE), rigid_link()
    figure, axes = empty()
    torques(axes, found, rigid)
    rest = found.time >= 0.2 - STEP / 2
    period = 2 * float(np.diff(found.time[rest][crossings(found.torque[rest, 0])]).mean())
    mode = 1 / flexinv.natural_modes(found.mechanism, count=1).frequency[0]
    peaks = f"peaks {abs(found.torque).max():.4f} and {abs(rigid.torque).max():.4f} N m (rigid)"
    return (
        figure,
        f"{peaks}; period after the motion {period:.4f} s, of the first mode {mode:.5f} s; the paper: 0.0998 s",
    )


def crossings(values: Array) -> Array:
    """Samples before which a signal changes its sign."""
    return np.flatnonzero(np.diff(np.sign(values)))


def one_link_axial() -> tuple[Figure, str]:
    """Figure 7: the axial force at the root of the link, positive in tension; the paper's is that of the root element."""
    figure, axes = empty()
    peaks = []
    for name, found in (("flexible", solved("flex_one_link", ONE)), ("rigid", rigid_link())):
        force = -found.wrench["hub"][:, 0]
        axes.plot(found.time, force, "--" if name == "rigid" else "-", linewidth=1.2, label=name)
        peaks.append(f"{name} {force.max():.2f} N")
    axes.set(xlabel="time [s]", ylabel="axial force at the root [N]")
    axes.legend(fontsize="small")
    return figure, f"largest tension: {', '.join(peaks)}"


def two_link_path() -> tuple[Figure, str]:
    """Figure 8: two links of different stiffness."""
    found = solved("flex_two_link", TWO)
    figure = Figure(figsize=(5, 3.8), layout="constrained")
    stroboscope(figure.add_subplot(), found, until=0.2, every=0.04)
    bent = ", ".join(f"{link} {1e3 * abs(values).max():.1f} mm" for link, values in found.deflection.items())
    return figure, f"largest deflection: {bent}; the paper: link 2, which is softer, bends more"


def two_link_angles() -> tuple[Figure, str]:
    """Figure 9: the angle of each link from its root to its tip, whose vibration the paper shows; dashed that of the joint."""
    found = solved("flex_two_link", TWO)
    figure, axes = empty()
    root, turned = np.zeros(2), np.zeros(len(found.time))
    swing = []
    for k, (link, tip) in enumerate(found.tip.items()):
        chord = np.unwrap(np.arctan2(*(tip[:, :2] - root).T[::-1]))
        turned = turned + found.q[:, k]
        axes.plot(found.time, chord, color=f"C{k}", linewidth=1.2, label=link)
        axes.plot(found.time, turned, "--", color=f"C{k}", linewidth=0.9, label=f"{link}, rigid")
        swing.append(f"{link} {abs(chord - turned)[found.time >= 0.2].max():.3f} rad")
        root = tip[:, :2]
    axes.set(xlabel="time [s]", ylabel="angle from the x axis [rad]")
    axes.legend(fontsize="small")
    return figure, f"swing after the motion: {', '.join(swing)}"


def two_link_torque() -> tuple[Figure, str]:
    """Figure 10: the torques of both joints."""
    found = solved("flex_two_link", TWO)
    figure, axes = empty()
    torques(axes, found, None)
    peaks = ", ".join(
        f"{name} {peak:.4f} N m" for name, peak in zip(found.torque_names, abs(found.torque).max(0), strict=True)
    )
    return figure, f"peaks: {peaks}; modes of both links are superposed, as the paper says"


def empty() -> tuple[Figure, Axes]:
    """A figure with one panel."""
    figure = Figure(figsize=(6.5, 3.2), layout="constrained")
    axes = figure.add_subplot()
    axes.grid(alpha=0.3)
    return figure, axes


FIGURES: dict[int, Callable[[], tuple[Figure, str]]] = {
    3: accuracy,
    4: timing,
    5: one_link_path,
    6: one_link_torque,
    7: one_link_axial,
    8: two_link_path,
    9: two_link_angles,
    10: two_link_torque,
}

if __name__ == "__main__":
    wrong = [word for word in sys.argv[1:] if not word.isdigit() or int(word) not in FIGURES]
    if wrong:
        sys.exit(f"figure {wrong[0]!r}: expected numbers of {', '.join(map(str, FIGURES))}, or nothing for all of them")
    for number in map(int, sys.argv[1:]) if len(sys.argv) > 1 else FIGURES:
        drawn, words = FIGURES[number]()
        save(drawn, f"paper_{number}")
        print(f"figure {number}: {words}")
