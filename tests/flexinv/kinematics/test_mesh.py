"""Meshes: wherever something is attached along a beam there is a node, and cuts leave the beam what it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import STRIP, clamped

from flexinv.kinematics.mesh import SAME_STATION, build
from flexinv.model.mechanism import Beam, Body, Inertia, Mechanism

# At an interior node of an uncut element and beside it (the cut moves that node); twice the same up to rounding.
STATIONS = [[0.5, 0.3], [0.3, 0.5], [0.3, 3 * 0.1], [0.1, 0.25, 0.5, 0.6, 0.75, 0.9]]


def carrying(stations: list[float], elements: int, order: int) -> Mechanism:
    m = clamped(Beam(0.5, STRIP), elements, order)
    bodies = tuple(Body(f"load {k}", Inertia(0.1), at) for k, at in enumerate(stations))
    return replace(m, links=(replace(m.links[0], bodies=bodies),))


@pytest.mark.parametrize("stations", STATIONS)
@pytest.mark.parametrize(("elements", "order"), [(1, 4), (2, 3), (4, 1)])
def test_bodies_sit_where_they_were_put(stations: list[float], elements: int, order: int) -> None:
    mesh = build(carrying(stations, elements, order))
    for k, station in enumerate(stations):
        index = list(mesh.section_nodes["beam"]).index(mesh.body_node["beam", f"load {k}"])
        assert abs(mesh.section_stations["beam"][index] - station) <= SAME_STATION


@pytest.mark.parametrize("stations", STATIONS)
def test_cuts_keep_mass_and_leave_no_sliver(stations: list[float]) -> None:
    mesh = build(carrying(stations, 1, 4))
    beam = mesh.mechanism.links[0].beam
    assert beam is not None
    mass = 0.5 * STRIP.mass_per_length[0] + 0.1 * len(stations)
    assert mesh.mass.sum() == pytest.approx(mass, rel=1e-14)  # rounding of a sum
    assert np.diff(mesh.section_stations["beam"]).min() > SAME_STATION
