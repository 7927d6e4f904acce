"""Answer a case kit of one flexible link on a revolute joint, in a plane and without gravity, with nothing but numpy.

    python beam.py KIT OUT

The beam is a chain of rigid rods with springs between them: EI / dx at the joints of the chain, 2 EI / dx at the clamped end.
Its angles theta are those of the rods in the plane; integrated by Runge and Kutta's method of order 4.  The error falls with
dx^2: two chains give the extrapolated torque, their difference its error bar.
"""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np

COUNT = 12  # rods of the fine chain; one with 16 is stiffer than steps of 1e-4 s allow


def chain(beam, time, q, v, count):
    """Torque of the hub [N m] and tip (x, y) [m] at all times; q, v : angle [rad] and rate [rad/s] of the hub."""
    section, dx = beam["section"], beam["length"] / count
    rho, ei = section["rho_A"][0], section["EI_z"][0]
    m, i = rho * dx, section["rho_I_z"][0] * dx + rho * dx**3 / 12.0
    # Centre of rod k: sum of dx of all before, half of its own: M_jk = dx^2 w_jk cos(theta_j - theta_k), w from these arms.
    arms = np.tril(np.ones((count, count)), -1) + 0.5 * np.eye(count)
    w = m * dx**2 * arms.T @ arms
    k = np.full(count, ei / dx)
    k[0] = 2.0 * ei / dx

    def rate(state, hub):
        theta, omega = state
        bend = k * (theta - np.concatenate([[hub], theta[:-1]]))
        moment = -bend + np.concatenate([bend[1:], [0.0]])
        difference = theta[:, None] - theta[None, :]
        mass = w * np.cos(difference) + i * np.eye(count)
        return np.array([omega, np.linalg.solve(mass, moment - (w * np.sin(difference)) @ omega**2)])

    state = np.zeros((2, count))
    h = time[1] - time[0]
    middle = 0.5 * (q[1:] + q[:-1]) + h / 8.0 * (v[:-1] - v[1:])
    torque, tip = [], []
    for n in range(len(time)):
        torque.append(k[0] * (q[n] - state[0][0]))
        tip.append(dx * np.array([np.cos(state[0]).sum(), np.sin(state[0]).sum()]))
        if n + 1 < len(time):
            a = rate(state, q[n])
            b = rate(state + 0.5 * h * a, middle[n])
            c = rate(state + 0.5 * h * b, middle[n])
            state = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(state + h * c, q[n + 1]))
    return np.array(torque), np.array(tip)


def answer(kit, out):
    data = json.loads((kit / "case.json").read_text())
    case, mechanism = data["case"], data["mechanism"]
    (link,), (joint,) = mechanism["links"], mechanism["joints"]
    assert joint["kind"] == "revolute"
    assert not any(mechanism["gravity"])
    with (kit / "motion.csv").open() as stream:
        _, *rows = list(csv.reader(stream))
    time, q, v = np.array(rows, dtype=float)[:, :3].T
    (coarse, tip0), (fine, tip1) = (chain(link["beam"], time, q, v, count) for count in (COUNT // 2, COUNT))
    torque, tip = (4.0 * fine - coarse) / 3.0, (4.0 * tip1 - tip0) / 3.0
    every = round(case["sample"] / case["step"])
    bar = np.abs(torque - fine).max()
    out.mkdir(exist_ok=True)
    with (out / "series.csv").open("w") as stream:
        name = joint["v"][0]
        heads = [f"torque/{name} [N m]", f"torque/{name} error [N m]", *(f"tip/{link['name']}/{c} [m]" for c in "xyz")]
        stream.write(",".join(["time [s]", *heads]) + "\n")
        for t, tau, (x, y) in zip(time[::every], torque[::every], tip[::every], strict=True):
            stream.write(",".join(repr(float(value)) for value in (t, tau, bar, x, y, 0.0)) + "\n")
    (out / "meta.json").write_text(json.dumps({"tool": "numpy", "case": data["digest"], "mesh": f"{COUNT} rods"}))


if __name__ == "__main__":
    answer(Path(sys.argv[1]), Path(sys.argv[2]))
