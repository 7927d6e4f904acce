"""Trust in programs: what ``crosscheck.toml`` runs is run only after its user has said so once.

A file in the user's own configuration remembers, by path of ``crosscheck.toml`` and name of the engine, a digest of the command
(of an FMU: of its content).  A new or changed one is not trusted.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from crosscheck.output_folder import replace


def store() -> Path:
    """Return the file that remembers: below $XDG_CONFIG_HOME, or ~/.config."""
    base = os.environ.get("XDG_CONFIG_HOME", "")
    return (Path(base) if base else Path.home() / ".config") / "crosscheck" / "trusted.json"


def trusted(config: Path, name: str, stamp: str) -> bool:
    """Return True if the user trusts an engine of a file as it is now (its stamp)."""
    return known().get(str(config), {}).get(name) == stamp


def trust(config: Path, stamps: Mapping[str, str]) -> None:
    """Remember the stamps of a file's engines, and forget those that were there before.  Raises OSError."""
    file = store()
    file.parent.mkdir(parents=True, exist_ok=True)
    replace(file, json.dumps({**known(), str(config): dict(stamps)}, indent=1) + "\n")


def known() -> dict[str, dict[str, str]]:
    """Return all that is remembered; nothing where the file is none of ours."""
    try:
        plain = json.loads(store().read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(plain, dict):
        return {}
    return {str(path): one for path, one in plain.items() if isinstance(one, dict)}
