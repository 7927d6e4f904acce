"""Mechanisms as engines get them: read from their files, with what flexinv computes from the data that they state."""

from __future__ import annotations

from pathlib import Path

from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism


def read_mechanism(path: str | Path) -> Mechanism:
    """Return the mechanism of a folder or file; a damping ratio of beams has become their retardation time [s].

    Engines know stresses by rates of strain only, so flexinv computes the time from its own modes, for all of them alike; their
    certificates say so.  Raises InputError as `load_mechanism` does, and for a mode that the mesh does not have.
    """
    mechanism = load_mechanism(path)
    if mechanism.modal_damping is None:
        return mechanism
    from flexinv.linearized.modal_damping import apply_stated_ratio  # loads the compiler

    return apply_stated_ratio(mechanism)


def check_resolved(mechanism: Mechanism) -> None:
    """Raise InputError for beams whose damping ratio [-] has not become a retardation time [s]: an engine would leave it out."""
    if mechanism.modal_damping is not None and mechanism.modal_damping.seconds is None:
        raise InputError(
            f"mechanism '{mechanism.name}': its damping is stated as a ratio of a mode, from which flexinv alone computes "
            "stresses; write crosscheck.measures.mechanisms.read_mechanism(folder) instead of load_mechanism"
        )
