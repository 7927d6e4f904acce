"""Validation of the arguments of `natural_modes`, `steady_modes` and `linear_model`."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from numpy.typing import ArrayLike

from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import floats, names, number, of_kind, table, whole


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
