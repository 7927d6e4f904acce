"""Craig-Bampton reduction against dense matrices, closed forms, and differences of the strain energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from part_examples import ALUMINIUM, make_bar, make_block, make_part

from flexinv.errors import InputError
from flexinv.model.part import MeshedPart, SparseMatrix
from flexinv.parts import reductions
from flexinv.parts.craig_bampton import compute_reduction
from flexinv.parts.part_matrices import build_part_matrices, build_rigid_motions
from flexinv.parts.point_masses import build_point_masses
from flexinv.parts.second_order import compute_second_order_forces
from flexinv.parts.solid_elements import build_rules
from flexinv.typing import Array


def make_stout(tie: str = "rigid", **data: object) -> MeshedPart:
    return make_part(*make_block("tetra10", (0.3, 0.1, 0.05), (2, 1, 1)), "tetra10", ALUMINIUM, tie, **data)


def build_dense(part: MeshedPart, held: bool) -> tuple[Array, Array, Array]:
    """K and M of the nodes that move, with the interface frames as coordinates unless they are held, by dense matrices."""
    found = build_part_matrices(part)
    count = 3 * len(found.points)
    stiffness = found.stiffness.toarray()
    mass = np.kron(found.mass.toarray(), np.eye(3))
    rows = [(3 * one.nodes[:, None] + np.arange(3)).ravel() for one in part.interfaces]
    motion = [build_rigid_motions(found.points[one.nodes], one.origin) for one in part.interfaces]
    if part.interfaces[0].tie == "rigid":
        free = np.setdiff1d(np.arange(count), np.concatenate(rows))
        moves = np.eye(count)[:, free]
        if not held:
            frame = np.zeros((count, 6))
            frame[rows[1]] = motion[1]
            moves = np.hstack([frame, moves])
    else:
        ties = np.zeros((12, count))
        for k in range(2):
            ties[6 * k : 6 * k + 6, rows[k]] = np.linalg.pinv(motion[k])
        moves = scipy.linalg.null_space(ties if held else ties[:6])
    return moves.T @ stiffness @ moves, moves.T @ mass @ moves, moves


@pytest.mark.parametrize("tie", ["rigid", "average"])
def test_frequencies_with_all_interfaces_held(tie: str) -> None:
    reduced = compute_reduction(make_stout(tie, modes=6))
    stiffness, mass, _ = build_dense(make_stout(tie), held=True)
    exact = np.sqrt(scipy.linalg.eigvalsh(stiffness, mass)[:7]) / (2 * np.pi)
    assert (
        np.abs(reduced.fixed / exact[:6] - 1).max() < 1e-8
    )  # Lanczos stops at rounding; K is known to 1e-10 of its softest
    assert reduced.left_out == pytest.approx(exact[6], rel=1e-8)


@pytest.mark.parametrize("tie", ["rigid", "average"])
def test_modes_converge_to_those_of_the_mesh(tie: str) -> None:
    """Held at the root: the reduction lies above the mesh, and meets it with more modes; static loads it meets with none."""
    stiffness, mass, _ = build_dense(make_stout(tie), held=False)
    exact = np.sqrt(scipy.linalg.eigvalsh(stiffness, mass)[:4]) / (2 * np.pi)
    gaps = []
    for modes in (0, 4, 30):
        found = compute_reduction(make_stout(tie, modes=modes)).frequency[:4] / exact - 1
        assert (found > -1e-9).all()
        gaps.append(found.max())
    assert gaps[0] > gaps[1] > gaps[2]
    assert (
        gaps[2] < 2e-4
    )  # the mode beyond 30 is some hundred times as fast as the fourth, and its part falls with the square


@pytest.mark.parametrize("tie", ["rigid", "average"])
def test_loads_at_interfaces_are_met_without_modes(tie: str) -> None:
    part = make_stout(tie, modes=0)
    reduced = compute_reduction(part)
    wrench = np.array([3.0, -2.0, 5.0, 0.4, 0.7, -0.2])
    by = np.vstack([reduced.moves[0], reduced.turns[0]])  # (6, shapes)
    moved = by @ ((by.T @ wrench) / reduced.modal_stiffness)
    stiffness, _, moves = build_dense(part, held=False)
    found = build_part_matrices(part)
    tip = part.interfaces[1]
    motion = build_rigid_motions(found.points[tip.nodes], tip.origin)
    rows = (3 * tip.nodes[:, None] + np.arange(3)).ravel()
    average = np.linalg.pinv(motion) @ moves[rows]
    exact = average @ np.linalg.solve(stiffness, average.T @ wrench)
    assert np.abs(moved - exact).max() < 1e-8 * np.abs(exact).max()


@pytest.mark.parametrize("stiffening", [True, False])
def test_point_masses_have_the_inertia_of_the_mesh(stiffening: bool) -> None:
    """All products of the fields 1, X and Phi, and of these with displacements of second order, are those of the mesh."""
    reduced = compute_reduction(make_stout(modes=5, stiffening=stiffening))
    points = build_point_masses(reduced)
    count = len(reduced.points)

    def list_fields(place: Array, shapes: Array) -> Array:
        return np.hstack([np.ones((len(place), 1)), place, shapes.reshape(len(place), -1)])

    fine = list_fields(reduced.points, reduced.shapes)
    few = list_fields(points.place, points.shapes)
    assert len(few) <= min(4 + 3 * len(reduced.modal_mass), count)
    exact = fine.T @ (reduced.mass @ fine)
    size = np.sqrt(np.diag(exact))
    assert np.abs((points.mass * few.T @ few - exact) / size[:, None] / size).max() < 1e-12  # rounding of the factors
    bent = fine.T @ (reduced.mass @ reduced.second.reshape(count, -1))
    found = points.mass * few.T @ points.second.reshape(len(few), -1)
    assert np.abs(found - bent).max(initial=0.0) <= 1e-10 * np.abs(bent).max(initial=0.0)
    wrong = points.mass * few[1:].T @ few[1:]  # a point left out is seen
    assert np.abs((wrong - exact) / size[:, None] / size).max() > 1e-3


def test_a_cantilever_that_bends_comes_nearer() -> None:
    """Along x the tip moves by - int w'^2 / 2; of the first mode with unit tip, int w'^2 = 1.16191 / length (Young, Felgar)."""
    reduced = compute_reduction(make_bar(modes=6, length=0.8))
    along = np.diag(reduced.second_moves[0, 0])[:2]
    assert along == pytest.approx(-1.16191 / 0.8, rel=1e-2)  # of a bar of 40 sides, whose mesh ends flat at both faces
    assert reduced.second_moves[0, 0, 0, 1] == pytest.approx(0.0, abs=1e-6)


def evaluate_strain_energy(part: MeshedPart, moved: Array) -> float:
    """Energy [J] of the Green strain of displacements (n, 3) [m]."""
    total = 0.0
    for cells in part.cells:
        rule = build_rules(cells.kind)[0]
        for nodes in cells.nodes:
            for slope, weight in zip(rule.slope, rule.weight, strict=True):
                jacobian = slope.T @ part.points[nodes]
                g = moved[nodes].T @ np.linalg.solve(jacobian, slope.T).T
                e = (g + g.T + g.T @ g) / 2
                six = np.array([*np.diag(e), 2 * e[1, 2], 2 * e[0, 2], 2 * e[0, 1]])
                total += 0.5 * weight * np.linalg.det(jacobian) * six @ cells.material.stiffness @ six
    return float(total)


def test_forces_of_second_order_are_those_of_the_energy() -> None:
    """N_ab . v is the third derivative of the energy along shapes a, b and v: from its values, by differences."""
    part = make_part(*make_block("hexahedron", (0.3, 0.1, 0.05), (2, 1, 1)), "hexahedron")
    found = build_part_matrices(part)
    shapes = np.random.default_rng(4).normal(size=(3, len(part.points), 3))
    force = compute_second_order_forces(part, found, shapes[:2].transpose(1, 2, 0))  # pairs 00, 01, 11
    h = 1e-3
    third = 0.0
    for signs in np.ndindex(2, 2, 2):
        s = 1.0 - 2.0 * np.array(signs)
        third += s.prod() * evaluate_strain_energy(part, h * np.einsum("s,snk->nk", s, shapes))
    third /= (2 * h) ** 3
    assert force[:, 1] @ shapes[2].ravel() == pytest.approx(
        third, rel=1e-5
    )  # the energy is quartic: rounding / h^3 is left
    assert force[:, 0] @ shapes[2].ravel() != pytest.approx(third, rel=1e-2)


def test_matrices_of_another_program_are_taken_over() -> None:
    part = make_stout()
    found = build_part_matrices(part)
    mass, stiffness = (scipy.sparse.coo_array(m) for m in (scipy.sparse.kron(found.mass, np.eye(3)), found.stiffness))
    size = 3 * len(part.points)
    given = replace(
        part, cells=(), mass=SparseMatrix(size, mass.row, mass.col, mass.data),
        stiffness=SparseMatrix(size, stiffness.row, stiffness.col, stiffness.data),
    )  # fmt: skip
    same, other = compute_reduction(replace(part, stiffening=False)), compute_reduction(given)
    assert other.frequency == pytest.approx(same.frequency, rel=1e-10)
    assert other.soft == 0  # no cells, no strains of second order


def build_given(part: MeshedPart, change_mass: Array, change_stiffness: Array) -> MeshedPart:
    found = build_part_matrices(part)
    both = np.kron(found.mass.toarray(), np.eye(3)) + change_mass, found.stiffness.toarray() + change_stiffness
    entries = [scipy.sparse.coo_array(matrix) for matrix in both]
    mass, stiffness = (SparseMatrix(m.shape[0], m.row, m.col, m.data) for m in entries)
    return replace(part, cells=(), mass=mass, stiffness=stiffness)


def test_matrices_that_no_free_part_has_are_refused() -> None:
    part = make_part(*make_block("tetra", (0.3, 0.1, 0.05), (2, 1, 1)), "tetra")
    size = 3 * len(part.points)
    none = np.zeros((size, size))
    one = none.copy()
    one[0, 0] = 1e12
    uneven = none.copy()
    uneven[0, 4] = 1e9
    heavy = none.copy()
    heavy[0, 0] = 1.0
    for change, words in (
        ((none, one), "stiffness resists translations"),
        ((none, uneven), "stiffness is not symmetric"),
        ((heavy, none), "mass differs between directions"),
    ):
        with pytest.raises(InputError, match=words):
            compute_reduction(build_given(part, *change))
    small = SparseMatrix(size - 3, np.arange(3), np.arange(3), np.ones(3))
    with pytest.raises(InputError, match=f"mass has {size - 3} rows, the mesh {size // 3} nodes"):
        replace(part, cells=(), mass=small, stiffness=small)
    with pytest.raises(InputError, match="expected at most"):
        compute_reduction(replace(part, modes=500))


def test_modes_up_to_a_frequency() -> None:
    part = make_stout(modes=30)
    all_of_them = compute_reduction(part).fixed
    limit = float(all_of_them[4:6].mean())
    some = compute_reduction(replace(part, frequency=limit))
    assert some.fixed == pytest.approx(all_of_them[:5], rel=1e-9)
    assert some.left_out == pytest.approx(all_of_them[5], rel=1e-9)


def test_reductions_are_kept_by_what_they_are_made_of(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(reductions, "FEW_POINTS", 0)
    made = []
    monkeypatch.setattr(reductions, "compute_reduction", lambda part: made.append(1) or compute_reduction(part))
    first = reductions.find_reduction(make_stout(modes=3))
    again = reductions.find_reduction(make_stout(modes=3, retardation=1e-3))  # damping is no part of it
    assert len(made) == 1
    for name in ("shapes", "modal_stiffness", "second", "second_turns"):
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert abs(first.mass - again.mass).max() == 0.0
    reductions.find_reduction(make_stout(modes=4))
    assert len(made) == 2
    for file in reductions.find_cache_folder().glob("*.npz"):
        file.write_bytes(file.read_bytes()[:100])  # torn
    assert np.array_equal(reductions.find_reduction(make_stout(modes=3)).shapes, first.shapes)
    assert len(made) == 3


def test_a_hinge_and_a_negative_energy_are_refused() -> None:
    """Two bricks of one shared edge turn about it; a stiffness of which a motion of the free part is turned over gives energy."""
    points, cells = make_block("hexahedron", (0.4, 0.1, 0.1), (2, 1, 1))
    upper = np.flatnonzero((np.abs(points[:, 0] - 0.2) < 1e-9) & (points[:, 2] > 0.0))
    own = {int(node): len(points) + k for k, node in enumerate(upper)}
    cells[1] = [own.get(int(node), int(node)) for node in cells[1]]
    hinged = make_part(np.vstack([points, points[upper]]), cells, "hexahedron", modes=1)
    with pytest.raises(InputError, match=r"moves without force(?s:.*)hinge"):
        compute_reduction(hinged)
    part = make_bar("hexahedron", 0.4, 0.1, (3, 1, 1), modes=1)
    found = build_part_matrices(part)
    mass = np.kron(found.mass.toarray(), np.eye(3))
    value, shapes = scipy.linalg.eigh(found.stiffness.toarray(), mass)
    push = mass @ shapes[:, 6]
    whole = [
        scipy.sparse.coo_array(one) for one in (mass, found.stiffness.toarray() - 3 * value[6] * np.outer(push, push))
    ]
    given = [SparseMatrix(one.shape[0], *one.coords, one.data) for one in whole]
    with pytest.raises(InputError, match=r"moves without force, omega\^2 = -"):
        compute_reduction(replace(part, cells=(), mass=given[0], stiffness=given[1]))
