"""A URDF with the masses, damping and friction that were identified; all else stays, byte by byte.

Only the elements ``<inertial>`` and ``<dynamics>`` that change are replaced, the old values stand beside them in a comment.  Each
written file is read again and held against what was identified.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from crosscheck.identification.identify import Identification
from crosscheck.identification.pseudo_inertia import QUANTITIES
from crosscheck.identification.responses.response import make_body
from crosscheck.identification.write_back.elements import (
    Edit,
    XmlElement,
    apply_edits,
    format_comment,
    parse_elements,
    write_attribute,
)
from crosscheck.identification.write_back.identified import (
    check_joint_number,
    check_link_numbers,
    check_new_file,
    collect_joint_values,
    compute_identified_links,
    describe_rest,
    write_checked,
)
from flexinv.errors import InputError
from flexinv.files.from_urdf import STANDARD_GRAVITY, read_robot, read_urdf
from flexinv.rigid.torque_regressor import compute_link_parameters
from flexinv.typing import Array

# kind of parameter -> attribute of <dynamics>
LAWS = {
    "viscous friction": "damping",
    "joint damping": "damping",
    "coulomb friction": "friction",
    "joint friction": "friction",
}
PLACES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
JointValues = Mapping[tuple[str, str], float]


def write_urdf(identification: Identification, file: Path) -> list[str]:
    """Write the URDF of the mechanism with what was identified [kg], [m], [kg m^2], [N m s/rad], [N m].

    Return in words what a URDF cannot say.  Raises InputError: the mechanism has no URDF, the file is there already, an encoding
    that is not a superset of ASCII, a written file that does not give the torques that were identified.
    """
    mechanism = identification.machine.mechanism
    if mechanism.urdf is None:
        raise InputError(
            f"--write-urdf {file}: {mechanism.name} comes from no URDF, expected a mechanism with [urdf]; "
            "identified.toml holds all that was found, remove --write-urdf"
        )
    check_new_file("--write-urdf", file)
    read_robot(mechanism.urdf)  # which refuses entities and DOCTYPE
    text = mechanism.urdf.read_bytes()
    root = parse_elements(mechanism.urdf, text)
    links = _list_places(root, "link", "inertial")
    joints = _list_places(root, "joint", "dynamics")
    ten = {name: numbers for name, numbers in compute_identified_links(identification).items() if name in links}
    rows = [row for row in identification.parameters if row.parameter in LAWS and row.place in joints]
    values = collect_joint_values(rows, LAWS)
    edits = [_replace_inertial(links[name], numbers) for name, numbers in ten.items()]
    edits += [_replace_dynamics(text, joints[name], name, values) for name in dict.fromkeys(row.place for row in rows)]
    write_checked(file, apply_edits(text, edits), lambda: _check_numbers(file, ten, values))
    said = {(quantity, name) for name in ten for quantity in QUANTITIES} | {(row.parameter, row.place) for row in rows}
    return list(describe_rest(identification.parameters, said, "a URDF"))


def _list_places(root: XmlElement, owner: str, tag: str) -> dict[str, XmlElement]:
    """By name of each link or joint its element of that tag, or the owner itself, where there is room for one."""
    out: dict[str, XmlElement] = {}
    for element in root.children:
        child = element.find_child(tag)
        if element.tag == owner and (child is not None or element.opened):
            out.setdefault(element.name, child or element)
    return out


def _replace_inertial(place: XmlElement, ten: Array) -> Edit:
    """The element of m, h, I (10,) [kg], [kg m], [kg m^2], and what stood there before."""
    inertia = make_body("", ten).inertia
    xyz = " ".join(repr(float(x)) for x in inertia.com)
    entries = " ".join(f'{name}="{float(inertia.tensor[at])!r}"' for name, at in PLACES.items())
    new = f'<inertial><origin xyz="{xyz}" rpy="0 0 0"/><mass value="{inertia.mass!r}"/><inertia {entries}/></inertial>'
    return _replace_place(place, "inertial", new.encode())


def _replace_dynamics(text: bytes, place: XmlElement, joint: str, values: JointValues) -> Edit:
    """The element of a joint with damping or friction that was found; its other attributes stay as they are written."""
    element = text[place.start : place.end] if place.tag == "dynamics" else b"<dynamics/>"
    for (name, attribute), value in values.items():
        if name == joint:
            element = write_attribute(element, attribute, repr(value))
    return _replace_place(place, "dynamics", element)


def _replace_place(place: XmlElement, tag: str, new: bytes) -> Edit:
    """The edit that puts an element in the place of the one of its tag, or at the end of its owner."""
    if place.tag != tag:
        return Edit(place.close, place.close, new)
    return Edit(place.start, place.end, format_comment(place.describe()) + new)


def _check_numbers(file: Path, ten: Mapping[str, Array], values: JointValues) -> None:
    """Raise InputError where the file, read again, has other numbers: torques are linear in m, h, I, damping and friction."""
    again = read_urdf(file, (), "fixed", STANDARD_GRAVITY, ())[0]
    for name, expected in ten.items():
        check_link_numbers(file, name, compute_link_parameters(again.link_of[name]), expected)
    for (name, attribute), value in values.items():
        joint = again.joint_of[name]
        check_joint_number(file, attribute, name, joint.damping if attribute == "damping" else joint.friction, value)
