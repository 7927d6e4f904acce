"""Elements of an XML file with the bytes at which they stand, edits of these bytes, and comments of what stood there before.

A file is read as MuJoCo and urdfdom read it: two hyphens within a comment are no fault, and stay where they are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from flexinv.errors import InputError
from flexinv.files.lenient_xml import replace_hyphens

TAG = re.compile(rb"""<[^"'>]*(?:"[^"]*"[^"'>]*|'[^']*'[^"'>]*)*>""")
ATTRIBUTE = re.compile(rb"""([^\s=<>"'/]+)(\s*=\s*)("[^"]*"|'[^']*')""")
TAG_NAME = re.compile(rb"<[^\s/>]+")


@dataclass
class XmlElement:
    """An element of a file.

    start, inside, close, end : bytes at which it, its content, its end tag and what follows begin; <a/> has no room inside
    """

    tag: str
    attributes: Mapping[str, str]
    start: int
    inside: int
    close: int = -1
    end: int = -1
    children: list[XmlElement] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Return its name [-], "" where it has none."""
        return self.attributes.get("name", "")

    @property
    def opened(self) -> bool:
        """Return True if there is room inside, between two tags."""
        return self.close < self.end

    def find_child(self, tag: str) -> XmlElement | None:
        """Return the first child of a tag, None where there is none."""
        return next((one for one in self.children if one.tag == tag), None)

    def list_elements(self) -> Iterator[XmlElement]:
        """Yield the element and all inside of it, in the order of the file."""
        yield self
        for child in self.children:
            yield from child.list_elements()

    def describe(self) -> str:
        """Return the attributes of the element and of those inside it in a line [unit of each]."""
        words = [
            f"{one.tag} " + " ".join(f"{k}={v}" for k, v in one.attributes.items()) for one in self.list_elements()
        ]
        return "; ".join(word.strip() for word in words)


@dataclass(frozen=True)
class Edit:
    """Bytes that take the place of those from ``start`` to ``end``."""

    start: int
    end: int
    new: bytes


def parse_elements(path: Path, text: bytes) -> XmlElement:
    """Return the root of a file with all elements [byte].

    Raises InputError: an encoding that is not a superset of ASCII, XML that is not well formed.
    """
    if text[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(f"{path}: it is UTF-16, expected an encoding that holds ASCII as it is; write it as UTF-8")
    parser = expat.ParserCreate()
    whole = XmlElement("", {}, 0, 0)
    opened = [whole]

    def find_end_of_tag() -> int:
        tag = TAG.match(text, parser.CurrentByteIndex)
        assert tag is not None
        return tag.end()

    def begin(tag: str, attributes: dict[str, str]) -> None:
        element = XmlElement(tag, attributes, parser.CurrentByteIndex, find_end_of_tag())
        opened[-1].children.append(element)
        opened.append(element)

    def end(tag: str) -> None:
        element = opened.pop()
        empty = text.endswith(b"/>", element.start, element.inside)
        element.close = element.inside if empty else parser.CurrentByteIndex
        element.end = element.inside if empty else find_end_of_tag()

    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    try:
        parser.Parse(replace_hyphens(text)[0], True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: {error}, expected XML that is well formed; mend that line") from None
    return whole.children[0]


def apply_edits(text: bytes, edits: Iterable[Edit]) -> bytes:
    """Return the text with edits that do not overlap."""
    for edit in sorted(edits, key=lambda one: -one.start):
        text = text[: edit.start] + edit.new + text[edit.end :]
    return text


def write_attribute(element: bytes, name: str, value: str) -> bytes:
    """Return the text of an element with another value of an attribute of its first tag [unit of the attribute]."""
    tag = TAG.match(element)
    assert tag is not None
    key = name.encode("ascii")
    new = key + b'="' + value.encode("ascii") + b'"'
    head = ATTRIBUTE.sub(lambda match: new if match[1] == key else match[0], tag.group())
    if not any(match[1] == key for match in ATTRIBUTE.finditer(head)):
        head = TAG_NAME.sub(lambda match: match[0] + b" " + new, head, count=1)
    return head + element[tag.end() :]


def format_comment(before: str) -> bytes:
    """Return the words for old numbers [unit of each] as a comment in which no two hyphens meet, "" for none."""
    if not before:
        return b""
    return f"<!-- before: {re.sub('-(?=-)', '- ', before)} -->".encode("ascii", "xmlcharrefreplace")
