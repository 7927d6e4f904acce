"""Findings about what is stated of meshed links: odd materials, interfaces that hold too much, joints off them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from crosscheck.findings.finding import Finding, make_warning
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism
from flexinv.model.part import LINEAR_KINDS, Material, MeshedPart
from flexinv.parts.reductions import find_reduction

# Waves along a rod of diamond run at 18 km/s: nothing is faster.
FASTEST = 2e4
# Full rubber reaches 2,000 kg/m^3; what is heavier is a metal, a glass or a ceramic, none of which is softer than lead (16 GPa).
HEAVY = 2200.0
SOFT = 1e9
# Fully integrated cells lock against changes of volume beyond it.
RUBBER = 0.49
# Part of the nodes that an interface may hold, and part of the extent in all three directions at once.
MOST_NODES = 0.5
# Damping over critical damping of the slowest mode, held at the root: beyond it the link creeps back and never swings.
OVERDAMPED = 1.0


def check_statements(mechanism: Mechanism, name: str, part: MeshedPart) -> Iterator[Finding]:
    """Yield the findings of what is stated of the part of a link."""
    place = f"link {name}"
    for cells in part.cells:
        yield from _check_material(cells.material, f"{place}, material {cells.name}" if cells.name else place)
    yield from _check_interfaces(part, place)
    yield from _check_lumping(part, place)
    yield from _check_damping(part, place)
    for joint in mechanism.joints:
        if joint.parent == name and not joint.interface:
            why = f"the link frame moves with its root {part.root!r}: what hangs there does not feel the mesh"
            write = f'interface = "{part.tip}", if it hangs on the mesh'
            yield make_warning("mesh joint", f"joint {joint.name}", f"no interface of {name}", why, write)


def _check_material(material: Material, place: str) -> Iterator[Finding]:
    """A modulus and a density that no material has together, and a Poisson's ratio at which cells lock."""
    compliance = np.linalg.inv(material.stiffness)
    young = 1.0 / np.diag(compliance)[:3]
    poisson = float((-compliance[[0, 0, 1], [1, 2, 2]] * young[[0, 0, 1]]).max())
    speed = float(np.sqrt(young.max() / material.density))
    given = f"E = {young.max():.4g} Pa with {material.density:.4g} kg/m^3"
    if speed > FASTEST:
        why = f"sound would run at {speed:.3g} m/s along a rod of it, and does at 18,000 in diamond"
        yield make_warning(
            "mesh material", place, given, why, "rho_kg_per_m3 in kg/m^3 (1 g/cm^3 is 1000) and E_Pa in Pa"
        )
    if material.density > HEAVY and young.max() < SOFT:
        why = "nothing as heavy as a metal is as soft as a rubber"
        yield make_warning("mesh material", place, given, why, "E_Pa in Pa: 70 GPa is 70e9")
    if poisson > RUBBER:
        why = "cells lock where a material keeps its volume: the part is too stiff"
        yield make_warning(
            "mesh locks", place, f"nu = {poisson:.6g}", why, "nu = 0.49 or less, and see how much it matters"
        )


def _check_interfaces(part: MeshedPart, place: str) -> Iterator[Finding]:
    """Interfaces that hold most of the part, or nodes all over it: nothing deforms between them."""
    used = (
        np.unique(np.concatenate([cells.nodes.ravel() for cells in part.cells]))
        if part.cells
        else np.arange(len(part.points))
    )
    extent = np.ptp(part.points[used], axis=0)
    for one in part.interfaces:
        over = np.ptp(part.points[one.nodes], axis=0)
        share = len(one.nodes) / len(used)
        if share > MOST_NODES or (over > MOST_NODES * extent).all():
            given = f"interface {one.name!r} holds {100 * share:.2g} % of the nodes, over {over.round(6).tolist()} m"
            why = "it takes the part whole, and what it holds does not deform"
            write = "a smaller tolerance_m, or a set, plane or cylinder of one end"
            yield make_warning("mesh interface", place, given, why, write)


def _check_lumping(part: MeshedPart, place: str) -> Iterator[Finding]:
    kinds = sorted({cells.kind for cells in part.cells} - set(LINEAR_KINDS))
    if part.lumped and kinds:
        why = "their mass stays consistent: that of linear cells alone is lumped"
        yield make_warning("mesh mass", place, f"lumped = true with {', '.join(kinds)}", why, "lumped = false")


def _check_damping(part: MeshedPart, place: str) -> Iterator[Finding]:
    """A damping by which the slowest mode does not swing."""
    if not (part.retardation or part.drag):
        return
    try:
        slowest = 2.0 * np.pi * float(find_reduction(part).frequency[0])
    except InputError:
        return  # which says itself what is wrong
    ratio = (part.retardation * slowest + part.drag / slowest) / 2.0
    if ratio > OVERDAMPED:
        given = f"{ratio:.3g} of critical damping at {slowest / (2 * np.pi):.4g} Hz"
        why = "the link would creep in place of swinging"
        write = f"retardation_s = {0.02 / slowest:.2g} for 1 %"
        yield make_warning("mesh damping", place, given, why, write)
