"""The law of a beam's section, written once: stress resultants by strains, the same for strain rates with numbers of damping.

    n, m = C (gamma, kappa)          C = diag(direct) + coupling,  (6, 6), symmetric, in the order of `model.section_matrices`

Strains of most sections are independent: ``direct`` says all, and nothing of ``coupling`` is computed.  In a plane three strains
are left, axial, shear and bending, with the couplings of each two.  Python calls these functions with arrays; kernels take in
their text.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flexinv.kernels.jit import jit_formula
from flexinv.model.links import Section
from flexinv.typing import Array

Three = tuple[Any, Any, Any]
Six = tuple[Any, Any, Any, Any, Any, Any]


@jit_formula
def compute_direct_resultants(direct: Three, strain: Three) -> Three:
    """Return the resultants [N], [N m] of three strains [-], [1/m] that are independent."""
    return direct[0] * strain[0], direct[1] * strain[1], direct[2] * strain[2]


@jit_formula
def compute_coupled_resultant(row: Any, strain: Six) -> Any:
    """Return one of six resultants [N], [N m] that the strains [-], [1/m] make of one another; row : (6,) of the coupling."""
    first = row[0] * strain[0] + row[1] * strain[1] + row[2] * strain[2]
    return first + row[3] * strain[3] + row[4] * strain[4] + row[5] * strain[5]


@jit_formula
def compute_coupled_resultants(coupling: Any, strain: Six) -> Six:
    """Return the six resultants [N], [N m] that the strains [-], [1/m] make of one another; coupling : (6, 6)."""
    return (
        compute_coupled_resultant(coupling[0], strain),
        compute_coupled_resultant(coupling[1], strain),
        compute_coupled_resultant(coupling[2], strain),
        compute_coupled_resultant(coupling[3], strain),
        compute_coupled_resultant(coupling[4], strain),
        compute_coupled_resultant(coupling[5], strain),
    )


@jit_formula
def compute_planar_coupling(coupling: Three, strain: Three) -> Three:
    """Return the resultants [N], [N m] of axial strain, shear and bending in a plane [-], [1/m] by their couplings.

    coupling : axial with shear [N], axial with bending [N m], shear with bending [N m]
    """
    return (
        coupling[0] * strain[1] + coupling[1] * strain[2],
        coupling[0] * strain[0] + coupling[2] * strain[2],
        coupling[1] * strain[0] + coupling[2] * strain[1],
    )


@jit_formula
def compute_planar_work(coupling: Three, strain: Three) -> Any:
    """Return the work [N], or of rates and damping the power [W/m], of three strains [-], [1/m] on their coupled resultants."""
    by = compute_planar_coupling(coupling, strain)
    return by[0] * strain[0] + by[1] * strain[1] + by[2] * strain[2]


class BeamLaw(NamedTuple):
    """The law at one place of a beam.

    direct : (6,) EA, GA_y, GA_z [N], GJ, EI_y, EI_z [N m^2], or those of damping [N s], [N m^2 s]
    coupling : (6, 6) with a diagonal of zeros [N], [N m], [N m^2]; None where the strains are independent
    """

    direct: Array
    coupling: Array | None = None

    def resultants(self, strain: Array) -> Array:
        """Return the stress resultants (..., 6) [N], [N m] of strains (..., 6) [-], [1/m]."""
        e = np.moveaxis(np.asarray(strain, dtype=float), -1, 0)
        c = self.direct
        n = compute_direct_resultants((c[0], c[1], c[2]), (e[0], e[1], e[2]))
        m = compute_direct_resultants((c[3], c[4], c[5]), (e[3], e[4], e[5]))
        direct = np.stack([*n, *m], axis=-1)
        if self.coupling is None:
            return direct
        six = e[0], e[1], e[2], e[3], e[4], e[5]
        return np.asarray(direct + np.stack(compute_coupled_resultants(self.coupling, six), axis=-1))

    def tangent(self, strain: Array) -> Array:
        """Return the derivative of the resultants (..., 6, 6) [N], [N m], [N m^2], the same at every strain (..., 6)."""
        whole = np.diag(self.direct) if self.coupling is None else np.diag(self.direct) + self.coupling
        return np.broadcast_to(whole, (*np.shape(strain)[:-1], 6, 6))


def build_beam_laws(section: Section) -> list[BeamLaw]:
    """Return the laws [N], [N m], [N m^2] at the stations of a section."""
    direct, coupling = split_coupling(section.stiffness)
    beside = [None] * len(direct) if section.stiffness.ndim == 2 else list(coupling)
    return [BeamLaw(law, other) for law, other in zip(direct, beside, strict=True)]


def split_coupling(table: Array) -> tuple[Array, Array]:
    """Return diagonals (n, 6) and what is beside them (n, 6, 6) [any unit] of a table (n, 6) or (n, 6, 6)."""
    if table.ndim == 2:
        return table, np.zeros((len(table), 6, 6))
    direct = np.diagonal(table, axis1=1, axis2=2).copy()
    return direct, table * (1.0 - np.eye(6))
