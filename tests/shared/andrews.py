"""Andrews' squeezer by itself: the explicit planar equations of the IVP test set, integrated by scipy.

    M(q) a + G(q)^T lambda = f(q, v),   g(q) = 0,   q = beta, Theta, gamma, Phi, delta, Omega, epsilon

Source of equations, data and published values: W. M. Lioen, J. J. B. de Swart, Test Set for IVP Solvers, problem "Andrews'
squeezing mechanism" (after W. Schiehlen, Multibody Systems Handbook, 1990); tests/data/andrews.toml holds the numbers.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from itertools import pairwise
from math import cos, hypot, sin
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from flexinv.typing import Array

DATA: dict[str, Any] = tomllib.loads((Path(__file__).parents[1] / "data" / "andrews.toml").read_text(encoding="utf-8"))
P: dict[str, float] = DATA["parameters"]
NAMES = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")


def mass_matrix(q: Array) -> Array:
    """M(q), (7, 7)."""
    _, theta, _, phi, _, omega, _ = q.tolist()
    m = np.zeros((7, 7))
    arm, reach = P["e"] - P["ea"], P["zf"] - P["fa"]
    crossed = P["da"] * P["rr"] * cos(theta)
    m[0, 0] = P["m1"] * P["ra"] ** 2 + P["m2"] * (P["rr"] ** 2 - 2 * crossed + P["da"] ** 2) + P["I1"] + P["I2"]
    m[0, 1] = m[1, 0] = P["m2"] * (P["da"] ** 2 - crossed) + P["I2"]
    m[1, 1] = P["m2"] * P["da"] ** 2 + P["I2"]
    m[2, 2] = P["m3"] * (P["sa"] ** 2 + P["sb"] ** 2) + P["I3"]
    bent = P["zt"] * arm * sin(phi)
    m[3, 3] = P["m4"] * arm**2 + P["I4"]
    m[3, 4] = m[4, 3] = P["m4"] * (arm**2 + bent) + P["I4"]
    m[4, 4] = P["m4"] * (P["zt"] ** 2 + 2 * bent + arm**2) + P["m5"] * (P["ta"] ** 2 + P["tb"] ** 2) + P["I4"] + P["I5"]
    bent = P["u"] * reach * sin(omega)
    m[5, 5] = P["m6"] * reach**2 + P["I6"]
    m[5, 6] = m[6, 5] = P["m6"] * (reach**2 - bent) + P["I6"]
    m[6, 6] = (
        P["m6"] * (reach**2 - 2 * bent + P["u"] ** 2) + P["m7"] * (P["ua"] ** 2 + P["ub"] ** 2) + P["I6"] + P["I7"]
    )
    return m


def efforts(q: Array, v: Array) -> Array:
    """f(q, v), (7,): drive, velocity terms and spring."""
    _, theta, gamma, phi, _, omega, _ = q.tolist()
    b1, t1, _, p1, d1, o1, e1 = v.tolist()
    s, c = sin(gamma), cos(gamma)
    gap = P["sd"] * c + P["sc"] * s + P["xb"] - P["xc"], P["sd"] * s - P["sc"] * c + P["yb"] - P["yc"]
    length = hypot(*gap)
    pull = [-P["c0"] * (length - P["l0"]) / length * part for part in gap]
    arm, reach = P["e"] - P["ea"], P["zf"] - P["fa"]
    return np.array(
        [
            P["drive"] - P["m2"] * P["da"] * P["rr"] * t1 * (t1 + 2 * b1) * sin(theta),
            P["m2"] * P["da"] * P["rr"] * b1**2 * sin(theta),
            pull[0] * (P["sc"] * c - P["sd"] * s) + pull[1] * (P["sd"] * c + P["sc"] * s),
            P["m4"] * P["zt"] * arm * d1**2 * cos(phi),
            -P["m4"] * P["zt"] * arm * p1 * (p1 + 2 * d1) * cos(phi),
            -P["m6"] * P["u"] * reach * e1**2 * cos(omega),
            P["m6"] * P["u"] * reach * o1 * (o1 + 2 * e1) * cos(omega),
        ]
    )


def chains(q: Array) -> list[list[tuple[float, float, tuple[int, ...]]]]:
    """E of K2, K3, K4, K6 as sums of length (cos, sin) angle: (length, angle, which coordinates turn it)."""
    b, t, g, p, d, o, e = q.tolist()
    right = np.pi / 2
    return [
        [(P["rr"], b, (0,)), (-P["d"], b + t, (0, 1))],
        [(P["ss"], g - right, (2,))],
        [(P["zt"], d, (4,)), (P["e"], p + d - right, (3, 4))],
        [(P["u"], e - right, (6,)), (P["zf"], o + e, (5, 6))],
    ]


ROOTS = np.array([[0, 0], [P["xb"], P["yb"]], [P["xa"], P["ya"]], [P["xa"], P["ya"]]])


def constraints(q: Array, v: Array) -> tuple[Array, Array, Array]:
    """g (6,), G (6, 7) and G' v (6,): E of K2 less E of K3, of K4, of K6."""
    rates = v.tolist()
    points = []  # x, y, their slopes (7,) and bends of each E, in plain numbers: the integration asks tens of thousands of times
    for (x, y), chain in zip(ROOTS.tolist(), chains(q), strict=True):
        dx, dy, bx, by = [0.0] * 7, [0.0] * 7, 0.0, 0.0
        for length, angle, turned in chain:
            along, across = length * cos(angle), length * sin(angle)
            x, y = x + along, y + across
            for j in turned:
                dx[j], dy[j] = dx[j] - across, dy[j] + along
            square = sum(rates[j] for j in turned) ** 2
            bx, by = bx - square * along, by - square * across
        points.append([[x, *dx, bx], [y, *dy, by]])
    first, *others = np.array(points)
    g = (first - np.array(others)).reshape(6, 9)
    return g[:, 0], g[:, 1:8], g[:, 8]


def accelerations(q: Array, v: Array) -> tuple[Array, Array]:
    """a (7,) and lambda (6,)."""
    _, jacobian, bend = constraints(q, v)
    system = np.zeros((13, 13))
    system[:7, :7], system[:7, 7:], system[7:, :7] = mass_matrix(q), jacobian.T, jacobian
    both = np.linalg.solve(system, np.concatenate([efforts(q, v), -bend]))
    return both[:7], both[7:]


@dataclass(frozen=True)
class Series:
    """time (samples,) [s]; q, v, a (samples, 7); lam (samples, 6) [N]."""

    time: Array
    q: Array
    v: Array
    a: Array
    lam: Array


def series(end: float, samples: int) -> Series:
    """Integrate from the published start; every sample is an end of the integration, none is interpolated."""
    time = np.linspace(0, end, samples)
    state = np.concatenate([np.array(DATA["initial"]["q"]), np.zeros(7)])
    states = [state]

    def rate(_: float, y: Array) -> Array:
        return np.concatenate([y[7:], accelerations(y[:7], y[7:])[0]])

    for a, b in pairwise(time):
        state = solve_ivp(rate, (a, b), state, method="DOP853", rtol=1e-13, atol=1e-13, first_step=b - a).y[:, -1]
        states.append(state)
    y = np.array(states)
    forces = [accelerations(row[:7], row[7:]) for row in y]
    return Series(time, y[:, :7], y[:, 7:], np.array([f[0] for f in forces]), np.array([f[1] for f in forces]))
