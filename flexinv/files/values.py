"""Values in TOML tables: finite numbers, names and texts, and keys that end in their unit (``length_m``)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

LARGEST_NUMBER = 1e30  # no length, mass or stiffness in SI is larger; powers of larger numbers overflow
FORMAT = 1  # of mechanism.toml, cases.toml and identify.toml; a change that an older version would misread raises it
# [characters]
LONGEST_NAME = 100
LONGEST_TEXT = 4000


def check_bounded(value: Any) -> Any:
    """Refuse (ValueError) what is no finite number of a size that can be meant, at most ``LARGEST_NUMBER`` [any unit]."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("should be a number")
    if value != value or abs(value) > LARGEST_NUMBER:
        raise ValueError(f"should be a finite number, at most {LARGEST_NUMBER:g} in size")
    return value


def check_name(name: str) -> str:
    """Return a name [-]; ValueError for one that is empty, long or has control characters."""
    if not name.isprintable() or not name.strip() or len(name) > LONGEST_NAME:
        raise ValueError(f"a name is 1 to {LONGEST_NAME} printable characters, none of them a control character")
    return name


def _check_text(text: str) -> str:
    if not text.strip() or len(text) > LONGEST_TEXT:
        raise ValueError(f"a text is 1 to {LONGEST_TEXT} characters and not only blanks")
    if not all(c.isprintable() or c == "\n" for c in text):
        raise ValueError("a text has no control characters")
    return text


def _check_format_version(version: int) -> int:
    if not 1 <= version <= FORMAT:
        raise ValueError(f"this version of flexinv reads formats 1 to {FORMAT}; a newer format needs a newer flexinv")
    return version


Format = Annotated[int, AfterValidator(_check_format_version)]
Number = Annotated[float, BeforeValidator(check_bounded)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Name = Annotated[str, AfterValidator(check_name)]
Text = Annotated[str, AfterValidator(_check_text)]


# One dictionary per dimension: unit as it is written in a key -> its size in the unit of size 1 (the SI one).
DIMENSIONS: tuple[dict[str, float], ...] = (
    {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "km": 1e3, "in": 0.0254, "ft": 0.3048},
    {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "t": 1e3, "lb": 0.45359237},
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    {"rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295},
    {"kgm2": 1.0, "kgmm2": 1e-6, "kgcm2": 1e-4, "gm2": 1e-3, "gcm2": 1e-7, "gmm2": 1e-9},
    {"N": 1.0, "kN": 1e3, "MN": 1e6, "mN": 1e-3},
    {"Nm": 1.0, "kNm": 1e3, "Nmm": 1e-3, "mNm": 1e-3, "Ncm": 1e-2},
    {"Nm2": 1.0, "kNm2": 1e3, "Nmm2": 1e-6},
    {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "N_per_mm2": 1e6},
    {"kg_per_m": 1.0, "g_per_m": 1e-3, "kg_per_mm": 1e3, "g_per_mm": 1.0},
    {"kg_per_m3": 1.0, "g_per_cm3": 1e3, "kg_per_dm3": 1e3},
    {"kgm": 1.0, "kgmm": 1e-3, "gmm": 1e-6},
    {"m_per_s2": 1.0, "mm_per_s2": 1e-3},
    {"m_per_s": 1.0, "mm_per_s": 1e-3},
    {"rad_per_s": 1.0, "deg_per_s": 0.017453292519943295, "rpm": 0.10471975511965977},
    {"per_m": 1.0, "rad_per_m": 1.0, "deg_per_m": 0.017453292519943295, "per_mm": 1e3},
    {"Nms_per_rad": 1.0, "Nmms_per_rad": 1e-3, "Nms_per_deg": 57.29577951308232},
    {"Ns_per_m": 1.0, "Ns_per_mm": 1e3},
    {"Nm_per_A": 1.0, "mNm_per_A": 1e-3},
    {"N_per_m": 1.0, "N_per_mm": 1e3, "kN_per_m": 1e3},
    {"Nm_per_rad": 1.0, "Nm_per_deg": 57.29577951308232, "Nmm_per_rad": 1e-3, "kNm_per_rad": 1e3},
)
UNITS = {unit: dimension for dimension in DIMENSIONS for unit in dimension}


def split_unit(key: str) -> tuple[str, str]:
    """Split a key into its stem and its unit; the unit is ``""`` when it ends in none.

    ``mass_per_length_kg_per_m`` -> (``mass_per_length``, ``kg_per_m``) [-]: the longest ending that is a unit.
    """
    parts = key.split("_")
    for k in range(1, len(parts)):
        unit = "_".join(parts[k:])
        if unit in UNITS:
            return "_".join(parts[:k]), unit
    return key, ""


def convert_number(value: Any, unit: str, target: str) -> Any:
    """Return a number, or a list or table of numbers, given in [unit], in [target]; None if that cannot be.

    Twelve digits are kept: what was typed in one unit reads as it would be typed in the other.
    """
    if unit not in UNITS or UNITS[unit] is not UNITS.get(target):
        return None
    if isinstance(value, list):
        parts = [convert_number(part, unit, target) for part in value]
        return None if any(part is None for part in parts) else parts
    if isinstance(value, dict):
        table = {key: convert_number(part, unit, target) for key, part in value.items()}
        return None if any(part is None for part in table.values()) else table
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(f"{value * UNITS[unit][unit] / UNITS[unit][target]:.12g}")


def find_correction(key: str, value: Any, known: Iterable[str]) -> tuple[str, Any] | None:
    """Find the known key that ``key`` is in another unit or without one, and the value in that key's unit [-].

    Returns None when no known key has the same stem; the value is None when it cannot be converted.
    """
    stem, unit = split_unit(key)
    same = [name for name in known if split_unit(name)[0] == stem and split_unit(name)[1]]
    for name in same:
        number = convert_number(value, unit, split_unit(name)[1])
        if number is not None:
            return name, number
    return (same[0], value if not unit and len(same) == 1 else None) if same else None
