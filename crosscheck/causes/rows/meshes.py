"""Causes in links that are meshes: moduli, and how interfaces are held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from crosscheck.causes.cause import Cause, Change, check_fraction
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from flexinv.model.mechanism import Link
from flexinv.model.part import MeshedPart, SparseMatrix
from flexinv.typing import Array

RING = "a stop and a rest long enough to ring: stiffness moves the frequency, mass moves the torque before it, too"
OTHER_TIE = {"rigid": "average", "average": "rigid"}


def _make_part_change(change: Callable[[MeshedPart, Array], MeshedPart]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        def update_link(link: Link) -> Link:
            assert link.part is not None
            return replace(link, part=change(replace(link.part, finer=None), size))

        return subject.replace_link(target, update_link)

    return apply_change


def _scale_stiffness(part: MeshedPart, size: Array) -> MeshedPart:
    """Scale the moduli, and with them what damps in proportion."""
    factor = 1.0 + check_fraction(size)
    cells = tuple(
        replace(one, material=replace(one.material, stiffness=factor * one.material.stiffness)) for one in part.cells
    )
    return replace(part, cells=cells, stiffness=_scale_matrix(part.stiffness, factor))


def _scale_matrix(matrix: SparseMatrix | None, factor: float) -> SparseMatrix | None:
    return None if matrix is None else replace(matrix, value=factor * matrix.value)


def _turn_tie(part: MeshedPart, size: Array) -> MeshedPart:
    return replace(part, interfaces=tuple(replace(one, tie=OTHER_TIE[one.tie]) for one in part.interfaces))


def _list_meshes(model: Model) -> list[str]:
    return [link.name for link in model.base.mechanism.meshed]


ROWS = (
    Cause(
        "modulus of a mesh",
        "the moduli of elasticity of {target} are larger by the fraction {size}",
        _make_part_change(_scale_stiffness),
        _list_meshes,
        fraction=True,
        shows=RING,
    ),
    Cause(
        "tie of interfaces",
        "interfaces of {target} are held as averages in place of rigid faces, or the other way round (RBE3, RBE2)",
        _make_part_change(_turn_tie),
        _list_meshes,
        0,
        shows=RING,
    ),
)
