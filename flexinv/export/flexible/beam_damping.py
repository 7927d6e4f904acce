"""Damping of beams that changes while a library marches: the numbers of each beam in the block, times a factor."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexinv.dynamics.section_strains import list_section_points
from flexinv.elements import planar_beam
from flexinv.elements.beam_element import Elements
from flexinv.elements.planar_beam import PlanarElements
from flexinv.export.memory_image import WORD, MemoryImage
from flexinv.kinematics.mesh import Mesh

NumberRange = tuple[int, int]  # offset of a number in the block [bytes], and how many follow one another


def format_damping(image: MemoryImage, mesh: Mesh, elements: Elements | PlanarElements) -> dict[str, str] | None:
    """Return the places of each beam's damping for the template `damping` [-]; None where no beam of the march has any.

    In a plane sections that are coupled have theirs among other numbers: None, too.
    """
    if not elements.damping.size or (isinstance(elements, PlanarElements) and elements.coupling.size):
        return None
    rows = list[str]()
    first = [0]
    for _, span, _, _ in list_section_points(mesh):
        rows += [f"{{{offset}, {count}}}" for offset, count in _list_stretches(image, elements, span.start, span.stop)]
        first.append(len(rows))
    return {"damping_stretches": ", ".join(rows), "first_stretches": ", ".join(map(str, first))}


def _list_stretches(
    image: MemoryImage, elements: Elements | PlanarElements, first: int, last: int
) -> Iterator[NumberRange]:
    """The places of the damping of the elements from ``first`` to before ``last``."""
    if isinstance(elements, PlanarElements):
        yield from _list_planar_places(image, elements, first, last)
        return
    for array in (elements.damping, elements.damping_coupling):
        if array.size:
            yield image.find_place(array[first:last]), int(array[first:last].size)


def _list_planar_places(image: MemoryImage, elements: PlanarElements, first: int, last: int) -> Iterator[NumberRange]:
    """In a plane a block of points at once has all their axial numbers, then those of shear, then those of bending."""
    base = image.find_place(elements.damping)
    points = elements.shape.shape[1]
    lanes = planar_beam.POINTS_AT_ONCE
    for n in range(first * points, last * points):
        at = n // lanes * int(planar_beam.COEFFICIENTS) + n % lanes
        for row in (planar_beam.D_AXIAL, planar_beam.D_SHEAR, planar_beam.D_BENDING):
            yield base + WORD * int(np.uint64(at) + row), 1
