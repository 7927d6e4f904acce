"""The walking of models/walker: paths of hips, torso and feet in closed form, joint angles by inverse kinematics.

Running this file writes models/walker/gait.csv; tests/test_walker.py says that the file there is what it writes.  All paths
are polynomials whose first five derivatives vanish where they begin and end: feet land and lift without velocity or
acceleration, splines through the samples stay smooth across the switches.  Slow enough for a real floor: it never
has to pull, and the centres of pressure stay under the feet.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexinv.typing import Array

HEIGHT = 1.75  # of the person [m]
THIGH, SHANK, ANKLE = 0.245 * HEIGHT, 0.246 * HEIGHT, 0.039 * HEIGHT  # lengths, height of the ankle over the sole [m]
JOINTS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle"))
STEP, END = 0.005, 2.8  # [s]
# Lifts and lands: [s]; from and to: along the floor [m].
SWINGS = {"right": (0.5, 1.3, -0.25, 0.30), "left": (1.5, 2.3, 0.0, 0.55)}
CLEARANCE = 0.06  # of the swinging foot [m]
HIPS = (0.02, 0.36)  # from, to [m]
HIP_HEIGHT, DIP = 0.87, 0.01  # [m]
LEAN = 0.08  # [rad]
CSV = Path(__file__).resolve().parents[2] / "models" / "walker" / "gait.csv"


def soft(s: Array) -> Array:
    """From 0 to 1 with five derivatives zero at both ends, constant outside."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**6 * (462 - 1980 * s + 3465 * s**2 - 3080 * s**3 + 1386 * s**4 - 252 * s**5))


def foot(side: str, time: Array) -> Array:
    """Where the sole under the ankle is, (samples, 2) [m]: along the floor and over it."""
    lifts, lands, start, end = SWINGS[side]
    done = soft((time - lifts) / (lands - lifts))
    return np.stack([start + done * (end - start), 4 * CLEARANCE * done * (1 - done)], axis=1)


def torso(time: Array) -> Array:
    """Hips and lean of the torso, (samples, 3) [m], [m], [rad]; leaning forward is negative."""
    done = soft(time / END)
    bump = 4 * done * (1 - done)
    return np.stack([HIPS[0] + done * (HIPS[1] - HIPS[0]), HIP_HEIGHT - DIP * bump, -LEAN * bump], axis=1)


def angles(time: Array) -> Array:
    """Angles of JOINTS, (samples, 6) [rad], by the law of cosines; the knees bend backward, the feet stay flat."""
    body, out = torso(time), []
    for side in ("left", "right"):
        leg = foot(side, time) + np.array([0.0, ANKLE]) - body[:, :2]
        reach = np.hypot(*leg.T)
        knee = -np.arccos((reach**2 - THIGH**2 - SHANK**2) / (2 * THIGH * SHANK))
        thigh = np.arctan2(leg[:, 1], leg[:, 0]) - np.arctan2(SHANK * np.sin(knee), THIGH + SHANK * np.cos(knee))
        hip = thigh + np.pi / 2 - body[:, 2]  # a hip at zero lets the leg hang along the torso
        out += [hip, knee, -(body[:, 2] + hip + knee)]
    return np.stack(out, axis=1)


def rows() -> list[str]:
    """Lines of the file, times [s] and angles [rad]."""
    time = np.arange(round(END / STEP) + 1, dtype=np.float64) * STEP
    head = ",".join(["time_s", *(f"{name}_rad" for name in JOINTS)])
    return [
        head,
        *(f"{t:.10g}," + ",".join(repr(float(a)) for a in q) for t, q in zip(time, angles(time), strict=True)),
    ]


if __name__ == "__main__":
    CSV.write_text("\n".join(rows()) + "\n", encoding="utf-8")
