"""Natural frequencies of turning blades beside measured ones: python docs/studies/rotating_beams.py prints every row.

J. J. Epps, R. Chandra, *The natural frequencies of rotating composite beams with tip sweep*, J. AHS 41(1), 1996: a straight
blade of graphite, and blades of aluminium whose outer 6 inches are swept back, measured turning.  Numbers and sections as in
AeroBeams.jl (test/examples/straightRotor.jl) and GXBeam.jl (test/examples/rotating.jl); both follow Hodges, Shang, Cesnik,
AIAA 95-1174.  Those two judge more mildly than by the row: AeroBeams by the norm over the modes of a configuration, 5 %, at 750
rpm and 45 degrees; GXBeam by 10 % or 1 Hz a row.

The blades as stated are too soft and gain too little with the speed, at every sweep alike.  Two lengths of the mounting explain
that: how far the clamp holds the strip, and how far the hub holds the clamp from the axis.  They are identified on straight
blades, of graphite at 0 and 500 rpm, of aluminium without sweep; what is printed for other speeds and sweeps is predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import click
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexinv.linearized.steady_modes import SteadyModes, steady_modes
from flexinv.model.mechanism import WORLD, Beam, Joint, Link, Mechanism, Placement, Section

Array = NDArray[np.float64]
INCH, POUND = 0.0254, 4.4482216152605  # [m], [N]
RPM = 2 * np.pi / 60
ROOT = 2.5  # [in] from the axis to where the blade begins
# Rows within this part of the measured frequency.
WITHIN = 0.05
# Rotation [rad] for a displacement of 1 m: some wave numbers of the blade where it bends; a straight blade that twists displaces
# by rounding only.
TWIST = 1e3
# Rows that no strip can meet together: read as 1.4 Hz without sweep and as 1.8 Hz with 15 degrees, where the sweep changes the
# first mode at rest by less than 2 %.
UNREADABLE = {("aluminium", 0, sweep, 1) for sweep in (0, 15, 30, 45)}


@dataclass(frozen=True)
class Mounting:
    """How a blade is held: clamp [in] by which its free part begins later, hub [in] by which all of it is further out."""

    clamp: float = 0.0
    hub: float = 0.0


@dataclass(frozen=True)
class Rotor:
    """A blade and what was measured [Hz] of its first motions out of the plane, by speed [rpm] and sweep [degrees]."""

    name: str
    blade: Callable[[float, Mounting], Mechanism]
    measured: Mapping[tuple[int, int], tuple[float, ...]]
    known: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Row:
    """One measured frequency and the computed one [Hz]."""

    rotor: str
    rpm: int
    sweep: int
    mode: int
    measured: float
    found: float

    @property
    def off(self) -> float:
        """Computed over measured, less one [-]."""
        return self.found / self.measured - 1

    @property
    def key(self) -> tuple[str, int, int, int]:
        """Which row it is: rotor, speed [rpm], sweep [degrees], mode."""
        return self.rotor, self.rpm, self.sweep, self.mode


def section(b: float, h: float, e: float, shear: tuple[float, float, float], rho: float) -> Section:
    """A rectangle b by h [in], wide in the plane of rotation; e and shear (of GA_y, GA_z, GJ) [psi], factors of the sources."""
    area, flap, lag = b * h, b * h**3 / 12, h * b**3 / 12
    strength = POUND * np.array([1.0, 1.0, 1.0, INCH**2, INCH**2, INCH**2])
    rigid = np.array([e * area, 5 / 6 * shear[0] * area, shear[1] * area / 14.625, shear[2] * (flap + lag) / 65.852,
                      e * flap, e * lag])  # fmt: skip
    density = rho * POUND / INCH**4  # of lb s^2 / in^4
    inertia = density * INCH**4 * np.array([[flap + lag, flap, lag]])
    return Section(np.zeros(1), (rigid * strength)[None], np.array([density * area * INCH**2]), inertia)


def straight(_: float, held: Mounting) -> Mechanism:
    """The straight rotor: graphite, 37.5 in."""
    own = section(1.0, 0.117, 2.059e7, (8.9e5, 8.9e5, 8e5), 1.44e-4)
    return _rotor((Link("blade", (), _inner(37.5, own, held)),), ())


def swept(degrees: float, held: Mounting) -> Mechanism:
    """The rotor with a swept tip: aluminium, 31.5 in and 6 in."""
    g = 1.06e7 / (2 * 1.325)
    own = section(1.0, 0.063, 1.06e7, (g, g, g), 2.51e-4)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    back = Placement(np.zeros(3), np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    links = Link("blade", (), _inner(31.5, own, held)), Link("tip", (), Beam(6 * INCH, own, 1, 3))
    return _rotor(links, (Joint("bend", "fixed", "blade", "tip", back, station=1.0),))


def _inner(length: float, own: Section, held: Mounting) -> Beam:
    begins = Placement(np.array([(ROOT + held.hub + held.clamp) * INCH, 0.0, 0.0]))
    # two elements of order 7 (and one of order 5 in the tip) move no frequency of the tables by more than 1.4e-4 of itself
    return Beam((length - held.clamp) * INCH, own, 2, 4, placement=begins)


def _rotor(links: tuple[Link, ...], joints: tuple[Joint, ...]) -> Mechanism:
    return Mechanism("rotor", links, (Joint("hub", "revolute", WORLD, "blade"), *joints), gravity=np.zeros(3))


GRAPHITE = Rotor("graphite", straight, {
    (0, 0): (5.2374, 32.999, 90.439, 172.37),
    (250, 0): (7.4239, 34.582, 91.112, 175.32),
    (500, 0): (11.018, 40.188, 97.733, 179.67),
    (750, 0): (15.82, 47.001, 105.58, 188.74),
}, ((0, 0), (500, 0)))  # fmt: skip
ALUMINIUM = Rotor("aluminium", swept, {
    (0, 0): (1.4, 10.3, 27.7), (0, 15): (1.8, 10.2, 27.2), (0, 30): (1.7, 10.4, 26.6), (0, 45): (1.6, 10.4, 24.8),
    (500, 0): (10.2, 25.2, 47.0), (500, 15): (10.1, 25.2, 44.4), (500, 30): (10.2, 23.7, 39.3), (500, 45): (10.2, 21.6, 35.1),
    (750, 0): (14.8, 36.1, 62.9), (750, 15): (14.4, 34.8, 55.9), (750, 30): (14.9, 30.7, 48.6), (750, 45): (14.7, 26.1, 44.8),
}, ((0, 0), (500, 0), (750, 0)))  # fmt: skip
ROTORS = (GRAPHITE, ALUMINIUM)


def flapping(found: SteadyModes, count: int) -> Array:
    """Return the lowest frequencies [Hz] of motions out of the plane of rotation."""
    size = np.abs(found.displacement).max(axis=1)  # (mode, xyz)
    bends = np.abs(found.rotation).max(axis=(1, 2)) < TWIST * size.max(axis=1)
    return np.asarray(found.frequency[(size[:, 2] > size[:, 1]) & bends][:count])


def rows(rotor: Rotor, held: Mounting, which: tuple[tuple[int, int], ...] | None = None) -> list[Row]:
    """Return measured and computed frequencies [Hz] of a rotor held like that."""
    out = []
    for rpm, sweep in which or tuple(rotor.measured):
        measured = rotor.measured[rpm, sweep]
        modes = steady_modes(rotor.blade(sweep, held), rates={"hub": rpm * RPM}, count=12)
        found = flapping(modes, len(measured))
        pairs = zip(measured, found, strict=True)
        out += [Row(rotor.name, rpm, sweep, k, a, float(b)) for k, (a, b) in enumerate(pairs, 1)]
    return out


def identify(rotor: Rotor) -> Mounting:
    """Return the mounting [in] with which the known rows of a rotor are met best: least squares of their relative errors."""

    def errors(lengths: Array) -> Array:
        found = rows(rotor, Mounting(*lengths), rotor.known)
        return np.array([row.off for row in found if row.key not in UNREADABLE])

    # frequencies are read to 1e-3; a hundredth of an inch changes them by less
    return Mounting(*least_squares(errors, [0.0, 0.0], diff_step=1e-2, x_scale=[1.0, 1.0], xtol=1e-2, ftol=1e-3).x)


def norms(found: list[Row]) -> dict[tuple[str, int, int], float]:
    """Return |computed - measured| / |measured| [-], norms over the modes of a speed and sweep."""
    out = {}
    for rotor, rpm, sweep in dict.fromkeys(row.key[:3] for row in found):
        own = [row for row in found if row.key[:3] == (rotor, rpm, sweep)]
        measured = np.array([row.measured for row in own])
        size = float(np.linalg.norm([row.found for row in own] - measured) / np.linalg.norm(measured))
        out[rotor, rpm, sweep] = size
    return out


def report(rotor: Rotor, held: Mounting, stated: list[Row], mounted: list[Row]) -> list[str]:
    """Return the lines of a table: measured, computed as stated and as mounted [Hz], and what the last is."""
    lines = [
        f"{rotor.name}: the clamp holds {held.clamp:.2f} in of the strip, the hub is {held.hub:.2f} in larger",
        " rpm sweep mode  measured    stated           mounted",
    ]
    for a, b in zip(stated, mounted, strict=True):
        known = "identified on" if (a.rpm, a.sweep) in rotor.known else "predicted"
        what = "not to be read" if a.key in UNREADABLE else known
        numbers = f"{a.measured:9.3f} {a.found:9.3f} {a.off:+6.1%} {b.found:9.3f} {b.off:+6.1%}"
        lines.append(f"{a.rpm:4} {a.sweep:5} {a.mode:4} {numbers}  {what}")
    for name, found in (("stated", stated), ("mounted", mounted)):
        inside, size = sum(abs(row.off) <= WITHIN for row in found), norms(found).values()
        close = sum(part <= WITHIN for part in size)
        lines.append(f"{name}: {inside} of {len(found)} rows within 5 %; norm over modes: {close} of {len(size)}")
    return lines


def main() -> None:
    """Print all rows [Hz], of the blades as stated and as mounted."""
    for rotor in ROTORS:
        held = identify(rotor)
        click.echo("\n".join([*report(rotor, held, rows(rotor, Mounting()), rows(rotor, held)), ""]))


if __name__ == "__main__":
    main()
