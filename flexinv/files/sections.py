"""Beam sections of a mechanism file: stiffness and inertia per length, given or from geometry and material."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.errors import InputError
from flexinv.files.schema import (
    CircleTable,
    MaterialTable,
    RectangleTable,
    StationTable,
    StiffnessSectionTable,
    TubeTable,
)
from flexinv.files.toml_tables import complaint, place, toml_text, validate
from flexinv.files.unit_keys import nearest
from flexinv.mechanism import Array, Section

SHAPES: dict[str, type[RectangleTable] | type[CircleTable] | type[TubeTable]] = {
    "rectangle": RectangleTable,
    "circle": CircleTable,
    "tube": TubeTable,
}


@dataclass(frozen=True)
class CrossSection:
    """One cross-section: stiffness (6,) [N, N, N, N m^2, N m^2, N m^2], mass [kg/m], rotary inertia (3,) [kg m].

    retardation : (6,) [s], damping over stiffness
    """

    stiffness: tuple[float, ...]
    mass_per_length: float
    rotary_inertia: tuple[float, float, float]
    retardation: tuple[float, ...]


def read_section(data: Any, file: Path, name: str) -> CrossSection:
    """Read ``[sections.NAME]``: by ``shape`` and material, or by its numbers [N, N m^2, kg/m, kg m]."""
    path = f"sections.{name}"
    shape = data.get("shape") if isinstance(data, dict) else None
    if shape is None:
        return _from_numbers(validate(StiffnessSectionTable, data, file, path))
    if not isinstance(shape, str) or shape not in SHAPES:
        near = nearest(str(shape), SHAPES) or "rectangle"
        where = place(file, path, "shape")
        raise InputError(
            complaint(where, f"shape = {toml_text(shape)}", f"one of {', '.join(SHAPES)}", f'shape = "{near}"')
        )
    table = validate(SHAPES[shape], data, file, path)
    if isinstance(table, TubeTable) and table.wall_m > table.outer_diameter_m / 2:
        expected = f"at most half of outer_diameter_m = {table.outer_diameter_m} [m]"
        where = place(file, path, "wall_m")
        raise InputError(
            complaint(where, f"wall_m = {table.wall_m}", expected, f"wall_m = {table.outer_diameter_m / 10:g}")
        )
    if (table.nu is None) == (table.G_Pa is None):
        given = "neither" if table.nu is None else "both"
        where = place(file, path, "nu")
        raise InputError(complaint(where, given, "one of nu [-] and G_Pa [Pa]", "nu = 0.33"))
    return _from_geometry(table)


def _from_numbers(table: StiffnessSectionTable) -> CrossSection:
    stiffness = (table.EA_N, *table.GA_N, table.GJ_Nm2, *table.EI_Nm2)
    return CrossSection(stiffness, table.mass_per_length_kg_per_m, table.rho_I_kgm, table.retardation_s)


def _from_geometry(table: RectangleTable | CircleTable | TubeTable) -> CrossSection:
    """EA, k_y GA, k_z GA, G J, E I_y, E I_z; rho A; rho (I_y + I_z), rho I_y, rho I_z."""
    young, shear, poisson = _moduli(table)
    area, torsion, second_y, second_z = _areas(table)
    factors = table.shear_factor or shear_factors(table, poisson)
    stiffness = (
        young * area, factors[0] * shear * area, factors[1] * shear * area,
        shear * torsion, young * second_y, young * second_z,
    )  # fmt: skip
    rho = table.rho_kg_per_m3
    rotary = (rho * (second_y + second_z), rho * second_y, rho * second_z)
    return CrossSection(stiffness, rho * area, rotary, table.retardation_s)


def _moduli(table: MaterialTable) -> tuple[float, float, float]:
    """E, G and nu from E and one of the others: G = E / (2 (1 + nu))."""
    if table.G_Pa is not None:
        return table.E_Pa, table.G_Pa, table.E_Pa / (2 * table.G_Pa) - 1
    assert table.nu is not None
    return table.E_Pa, table.E_Pa / (2 * (1 + table.nu)), table.nu


def _areas(table: RectangleTable | CircleTable | TubeTable) -> tuple[float, float, float, float]:
    """A [m^2], J, I_y = int z^2 dA, I_z = int y^2 dA [m^4]."""
    if isinstance(table, RectangleTable):
        y, z = table.size_y_m, table.size_z_m
        return y * z, rectangle_torsion(y, z), y * z**3 / 12, z * y**3 / 12
    outer = table.diameter_m if isinstance(table, CircleTable) else table.outer_diameter_m
    inner = 0.0 if isinstance(table, CircleTable) else table.outer_diameter_m - 2 * table.wall_m
    second = np.pi * (outer**4 - inner**4) / 64
    return np.pi * (outer**2 - inner**2) / 4, 2 * second, second, second


def rectangle_torsion(a: float, b: float) -> float:
    """Return the torsion constant J [m^4] of a rectangle with sides a and b [m].

    J = a b^3 / 3 (1 - 192 b / (pi^5 a) sum_{n odd} tanh(n pi a / (2 b)) / n^5), a >= b
    (Saint-Venant; Timoshenko and Goodier, Theory of Elasticity, torsion of rectangular bars)
    """
    a, b = max(a, b), min(a, b)
    n = np.arange(1, 400, 2)  # the sum's remainder after n = 399 is below 1e-11 of J
    series = float(np.sum(np.tanh(n * np.pi * a / (2 * b)) / n**5.0))
    return a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * series)


def shear_factors(table: MaterialTable, nu: float) -> tuple[float, float]:
    """Return Cowper's shear factors along y and z [-].

    rectangle 10 (1 + nu) / (12 + 11 nu); circle 6 (1 + nu) / (7 + 6 nu);
    tube 6 (1 + nu)(1 + m^2)^2 / ((7 + 6 nu)(1 + m^2)^2 + (20 + 12 nu) m^2), m = inner / outer radius
    (G. R. Cowper, The shear coefficient in Timoshenko's beam theory, J. Appl. Mech. 33, 1966, table 1)
    """
    if isinstance(table, RectangleTable):
        factor = 10 * (1 + nu) / (12 + 11 * nu)
    else:
        m = 1 - 2 * table.wall_m / table.outer_diameter_m if isinstance(table, TubeTable) else 0.0
        square = (1 + m**2) ** 2
        factor = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * m**2)
    return factor, factor


def section_along(value: Any, sections: Mapping[str, CrossSection], file: Path, path: str) -> Section:
    """Assemble a beam's section from one name or from stations [-]; linear between stations.

    Stations begin at 0, end at 1 and increase; one name is a uniform beam.
    """
    uniform = isinstance(value, str)
    rows = [{"at": 0.0, "section": value}] if uniform else value
    where = place(file, path, "section")
    advice = 'section = [{ at = 0, section = "A" }, { at = 1, section = "B" }]'
    if not isinstance(rows, list) or len(rows) < (1 if uniform else 2):
        expected = "the name of a [sections.NAME], or two or more stations"
        raise InputError(complaint(where, f"section = {toml_text(value)}", expected, advice))
    tables = [validate(StationTable, row, file, f"{path}.section[{k}]") for k, row in enumerate(rows)]
    at = np.array([table.at for table in tables])
    if not uniform and (at[0] != 0.0 or at[-1] != 1.0 or np.any(np.diff(at) <= 0)):
        raise InputError(complaint(where, f"at = {at.tolist()}", "at increasing from 0 to 1 [-]", advice))
    parts = [_named(table.section, sections, where) for table in tables]
    stiffness, retardation = _rows([p.stiffness for p in parts]), _rows([p.retardation for p in parts])
    damping = retardation * stiffness if retardation.any() else None
    mass, rotary = _rows([p.mass_per_length for p in parts]), _rows([p.rotary_inertia for p in parts])
    return Section(at, stiffness, mass, rotary, damping)


def _named(name: str, sections: Mapping[str, CrossSection], where: str) -> CrossSection:
    if name in sections:
        return sections[name]
    near = nearest(name, sections)
    expected = f"one of the sections {', '.join(sections)}" if sections else "a section that the file has"
    advice = f'section = "{near}"' if near else f"a table [sections.{name}]"
    raise InputError(complaint(where, f'section = "{name}"', expected, advice))


def _rows(values: list[Any]) -> Array:
    return np.array(values, dtype=np.float64)
