"""What meshed links feel: stress of a bent bar, wrenches at interfaces, tables, and the net of the moving picture."""

from __future__ import annotations

import re

import numpy as np
import pytest
from part_examples import ALUMINIUM, make_bar, make_block, make_part

import flexinv
from flexinv.analysis.solution import Solution
from flexinv.display.animation import LEVEL_COLOURS
from flexinv.errors import InputError
from flexinv.inverse.part_results import build_part_stress
from flexinv.model.mechanism import Attachment, Body, Force, Inertia, Joint, Link, Mechanism
from flexinv.parts.surface_net import build_surface_net, list_surface_edges

Y = np.array([0.0, 1.0, 0.0])
LENGTH = 0.8
SIDE = 0.02


def make_loaded_bar(load: float) -> Mechanism:
    """A bar along x whose tip is pushed up [N]."""
    link = Link("bar", part=make_bar(count=(20, 2, 2), modes=4))
    push = Force("push", Attachment("bar", interface="tip"), np.array([[0, 0, load, 0, 0, 0]]))
    joint = Joint("hub", "revolute", "world", "bar", axis=Y)
    return Mechanism("loaded", (link,), (joint,), np.zeros(3), forces=(push,))


@pytest.fixture(scope="module")
def moving() -> Solution:
    """Two meshed links one behind the other, a load at the end."""
    load = Body("load", Inertia(0.3, np.array([0.0, 0.01, 0.02]), 1e-4 * np.eye(3)), interface="tip")
    links = (
        Link("a", part=make_bar(count=(5, 1, 1), modes=4)),
        Link("b", (load,), part=make_bar(count=(5, 1, 1), length=0.5, modes=4)),
    )
    joints = (Joint("hub", "revolute", "world", "a"), Joint("elbow", "revolute", "a", "b", axis=Y, interface="tip"))
    motion = flexinv.Motion.point_to_point({"hub": 0.0, "elbow": 0.0}, {"hub": 1.0, "elbow": -1.2}, duration=0.3)
    return flexinv.solve(Mechanism("two", links, joints), motion, step=2e-3, initial="static")


def test_a_bent_bar_has_the_stress_of_its_bending_moment() -> None:
    """sigma = M h / (2 I) half way, where ends are far: what differs is rounding, as a 20-node brick bends exactly there."""
    load = 5.0
    stress = flexinv.statics(make_loaded_bar(load)).stress["bar"]
    half = np.abs(stress.points - [LENGTH / 2, 0.0, SIDE / 2]) < 1e-9
    node = int(np.flatnonzero(half.all(axis=1))[0])
    bending = load * LENGTH / 2 * (SIDE / 2) / (SIDE**4 / 12)
    assert stress.compute()[0, node] == pytest.approx(bending, rel=1e-3)  # 1e-4 is the turn of the load's arm
    assert stress.place[0, 0] < 0.1 * LENGTH  # and the largest is near the root
    assert stress.largest[0] > 1.8 * bending


def test_chosen_samples_have_the_stress_of_all(moving: Solution) -> None:
    stress = moving.stress["a"]
    whole = stress.compute()
    assert whole.shape == (len(moving.time), len(stress.points))
    assert (stress.compute([3, -1]) == whole[[3, -1]]).all()
    assert (stress.largest == whole.max(axis=1)).all()
    assert (whole[np.arange(len(whole)), stress.node] == stress.largest).all()
    with pytest.raises(InputError, match="samples"):
        stress.compute(len(moving.time))


def test_links_without_a_mesh_have_no_stress(moving: Solution) -> None:
    with pytest.raises(InputError, match="link 'c' has no mesh; those with one: a, b"):
        build_part_stress(moving.mesh, moving.nodes, "c")


def test_interfaces_give_what_joints_and_payloads_take(moving: Solution) -> None:
    """At the elbow the interface gives the joint's force; at the tip it gives what moves the load, m (a - g) at its centre."""
    given = moving.interface_wrench[("a", "tip")]
    taken = moving.wrench["elbow"]
    for part in (slice(0, 3), slice(3, 6)):
        sizes = [np.linalg.norm(wrench[:, part], axis=1) for wrench in (given, taken)]
        assert np.abs(sizes[0] - sizes[1]).max() < 1e-12 * sizes[1].max()  # the same at one place, along other axes
    node = moving.mesh.interface_node[("b", "tip")]
    load = moving.mesh.body_node[("b", "load")]
    force = 0.3 * (moving.nodes.a[:, load] - moving.mechanism.gravity)
    at_tip = np.einsum("sji,sj->si", moving.nodes.rotation[:, node], force)
    assert np.abs(moving.interface_wrench[("b", "tip")][:, :3] - at_tip).max() < 1e-12 * np.abs(force).max()


def test_tables_have_stress_and_wrenches_with_units(moving: Solution) -> None:
    table = moving.frame()
    assert (table["largest stress a [Pa]"] == moving.stress["a"].largest).all()
    assert (table["mz b tip [N m]"] == moving.interface_wrench[("b", "tip")][:, 5]).all()


@pytest.mark.parametrize("kind", ["tetra", "tetra10", "hexahedron", "hexahedron20", "wedge"])
def test_edges_of_the_surface_are_those_of_outer_faces(kind: str) -> None:
    """A closed surface of f faces with e edges and v corners has v - e + f = 2; of triangles 3 f = 2 e, of squares 4 f = 2 e."""
    part = make_part(*make_block(kind, (0.3, 0.2, 0.1), (3, 2, 2)), kind, ALUMINIUM)
    edges = list_surface_edges(part)
    corners = len(np.unique(edges))
    squares = 2 * (3 * 2 + 3 * 2 + 2 * 2)
    faces = {"tetra": 2 * squares, "tetra10": 2 * squares, "wedge": squares + 2 * 3 * 2}.get(kind, squares)
    assert corners - len(edges) + faces == 2
    low, high = part.points.min(axis=0), part.points.max(axis=0)
    on_wall = (np.abs(part.points[edges] - low) < 1e-9) | (np.abs(part.points[edges] - high) < 1e-9)
    assert on_wall.any(axis=2).all()


def test_a_net_has_few_knots_and_is_one_piece() -> None:
    part = make_bar(count=(20, 2, 2))
    net = build_surface_net(part, 30)
    assert 10 <= len(net.knots) <= 30
    reached = {0}
    for _ in net.knots:
        reached |= {int(k) for edge in net.edges for k in edge if reached & {int(one) for one in edge}}
    assert reached == set(range(len(net.knots)))


def test_the_moving_picture_shows_stress_in_colours(moving: Solution) -> None:
    """Least and largest levels are there, edges jump from one colour to another, and the words say what red is."""
    picture = moving.animate(seconds=3.0)
    for colour in (LEVEL_COLOURS[0], LEVEL_COLOURS[-1]):
        assert f'stroke="{colour}" stroke-width' in picture.svg
    assert 'calcMode="discrete"' in picture.svg
    peak = max(stress.largest.max() for stress in moving.stress.values())
    said = re.search(r"von Mises stress, 0 to (\S+) Pa", picture.words)
    assert said is not None
    assert float(said[1]) == pytest.approx(peak, rel=1e-3)  # as it is written
