"""Differences of links that are meshes: what no choice of axes, elements or modes changes of the part itself.

    frequencies            of the free part [Hz]; held at the root, where both name one root
    principal stiffness    of every interface that both name, the part held at one root: 1 / eigenvalues of the compliance of its
                           frame, slides [N/m] and turns [N m/rad] by themselves

Both parts take the larger number of modes, twice, so that a basis is no difference.  Their masses are compared as rigid bodies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from crosscheck.equivalence.difference import Difference
from crosscheck.measures.certificate import COMPARED_MODES, MESHED, TIMES_MODES
from flexinv.errors import InputError
from flexinv.model.part import MeshedPart
from flexinv.parts.craig_bampton import Reduction
from flexinv.parts.reductions import find_reduction
from flexinv.typing import Array

# What a part states beside its mesh: what it is called, and its unit.
STATED = {"retardation": ("retardation of mesh", "s"), "drag": ("drag of mesh", "1/s")}


def list_mesh_differences(place: str, first: MeshedPart, second: MeshedPart) -> Iterator[Difference]:
    """Yield the differences of two parts [unit of each]; place : of the link, by A's name."""
    yield from _list_stated_differences(place, first, second)
    modes = TIMES_MODES * max(first.modes, second.modes, 1)
    reduced = [_find_richer_basis(part, modes) for part in (first, second)]
    yield from _list_changed(
        place, "free frequency of mesh", "Hz", *(one.compute_free_frequencies()[:COMPARED_MODES] for one in reduced)
    )
    if first.root != second.root:
        return
    held = [one.frequency[:COMPARED_MODES] for one in reduced]
    yield from _list_changed(place, f"frequency of mesh held at {first.root}", "Hz", *held)
    yield from _list_interface_differences(place, (first, second), reduced)


def _list_stated_differences(place: str, first: MeshedPart, second: MeshedPart) -> Iterator[Difference]:
    """Yield the differences of damping and of geometric stiffening."""
    for name, (what, unit) in STATED.items():
        a, b = (float(getattr(part, name)) for part in (first, second))
        if abs(a - b) > MESHED * max(a, b):
            yield _make_difference(what, place, a, b, unit)
    if first.stiffening != second.stiffening:
        one, two = ("with" if part.stiffening else "without" for part in (first, second))
        yield Difference("beam", "geometric stiffening of mesh", place, 1.0, "-", one, two, structural=True)


def _list_interface_differences(
    place: str, parts: tuple[MeshedPart, MeshedPart], reduced: list[Reduction]
) -> Iterator[Difference]:
    """Yield the differences of the principal stiffness of interfaces that both name."""
    names = [[one.name for one in part.moved] for part in parts]
    for name in (name for name in names[0] if name in names[1]):
        stiffness = [_compute_principal_stiffness(one, k.index(name)) for one, k in zip(reduced, names, strict=True)]
        for what, unit, part in (("stiffness", "N/m", 0), ("turning stiffness", "N m/rad", 1)):
            both = [one[part] for one in stiffness]
            yield from _list_changed(place, f"principal {what} of mesh at {name}", unit, *both)


def _find_richer_basis(part: MeshedPart, modes: int) -> Reduction:
    """The part with so many modes, or with its own where it has no more."""
    try:
        return find_reduction(replace(part, modes=modes, frequency=0.0))
    except InputError:
        return find_reduction(part)


def _compute_principal_stiffness(reduced: Reduction, number: int) -> tuple[Array, Array]:
    """Principal stiffness of the frame of a moved interface, (3,) of slides [N/m] and (3,) of turns [N m/rad], softest first."""
    slides, turns = (
        (moves / reduced.modal_stiffness) @ moves.T for moves in (reduced.moves[number], reduced.turns[number])
    )
    return np.sort(1.0 / np.linalg.eigvalsh(slides)), np.sort(1.0 / np.linalg.eigvalsh(turns))


def _list_changed(place: str, what: str, unit: str, first: Array, second: Array) -> Iterator[Difference]:
    """The number of a list that differs most, if it does."""
    count = min(len(first), len(second))
    apart = np.abs(second[:count] / first[:count] - 1.0)
    if count and apart.max() > MESHED:
        k = int(apart.argmax())
        yield _make_difference(f"{what}, number {k + 1}", place, float(first[k]), float(second[k]), unit)


def _make_difference(what: str, place: str, first: float, second: float, unit: str) -> Difference:
    size = abs(second / first - 1.0) if first else 1.0
    one, two = (f"{value:.9g} {unit}" for value in (first, second))
    return Difference("beam", what, place, size, "of it", one, two, structural=True)
