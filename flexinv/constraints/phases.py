"""Phases: the stretches of a motion between which closures begin or cease to act.  Open and closed is data, not code."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexinv.constraints.closures import Rows
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array, Mask

# A switching instant this close to a sample, in parts of the step, is that sample.
SAME_INSTANT = 1e-6


@dataclass(frozen=True)
class Phase:
    """Samples ``first`` to before ``last``, in which the closures of ``active`` (closures,) act."""

    first: int
    last: int
    active: Mask


@dataclass(frozen=True)
class Stretch:
    """A phase and the constraints of all closures, with the frames [m] that they tie in it."""

    phase: Phase
    rows: Rows

    @property
    def span(self) -> slice:
        """Samples of the phase."""
        return slice(self.phase.first, self.phase.last)

    @property
    def acting(self) -> Rows:
        """Constraints that act [m], [-]."""
        return self.rows.of(self.phase.active)

    @property
    def pick(self) -> Mask:
        """(rows,) which constraints act."""
        return self.phase.active[self.rows.closure]


def phases(mechanism: Mechanism, time: Array) -> list[Phase]:
    """Return the phases of a grid ``time`` (samples,) [s], uniform at its start; a closure acts from its start to before its end.

    Raises InputError when a closure begins or ceases between two samples.
    """
    step = float(time[1] - time[0]) if len(time) > 1 else 1.0
    cuts = {0}
    for closure in mechanism.closures:
        for instant in (t for interval in closure.active for t in interval if time[0] < t < time[-1]):
            sample = int(np.abs(time - instant).argmin())
            if abs(time[sample] - instant) > SAME_INSTANT * step:
                raise InputError(
                    f"mechanism '{mechanism.name}', closure '{closure.name}': it switches at {instant:g} s, between two samples "
                    f"({step:g} s apart); write step = {(instant - time[0]) / max(1, sample):.10g} or another that meets it"
                )
            cuts.add(sample)
    bounds = [*sorted(cuts), len(time)]
    slack = SAME_INSTANT * step
    return [Phase(first, last, acting(mechanism, float(time[first]) + slack)) for first, last in pairwise(bounds)]


def acting(mechanism: Mechanism, time: float) -> Mask:
    """Return a mask (closures,) of the closures that act at ``time`` [s]."""
    return np.array(
        [not c.active or any(start <= time < end for start, end in c.active) for c in mechanism.closures], dtype=bool
    )
