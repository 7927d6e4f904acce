"""Identified numbers as robot files say them: mass properties of links, numbers of joints; and what no file can say."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from crosscheck.identification.identify import Identification
from crosscheck.identification.responses.response import compute_link_inertias
from crosscheck.identification.table import Row
from crosscheck.report.words import format_short
from flexinv.errors import InputError
from flexinv.typing import Array

# Of the largest of m, h, I: numbers are written with all their digits, and moved between frames twice.
ROUNDED = 1e-12


def check_new_file(option: str, file: Path) -> None:
    """Raise InputError where a file that is to be written is there already."""
    if file.exists():
        raise InputError(f"{option} {file}: there is such a file, and none is written over; write another name")


def compute_identified_links(identification: Identification) -> dict[str, Array]:
    """Return m, h, I (10,) [kg], [kg m], [kg m^2] of each link whose mass properties were free, in its own frame."""
    machine = identification.machine
    ten = compute_link_inertias(machine.space, machine.mechanism, machine.space.compute_values(identification.fit.z))
    links = enumerate(machine.mechanism.links)
    return {one.name: ten[k] for k, one in links if one.name in machine.space.factors}


def collect_joint_values(rows: Iterable[Row], laws: Mapping[str, str]) -> dict[tuple[str, str], float]:
    """Return the values [unit of each] by joint and attribute; laws : kind of parameter -> attribute, of which several add up."""
    out: dict[tuple[str, str], float] = {}
    for row in rows:
        key = row.place, laws[row.parameter]
        out[key] = out.get(key, 0.0) + row.value
    return out


def check_link_numbers(file: Path, link: str, found: Array, expected: Array) -> None:
    """Raise InputError where m, h, I (10,) [kg], [kg m], [kg m^2] of a written file are not those that were identified."""
    if np.abs(found - expected).max() > ROUNDED * np.abs(expected).max():
        raise InputError(f"{file}: link {link} is read back as {found}, expected {expected}: the file is not written")


def check_joint_number(file: Path, attribute: str, joint: str, found: float, expected: float) -> None:
    """Raise InputError where a number of a joint of a written file [unit of the attribute] is not that which was identified."""
    if abs(found - expected) > ROUNDED * abs(expected):
        raise InputError(
            f"{file}: {attribute} of joint {joint} is read back as {found}, expected {expected}: the file is not written"
        )


def write_checked(file: Path, text: bytes, check: Callable[[], None]) -> None:
    """Write a file, and remove it where its check, which reads it again, raises InputError or comes to no end."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(text)
    try:
        check()
    except BaseException:
        file.unlink()
        raise


def describe_rest(rows: Iterable[Row], said: Collection[tuple[str, str]], kind: str) -> Iterator[str]:
    """Yield what the file does not say, with its value [unit of each]; said : parameter and place; kind : "a URDF"."""
    for row in rows:
        if (row.parameter, row.place) not in said:
            yield f"{row.parameter} of {row.place}: {format_short(row.value)} {row.unit}, which {kind} cannot say"
