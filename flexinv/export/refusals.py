"""Refusals of mechanisms that cannot be exported as a C library, before anything is written."""

from __future__ import annotations

from collections.abc import Iterable

from flexinv.errors import InputError
from flexinv.export.acting_sets import format_acting_sets, list_acting_sets
from flexinv.export.machine_code import check_compiler
from flexinv.export.names import LIBRARY_PREFIX, make_words
from flexinv.model.mechanism import Mechanism
from flexinv.rigid.prepare import prepare


def check_exportable(mechanism: Mechanism) -> None:
    """Raise InputError [-] for a mechanism that has no C library: names that are one in C, parts for which there is no kernel."""
    m = mechanism
    _check_any(m, "torques")
    if m.is_rigid:
        captures = [c.name for c in m.closures if c.capture]
        _refuse(
            m,
            "closures that capture frames as they lie",
            captures,
            "of which rigid libraries know nothing; call flexinv.solve",
        )
        for one in list_acting_sets(m):
            _check_loops(one.mechanism)
        return
    check_lasting(m, "a library with beams", "flexinv.solve")
    coupling = [c.name for c in m.closures if c.kind == "coupling"]
    _refuse(
        m,
        "beams and closures that couple joints",
        coupling,
        "for which a single step has no kernel; call flexinv.solve",
    )


def check_movable(mechanism: Mechanism) -> None:
    """Raise InputError [-] for a mechanism that torques do not move in a library: names, phases."""
    _check_any(mechanism, "motion")
    check_lasting(mechanism, "a forward FMU", "flexinv.simulate")


def check_lasting(mechanism: Mechanism, what: str, instead: str) -> None:
    """Raise InputError for closures that act for a while [s]; what : the file that cannot be told; instead : what to call."""
    passing = [c.name for c in mechanism.closures if c.active]
    why = f"and {what} has no call that says which of them act; call {instead}"
    _refuse(mechanism, "closures that act for a while", passing, why)


def _check_any(mechanism: Mechanism, asked: str) -> None:
    """Refuse what no library does: nothing that moves, names that are one in C."""
    m = mechanism
    if m.nv == 0:
        raise InputError(f"export: mechanism {m.name!r} has no joint that moves, and so no {asked}")
    check_compiler()
    make_words("coordinates", m.coordinate_names)
    make_words("rates", m.velocity_names)
    make_words("links", [link.name for link in m.links])
    format_acting_sets(m, LIBRARY_PREFIX)  # whose names are words, too


def _check_loops(mechanism: Mechanism) -> None:
    """Refuse rigid loops whose efforts the kernel leaves to singular values in Python, all of them."""
    if mechanism.closures and not prepare(mechanism, threads=1).plan.sizes:
        names = [closure.name for closure in mechanism.closures]
        why = "whose efforts no fixed order of elimination shares out (too few drives, or another rank from place to place)"
        _refuse(mechanism, "closures", names, f"{why}; call flexinv.prepare(mechanism)")


def _refuse(mechanism: Mechanism, parts: str, names: Iterable[str], why: str) -> None:
    """Raise InputError where a mechanism has ``parts``, by their names; why : and what to call instead."""
    if listed := ", ".join(map(repr, names)):
        raise InputError(
            f"export: mechanism {mechanism.name!r} has {parts} ({listed}), {why} from Python, or export the mechanism without "
            "them"
        )
