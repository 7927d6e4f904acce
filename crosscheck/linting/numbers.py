"""Numbers of a URDF as they are written: broken over lines, with commas or units, too few or too many.

XML makes a space of a line break or a tab within an attribute; urdfdom, which Pinocchio reads with, sees it as it is, and takes
no number there.  Measured with MuJoCo 4.0.0, Pinocchio 4.1.0 and Drake 1.51.1:

    mass value=" 1.25 ", xyz="0<line break>0 0.1"    Pinocchio leaves out the whole <inertial>, the others read it
    mass value="1,25"                                MuJoCo refuses the file, Pinocchio leaves out <inertial>, Drake takes 1 kg
    xyz="0,0,0.1", mass value="1. 25"                MuJoCo and Drake refuse the file, Pinocchio leaves out <inertial>
    box size="0.1,0.2,0.3"                           MuJoCo refuses the file, the others leave out the shape
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree.ElementTree import Element

from crosscheck.findings.finding import Finding, make_error, make_warning

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
COUNTS = {"xyz": 3, "rpy": 3, "size": 3, "scale": 3}  # of numbers in an attribute; all others have one
NAMES = (
    "xyz|rpy|size|scale|radius|length|value|i[xyz]{2}|multiplier|offset|lower|upper|effort|velocity|damping|friction"
)
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
BROKEN = re.compile(rf"\s({NAMES})\s*=\s*(\"[^\"<]*[\n\r\t][^\"<]*\"|'[^'<]*[\n\r\t][^'<]*')")
ATTRIBUTES = {
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
INERTIAL = (
    "Pinocchio takes zero without a word, Drake what stands before a comma, or they refuse the file, as MuJoCo does"
)
SHAPE = "MuJoCo refuses the file, Pinocchio and Drake leave out the shape, or refuse"
BETWEEN = (
    "Pinocchio's parser takes no number there: it leaves out <inertial> or shape, or refuses; MuJoCo and Drake read it"
)


def check_broken_lines(text: str) -> Iterator[Finding]:
    """Yield attributes of numbers in which a line break or a tab stands [any unit]."""
    plain = COMMENT.sub(lambda found: re.sub(r"[^\n]", " ", found.group()), text)
    for found in BROKEN.finditer(plain):
        line = plain.count("\n", 0, found.start(2)) + 1
        value = found.group(2)[1:-1]
        shown = value.replace("\n", "\\n").replace("\r", "\\r").replace("\t", "\\t")
        write = f'{found.group(1)}="{" ".join(value.split())}"'[:120]
        yield make_warning("number", f"line {line}", f'{found.group(1)}="{shown}"'[:80], BETWEEN, write)


def check_numbers(robot: Element) -> Iterator[Finding]:
    """Yield attributes of links that are not the numbers that stand there in a URDF [any unit]."""
    for link in robot.findall("link"):
        place = f"link {link.get('name')}"
        for part in link:
            if part.tag not in ("inertial", "visual", "collision"):
                continue
            why = INERTIAL if part.tag == "inertial" else SHAPE
            for element in part.iter():
                for name in ATTRIBUTES.get(element.tag, ()):
                    if name in element.attrib:
                        yield from _check_attribute(place, name, element.get(name, ""), why)


def _check_attribute(place: str, name: str, text: str, why: str) -> Iterator[Finding]:
    count = COUNTS.get(name, 1)
    words = text.split()
    given = f'{name}="{text}"'[:80]
    if len(words) == count and all(NUMBER.fullmatch(word) for word in words):
        if count == 1 and text != words[0]:
            yield make_warning("number", place, given, f"spaces beside it: {BETWEEN}", f'{name}="{words[0]}"')
        return
    cause, write = _find_cause(text, count)
    yield make_error("number", place, given, f"{cause}: {why}", f'{name}="{write}"')


def _find_cause(text: str, count: int) -> tuple[str, str]:
    """Return the cause for which a text is no numbers, and the text to write."""
    tries = (
        ("commas or semicolons between numbers", re.sub(r"[,;]", " ", text)),
        ("a decimal comma", text.replace(",", ".")),
        ("a number that is broken in two", re.sub(r"(?<=[\d.])\s+(?=\d)", "", text) if count == 1 else text),
        ("a unit", re.sub(r"(?<=[\d.])\s*(kg|mm|cm|m|rad|deg|f)\b", "", text)),
    )
    for cause, changed in tries:
        words = changed.split()
        if changed != text and len(words) == count and all(NUMBER.fullmatch(word) for word in words):
            return cause, " ".join(words)
    expected = "one finite number" if count == 1 else f"{count} finite numbers with spaces between them"
    return f"no {expected}", "1.0" if count == 1 else " ".join(["0.1"] * count)
