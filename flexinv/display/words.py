"""Words and numbers as texts of a terminal and of a page: one line, printable, escaped."""

from __future__ import annotations

from html import escape

SHOWN_DIGITS = 4
CUT = "..."


def make_printable(text: str) -> str:
    """Return a text in one line, a mark for each character that a terminal or XML does not print."""
    return "".join(char if char.isprintable() else "\ufffd" for char in " ".join(str(text).split()))


def join_lines(message: object) -> str:
    """Return the lines of a message [-] as one, with semicolons between them."""
    return "; ".join(" ".join(line.split()) for line in str(message).splitlines() if line.strip())


def take_start(text: str, width: int) -> str:
    """Return a text in one line of at most ``width`` characters [-]; what is cut off is marked."""
    line = make_printable(text)
    return line if len(line) <= width else line[: width - len(CUT)] + CUT


def take_end(text: str, width: int) -> str:
    """Return the end of a text in one line, at most ``width`` characters [-]: names of one robot often begin alike."""
    line = make_printable(text)
    return line if len(line) <= width else CUT + line[len(line) - width + len(CUT) :]


def convert_to_xml(text: str) -> str:
    """Return a text as it stands between tags or quotes of XML."""
    return escape(make_printable(text))


def format_number(value: float) -> str:
    """Return a number [any unit] with four digits."""
    return f"{float(value):.{SHOWN_DIGITS}g}"


def format_count(number: int, word: str) -> str:
    """Return a number [-] of things, such as "1 joint" or "3 joints"."""
    return f"{number} {word}" if number == 1 else f"{number} {word}s"
