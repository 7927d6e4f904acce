"""Overlay of a mechanism file on its URDF: payloads, drives, and links that become beams."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from flexinv.files.bodies import read_payloads
from flexinv.files.joints import DRIVES, MOTORS, drive, read_drive
from flexinv.files.schema import OverlayBeamTable, OverlayLinkTable, OverlayTable
from flexinv.files.sections import CrossSection, section_along
from flexinv.files.toml_tables import Location, complaint, validate
from flexinv.model.mechanism import Beam, Body, Inertia, Joint, Link, Mechanism, Placement
from flexinv.typing import Array
from flexinv.validation import nearest


def overlaid(
    mechanism: Mechanism, table: OverlayTable, sections: Mapping[str, CrossSection], top: Location
) -> Mechanism:
    """Lay payloads [kg, m, kg m^2], drives [kg m^2, N m s/rad, N m] and beams over a mechanism.

    Undeformed, the mechanism keeps its geometry: a joint on a link that became a beam is placed anew in the frame of
    the cross-section that carries it.
    """
    links, joints, notes = dict(mechanism.link_of), dict(mechanism.joint_of), list(mechanism.notes)
    for name, data in table.links.items():
        where = top.inner(f"links.{name}")
        _check_known(name, links, where, "link")
        laid = validate(OverlayLinkTable, data, where)
        if laid.beam is not None and laid.tip_m is not None:
            given, expected = f"tip_m = {laid.tip_m} beside a beam", "no tip: a beam reports its end"
            raise where.wrong("tip_m", given, expected, "the beam alone")
        if laid.beam is not None:
            own = sum(body.inertia.mass for body in links[name].bodies)
            links[name], changed = _flexible(links[name], joints, laid.beam, sections, where.inner("beam"))
            joints.update(changed)
            notes.append(_told(links[name], laid.beam, own))
        payload = read_payloads(laid.payload, laid.beam is not None, name, where)
        tip = links[name].tip if laid.tip_m is None else np.array(laid.tip_m, dtype=np.float64)
        links[name] = replace(links[name], bodies=(*links[name].bodies, *payload), tip=tip)
    for name, data in table.joints.items():
        where = top.inner(f"joints.{name}")
        _check_known(name, joints, where, "joint")
        joints[name] = _driven(joints[name], data, where)
    return replace(mechanism, links=tuple(links.values()), joints=tuple(joints.values()), notes=tuple(notes))


def _check_known(name: str, known: Mapping[str, Any], where: Location, kind: str) -> None:
    if name not in known:
        near = nearest(name, known)
        write = f"[overlay.{kind}s.{near}]" if near else f"one of {', '.join(list(known)[:20])}"
        raise where.wrong("", f'a {kind} "{name}"', f"a {kind} of the URDF", write)


def _driven(joint: Joint, data: Any, where: Location) -> Joint:
    """Replace what the table states of the drive; the rest stays as the URDF has it."""
    if joint.kind not in DRIVES:
        expected = f"a joint with a drive; {joint.name} is {joint.kind}"
        raise where.wrong("", f"an overlay of joint {joint.name}", expected, "remove the table")
    if isinstance(data, dict) and "drive" in data:  # in place of the damping and dry friction that the URDF has
        inner = where.inner("drive")
        if joint.kind not in MOTORS:
            expected = f"a drive of a joint with one coordinate ({', '.join(MOTORS)}); {joint.name} is {joint.kind}"
            raise inner.wrong("", f"a drive of joint {joint.name}", expected, "remove the table")
        motor = read_drive(validate(MOTORS[joint.kind], data["drive"], inner), inner)
        joint = replace(joint, drive=motor, damping=0.0, friction=0.0)
        data = {key: value for key, value in data.items() if key != "drive"}
    table = validate(DRIVES[joint.kind], data, where)
    stated = {key.split("_")[0] for key in table.model_fields_set}
    changed = {name: value for name, value in drive(table, where).items() if name.split("_")[0] in stated}
    return replace(joint, **changed)


def _flexible(
    link: Link, joints: Mapping[str, Joint], table: OverlayBeamTable, sections: Mapping[str, CrossSection],
    where: Location,
) -> tuple[Link, dict[str, Joint]]:  # fmt: skip
    """The link as a beam from its root point straight to one of its joints, and its joints placed on that beam."""
    outward = {name: joint for name, joint in joints.items() if joint.parent == link.name}
    if table.to_joint not in outward:
        near = nearest(table.to_joint, outward) or next(iter(outward), None)
        expected = f"a joint whose parent is {link.name}: {', '.join(outward) or 'it has none'}"
        write = f'to_joint = "{near}"' if near else "a beam for a link that carries a joint"
        raise where.wrong("to_joint", f'to_joint = "{table.to_joint}"', expected, write)
    start = np.array(table.root_xyz_m, dtype=np.float64)
    along = outward[table.to_joint].placement.position - start
    length = float(np.linalg.norm(along))
    if length == 0.0:
        expected = f"a root away from joint {table.to_joint}: a beam has a length > 0 [m]"
        given = f"root_xyz_m = {start.tolist()}, where the joint is"
        raise where.wrong("root_xyz_m", given, expected, "root_xyz_m = [0, 0, 0]")
    root = Placement(start, _section_axes(along / length, table.y_axis, where.key("y_axis")))
    section = section_along(table.section, sections, where)
    bodies = link.bodies if table.own_inertia == "at_root" else ()
    beam = Beam(length, section, table.elements, table.order, placement=root)
    flexible = Link(link.name, tuple(_on_root(body, root) for body in bodies), beam)
    return flexible, {name: _on_beam(j, root, length, name == table.to_joint) for name, j in outward.items()}


def _section_axes(x: Array, y_axis: Any, where: str) -> Array:
    """R = [x, y, z] with y the part of y_axis across x."""
    given = np.array(y_axis, dtype=np.float64)
    across = given - (given @ x) * x
    size = float(np.linalg.norm(across))
    # a direction within 1e-6 of the beam's would leave its part across to rounding
    if size <= 1e-6 * float(np.linalg.norm(given)):
        write = f"y_axis = {np.eye(3)[int(np.argmin(np.abs(x)))].tolist()}"
        expected = f"a direction that is not along the beam, {np.round(x, 6).tolist()} [-]"
        raise complaint(where, f"y_axis = {given.tolist()}", expected, write)
    y = across / size
    return np.column_stack([x, y, np.cross(x, y)])


def _on_root(body: Body, root: Placement) -> Body:
    """The same body seen from the root cross-section: c' = R^T (c - p), I' = R^T I R."""
    rotation, inertia = root.rotation, body.inertia
    com = rotation.T @ (inertia.com - root.position)
    return replace(body, inertia=Inertia(inertia.mass, com, rotation.T @ inertia.tensor @ rotation), station=0.0)


def _on_beam(joint: Joint, root: Placement, length: float, at_tip: bool) -> Joint:
    """The same place seen from the nearest cross-section (the tip's for the joint at which the beam ends)."""
    offset = root.rotation.T @ (joint.placement.position - root.position)  # (along, y, z) [m]
    station = 1.0 if at_tip else float(np.clip(offset[0] / length, 0.0, 1.0))
    position = np.zeros(3) if at_tip else offset - np.array([station * length, 0.0, 0.0])
    return replace(joint, station=station, placement=Placement(position, root.rotation.T @ joint.placement.rotation))


def _told(link: Link, table: OverlayBeamTable, own: float) -> str:
    beam = link.beam
    assert beam is not None
    density, uniform = beam.section.mass_per_length, beam.section.stations.size == 1
    mass = float(density[0] if uniform else np.trapezoid(density, beam.section.stations)) * beam.length
    kept = "replaced" if table.own_inertia == "replaced" else "kept as a rigid body at its root"
    return f"{link.name} is a beam of {beam.length:.6g} m and {mass:.6g} kg; its URDF inertia ({own:.6g} kg) is {kept}"
