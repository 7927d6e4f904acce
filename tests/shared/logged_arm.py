"""A small arm with known truth, and logs of it: what identification must find."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from flexinv.files.load_mechanism import load_mechanism
from flexinv.rigid.joint_torques import joint_torques
from flexinv.typing import Array

MECHANISM = """title = "two links"
source = "test"
gravity_m_per_s2 = [0, 0, -9.81]
[links.upper]
kind = "rigid"
mass_kg = {upper}
com_m = [0.2, 0, 0]
inertia_kgm2 = {{ xx = 0.02, yy = 0.1, zz = 0.1 }}
[links.fore]
kind = "rigid"
mass_kg = {fore}
com_m = [0.15, 0.02, 0]
inertia_kgm2 = {{ xx = 0.01, yy = 0.04, zz = 0.04 }}
[joints.shoulder]
kind = "revolute"
parent = "world"
child = "upper"
axis = [0, 1, 0]
rotor_inertia_kgm2 = 0.3
damping_Nms_per_rad = {viscous}
friction_Nm = 2.0
[joints.elbow]
kind = "revolute"
parent = "upper"
child = "fore"
placement = {{ xyz_m = [0.4, 0, 0] }}
axis = [0, 1, 0]
rotor_inertia_kgm2 = 0.1
damping_Nms_per_rad = 1.0
friction_Nm = 1.0
"""
IDENTIFY = """bandwidth_Hz = 10
still_rad_per_s = 0.02
block_s = 1.0
least_radius_m = 0.01
[joints.shoulder]
angle = { column = "q1" }
effort = { column = "t1" }
[joints.elbow]
angle = { column = "q2" }
effort = { column = "t2" }
[[free]]
parameter = "mass properties"
relative = 0.3
[[free]]
parameter = "viscous friction"
relative = 0.5
[[free]]
parameter = "coulomb friction"
relative = 0.5
[[free]]
parameter = "effort offset"
error = 0.5
"""
TRUTH = {"upper": 5.0, "fore": 3.0, "viscous": 4.0}
KNOWN = {"upper": 6.0, "fore": 2.4, "viscous": 3.0}


def write_arm(folder: Path, numbers: dict[str, float] | None = None, text: str = MECHANISM) -> Path:
    """Write mechanism and identify.toml of the arm as somebody knows it [kg], [N m s/rad]; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "mechanism.toml").write_text(text.format(**(KNOWN if numbers is None else numbers)), encoding="utf-8")
    (folder / "identify.toml").write_text(IDENTIFY, encoding="utf-8")
    return folder


def frame(
    folder: Path, seed: int = 0, seconds: float = 8.0, noise: float = 0.05, text: str = MECHANISM
) -> pd.DataFrame:
    """Return a log [s, rad, N m] of the true arm on a motion of four harmonics, with noise on the torques."""
    truth = load_mechanism(write_arm(folder / "truth", TRUTH, text))
    random, time = np.random.default_rng(seed), np.arange(0.0, seconds, 0.004)
    q, qd, qdd = np.zeros((3, len(time), 2))
    for k in range(2):
        for harmonic in range(1, 5):
            w, size, phase = 0.25 * np.pi * harmonic, random.uniform(0.1, 0.4), random.uniform(0, 2 * np.pi)
            q[:, k] += size * np.sin(w * time + phase)
            qd[:, k] += size * w * np.cos(w * time + phase)
            qdd[:, k] -= size * w * w * np.sin(w * time + phase)
    rigid = joint_torques(truth, q, qd, qdd, passive=False)
    law = np.array([[TRUTH["viscous"], 1.0], [2.0, 1.0]])
    torque = rigid + law[0] * qd + law[1] * np.tanh(qd / 0.02)
    torque += noise * random.normal(size=torque.shape)
    return pd.DataFrame({"time_s": time, "q1": q[:, 0], "q2": q[:, 1], "t1": torque[:, 0], "t2": torque[:, 1]})


def jitter(time: Array, seed: int) -> Array:
    """Return the times [s] of which 40 % are off by up to 30 % of a step, and 2 % are missing."""
    random = np.random.default_rng(seed)
    step = time[1] - time[0]
    off = np.where(random.random(len(time)) < 0.4, random.uniform(-0.3, 0.3, len(time)) * step, 0.0)
    there = random.random(len(time)) > 0.02
    off[[0, -1]], there[[0, -1]] = 0.0, True
    return np.asarray((time + off)[there])
