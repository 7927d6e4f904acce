"""The parallel-axis theorem: against point masses, and written in one place only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from flexinv.model.parallel_axis import compute_parallel_axis_term

ROUNDING = 1e-15  # a few roundings of numbers of size one


def test_a_body_of_point_masses_about_two_points() -> None:
    """sum m_k (|r_k|^2 1 - r_k r_k^T) about the origin is the same about the centre, and the term of all mass there."""
    random = np.random.default_rng(1)
    masses = random.uniform(0.1, 1.0, 5)
    points = random.normal(size=(5, 3))
    mass = float(masses.sum())
    centre = masses @ points / mass

    def sum_moments(origin: np.ndarray) -> np.ndarray:
        arms = points - origin
        return np.einsum(
            "k,kij->ij", masses, (arms**2).sum(1)[:, None, None] * np.eye(3) - arms[:, :, None] * arms[:, None]
        )

    expected = sum_moments(np.zeros(3)) - sum_moments(centre)
    np.testing.assert_allclose(compute_parallel_axis_term(mass, centre), expected, atol=50 * ROUNDING)


def test_no_digit_is_lost_about_the_arm_itself() -> None:
    """About an axis through both points nothing is gained, however long the arm: |c|^2 - c_x^2 would leave 1e-4 here."""
    term = compute_parallel_axis_term(1.0, np.array([1e6, 1e-3, 0.0]))
    assert term[0, 0] == pytest.approx(1e-6, rel=ROUNDING)


def list_repeats(text: str) -> Iterator[str]:
    """Yield products of an outer product of a vector with itself taken from a multiple of the identity."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub) and isinstance(node.right, ast.Call):
            arguments = [ast.unparse(one) for one in node.right.args]
            is_outer = ast.unparse(node.right.func) in ("np.outer", "outer") and len(set(arguments)) == 1
            if is_outer and isinstance(node.left, ast.BinOp) and "eye(3)" in ast.unparse(node.left):
                yield ast.unparse(node)


def test_the_theorem_is_written_once(root: Path) -> None:
    """But for engines, each a model of its own, and campaigns, which state by code of their own what is judged."""
    files = [p for name in ("flexinv", "crosscheck") for p in sorted((root / name).rglob("*.py"))]
    repeats = {
        file.relative_to(root).as_posix(): found
        for file in files
        if "engines" not in file.parts and (found := list(list_repeats(file.read_text())))
    }
    assert repeats == {}
    text = "import numpy as np\ndef f(m, c):\n    return m * (float(c @ c) * np.eye(3) - np.outer(c, c))\n"
    assert list(list_repeats(text)) == ["float(c @ c) * np.eye(3) - np.outer(c, c)"]
