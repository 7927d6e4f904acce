"""A case kit as a description: the mechanism of its ``case.json``, resolved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from crosscheck.kit.tables import (
    FORMAT,
    BeamData,
    BodyData,
    CaseFile,
    ClosureData,
    End,
    Frame,
    JointData,
    MechanismData,
)
from crosscheck.lifting.attached import list_force_features
from crosscheck.lifting.description import Description
from flexinv.errors import InputError
from flexinv.files.toml_tables import make_input_error, read_bytes
from flexinv.model.mechanism import Attachment, Beam, Body, Closure, Inertia, Joint, Link, Mechanism, Placement, Section

LARGEST = 64 << 20  # [byte]


def lift_kit(path: Path) -> Description:
    """Return the mechanism of a kit's ``case.json`` [m, kg, rad].  Raises InputError."""
    advice = "crosscheck kit NAME --case CASE, which writes one"
    data = read_bytes(path, LARGEST, "the case.json of a case kit", advice, advice)
    try:
        said = CaseFile.model_validate_json(data).mechanism
    except ValidationError as error:
        first = next((one for one in error.errors() if one["loc"] == ("format",)), error.errors()[0])
        where = ".".join(map(str, first["loc"])) or "the top of the file"
        if where == "format" and str(first["input"]).startswith("crosscheck-case/"):
            given = f'format "{first["input"]}"'
            known = f'"{FORMAT}": this crosscheck knows no other'
            raise make_input_error(str(path), given, known, f"{advice}, or install a newer crosscheck") from None
        raise make_input_error(f"{path}: {where}", first["msg"], "the case.json of a case kit", advice) from None
    features = tuple(list_force_features(said.springs, said.forces))
    try:
        mechanism = _build_mechanism(said)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return Description(f"{path.parent.name}/{path.name}", mechanism, "kit", features=features, file=path)


def _build_mechanism(said: MechanismData) -> Mechanism:
    return Mechanism(
        said.name,
        tuple(
            Link(
                link.name,
                tuple(map(_build_body, link.bodies)),
                None if link.beam is None else _build_beam(link.beam),
                np.array(link.tip),
            )
            for link in said.links
        ),
        tuple(map(_build_joint, said.joints)),
        gravity=np.array(said.gravity),
        closures=tuple(map(_build_closure, said.closures)),
        title=said.title,
    )


def _build_body(said: BodyData) -> Body:
    return Body(said.name, Inertia.stated(said.mass, np.array(said.com), np.array(said.inertia)), said.station)


def _build_beam(said: BeamData) -> Beam:
    s = said.section
    stiffness = np.column_stack([s.EA, s.GA_y, s.GA_z, s.GJ, s.EI_y, s.EI_z])
    rotary = np.column_stack([s.rho_I_x, s.rho_I_y, s.rho_I_z])
    damping = np.array(s.damping) if s.damping else None
    section = Section(np.array(s.station), stiffness, np.array(s.rho_A), rotary, damping)
    return Beam(said.length, section, said.elements, said.order, np.array(said.curvature), _build_placement(said.root))


def _build_placement(said: Frame) -> Placement:
    return Placement(np.array(said.position), np.array(said.rotation))


def _build_joint(said: JointData) -> Joint:
    own: dict[str, Any] = {
        name: getattr(said, name)
        for name in ("rotor_inertia", "damping", "friction", "stiffness", "rest", "actuated", "weight", "pitch")
    }
    axes: dict[str, Any] = {"axis": np.array(said.axis), "second_axis": np.array(said.second_axis)}
    return Joint(
        said.name, said.kind, said.parent, said.child, _build_placement(said.frame), said.station, **axes, **own
    )


def _end(said: End) -> Attachment:
    return Attachment(said.link, _build_placement(said.frame), said.station)


def _build_closure(said: ClosureData) -> Closure:
    return Closure(
        said.name, said.kind, _end(said.first), _end(said.second), np.array(said.axis), np.array(said.second_axis),
        factors=tuple(said.factors.items()), offset=said.offset,
    )  # fmt: skip
