"""XML as other readers take it: two hyphens within a comment, prefixes without a declaration.

Both are against the standard, and Python's parser refuses them; urdfdom, MuJoCo and DART read such files.  What is put right here
is said, line by line, so that a linter can say it on.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

COMMENT = re.compile(rb"<!\[CDATA\[.*?\]\]>|<!--(.*?)-->", re.DOTALL)
TAG = re.compile(rb"<[A-Za-z_][^<>]*>")
PREFIX = re.compile(rb"(?:</?|\s)([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*")
QUOTED = re.compile(rb"\"[^\"]*\"|'[^']*'")
# Where documents of this field declare prefixes, what they declare.
NAMESPACES = {"drake": "http://drake.mit.edu", "xacro": "http://www.ros.org/wiki/xacro"}
BOUND = (b"xml", b"xmlns")


def repaired_xml(data: bytes) -> tuple[bytes, list[str]]:
    """Return a text of XML with its comments and prefixes put right [-], and what was wrong, a line each."""
    text, comments = _without_hyphens(data)
    return _with_namespaces(text, comments)


def _without_hyphens(data: bytes) -> tuple[bytes, list[str]]:
    """The text with spaces for hyphens that a comment must not hold; lines stay where they are."""
    words: list[str] = []
    parts: list[bytes] = []
    end = 0
    for found in COMMENT.finditer(data):
        inside = found[1]
        if inside is None or (b"--" not in inside and not inside.endswith(b"-")):
            continue
        line = data.count(b"\n", 0, found.start()) + 1
        words.append(f"line {line}: -- within a comment")
        parts += [data[end : found.start(1)], re.sub(rb"-{2,}|-$", _blank, inside)]
        end = found.end(1)
    return b"".join([*parts, data[end:]]), words


def _blank(found: re.Match[bytes]) -> bytes:
    return b" " * len(found[0])


def _with_namespaces(text: bytes, words: list[str]) -> tuple[bytes, list[str]]:
    """The text whose root declares the prefixes that nothing declares."""
    plain = COMMENT.sub(lambda found: b" " * len(found[0]), text)
    root = TAG.search(plain)
    if root is None:
        return text, words
    missing = [name for name in _prefixes(plain) if b"xmlns:" + name not in plain and name not in BOUND]
    declared = b""
    for name in dict.fromkeys(missing):
        prefix = name.decode("ascii", "replace")
        address = NAMESPACES.get(prefix, f"undeclared:{prefix}")
        declared += f' xmlns:{prefix}="{address}"'.encode()
        words = [*words, f'prefix {prefix}: without xmlns:{prefix}="{address}"']
    at = root.end() - (2 if root[0].endswith(b"/>") else 1)
    return text[:at] + declared + text[at:], words


def _prefixes(plain: bytes) -> Iterator[bytes]:
    for tag in TAG.finditer(plain):
        without = QUOTED.sub(b'""', tag[0])
        yield from (found[1] for found in PREFIX.finditer(without))
