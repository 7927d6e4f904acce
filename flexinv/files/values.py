"""Types of the values in TOML tables: finite numbers, with bounds and by threes, names and texts."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

LARGEST = 1e30  # no length, mass or stiffness in SI is larger; powers of larger numbers overflow
FORMAT = 1  # of mechanism.toml, cases.toml and identify.toml; a change that an older version would misread raises it
LONGEST_NAME, LONGEST_TEXT = 100, 4000  # [characters]


def bounded(value: Any) -> Any:
    """Refuse (ValueError) what is no finite number of a size that can be meant, at most ``LARGEST`` [any unit]."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("should be a number")
    if value != value or abs(value) > LARGEST:
        raise ValueError(f"should be a finite number, at most {LARGEST:g} in size")
    return value


def clean_name(name: str) -> str:
    """Return a name [-]; ValueError for one that is empty, long or has control characters."""
    if not name.isprintable() or not name.strip() or len(name) > LONGEST_NAME:
        raise ValueError(f"a name is 1 to {LONGEST_NAME} printable characters, none of them a control character")
    return name


def _clean_text(text: str) -> str:
    if not text.strip() or len(text) > LONGEST_TEXT:
        raise ValueError(f"a text is 1 to {LONGEST_TEXT} characters and not only blanks")
    if not all(c.isprintable() or c == "\n" for c in text):
        raise ValueError("a text has no control characters")
    return text


def _known_format(version: int) -> int:
    if not 1 <= version <= FORMAT:
        raise ValueError(f"this version of flexinv reads formats 1 to {FORMAT}; a newer format needs a newer flexinv")
    return version


Format = Annotated[int, AfterValidator(_known_format)]
Number = Annotated[float, BeforeValidator(bounded)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Name = Annotated[str, AfterValidator(clean_name)]
Text = Annotated[str, AfterValidator(_clean_text)]
