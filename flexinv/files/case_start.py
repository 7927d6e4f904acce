"""Start of a case: positions of the joints that its motion leaves out; in a loop, the guess that selects the branch."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.errors import InputError
from flexinv.files.case_motion import ANGLE, TURN, Reader, plain
from flexinv.files.case_schema import (
    AngleStartTable,
    PoseStartTable,
    PositionStartTable,
    RotationStartTable,
    TwoAnglesStartTable,
)
from flexinv.files.toml_tables import Table, complaint, location, validate
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array
from flexinv.validation import nearest

# Units of the velocity coordinates of a kind of joint -> its table, the parts of its coordinates (by their keys), an example.
STARTS: dict[tuple[str, ...], tuple[type[Table], tuple[dict[str, Reader], ...], str]] = {
    ("rad",): (AngleStartTable, (ANGLE,), "{ deg = 30 }"),
    ("m",): (PositionStartTable, ({"m": plain},), "{ m = 0.1 }"),
    2 * ("rad",): (TwoAnglesStartTable, (ANGLE,), "{ deg = [10, -5] }"),
    3 * ("rad",): (RotationStartTable, (TURN,), "{ rpy_deg = [0, 0, 90] }"),
    (*3 * ("m",), *3 * ("rad",)): (
        PoseStartTable,
        ({"xyz_m": plain}, TURN),
        "{ xyz_m = [0, 0, 1], rpy_deg = [0, 0, 0] }",
    ),
}


def read_start(
    tables: Mapping[str, Any], mechanism: Mechanism, motion: Motion, file: Path, path: str
) -> dict[str, Array]:
    """Read the start of joints that the motion leaves out: joint -> its coordinates [rad], [m], quaternion [-]."""
    given = motion.joints(mechanism)
    passive = [joint.name for joint in mechanism.joints if joint.nv and joint.name not in given]
    for name in tables:
        if name not in passive:
            _refuse(name, name in given, passive, file, path)
    return read_places(tables, mechanism, passive, file, path)


def read_places(
    tables: Mapping[str, Any], mechanism: Mechanism, joints: list[str], file: Path, path: str
) -> dict[str, Array]:
    """Read where joints are, each of ``joints`` or none: joint -> its coordinates [rad], [m], quaternion [-]."""
    out = {}
    for name, data in tables.items():
        if name not in joints:
            near = nearest(name, joints)
            expected = f"a joint of {mechanism.name} that moves: {', '.join(joints[:20]) or 'there is none'}"
            write = f"{near} instead of {name}" if near else f"no start.{name}"
            raise InputError(complaint(location(file, path, name), f"a start for joint {name}", expected, write))
        model, parts, write = STARTS[KINDS[mechanism.joint_of[name].kind].units]
        where = f"{path}.{name}"
        table = validate(model, data, file, where)
        out[name] = np.concatenate([_part(table, part, write, file, where) for part in parts])
    return out


def _refuse(name: str, moved: bool, passive: list[str], file: Path, path: str) -> None:
    near = nearest(name, passive)
    given = f"a start for joint {name}" + (", which the motion moves" if moved else "")
    expected = f"a joint that the motion leaves out: {', '.join(passive[:20]) or 'there is none'}"
    write = f"{near} instead of {name}" if near and not moved else f"the motion alone; no start.{name}"
    raise InputError(complaint(location(file, path, name), given, expected, write))


def _part(table: Table, part: Mapping[str, Reader], write: str, file: Path, path: str) -> Array:
    stated = [key for key in part if getattr(table, key) is not None]
    if len(stated) != 1:
        expected = f"where it starts: one of {', '.join(part)}"
        raise InputError(complaint(location(file, path), " and ".join(stated) or "nothing", expected, write))
    return part[stated[0]](getattr(table, stated[0]))
