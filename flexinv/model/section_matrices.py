"""Matrices of a beam's section: stiffness, damping and mass per length (6, 6), what is possible, and about which axis they are.

Strains, stress resultants and velocities of a section stand in one order: axial, shear y, shear z, twist, bending y, bending z
(that of VABS, whose x1 runs along the beam).  With c the mass centre and J the inertia about it the kinetic energy per length
of velocities (v, w) at the reference axis is half of (v, w) . M (v, w):

    M = (m 1, -m skew(c);  m skew(c), J - m skew(c) skew(c))

A section about another axis: with the new origin p and the turn R in the old axes the same motion has the strains
    gamma' = R^T (gamma + kappa x p),   kappa' = R^T kappa,       C' = T^-T C T^-1 with e' = T e,  M likewise
Source: Hodges, *Nonlinear Composite Beam Theory*, 2006, chapters 4 and 6.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexinv.errors import InputError
from flexinv.model.parallel_axis import compute_parallel_axis_term
from flexinv.model.rules import Rule, copy_read_only, make_array_rule
from flexinv.typing import Array
from flexinv.validation import check_finite_array, convert_to_floats

COMPONENTS = ("axial", "shear y", "shear z", "twist", "bending y", "bending z")
# Of the geometric mean of two entries of the diagonal: files carry about seven digits, as of an inertia (`links.DIGITS`).
ASYMMETRY = 1e-6
# Least eigenvalue of a stiffness whose diagonal is one: below it rounding of seven digits says whether it is positive.
LEAST_STIFFNESS = 1e-9
UPPER = np.triu_indices(6, 1)


def make_section_rule(
    size: int, unit: str, describe: Callable[[Array], str] = lambda one: "", expected: str = "a symmetric matrix"
) -> Rule:
    """Return the rule of a table (n, size) of numbers >= 0 [any unit], or of matrices (n, size, size), which become symmetric.

    describe : the reason against a matrix, ``""`` for none; expected : what it has to be, in words
    """

    check_numbers = make_array_rule((None, size), unit, least=0.0)

    def check_value(name: str, value: Any) -> Any:
        if convert_to_floats(name, value).ndim != 3:
            return check_numbers(name, value)
        given = check_finite_array(name, value, (None, size, size), unit)
        for k, matrix in enumerate(given):
            if reason := describe_asymmetry(matrix) or describe(matrix):
                raise InputError(f"{name}[{k}]: {reason}; expected {expected} ({size}, {size}) [{unit}]")
        return copy_read_only((given + given.swapaxes(1, 2)) / 2.0)

    return check_value


def build_full_matrices(rows: Array) -> Array:
    """Return matrices (n, size, size) [any unit] of a table that holds them or their diagonals (n, size)."""
    return rows if rows.ndim == 3 else np.asarray(rows[:, :, None] * np.eye(rows.shape[1]))


def take_diagonals(name: str, given: ArrayLike) -> Array:
    """Return the diagonals (n, size) [any unit] of matrices (n, size, size) of which none has anything beside it, else all.

    Raises InputError, which begins with ``name``, for what are no numbers.
    """
    whole = convert_to_floats(name, given)
    if whole.ndim != 3 or whole.shape[1] != whole.shape[2] or (whole * (1.0 - np.eye(whole.shape[1]))).any():
        return whole
    return np.diagonal(whole, axis1=1, axis2=2).copy()


def scale_to_unit_strengths(matrix: Array) -> Array:
    """Return the matrix with rows and columns so scaled that its diagonal is one [-], zero where it is zero."""
    size = np.sqrt(np.abs(np.diagonal(matrix)))
    over = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    return matrix * over[:, None] * over


def describe_asymmetry(matrix: Array) -> str:
    """Return the reason against a matrix [any unit] that is not symmetric, ``""`` for one that is."""
    size = np.sqrt(np.abs(np.diagonal(matrix)))
    off = np.abs(matrix - matrix.T) - ASYMMETRY * np.outer(size, size)
    row, column = np.unravel_index(int(off.argmax()), off.shape)
    if off.max() <= 0.0:
        return ""
    one = f"entry ({row + 1}, {column + 1}) is {matrix[row, column]:.7g}"
    return f"it is not symmetric: {one}, entry ({column + 1}, {row + 1}) is {matrix[column, row]:.7g}"


def describe_impossible_stiffness(matrix: Array) -> str:
    """Return the reason against a stiffness (6, 6) [N], [N m], [N m^2], ``""`` for one that stores energy in every strain."""
    diagonal = np.diagonal(matrix)
    if diagonal.min() <= 0.0:
        return f"it is not positive definite: the stiffness of {COMPONENTS[int(diagonal.argmin())]} is {diagonal.min():.4g}"
    least = float(np.linalg.eigvalsh(scale_to_unit_strengths(matrix))[0])
    if least > LEAST_STIFFNESS:
        return ""
    return f"it is not positive definite: with its diagonal scaled to 1 the least eigenvalue is {least:.3g}"


def describe_impossible_damping(matrix: Array) -> str:
    """Return the reason against a damping (6, 6) [N s], [N m s], [N m^2 s], ``""`` for one that feeds no motion."""
    diagonal = np.diagonal(matrix)
    if diagonal.min() < 0.0:
        return f"the damping of {COMPONENTS[int(diagonal.argmin())]} is negative, {diagonal.min():.4g}"
    scaled = scale_to_unit_strengths(matrix)
    if (np.abs(matrix[UPPER]) > 0.0)[scaled[UPPER] == 0.0].any():
        return "a strain without damping of its own is coupled with another"
    least = float(np.linalg.eigvalsh(scaled)[0])
    return (
        ""
        if least > -LEAST_STIFFNESS
        else f"it feeds energy: with its diagonal scaled to 1 an eigenvalue is {least:.3g}"
    )


def build_mass_matrix(mass: float, centre: Array, inertia: Array) -> Array:
    """Return M (6, 6) [kg/m], [kg], [kg m] of a mass [kg/m], its centre (2,) y, z [m], the inertia (3, 3) about that [kg m]."""
    place = np.array([0.0, *centre])
    arm = _build_skew(place)
    about = inertia + compute_parallel_axis_term(mass, place)
    return np.block([[mass * np.eye(3), -mass * arm], [mass * arm, about]])


def split_mass_matrix(matrix: Array, name: str) -> tuple[float, Array, Array]:
    """Return mass per length [kg/m], its centre (2,) y, z [m] and the inertia (3, 3) about that [kg m] of M (6, 6).

    Raises InputError, which begins with ``name``, where it is not the M of a mass in the plane of the section.
    """
    expected = "M = (m 1, -m skew(c); m skew(c), J) with c = (0, y, z), in the order " + ", ".join(COMPONENTS)
    mass = float(matrix[0, 0])
    size = np.sqrt(np.abs(np.diagonal(matrix)))
    reason = describe_asymmetry(matrix)
    if not reason and not mass > 0.0:
        reason = f"its mass is {mass:.4g} kg/m"
    if reason:
        raise InputError(f"{name} = {matrix.tolist()}: {reason}; expected {expected}")
    centre = np.array([-matrix[0, 5] - matrix[5, 0], matrix[0, 4] + matrix[4, 0]]) / (2.0 * mass)
    about = (matrix[3:, 3:] + matrix[3:, 3:].T) / 2.0
    inertia = about - compute_parallel_axis_term(mass, np.array([0.0, *centre]))
    off = np.abs(build_mass_matrix(mass, centre, inertia) - matrix) - ASYMMETRY * np.outer(size, size)
    if off.max() > 0.0:
        row, column = np.unravel_index(int(off.argmax()), off.shape)
        reason = (
            f"entry ({row + 1}, {column + 1}) is {matrix[row, column]:.7g}, which no mass in the section's plane has"
        )
        raise InputError(f"{name} = {matrix.tolist()}: {reason}; expected {expected}")
    return mass, centre, inertia


def build_axis_change(y: float, z: float, angle: float) -> Array:
    """Return T (6, 6) [-], [m], which makes strains, or velocities, about another axis of given ones.

    y, z : where that axis is [m]; angle : by which its frame is turned about x [rad]
    """
    c = np.cos(angle)
    s = np.sin(angle)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.block([[turn.T, -turn.T @ _build_skew(np.array([0.0, y, z]))], [np.zeros((3, 3)), turn.T]])


def _build_skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
