"""The dictionary: all causes, by name."""

from __future__ import annotations

from crosscheck.causes.cause import Cause
from crosscheck.causes.rows import beams as beam_rows
from crosscheck.causes.rows import bodies as body_rows
from crosscheck.causes.rows import conventions as convention_rows
from crosscheck.causes.rows import friction as friction_rows
from crosscheck.causes.rows import geometry as geometry_rows
from crosscheck.causes.rows import joints as joint_rows
from crosscheck.causes.rows import mixups as mixup_rows
from crosscheck.causes.rows import scales as scale_rows
from crosscheck.causes.rows import sections as section_rows
from crosscheck.causes.rows import signals as signal_rows
from crosscheck.causes.rows import springs as spring_rows

TABLES = (
    joint_rows,
    friction_rows,
    body_rows,
    mixup_rows,
    convention_rows,
    scale_rows,
    signal_rows,
    geometry_rows,
    spring_rows,
    beam_rows,
    section_rows,
)
DICTIONARY: dict[str, Cause] = {cause.name: cause for table in TABLES for cause in table.ROWS}
