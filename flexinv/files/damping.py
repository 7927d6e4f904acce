"""The table ``[damping]`` of a mechanism file: all beams' damping by a retardation time or by the ratio of one mode."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flexinv.errors import InputError
from flexinv.files.schema import DampingTable
from flexinv.files.toml_tables import complaint, place
from flexinv.model.damping import ModalDamping, with_retardation
from flexinv.model.mechanism import Mechanism


def damped(mechanism: Mechanism, table: DampingTable | None, file: Path) -> Mechanism:
    """Return the mechanism with the damping of its file [s], [-]; a ratio stays data until a mesh is built."""
    if table is None:
        return mechanism
    where = place(file, "damping", "ratio")
    if (table.retardation_s is None) == (table.ratio is None):
        given = "neither" if table.ratio is None else "both"
        raise InputError(complaint(where, given, "one of ratio [-] and retardation_s [s]", "ratio = 0.01"))
    if any(link.beam is not None and link.beam.section.damping is not None for link in mechanism.links):
        given = "[damping] beside retardation_s of a section"
        raise InputError(complaint(place(file, "damping"), given, "one or the other", "no table [damping]"))
    if not mechanism.beams:
        complained = complaint(where, "no link that is a beam", "a beam to damp", "damping of joints in their tables")
        raise InputError(complained)
    if table.ratio is None:
        return with_retardation(mechanism, table.retardation_s or 0.0)
    return replace(mechanism, modal_damping=ModalDamping(table.ratio, table.mode))
