"""Python objects as engines: ``door_package:f001_none`` answers as ``door_program.py KIT OUT f001 none`` does."""

from __future__ import annotations

import tempfile
from pathlib import Path

import door_program

from crosscheck.engines.base import sample_times
from crosscheck.kit.write import write
from crosscheck.measures.record import Record, Series

REFINED = ("refined", "restless", *door_program.FALLS)


class Package:
    """An adapter with one planted fault."""

    def __init__(self, fault, bars):
        self.row = door_program.planted(fault)
        self.bars = bars
        self.refines = bars in REFINED

    def version(self):
        return "1"

    def abilities(self):
        return "One machine, with a planted fault."

    def unsupported(self, mechanism, case, engine):
        return None if mechanism.name == self.row["machine"] else "another machine"

    def run(self, mechanism, case, engine, options):
        level = 2 ** int(options.get("refinement", 0)) if self.refines else 1
        with tempfile.TemporaryDirectory() as folder:
            kit = Path(folder) / "kit"
            write(mechanism, case, kit, refinement=level)
            door_program.answer(kit, Path(folder) / "out", self.row, self.bars)
            names, _, values = door_program.read_series(Path(folder) / "out" / "series.csv")
        table = dict(zip(names, values.T, strict=True))
        made = {}
        for head, column in table.items():
            name, _, unit = head.rstrip("]").partition(" [")
            if not name.endswith(" error"):
                bar = table.get(f"{name} error [{unit}]") if options.get("error", True) else None
                made[name] = Series(name, unit, column, bar)
        return Record(engine=engine, time=sample_times(case), series=made)


def __getattr__(name):
    fault, _, bars = name.partition("_")
    if not fault.startswith("f"):
        raise AttributeError(name)
    return Package(fault, bars)
