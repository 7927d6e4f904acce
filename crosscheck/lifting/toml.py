"""A mechanism of ours as a description: its drives expanded into rotors, friction and gears."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

from crosscheck.lifting.description import Description
from crosscheck.measures.mechanisms import read_mechanism
from flexinv.model.mechanism import Joint


def lift_toml(path: Path) -> Description:
    """Return the mechanism of a folder or of its file [m, kg, rad].  Raises InputError."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stated = read_mechanism(path)
    gears = {joint.name: joint.drive.ratio for joint in stated.joints if joint.drive is not None}
    dropped = [str(one.message) for one in caught]
    dropped += [f"drive of joint {j.name}: an elastic one whose link is moved" for j in stated.joints if _elastic(j)]
    dropped += [
        f"{len(getattr(stated, key))} {key}: not compared" for key in ("springs", "forces") if getattr(stated, key)
    ]
    label = f"{path.parent.name}/{path.name}" if path.suffix else path.name
    return Description(
        label, replace(stated, springs=(), forces=()), "toml", "flexinv", gears, tuple(dropped), file=path
    )


def _elastic(joint: Joint) -> bool:
    return joint.drive is not None and bool(joint.drive.stiffness) and joint.drive.moves == "link"
