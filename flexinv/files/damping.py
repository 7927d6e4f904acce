"""The table ``[damping]`` of a mechanism file: all beams' damping by a retardation time or by the ratio of one mode."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flexinv.errors import InputError
from flexinv.files.schema import DampingTable
from flexinv.files.toml_tables import complaint, place
from flexinv.model.mechanism import Mechanism

# So many modes are named in the note that says what a ratio at one of them makes of the others.
NAMED = 4


def damped(mechanism: Mechanism, table: DampingTable | None, file: Path) -> Mechanism:
    """Return the mechanism with the damping of its file [s], [-], and a note of what follows from a ratio."""
    if table is None:
        return mechanism
    from flexinv.linearized.damping_ratio import with_ratio, with_retardation

    where = place(file, "damping", "ratio")
    if (table.retardation_s is None) == (table.ratio is None):
        given = "neither" if table.ratio is None else "both"
        raise InputError(complaint(where, given, "one of ratio [-] and retardation_s [s]", "ratio = 0.01"))
    if any(link.beam is not None and link.beam.section.damping is not None for link in mechanism.links):
        given = "[damping] beside retardation_s of a section"
        raise InputError(complaint(place(file, "damping"), given, "one or the other", "no table [damping]"))
    try:
        if table.ratio is None:
            return with_retardation(mechanism, table.retardation_s or 0.0)
        made, seconds, found = with_ratio(mechanism, table.ratio, table.mode)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    ratios = ", ".join(
        f"{k} at {frequency:.4g} Hz {ratio:.3g}"
        for k, (frequency, ratio) in enumerate(zip(found.frequency[:NAMED], found.ratio[:NAMED], strict=True), 1)
    )
    stated = f"retardation time {seconds:.5g} s from ratio {table.ratio:g} at mode {table.mode}"
    note = f"damping of beams: {stated}; ratios of modes: {ratios}"
    return replace(made, notes=(*made.notes, note))
