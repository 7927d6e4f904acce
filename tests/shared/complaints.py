"""Faults planted in good files, and the check of what is said about them."""

from __future__ import annotations

import tomllib
from pathlib import Path

Planted = tuple[str, str, str, str, str, str, str]


def planted(name: str) -> dict[str, Planted]:
    """Read faults: text, replacement, table, key, part of what was given, of what is expected, of what to write."""
    data = tomllib.loads(Path(__file__).parents[1].joinpath("data", name).read_text(encoding="utf-8"))
    return {title: (*case["edit"], *case["place"], *case["says"]) for title, case in data.items()}


def check_complaint(text: str, file: Path, case: Planted) -> None:
    """Check that a message names file, table and key, and tells what was given, expected, and what to write."""
    _, _, table, key, given, expected, advice = case
    first, *rest = text.splitlines()
    assert str(file) in first
    assert (f"[{table}" if table else "the top of the file") in first
    assert not key or first.endswith(f"key {key}")
    lines = {line.split(":")[0].strip(): line for line in rest[:3]}
    assert given in lines["given"]
    assert expected in lines["expected"]
    assert advice in lines["write"]
