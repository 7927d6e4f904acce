"""Location of a mechanism file's URDF: inside the models folder, or in an installed package of robots."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from flexinv.files.schema import UrdfTable
from flexinv.files.toml_tables import Location, complaint
from flexinv.validation import nearest

ROBOTS = "cmeel.prefix/share/example-robot-data/robots"  # where the wheel of example-robot-data puts its robots


def robots_folder() -> Path:
    """Return the folder of the robots of the PyPI package example-robot-data [-]; InputError without it."""
    advice = "pip install 'flexinv[robots]'"
    try:
        folder = Path(str(distribution("example-robot-data").locate_file(ROBOTS)))
    except PackageNotFoundError:
        given, expected = "it is not installed", "the PyPI package example-robot-data (models only, 131 MB)"
        raise complaint("package example-robot-data", given, expected, advice) from None
    if not folder.is_dir():
        raise complaint("package example-robot-data", f"no folder {folder}", "its robots there", advice)
    return folder.resolve()


def find_urdf(table: UrdfTable, where: Location) -> tuple[Path, tuple[Path, ...]]:
    """Return the URDF and the folders for its ``package://`` paths [-].

    With a package: inside its robots.  Without: beside the mechanism file, and never outside the models folder
    (the one that holds the mechanism's folder).
    """
    if table.package is not None:
        start = limit = robots_folder()
        packages: tuple[Path, ...] = (start, start.parent.parent)
    else:
        start = where.file.resolve().parent
        limit = start.parent
        packages = (start,)
    path = (start / table.path).resolve()
    if Path(table.path).is_absolute() or not path.is_relative_to(limit):
        expected = f"a relative path that stays inside {'the package' if table.package else 'the models folder'}"
        raise where.wrong("path", f'path = "{table.path}"', expected, f'path = "{Path(table.path).name}"')
    if not path.is_file():
        known = sorted(str(p.relative_to(start)) for p in start.rglob("*.urdf")) if start.is_dir() else []
        near = nearest(table.path, known)
        write = f'path = "{near}"' if near else "the path of a URDF that exists"
        raise where.wrong("path", f'path = "{table.path}", no such file', f"a URDF in {start}", write)
    return path, packages
