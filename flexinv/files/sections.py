"""Beam sections of a mechanism file: stiffness and inertia per length, given or from geometry and material."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from flexinv.errors import InputError
from flexinv.files.schema import SOURCE, Across, Rotary, SixBySix, Times
from flexinv.files.toml_tables import (
    Location,
    Table,
    check_table,
    format_toml,
    make_key,
    make_optional_key,
    read_option,
)
from flexinv.files.values import Fraction, Name, NotNegative, Number, Positive, Text
from flexinv.model.mechanism import Section
from flexinv.typing import Array
from flexinv.validation import find_nearest_word

RETARDATION = make_key(
    "damping, stress by rate of strain over stress by strain [s]: one number, or { axial, shear, twist, bending }",
    "1e-3", (0.0,) * 6,
)  # fmt: skip


class StationTable(Table):
    """Section of a beam at a fraction of its length."""

    at: Fraction = make_key("the fraction 0..1 of the length [-]; two stations at the same one are a step", "0.5")
    section: Name = make_key("the name of a table [sections.NAME]", '"tube"')


class StiffnessSectionTable(Table):
    """A section by its numbers."""

    retardation_s: Times = RETARDATION
    EA_N: Positive = make_key("axial stiffness, a number > 0 [N]", "1.452e6")
    GA_N: Across = make_key("shear stiffness with its shear factor [N]: one number, or { y, z }", "4.65e5")
    GJ_Nm2: Positive = make_key("torsional stiffness, a number > 0 [N m^2]", "0.68")
    EI_Nm2: Across = make_key("bending stiffness [N m^2]: one number, or about { y, z }", "{ y = 13.7, z = 0.46 }")
    mass_per_length_kg_per_m: Positive = make_key("mass per length, a number > 0 [kg/m]", "0.056")
    rho_I_kgm: Rotary = make_key(
        "rotary inertia per length [kg m]: { y, z } (x is their sum unless given), one number for both, or 0 if none",
        "{ y = 5.3e-7, z = 1.77e-8 }",
    )
    source: Text = SOURCE


class AxisTable(Table):
    """Place of an axis in a section."""

    y_m: Number = make_key("along the section's y, a number [m]", "0.01", 0.0)
    z_m: Number = make_key("along the section's z, a number [m]", "-0.02", 0.0)
    turn_deg: Number = make_key("a turn about x, from y to z, a number [deg]", "5", 0.0)


class MatrixSectionTable(Table):
    """A section by its matrices, as VABS, SONATA or BeamDyn have them."""

    shape: Literal["matrices"] = make_key('"matrices", or "rectangle", "circle", "tube"', '"matrices"')
    convention: Literal["VABS", "BeamDyn"] = make_key(
        '"VABS": axial, shear y, shear z, twist, bending y, bending z; "BeamDyn": shear, shear, axial, bending, bending, twist',
        '"VABS"', "VABS",
    )  # fmt: skip
    stiffness_matrix: SixBySix = make_key(
        "six rows of six numbers, symmetric and positive definite [N, N m, N m^2]", "[[1.4e6, 0, 0, 0, 0, 0], ...]"
    )
    mass_matrix: SixBySix = make_key(
        "six rows of six numbers per length, about the axis of the stiffness [kg/m, kg, kg m]",
        "[[0.06, 0, 0, 0, 0, -1e-4], ...]",
    )
    damping_matrix: SixBySix | None = make_optional_key(
        "six rows of six numbers, stress by rate of strain [N s, N m s, N m^2 s]", "[[1.4e2, 0, 0, 0, 0, 0], ...]"
    )
    retardation_s: NotNegative = make_key("damping over stiffness, a number, 0 or more [s]", "1e-3", 0.0)
    axis: AxisTable = make_key(
        "where the beam's axis is in the axes of the matrices: { y_m, z_m, turn_deg }", "{ y_m = 0.01 }", AxisTable()
    )
    source: Text = SOURCE


class MaterialTable(Table):
    """Material: the keys that all sections given by their geometry share."""

    E_Pa: Positive = make_key("Young's modulus, a number > 0 [Pa]", "70e9")
    nu: Annotated[Number, Field(gt=-1, le=0.5)] | None = make_optional_key(
        "Poisson's ratio, -1 < nu <= 0.5 [-]", "0.33"
    )
    G_Pa: Positive | None = make_optional_key("shear modulus, a number > 0 [Pa]", "26e9")
    retardation_s: Times = RETARDATION
    rho_kg_per_m3: Positive = make_key("density, a number > 0 [kg/m^3]", "2700")
    shear_factor: Across | None = make_optional_key(
        "shear factor [-]: one number, or { y, z }; Cowper's when absent", "0.85"
    )
    source: Text = SOURCE


class RectangleTable(MaterialTable):
    """A rectangle, its sides along y and z."""

    shape: Literal["rectangle"] = make_key('"rectangle", "circle" or "tube"', '"rectangle"')
    size_y_m: Positive = make_key("the side along y, a number > 0 [m]", "0.002")
    size_z_m: Positive = make_key("the side along z, a number > 0 [m]", "0.02")


class CircleTable(MaterialTable):
    """A full circle."""

    shape: Literal["circle"] = make_key('"rectangle", "circle" or "tube"', '"circle"')
    diameter_m: Positive = make_key("the diameter, a number > 0 [m]", "0.02")


class TubeTable(MaterialTable):
    """A round tube."""

    shape: Literal["tube"] = make_key('"rectangle", "circle" or "tube"', '"tube"')
    outer_diameter_m: Positive = make_key("the outer diameter, a number > 0 [m]", "0.05")
    wall_m: Positive = make_key("the wall thickness, > 0 and at most half the diameter [m]", "0.003")


ShapeTable = RectangleTable | CircleTable | TubeTable
SECTION_SHAPES: dict[str, type[ShapeTable]] = {"rectangle": RectangleTable, "circle": CircleTable, "tube": TubeTable}
MATRICES = "matrices"
MATRIX_KEYS = ("stiffness_matrix", "mass_matrix", "damping_matrix")
MATERIAL_KEYS = tuple(dict.fromkeys(key for table in SECTION_SHAPES.values() for key in table.model_fields))
# Where axial, shear y, shear z, twist, bending y, bending z stand: BeamDyn's z runs along the beam, its x and y are our y and z.
MATRIX_ORDERS = {"VABS": [0, 1, 2, 3, 4, 5], "BeamDyn": [2, 0, 1, 5, 3, 4]}
# A taper is stated at so many stations that what is linear between them is off by this part of it at most: EI goes with the
# fourth power of dimensions, and 1e-5 is far below what anybody knows of a section.
TAPER = 1e-5
MOST_HALVINGS = 16


@dataclass(frozen=True)
class CrossSection:
    """One cross-section in numbers (16,), and the shape and material that they follow from, None where they are given.

    numbers : stiffness (6) [N, N, N, N m^2, N m^2, N m^2], mass [kg/m], rotary inertia (3) [kg m], retardation (6) [s]
    coupled : the section of matrices, whose numbers are nan; None of all others
    """

    numbers: Array
    table: ShapeTable | None = None
    coupled: Section | None = None

    def build_section(self) -> Section:
        """Return the section of one station [N], [N m^2], [kg/m], [kg m]."""
        return self.coupled or _build_section(np.zeros(1), self.numbers[None])


def read_section(data: Any, where: Location) -> CrossSection:
    """Read ``[sections.NAME]``: by ``shape`` and material, or by its numbers [N, N m^2, kg/m, kg m]."""
    shapes = (*SECTION_SHAPES, MATRICES)
    shape = read_option(data, where, "shape", shapes, f"one of {', '.join(shapes)}", "rectangle")
    if isinstance(data, dict):
        _check_one_form(data, shape, where)
    if shape == MATRICES:
        return _read_matrices(check_table(MatrixSectionTable, data, where), where)
    if not shape:
        given = check_table(StiffnessSectionTable, data, where)
        stiffness = given.EA_N, *given.GA_N, given.GJ_Nm2, *given.EI_Nm2
        inertia = given.mass_per_length_kg_per_m, *given.rho_I_kgm
        return CrossSection(np.array([*stiffness, *inertia, *given.retardation_s]))
    table = check_table(SECTION_SHAPES[shape], data, where)
    if isinstance(table, TubeTable) and table.wall_m > table.outer_diameter_m / 2:
        expected = f"at most half of outer_diameter_m = {table.outer_diameter_m} [m]"
        raise where.make_error(
            "wall_m", f"wall_m = {table.wall_m}", expected, f"wall_m = {table.outer_diameter_m / 10:g}"
        )
    if (table.nu is None) == (table.G_Pa is None):
        raise where.make_error(
            "nu", "neither" if table.nu is None else "both", "one of nu [-] and G_Pa [Pa]", "nu = 0.33"
        )
    return _compute_section(table)


def _check_one_form(data: Mapping[str, Any], shape: str, where: Location) -> None:
    """Raise InputError for matrices beside other numbers, or without the shape that says that they are there."""
    stated = [key for key in MATRIX_KEYS if key in data]
    if not stated and shape != MATRICES:
        return
    others = [key for key in (*StiffnessSectionTable.model_fields, *MATERIAL_KEYS) if key in data]
    beside = [key for key in others if key not in MatrixSectionTable.model_fields]
    if beside:
        given = f"{beside[0]} beside {stated[0]}" if stated else f'{beside[0]} beside shape = "{MATRICES}"'
        expected = "a section by matrices or one by numbers, not both"
        raise where.make_error(beside[0], given, expected, f"either without {', '.join(beside)}, or without matrices")
    if shape != MATRICES:
        given = f'{stated[0]} with shape = "{shape}"' if shape else f"{stated[0]} without a shape"
        raise where.make_error("shape", given, "the shape that matrices belong to", f'shape = "{MATRICES}"')


def _read_matrices(table: MatrixSectionTable, where: Location) -> CrossSection:
    """The section of matrices about the beam's axis."""
    if table.damping_matrix is not None and table.retardation_s:
        expected = "one of retardation_s [s] and damping_matrix [N s, N m s, N m^2 s]"
        raise where.make_error("damping_matrix", "both", expected, "retardation_s = 1e-3")
    order = np.ix_(MATRIX_ORDERS[table.convention], MATRIX_ORDERS[table.convention])
    stiffness = table.stiffness_matrix[order]
    damping = None if table.damping_matrix is None else table.damping_matrix[order]
    if table.retardation_s:
        damping = table.retardation_s * stiffness
    lost = None if damping is None else damping[None]
    at = table.axis
    try:
        made = Section.build_from_matrices(np.zeros(1), stiffness[None], table.mass_matrix[order][None], lost)
    except InputError as error:
        reason = str(error).removeprefix("Section: ")
        key = next((key for key in MATRIX_KEYS if reason.startswith(key.split("_")[0])), MATRIX_KEYS[0])
        given, _, expected = reason.rpartition("; expected ")
        advice = f"the numbers of the cross-section's analysis, with convention = one of {', '.join(MATRIX_ORDERS)}"
        raise where.make_error(key, given.replace("[0]", "", 1), expected, advice) from None
    moved = at.y_m or at.z_m or at.turn_deg
    whole = made.move_axis(at.y_m, at.z_m, float(np.radians(at.turn_deg))) if moved else made
    if not whole.is_coupled:
        return CrossSection(_list_numbers(whole), coupled=None)
    return CrossSection(np.full(16, np.nan), coupled=whole)


def _list_numbers(section: Section) -> Array:
    """The numbers (16,) of a section of one station whose matrices are diagonal."""
    damping = np.zeros(6) if section.damping is None else section.damping[0]
    retardation = damping / section.stiffness[0]
    return np.array([*section.stiffness[0], section.mass_per_length[0], *section.rotary_inertia[0], *retardation])


def _compute_section(table: ShapeTable) -> CrossSection:
    """EA, k_y GA, k_z GA, G J, E I_y, E I_z; rho A; rho (I_y + I_z), rho I_y, rho I_z."""
    young, shear, poisson = _resolve_moduli(table)
    if isinstance(table, RectangleTable):  # A [m^2], J, I_y = int z^2 dA, I_z = int y^2 dA [m^4]
        y = table.size_y_m
        z = table.size_z_m
        area = y * z
        torsion = compute_rectangle_torsion(y, z)
        second_y = y * z**3 / 12
        second_z = z * y**3 / 12
    else:
        outer = table.diameter_m if isinstance(table, CircleTable) else table.outer_diameter_m
        inner = 0.0 if isinstance(table, CircleTable) else table.outer_diameter_m - 2 * table.wall_m
        second_y = second_z = np.pi * (outer**4 - inner**4) / 64
        area = np.pi * (outer**2 - inner**2) / 4
        torsion = 2 * second_y
    factors = table.shear_factor or compute_shear_factors(table, poisson)
    rho = table.rho_kg_per_m3
    numbers = [
        young * area, factors[0] * shear * area, factors[1] * shear * area,
        shear * torsion, young * second_y, young * second_z,
        rho * area, rho * (second_y + second_z), rho * second_y, rho * second_z, *table.retardation_s,
    ]  # fmt: skip
    return CrossSection(np.array(numbers), table)


def _resolve_moduli(table: MaterialTable) -> tuple[float, float, float]:
    """E, G and nu from E and one of the others: G = E / (2 (1 + nu))."""
    if table.G_Pa is not None:
        return table.E_Pa, table.G_Pa, table.E_Pa / (2 * table.G_Pa) - 1
    assert table.nu is not None
    return table.E_Pa, table.E_Pa / (2 * (1 + table.nu)), table.nu


def compute_rectangle_torsion(a: float, b: float) -> float:
    """Return the torsion constant J [m^4] of a rectangle with sides a and b [m].

    J = a b^3 / 3 (1 - 192 b / (pi^5 a) sum_{n odd} tanh(n pi a / (2 b)) / n^5), a >= b
    (Saint-Venant; Timoshenko and Goodier, Theory of Elasticity, torsion of rectangular bars)
    """
    a, b = max(a, b), min(a, b)
    n = np.arange(1, 400, 2)  # the sum's remainder after n = 399 is below 1e-11 of J
    series = float(np.sum(np.tanh(n * np.pi * a / (2 * b)) / n**5.0))
    return a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * series)


def compute_shear_factors(table: MaterialTable, nu: float) -> tuple[float, float]:
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


def assemble_section(value: Any, sections: Mapping[str, CrossSection], where: Location) -> Section:
    """Assemble a beam's section from one name or from stations [-].

    Stations begin at 0, end at 1 and increase, two equal ones are a step; one name is a uniform beam.  Between two sections of
    one shape dimensions and material are linear (more stations say so), between others stiffness and mass are.
    """
    tables = _read_stations(value, where)
    stated = [_find_section(table.section, sections, where) for table in tables]
    at = [table.at for table in tables]
    stations = [(at[0], stated[0])]  # with more between those of one shape, wherever linear would not be the taper
    for (start, first), (end, last) in pairwise(zip(at, stated, strict=True)):
        if end > start and first.table is not None and type(first.table) is type(last.table):
            stations += _list_stations_between(first, last, start, end)
        stations.append((end, last))
    places = np.array([place for place, _ in stations])
    parts = [part for _, part in stations]
    if any(part.coupled for part in parts):
        return _join_sections(places, [part.build_section() for part in parts])
    return _build_section(places, np.array([part.numbers for part in parts]))


def _join_sections(places: Array, parts: list[Section]) -> Section:
    """The section whose matrices at the places are those of sections of one station each."""
    stiffness, mass, damping = (
        np.concatenate([getattr(section, name) for section in parts])
        for name in ("stiffness_matrices", "mass_matrices", "damping_matrices")
    )
    return Section.build_from_matrices(places, stiffness, mass, damping if damping.any() else None)


def _build_section(places: Array, numbers: Array) -> Section:
    """The section of the numbers (stations, 16) of `CrossSection`."""
    stiffness, mass, rotary, retardation = np.split(numbers, [6, 7, 10], axis=1)
    return Section(places, stiffness, mass[:, 0], rotary, retardation * stiffness if retardation.any() else None)


def _read_stations(value: Any, where: Location) -> list[StationTable]:
    """The stations that a file states, one at the root where it has nothing but a name."""
    if isinstance(value, str):
        return [check_table(StationTable, {"at": 0.0, "section": value}, where.make_inner_location("section[0]"))]
    advice = 'section = [{ at = 0, section = "A" }, { at = 1, section = "B" }]'
    if not isinstance(value, list) or len(value) < 2:
        expected = "the name of a [sections.NAME], or two or more stations"
        raise where.make_error("section", f"section = {format_toml(value)}", expected, advice)
    tables = [check_table(StationTable, row, where.make_inner_location(f"section[{k}]")) for k, row in enumerate(value)]
    at = np.array([table.at for table in tables])
    if at[0] != 0.0 or at[-1] != 1.0 or not _is_station_list(at):
        expected = "at increasing from 0 to 1 [-]; two equal ones between are a step"
        raise where.make_error("section", f"at = {at.tolist()}", expected, advice)
    return tables


def _find_section(name: str, sections: Mapping[str, CrossSection], where: Location) -> CrossSection:
    if name in sections:
        return sections[name]
    near = find_nearest_word(name, sections)
    expected = f"one of the sections {', '.join(sections)}" if sections else "a section that the file has"
    write = f'section = "{near}"' if near else f"a table [sections.{name}]"
    raise where.make_error("section", f'section = "{name}"', expected, write)


def _is_station_list(at: NDArray[np.floating]) -> bool:
    """True for stations that increase, but for two and two that are equal between the ends: there the section steps."""
    steps = np.diff(at)
    lone = not np.any((steps[1:] == 0.0) & (steps[:-1] == 0.0))
    return bool(np.all(steps >= 0.0) and lone and steps[0] > 0.0 and steps[-1] > 0.0)


def _list_stations_between(
    first: CrossSection, last: CrossSection, start: float, end: float
) -> list[tuple[float, CrossSection]]:
    """Stations between two of one shape, halved until linear is near enough; stacked instead of nested."""
    out: list[tuple[float, CrossSection]] = []
    todo = [(0.0, first, 1.0, last, 0)]
    while todo:
        a, one, b, two, depth = todo.pop()
        middle = _make_section_between(first, last, (a + b) / 2)
        off = (one.numbers + two.numbers) / 2 - middle.numbers
        if depth < MOST_HALVINGS and (np.abs(off) > TAPER * np.abs(middle.numbers)).any():
            todo += [((a + b) / 2, middle, b, two, depth + 1), (a, one, (a + b) / 2, middle, depth + 1)]
        elif b < 1.0:
            out.append((start + b * (end - start), two))
    return out


def _make_section_between(first: CrossSection, last: CrossSection, part: float) -> CrossSection:
    """The section at a part of the way from one to another of the same shape: dimensions, E, G, density linear."""
    a = first.table
    b = last.table
    assert a is not None
    assert b is not None

    def compute_mean(one: ArrayLike, two: ArrayLike) -> Any:
        return ((1 - part) * np.asarray(one) + part * np.asarray(two)).tolist()

    sizes = [key for key in type(a).model_fields if key.endswith("_m")]
    same = (*sizes, "E_Pa", "rho_kg_per_m3", "retardation_s")
    change = {key: compute_mean(getattr(a, key), getattr(b, key)) for key in same}
    change |= {"nu": None, "G_Pa": compute_mean(_resolve_moduli(a)[1], _resolve_moduli(b)[1])}
    if a.shear_factor or b.shear_factor:
        change["shear_factor"] = compute_mean(
            *(one.shear_factor or compute_shear_factors(one, _resolve_moduli(one)[2]) for one in (a, b))
        )
    return _compute_section(a.model_copy(update=change))
