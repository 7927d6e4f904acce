"""A mechanism of ours as a description: its drives expanded into rotors, friction and gears."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from crosscheck.lifting.attachment_features import list_force_features
from crosscheck.lifting.description import Description
from crosscheck.lifting.reader_dynamics import Feature, Parameter
from crosscheck.measures.mechanisms import read_mechanism
from flexinv.model.mechanism import Joint


def lift_toml(path: Path) -> Description:
    """Return the mechanism of a folder or of its file [m, kg, rad].  Raises InputError."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mechanism = read_mechanism(path)
    gears = {joint.name: joint.drive.ratio for joint in mechanism.joints if joint.drive is not None}
    dropped = [str(one.message) for one in caught]
    features = (*_find_elastic_drives(mechanism.joints), *list_force_features(mechanism.springs, mechanism.forces))
    label = f"{path.parent.name}/{path.name}" if path.suffix else path.name
    return Description(
        label,
        replace(mechanism, springs=(), forces=()),
        "toml",
        "flexinv",
        gears,
        tuple(dropped),
        file=path,
        features=features,
    )


def _find_elastic_drives(joints: Iterable[Joint]) -> Iterator[Feature]:
    """Drives with an elastic joint whose link is moved: no spring of the mechanism, but of the way to the motor."""
    for joint in joints:
        drive = joint.drive
        if drive is not None and drive.stiffness and drive.moves == "link":
            numbers: dict[str, Parameter] = {
                key: value for key, value in vars(drive).items() if isinstance(value, int | float)
            }
            yield Feature("elastic-drive", f"joint {joint.name}", numbers, felt=False, joints=(joint.name,))
