"""Skeleton of a project outside of this one: a mechanism, an engine of one's own, and crosscheck.toml, which run at once."""

from __future__ import annotations

from pathlib import Path

from flexinv.errors import InputError

FOLDER = Path(__file__).resolve().parents[1] / "skeleton"
NAMES = {
    "my_engine.py.txt": "my_engine.py",
    "gitignore.txt": ".gitignore",
}  # what a package may not ship under its own name


def write(folder: Path) -> list[Path]:
    """Write the skeleton into a folder and return its files.  Raises InputError where one of them is there, and OSError."""
    files = sorted(f for f in FOLDER.rglob("*") if f.is_file() and "__pycache__" not in f.parts)
    targets = [folder / f.relative_to(FOLDER).with_name(NAMES.get(f.name, f.name)) for f in files]
    for target in targets:
        if target.exists():
            raise InputError(
                f"{target} is there already, and stays; write crosscheck init with a new or an empty folder"
            )
    for file, target in zip(files, targets, strict=True):
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    return targets
