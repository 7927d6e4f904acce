"""A mechanism and a case, resolved: plain tables in SI units with every default written out, and what is asked for."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Container
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from crosscheck.engines.base import sample_times
from crosscheck.kit.parts import convert_part, make_archive_name
from crosscheck.kit.tables import (
    FORMAT,
    Asked,
    BeamData,
    BodyData,
    CaseData,
    CaseFile,
    ClosureData,
    ClosureKind,
    Coordinate,
    End,
    ForceData,
    Frame,
    Impact,
    JointData,
    JointKind,
    LawData,
    LinkData,
    MechanismData,
    SectionData,
    SpringData,
    Velocity,
)
from crosscheck.measures.record import XYZ, list_effort_units
from crosscheck.measures.series_csv import list_all_series
from flexinv.files.load_cases import Case
from flexinv.model.attachments import GasLaw, SpringLaw
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Attachment, Beam, Body, Closure, Joint, Link, Mechanism, Placement, Section

COLUMNS = ("EA", "GA_y", "GA_z", "GJ", "EI_y", "EI_z")
# By kind of joint: unit of every coordinate and of every velocity.
UNITS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "fixed": ((), ()),
    "revolute": (("rad",), ("rad/s",)),
    "prismatic": (("m",), ("m/s",)),
    "helical": (("rad",), ("rad/s",)),
    "continuous": (("-", "-"), ("rad/s",)),
    "universal": (("rad", "rad"), ("rad/s", "rad/s")),
    "spherical": (("-",) * 4, ("rad/s",) * 3),
    "free": (("m",) * 3 + ("-",) * 4, ("m/s",) * 3 + ("rad/s",) * 3),
}
MEANINGS = {
    "torque": "effort of the drive of every velocity; inverse dynamics: what makes the motion",
    "wrench": "force and moment of a joint on its child, at the joint, along the axes of the child's frame",
    "reaction": "force and moment of a closure on its second frame, there, along its axes; components that redundant constraints "
    "leave open are not compared",
    "tip": "place of the tip of a link in the world",
    "deflection": "tip of a beam less the tip of the undeformed beam that moves with its root section, in the axes of the "
    "root section",
    "axial": "force of a beam's joint on the beam, along x of the joint's child: below 0 where the beam is pulled outward",
    "internal": "force and moment in a section of a beam, along its axes: internal/BEAM/STATION/PART, with the stations (four "
    "digits) of expected/series.csv",
    "frequency": "is taken from the deflection (else the torque) after the motion: nothing more is asked",
}


def build_case_file(mechanism: Mechanism, case: Case, refinement: int = 1) -> CaseFile:
    """Return all that ``case.json`` says; refinement : times [-] by which step and mesh are to be finer."""
    if refinement > 1:
        case = replace(case, step=case.step / refinement)
    said = convert_mechanism(mechanism)
    asked = convert_case(mechanism, case, refinement)
    plain = {"mechanism": said.model_dump(mode="json"), "case": asked.model_dump(mode="json")}
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:16]
    return CaseFile(format=FORMAT, digest=digest, mechanism=said, case=asked)


def convert_mechanism(mechanism: Mechanism) -> MechanismData:
    """Return a mechanism as a table [m, kg, s, rad, N]."""
    return MechanismData(
        name=mechanism.name,
        title=mechanism.title,
        source=mechanism.source,
        gravity=_list_numbers(mechanism.gravity),
        links=[_convert_link(number, link) for number, link in enumerate(mechanism.links)],
        joints=[_convert_joint(joint) for joint in mechanism.joints],
        closures=[_convert_closure(closure) for closure in mechanism.closures],
        springs=[
            SpringData(
                name=s.name,
                first=_end(s.first),
                second=_end(s.second),
                stiffness=s.stiffness,
                rest=s.rest,
                damping=s.damping,
                law=_convert_law(s.law),
            )
            for s in mechanism.springs
        ],
        forces=[
            ForceData(
                name=f.name, at=_end(f.at), time=_list_numbers(f.time), wrench=f.wrench.tolist(), follower=f.follower
            )
            for f in mechanism.forces
        ],
        notes=list(mechanism.notes),
    )


def _convert_law(law: SpringLaw | None) -> LawData | None:
    if law is None:
        return None
    if isinstance(law, GasLaw):
        return {"kind": "gas", "force": law.force, "travel": law.travel, "exponent": law.exponent}
    return {"kind": "table", "length": law.length.tolist(), "force": law.force.tolist()}


def convert_case(mechanism: Mechanism, case: Case, refinement: int = 1) -> CaseData:
    """Return a case as a table [s, rad, m]."""
    given = set(case.motion.joints(mechanism))
    return CaseData(
        name=case.name,
        title=case.title,
        source=case.source,
        notes=[case.notes] if isinstance(case.notes, str) else list(case.notes),
        step=case.step,
        sample=case.sample,
        end=case.end,
        samples=sample_times(case).size,
        integrated=needs_integration(mechanism, case),
        spectral_radius=case.spectral_radius,
        initial="static" if case.initial == "static" else "consistent",
        start={name: _list_numbers(values) for name, values in case.start.items()},
        jumps=[float(t) for t in case.motion.jumps],
        refinement=refinement,
        coordinates=_list_coordinates(mechanism, given),
        velocities=_list_velocities(mechanism, given),
        asked=[
            Asked(quantity=q, series=list_quantity_series(mechanism, case, q), meaning=MEANINGS[q])
            for q in case.quantities
        ],
    )


def _list_coordinates(mechanism: Mechanism, given: Container[str]) -> list[Coordinate]:
    units = [(u, j.name in given) for j in mechanism.joints for u in UNITS[j.kind][0]]
    named = zip(mechanism.coordinate_names, units, strict=True)
    return [Coordinate(name=name, unit=unit, given=known) for name, (unit, known) in named]


def _list_velocities(mechanism: Mechanism, given: Container[str]) -> list[Velocity]:
    units = [(u, j.name in given) for j in mechanism.joints for u in UNITS[j.kind][1]]
    efforts = list_effort_units(mechanism)
    return [
        Velocity(name=n, unit=u, acceleration_unit=f"{u}^2", effort_unit=e, given=g, actuated=bool(a))
        for n, (u, g), e, a in zip(mechanism.velocity_names, units, efforts, mechanism.actuated, strict=True)
    ]


def needs_integration(mechanism: Mechanism, case: Case) -> bool:
    """Return True if a case has to be integrated in time: beams, or joints of an open tree without a motion."""
    given = set(case.motion.joints(mechanism))
    free = any(j.nv and j.name not in given for j in mechanism.joints)
    return not mechanism.is_rigid or (free and not mechanism.closures)


def list_idle_velocities(mechanism: Mechanism, case: Case) -> tuple[str, ...]:
    """Return the velocities [-] without effort: no drive, and in a loop or left to the dynamics."""
    given = set(case.motion.joints(mechanism))
    return tuple(
        j.name + suffix
        for j in mechanism.joints
        if not j.actuated and (mechanism.closures or j.name not in given)
        for suffix in KINDS[j.kind].v
    )


def list_quantity_series(mechanism: Mechanism, case: Case, quantity: str) -> dict[str, str]:
    """Return names and units of the series of a quantity; torques of velocities without effort are not asked for."""
    if quantity == "torque":
        still = list_idle_velocities(mechanism, case)
        named = zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True)
        return {f"torque/{name}": unit for name, unit in named if name not in still}
    return {n: u for n, u in list_all_series(mechanism).items() if n.split("/", 1)[0] == quantity}


def _convert_link(number: int, link: Link) -> LinkData:
    return LinkData(
        name=link.name,
        bodies=[_convert_body(b) for b in link.bodies],
        beam=None if link.beam is None else _convert_beam(link.beam),
        part=None if link.part is None else convert_part(link.part, make_archive_name(number)),
        tip=_list_numbers(link.tip),
    )


def _convert_body(body: Body) -> BodyData:
    i = body.inertia
    return BodyData(
        name=body.name,
        station=body.station,
        interface=body.interface,
        mass=float(i.mass),
        com=_list_numbers(i.com),
        inertia=i.tensor.tolist(),
    )


def _convert_beam(beam: Beam) -> BeamData:
    section = _convert_coupled_section(beam.section) if beam.section.is_coupled else _convert_section(beam.section)
    return BeamData(
        length=beam.length,
        root=_convert_frame(beam.placement),
        curvature=_list_numbers(beam.curvature),
        section=section,
        elements=beam.elements,
        order=beam.order,
    )


def _convert_coupled_section(section: Section) -> SectionData:
    """A section as matrices, without the numbers that would be its diagonals."""
    empty: dict[str, list[float]] = {name: [] for name in (*COLUMNS, *(f"rho_I_{axis}" for axis in XYZ))}
    return SectionData(
        station=_list_numbers(section.stations),
        stiffness_matrix=section.stiffness_matrices.tolist(),
        mass_matrix=section.mass_matrices.tolist(),
        damping_matrix=[] if section.damping is None else section.damping_matrices.tolist(),
        rho_A=[],
        damping=[],
        **empty,
    )


def _convert_section(section: Section) -> SectionData:
    stiff = {name: _list_numbers(section.stiffness[:, k]) for k, name in enumerate(COLUMNS)}
    rotary = {f"rho_I_{axis}": _list_numbers(section.rotary_inertia[:, k]) for k, axis in enumerate(XYZ)}
    return SectionData(
        station=_list_numbers(section.stations),
        rho_A=_list_numbers(section.mass_per_length),
        damping=[] if section.damping is None else section.damping.tolist(),
        stiffness_matrix=[],
        mass_matrix=[],
        damping_matrix=[],
        **stiff,
        **rotary,
    )


def _convert_joint(joint: Joint) -> JointData:
    q = KINDS[joint.kind].q
    v = KINDS[joint.kind].v
    return JointData(
        name=joint.name,
        kind=cast(JointKind, joint.kind),
        parent=joint.parent,
        child=joint.child,
        rotor_inertia=joint.rotor_inertia,
        damping=joint.damping,
        friction=joint.friction,
        stiffness=joint.stiffness,
        rest=joint.rest,
        actuated=joint.actuated,
        weight=joint.weight,
        frame=_convert_frame(joint.placement),
        station=joint.station,
        interface=joint.interface,
        axis=_list_numbers(joint.axis),
        second_axis=_list_numbers(joint.second_axis),
        pitch=joint.pitch,
        q=[joint.name + suffix for suffix in q],
        v=[joint.name + suffix for suffix in v],
    )


def _convert_closure(closure: Closure) -> ClosureData:
    return ClosureData(
        name=closure.name,
        kind=cast(ClosureKind, closure.kind),
        impact=cast(Impact, closure.impact),
        first=_end(closure.first),
        second=_end(closure.second),
        axis=_list_numbers(closure.axis),
        second_axis=_list_numbers(closure.second_axis),
        active=[[float(t) for t in span] for span in closure.active],
        capture=closure.capture,
        factors=dict(closure.factors),
        offset=closure.offset,
    )


def _end(at: Attachment) -> End:
    return End(link=at.link, station=at.station, interface=at.interface, frame=_convert_frame(at.placement))


def _convert_frame(placement: Placement) -> Frame:
    return Frame(position=_list_numbers(placement.position), rotation=placement.rotation.tolist())


def _list_numbers(values: ArrayLike) -> list[float]:
    return [float(x) for x in np.asarray(values, dtype=np.float64)]
