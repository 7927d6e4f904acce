"""Rules of everything that shows itself: ten lines of text, a page that is well-formed and has nothing foreign."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree as ET

from flexinv.display import card as cards

SVG = "{http://www.w3.org/2000/svg}"


def check_shown(result: Any) -> ET.Element:
    """Hold both forms of a result against their rules, and return its page as a tree."""
    text = repr(result)
    assert text == str(result)
    assert "cannot be described" not in text
    lines = text.split("\n")
    assert len(lines) <= cards.TEXT_LINES
    assert max(map(len, lines)) <= cards.TEXT_COLUMNS
    assert all(line.isprintable() for line in lines)
    assert "array(" not in text
    page = result._repr_html_()
    assert len(page) < 60_000  # a notebook holds it once for every time that it is shown
    tree = ET.fromstring(page)
    for one in tree.iter():
        assert one.tag.removeprefix(SVG) not in {
            "script",
            "style",
            "link",
            "iframe",
            "object",
            "image",
            "img",
            "a",
            "use",
        }
        for key, value in one.attrib.items():
            assert not key.lower().startswith("on")
            assert "href" not in key
            assert "url(" not in value
    assert set(re.findall(r"https?://[^\"']+", page)) <= {SVG.strip("{}")}
    return tree
