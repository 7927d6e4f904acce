"""XML within bounds: at most so many levels and elements, no DOCTYPE and no entities, whatever the size of the file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder

from defusedxml.ElementTree import DefusedXMLParser

DEEPEST = 500  # levels: the parser of MuJoCo has the same bound, a nested chain of 480 bodies passes
# Elements, and attributes beyond one per element: the largest robots of example-robot-data have 4,000.
MOST_ELEMENTS = 200_000


class XmlBoundExceeded(ValueError):
    """A document beyond a bound.

    given, expected, write : the words of a complaint
    """

    def __init__(self, given: str, expected: str, write: str) -> None:
        """Keep the words."""
        super().__init__(f"{given}; expected {expected}")
        self.given = given
        self.expected = expected
        self.write = write


class _BoundedBuilder(TreeBuilder):
    """A builder of trees that counts."""

    def __init__(self) -> None:
        super().__init__()
        self.depth = 0
        self.count = 0

    def start(self, tag: Any, attributes: Mapping[Any, Any]) -> Element:
        """Begin an element."""
        self.depth += 1
        self.count += max(1, len(attributes))
        if self.depth > DEEPEST:
            write = "a file without elements that stand in each other for nothing; a chain of bodies as separate models"
            raise XmlBoundExceeded(f"more than {DEEPEST} levels of elements", f"at most {DEEPEST} levels", write)
        if self.count > MOST_ELEMENTS:
            write = "the machine alone: what is only seen, and tables of numbers, in files of their own"
            raise XmlBoundExceeded(
                f"more than {MOST_ELEMENTS} elements and attributes", f"at most {MOST_ELEMENTS}", write
            )
        return super().start(tag, dict(attributes))

    def end(self, tag: str) -> Element:
        """End an element."""
        self.depth -= 1
        return super().end(tag)


def parse_bounded(data: bytes) -> Element:
    """Return the root of a document [-].

    Raises Unbounded, ParseError, LookupError (an encoding that Python does not know), and DefusedXmlException for a DOCTYPE.
    """
    parser = DefusedXMLParser(target=_BoundedBuilder(), forbid_dtd=True)
    parser.feed(data)
    root: Element = parser.close()
    return root
