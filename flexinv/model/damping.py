"""Damping of beams as data: one retardation time for all of them, or the ratio that one natural mode shall have."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError

if TYPE_CHECKING:
    from flexinv.model.links import Link
    from flexinv.model.mechanism import Mechanism


@dataclass(frozen=True)
class ModalDamping:
    """Damping of all beams by the ratio of one natural mode, all joints held at zero.

    ratio : of critical damping [-]; mode : its number, 1 the lowest
    seconds : retardation time that follows from it [s], None until modes are computed (`linearized.damping_ratio.damped`)
    """

    ratio: float
    mode: int = 1
    seconds: float | None = None

    def __str__(self) -> str:
        """Return the stated ratio, and the time that follows from it [-], [s]."""
        stated = f"ratio {self.ratio:g} at mode {self.mode}"
        return stated if self.seconds is None else f"retardation time {self.seconds:.5g} s from {stated}"


def with_retardation(mechanism: Mechanism, seconds: ArrayLike) -> Mechanism:
    """Return the mechanism with damped beams, D = seconds C [N s], [N m^2 s]; a stated ratio is replaced.

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

    return replace(mechanism, links=tuple(damped(link) for link in mechanism.links), modal_damping=None)
