"""XML as other readers take it: two hyphens within a comment, prefixes without a declaration.

Both are against the standard, and Python's parser refuses them; urdfdom, MuJoCo and DART read such files.  What is put right here
is said, line by line, so that a linter can say it on.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

SECTION_STARTS = re.compile(rb"<!\[CDATA\[|<!--")
SECTION_ENDS = {b"<!--": b"-->", b"<![CDATA[": b"]]>"}
TAG = re.compile(rb"<[A-Za-z_][^<>]*>")
DECLARED = re.compile(rb"xmlns:([A-Za-z_][\w.-]*)")
PREFIX = re.compile(rb"(?:</?|\s)([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*")
QUOTED = re.compile(rb"\"[^\"]*\"|'[^']*'")
# Where documents of this field declare prefixes, what they declare.
NAMESPACES = {"drake": "http://drake.mit.edu", "xacro": "http://www.ros.org/wiki/xacro"}
BOUND = (b"xml", b"xmlns")
MOST_PREFIXES = 100  # that are put right: no document of this field has ten


def replace_invalid_xml(data: bytes) -> tuple[bytes, list[str]]:
    """Return a text of XML with its comments and prefixes put right [-], and what was wrong, a line each."""
    text, comments = replace_hyphens(data)
    return _add_namespaces(text, comments)


def _find_sections(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Yield comments and CDATA: how each opens, where its inside begins, and where it ends; in one way through the text."""
    at = 0
    while match := SECTION_STARTS.search(data, at):
        mark = match[0]
        end = data.find(SECTION_ENDS[mark], match.end())
        if end < 0:
            return  # a parser ends here, too
        yield mark, match.end(), end
        at = end + len(SECTION_ENDS[mark])


def replace_hyphens(data: bytes) -> tuple[bytes, list[str]]:
    """Return the text with spaces for hyphens that a comment must not hold [-], and what was wrong; bytes stay where they are."""
    words: list[str] = []
    parts: list[bytes] = []
    copied = 0
    line = 1
    counted = 0
    for mark, start, end in _find_sections(data):
        inside = data[start:end]
        if mark != b"<!--" or (b"--" not in inside and not inside.endswith(b"-")):
            continue
        line += data.count(b"\n", counted, start)
        counted = start
        words.append(f"line {line}: -- within a comment")
        parts += [data[copied:start], re.sub(rb"-{2,}|-$", _make_blanks, inside)]
        copied = end
    return b"".join([*parts, data[copied:]]), words


def _make_blanks(found: re.Match[bytes]) -> bytes:
    return b" " * len(found[0])


def _replace_sections(text: bytes) -> bytes:
    """The text with spaces for comments and CDATA."""
    parts: list[bytes] = []
    copied = 0
    for mark, start, end in _find_sections(text):
        first = start - len(mark)
        last = end + len(SECTION_ENDS[mark])
        parts += [text[copied:first], b" " * (last - first)]
        copied = last
    return b"".join([*parts, text[copied:]])


def _add_namespaces(text: bytes, words: list[str]) -> tuple[bytes, list[str]]:
    """The text whose root declares the prefixes that nothing declares."""
    plain = _replace_sections(text)
    root = TAG.search(plain)
    if root is None:
        return text, words
    known = {*BOUND, *DECLARED.findall(plain)}
    missing = [name for name in dict.fromkeys(_list_prefixes(plain)) if name not in known][:MOST_PREFIXES]
    declared = b""
    for name in missing:
        prefix = name.decode("ascii", "replace")
        address = NAMESPACES.get(prefix, f"undeclared:{prefix}")
        declared += f' xmlns:{prefix}="{address}"'.encode()
        words = [*words, f'prefix {prefix}: without xmlns:{prefix}="{address}"']
    at = root.end() - (2 if root[0].endswith(b"/>") else 1)
    return text[:at] + declared + text[at:], words


def _list_prefixes(plain: bytes) -> Iterator[bytes]:
    for tag in TAG.finditer(plain):
        without = QUOTED.sub(b'""', tag[0])
        yield from (found[1] for found in PREFIX.finditer(without))
