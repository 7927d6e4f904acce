"""The dictionary: all causes, by name."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator

from crosscheck.causes.cause import Cause
from crosscheck.causes.rows import beams as beam_rows
from crosscheck.causes.rows import bodies as body_rows
from crosscheck.causes.rows import conventions as convention_rows
from crosscheck.causes.rows import friction as friction_rows
from crosscheck.causes.rows import geometry as geometry_rows
from crosscheck.causes.rows import joints as joint_rows
from crosscheck.causes.rows import meshes as mesh_rows
from crosscheck.causes.rows import mixups as mixup_rows
from crosscheck.causes.rows import scales as scale_rows
from crosscheck.causes.rows import sections as section_rows
from crosscheck.causes.rows import signals as signal_rows
from crosscheck.causes.rows import springs as spring_rows
from crosscheck.causes.rows import terms as term_rows
from crosscheck.doors.packages import CAUSE_GROUP, EntryPoint, list_entry_points

TABLES = (
    joint_rows,
    friction_rows,
    body_rows,
    mixup_rows,
    convention_rows,
    term_rows,
    scale_rows,
    signal_rows,
    geometry_rows,
    spring_rows,
    beam_rows,
    section_rows,
    mesh_rows,
)
DICTIONARY: dict[str, Cause] = {cause.name: cause for table in TABLES for cause in table.ROWS}


def collect_causes() -> dict[str, Cause]:
    """Return the dictionary and the causes of installed packages (entry points ``crosscheck.causes``), by name."""
    causes = dict(DICTIONARY)
    for point in list_entry_points(CAUSE_GROUP):
        for cause in _list_entry_point_causes(point):
            if cause.name in causes:
                warnings.warn(f"package {point.package}: a cause called {cause.name!r} is there already", stacklevel=2)
            causes.setdefault(cause.name, cause)
    return causes


def _list_entry_point_causes(point: EntryPoint) -> Iterator[Cause]:
    """Yield the causes that an entry point leads to: one, or several; one that fails ends no diagnosis."""
    module, _, name = point.value.partition(":")
    try:
        target = getattr(importlib.import_module(module), name)
        rows = (target,) if isinstance(target, Cause) else tuple(target)
        if not all(isinstance(row, Cause) for row in rows):
            raise TypeError("expected a Cause, or several")
    except Exception as error:
        warnings.warn(f"package {point.package}: no causes at {point.value}: {error}", stacklevel=2)
        return
    yield from rows
