"""Trust in programs: what ``crosscheck.toml`` runs is run only after its user has said so once.

A file in the user's own configuration remembers, by path of ``crosscheck.toml`` and name of the engine, what was trusted: a
digest of the settings, and one of every file that belongs to the program (`crosscheck.doors.program_files`).  A new or changed
one is not trusted.  Trust says nothing of what a program reaches outside of the project: an interpreter, installed packages, the
network.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from crosscheck.output_folder import replace


def find_store() -> Path:
    """Return the file that remembers: below $XDG_CONFIG_HOME, or ~/.config."""
    base = os.environ.get("XDG_CONFIG_HOME", "")
    return (Path(base) if base else Path.home() / ".config") / "crosscheck" / "trusted.json"


def read_trusted_parts(config: Path, name: str) -> dict[str, str] | None:
    """Return the digests of an engine's parts that the user trusts; None where nothing is remembered."""
    parts = read_store().get(str(config), {}).get(name)
    if not isinstance(parts, dict):
        return None
    return {str(part): str(digest) for part, digest in parts.items()}


def write_trusted_parts(config: Path, parts: Mapping[str, Mapping[str, str]]) -> None:
    """Remember the parts of a file's engines, and forget those that were there before.  Raises OSError."""
    file = find_store()
    file.parent.mkdir(parents=True, exist_ok=True)
    plain = {name: dict(digests) for name, digests in parts.items()}
    replace(file, json.dumps({**read_store(), str(config): plain}, indent=1) + "\n")


def read_store() -> dict[str, dict[str, object]]:
    """Return all that is remembered; nothing where the file is none of ours."""
    try:
        plain = json.loads(find_store().read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(plain, dict):
        return {}
    return {str(path): one for path, one in plain.items() if isinstance(one, dict)}
