"""Load ``models/<name>/mechanism.toml``: links, joints, sections and payloads, or a URDF with what is laid over it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.errors import InputError, ModelWarning
from flexinv.files.bodies import SHAPES, check_station, far_end, read_inertia, read_payloads
from flexinv.files.closures import read_closure, read_force, read_spring
from flexinv.files.from_urdf import STANDARD_GRAVITY, find_urdf, read_urdf
from flexinv.files.joints import depth_first, read_joint, read_placement
from flexinv.files.overlay import overlaid
from flexinv.files.schema import BeamLinkTable, DampingTable, MechanismTable, RigidLinkTable, UrdfTable
from flexinv.files.sections import CrossSection, read_section, section_along
from flexinv.files.toml_tables import Location, check_names, one_of, read_toml, toml_file, toml_text, validate
from flexinv.model.mechanism import WORLD, Beam, Body, Link, Mechanism, ModalDamping, expanded, with_retardation

LINKS: dict[str, type[RigidLinkTable] | type[BeamLinkTable]] = {"rigid": RigidLinkTable, "beam": BeamLinkTable}


def load_mechanism(path: str | Path) -> Mechanism:
    """Load a mechanism from its folder or its file; every number in the unit [m, kg, s, rad, N] that its key names.

    path : ``models/<name>`` or the TOML file.  The format is described in models/README.md.
    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    Warns (ModelWarning) where the model was changed: an axis normalised, mimic joints made independent.
    """
    file = toml_file(path, "mechanism.toml")
    top = Location(file)
    data, base = read_layers(file)
    table = validate(MechanismTable, data, top)
    named = ("sections", "links", "joints", "closures", "springs", "forces")
    check_names(file, **{kind: getattr(table, kind) for kind in named})
    sections = {name: read_section(data, top.inner(f"sections.{name}")) for name, data in table.sections.items()}
    home = Location(base)
    mechanism = _native(table, sections, top) if table.urdf is None else _from_urdf(table, table.urdf, sections, home)
    try:
        mechanism = expanded(mechanism)  # by what drives add, joints and links
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    links, joints = mechanism.link_of, mechanism.joint_of
    closures = (read_closure(data, links, joints, top.inner(f"closures.{n}"), n) for n, data in table.closures.items())
    springs = (read_spring(data, links, top.inner(f"springs.{n}"), n) for n, data in table.springs.items())
    forces = (read_force(data, links, top.inner(f"forces.{n}"), n) for n, data in table.forces.items())
    mechanism = replace(mechanism, closures=tuple(closures), springs=tuple(springs), forces=tuple(forces))
    mechanism = _damped(mechanism, table.damping, top.inner("damping"))
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
    where, expected = Location(file), "the path of a mechanism file, from this file's folder, that is over no other one"
    if not isinstance(name, str) or not name.endswith(".toml") or not (file.parent / name).is_file():
        raise where.wrong("over", toml_text(name), expected, 'over = "mechanism.toml"')
    base = file.parent / name
    under = read_toml(base)
    if "over" in under:
        raise where.wrong("over", f"{name}, which is over {toml_text(under['over'])}", expected, "one layer")
    return _laid(under, {key: value for key, value in data.items() if key != "over"}), base


def _laid(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    out = {key: value for key, value in under.items() if "inertia_kgm2" not in over or key not in SHAPES}
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(under.get(key), dict) and key != "inertia_kgm2"
        out[key] = _laid(under[key], value) if both else value
    return out


def _native(table: MechanismTable, sections: Mapping[str, CrossSection], top: Location) -> Mechanism:
    if table.overlay is not None:
        given, advice = "overlay without [urdf]", "its keys in [links.NAME] and [joints.NAME] themselves"
        raise top.inner("overlay").wrong("", given, "an overlay of a URDF", advice)
    gravity = "gravity_m_per_s2 = [0, 0, -9.81]   (zeros for a horizontal plane)"
    for key, write in (
        ("gravity_m_per_s2", gravity),
        ("links", '[links.arm] with kind = "rigid" or "beam"'),
        ("joints", f'[joints.base] with kind, parent = "{WORLD}", child'),
    ):
        if not getattr(table, key):
            raise top.wrong(key, "nothing", MechanismTable.model_fields[key].description or "", write)
    links = {name: _link(data, name, sections, top.inner(f"links.{name}")) for name, data in table.links.items()}
    joints = [read_joint(data, top.inner(f"joints.{name}"), name) for name, data in table.joints.items()]

    ordered = depth_first(joints, links, lambda kind, name, key: top.inner(f"{kind}s.{name}").key(key))
    for joint in ordered:
        on_beam = joint.parent != WORLD and links[joint.parent].beam is not None
        beam, other = f"the beam {joint.parent} that carries the joint", f"{joint.parent} is not a beam"
        where = top.inner(f"joints.{joint.name}")
        check_station(joint.station, on_beam, where, beam, other, "placement = { xyz_m = [0.4, 0, 0] }")
    pull = np.array(table.gravity_m_per_s2, dtype=np.float64)
    return Mechanism("", tuple(links[joint.child] for joint in ordered), ordered, pull)


def _damped(mechanism: Mechanism, table: DampingTable | None, where: Location) -> Mechanism:
    """Return the mechanism with the damping of its file [s], [-]; a ratio stays data until a mesh is built."""
    if table is None:
        return mechanism
    if (table.retardation_s is None) == (table.ratio is None):
        given = "neither" if table.ratio is None else "both"
        raise where.wrong("ratio", given, "one of ratio [-] and retardation_s [s]", "ratio = 0.01")
    if any(link.beam is not None and link.beam.section.damping is not None for link in mechanism.links):
        raise where.wrong("", "[damping] beside retardation_s of a section", "one or the other", "no table [damping]")
    if not mechanism.beams:
        raise where.wrong("ratio", "no link that is a beam", "a beam to damp", "damping of joints in their tables")
    if table.ratio is None:
        return with_retardation(mechanism, table.retardation_s or 0.0)
    return replace(mechanism, modal_damping=ModalDamping(table.ratio, table.mode))


def _link(data: Any, name: str, sections: Mapping[str, CrossSection], where: Location) -> Link:
    if name == WORLD:
        advice = f'[links.base], and joints that hang on parent = "{WORLD}"'
        raise where.wrong("", f'a link named "{WORLD}"', "another name: the world is no link", advice)
    kind = one_of(data, where, "kind", LINKS, '"rigid" or "beam"', "rigid") or "rigid"
    table = validate(LINKS[kind], data, where)
    if isinstance(table, BeamLinkTable):
        section = section_along(table.section, sections, where)
        bend = table.curvature_per_m
        curvature = np.array([bend.twist, bend.y, bend.z] if bend else [0, 0, 0], dtype=np.float64)
        root = read_placement(table.root, where.inner("root"))
        beam = Beam(table.length_m, section, table.elements, table.order, curvature, root)
        return Link(name, read_payloads(table.payload, True, name, where), beam)
    if table.massless and (table.mass_kg is not None or table.inertia_kgm2 is not None):
        given, expected = "massless = true and a mass or an inertia", "one or the other"
        raise where.wrong("massless", given, expected, "massless = false, or no mass")
    own = () if table.massless else (Body(name, read_inertia(table, where)),)
    long = table.rod or table.cylinder  # without a stated tip its far end is the link's
    tip = far_end(long) if table.tip_m is None and long is not None else np.array(table.tip_m or [0.0, 0.0, 0.0])
    return Link(name, (*own, *read_payloads(table.payload, False, name, where)), tip=tip)


def _from_urdf(
    table: MechanismTable, urdf: UrdfTable, sections: Mapping[str, CrossSection], top: Location
) -> Mechanism:
    for key in ("links", "joints"):
        if getattr(table, key):
            advice = f"[overlay.{key}.NAME] for what is laid over the URDF"
            raise top.inner(key).wrong("", f"[{key}] beside [urdf]", "one or the other", advice)
    path, packages = find_urdf(urdf, top.inner("urdf"))
    gravity = table.gravity_m_per_s2 or STANDARD_GRAVITY
    mechanism, warned = read_urdf(path, packages, urdf.base, gravity, urdf.lock)
    for subject, text in warned.items():
        if subject != "mimic" or urdf.mimic is None:
            advice = '; write mimic = "independent" in [urdf] if so meant, or lock them' if subject == "mimic" else ""
            warnings.warn(f"{path}: {text}{advice}", ModelWarning, stacklevel=4)
    return mechanism if table.overlay is None else overlaid(mechanism, table.overlay, sections, top.inner("overlay"))
