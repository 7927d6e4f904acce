"""A case kit as a description: the mechanism of its ``case.json``, resolved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import ValidationError

from crosscheck.kit.parts import read_part
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
    SectionData,
)
from crosscheck.lifting.attachment_features import list_force_features
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
        mechanism = _build_mechanism(said, path.parent)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return Description(f"{path.parent.name}/{path.name}", mechanism, "kit", features=features, file=path)


def _build_mechanism(data: MechanismData, folder: Path) -> Mechanism:
    return Mechanism(
        data.name,
        tuple(
            Link(
                link.name,
                tuple(map(_build_body, link.bodies)),
                None if link.beam is None else _build_beam(link.beam),
                np.array(link.tip),
                part=None if link.part is None else read_part(link.part, folder),
            )
            for link in data.links
        ),
        tuple(map(_build_joint, data.joints)),
        gravity=np.array(data.gravity),
        closures=tuple(map(_build_closure, data.closures)),
        title=data.title,
    )


def _build_body(data: BodyData) -> Body:
    inertia = Inertia.build_unchecked(data.mass, np.array(data.com), np.array(data.inertia))
    return Body(data.name, inertia, data.station, data.interface)


def _build_beam(data: BeamData) -> Beam:
    section = _build_section(data.section)
    return Beam(data.length, section, data.elements, data.order, np.array(data.curvature), _build_placement(data.root))


def _build_section(data: SectionData) -> Section:
    if data.stiffness_matrix or data.mass_matrix or data.damping_matrix:
        return _build_coupled_section(data)
    stiffness = np.column_stack([data.EA, data.GA_y, data.GA_z, data.GJ, data.EI_y, data.EI_z])
    rotary = np.column_stack([data.rho_I_x, data.rho_I_y, data.rho_I_z])
    damping = np.array(data.damping) if data.damping else None
    return Section(np.array(data.station), stiffness, np.array(data.rho_A), rotary, damping)


def _build_coupled_section(data: SectionData) -> Section:
    """The section of matrices; raises InputError where numbers stand beside them."""
    matrices = ("stiffness_matrix", "mass_matrix", "damping_matrix")
    numbers = [name for name in SectionData.model_fields if name not in ("station", *matrices)]
    both = [name for name in numbers if getattr(data, name)]
    if both:
        raise InputError(
            f"section: {', '.join(both)} beside matrices; expected one or the other; write [] for the numbers"
        )
    damping = np.array(data.damping_matrix) if data.damping_matrix else None
    return Section.build_from_matrices(
        np.array(data.station), np.array(data.stiffness_matrix), np.array(data.mass_matrix), damping
    )


def _build_placement(data: Frame) -> Placement:
    return Placement(np.array(data.position), np.array(data.rotation))


def _build_joint(data: JointData) -> Joint:
    return Joint(
        data.name,
        data.kind,
        data.parent,
        data.child,
        _build_placement(data.frame),
        data.station,
        axis=np.array(data.axis),
        second_axis=np.array(data.second_axis),
        rotor_inertia=data.rotor_inertia,
        damping=data.damping,
        friction=data.friction,
        stiffness=data.stiffness,
        rest=data.rest,
        actuated=data.actuated,
        weight=data.weight,
        pitch=data.pitch,
        interface=data.interface,
    )


def _end(data: End) -> Attachment:
    return Attachment(data.link, _build_placement(data.frame), data.station, data.interface)


def _build_closure(data: ClosureData) -> Closure:
    return Closure(
        data.name, data.kind, _end(data.first), _end(data.second), np.array(data.axis), np.array(data.second_axis),
        factors=tuple(data.factors.items()), offset=data.offset,
    )  # fmt: skip
