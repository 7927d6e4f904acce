"""Gauss-Legendre and Gauss-Lobatto-Legendre points, and the Lagrange polynomials of one spectral element."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from flexinv.errors import InputError
from flexinv.model.owned_cache import make_read_only
from flexinv.typing import Array

MAXIMAL_ORDER = 40  # beyond this nodes crowd so closely at the ends that more elements are always the better choice


@dataclass(frozen=True)
class Reference:
    """The reference element on [-1, 1] of one polynomial order p.

    nodes, weights : (p+1,) Gauss-Lobatto points and weights [-]: degrees of freedom and lumped mass
    points, point_weights : (p,) Gauss points and weights [-]: where strains are taken (one fewer: no shear locking)
    shape, slope : (p, p+1) Lagrange polynomials and their derivatives at the Gauss points [-]
    """

    order: int
    nodes: Array
    weights: Array
    points: Array
    point_weights: Array
    shape: Array
    slope: Array

    def __post_init__(self) -> None:
        """Prove the tables: both rules integrate, and the polynomials interpolate, what they must."""
        p = self.order
        for x, w in ((self.nodes, self.weights), (self.points, self.point_weights)):
            for k in range(2 * p):  # Lobatto with p + 1 points and Gauss with p are both exact to degree 2 p - 1
                # rounding: p+1 terms of size <= 1, each node known to an ulp times k
                assert abs(w @ x**k - (1 + (-1) ** k) / (k + 1)) < 1e-13, (p, k)
        # differentiation at Gauss points is exact for x^p; conditioning of Lagrange slopes grows like p^2
        assert np.allclose(self.shape @ self.nodes**p, self.points**p, rtol=0, atol=1e-13 * p)
        assert np.allclose(self.slope @ self.nodes**p, p * self.points ** (p - 1), rtol=0, atol=1e-13 * p**3)


def compute_gauss_lobatto(order: int) -> tuple[Array, Array]:
    """Return the order + 1 Gauss-Lobatto-Legendre nodes and weights [-] on [-1, 1].

    Nodes are the ends and the roots of P_p'; w_i = 2 / (p (p+1) P_p(x_i)^2): Canuto et al., *Spectral Methods*, 2006, (2.3.12).
    """
    basis = legendre.Legendre.basis(order)
    first = basis.deriv(1)
    second = basis.deriv(2)
    inner = np.sort(np.real(first.roots())) if order > 1 else np.empty(0)
    for _ in range(3):  # polish the companion-matrix roots to the last digit
        inner = inner - first(inner) / second(inner)
    x = np.concatenate([[-1.0], 0.5 * (inner - inner[::-1]), [1.0]])  # exactly antisymmetric
    return x, 2.0 / (order * (order + 1) * basis(x) ** 2)


def evaluate_lagrange(nodes: Array, x: Array) -> tuple[Array, Array]:
    """Return Lagrange polynomials on ``nodes`` and their derivatives at ``x``, each (len(x), len(nodes)) [-].

    By products, not through monomials: no cancellation at high order.
    """
    value = np.ones((len(x), len(nodes)))
    slope = np.zeros((len(x), len(nodes)))
    for i in range(len(nodes)):
        others = [k for k in range(len(nodes)) if k != i]
        scale = np.prod(nodes[i] - nodes[others])
        value[:, i] = np.prod(x[:, None] - nodes[others], axis=1) / scale
        for k in others:
            slope[:, i] += np.prod(x[:, None] - nodes[[m for m in others if m != k]], axis=1) / scale
    return value, slope


@cache
def build_reference(order: int) -> Reference:
    """Return the reference element of polynomial ``order`` [-], 1 to 40.  Raises InputError for any other order."""
    if not 1 <= order <= MAXIMAL_ORDER:
        raise InputError(f"order = {order}: expected 1 to {MAXIMAL_ORDER}; for more resolution write more elements")
    nodes, weights = compute_gauss_lobatto(order)
    points, point_weights = legendre.leggauss(order)
    return make_read_only(Reference(order, nodes, weights, points, point_weights, *evaluate_lagrange(nodes, points)))
