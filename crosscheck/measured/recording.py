"""A measured record: equally spaced samples of named signals, and parts of it that share no sample."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexinv.errors import InputError

Array = NDArray[np.float64]
# Times are written with three decimals: their spacing is even to half a unit of the last one.
EVEN = 5e-4


@dataclass(frozen=True)
class Recording:
    """Samples of a machine at work.

    start : of its first sample in the whole record [s]; spacing : between samples [s]
    signals : name -> (samples,) in the unit that the name ends in
    """

    start: float
    spacing: float
    signals: dict[str, Array]

    @property
    def size(self) -> int:
        """Number of samples [-]."""
        return len(next(iter(self.signals.values())))

    @property
    def time(self) -> Array:
        """(samples,) [s], from 0."""
        return np.asarray(self.spacing * np.arange(self.size), dtype=np.float64)

    def cut(self, start: float, duration: float) -> Recording:
        """Return the samples of [start, start + duration) [s] of the whole record: the next part begins with another one."""
        first = round((start - self.start) / self.spacing)
        count = round(duration / self.spacing)
        if first < 0 or first + count > self.size:
            raise InputError(
                f"{start:g} to {start + duration:g} s: the record goes from {self.start:g} to "
                f"{self.start + self.size * self.spacing:g} s; write a part of that"
            )
        part = slice(first, first + count)
        return Recording(start, self.spacing, {name: values[part] for name, values in self.signals.items()})


def read_recording(path: Path, names: tuple[str, ...]) -> Recording:
    """Read a CSV file: ``time_s`` [s] first, then the signals, named with their units.

    Raises InputError: missing column, times that are not evenly spaced, numbers that are missing.
    """
    with path.open(encoding="utf-8") as stream:
        header = stream.readline().strip().split(",")
    if lacking := [name for name in ("time_s", *names) if name not in header]:
        raise InputError(f"{path}: line 1 has no column {lacking[0]}; it has {', '.join(header)}")
    table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    if not np.all(np.isfinite(table)):
        raise InputError(f"{path}: a number is missing; leave no cell empty")
    time = table[:, header.index("time_s")]
    spacing = float(time[-1] - time[0]) / (len(time) - 1)
    if np.abs(np.diff(time) - spacing).max() > EVEN:
        raise InputError(f"{path}: column time_s is not evenly spaced by {spacing:g} s; resample the record")
    return Recording(float(time[0]), spacing, {name: table[:, header.index(name)] for name in names})
