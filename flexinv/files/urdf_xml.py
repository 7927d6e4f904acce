"""Read a URDF's XML as data: sizes limited, entities refused, every number checked."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from flexinv.files.toml_tables import complaint, read_bytes
from flexinv.files.values import LARGEST, LONGEST_NAME
from flexinv.typing import Array
from flexinv.validation import nearest

LARGEST_FILE = 16 << 20  # [byte]: the largest URDF of example-robot-data has 0.2 MB


def read_robot(path: Path) -> Element:
    """Parse the file and return its ``<robot>``, at most ``LARGEST_FILE`` [byte]; InputError says what is wrong."""
    root = read_xml(path)
    if root.tag != "robot":
        advice = "the URDF itself; a .xacro file is expanded first: xacro robot.urdf.xacro > robot.urdf"
        raise complaint(str(path), f"<{root.tag[:80]}>", '<robot name="...">', advice)
    return root


def read_xml(path: Path) -> Element:
    """Parse a file of XML, at most ``LARGEST_FILE`` [byte] and without entities; InputError says what is wrong."""
    near = nearest(path.name, sorted(p.name for p in path.parent.glob("*.urdf"))) if path.parent.is_dir() else None
    existing = near or "the path of a file that exists"
    data = read_bytes(path, LARGEST_FILE, "a URDF", existing, "meshes as files of their own")
    try:
        root: Element = fromstring(data, forbid_dtd=True)
    except DefusedXmlException:
        expected = "XML without DOCTYPE and entities: they could swell without end or read other files"
        raise complaint(str(path), "a DOCTYPE or ENTITY", expected, "the file with its entities written out") from None
    except (ParseError, ValueError, LookupError) as error:
        given = f"XML that does not parse: {error}"
        raise complaint(str(path), given, "well-formed XML", _mended(data, str(error))) from None
    return root


def _mended(data: bytes, error: str) -> str:
    """Return the advice for XML that does not parse: another file, another encoding, or tags that are closed."""
    if b"<" not in data[:256]:
        return "a file of XML: this one does not begin as XML, so another format perhaps bears its name"
    if "invalid token" in error:
        return "text in UTF-8, or its encoding in the first line; & as &amp; and < as &lt; in names"
    return "each tag closed"


def location(path: Path, element: Element, key: str = "") -> str:
    """Name a place [-]: ``robot.urdf: <joint name="elbow">, axis``."""
    name = element.get("name")
    tag = f'<{element.tag} name="{name}">' if name else f"<{element.tag}>"
    return f"{path}: {tag}" + (f", {key}" if key else "")


def name_of(element: Element, path: Path) -> str:
    """Return the element's name [-]: 1 to 100 printable characters."""
    name = element.get("name", "")
    if not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
        expected = f"a name of 1 to {LONGEST_NAME} printable characters"
        raise complaint(f"{path}: <{element.tag}>", f"name = {name[:60]!a}", expected, f'<{element.tag} name="...">')
    return name


def numbers(
    element: Element | None, attribute: str, count: int, default: Any, where: str, largest: float = LARGEST
) -> Array:
    """Read an attribute as ``count`` finite numbers, in its own unit such as [m]; ``default`` where it is absent."""
    text = element.get(attribute) if element is not None else None
    if text is None:
        return np.array(default, dtype=np.float64)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(value) <= largest for value in values) or "_" in text:
        expected = f"{count} finite number{'s' if count > 1 else ''}, at most {largest:g} in size"
        write = f'{attribute}="{" ".join(["0"] * count)}"'
        if "$" in text:
            write = "what xacro makes of this expression: xacro robot.urdf.xacro > robot.urdf"
        raise complaint(where, f'{attribute}="{text[:60]}"', expected, write)
    return np.array(values)


def number(element: Element | None, attribute: str, default: float, where: str, largest: float = LARGEST) -> float:
    """Read an attribute as one finite number, in its own unit such as [kg]; ``default`` where it is absent."""
    return float(numbers(element, attribute, 1, [default], where, largest)[0])
