"""The models with loops against closed forms: coordinates as explicit functions of the drives, torques as virtual work.

With q = c(x) of the drives x, J = dc/dx:   qd = J xd,   qdd = J xdd + (xd^T d2c/dx2 xd),   tau = J^T tau_tree

tau_tree are the joint torques of the tree that the closures have been taken away from: no closure equation is used here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import sympy as sp
from scipy.spatial.transform import Rotation

import flexinv
from flexinv.constraints.continuation import compute_mobility
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

MODELS = Path(__file__).resolve().parents[3] / "models"


@cache
def solved(name: str, case: str) -> tuple[Mechanism, Case, flexinv.Solution]:
    mechanism = flexinv.load_mechanism(MODELS / name)
    chosen = load_cases(MODELS / name, mechanism)[case]
    return mechanism, chosen, run(mechanism, chosen)


def run(mechanism: Mechanism, case: Case) -> flexinv.Solution:
    return flexinv.solve(mechanism, case.motion, step=case.step, end=case.end, start=case.start)


# ---------------------------------------------------------------------------------------------- closed forms


def four_bar(side: int) -> Callable[..., dict[str, sp.Expr]]:
    """C is 0.5 from B and 0.4 from D; ``side`` picks one of the two circles' intersections."""

    def form(a: sp.Symbol) -> dict[str, sp.Expr]:
        bx, by = sp.cos(a) / 5, sp.sin(a) / 5
        ex, ey = bx - sp.Rational(9, 20), by
        square = ex**2 + ey**2
        cosine = (sp.Rational(16, 100) + square - sp.Rational(25, 100)) / (sp.Rational(8, 10) * sp.sqrt(square))
        d = sp.pi + sp.atan(ey / ex) - side * sp.acos(cosine)  # ex < 0
        cx, cy = sp.Rational(9, 20) + sp.Rational(2, 5) * sp.cos(d), sp.Rational(2, 5) * sp.sin(d)
        return {"A": a, "B": sp.atan2(cy - by, cx - bx) - a, "D": d}

    return form


def slider_crank(a: sp.Symbol) -> dict[str, sp.Expr]:
    rod = -sp.asin(sp.sin(a) / 3)
    return {"main": a, "crank_pin": rod - a, "slide": sp.cos(a) / 10 + sp.Rational(3, 10) * sp.cos(rod)}


def bricard(a: sp.Symbol) -> dict[str, sp.Expr]:
    b = sp.acos(1 / (1 + sp.cos(a)) - 1)
    return {"hinge1": a, "hinge2": b, "hinge3": a, "hinge4": b, "hinge5": a}


def five_bar(a: sp.Symbol, b: sp.Symbol) -> dict[str, sp.Expr]:
    """The tool is 0.4 from both elbows, above the line between them."""
    p, r = sp.Rational(1, 4), sp.Rational(2, 5)
    matrix = sp.Matrix([p * sp.cos(a), p * sp.sin(a)])
    right = sp.Matrix([sp.Rational(3, 10) + p * sp.cos(b), p * sp.sin(b)])
    gap = right - matrix
    square = gap.dot(gap)
    tool = (matrix + right) / 2 + sp.sqrt(r**2 / square - sp.Rational(1, 4)) * sp.Matrix([-gap[1], gap[0]])
    elbows = {"left_elbow": tool - matrix, "right_elbow": tool - right}
    angle = {name: sp.atan2(arm[1], arm[0]) for name, arm in elbows.items()}
    return {"left": a, "left_elbow": angle["left_elbow"] - a, "right": b, "right_elbow": angle["right_elbow"] - b}


@dataclass(frozen=True)
class KnownMotion:
    """Closed-form motion and virtual work: q, qd, qdd (samples, nv), work (samples, drives), J (samples, nv, drives)."""

    q: Array
    qd: Array
    qdd: Array
    work: Array
    jacobian: Array


def known(
    mechanism: Mechanism, drives: Sequence[str], form: Callable[..., dict[str, sp.Expr]], s: flexinv.Solution
) -> KnownMotion:
    symbols = sp.symbols(f"x:{len(drives)}")
    table = form(*symbols)
    c = sp.Matrix([table[name] for name in mechanism.velocity_names])
    first = c.jacobian(symbols)
    second = [first.diff(x) for x in symbols]
    evaluate = sp.lambdify(symbols, [c, first, *second], cse=True)
    columns = [mechanism.velocity_names.index(name) for name in drives]
    q, j, *h = (np.array(part) for part in zip(*(evaluate(*x) for x in s.q[:, columns]), strict=True))
    qd = np.einsum("sik,sk->si", j, s.qd[:, columns])
    bend = sum(
        np.einsum("sik,sk->si", part, s.qd[:, columns]) * s.qd[:, [k]] for part, k in zip(h, columns, strict=True)
    )
    qdd = np.einsum("sik,sk->si", j, s.qdd[:, columns]) + bend
    tree = flexinv.joint_torques(replace(mechanism, closures=()), q[:, :, 0], qd, qdd)
    return KnownMotion(q[:, :, 0], qd, qdd, np.einsum("sik,si->sk", j, tree), j)


PLANAR = {
    "four_bar, turn": (["A"], four_bar(1)),
    "four_bar, crossed": (["A"], four_bar(-1)),
    "slider_crank, turns": (["main"], slider_crank),
    "five_bar, reach": (["left", "right"], five_bar),
    "bricard, fold": (["hinge1"], bricard),
}


@pytest.mark.parametrize("which", PLANAR)
def test_motion_and_torque_have_their_closed_form(which: str) -> None:
    name, case = which.split(", ")
    mechanism, _, s = solved(name, case)
    drives, form = PLANAR[which]
    exact = known(mechanism, drives, form, s)
    turns = (s.q - exact.q + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turns).max() < 1e-12  # both closed to rounding; conditions up to 10
    for ours, theirs in ((s.qd, exact.qd), (s.qdd, exact.qdd), (s.torque, exact.work)):
        assert np.abs(ours - theirs).max() < 1e-11 * np.abs(theirs).max()  # rounding times condition, squared in qdd


def test_a_wrong_length_is_seen() -> None:
    """The comparison can fail: the closed form of another linkage is far from this one."""
    mechanism, _, s = solved("four_bar", "turn")
    longer = replace(s, q=s.q + np.array([1e-3, 0.0, 0.0]))
    exact = known(mechanism, ["A"], four_bar(1), longer)
    assert np.abs(s.torque - exact.work).max() > 1e-4 * np.abs(s.torque).max()


def test_three_drives_share_as_scipy_says() -> None:
    """J_a^T tau_a = J^T tau_tree, two equations for three drives: scipy's least squares takes the least norm."""
    mechanism, _, s = solved("five_bar_redundant", "reach")
    exact = known(mechanism, ["left", "right"], five_bar, s)
    assert s.loops is not None
    for k in range(len(s.time)):
        authority = exact.jacobian[k][mechanism.actuated].T  # (2, 3)
        least = scipy.linalg.lstsq(authority, exact.work[k])[0]
        assert np.abs(s.torque[k] - least).max() < 1e-11 * np.abs(s.torque).max()  # rounding times condition
        space = scipy.linalg.null_space(authority)
        ours = s.loops.preload[k][mechanism.actuated]
        assert ours.shape == space.shape == (3, 1)
        assert abs(space.T @ ours).item() == pytest.approx(1.0, abs=1e-12)  # the same line
        assert np.abs(s.loops.preload[k][~mechanism.actuated]).max() == 0.0


def test_preload_moves_nothing_and_two_drives_are_the_same_motion() -> None:
    """The redundant drives do the work of the two of five_bar, and least norm needs less effort."""
    _, _, two = solved("five_bar", "reach")
    _, _, three = solved("five_bar_redundant", "reach")
    drives = three.mechanism.actuated
    power = [np.einsum("si,si->s", s.torque, s.qd[:, s.mechanism.actuated]) for s in (two, three)]
    assert np.abs(power[0] - power[1]).max() < 1e-12 * np.abs(power[0]).max()
    assert np.all(np.linalg.norm(three.torque, axis=1) <= np.linalg.norm(two.torque, axis=1) * (1 + 1e-12))
    assert three.loops is not None
    idle = np.einsum("sik,si->sk", three.loops.preload[:, drives], three.qd[:, drives])
    assert np.abs(idle).max() < 1e-12 * np.abs(three.qd).max()  # a preload has no power, whatever the motion


def feet_and_balls(mechanism: Mechanism) -> tuple[Array, Array]:
    feet = np.array([mechanism.joint_of[f"foot{k}"].placement.position for k in range(1, 7)])
    return feet, np.array([c.second.placement.position for c in mechanism.closures])


def pose(s: flexinv.Solution) -> tuple[Array, Array]:
    """Position (samples, 3) and rotation (samples, 3, 3) of the plate."""
    q = s.q[:, s.mechanism.q_slices["plate"]]
    return q[:, :3], Rotation.from_quat(q[:, 3:]).as_matrix()


def test_stewart_legs_are_as_long_as_the_pose_says() -> None:
    mechanism, _, s = solved("stewart_platform", "swoop")
    feet, balls = feet_and_balls(mechanism)
    p, r = pose(s)
    reach = p[:, None] + np.einsum("sij,kj->ski", r, balls) - feet
    legs = [mechanism.q_slices[f"leg{k}"].start for k in range(1, 7)]
    assert np.abs(s.q[:, legs] - np.linalg.norm(reach, axis=2)).max() < 1e-13  # rounding
    assert set(s.torque_names) == {f"leg{k}" for k in range(1, 7)}
    assert np.abs(s.unactuated).max() < 1e-12 * np.abs(s.torque).max()  # plate and feet have no drives
    assert np.abs(s.power_residual).max() < 1e-11 * np.abs(s.torque).max() * np.abs(s.qd).max()


def test_stewart_forces_of_massless_legs_balance_the_plate() -> None:
    """sum f_k u_k = m (a - g) and sum (R b_k) x u_k f_k = R (I al + om x I om) + R c x m (a - g)."""
    mechanism, case, _ = solved("stewart_platform", "swoop")
    plate = mechanism.link_of["plate"]
    bare = replace(mechanism, links=tuple(x if x is plate else replace(x, bodies=()) for x in mechanism.links))
    s = run(bare, replace(case, step=0.05))
    feet, balls = feet_and_balls(bare)
    p, r = pose(s)
    v, om = np.split(s.qd[:, bare.v_slices["plate"]], 2, axis=1)
    dv, al = np.split(s.qdd[:, bare.v_slices["plate"]], 2, axis=1)
    body = plate.bodies[0].inertia
    c = body.com
    linear = dv + np.cross(om, v) + np.cross(al, c) + np.cross(om, np.cross(om, c))
    force = body.mass * (np.einsum("sij,sj->si", r, linear) - bare.gravity)
    moment = np.einsum("sij,sj->si", r, al @ body.tensor + np.cross(om, om @ body.tensor))
    moment += np.cross(np.einsum("sij,j->si", r, c), force)
    arms = np.einsum("sij,kj->ski", r, balls)
    along = p[:, None] + arms - feet
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    columns = np.concatenate([along, np.cross(arms, along)], axis=2)  # (sample, leg, 6)
    legs = [s.torque_names.index(f"leg{k}") for k in range(1, 7)]
    pushed = np.einsum("ski,sk->si", columns, s.torque[:, legs])
    assert np.abs(pushed - np.hstack([force, moment])).max() < 1e-11 * np.abs(force).max()  # rounding times condition


# ------------------------------------------------------------------------------------------------- mobility

MOBILITY = {
    "four_bar": (1, 5, 3),
    "slider_crank": (1, 5, 3),
    "five_bar": (2, 5, 3),
    "five_bar_redundant": (2, 5, 3),
    "andrews_squeezer": (1, 9, 3),
    "bricard": (1, 5, 1),
    "stewart_platform": (6, 18, 0),
    "geared_four_bar": (1, 7, 3),
}


@pytest.mark.parametrize("name", sorted(set(MOBILITY) - {"andrews_squeezer"}))  # of that one in test_andrews.py
def test_mobility(name: str) -> None:
    mechanism = flexinv.load_mechanism(MODELS / name)
    _, _, s = solved(name, next(iter(load_cases(MODELS / name, mechanism))))
    for k in (0, len(s.time) // 3, -1):
        mobility = compute_mobility(s.mesh, s.q[k])
        assert (mobility.freedoms, mobility.constraints, mobility.redundant) == MOBILITY[name]


def test_every_rigid_loop_that_stays_closed_is_here() -> None:
    mechanisms = [flexinv.load_mechanism(path) for path in MODELS.glob("*/mechanism.toml")]
    closed = {m.name for m in mechanisms if m.is_rigid and m.closures and not any(c.active for c in m.closures)}
    assert closed == set(MOBILITY)
