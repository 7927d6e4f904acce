"""Motions shaped for the modes of a mechanism: the usual way to an end without vibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.errors import InputError
from flexinv.linearized.natural_modes import natural_modes
from flexinv.model.by_value import ByValue
from flexinv.model.input_shaper import InputShaper
from flexinv.model.make_shaper import make_shaper
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array
from flexinv.validation import check_kind, check_seconds, check_whole_number

LOOKED_AT = 5  # of the way, at which modes are looked at: their frequencies change with where joints stand


@dataclass(frozen=True, eq=False)
class ShapedMotion(ByValue):
    """A motion in the parts of a shaper, and the modes it was made for.

    motion : the shaped one; shaper : its parts; time : (instants,) of the plain motion [s]
    frequency : (instants, modes) natural frequencies there [Hz]; the shaper is made for those of the last instant
    ratio : (modes,) damping ratios there [-]
    """

    motion: Motion
    shaper: InputShaper
    time: Array
    frequency: Array
    ratio: Array

    @property
    def vibration(self) -> Array:
        """(instants, modes) part of the plain motion's vibration that the shaper leaves of a mode with that frequency [-]."""
        columns = zip(self.frequency.T, self.ratio.tolist(), strict=True)
        return np.stack([self.shaper.compute_vibration(column, ratio) for column, ratio in columns], axis=1)


def make_shaped_motion(
    mechanism: Mechanism, motion: Motion, kind: str = "ZVD", modes: int = 1, vibration: float = 0.05
) -> ShapedMotion:
    """Return a motion shaped for the slowest modes of a mechanism at the end of the way, with the modes along it [Hz].

    kind, vibration : as of `make_shaper`; modes : how many of the slowest ones
    The shaped motion takes longer by ``shaper.duration``: half a period of each mode by ZV, a whole one by ZVD and EI.
    Raises InputError where nothing can swing, where a mode is unstable, and for motions that give no joint.
    """
    check_kind("mechanism", mechanism, Mechanism)
    check_kind("motion", motion, Motion)
    check_seconds("duration of the motion", motion.duration, "a motion that takes time [s]")
    count = check_whole_number("modes", modes, 1, "1 or more of the slowest modes")
    time = np.linspace(0.0, motion.duration, LOOKED_AT)
    places = motion.evaluate(mechanism, time)[0]
    found = [natural_modes(mechanism, place, count=count) for place in places]
    fewest = min(len(one.squared) for one in found)
    if fewest < count:
        raise InputError(
            f"modes = {count}: '{mechanism.name}' has {fewest} with its joints held; write modes = {fewest}"
        )
    for instant, one in zip(time, found, strict=True):
        if not all(word == "stable" for word in one.stability[:count]):
            words = ", ".join(one.stability[:count])
            raise InputError(
                f"make_shaped_motion: at {instant:g} s '{mechanism.name}' has {words}; expected modes that swing"
            )
    frequency = np.stack([one.frequency[:count] for one in found])
    ratio = found[-1].ratio[:count]
    shaper = make_shaper(kind, frequency[-1], ratio, vibration)
    return ShapedMotion(motion.shaped(shaper), shaper, time, frequency, ratio)
