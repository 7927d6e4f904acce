"""Load ``models/<name>/mechanism.toml``: links, joints, sections and payloads, or a URDF with what is laid over it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.errors import InputError, ModelWarning
from flexinv.files import schema
from flexinv.files.closures import read_closure, read_force, read_spring
from flexinv.files.from_urdf import STANDARD_GRAVITY, find_urdf, read_urdf
from flexinv.files.joints import (
    DRIVES,
    MOTORS,
    list_depth_first,
    read_drive,
    read_drive_properties,
    read_joint,
    read_placement,
)
from flexinv.files.schema import (
    INERTIA_SHAPES,
    check_interface,
    check_station,
    compute_far_end,
    read_inertia,
    read_payloads,
)
from flexinv.files.sections import CrossSection, assemble_section, read_section
from flexinv.files.toml_tables import (
    Location,
    check_table,
    check_table_names,
    format_toml,
    read_option,
    read_toml,
    resolve_toml_file,
)
from flexinv.model.links import REPLACED, WORLD, Beam, Body, Inertia, Link, Placement
from flexinv.model.mechanism import Joint, Mechanism, ModalDamping, build_drive_model, with_retardation
from flexinv.validation import find_nearest_word

KINDS_OF_LINKS = '"rigid", "beam" or "mesh"'


def load_mechanism(path: str | Path) -> Mechanism:
    """Load a mechanism from its folder or its file; every number in the unit [m, kg, s, rad, N] that its key names.

    path : ``models/<name>`` or the TOML file.  The format is described in models/README.md.
    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    Warns (ModelWarning) where the model was changed: an axis normalised, mimic joints made independent.
    """
    file = resolve_toml_file(path, "mechanism.toml")
    top = Location(file)
    data, base = read_layers(file)
    table = check_table(schema.MechanismTable, data, top)
    named = ("sections", "links", "joints", "closures", "springs", "forces")
    check_table_names(file, **{kind: getattr(table, kind) for kind in named})
    sections = {
        name: read_section(data, top.make_inner_location(f"sections.{name}")) for name, data in table.sections.items()
    }
    mechanism = (
        _build_native(table, sections, top) if table.urdf is None else _build_from_urdf(table, sections, Location(base))
    )
    try:
        mechanism = build_drive_model(mechanism)  # by what drives add, joints and links
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    links = mechanism.link_of
    joints = mechanism.joint_of
    closures = (
        read_closure(data, links, joints, top.make_inner_location(f"closures.{n}"), n)
        for n, data in table.closures.items()
    )
    springs = (
        read_spring(data, links, top.make_inner_location(f"springs.{n}"), n) for n, data in table.springs.items()
    )
    forces = (read_force(data, links, top.make_inner_location(f"forces.{n}"), n) for n, data in table.forces.items())
    mechanism = replace(mechanism, closures=tuple(closures), springs=tuple(springs), forces=tuple(forces))
    mechanism = _apply_damping(mechanism, table.damping, top.make_inner_location("damping"))
    name = table.name or (base.stem if base.name != "mechanism.toml" else base.resolve().parent.name)
    return replace(mechanism, name=name, title=table.title, source=table.source, notes=(*table.notes, *mechanism.notes))


def read_layers(file: Path) -> tuple[dict[str, Any], Path]:
    """Read a file [any unit], laid over the mechanism file that its key ``over`` names; return the data and that file.

    Tables are merged key by key, all else replaces what was there; a body with an inertia of its own has no shape any more.
    """
    data = read_toml(file)
    name = data.get("over")
    if name is None:
        return data, file
    where = Location(file)
    expected = "the path of a mechanism file, from this file's folder, that is over no other one"
    if not isinstance(name, str) or not name.endswith(".toml") or not (file.parent / name).is_file():
        raise where.make_error("over", format_toml(name), expected, 'over = "mechanism.toml"')
    base = file.parent / name
    under = read_toml(base)
    if "over" in under:
        raise where.make_error("over", f"{name}, which is over {format_toml(under['over'])}", expected, "one layer")
    return _join_tables(under, {key: value for key, value in data.items() if key != "over"}), base


def _join_tables(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    out = {key: value for key, value in under.items() if "inertia_kgm2" not in over or key not in INERTIA_SHAPES}
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(under.get(key), dict) and key != "inertia_kgm2"
        out[key] = _join_tables(under[key], value) if both else value
    return out


def _build_native(table: schema.MechanismTable, sections: Mapping[str, CrossSection], top: Location) -> Mechanism:
    if table.overlay is not None:
        given = "overlay without [urdf]"
        advice = "its keys in [links.NAME] and [joints.NAME] themselves"
        raise top.make_inner_location("overlay").make_error("", given, "an overlay of a URDF", advice)
    gravity = "gravity_m_per_s2 = [0, 0, -9.81]   (zeros for a horizontal plane)"
    a_link = '[links.arm] with kind = "rigid", "beam" or "mesh"'
    base = f'[joints.base] with kind, parent = "{WORLD}", child'
    for key, write in (("gravity_m_per_s2", gravity), ("links", a_link), ("joints", base)):
        if not getattr(table, key):
            raise top.make_error(key, "nothing", schema.MechanismTable.model_fields[key].description or "", write)
    links = {
        name: _build_link(data, name, sections, top.make_inner_location(f"links.{name}"))
        for name, data in table.links.items()
    }
    joints = [read_joint(data, top.make_inner_location(f"joints.{name}"), name) for name, data in table.joints.items()]
    moving = list_depth_first(
        joints, links, lambda kind, name, key: top.make_inner_location(f"{kind}s.{name}").describe_key(key)
    )
    for joint in moving:
        on_beam = joint.parent != WORLD and links[joint.parent].beam is not None
        beam = f"the beam {joint.parent} that carries the joint"
        other = f"{joint.parent} is not a beam"
        where = top.make_inner_location(f"joints.{joint.name}")
        check_station(joint.station, on_beam, where, beam, other, "placement = { xyz_m = [0.4, 0, 0] }")
        check_interface(joint.interface or None, None if joint.parent == WORLD else links[joint.parent], where)
    pull = np.array(table.gravity_m_per_s2, dtype=np.float64)
    return Mechanism("", tuple(links[joint.child] for joint in moving), moving, pull)


def _apply_damping(mechanism: Mechanism, table: schema.DampingTable | None, where: Location) -> Mechanism:
    """Return the mechanism with the damping of its file [s], [-]; a ratio stays data until a mesh is built."""
    if table is None:
        return mechanism
    if (table.retardation_s is None) == (table.ratio is None):
        given = "neither" if table.ratio is None else "both"
        raise where.make_error("ratio", given, "one of ratio [-] and retardation_s [s]", "ratio = 0.01")
    if any(link.beam is not None and link.beam.section.damping is not None for link in mechanism.links):
        raise where.make_error(
            "", "[damping] beside retardation_s of a section", "one or the other", "no table [damping]"
        )
    if not mechanism.beams:
        raise where.make_error("ratio", "no link that is a beam", "a beam to damp", "damping of joints in their tables")
    if table.ratio is None:
        return with_retardation(mechanism, table.retardation_s or 0.0)
    return replace(mechanism, modal_damping=ModalDamping(table.ratio, table.mode))


def _build_link(data: Any, name: str, sections: Mapping[str, CrossSection], where: Location) -> Link:
    if name == WORLD:
        advice = f'[links.base], and joints that hang on parent = "{WORLD}"'
        raise where.make_error("", f'a link named "{WORLD}"', "another name: the world is no link", advice)
    kind = read_option(data, where, "kind", ("rigid", "beam", "mesh"), KINDS_OF_LINKS, "rigid")
    if kind == "mesh":
        return _build_mesh_link(data, name, where)
    if kind == "beam":
        made = check_table(schema.BeamLinkTable, data, where)
        section = assemble_section(made.section, sections, where)
        bend = made.curvature_per_m
        curvature = np.array([bend.twist, bend.y, bend.z] if bend else [0, 0, 0], dtype=np.float64)
        root = read_placement(made.root, where.make_inner_location("root"))
        beam = Beam(made.length_m, section, made.elements, made.order, curvature, root)
        return Link(name, read_payloads(made.payload, True, name, where), beam)
    table = check_table(schema.RigidLinkTable, data, where)
    if table.massless and (table.mass_kg is not None or table.inertia_kgm2 is not None):
        given = "massless = true and a mass or an inertia"
        raise where.make_error("massless", given, "one or the other", "massless = false, or no mass")
    bodies = () if table.massless else (Body(name, read_inertia(table, where)),)
    long = table.rod or table.cylinder  # without a stated tip its far end is the link's
    tip = (
        compute_far_end(long) if table.tip_m is None and long is not None else np.array(table.tip_m or [0.0, 0.0, 0.0])
    )
    return Link(name, (*bodies, *read_payloads(table.payload, False, name, where)), tip=tip)


def _build_mesh_link(data: Any, name: str, where: Location) -> Link:
    """A link of any shape; what its mesh needs is imported with the first one."""
    from flexinv.files.parts import read_meshed_link

    return read_meshed_link(data, name, where)


def _build_from_urdf(table: schema.MechanismTable, sections: Mapping[str, CrossSection], top: Location) -> Mechanism:
    urdf = table.urdf
    assert urdf is not None
    for key in ("links", "joints"):
        if getattr(table, key):
            advice = f"[overlay.{key}.NAME] for what is laid over the URDF"
            raise top.make_inner_location(key).make_error("", f"[{key}] beside [urdf]", "one or the other", advice)
    path, packages = find_urdf(urdf, top.make_inner_location("urdf"))
    mechanism, warned = read_urdf(path, packages, urdf.base, table.gravity_m_per_s2 or STANDARD_GRAVITY, urdf.lock)
    for subject, text in warned.items():
        if subject != "mimic" or urdf.mimic is None:
            advice = '; write mimic = "independent" in [urdf] if so meant, or lock them' if subject == "mimic" else ""
            warnings.warn(f"{path}: {text}{advice}", ModelWarning, stacklevel=4)
    return (
        mechanism
        if table.overlay is None
        else _apply_overlay(mechanism, table.overlay, sections, top.make_inner_location("overlay"))
    )


def _apply_overlay(
    mechanism: Mechanism, table: schema.OverlayTable, sections: Mapping[str, CrossSection], top: Location
) -> Mechanism:
    """The mechanism under masses [kg, m, kg m^2], drives [kg m^2, N m s/rad, N m] and beams; undeformed its geometry stays."""
    links = dict(mechanism.link_of)
    joints = dict(mechanism.joint_of)
    notes = list(mechanism.notes)
    for kind, known, tables in (("link", links, table.links), ("joint", joints, table.joints)):
        for name in tables:
            if name not in known:
                near = find_nearest_word(name, known)
                write = f"[overlay.{kind}s.{near}]" if near else f"one of {', '.join(list(known)[:20])}"
                raise top.make_inner_location(f"{kind}s.{name}").make_error(
                    "", f'a {kind} "{name}"', f"a {kind} of the URDF", write
                )
    for name, data in table.links.items():
        where = top.make_inner_location(f"links.{name}")
        laid = check_table(schema.OverlayLinkTable, data, where)
        links[name], changed, note = _apply_link_overlay(links[name], joints, laid, sections, where)
        joints.update(changed)
        notes += note
    driven = {
        name: _apply_drive(joints[name], data, top.make_inner_location(f"joints.{name}"))
        for name, data in table.joints.items()
    }
    moving = tuple((joints | driven).values())
    return replace(mechanism, links=tuple(links.values()), joints=moving, notes=tuple(notes))


def _apply_link_overlay(
    link: Link, joints: Mapping[str, Joint], laid: schema.OverlayLinkTable, sections: Mapping[str, CrossSection],
    where: Location,
) -> tuple[Link, dict[str, Joint], list[str]]:  # fmt: skip
    """The link under its overlay, the joints that it moves to a beam or a mesh, and a note of that."""
    bends = "a beam" if laid.beam is not None else "a mesh"
    if laid.beam is not None and laid.mesh is not None:
        raise where.make_error("mesh", "a beam and a mesh", "one of both", "[overlay.links.NAME.mesh] alone")
    flexible = laid.beam is not None or laid.mesh is not None
    link = _replace_own_body(link, laid, bends if flexible else "", where)
    if flexible and laid.tip_m is not None:
        expected = f"no tip: {bends} reports its end"
        raise where.make_error("tip_m", f"tip_m = {laid.tip_m} beside {bends}", expected, f"{bends} alone")
    changed: dict[str, Joint] = {}
    notes: list[str] = []
    interfaces: tuple[str, ...] = ()
    if laid.beam is not None:
        link, changed, note = _make_link_flexible(link, joints, laid.beam, sections, where.make_inner_location("beam"))
        notes.append(note)
    elif laid.mesh is not None:
        from flexinv.files.parts import make_link_meshed

        link, changed, note = make_link_meshed(link, joints, laid.mesh, where.make_inner_location("mesh"))
        notes.append(note)
        assert link.part is not None
        interfaces = tuple(link.part.interface_of)
    body_name = link.bodies[0].name if link.bodies else link.name
    payload = read_payloads(laid.payload, laid.beam is not None, body_name, where, interfaces)
    tip = link.tip if laid.tip_m is None else np.array(laid.tip_m, dtype=np.float64)
    return replace(link, bodies=(*link.bodies, *payload), tip=tip), changed, notes


def _replace_own_body(link: Link, table: schema.OverlayLinkTable, bends: str, where: Location) -> Link:
    """The link with the mass, centre and inertia [kg, m, kg m^2] of its overlay, if that states any, in place of the URDF's.

    bends : "a beam", "a mesh", whose mass is its own; "" for a rigid link
    """
    stated = [key for key in ("mass_kg", "com_m", *INERTIA_SHAPES) if getattr(table, key) is not None]
    if not stated:
        return link
    if bends:
        expected = "no mass of its own: that of a beam is its section's, that of a mesh its material's"
        raise where.make_error(stated[0], f"{stated[0]} beside {bends}", expected, f"{bends} alone, or a payload on it")
    return replace(link, bodies=(Body(REPLACED, read_inertia(table, where)),))


def _apply_drive(joint: Joint, data: Any, where: Location) -> Joint:
    """Replace what the table states of the drive; the rest stays as the URDF has it."""
    if joint.kind not in DRIVES:
        expected = f"a joint with a drive; {joint.name} is {joint.kind}"
        raise where.make_error("", f"an overlay of joint {joint.name}", expected, "remove the table")
    if isinstance(data, dict) and "drive" in data:  # in place of the damping and dry friction that the URDF has
        inner = where.make_inner_location("drive")
        if joint.kind not in MOTORS:
            expected = f"a drive of a joint with one coordinate ({', '.join(MOTORS)}); {joint.name} is {joint.kind}"
            raise inner.make_error("", f"a drive of joint {joint.name}", expected, "remove the table")
        motor = read_drive(check_table(MOTORS[joint.kind], data["drive"], inner), inner)
        joint = replace(joint, drive=motor, damping=0.0, friction=0.0)
        data = {key: value for key, value in data.items() if key != "drive"}
    table = check_table(DRIVES[joint.kind], data, where)
    stated = {key.split("_")[0] for key in table.model_fields_set}
    changed = {
        name: value for name, value in read_drive_properties(table, where).items() if name.split("_")[0] in stated
    }
    return replace(joint, **changed)


def _make_link_flexible(
    link: Link, joints: Mapping[str, Joint], table: schema.OverlayBeamTable, sections: Mapping[str, CrossSection],
    where: Location,
) -> tuple[Link, dict[str, Joint], str]:  # fmt: skip
    """The link as a beam from its root point straight to one of its joints, its joints placed on that beam, and a note."""
    outward = {name: joint for name, joint in joints.items() if joint.parent == link.name}
    if table.to_joint not in outward:
        near = find_nearest_word(table.to_joint, outward) or next(iter(outward), None)
        expected = f"a joint whose parent is {link.name}: {', '.join(outward) or 'it has none'}"
        write = f'to_joint = "{near}"' if near else "a beam for a link that carries a joint"
        raise where.make_error("to_joint", f'to_joint = "{table.to_joint}"', expected, write)
    root, length = _compute_beam_root(table, outward[table.to_joint], where)
    section = assemble_section(table.section, sections, where)
    beam = Beam(length, section, table.elements, table.order, placement=root)
    at_root = table.own_inertia == "at_root"
    bodies = tuple(_move_to_root(body, root) for body in link.bodies) if at_root else ()
    density = section.mass_per_length
    mass = float(density[0] if density.size == 1 else np.trapezoid(density, section.stations)) * length
    stated_mass = sum(body.inertia.mass for body in link.bodies)
    kept = "replaced" if table.own_inertia == "replaced" else "kept as a rigid body at its root"
    note = (
        f"{link.name} is a beam of {length:.6g} m and {mass:.6g} kg; its URDF inertia ({stated_mass:.6g} kg) is {kept}"
    )
    placed = {name: _move_to_beam(j, root, length, name == table.to_joint) for name, j in outward.items()}
    return Link(link.name, bodies, beam), placed, note


def _compute_beam_root(table: schema.OverlayBeamTable, to: Joint, where: Location) -> tuple[Placement, float]:
    """The frame of a beam's root in its link, x along the beam, and the beam's length [m]."""
    start = np.array(table.root_xyz_m, dtype=np.float64)
    along = to.placement.position - start
    length = float(np.linalg.norm(along))
    if length == 0.0:
        expected = f"a root away from joint {table.to_joint}: a beam has a length > 0 [m]"
        given = f"root_xyz_m = {start.tolist()}, where the joint is"
        raise where.make_error("root_xyz_m", given, expected, "root_xyz_m = [0, 0, 0]")
    x = along / length
    y = np.array(table.y_axis, dtype=np.float64)
    across = y - (y @ x) * x
    size = float(np.linalg.norm(across))
    # a direction within 1e-6 of the beam's would leave its part across to rounding
    if size <= 1e-6 * float(np.linalg.norm(y)):
        write = f"y_axis = {np.eye(3)[int(np.argmin(np.abs(x)))].tolist()}"
        expected = f"a direction that is not along the beam, {np.round(x, 6).tolist()} [-]"
        raise where.make_error("y_axis", f"y_axis = {y.tolist()}", expected, write)
    return Placement(start, np.column_stack([x, across / size, np.cross(x, across / size)])), length


def _move_to_root(body: Body, root: Placement) -> Body:
    """A body of a link as one at a beam's root: c' = R^T (c - p), I' = R^T I R."""
    com = root.rotation.T @ (body.inertia.com - root.position)
    tensor = root.rotation.T @ body.inertia.tensor @ root.rotation
    return replace(body, inertia=Inertia.build_unchecked(body.inertia.mass, com, tensor), station=0.0)


def _move_to_beam(joint: Joint, root: Placement, length: float, at_tip: bool) -> Joint:
    """The same place seen from the nearest cross-section (the tip's for the joint at which the beam ends)."""
    offset = root.rotation.T @ (joint.placement.position - root.position)  # (along, y, z) [m]
    station = 1.0 if at_tip else float(np.clip(offset[0] / length, 0.0, 1.0))
    position = np.zeros(3) if at_tip else offset - np.array([station * length, 0.0, 0.0])
    return replace(joint, station=station, placement=Placement(position, root.rotation.T @ joint.placement.rotation))
