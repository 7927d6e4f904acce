"""Default options of an engine, as far as it can be asked: what else is another in the release that differs."""

from __future__ import annotations

import json
from pathlib import Path

from packaging.utils import canonicalize_name

from crosscheck.bisect.environments import Environment
from crosscheck.bisect.script import Script, run_script

PROBES = Path(__file__).parent / "probes"
LONGEST_QUESTION = 120.0  # [s] that an engine may take to state its defaults


def read_defaults(package: str, environment: Environment) -> dict[str, str] | None:
    """Return the default options of a package by name, as text; None where it cannot be asked.

    A probe ``probes/NAME.py.txt`` is a script that prints them as JSON values.
    """
    probe = PROBES / f"{canonicalize_name(package)}.py.txt"
    if not probe.is_file():
        return None
    with run_script(Script((str(probe),), timeout=LONGEST_QUESTION), environment.python, as_python=True) as (end, _):
        lines = end.out.strip().splitlines()
        try:
            data = json.loads(lines[-1]) if lines and not end.reason else None
        except ValueError:
            return None
    return {str(name): str(value) for name, value in data.items()} if isinstance(data, dict) else None


def list_differences(before: dict[str, str], after: dict[str, str]) -> list[tuple[str, str, str]]:
    """Return name, old and new value of all that differs; "" for what one of them does not have."""
    names = sorted({*before, *after})
    return [(n, before.get(n, ""), after.get(n, "")) for n in names if before.get(n, "") != after.get(n, "")]
