"""A meshed link beside a beam: what both are as a uniform bar between their ends, length, mass, EA, GJ and EI.

    C  (6, 6)   motion of the far end's frame by a load there, the near end held: of a mesh its tip interface against its root
    EA = L / x (C^-1)_ff x        pulled along the line between the ends, the far end neither turned nor moved across
    GJ = L / x C_tt x             turned about it
    EI = L / eigenvalues of C_tt across it, the softer one first; none of them depends on the axes of a link

Both follow from statics alone, so that shear of the beam and vibration modes of the mesh are no part of them.  A mesh is stiffer
by its end faces, which keep their shape: over about its width at each end, so by `END_FACES` times width over length.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from crosscheck.equivalence.beams.rigid_beams import POINTS, evaluate_section_frame
from crosscheck.equivalence.difference import Difference
from flexinv.model.mechanism import Beam, Link
from flexinv.model.part import MeshedPart
from flexinv.parts.reductions import find_reduction
from flexinv.typing import Array

# Times width over length: of full sections, square to 1:2, with Poisson's ratios up to 0.45, rigid end faces add at most 0.27 to
# EA and EI and 0.35 to GJ (tests/crosscheck/equivalence/test_mesh_beams.py).  Walls of thin sections that warp take more.
END_FACES = 0.5
NAMES = {
    "length": ("length", "m"),
    "mass": ("mass", "kg"),
}
STIFFNESS = {
    "axial": ("axial stiffness EA", "N"),
    "torsion": ("torsional stiffness GJ", "N m^2"),
    "softer": ("bending stiffness EI, the softer", "N m^2"),
    "stiffer": ("bending stiffness EI, the stiffer", "N m^2"),
}


@dataclass(frozen=True)
class UniformBar:
    """The uniform bar that a link is between its ends.

    length [m]; mass [kg]; axial : EA [N]; torsion : GJ; softer, stiffer : EI [N m^2]
    width : the largest extent across, 0 where it is not known [m]
    """

    length: float
    mass: float
    axial: float
    torsion: float
    softer: float
    stiffer: float
    width: float = 0.0


def list_mesh_beam_differences(place: str, first: Link, second: Link) -> Iterator[Difference]:
    """Yield each number of a mesh and of a beam beside each other [unit of each], and whether ends of a bar explain it."""
    bars = [compute_uniform_bar(link) for link in (first, second)]
    mesh = bars[0] if first.part is not None else bars[1]
    bound = END_FACES * mesh.width / mesh.length
    for key, (cause, unit) in (NAMES | STIFFNESS).items():
        one, two = (float(getattr(bar, key)) for bar in bars)
        size = abs(two / one - 1.0)
        shown = (f"{one:.9g} {unit}", f"{two:.9g} {unit}")
        hints = _describe_bound(size, bound) if key in STIFFNESS else ()
        words = f"{cause} of mesh and of beam"
        yield Difference("beam", words, place, size, "of it", *shown, hints=hints, structural=True)


def _describe_bound(size: float, bound: float) -> tuple[str, ...]:
    shown = f"{100 * bound:.2g} % ({END_FACES} of width over length), by which rigid end faces stiffen a full section"
    return (f"within {shown}",) if size <= bound else (f"beyond {shown}: another section, material or a coarse mesh",)


def compute_uniform_bar(link: Link) -> UniformBar:
    """Return the uniform bar [m], [kg], [N], [N m^2] that a beam or a mesh is between its ends."""
    return _compute_bar_of_part(link.part) if link.part is not None else _compute_bar_of_beam(link.beam)


def _compute_bar_of_part(part: MeshedPart) -> UniformBar:
    reduced = find_reduction(part)
    ends = [part.interface_of[name].origin for name in (part.root, _find_far_interface(part))]
    number = [one.name for one in part.moved].index(_find_far_interface(part))
    frame = np.vstack([reduced.moves[number], reduced.turns[number]])
    axis = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    across = reduced.points @ _build_across(axis)
    mass = float(reduced.mass.sum())
    width = float(np.ptp(across, axis=0).max())
    return _make_bar((frame / reduced.modal_stiffness) @ frame.T, ends[1] - ends[0], mass, width)


def _find_far_interface(part: MeshedPart) -> str:
    """The tip, or where it is the root itself, the interface farthest from it."""
    if part.tip != part.root:
        return part.tip
    root = part.interface_of[part.root].origin
    return max(part.moved, key=lambda one: float(np.linalg.norm(one.origin - root))).name


def _compute_bar_of_beam(beam: Beam | None) -> UniformBar:
    assert beam is not None
    start, end = (evaluate_section_frame(beam, station).position for station in (0.0, 1.0))
    compliance = np.zeros((6, 6))
    mass = 0.0
    for station, weight in _list_stations(beam):
        frame = evaluate_section_frame(beam, station)
        arm = end - frame.position
        by_load = np.zeros((6, 6))
        by_load[:3, :3] = by_load[3:, 3:] = frame.rotation.T
        by_load[3:, :3] = frame.rotation.T @ np.cross(arm, np.eye(3)).T
        compliance += weight * by_load.T @ np.linalg.solve(_evaluate_stiffness(beam, station), by_load)
        mass += weight * beam.section.evaluate_inertia(station).mass
    return _make_bar(compliance, end - start, mass, 0.0)


def _evaluate_stiffness(beam: Beam, station: float) -> Array:
    """The matrix of a section at a station, (6, 6) [N], [N m], [N m^2]."""
    table = beam.section.stiffness_matrices.reshape(-1, 36).T
    return np.array([np.interp(station, beam.section.stations, entry) for entry in table]).reshape(6, 6)


def _list_stations(beam: Beam) -> Iterator[tuple[float, float]]:
    """Stations [-] and their shares of the length [m], by Gauss points between those at which the section is stated."""
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    bounds = np.union1d(np.linspace(0.0, 1.0, 3), np.clip(beam.section.stations, 0.0, 1.0))
    for low, high in pairwise(bounds):
        for node, weight in zip(nodes, weights, strict=True):
            yield float((low + high) / 2 + (high - low) / 2 * node), float(weight * (high - low) / 2 * beam.length)


def _build_across(axis: Array) -> Array:
    """Two directions across an axis, (3, 2) [-]."""
    return np.asarray(np.linalg.svd(axis[None])[2][1:].T)


def _make_bar(compliance: Array, chord: Array, mass: float, width: float) -> UniformBar:
    length = float(np.linalg.norm(chord))
    axis = chord / length
    across = _build_across(axis)
    turns = compliance[3:, 3:]
    stiffness = np.linalg.inv(compliance)[:3, :3]
    bending = length / np.linalg.eigvalsh(across.T @ turns @ across)
    return UniformBar(
        length, mass, length * float(axis @ stiffness @ axis), length / float(axis @ turns @ axis),
        float(bending.min()), float(bending.max()), width,
    )  # fmt: skip
