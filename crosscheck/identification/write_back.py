"""Write back: the user's own URDF with the masses, damping and friction that were identified; all else stays, byte by byte.

Only the elements ``<inertial>`` and ``<dynamics>`` that change are replaced, the old values stand beside them in a comment.  Each
written file is read again and held against what was identified.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from crosscheck.identification.identify import Identification
from crosscheck.identification.pseudo_inertia import COLUMNS, QUANTITIES, ROWS
from crosscheck.identification.response import compute_link_inertias
from crosscheck.identification.table import Row
from crosscheck.report.words import format_short
from flexinv.errors import InputError
from flexinv.files.from_urdf import STANDARD_GRAVITY, read_robot, read_urdf
from flexinv.model.parallel_axis import compute_parallel_axis_term
from flexinv.rigid.torque_regressor import compute_link_parameters
from flexinv.typing import Array

# kind of parameter -> attribute of <dynamics>
LAWS = {
    "viscous friction": "damping",
    "joint damping": "damping",
    "coulomb friction": "friction",
    "joint friction": "friction",
}
ROUNDED = 1e-12  # of the largest of m, h, I: numbers are written with all their digits, and moved between frames twice
TAG = re.compile(rb"""<[^"'>]*(?:"[^"]*"[^"'>]*|'[^']*'[^"'>]*)*>""")
Place = tuple[str, str]  # tag and name of its link or joint


@dataclass(frozen=True)
class Span:
    """Bytes of a file from ``start`` to ``end``: of an element, or an empty place where one is to stand."""

    start: int
    end: int


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
    if file.exists():
        raise InputError(f"--write-urdf {file}: there is such a file, and none is written over; write another name")
    text = mechanism.urdf.read_bytes()
    robot = read_robot(mechanism.urdf)
    spans = _find_spans(mechanism.urdf, text)
    ten = _list_identified_links(identification, spans)
    rows = [row for row in identification.parameters if row.parameter in LAWS and ("dynamics", row.place) in spans]
    written = _format_inertials(ten, robot, spans) | _format_dynamics(text, rows, robot, spans)
    for span in sorted(written, key=lambda one: -one.start):
        text = text[: span.start] + written[span] + text[span.end :]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(text)
    try:
        _check_numbers(file, ten, rows)
    except InputError:
        file.unlink()
        raise
    said = {(quantity, name) for name in ten for quantity in QUANTITIES} | {(row.parameter, row.place) for row in rows}
    return list(_describe_rest(identification.parameters, said))


def _list_identified_links(identification: Identification, spans: Mapping[Place, Span]) -> dict[str, Array]:
    """m, h, I (10,) [kg], [kg m], [kg m^2] of each link of the file whose mass properties were free."""
    machine = identification.machine
    ten = compute_link_inertias(machine.space, machine.mechanism, machine.space.compute_values(identification.fit.z))
    links = enumerate(machine.mechanism.links)
    return {
        one.name: ten[k] for k, one in links if one.name in machine.space.factors and ("inertial", one.name) in spans
    }


def _find_spans(path: Path, text: bytes) -> dict[Place, Span]:
    """The place of what may be replaced: the inertial of each link, the dynamics of each joint."""
    if text[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(f"{path}: it is UTF-16, expected an encoding that holds ASCII as it is; write it as UTF-8")
    parser = expat.ParserCreate()
    owner: list[tuple[str, str]] = []
    starts: dict[str, int] = {}
    spans: dict[Place, Span] = {}
    inner = {"link": "inertial", "joint": "dynamics"}

    def find_end() -> int:
        tag = TAG.match(text, parser.CurrentByteIndex)
        assert tag is not None
        return tag.end()

    def begin(tag: str, attributes: dict[str, str]) -> None:
        owner.append((tag, attributes.get("name", "")))
        if len(owner) == 3 and inner.get(owner[1][0]) == tag:
            starts[tag] = parser.CurrentByteIndex

    def end(tag: str) -> None:
        if len(owner) == 3 and inner.get(owner[1][0]) == tag and (tag, owner[1][1]) not in spans:
            spans[tag, owner[1][1]] = Span(starts[tag], find_end())
        opened = text.startswith(b"</", parser.CurrentByteIndex)  # there is no room inside of <link name="x"/>
        if len(owner) == 2 and tag in inner and opened and (inner[tag], owner[1][1]) not in spans:
            spans[inner[tag], owner[1][1]] = Span(parser.CurrentByteIndex, parser.CurrentByteIndex)
        owner.pop()

    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise InputError(
            f"{path}: {error}, expected XML that is well formed; mend that line, or write no URDF"
        ) from None
    return spans


def _format_inertials(ten: Mapping[str, Array], robot: Element, spans: Mapping[Place, Span]) -> dict[Span, bytes]:
    before = {link.get("name", ""): link.find("inertial") for link in robot.findall("link")}
    return {spans["inertial", name]: _format_inertial(own, before[name]) for name, own in ten.items()}


def _format_inertial(ten: Array, before: Element | None) -> bytes:
    """The element of m, h, I (10,) [kg], [kg m], [kg m^2], and what stood there before."""
    mass = ten[0]
    com = ten[1:4] / mass
    tensor = np.zeros((3, 3))
    tensor[ROWS, COLUMNS] = tensor[COLUMNS, ROWS] = ten[4:]
    tensor -= compute_parallel_axis_term(mass, com)
    xyz = " ".join(repr(float(x)) for x in com)
    places = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    entries = " ".join(f'{name}="{float(tensor[at])!r}"' for name, at in places.items())
    parts = [
        _format_comment(before),
        f'<inertial><origin xyz="{xyz}" rpy="0 0 0"/><mass value="{float(mass)!r}"/><inertia {entries}/></inertial>',
    ]
    return "".join(parts).encode("ascii", "xmlcharrefreplace")


def _format_comment(before: Element | None) -> str:
    """The attributes of an element and of those inside it, as a comment in which no two dashes meet."""
    if before is None:
        return ""
    words = [f"{one.tag} " + " ".join(f"{k}={v}" for k, v in one.attrib.items()) for one in before.iter()]
    text = "; ".join(word.strip() for word in words).replace("--", "- -")
    return f"<!-- before: {text} -->"


def _format_dynamics(text: bytes, rows: list[Row], robot: Element, spans: Mapping[Place, Span]) -> dict[Span, bytes]:
    """The elements of joints with damping or friction that was found; their other attributes stay as they are written."""
    out = {}
    for joint in robot.findall("joint"):
        span = spans.get(("dynamics", joint.get("name", "")))
        own = [row for row in rows if row.place == joint.get("name")]
        if span is None or not own:
            continue
        element = text[span.start : span.end] or b"<dynamics/>"
        for row in own:
            element = _write_attribute(element, LAWS[row.parameter].encode(), repr(row.value).encode())
        out[span] = _format_comment(joint.find("dynamics")).encode("ascii", "xmlcharrefreplace") + element
    return out


def _write_attribute(element: bytes, name: bytes, value: bytes) -> bytes:
    """The element with another value of an attribute of its first tag."""
    tag = TAG.match(element)
    assert tag is not None
    own = re.compile(rb"(?<=\s)" + name + rb"""\s*=\s*(?:"[^"]*"|'[^']*')""")
    new = name + b'="' + value + b'"'
    head, count = own.subn(new, tag.group())
    if not count:
        head = head.replace(b"<dynamics", b"<dynamics " + new, 1)
    return head + element[tag.end() :]


def _check_numbers(file: Path, ten: Mapping[str, Array], rows: list[Row]) -> None:
    """Raise InputError where the file, read again, has other numbers: torques are linear in m, h, I, damping and friction."""
    again = read_urdf(file, (), "fixed", STANDARD_GRAVITY, ())[0]
    for name, expected in ten.items():
        found = compute_link_parameters(again.link_of[name])
        if np.abs(found - expected).max() > ROUNDED * np.abs(expected).max():
            raise InputError(
                f"{file}: link {name} is read back as {found}, expected {expected}: the file is not written"
            )
    for row in rows:
        joint = again.joint_of[row.place]
        found_loss = joint.damping if LAWS[row.parameter] == "damping" else joint.friction
        if found_loss != row.value:
            raise InputError(
                f"{file}: {row.parameter} of {row.place} is read back as {found_loss}, expected {row.value}"
            )


def _describe_rest(rows: list[Row], said: Collection[tuple[str, str]]) -> Iterator[str]:
    """Yield what the file does not say, with its value [unit of each]."""
    for row in rows:
        if (row.parameter, row.place) not in said:
            yield f"{row.parameter} of {row.place}: {format_short(row.value)} {row.unit}, which a URDF cannot say"
