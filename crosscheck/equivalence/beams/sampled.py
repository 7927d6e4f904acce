"""Numbers of a beam as arrays over stations that two beams share, so that each of them can be exchanged alone.

Damping is held by its retardation times D / C: another stiffness alone leaves them as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexinv.model.mechanism import Array, Beam, Section


@dataclass(frozen=True)
class SampledBeam:
    """A beam's numbers over stations (n,) [-].

    length : (1, 1) [m]; curvature : (1, 3) [1/m]
    stiffness : (n, 6) EA, GA_y, GA_z [N], GJ, EI_y, EI_z [N m^2]
    inertia : (n, 4) rho A [kg/m], rho I about x, y, z [kg m]; retardation : (n, 6) [s]
    """

    stations: Array
    length: Array
    curvature: Array
    stiffness: Array
    inertia: Array
    retardation: Array

    def replace_table_columns(self, name: str, columns: slice, values: Array) -> SampledBeam:
        """Return the numbers with other columns of one field [unit of the field]."""
        table = np.array(getattr(self, name))
        table[:, columns] = values
        return replace(self, **{name: table})

    def build_beam(self, like: Beam) -> Beam:
        """Return the beam of these numbers [m, N, kg] with the mesh and the root of another one."""
        damping = self.retardation * self.stiffness if self.retardation.any() else None
        section = Section(self.stations, self.stiffness, self.inertia[:, 0], self.inertia[:, 1:], damping)
        return replace(like, length=float(self.length[0, 0]), curvature=self.curvature[0], section=section)


def sample_beam(beam: Beam, stations: Array) -> SampledBeam:
    """Return a beam's numbers at stations [-] that include its own: between them they are linear."""
    section = beam.section.check_independent("compare: numbers of a beam")
    tables = section.stiffness, np.column_stack([section.mass_per_length, section.rotary_inertia])
    stiffness, inertia = (_evaluate_table(stations, section.stations, table) for table in tables)
    damping = (
        np.zeros_like(stiffness)
        if section.damping is None
        else _evaluate_table(stations, section.stations, section.damping)
    )
    retardation = np.divide(damping, stiffness, out=np.zeros_like(damping), where=stiffness != 0)
    return SampledBeam(stations, np.array([[beam.length]]), beam.curvature[None], stiffness, inertia, retardation)


def collect_stations(one: Beam, two: Beam) -> Array:
    """Return the stations [-] of both beams, in order."""
    return np.union1d(one.section.stations, two.section.stations)


def _evaluate_table(wanted: Array, stations: Array, table: Array) -> Array:
    return np.column_stack([np.interp(wanted, stations, column) for column in table.T])
