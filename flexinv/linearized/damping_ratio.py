"""Damping of beams: by a retardation time, or by the damping ratio of one natural mode.

Kelvin-Voigt damping with one retardation time eta for all strains, D = eta C (`elements.beam`), damps a mode of frequency omega
with the ratio zeta = eta omega / 2: it grows with frequency, so that one target ratio at one mode fixes it for all others.

A rigid motion dissipates nothing; in steps of h on a circle of rate w the scheme's velocities are off by a part (w h)^2, which
leaves strain rates of second order (and power of fourth).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.linearized.natural_modes import Modes, natural_modes
from flexinv.model.mechanism import Link, Mechanism
from flexinv.typing import Array


def with_retardation(mechanism: Mechanism, seconds: ArrayLike) -> Mechanism:
    """Return the mechanism with damped beams, D = seconds C [N s], [N m^2 s].

    seconds : retardation time [s], one for all strains or six: axial, shear y, shear z, twist, bending y, bending z

    Raises InputError for negative times.
    """
    times = np.asarray(seconds, dtype=float)
    if times.shape not in ((), (6,)) or not np.isfinite(times).all() or (times < 0).any():
        raise InputError(f"retardation times {times.tolist()}: expected one number >= 0 or six [s], for example 1e-3")

    def damped(link: Link) -> Link:
        if link.beam is None:
            return link
        section = replace(link.beam.section, damping=times * link.beam.section.stiffness)
        return replace(link, beam=replace(link.beam, section=section))

    return replace(mechanism, links=tuple(damped(link) for link in mechanism.links))


def with_ratio(
    mechanism: Mechanism, ratio: float, mode: int = 1, q: ArrayLike | None = None
) -> tuple[Mechanism, float, Modes]:
    """Return the mechanism with all beams so damped that one natural mode has a given ratio [-], the time [s], and the modes.

    eta = ratio / (ratio of that mode at eta = 1 s)

    ratio : of critical damping, 0 to 1; mode : its number, 1 the lowest, all joints held at ``q`` (nq,)
        [rad], [m], zero by default

    Raises InputError for a ratio outside 0 to 1, without beams, and for a mode that does not oscillate or strain them.
    """
    if not mechanism.beams:
        raise InputError(
            f"damping ratio: '{mechanism.name}' has no beam that could be damped; give its joints a damping"
        )
    if not 0.0 <= ratio < 1.0:
        raise InputError(f"damping ratio {ratio:g}: expected 0 to 1 [-], for example 0.01")
    found = natural_modes(with_retardation(mechanism, 1.0), q)
    if not 1 <= mode <= len(found.squared):
        raise InputError(f"damping ratio: mode {mode}, expected 1 to {len(found.squared)}, the modes that the mesh has")
    whole: Array = found.ratio
    if not whole[mode - 1] > 0.0:
        raise InputError(f"damping ratio: mode {mode} does not oscillate; take another, `flexinv modes` lists them")
    seconds = ratio / float(whole[mode - 1])
    return with_retardation(mechanism, seconds), seconds, replace(found, friction=seconds * found.friction)
