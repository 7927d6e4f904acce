"""Rules of fields: what a field of a frozen record may hold, stated beside the fields and checked when a record is made.

A rule takes the words that name a field and the value that was given.  It returns the value as the record holds it (floats,
read-only arrays of floats, tuples), or raises the InputError of `flexinv.validation`.  So every record of a mechanism is valid
from its first moment on, whoever made it, and takes plain lists, whole numbers and numbers of single precision.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

import numpy as np

from flexinv.validation import (
    ARRAY_TYPE,
    FLOAT_TYPE,
    LARGEST_INTEGER,
    check_finite_array,
    check_flag,
    check_kind,
    check_number,
    check_whole_number,
    format_shape,
    refuse,
)

Rule = Callable[[str, Any], Any]
Rules = Mapping[str, Rule]
LARGEST_REAL = float(np.finfo(float).max)
# By how much a unit axis or a rotation may be off: numbers of single precision are by 1e-7, ones with six decimals by 1e-6.
NOT_UNIT = 1e-5


def make_real_rule(
    unit: str, least: float = -LARGEST_REAL, above: bool = False, most: float = LARGEST_REAL, infinite: bool = False
) -> Rule:
    """Return the rule of a number [any unit] from ``least`` to ``most``, with ``above`` more than the least.

    infinite : it may be beyond all numbers (limits that are not stated)
    """
    words = "a number" if infinite else "a finite number"
    if most < LARGEST_REAL:
        words += f" from {least:g} to {most:g}"
    elif least > -LARGEST_REAL:
        words += f" above {least:g}" if above else f", {least:g} or more"
    expected = f"{words} [{unit}]"

    def check_value(name: str, value: Any) -> float:
        given = value if type(value) is float else check_number(name, value, expected)
        unbounded = infinite and (given == np.inf or (given == -np.inf and least == -LARGEST_REAL))
        inside = least <= given <= most and not (above and given == least)
        if not (inside or unbounded):
            refuse(name, value, expected)
        return given

    return check_value


def make_array_rule(shape: tuple[int | None, ...], unit: str, least: float = -LARGEST_REAL) -> Rule:
    """Return the rule of an array [any unit] of finite numbers of a shape (None: any number), none below ``least``."""
    words = f"{format_shape(shape)} [{unit}]"

    def check_value(name: str, value: Any) -> Any:
        given = check_finite_array(name, value, shape, unit)
        if least > -LARGEST_REAL and (given < least).any():
            refuse(f"{name}, smallest {float(given.min()):g}", value, f"numbers {words}, {least:g} or more")
        return copy_read_only(given)

    return check_value


def check_unit_vector(name: str, value: Any) -> Any:
    """Return a direction of length 1, (3,) [-]; raises InputError for another length."""
    given = check_finite_array(name, value, (3,), "-")
    length = float(np.linalg.norm(given))
    if abs(length - 1.0) > NOT_UNIT:
        advice = str((given / length).round(9).tolist()) if length else "[0, 0, 1]"
        refuse(name, given.tolist(), "a direction of length 1 (3,) [-]", advice)
    return copy_read_only(given)


def check_rotation(name: str, value: Any) -> Any:
    """Return a rotation matrix R, (3, 3) [-]; raises InputError unless R R^T = 1 and det R = 1."""
    if value is IDENTITY:
        return value
    given = check_finite_array(name, value, (3, 3), "-")
    off = float(np.abs(given @ given.T - IDENTITY).max())
    if off > NOT_UNIT or _is_reflection(given):
        why = f"R R^T is off the identity by {off:.3g}" if off > NOT_UNIT else "det R = -1, a reflection"
        expected = f"a rotation matrix (3, 3) [-], of which {why}"
        refuse(name, given.tolist(), expected)
    return copy_read_only(given)


def _is_reflection(given: Any) -> bool:
    """Return True where det R < 0, by plain numbers: NumPy's calls took longer than all the rest."""
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = given.tolist()
    cross = (xy * yz - xz * yy) * zx
    return bool(cross - (xx * yz - xz * yx) * zy + (xx * yy - xy * yx) * zz < 0.0)


def copy_read_only(values: Any) -> Any:
    """Return an array of floats [any unit] that nobody can write to: itself if it is one, else a copy."""
    if type(values) is ARRAY_TYPE and values.dtype is FLOAT_TYPE and not values.flags.writeable:
        return values
    copy = np.array(values, dtype=FLOAT_TYPE)
    copy.flags.writeable = False
    return copy


ORIGIN = copy_read_only(np.zeros(3))
IDENTITY = copy_read_only(np.eye(3))


def check_text(name: str, value: Any) -> str:
    """Return a text [-]; raises InputError for what is none."""
    if not isinstance(value, str):
        refuse(name, value, "a text")
    return str(value)


def check_truth(name: str, value: Any) -> bool:
    """Return True or False [-]; raises InputError for what is neither."""
    return value if type(value) is bool else check_flag(name, value)


def count(least: int) -> Rule:
    """Return the rule of a whole number [-], ``least`` or more."""

    def check_value(name: str, value: Any) -> int:
        return (
            value
            if type(value) is int and least <= value <= LARGEST_INTEGER
            else check_whole_number(name, value, least)
        )

    return check_value


def make_option_rule(options: Collection[str]) -> Rule:
    """Return the rule of a text that is one of the options [-]."""

    def check_value(name: str, value: Any) -> str:
        if not isinstance(value, str) or value not in options:
            refuse(name, value, f"one of {', '.join(options)}")
        return str(value)

    return check_value


def make_kind_rule(*kinds: type) -> Rule:
    """Return the rule of a record of one of these kinds [-]."""

    def check_value(name: str, value: Any) -> Any:
        if not isinstance(value, kinds):
            if len(kinds) == 1:
                check_kind(name, value, kinds[0])
            refuse(name, value, " or ".join(f"a {kind.__name__}" for kind in kinds))
        return value

    return check_value


def make_optional_rule(rule: Rule) -> Rule:
    """Return the rule [-] of a value that may be None, too."""

    def check_value(name: str, value: Any) -> Any:
        return None if value is None else rule(name, value)

    return check_value


def make_list_rule(rule: Rule) -> Rule:
    """Return the rule of a list or a tuple [-] whose parts keep a rule; it becomes a tuple."""

    def check_value(name: str, value: Any) -> tuple[Any, ...]:
        if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
            refuse(name, value, "a list or a tuple")
        return tuple(rule(f"{name}[{k}]", part) for k, part in enumerate(value))

    return check_value


def make_pair_rule(first: Rule, second: Rule) -> Rule:
    """Return the rule of two values [-], each with a rule of its own; they become a tuple."""

    def check_value(name: str, value: Any) -> tuple[Any, Any]:
        if isinstance(value, str | Mapping) or not isinstance(value, Iterable) or len(parts := tuple(value)) != 2:
            refuse(name, value, "a list or a tuple of two")
        return first(f"{name}[0]", parts[0]), second(f"{name}[1]", parts[1])

    return check_value
