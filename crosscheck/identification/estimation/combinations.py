"""Combinations: which numbers the logs tell only together, and with which others.

Of the logs alone, without what was known before, the information about parameters p in units of their priors' widths is

    W = D T^-T (C^-1 - 1) T^-1 D,    p = p^ + T (z - z^),    D = diag |T_k|     (`posterior.compute_log_information`)

A parameter that would be told were the others known (W_kk >> 1) but is not told alone shares its effect with others.  They are
found one by one, as in orthogonal matching pursuit: the other whose column takes most of W_kk, until what is left of it is less
than what was known before.  Source: M. Gautier, W. Khalil, "Direct calculation of minimum set of inertial parameters of serial
robots", IEEE Trans. Robotics and Automation 6 (1990), for the combinations; T. Cai, L. Wang, IEEE Trans. Information Theory 57
(2011), for the pursuit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.identification.estimation.fit import TOLD, Fit
from crosscheck.identification.estimation.posterior import compute_log_information
from crosscheck.identification.parameters import Key, ParameterSpace
from flexinv.typing import Array

SHOWN = (
    10.0  # information of the logs over that of the prior: were the others known, a third of the width would be left
)
MOST = 4  # others that a sentence names
APART = 0.5  # of the width of its prior: below, the logs tell a parameter apart from others


@dataclass(frozen=True)
class ParameterCombination:
    """A parameter that the logs tell only together with others.

    key, unit : what and where; others : kind and place of each, the first takes most
    alone : its 90 % interval is +- this [unit] were they known; distinct_share : part of its effect that is not theirs [-]
    """

    key: Key
    unit: str
    others: tuple[Key, ...]
    alone: float
    distinct_share: float

    @property
    def words(self) -> str:
        """The same in a sentence [-]."""
        others = " and ".join(_describe_parameter(key) for key in self.others)
        return (
            f"{_describe_parameter(self.key)} cannot be told apart from {others}: "
            f"all but {self.distinct_share:.1g} of what it changes "
            f"in these logs "
            f"could be theirs; were they known, it would be known to ±{self.alone:.2g} {self.unit}"
        )


def count_narrowed_directions(fit: Fit) -> int:
    """Return the number of independent combinations that the logs narrow to `fit.TOLD` of their priors [-]."""
    return int((np.linalg.eigvalsh(fit.covariance) < TOLD**2).sum())


def list_combinations(space: ParameterSpace, fit: Fit) -> list[ParameterCombination]:
    """Return the parameters [unit of each] that are told only together with others, at most `MOST` others each."""
    logs = compute_log_information(space, fit)
    information = logs.matrix
    out = []
    for k, key in enumerate(logs.keys):
        if logs.ratio[k] < APART or information[k, k] < SHOWN:
            continue
        others, left = _find_pursuit_columns(information, k)
        if others and left < 1.0 / (1.0 + information[k, k]) ** 0.5:
            alone = 1.645 * logs.width[k] / np.sqrt(1.0 + information[k, k])
            out.append(
                ParameterCombination(key, logs.units[k], tuple(logs.keys[j] for j in others), float(alone), left)
            )
    return out


def _find_pursuit_columns(information: Array, k: int) -> tuple[list[int], float]:
    """Return the columns that take most of column k of a Gram matrix, and the part that is left [-]."""
    others: list[int] = []
    whole = float(information[k, k])
    rest = whole
    while rest > 1.0 and len(others) < MOST:
        best = -1
        least = rest
        for j in range(len(information)):
            if j == k or j in others or information[j, j] <= 0.0:
                continue
            now = _compute_column_rest(information, k, [*others, j])
            if now < least:
                best = j
                least = now
        if best < 0 or least > 0.9 * rest:
            break
        others.append(best)
        rest = least
    return others, max(0.0, rest / whole)


def _compute_column_rest(information: Array, k: int, others: list[int]) -> float:
    """Return the part of column k beside the others, which keep their priors (the 1) [-]."""
    block = information[np.ix_(others, others)] + np.eye(len(others))
    beside = information[k, others]
    return float(information[k, k] - beside @ np.linalg.solve(block, beside))


def _describe_parameter(key: Key) -> str:
    return f"{key[0]} of {key[1]}"
