"""A one-link arm on an elastic hub, and its tip's exact inverse by frequency."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexinv.model.mechanism import Beam, Body, Inertia, Joint, Link, Mechanism, Section

LENGTH, DENSITY, BENDING, ROTOR, HUB = 0.7, 4.0, 0.6, 1.0, 100.0  # m, kg/m, N m^2, kg m^2, N m/rad


def beam(order: int, elements: int = 1, retardation: float = 0.0) -> Link:
    """The link, next to without shear and rotary inertia (1e-9 of its own); bending damped by a retardation time [s].

    GA of 1e9 N; 1e6 N where it is damped, EI / (GA L^2) = 1e-6: forces along a stiffer beam hide from Newton what bends.
    """
    rigid = 1e6 if retardation else 1e9
    stiffness = np.array([[rigid, rigid, rigid, BENDING, BENDING, BENDING]])
    damping = retardation * np.where(stiffness < rigid, stiffness, 0.0) if retardation else None
    section = Section(np.zeros(1), stiffness, np.array([DENSITY]), np.full((1, 3), 1e-9), damping=damping)
    return Link("link", beam=Beam(LENGTH, section, elements, order))


def hub_arm(order: int = 8, elements: int = 1, elastic: bool = True, retardation: float = 0.0) -> Mechanism:
    """Rotor, spring, beam."""
    rotor = Link("rotor", (Body("rotor", Inertia(1.0, np.zeros(3), ROTOR * np.eye(3))),))
    link = beam(order, elements, retardation)
    drive = Joint("drive", "revolute", "world", "rotor")
    hub = Joint("hub", "revolute" if elastic else "fixed", "rotor", "link", stiffness=HUB * elastic, actuated=False)
    return Mechanism("hub arm", (rotor, link), (drive, hub), gravity=np.zeros(3))


def torque_by_frequency(
    acceleration: NDArray[np.float64], h: float, elastic: bool = True, retardation: float = 0.0
) -> NDArray[np.float64]:
    """Torque (samples,) [N m] that gives the tip of the linear arm the acceleration (samples,) [m/s^2] of zero mean.

    rho w_tt + EI w'''' = 0 with w(0) = 0, EI w''(0) = k (w'(0) - theta) (or w'(0) = theta), w''(L) = w'''(L) = 0 and
    J theta_tt = tau + EI w''(0), term by term of the Fourier series: periodic, so bounded for all times.
    A damped beam has EI (1 + i omega retardation).
    """
    size = len(acceleration)
    omega = 2 * np.pi * np.fft.rfftfreq(size, h)
    spectrum = np.fft.rfft(acceleration)
    inertia = ROTOR + DENSITY * LENGTH**3 / 3
    gain = np.full(
        len(omega), inertia / LENGTH, dtype=complex
    )  # of the rigid arm, at rest: torque over acceleration of the tip
    for k, w in enumerate(omega[1:], 1):
        bending = BENDING * (1 + 1j * w * retardation)
        b = (DENSITY * w**2 / bending) ** 0.25
        if abs(b) * LENGTH > 15:  # 177 rad/s: the path holds nothing there, and exp(15) of rounding is still 1e-9
            gain[k] = 0.0
            continue
        cos, sin, cosh, sinh = (f(b * LENGTH) for f in (np.cos, np.sin, np.cosh, np.sinh))
        # w = A cos + B sin + C cosh + D sinh of b x, C = -A; the slope of the link at the hub is one
        rows = np.array([[-cos - cosh, -sin, sinh], [sin - sinh, -cos, cosh], [0.0, b, b]])
        a, s, d = np.linalg.solve(rows, [0.0, 0.0, 1.0])
        moment = bending * b**2 * -2 * a  # EI w''(0)
        theta = 1.0 - moment / HUB if elastic else 1.0
        tip = a * (cos - cosh) + s * sin + d * sinh
        gain[k] = (-ROTOR * w**2 * theta - moment) / (-(w**2) * tip)
    return np.fft.irfft(gain * spectrum, size)
