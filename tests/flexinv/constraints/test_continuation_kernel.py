"""Compiled following of closed loops: the same kinematics, equations and branch as through NumPy, one sample at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from loop_examples import Example, five_bar, four_bar, platform, slider_crank, spatial
from rigid_trees import tree

from crosscheck.studies.robot_sweep import sample_states
from flexinv.analysis.solve import solve
from flexinv.constraints import continuation as loops
from flexinv.constraints.closures import Rows, compute_constraint_jacobian
from flexinv.constraints.continuation_kernel import Continuation, compute_qr
from flexinv.constraints.equations import fill_closure_residuals, fill_closure_rows
from flexinv.kernels import sparse_qr
from flexinv.kernels.fronts import build_fronts
from flexinv.kernels.jit import jit
from flexinv.kernels.sparse_qr import FrontFactors, compute_condition_estimate, fill_zeros, write_entry
from flexinv.kinematics.configuration import build_nodes, integrate_coordinates, move_nodes
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import compute_difference, compute_rigid_motion, integrate_configuration
from flexinv.kinematics.tree import Frames, Joints
from flexinv.model.mechanism import CLOSURES, Attachment, Closure, Mechanism
from flexinv.typing import Array

# Rounding of some hundred operations on numbers of the size of one.
ROUNDING = 1e-13


@jit
def nodes_at(t, q, qd, qdd, j, f):
    """Motion of all nodes into f."""
    move_nodes(t, q, qd, qdd, j, f)


@jit
def stepped(t, q, d):
    """A step of q in place."""
    integrate_coordinates(t, q, d)


@jit
def equations(t, c, f, phi, g):
    """Residuals (rows, 3) and Jacobian (rows, nv)."""
    fill_closure_rows(t, c, f, phi, g)


@jit
def residuals_alone(c, f, phi):
    """Residuals (rows, 3)."""
    fill_closure_residuals(c, f, phi)


@jit
def least_squares(p):
    """Solve a x = p.y with p.g = a; whether the rank is full, and the estimate of the condition number, which overwrites x."""
    fill_zeros(p.qr)
    for e in range(p.fronts.entry.shape[0]):
        write_entry(p.fronts, p.qr, e, 0, p.g[p.fronts.entry[e, 0], p.fronts.entry[e, 1]])
    if not compute_qr(p):
        return False, np.inf
    sparse_qr.solve_least_squares(p.fronts, p.qr, p.y, p.x)
    for i in range(p.x.shape[0]):
        p.step[i] = p.x[i, 0]
    return True, compute_condition_estimate(p.fronts, p.qr, p.x, p.sign)


def frames(size: int) -> tuple[Joints, Frames]:
    a, b = (tuple(np.zeros((size, 3)) for _ in range(5)) for _ in range(2))
    r, s = np.zeros((2, size, 3, 3))
    return Joints(a[0], a[1], a[2], r, a[3], a[4]), Frames(b[0], s, b[1], b[2], b[3], b[4])


def tied() -> Mechanism:
    """A tree of every kind of joint with a closure of every kind between links and with the world, far from closed."""
    ends = (("slider", "wheel"), ("hip", "world"), ("world", "wrist"), ("base", "slider"))
    random = np.random.default_rng(5)
    names = list(CLOSURES)
    closures = []
    for k, kind in enumerate(names):
        place = [replace(joint.placement) for joint in tree(seed=k).joints[1:3]]
        axis, second = np.linalg.qr(random.normal(size=(3, 3)))[0][:2]
        first, last = (Attachment(link, p) for link, p in zip(ends[k % 4], place, strict=True))
        closures.append(Closure(kind, kind, first, last, axis=axis, second_axis=second))
    return replace(tree(), closures=tuple(closures))


def one_state(mesh: Mesh) -> tuple[Array, Array, Array]:
    return sample_states(replace(mesh.mechanism, closures=()), 1, np.random.default_rng(0))


def test_nodes_move_as_in_rigid_motion() -> None:
    mesh = build(tree())
    q, qd, qdd = one_state(mesh)
    expected, (j, f) = compute_rigid_motion(mesh, q, qd, qdd), frames(mesh.size)
    nodes_at(build_nodes(mesh), q[0], qd[0], qdd[0], j, f)
    for result, name in zip(f, ("x", "rotation", "v", "omega", "a", "alpha"), strict=True):
        values = getattr(expected, name)[0]
        assert abs(result - values).max() < ROUNDING * max(1.0, abs(values).max()), name


def test_steps_are_those_of_the_manifold() -> None:
    """Quaternions turn by R exp(psi), cosine and sine by the angle: `compute_difference` finds the step again."""
    mesh = build(tree())
    q, d, _ = (a[0] for a in one_state(mesh))
    for step in (d / abs(d).max(), 1e-9 * d, 0 * d):  # less than half a turn
        result = q.copy()
        stepped(build_nodes(mesh), result, step)
        assert abs(compute_difference(mesh.mechanism, q, result) - step).max() < ROUNDING * max(1.0, abs(q).max())
        assert (result == integrate_configuration(mesh.mechanism, q, step)).all()
    assert np.array_equal(result, q)  # without a step, not even quaternions are normalised again


def of_vectors(f: Frames, rows: Rows) -> Array:
    """Return u . w or u . d and its two rates (rows, 3), from vectors in the world: phi'' = u''.w + 2 u'.w' + u.w''."""

    def carried(node: int, vector: Array) -> tuple[Array, Array, Array]:
        if node < 0:
            return vector, 0 * vector, 0 * vector
        spin = np.cross(f.w[node], vector)
        return tuple(f.r[node] @ v for v in (vector, spin, np.cross(f.al[node], vector) + np.cross(f.w[node], spin)))

    result = np.empty((len(rows.closure), 3))
    for k, (a, b) in enumerate(zip(rows.a.tolist(), rows.b.tolist(), strict=True)):
        u, w = carried(a, rows.u[k]), list(carried(b, rows.w[k]))
        if not rows.direction[k]:
            ends = [carried(n, p[k]) for n, p in ((a, rows.place_a), (b, rows.place_b))]
            x, y = ([v[n] if n >= 0 else np.zeros(3) for v in (f.x, f.v, f.a)] for n in (a, b))
            w = [y[i] + ends[1][i] - x[i] - ends[0][i] for i in range(3)]
        result[k] = u[0] @ w[0], u[1] @ w[0] + u[0] @ w[1], u[2] @ w[0] + 2 * u[1] @ w[1] + u[0] @ w[2]
    return result


def test_equations_of_every_kind() -> None:
    """Seen from the first frame as they are in the world; and G qd = phi' at a state that is far from closed."""
    mesh = build(tied())
    rows = loops.build_constraint_rows(mesh)
    q, qd, qdd = one_state(mesh)
    motion, (j, f) = compute_rigid_motion(mesh, q, qd, qdd), frames(mesh.size)
    nodes_at(build_nodes(mesh), q[0], qd[0], qdd[0], j, f)
    phi, g = np.empty((len(rows.closure), 3)), np.zeros((len(rows.closure), mesh.mechanism.nv))
    equations(build_nodes(mesh), rows, f, phi, g)
    expected, alone = of_vectors(f, rows), np.empty_like(phi)
    residuals_alone(rows, f, alone)
    assert np.array_equal(phi, alone)
    assert abs(phi - expected).max() < ROUNDING * abs(expected).max()
    assert abs(g @ qd[0] - phi[:, 1]).max() < ROUNDING * abs(phi[:, 1]).max()
    assert abs(compute_constraint_jacobian(mesh, motion, rows)[0] - g).max() < ROUNDING * abs(g).max()


def problem(a: Array, y: Array) -> Continuation:
    (rows, columns), fronts = a.shape, build_fronts(a != 0.0)
    none, x, sign = np.zeros(columns), *np.zeros((2, columns, 1))
    return Continuation(
        np.zeros(columns, dtype=np.int64), np.zeros(1, dtype=bool), np.ones(rows), none, a, fronts,
        FrontFactors.build_for(fronts),
        y[:, None].copy(), x, sign, none.copy(), none, none,
    )  # fmt: skip


@pytest.mark.parametrize(("rows", "columns"), [(2, 2), (5, 2), (7, 7), (30, 24)])
def test_least_squares(rows: int, columns: int) -> None:
    random = np.random.default_rng(rows)
    a, y = random.normal(size=(rows, columns)), random.normal(size=rows)
    a[-1] = 2 * a[0] if rows > columns else a[-1]  # a row that repeats another, which nothing contradicts
    y[-1] = 2 * y[0] if rows > columns else y[-1]
    p = problem(a, y)
    full, estimate = least_squares(p)
    assert full
    assert abs(p.step - np.linalg.lstsq(a, y, rcond=None)[0]).max() < 1e-11  # conditions of some hundreds
    assert np.linalg.cond(a) <= estimate <= columns**1.5 * np.linalg.cond(a)


def test_what_may_lack_rank_is_left_alone() -> None:
    a = np.random.default_rng(0).normal(size=(5, 3))
    a[:, 2] = a[:, 0] + 1e-9 * a[:, 1]
    assert not least_squares(problem(a, np.ones(5)))[0]
    assert not least_squares(problem(np.zeros((5, 3)), np.ones(5)))[0]
    assert not least_squares(problem(np.full((5, 3), np.nan), np.ones(5)))[0]
    assert not least_squares(problem(np.ones((2, 3)), np.ones(3)))[0]


LOOPS = {
    "four-bar": four_bar(),
    "five-bar": five_bar(2),
    "slider-crank": slider_crank("pin"),
    "point on line": slider_crank("point-on-line"),
    "spatial": spatial(),
    "platform": platform(),
}


@pytest.mark.parametrize("name", LOOPS)
def test_the_branch_is_that_of_newton_in_numpy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the compiled following switched off every sample goes the long way, to the same place; rates alike."""
    example: Example = LOOPS[name]
    mechanism, case = example
    solution = solve(mechanism, case.motion, step=case.step, start=case.start)

    def not_at_all(*arguments: Any) -> int:
        *_, condition, first = arguments
        condition.fill(np.inf)
        return int(first)

    monkeypatch.setattr(loops, "find_branch", not_at_all)
    expected = solve(mechanism, case.motion, step=case.step, start=case.start)
    for part in ("q", "qd", "qdd"):
        values = getattr(expected, part)
        assert abs(getattr(solution, part) - values).max() < 1e-11 * max(1.0, abs(values).max())  # Newton's last step


def test_long_steps_are_halved_by_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel refuses a step that surprises; from there it goes on by itself."""
    mechanism, case = four_bar()
    reached = []
    original = loops.find_branch

    def counted(*arguments: object) -> int:
        reached.append((arguments[-1], original(*arguments)))
        return int(reached[-1][1])

    monkeypatch.setattr(loops, "find_branch", counted)
    coarse = solve(mechanism, case.motion, step=1 / 10, start=case.start)
    assert len(reached) > 1
    assert any(last == 11 for _, last in reached)
    fine = solve(mechanism, case.motion, step=1 / 200, start=case.start)
    assert abs(coarse.q - fine.q[::20]).max() < 1e-12
