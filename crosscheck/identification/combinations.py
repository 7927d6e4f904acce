"""Combinations: which numbers the logs tell only together, and with which others.

Of the logs alone, without what was known before, the information about parameters p in units of their priors' widths is

    W = D T^-T (C^-1 - 1) T^-1 D,    p = p^ + T (z - z^),    D = diag |T_k|

A parameter that would be told were the others known (W_kk >> 1) but is not told alone shares its effect with others.  They are
found one by one, as in orthogonal matching pursuit: the other whose column takes most of W_kk, until what is left of it is less
than what was known before.  Source: M. Gautier, W. Khalil, "Direct calculation of minimum set of inertial parameters of serial
robots", IEEE Trans. Robotics and Automation 6 (1990), for the combinations; T. Cai, L. Wang, IEEE Trans. Information Theory 57
(2011), for the pursuit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosscheck.identification.fit import TOLD, Fit
from crosscheck.identification.parameters import MASS, Key, ParameterSpace
from crosscheck.identification.pseudo_inertia import NAMES, QUANTITIES, UNITS, convert_to_com, move_mass_properties
from flexinv.typing import Array

STEP = 1e-6  # of the derivatives of mass, centre and inertia by the coordinates of a link
SHOWN = (
    10.0  # information of the logs over that of the prior: were the others known, a third of the width would be left
)
MOST = 4  # others that a sentence names


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
    keys, units, slope = _convert_to_physical(space, fit.z)
    width = np.linalg.norm(slope, axis=1)
    back = np.linalg.inv(slope / width[:, None])
    information = back.T @ (np.linalg.inv(fit.covariance) - np.eye(len(fit.z))) @ back
    told = np.sqrt(np.diag(slope @ fit.covariance @ slope.T)) < TOLD * width
    out = []
    for k, key in enumerate(keys):
        if told[k] or information[k, k] < SHOWN:
            continue
        others, left = _find_pursuit_columns(information, k)
        if others and left < 1.0 / (1.0 + information[k, k]) ** 0.5:
            alone = 1.645 * width[k] / np.sqrt(1.0 + information[k, k])
            out.append(ParameterCombination(key, units[k], tuple(keys[j] for j in others), float(alone), left))
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


def _convert_to_physical(space: ParameterSpace, z: Array) -> tuple[list[Key], list[str], Array]:
    """Return the parameters in physical quantities: what and where, units, derivatives by z (parameters, parameters)."""
    at = {p.key: k for k, p in enumerate(space.parameters)}
    keys: list[Key] = [p.key for p in space.parameters]
    units = [p.unit for p in space.parameters]
    slope = np.diag(
        [p.error * (p.compute_value(float(x)) if p.positive else 1.0) for p, x in zip(space.parameters, z, strict=True)]
    )
    for name, factor in space.factors.items():
        here = [at[MASS, f"{name}.{n}"] for n in NAMES]
        errors = np.array([space.parameters[k].error for k in here])
        x = errors * z[here]
        columns = [
            (convert_to_com(move_mass_properties(factor, x + e)) - convert_to_com(move_mass_properties(factor, x - e)))
            / (2 * STEP)
            for e in STEP * np.eye(len(NAMES))
        ]
        slope[np.ix_(here, here)] = np.column_stack(columns) * errors
        for k, quantity, unit in zip(here, QUANTITIES, UNITS, strict=True):
            keys[k] = (quantity, name)
            units[k] = unit
    return keys, units, slope


def _describe_parameter(key: Key) -> str:
    return f"{key[0]} of {key[1]}"
