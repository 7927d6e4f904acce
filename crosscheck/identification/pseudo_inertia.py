"""Mass properties as ten unbounded numbers: every value of them is a body that can be (log-Cholesky of the pseudo-inertia).

    P = [[S, h], [h^T, m]] = (L U) (L U)^T,   S = tr(I)/2 - I   (I about the frame's origin, h = m c)
    U = e^a [[e^d1, s12, s13, t1], [0, e^d2, s23, t2], [0, 0, e^d3, t3], [0, 0, 0, 1]]

L is the upper triangular factor of what is known before, so that a = d = s = t = 0 is just that, and m = m0 e^(2a).
Source: C. Rucker, P. Wensing, "Smooth parameterization of rigid-body inertia", IEEE Robotics and Automation Letters 7 (2022).
"""

from __future__ import annotations

import numpy as np

from flexinv.typing import Array

NAMES = ("a", "d1", "d2", "d3", "s12", "s23", "s13", "t1", "t2", "t3")
# Rows and columns of the tensor in the order of `flexinv.rigid.torque_regressor`: xx, xy, yy, xz, yz, zz.
ROWS = [0, 0, 1, 0, 1, 2]
COLUMNS = [0, 1, 1, 2, 2, 2]
# Rows and columns of U at which the numbers behind a stand.
ENTRY_ROWS = [0, 1, 2, 0, 1, 0, 0, 1, 2]
ENTRY_COLUMNS = [0, 1, 2, 1, 2, 2, 3, 3, 3]
QUANTITIES = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
SHAPE = 0.5  # largest relative error of radii of gyration, and of the tangents of their axes' directions
UNITS = ("kg", "m", "m", "m", *("kg m^2",) * 6)


def compute_pseudo_inertia(ten: Array) -> Array:
    """Return P (4, 4) [kg m^2], [kg m], [kg] of m, h, I (10,) about the frame's origin."""
    tensor = np.zeros((3, 3))
    tensor[ROWS, COLUMNS] = tensor[COLUMNS, ROWS] = ten[4:]
    out = np.zeros((4, 4))
    out[:3, :3] = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    out[:3, 3] = out[3, :3] = ten[1:4]
    out[3, 3] = ten[0]
    return out


def compute_ten_parameters(pseudo: Array) -> Array:
    """Return m [kg], h [kg m], I [kg m^2] (..., 10) of pseudo-inertias (..., 4, 4)."""
    spread = pseudo[..., :3, :3]
    tensor = np.trace(spread, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - spread
    return np.concatenate([pseudo[..., 3:, 3], pseudo[..., :3, 3], tensor[..., ROWS, COLUMNS]], axis=-1)


def compute_upper_factor(pseudo: Array) -> Array:
    """Return the upper triangular L (4, 4) [any unit] with P = L L^T."""
    flip = pseudo[::-1, ::-1]
    return np.asarray(np.linalg.cholesky(flip)[::-1, ::-1])


def make_plausible(ten: Array, radius: float) -> Array:
    """Return mass properties (10,) [kg], [kg m], [kg m^2] whose mass is nowhere closer together than a radius of gyration [m].

    A point mass has no inertia of its own, and no logarithm: S about the centre of mass is raised to m radius^2 / 3 per axis.
    """
    pseudo = compute_pseudo_inertia(ten)
    mass = pseudo[3, 3]
    h = pseudo[:3, 3]
    spread = pseudo[:3, :3] - np.outer(h, h) / mass
    values, vectors = np.linalg.eigh(spread)
    raised = vectors @ np.diag(np.maximum(values, mass * radius**2 / 3.0)) @ vectors.T
    pseudo[:3, :3] = raised + np.outer(h, h) / mass
    return compute_ten_parameters(pseudo)


def move_mass_properties(factor: Array, x: Array) -> Array:
    """Return mass properties (..., 10) [kg], [kg m], [kg m^2] for x (..., 10) [-] as ``NAMES``; factor : L (4, 4)."""
    half = factor @ _compute_upper_factors(x) * np.exp(x[..., 0])[..., None, None]
    return compute_ten_parameters(half @ np.swapaxes(half, -1, -2))


def _compute_upper_factors(x: Array) -> Array:
    """U (..., 4, 4) without e^a [-]."""
    u = np.zeros((*x.shape[:-1], 4, 4))
    u[..., ENTRY_ROWS, ENTRY_COLUMNS] = x[..., 1:]
    u[..., [0, 1, 2], [0, 1, 2]] = np.exp(x[..., 1:4])
    u[..., 3, 3] = 1.0
    return u


def compute_mass_property_slopes(factor: Array, x: Array) -> Array:
    """Return the slopes (..., 10, 10) of `move_mass_properties` by x (..., 10) [-]; factor : L (4, 4).

    ``dP / dx = L (dU U^T + U dU^T) L^T``, each dU an entry of U; ``dP / da = 2 P``.
    """
    u = _compute_upper_factors(x)
    out = np.zeros((*x.shape, len(NAMES)))
    out[..., :, 0] = 2.0 * move_mass_properties(factor, x)
    scale = np.exp(2.0 * x[..., :1, None])
    for k, (row, column) in enumerate(zip(ENTRY_ROWS, ENTRY_COLUMNS, strict=True), start=1):
        turned = np.zeros_like(u)
        turned[..., row, :] = u[..., :, column]  # dU U^T, of an entry of 1
        if row == column:
            turned[..., row, :] *= u[..., row, row, None]  # which is e^d
        half = factor @ turned @ factor.T
        out[..., :, k] = compute_ten_parameters(scale * (half + np.swapaxes(half, -1, -2)))
    return out


def compute_prior_errors(factor: Array, relative: float, shape: float = SHAPE) -> Array:
    """Return standard errors (10,) [-] of x for a relative error of the mass: of radii the same, of the centre a third.

    The centre of mass is believed to a third of ``relative`` times its distance from the frame and the radius of gyration.
    Radii and the directions of axes are never less certain than ``shape``: a body of twelve times the mass is not twelve times as
    wide, at one density its radii grow with the cube root, 2.3.
    """
    pseudo = factor @ factor.T
    mass = pseudo[3, 3]
    com = pseudo[:3, 3] / mass
    radius = np.diag(factor)[:3] / np.sqrt(mass)
    shift = relative / 3.0 * (np.linalg.norm(com) + radius) / radius
    return np.concatenate([[relative / 2.0], [min(relative, shape)] * 6, shift])


def convert_to_com(ten: Array) -> Array:
    """Return mass [kg], centre of mass [m] and inertia about it [kg m^2], (..., 10), of m, h, I (..., 10) about the origin."""
    mass = ten[..., :1]
    c = ten[..., 1:4] / ten[..., :1]
    outer = c[..., :, None] * c[..., None, :]
    steiner = np.trace(outer, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - outer
    return np.concatenate([mass, c, ten[..., 4:] - mass * steiner[..., ROWS, COLUMNS]], axis=-1)
