"""Checks that are free: power and momentum balance of a solution, from nodal motion and forces alone."""

from __future__ import annotations

from dataclasses import dataclass

from flexinv.mechanism import Array


@dataclass(frozen=True)
class Balance:
    """Energies and what is left of the balances (`second_step`).

    kinetic, potential, elastic : (samples,) [J]; dissipated : (samples,) [W] by the damping of beams
    power : (samples,) [W] residual of  tau . qd = sum P . v + Q . w + power of internal forces, at every instant
    work : (samples,) [J] residual of  integral (tau . qd + power of applied forces - dissipated) dt = change of energy
        (trapezoidal: time error shows here)
    momentum : (samples, 6) [N], [N m] reaction at the base (elastic side) less sum P and sum x x P + Q (inertia side)
    """

    kinetic: Array
    potential: Array
    elastic: Array
    power: Array
    work: Array
    momentum: Array
    dissipated: Array
