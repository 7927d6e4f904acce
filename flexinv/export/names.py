"""Names of a mechanism as words of C, CMake, XML and Markdown: mangled where they are identifiers, escaped where they are text.

Whatever somebody has written as a name, a file of C has it only as letters, digits and underscores, or within a string or a
comment that it cannot end.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from flexinv.errors import InputError

# Commands that compile C for this machine, the usual one first; and the Python package that brings one.
C_COMPILERS = ("cc", "gcc", "clang")
COMPILER_PACKAGE = "ziglang"
LIBRARY_PREFIX = "flexinv_"  # of all that a library defines: no keyword of C or C++, no name of the system begins so
LONGEST = 100  # characters of a mangled name: a file that bears it has a name that every system takes


def make_word(name: str) -> str:
    """Return a name as a word of letters, digits and underscores [-]; letters beyond ASCII become their numbers."""
    text = "".join(one if one.isascii() else f"u{ord(one):x}" for one in name)
    word = "".join(one if one.isalnum() or one == "_" else "_" for one in text)
    return word[:LONGEST].strip("_") or "unnamed"


def make_words(kind: str, names: Sequence[str]) -> dict[str, str]:
    """Return name -> mangled name in capitals [-]; raises InputError where two names of a ``kind`` become one."""
    taken: dict[str, str] = {}
    for name in names:
        word = make_word(name).upper()
        if word in taken:
            raise InputError(
                f"export: {kind} {taken[word]!r} and {name!r} both become {word} in C; rename one of them in the mechanism"
            )
        taken[word] = name
    return {name: word for word, name in taken.items()}


def format_string(text: str) -> str:
    """Return a text as a literal of C [-], quotes and all; what is not plain becomes octal numbers of its bytes in UTF-8."""
    plain = "".join(chr(one) if _is_plain(one) else f"\\{one:03o}" for one in text.encode())
    return f'"{plain}"'


def format_comment(text: str) -> str:
    """Return a text that may stand in a comment of C or CMake [-]: one line of plain signs that ends no comment."""
    return "".join(chr(one) if _is_plain(one) and chr(one) not in "*/#[]" else "." for one in text.encode())


def format_markdown(text: str) -> str:
    """Return a text for a table of Markdown [-], where it neither ends a cell nor becomes a link, a picture or HTML."""
    line = " ".join(text.split())
    return "".join(one if one.isalnum() or one in " _-.,:" else f"&#{ord(one)};" for one in line)


def format_line(text: str) -> str:
    """Return a text on one line that XML can hold [-]: signs that it forbids become _, and whoever writes it escapes the rest."""
    return "".join(one if one.isprintable() and one != "\N{REPLACEMENT CHARACTER}" else "_" for one in text)


def format_numbers(numbers: Iterable[float]) -> str:
    """Return numbers [any unit] as a list of C, in hexadecimal, so that no digit is lost."""
    return ", ".join(float(one).hex() for one in numbers)


def _is_plain(byte: int) -> bool:
    """Return True for a sign that is itself in every string of C: no quote, no escape, no part of a trigraph."""
    return 32 <= byte < 127 and chr(byte) not in '"\\?'
