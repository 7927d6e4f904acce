"""Secrets: what a command line, a message or an address says without its passwords.

An address (``postgresql://me:secret@host/nights?sslpassword=x``) keeps its user, host and path.  What stands in it as a
password, and all that follows a question mark, is ``***``: no file, page, log or message shows it.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from urllib.parse import unquote

HIDDEN = "***"
# Up to the last @ of the word: a password may hold one that nobody has encoded.
PASSWORD = re.compile(r"(?P<before>[A-Za-z][\w+.-]*://[^/\s:@]*):\S*@")
QUERY = re.compile(r"(?P<before>[A-Za-z][\w+.-]*://[^\s?]*)\?[^\s'\")]*")
ADDRESSES = ("--history", "--scheduler")  # options whose value is an address, or was meant to be one


def remove_passwords(text: str) -> str:
    """Return a text with every password of an address in it hidden."""
    return QUERY.sub(rf"\g<before>?{HIDDEN}", PASSWORD.sub(rf"\g<before>:{HIDDEN}@", text))


def remove_password(text: str, password: str | None) -> str:
    """Return a text in which a password that is known is hidden, as it is and as it is written in an address."""
    for word in {password, unquote(password)} - {""} if password else ():
        text = text.replace(word, HIDDEN)
    return remove_passwords(text)


def format_command_line(words: Sequence[str]) -> str:
    """Return a command line as somebody may read it: ``crosscheck`` and its words, without passwords."""
    shown = []
    before = ""
    for word in words:
        option, equals, value = word.partition("=")
        if before in ADDRESSES and "://" not in word:
            word = HIDDEN  # no address at all: it may be anything
        elif option in ADDRESSES and equals and "://" not in value:
            word = f"{option}={HIDDEN}"
        shown.append(remove_passwords(word))
        before = word
    return shlex.join(["crosscheck", *shown])
