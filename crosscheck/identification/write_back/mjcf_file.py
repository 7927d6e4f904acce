"""An MJCF as MuJoCo compiles it, each body and each joint of the model with its element in the file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from crosscheck.engines import ENGINES, describe_missing_package
from crosscheck.identification.write_back.elements import XmlElement, parse_elements
from crosscheck.lifting.description import Description
from flexinv.errors import InputError
from flexinv.files.from_urdf import read_xml

if TYPE_CHECKING:
    from crosscheck.engines.mujoco.file_order import ModelBody, ModelJoint

JOINTS = ("joint", "freejoint")
ELSEWHERE = (
    "bodies and joints that <include>, <replicate>, <attach> or <composite> make stand in no place that could be edited"
)


@dataclass(frozen=True)
class MjcfBody:
    """A body: what the model has, and its elements."""

    model: ModelBody
    element: XmlElement
    joints: tuple[tuple[ModelJoint, XmlElement], ...]


@dataclass(frozen=True)
class MjcfFile:
    """An MJCF: its bytes, what was lifted from it, and its bodies by name."""

    path: Path
    text: bytes
    description: Description
    bodies: dict[str, MjcfBody]

    @property
    def joints(self) -> dict[str, tuple[ModelJoint, XmlElement]]:
        """Return the joints by name."""
        return {one[0].name: one for body in self.bodies.values() for one in body.joints}


def read_mjcf(path: Path) -> MjcfFile:
    """Return an MJCF with the bytes of its bodies and joints [m, kg, rad].

    Raises InputError: no MJCF, MuJoCo is not installed or refuses it, bodies or joints that have no element in this file.
    """
    if (words := describe_missing_package(ENGINES["mujoco"])) is not None:
        raise InputError(f"{path}: an MJCF is read by MuJoCo, and {words}")
    if (tag := read_xml(path, "an MJCF").tag) != "mujoco":
        urdf = "; write --write-urdf NEW for a URDF" if tag == "robot" else ""
        raise InputError(f"{path}: it begins with <{tag[:60]}>, expected an MJCF, <mujoco>{urdf}")
    from crosscheck.engines.mujoco.file_order import lift_in_order  # which needs MuJoCo

    description, bodies = lift_in_order(path)
    text = path.read_bytes()
    root = parse_elements(path, text)
    elements = [one for world in root.children if world.tag == "worldbody" for one in _list_bodies(world)]
    _check_same(path, "body", [one.stated for one in bodies], elements)
    return MjcfFile(
        path, text, description, {b.name: _match_joints(path, b, e) for b, e in zip(bodies, elements, strict=True)}
    )


def _list_bodies(parent: XmlElement) -> Iterator[XmlElement]:
    """Yield the bodies below an element, depth-first, through the frames that group them."""
    for child in parent.children:
        if child.tag == "body":
            yield child
        if child.tag in ("body", "frame"):
            yield from _list_bodies(child)


def _list_joints(parent: XmlElement) -> Iterator[XmlElement]:
    for child in parent.children:
        if child.tag in JOINTS:
            yield child
        if child.tag == "frame":
            yield from _list_joints(child)


def _match_joints(path: Path, body: ModelBody, element: XmlElement) -> MjcfBody:
    elements = list(_list_joints(element))
    _check_same(path, f"joint of body {body.name}", [joint.stated for joint in body.joints], elements)
    return MjcfBody(body, element, tuple(zip(body.joints, elements, strict=True)))


def _check_same(path: Path, what: str, model: Sequence[str], elements: Sequence[XmlElement]) -> None:
    """Raise InputError where the model has other parts than the file has elements."""
    file = [one.name for one in elements]
    if file == list(model):
        return
    both = zip([*model, ""], [*file, ""], strict=False)
    first, second = next(pair for pair in both if pair[0] != pair[1])
    raise InputError(
        f"{path}: where MuJoCo has {what} {first or 'none'!r} the file has {second or 'none'!r}, expected each {what} written "
        f"in this file: {ELSEWHERE}; write a file with all of them, as mujoco.mj_saveLastXML does"
    )
