"""natural_modes for callers, and what it and its like (`steady_modes`, `linear_model`) look at before they begin."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from numpy.typing import ArrayLike

from flexinv import modes
from flexinv.arguments import floats, names, number, of_kind, table, whole
from flexinv.mechanism import Array, Mechanism
from flexinv.modes import Modes


def natural_modes(
    mechanism: Mechanism, q: ArrayLike | None = None, free: Collection[str] | None = None, count: int | None = None
) -> Modes:
    """Return natural frequencies [Hz] and mode shapes at rest under gravity, joints clamped at ``q`` but for the free ones.

    q : (nq,) [rad], [m], zero by default; in a loop the guess from which it is closed
    free : names of joints that move freely about ``q``; by default none in a tree, and in a loop those without a drive
    count : number of modes, all by default

    Raises InputError for unknown joints and where nothing can move, ConvergenceError where no rest position is found.
    """
    return modes.natural_modes(mechanism, check_modes(mechanism, q, free, count), free, count)


def check_modes(
    mechanism: Mechanism, q: ArrayLike | None, free: Collection[str] | None, count: int | None
) -> Array | None:
    """Return q [rad], [m] as floats; raises InputError for arguments of another kind."""
    of_kind("mechanism", mechanism, Mechanism)
    if free is not None:
        names("free", free, "joints")
    if count is not None:
        whole("count", count, 1, "1 or more, or None for all")
    return None if q is None else floats("modes: q", q)


def check_rates(rates: Mapping[str, float] | None) -> dict[str, float]:
    """Return rates [rad/s] by joint as floats, none for None."""
    given = table("rates", rates, "a table of joints and their rates", 'rates={"joint": 10.0}')
    return {name: number(f"rate of joint {name!r}", rate, "a finite number [rad/s]") for name, rate in given.items()}
