"""Logs of the arm of `logged_arm` whose drives have more than Coulomb and viscous friction."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import logged_arm
import numpy as np
from scipy.interpolate import CubicSpline

from crosscheck.identification.drives.evidence import Terms, build_terms
from crosscheck.identification.estimation.days import fit_days
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log
from crosscheck.identification.readings import make_run
from crosscheck.identification.responses.response import remove_rotors_and_friction
from flexinv.files.load_mechanism import load_mechanism
from flexinv.rigid.joint_torques import joint_torques
from flexinv.typing import Array

JOINTS = ("shoulder", "elbow")
More = Callable[[Array, Array, Array, Array], Array]


def make_log(folder: Path, more: More | None = None, seed: int = 0, seconds: float = 8.0, noise: float = 0.05) -> Log:
    """Return a log [s, rad, N m] of the true arm.

    more : further efforts (samples, joints) [N m] of angle, rate, acceleration and load (samples, joints)
    """
    frame = logged_arm.frame(folder, seed, seconds, noise)
    columns = {name: frame[name].to_numpy() for name in ("q1", "q2", "t1", "t2")}
    time = frame["time_s"].to_numpy()
    if more is not None:
        spline = CubicSpline(time, np.column_stack([columns["q1"], columns["q2"]]))
        q, qd, qdd = (spline(time, order) for order in range(3))
        truth = load_mechanism(logged_arm.write_arm(folder / "truth", logged_arm.TRUTH))
        load = joint_torques(remove_rotors_and_friction(truth, JOINTS), q, qd, qdd)
        efforts = more(q, qd, qdd, load)
        columns |= {"t1": columns["t1"] + efforts[:, 0], "t2": columns["t2"] + efforts[:, 1]}
    return Log(f"seed {seed}", time, columns)


def fit_log(folder: Path, log: Log, text: str = logged_arm.IDENTIFY) -> Terms:
    """Return the residuals [-] of a log under the parameters of the arm that it tells; no interval is asked for."""
    logged_arm.write_arm(folder)
    (folder / "identify.toml").write_text(text, encoding="utf-8")
    machine = read_machine(folder)
    return build_terms(*fit_days(machine, [make_run(machine, log)], ["today"], "files"))
