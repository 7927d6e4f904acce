"""All planted faults, and parts that are right, in the order in which they are tried."""

from __future__ import annotations

from campaigns.part_faults import controls, geometry, matrices, statements, texts
from campaigns.part_faults.table import FAULTS, PlantedFault

SOURCES = (geometry, statements, texts, matrices, controls)  # that put their faults into the table as they are imported


def list_faults() -> list[PlantedFault]:
    """Return all planted faults and controls [-]."""
    return list(FAULTS.values())
