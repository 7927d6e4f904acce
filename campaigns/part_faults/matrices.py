"""Faults of mass and stiffness that another program has exported."""

from __future__ import annotations

import io
import random
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy

from campaigns.part_faults.draft import MATERIAL, Draft, make_draft
from campaigns.part_faults.table import fault
from flexinv.files.load_mechanism import load_mechanism
from flexinv.parts.part_matrices import build_part_matrices
from flexinv.typing import Array

Change = Callable[[Array, Array, random.Random], tuple[Array, Array]]
GIVEN = 'mass = "mass.mtx"\nstiffness = "stiffness.mtx"\nunit_kg = 1000'


def make_matrix_draft(draw: random.Random) -> Draft:
    """Return a part with its matrices [t], [t/s^2] beside the mesh."""
    draft = make_draft(draw, "tetra", (3, 1, 1))
    with tempfile.TemporaryDirectory() as folder:
        draft.write(Path(folder) / "whole")
        part = load_mechanism(Path(folder) / "whole").link_of["arm"].part
    assert part is not None
    found = build_part_matrices(part)
    mass = scipy.sparse.kron(found.mass, scipy.sparse.eye_array(3)).toarray() / 1000
    draft.swap(MATERIAL, GIVEN)
    _put_matrices(draft, mass, found.stiffness.toarray() / 1000)
    return draft


def _put_matrices(draft: Draft, mass: Array, stiffness: Array) -> None:
    for name, matrix in (("mass", mass), ("stiffness", stiffness)):
        stream = io.BytesIO()
        scipy.io.mmwrite(stream, scipy.sparse.coo_array(matrix), precision=16, symmetry="general")
        draft.files[f"{name}.mtx"] = stream.getvalue()


def _read_matrix(draft: Draft, name: str) -> Array:
    return np.asarray(scipy.io.mmread(io.BytesIO(draft.files[f"{name}.mtx"])).toarray())


def _change_matrices(draw: random.Random, change: Change) -> Draft:
    draft = make_matrix_draft(draw)
    mass, stiffness = (_read_matrix(draft, name) for name in ("mass", "stiffness"))
    _put_matrices(draft, *change(mass, stiffness, draw))
    return draft


def _alter(matrix: Array, row: int, column: int, value: float) -> Array:
    """The matrix with one entry changed by a part of its largest one."""
    out = matrix.copy()
    out[row, column] += value * np.abs(matrix).max()
    return out


def _hold(stiffness: Array) -> Array:
    """Three nodes are held by stiff springs: boundary conditions were left in."""
    out = stiffness.copy()
    out[np.arange(9), np.arange(9)] += 1e3 * np.abs(stiffness).max()
    return out


def _shuffle(matrix: Array, draw: random.Random) -> Array:
    order = list(range(len(matrix) // 3))
    draw.shuffle(order)
    rows = (3 * np.array(order)[:, None] + np.arange(3)).ravel()
    return matrix[np.ix_(rows, rows)]


def _loosen(stiffness: Array) -> Array:
    """One node hangs on nothing: three motions more without force."""
    out = stiffness.copy()
    out[-3:] = 0.0
    out[:, -3:] = 0.0
    return out


def _soften(stiffness: Array) -> Array:
    """A motion that is no rigid one costs no force."""
    value, vectors = np.linalg.eigh(stiffness)
    return stiffness - value[6] * np.outer(vectors[:, 6], vectors[:, 6])


def _by_components(matrix: Array) -> Array:
    """All x, then all y, then all z."""
    order = np.arange(len(matrix)).reshape(-1, 3).T.ravel()
    return matrix[np.ix_(order, order)]


CHANGES: dict[str, tuple[Change, str]] = {
    "mass_not_symmetric": (lambda m, k, draw: (_alter(m, 0, 12, 0.1), k), "mass"),
    "stiffness_not_symmetric": (lambda m, k, draw: (m, _alter(k, 0, 4, 0.1)), "stiffness is not symmetric"),
    "stiffness_lower_half": (lambda m, k, draw: (m, np.tril(k)), "stiffness is not symmetric"),
    "mass_negative": (lambda m, k, draw: (-m, k), "mass"),
    "stiffness_negative": (lambda m, k, draw: (m, -k), "stiffness"),
    "stiffness_indefinite": (lambda m, k, draw: (m, k - 3 * _soften_part(k)), "not positive"),
    "mass_indefinite": (lambda m, k, draw: (_make_indefinite(m), k), "not positive"),
    "mass_smaller": (lambda m, k, draw: (m[:-3, :-3], k), "mass|rows|size"),
    "both_smaller": (lambda m, k, draw: (m[:-3, :-3], k[:-3, :-3]), "rows|size"),
    "exchanged": (lambda m, k, draw: (k, m), "mass|stiffness"),
    "stiffness_held": (lambda m, k, draw: (m, _hold(k)), "stiffness resists"),
    "rows_permuted": (lambda m, k, draw: (_shuffle(m, random.Random(1)), _shuffle(k, random.Random(1))), "order of the rows"),
    "stiffness_rows_permuted": (lambda m, k, draw: (m, _shuffle(k, random.Random(2))), "order of the rows"),
    "mass_rows_permuted": (lambda m, k, draw: (_shuffle(m, random.Random(3)), k), "without stiffness between"),
    "rows_by_components": (lambda m, k, draw: (_by_components(m), _by_components(k)), "mass|order"),
    "node_on_nothing": (lambda m, k, draw: (m, _loosen(k)), "stiffness"),
    "seventh_motion": (lambda m, k, draw: (m, _soften(k)), "7 motions without force"),
    "not_a_number": (lambda m, k, draw: (m, _alter(k, 0, 0, np.nan)), "number|nan|finite"),
    "unit_of_mass_forgotten": (lambda m, k, draw: (1000 * m, 1000 * k), "unit_kg|density"),
    "mass_of_zero": (lambda m, k, draw: (0.0 * m, k), "mass"),
    "stiffness_of_shells": (lambda m, k, draw: (np.kron(m, np.eye(2)), np.kron(k, np.eye(2))), "rows|size"),
    "mass_turned_by_direction": (lambda m, k, draw: (m * np.tile([1.0, 1.0, 1.5], len(m) // 3), k), "direction"),
}  # fmt: skip


def _soften_part(stiffness: Array) -> Array:
    value, vectors = np.linalg.eigh(stiffness)
    return value[6] * np.outer(vectors[:, 6], vectors[:, 6])


def _make_indefinite(mass: Array) -> Array:
    """The slowest motion of the mass by itself has the opposite sign, alike in x, y and z."""
    one = mass[::3, ::3]
    value, vectors = np.linalg.eigh(one)
    return np.kron(one - 3 * value[0] * np.outer(vectors[:, 0], vectors[:, 0]), np.eye(3))


for name, (change, words) in CHANGES.items():
    fault(words, f"matrix_{name}")(lambda draw, change=change: _change_matrices(draw, change))


def _change_file(draw: random.Random, change: Callable[[bytes], bytes]) -> Draft:
    draft = make_matrix_draft(draw)
    draft.files["stiffness.mtx"] = change(draft.files["stiffness.mtx"])
    return draft


FILES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "torn": (lambda data: data[: len(data) // 2], "stiffness.mtx"),
    "empty": (lambda data: b"", "stiffness.mtx"),
    "of_words": (lambda data: b"see the attached report\n", "stiffness.mtx"),
    "counted_from_zero": (lambda data: data.replace(b"\n1 1 ", b"\n0 0 "), "stiffness.mtx"),
    "of_result_of_a_gigabyte": (lambda data: data.replace(b"%%MatrixMarket", b"%%MatrixMarked"), "stiffness.mtx"),
}
for name, (edit, words) in FILES.items():
    fault(words, f"matrix_file_{name}")(lambda draw, edit=edit: _change_file(draw, edit))


@fault("both mass and stiffness")
def give_stiffness_alone(draw: random.Random) -> Draft:
    """Only one matrix was exported."""
    draft = make_matrix_draft(draw)
    draft.swap('mass = "mass.mtx"\n', "")
    return draft


@fault("material|matrices")
def give_material_beside_matrices(draw: random.Random) -> Draft:
    """A material that ready matrices do not use."""
    draft = make_matrix_draft(draw)
    draft.swap(GIVEN, f"{MATERIAL}\n{GIVEN}")
    return draft
