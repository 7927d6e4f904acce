"""Sudden couples on the tip section of an arm: the sweep over couples and steps, in the plane of its joint and out of it.

``python tests/shared/sudden_sweep.py`` prints both tables.  The arm is the paper's, damped as
models/flex_one_link_damped:
what a step cannot resolve then dies out in a refined run, too, which is what a march can be held against.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from flexible_examples import STRIP, arm

import flexinv
from flexinv.model.mechanism import Attachment, Force, Mechanism, Placement, with_retardation
from flexinv.typing import Array

# The retardation time of models/flex_one_link_damped: 0.03 of critical in the first mode.
RETARDATION = 9.5e-4  # [s]
COUPLES = tuple(np.round(np.geomspace(1e-4, 2.0, 15), 6).tolist())  # [N m]; 17 mN m among them to 6 %
STEPS = (5e-4, 2e-4, 1e-4, 5e-5, 2e-5)  # [s]
REFINED, KEPT = 2e-6, 1e-5  # [s] step of the refined run, and its samples: all steps are multiples of them
END = 0.01  # [s]: what the couple starts has gone along the arm some times
RIGHT = 0.01  # of the range of the refined run: what the issue asks for


@dataclass(frozen=True)
class Outcome:
    """One pair of couple [N m] and step [s]: the error that was raised, or the largest error of all samples by quantity [-]."""

    couple: float
    step: float
    error: str
    off: dict[str, float]

    @property
    def right(self) -> bool:
        return not self.error and max(self.off.values()) <= RIGHT


def pushed(couple: float, axis: int, mechanism: Mechanism | None = None) -> Mechanism:
    """The arm with a couple [N m] about one of the world's axes on its tip section, constant from the start."""
    wrench = np.zeros((1, 6))
    wrench[0, 3 + axis] = couple
    tip = Attachment("link", Placement(np.zeros(3)), 1.0)
    return replace(mechanism or damped(), forces=(Force("couple", tip, wrench),))


@lru_cache(maxsize=1)
def damped() -> Mechanism:
    """The paper's arm, damped."""
    return with_retardation(arm(section=STRIP), RETARDATION)


def held(couple: float, step: float, axis: int, every: int = 1) -> flexinv.Solution:
    """The arm at rest, its joint held."""
    motion = flexinv.Motion.point_to_point([0.0], [0.0], END)
    return flexinv.solve(pushed(couple, axis), motion, step=step, every=every)


def quantities(s: flexinv.Solution) -> dict[str, Array]:
    """Torque (or, out of the plane, the moment at the root), places and rates of all sections, a column for each."""
    samples = len(s.time)
    moment = s.wrench["hub"][:, 3:]
    return {
        "moment": moment,
        "place": s.nodes.x.reshape(samples, -1),
        "turn": s.nodes.rotation.reshape(samples, -1),
        "rate": s.nodes.v.reshape(samples, -1),
        "spin": s.nodes.omega.reshape(samples, -1),
    }


@lru_cache(maxsize=64)
def refined(couple: float, axis: int) -> dict[str, Array]:
    """The refined run at its samples."""
    return quantities(held(couple, REFINED, axis, round(KEPT / REFINED)))


def outcome(couple: float, step: float, axis: int) -> Outcome:
    """March one pair and compare every sample but the first, at which nothing has moved yet."""
    try:
        result = quantities(held(couple, step, axis))
    except flexinv.ConvergenceError as error:
        return Outcome(couple, step, str(error), {})
    off, stride = {}, round(step / KEPT)
    for name, values in result.items():
        exact = refined(couple, axis)[name][::stride]
        span = np.ptp(refined(couple, axis)[name], axis=0).max()
        off[name] = float(np.abs(values - exact).max() / span)
    return Outcome(couple, step, "", off)


def sweep(axis: int, couples: tuple[float, ...] = COUPLES, steps: tuple[float, ...] = STEPS) -> list[Outcome]:
    """All pairs, about the joint's axis (2) or across it (1)."""
    return [outcome(couple, step, axis) for couple in couples for step in steps]


def silent(found: list[Outcome]) -> list[Outcome]:
    """Pairs that are neither right nor an error."""
    return [one for one in found if not one.error and not one.right]


def table(axis: int) -> str:
    """The sweep about one axis as text, a line for each pair and one for all."""
    result, where, lines = sweep(axis), "in the plane" if axis == 2 else "out of it", []
    for one in result:
        text = one.error or "  ".join(f"{name} {value:.1e}" for name, value in one.off.items())
        word = "right" if one.right else "error" if one.error else "silent"
        lines.append(f"{where}  {one.couple:9.3g} N m  {one.step:7.0e} s  {word:6}  {text[:150]}")
    counts = sum(one.right for one in result), sum(bool(one.error) for one in result), len(silent(result))
    return "\n".join([*lines, "{}: {} right, {} errors, {} silent, of {}\n".format(where, *counts, len(result))])


if __name__ == "__main__":
    sys.stdout.write(table(2) + table(1))
