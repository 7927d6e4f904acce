"""Beams whose strains and masses are coupled, and what linear theory says of them exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg
from flexible_examples import clamped

from flexinv.model.mechanism import Beam, Mechanism, Section
from flexinv.typing import Array

E1 = np.array([1.0, 0.0, 0.0])
# Strengths of a soft strip: strains of some per cent are forces of some newtons, so that no difference of large numbers is left.
DIAGONAL = np.array([90.0, 40.0, 30.0, 0.5, 0.8, 0.6])
NONE = np.zeros((6, 6))


def skew(a: Array) -> Array:
    return np.asarray(np.cross(np.eye(3), a))


def couple(*entries: tuple[int, int, float]) -> Array:
    """The stiffness with parts of the geometric mean of two strengths as couplings."""
    c = np.diag(DIAGONAL)
    for i, j, part in entries:
        c[i, j] = c[j, i] = part * np.sqrt(DIAGONAL[i] * DIAGONAL[j])
    return c


BEND_TWIST = couple((3, 4, 0.4))
EXTENSION_TWIST = couple((0, 3, -0.5))


def full(seed: int = 0, part: float = 0.25) -> Array:
    """A stiffness in which every strain has stress of every other."""
    dice = np.random.default_rng(seed).uniform(-part, part, size=(6, 6))
    root = np.sqrt(np.diag(DIAGONAL))
    return np.asarray(root @ (np.eye(6) + (dice + dice.T) / 2.0 * (1.0 - np.eye(6))) @ root)


def mass_about(y: float, z: float, mass: float = 0.4, product: float = 2e-4) -> Array:
    """M of a flat section with its centre off the axis, and a product of inertia."""
    c = skew(np.array([0.0, y, z]))
    own = np.array([[9e-4, 0.0, 0.0], [0.0, 5e-4, product], [0.0, product, 4e-4]])
    return np.block([[mass * np.eye(3), -mass * c], [mass * c, own - mass * c @ c]])


def section(stiffness: Array, mass: Array | None = None, damping: Array | None = None) -> Section:
    m = mass_about(0.0, 0.0, product=0.0) if mass is None else mass
    lost = None if damping is None else damping[None]
    return Section.build_from_matrices(np.zeros(1), stiffness[None], m[None], lost)


def cantilever(own: Section, order: int = 8, elements: int = 1, length: float = 1.0) -> Mechanism:
    return clamped(Beam(length, own), elements, order)


def find_linear_tip(compliance: Array, wrench: Array, length: float) -> Array:
    """Displacement [m] and rotation [rad] of the tip under a small wrench there: strains C^-1 (F, M + (L - s) e1 x F) summed up.

    theta' = kappa,  u' = gamma + theta x e1: the second integral is that of (L - s) kappa x e1.
    """
    nodes, weights = np.polynomial.legendre.leggauss(4)  # exact to order 7; the integrand is of order 2
    tip = np.zeros(6)
    for s, w in zip(length / 2 * (1 + nodes), length / 2 * weights, strict=True):
        moment = wrench[3:] + (length - s) * np.cross(E1, wrench[:3])
        strain = compliance @ np.concatenate([wrench[:3], moment])
        tip[:3] += w * (strain[:3] + (length - s) * np.cross(strain[3:], E1))
        tip[3:] += w * strain[3:]
    return tip


def compute_frequency_function(stiffness: Array, mass: Array, length: float, omega: float) -> float:
    """Zero at the natural frequencies [rad/s] of a clamped beam: det of what the root's wrench makes of the tip's.

    u' = gamma + theta x e1,  theta' = kappa,  (gamma, kappa) = C^-1 (F, m)
    F' = -omega^2 (M v)_1,  m' = -e1 x F - omega^2 (M v)_2
    """
    carried = np.block([[np.zeros((3, 3)), -skew(E1)], [np.zeros((3, 6))]])
    lever = np.block([[np.zeros((3, 6))], [-skew(E1), np.zeros((3, 3))]])
    a = np.block([[carried, np.linalg.inv(stiffness)], [-(omega**2) * mass, lever]])
    return float(np.linalg.det(scipy.linalg.expm(length * a)[6:, 6:]))


def turned_about_x(angle: float) -> Array:
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def with_beams(mechanism: Mechanism, own: Section) -> Mechanism:
    """The mechanism with another section of all its beams."""
    links = (one if one.beam is None else replace(one, beam=replace(one.beam, section=own)) for one in mechanism.links)
    return replace(mechanism, links=tuple(links))
