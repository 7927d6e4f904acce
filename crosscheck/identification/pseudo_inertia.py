"""Mass properties as ten unbounded numbers: every value of them is a body that can be (log-Cholesky of the pseudo-inertia).

    P = [[S, h], [h^T, m]] = (L U) (L U)^T,   S = tr(I)/2 - I   (I about the frame's origin, h = m c)
    U = e^a [[e^d1, s12, s13, t1], [0, e^d2, s23, t2], [0, 0, e^d3, t3], [0, 0, 0, 1]]

L is the upper triangular factor of what is known before, so that a = d = s = t = 0 is just that, and m = m0 e^(2a).
Source: C. Rucker, P. Wensing, "Smooth parameterization of rigid-body inertia", IEEE Robotics and Automation Letters 7 (2022).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.typing import Array

NAMES = ("a", "d1", "d2", "d3", "s12", "s23", "s13", "t1", "t2", "t3")
# Rows and columns of the tensor in the order of `flexinv.rigid.torque_regressor`: xx, xy, yy, xz, yz, zz.
ROWS = [0, 0, 1, 0, 1, 2]
COLUMNS = [0, 1, 1, 2, 2, 2]
# Rows and columns of U at which the numbers behind a stand.
ENTRY_ROWS = [0, 1, 2, 0, 1, 0, 0, 1, 2]
ENTRY_COLUMNS = [0, 1, 2, 1, 2, 2, 3, 3, 3]
# The same with the 1 in its corner.
UPPER_ROWS = [*ENTRY_ROWS, 3]
UPPER_COLUMNS = [*ENTRY_COLUMNS, 3]
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


@dataclass(frozen=True)
class MassPropertyMap:
    """The mass properties of some links as functions of their ten numbers, for many values of them at once.

    They are quadratic in the entries u of U (those of ``NAMES``, and the 1 in its corner), with J_pk = sum_e u_e G_epk:

        (m, h, I)_p = e^(2a) / 2 sum_k J_pk u_k,     d(m, h, I)_p / du_k = e^(2a) J_pk

    products : G (links, entries, properties, entries) [kg], [kg m], [kg m^2]
    """

    products: Array

    @classmethod
    def build_for(cls, factors: Array) -> MassPropertyMap:
        """Return the map of links whose known mass properties have the factors L (links, 4, 4)."""
        single = np.zeros((len(UPPER_ROWS), 4, 4))
        single[np.arange(len(UPPER_ROWS)), UPPER_ROWS, UPPER_COLUMNS] = 1.0
        one_sided = np.einsum("eij,klj->ekil", single, single)
        both = one_sided + np.swapaxes(one_sided, -1, -2)  # E_e E_k^T + E_k E_e^T
        turned = factors[:, None, None] @ both @ np.swapaxes(factors, -1, -2)[:, None, None]
        return cls(np.ascontiguousarray(np.swapaxes(compute_ten_parameters(turned), -1, -2)))

    def move(self, x: Array) -> Array:
        """Return mass properties (samples, links, 10) [kg], [kg m], [kg m^2] for x (samples, links, 10) [-] as ``NAMES``."""
        entries, slopes = self._evaluate(x)
        return np.asarray(0.5 * np.einsum("slpk,slk->slp", slopes, entries))

    def compute_slopes(self, x: Array) -> Array:
        """Return the slopes (samples, links, 10, 10) of `move` by x (samples, links, 10) [-]."""
        entries, slopes = self._evaluate(x)
        out = np.empty_like(slopes)
        out[..., 0] = np.einsum("slpk,slk->slp", slopes, entries)  # twice the value, by a
        out[..., 1:] = slopes[..., :-1]
        out[..., 1:4] *= entries[..., None, :3]  # e^d, of the logarithms d
        return out

    def _evaluate(self, x: Array) -> tuple[Array, Array]:
        """Entries u (samples, links, 10), and e^(2a) J (samples, links, 10, 10)."""
        entries = np.concatenate([np.exp(x[..., 1:4]), x[..., 4:], np.ones_like(x[..., :1])], axis=-1)
        scaled = np.exp(2.0 * x[..., :1]) * entries
        count = len(UPPER_ROWS)
        products = self.products.reshape(len(self.products), count, count * count)
        slopes = np.swapaxes(scaled, 0, 1) @ products  # (links, samples, properties times entries)
        return entries, np.swapaxes(slopes, 0, 1).reshape(*x.shape[:-1], count, count)


def move_mass_properties(factor: Array, x: Array) -> Array:
    """Return mass properties (..., 10) [kg], [kg m], [kg m^2] of one link for x (..., 10) [-] as ``NAMES``; factor : L (4, 4)."""
    moved = MassPropertyMap.build_for(factor[None]).move(x.reshape(-1, 1, len(NAMES)))
    return moved.reshape(x.shape)


def compute_prior_errors(factor: Array, relative: float, shape: float = SHAPE, turn: float = SHAPE) -> Array:
    """Return standard errors (10,) [-] of x for a relative error of the mass: of radii the same, of the centre a third.

    The centre of mass is believed to a third of ``relative`` times its distance from the frame and the radius of gyration.
    Radii are never less certain than ``shape``, nor the directions of axes than ``turn``: a body of twelve times the mass is not
    twelve times as wide, at one density its radii grow with the cube root, 2.3.
    """
    pseudo = factor @ factor.T
    mass = pseudo[3, 3]
    com = pseudo[:3, 3] / mass
    radius = np.diag(factor)[:3] / np.sqrt(mass)
    shift = relative / 3.0 * (np.linalg.norm(com) + radius) / radius
    return np.concatenate([[relative / 2.0], [min(relative, shape)] * 3, [min(relative, turn)] * 3, shift])


def convert_to_com(ten: Array) -> Array:
    """Return mass [kg], centre of mass [m] and inertia about it [kg m^2], (..., 10), of m, h, I (..., 10) about the origin."""
    mass = ten[..., :1]
    c = ten[..., 1:4] / ten[..., :1]
    outer = c[..., :, None] * c[..., None, :]
    steiner = np.trace(outer, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - outer
    return np.concatenate([mass, c, ten[..., 4:] - mass * steiner[..., ROWS, COLUMNS]], axis=-1)
