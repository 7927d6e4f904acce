"""Statics against exact and published solutions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from bending_four_bar import bending, rigid_twin
from flexible_examples import clamped, uniform
from four_bar_example import START

import flexinv
from flexinv import Load
from flexinv.model.mechanism import Attachment, Body, Force, Inertia, Joint, Link, Mechanism, Placement, Spring

DATA = Path(__file__).resolve().parents[2] / "data"
REISSNER = pd.read_csv(DATA / "reissner_statics.csv", comment="#")
ELASTICA = pd.read_csv(DATA / "elastica_tip_load.csv", comment="#").to_numpy().tolist()
# 45 degree bend of radius 100 (Bathe, Bolourchi 1979) in three readings of its section, and its out-of-plane tip load.
SHEAR_AND_TWIST = {"beamdyn/kynema": (5e6 * 5 / 6, 1e7 / 12), "gxbeam": (5e6, 1e7 / 12), "simo/exudyn": (5e6, 7.05e5)}
BEND = REISSNER[REISSNER.case == "bend45"][["stiffness", "P", "x", "y", "z"]].to_numpy().tolist()
# Princeton beam (Dowell, Traybar): tip weight at angle beta to the strong axis.
PRINCETON = REISSNER[REISSNER.case == "princeton"][["P", "beta_deg", "ux", "uy", "uz"]].to_numpy().tolist()

# A moment about an axis that stays, and a push that turns along, are no loads with a potential: these slender beams flutter.
FLUTTERS = pytest.mark.filterwarnings("ignore:.*complex. flutter:flexinv.ModelWarning")


@pytest.mark.parametrize(("alpha", "w", "u", "angle"), ELASTICA)
def test_elastica(alpha: float, w: float, u: float, angle: float) -> None:
    rod = uniform(1.0, 1e9, 1e9, 1.0, (1.0, 1.0))  # EA and GA so large that they bend the table by 1e-9
    s = flexinv.statics(clamped(rod, 2, 10), [Load("beam", force=[0, alpha, 0])])
    x, y, _ = s.deflection["beam"][0]
    assert y == pytest.approx(w, abs=1e-6)
    assert -x == pytest.approx(u, abs=1e-6)
    turn = s.nodes.rotation[0, s.mesh.tip_node["beam"]]
    assert np.arctan2(turn[1, 0], turn[0, 0]) == pytest.approx(angle, abs=1e-6)
    assert s.wrench["root"][0, 5] == pytest.approx(-alpha * (1 + x), rel=1e-9)  # the support's moment: P times the arm


@pytest.mark.parametrize(("section", "load", "x", "y", "z"), BEND)
def test_45_degree_bend(section: str, load: float, x: float, y: float, z: float) -> None:
    ga, gj = SHEAR_AND_TWIST[section.split(":")[0]]
    arc = uniform(100 * np.pi / 4, 1e7, ga, gj, (1e7 / 12, 1e7 / 12), curvature=np.array([0.0, 0.0, 0.01]))
    s = flexinv.statics(clamped(arc, 2, 6), [Load("beam", force=[0, 0, load])])
    displacement = np.linalg.norm(s.deflection["beam"][0])
    assert np.linalg.norm(s.tip["beam"][0] - [x, y, z]) < 1e-5 * displacement  # the bound; 4e-7 is reached


@pytest.mark.parametrize(("load", "beta", "ux", "uy", "uz"), PRINCETON)
def test_princeton_beam(load: float, beta: float, ux: float, uy: float, uz: float) -> None:
    height, width, e, nu = 0.0123777, 0.0032024, 71.7e9, 0.31
    g, area = e / (2 * (1 + nu)), height * width
    weak, strong = height * width**3 / 12, width * height**3 / 12  # bending in z (about y), in y (about z)
    beam = uniform(0.508, e * area, g * area, 0.198 * g * (weak + strong), (e * weak, e * strong))
    angle = np.radians(beta)
    s = flexinv.statics(
        clamped(beam, 2, 8), [Load("beam", force=load * np.array([0.0, -np.cos(angle), np.sin(angle)]))]
    )
    expected = np.array([ux, uy, uz])
    assert np.linalg.norm(s.deflection["beam"][0] - expected) < 1e-5 * np.linalg.norm(expected)


def test_geradin_cardona_cantilever() -> None:
    """L = 5, tip force 600 kN: tip by the same shooting; published -2.159 and 0.596 (Simpson, Palacios 2013)."""
    beam = uniform(5.0, 4.8e8, 3.231e8, 1e6, (9.346e6, 9.346e6))
    s = flexinv.statics(clamped(beam, 2, 8), [Load("beam", force=[0, 0, -6e5])])
    assert s.deflection["beam"][0] == pytest.approx([-0.59647127224, 0, -2.1596938945], abs=1e-5 * 2.16)


@FLUTTERS
def test_end_moment_rolls_the_beam_into_a_circle() -> None:
    beam = uniform(10.0, 1e6, 1e6, 100.0, (100.0, 100.0))
    s = flexinv.statics(clamped(beam, 4, 6), [Load("beam", moment=[0, 0, 2 * np.pi * 100.0 / 10.0])])
    assert np.linalg.norm(s.tip["beam"][0]) < 1e-5  # the tip is back at the root; 1e-6 of the length is mesh error


@FLUTTERS
def test_follower_and_dead_load_differ_as_they_must() -> None:
    """A follower force keeps its angle to the tip: the root moment is what the lever and the turned force say."""
    beam = uniform(1.0, 1e7, 1e7, 1.0, (1.0, 1.0))
    dead = flexinv.statics(clamped(beam, 2, 8), [Load("beam", force=[0, 2.0, 0])])
    turning = flexinv.statics(clamped(beam, 2, 8), [Load("beam", force=[0, 2.0, 0], follower=True)])
    turn = turning.nodes.rotation[0, turning.mesh.tip_node["beam"]]
    lever = np.cross(turning.tip["beam"][0], turn @ [0, 2.0, 0])
    assert turning.wrench["root"][0, 3:] == pytest.approx(-lever, abs=1e-8)  # rounding of EA = 1e7 times ulp
    assert abs(turning.tip["beam"][0] - dead.tip["beam"][0]).max() > 0.01


def test_load_between_nodes_acts_where_it_is_said() -> None:
    """Linear theory: a small load P at a = 0.37 L deflects the tip by P a^2 (3 L - a) / 6 EI (+ shear P a / GA)."""
    a, p = 0.37, 1e-4
    s = flexinv.statics(
        clamped(uniform(1.0, 1e6, 1e6, 1.0, (1.0, 1.0)), 1, 6), [Load("beam", force=[0, p, 0], station=a)]
    )
    expected = p * a**2 * (3 - a) / 6 + p * a / 1e6
    assert s.deflection["beam"][0, 1] == pytest.approx(expected, rel=1e-6)  # linear theory misses terms of 1e-9


@pytest.mark.parametrize(
    ("load", "words"),
    [
        ({"link": "bean"}, "no link 'bean'.*beam"),
        ({"link": "beam", "force": [0, np.nan, 0]}, r"force\[1\] = nan: expected a finite number \[N\]"),
        ({"link": "beam", "station": 1.2}, r"station = 1.2.*0 to 1"),
    ],
)
def test_bad_loads_are_explained(load: dict[str, Any], words: str) -> None:
    with pytest.raises(flexinv.InputError, match=words):
        flexinv.statics(clamped(uniform(1.0, 1e6, 1e6, 1.0, (1.0, 1.0)), 1, 4), [Load(**load)])


@FLUTTERS
def test_forces_of_the_mechanism_act_as_loads_do() -> None:
    m = clamped(uniform(1.0, 1e6, 1e6, 1.0, (1.0, 1.0)), 1, 4)
    at = Attachment("beam", Placement(np.array([0.1, 0.2, 0.0])), 0.7)
    wrench = np.array([[0.1, 0.2, -0.3, 0.05, 0.0, 0.1]])
    for follower in (False, True):
        pushed = flexinv.statics(replace(m, forces=(Force("wind", at, wrench, follower=follower),)))
        load = Load("beam", wrench[0, :3], wrench[0, 3:], 0.7, at.placement.position, follower)
        loaded = flexinv.statics(m, [load])
        assert np.ptp(loaded.deflection["beam"]) > 0.01
        np.testing.assert_array_equal(pushed.tip["beam"], loaded.tip["beam"])


def test_a_spring_shares_the_load_with_the_beam() -> None:
    """Tip under F and a transverse spring: k_beam = 1 / (L^3 / 3 EI + L / GA) and k side by side (small deflection)."""
    m = clamped(uniform(1.0, 1e4, 1e4, 1.0, (1.0, 1.0)), 1, 4)
    post = Attachment("world", Placement(np.array([1.0, 5.0, 0.0])))
    spring = Spring("post", post, Attachment("beam", station=1.0), 4.0, 5.0)
    s = flexinv.statics(replace(m, springs=(spring,)), [Load("beam", [0, 1e-5, 0])])
    # the deflection of 1.4e-6 changes lengths by its square
    assert s.deflection["beam"][0, 1] == pytest.approx(1e-5 / (1 / (1 / 3 + 1e-4) + 4.0), rel=1e-8)
    assert abs(s.balance.momentum).max() < 1e-11  # rounding of lengths of 1 m in EA
    assert s.iterations.max() <= 4  # the spring's exact slope: quadratic


def test_a_loop_at_rest_is_the_loop_that_stays() -> None:
    """`statics` with closures against the march that starts at rest; the drive's torque is that of virtual work when rigid."""
    m = bending()
    stay = flexinv.Motion.point_to_point({"A": 0.3}, {"A": 0.3}, 0.01)
    marched = flexinv.solve(m, stay, step=1e-3, start=START, initial="static")
    q = np.array([0.3, START["B"], START["D"]])
    s = flexinv.statics(m, q=q)
    # Newton's last increment of 1e-8 at rest, in the bending stiffness
    assert s.torque[0] == pytest.approx(marched.torque[0], rel=1e-6)
    assert s.unactuated == pytest.approx(np.zeros((1, 2)), abs=1e-7)
    rigid = rigid_twin()
    held = flexinv.statics(rigid, q=q)
    moving = flexinv.solve(rigid, stay, step=1e-3, start=START)
    assert held.torque[0] == pytest.approx(moving.torque[0], rel=1e-12)
    loaded = flexinv.statics(rigid, [Load("coupler", force=[0, -3.0, 0], point=[0.25, 0, 0])], q=q)
    lift = (_height(rigid, 0.3 + 1e-5) - _height(rigid, 0.3 - 1e-5)) / 2e-5
    assert loaded.torque[0, 0] - held.torque[0, 0] == pytest.approx(3.0 * lift, rel=1e-8)  # central difference


def _height(m: Mechanism, angle: float) -> float:
    """Height of the middle of the coupler at a crank angle [m]."""
    s = flexinv.statics(m, q=np.array([angle, START["B"], START["D"]]))
    node = s.mesh.joint_node["B"]
    return float((s.nodes.x[0, node] + s.nodes.rotation[0, node] @ np.array([0.25, 0, 0]))[1])


@pytest.mark.parametrize(("part", "stable"), [(0.5, True), (0.999, True), (1.001, False), (3.0, False)])
def test_a_column_says_whether_it_would_stay(part: float, stable: bool) -> None:
    """Euler: (pi/2)^2 EI / L^2; straight it is in equilibrium under any load, but beyond that one it does not stay so."""
    rod = uniform(1.0, 1e6, 1e6, 1.0, (1.0, 1.0))  # what EA and GA give way is 2.5e-6 of the load
    press = [Load("beam", force=[-part * np.pi**2 / 4, 0, 0])]
    if stable:
        assert flexinv.statics(clamped(rod, 2, 8), press).stable is True
        return
    with pytest.warns(
        flexinv.ModelWarning,
        match=r"this equilibrium is unstable, .* 2 unstable eigenvalues .*divergence.* buckling load",
    ):
        s = flexinv.statics(clamped(rod, 2, 8), press)
    assert s.stable is False
    assert abs(s.deflection["beam"][0, 1:]).max() < 1e-12
    assert "unstable" in s.notes[-1]


def test_the_bent_column_stays() -> None:
    """A hundredth beyond the buckling load, and a small load across: it bends by a fifth of its length, and stays so."""
    rod = uniform(1.0, 1e6, 1e6, 1.0, (1.0, 1.0))
    s = flexinv.statics(clamped(rod, 2, 8), [Load("beam", force=[-1.01 * np.pi**2 / 4, 2.5e-3, 0])])
    assert s.stable is True
    assert s.deflection["beam"][0, 1] > 0.2


def test_the_root_is_named_and_is_not_the_first_point() -> None:
    """A force across at the tip: the moment falls to zero along the beam, and only the root has all of it."""
    rod = uniform(2.0, 1e6, 1e6, 100.0, (100.0, 100.0))
    s = flexinv.statics(clamped(rod, 2, 4), [Load("beam", force=[3.0, 1e-3, 0.0])])
    root = s.root["beam"][0]
    assert root[[0, 1]] == pytest.approx([3.0, 1e-3], rel=1e-6)
    assert root == pytest.approx(-s.wrench["root"][0], rel=1e-9, abs=1e-12)  # rounding of EA is 1e-10 N
    assert s.internal_stations["beam"][0] > 0.03
    assert abs(s.internal["beam"][0, 0, 5]) < 0.97 * root[5]
    table = s.internal_frame()
    assert table["bending_z beam at root [N m]"].iloc[0] == root[5]
    assert table["axial beam at 0.034716 [N]"].iloc[0] == s.internal["beam"][0, 0, 0]


def test_a_spring_holds_a_rigid_link_on_both_sides_of_the_balance() -> None:
    """The wrench of the joint, from the elastic side, and the efforts know what the spring does."""
    rod = Link("rod", (Body("rod", Inertia(1.0, np.array([0.2, 0.0, 0.0]), np.diag([1e-4, 0.02, 0.02]))),))
    pull = Spring(
        "pull",
        Attachment("world", Placement(np.array([0.1, 0.7, 0.0]))),
        Attachment("rod", Placement(np.array([0.4, 0.0, 0.0]))),
        40.0,
        0.3,
    )
    hold = Joint("hold", "revolute", "world", "rod", Placement(np.array([0.3, 0.0, 0.0])))
    s = flexinv.statics(Mechanism("held", (rod,), (hold,), springs=(pull,)), q=np.array([0.4]))
    assert abs(s.momentum_residual).max() < 1e-12 * abs(s.wrench["hold"]).max()
    np.testing.assert_allclose(s.reaction, s.torque_all, rtol=0, atol=1e-12)
