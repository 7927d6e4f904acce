"""Statements of an SDF that the readers of Drake and DART leave out: dry friction, mimics, added mass, gravity.

    names         "crane::luff" of joint or link luff in model crane; a model that is merged adds no name
    friction      <axis> <dynamics> <friction> [N m], [N]
    mimic         q = multiplier (q_of - reference) + offset
    added mass    <fluid_added_mass> of a link: a feature, "added-mass", with its (6, 6) entries [kg], [kg m], [kg m^2]
    gravity       of the world [m/s^2]; a link or model that switches it off is a feature, "gravcomp"

Source: http://sdformat.org/spec, version 1.11.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from crosscheck.lifting.reader_dynamics import Feature, Parameter
from flexinv.errors import InputError
from flexinv.files.from_urdf import read_xml
from flexinv.model.mechanism import GEARED, WORLD, Array, Attachment, Closure, Mechanism

SCOPE = "::"
ADDED = tuple(a + b for k, a in enumerate("xyzpqr") for b in "xyzpqr"[k:])  # xx, xy, ..., rr
WITHOUT_AXIS = ("fixed", "free")


@dataclass(frozen=True)
class Mimic:
    """A law of an axis: the joint that is followed, by its scoped name, multiplier [-], offset and reference [rad], [m]."""

    leader: str
    multiplier: float
    offset: float
    reference: float


@dataclass
class SdfStatements:
    """Statements of an SDF by scoped names of joints and links; gravity (3,) [m/s^2], None where no world states it.

    unread : files that it includes and that are not looked at
    """

    friction: dict[str, tuple[float, ...]] = field(default_factory=dict)
    mimics: dict[str, Mimic] = field(default_factory=dict)
    added: dict[str, dict[str, float]] = field(default_factory=dict)
    floating: list[str] = field(default_factory=list)
    gravity: Array | None = None
    unread: list[str] = field(default_factory=list)


def read_stated(path: Path) -> SdfStatements:
    """Return the statements of an SDF [N m], [kg], included files beside it among them.  Raises InputError for no numbers."""
    sdf_statements = SdfStatements()
    root = read_xml(path)
    for world in root.findall("world"):
        if (pull := _read_numbers(world, "gravity", f"{path}: <world>")).size == 3:
            sdf_statements.gravity = pull
        for model in _list_models(world):
            _read_model(model, "", path, sdf_statements)
    for model in _list_models(root):
        _read_model(model, "", path, sdf_statements)
    return sdf_statements


def _list_models(parent: Element) -> Iterator[Element]:
    yield from (part for part in parent if part.tag in ("model", "include"))


def _read_model(model: Element, scope: str, path: Path, statements: SdfStatements) -> None:
    if model.tag == "include":
        _read_include(model, scope, path, statements)
        return
    inner = _join_scope(scope, model.get("name", ""))
    for link in model.findall("link"):
        name = _join_scope(inner, link.get("name", ""))
        where = f'{path}: <link name="{link.get("name", "")}">'
        mass = link.find("inertial/fluid_added_mass")
        if mass is not None:
            entries = {key: float(_read_number(mass, key, 0.0, where)) for key in ADDED}
            statements.added[name] = {key: value for key, value in entries.items() if value}
        if _read_text(link, "gravity") in ("false", "0"):
            statements.floating.append(name)
    for joint in model.findall("joint"):
        _read_joint(joint, inner, path, statements)
    for part in _list_models(model):
        _read_model(
            part, scope if part.get("merge") in ("true", "1") and part.tag == "model" else inner, path, statements
        )


def _read_joint(joint: Element, scope: str, path: Path, statements: SdfStatements) -> None:
    name = _join_scope(scope, joint.get("name", ""))
    where = f'{path}: <joint name="{joint.get("name", "")}">'
    axes = [axis for axis in (joint.find("axis"), joint.find("axis2")) if axis is not None]
    friction = [_read_number(axis, "dynamics/friction", 0.0, where) for axis in axes]
    if any(friction):
        statements.friction[name] = tuple(friction)
    law = axes[0].find("mimic") if axes else None
    if law is not None:
        multiplier = _read_number(law, "multiplier", 1.0, where)
        offset, reference = (_read_number(law, key, 0.0, where) for key in ("offset", "reference"))
        statements.mimics[name] = Mimic(_join_scope(scope, law.get("joint", "")), multiplier, offset, reference)


def _read_include(include: Element, scope: str, path: Path, statements: SdfStatements) -> None:
    """Look into an included file that stands beside this one; others are said to be unread."""
    uri = _read_text(include, "uri").removeprefix("file://")
    there = path.parent / uri
    if not uri or ":" in uri or not there.is_file():
        statements.unread.append(uri or "an include without uri")
        return
    inner = read_xml(there)
    for model in _list_models(inner):
        if name := _read_text(include, "name"):
            model.set("name", name)
        _read_model(model, scope, there, statements)


def _join_scope(scope: str, name: str) -> str:
    return f"{scope}{SCOPE}{name}" if scope else name


def _read_text(element: Element, key: str) -> str:
    return (element.findtext(key) or "").strip()


def _read_numbers(element: Element, key: str, where: str) -> Array:
    text = _read_text(element, key)
    try:
        return np.array([float(word) for word in text.split()])
    except ValueError:
        raise InputError(
            f"{where}, {key}\n  given:    {text[:60]}\n  expected: numbers\n  write:    <{key}>0 0 -9.81</{key}>"
        ) from None


def _read_number(element: Element, key: str, default: float, where: str) -> float:
    numbers = _read_numbers(element, key, where)
    return float(numbers[0]) if numbers.size else default


def with_stated(
    mechanism: Mechanism, statements: SdfStatements, joint_of: Callable[[str], str]
) -> tuple[Mechanism, list[str]]:  # fmt: skip
    """Return a mechanism with the dry friction [N m], [N] and the mimics of an SDF, and what is said of them.

    joint_of : the mechanism's name of a joint by its scoped name, "" where it has none
    """
    words: list[str] = []
    friction: dict[str, float] = {}
    for scoped, values in statements.friction.items():
        name = joint_of(scoped)
        if not name or mechanism.joint_of[name].kind in WITHOUT_AXIS or len(set(values)) > 1:
            words.append(
                f"friction of joint {scoped}: {' and '.join(f'{v:g}' for v in values)}, which no joint of it has"
            )
            continue
        friction[name] = values[0]
    joints = [replace(joint, friction=friction.get(joint.name, joint.friction)) for joint in mechanism.joints]
    laws = list(_list_couplings(mechanism, statements, joint_of, words))
    return replace(mechanism, joints=tuple(joints), closures=(*mechanism.closures, *laws)), words


def _list_couplings(
    mechanism: Mechanism, statements: SdfStatements, joint_of: Callable[[str], str], words: list[str]
) -> Iterator[Closure]:  # fmt: skip
    here = Attachment(WORLD)
    for scoped, law in statements.mimics.items():
        names = joint_of(scoped), joint_of(law.leader)
        kinds = {mechanism.joint_of[name].kind for name in names if name}
        if not all(names) or not kinds <= {*GEARED, "continuous"}:
            words.append(f"mimic of joint {scoped}: of {law.leader}, which is no joint that can be followed")
            continue
        offset = law.offset - law.multiplier * law.reference
        factors = (names[0], 1.0), (names[1], -law.multiplier)
        yield Closure(f"mimic {names[0]}", "coupling", here, here, factors=factors, offset=offset)


def features_of(statements: SdfStatements, links: Mapping[str, str]) -> tuple[Feature, ...]:
    """Return the features of an SDF, of which no reader makes anything [-]; links : the mechanism's names by scoped names."""
    found = []
    for scoped, entries in statements.added.items():
        numbers: dict[str, Parameter] = dict(entries)
        if numbers:
            found.append(Feature("added-mass", f"link {links.get(scoped, scoped)}", numbers, felt=False))
    for scoped in statements.floating:
        found.append(Feature("gravcomp", f"link {links.get(scoped, scoped)}", {"gravcomp": 1.0}, felt=False))
    for uri in statements.unread:
        found.append(Feature("include", f"file {uri}", {"looked at": "no"}, felt=False))
    return tuple(found)
