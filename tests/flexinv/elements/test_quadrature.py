"""Tables of the reference element: they integrate and interpolate what they must, and prove it themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexinv.elements.quadrature import MAXIMAL_ORDER, build_reference, compute_gauss_lobatto, evaluate_lagrange
from flexinv.errors import InputError

ORDERS = (1, 2, 3, 4, 7, 12, MAXIMAL_ORDER)
EPS = np.finfo(float).eps


def test_known_tables() -> None:
    """Canuto et al., Spectral Methods, 2006, table 2.3."""
    for order, nodes, weights in (
        (1, [-1, 1], [1, 1]),
        (2, [-1, 0, 1], [1 / 3, 4 / 3, 1 / 3]),
        (3, [-1, -np.sqrt(0.2), np.sqrt(0.2), 1], [1 / 6, 5 / 6, 5 / 6, 1 / 6]),
        (4, [-1, -np.sqrt(3 / 7), 0, np.sqrt(3 / 7), 1], [1 / 10, 49 / 90, 32 / 45, 49 / 90, 1 / 10]),
    ):
        got = compute_gauss_lobatto(order)
        np.testing.assert_allclose(
            got, (nodes, weights), rtol=0, atol=8 * EPS
        )  # roots polished to an ulp, weights follow


@pytest.mark.parametrize("order", ORDERS)
def test_both_rules_integrate_polynomials_of_degree_2p_minus_1(order: int) -> None:
    ref = build_reference(order)
    for x, w in ((ref.nodes, ref.weights), (ref.points, ref.point_weights)):
        for k in range(2 * order):
            # p + 1 terms, each with a node known to an ulp raised to k
            assert w @ x**k == pytest.approx((1 + (-1) ** k) / (k + 1), abs=2 * (order + k) * EPS)


@pytest.mark.parametrize("order", ORDERS)
def test_neither_rule_integrates_more(order: int) -> None:
    """The error of x^2p is that of theory (Gauss), and of the other sign for Lobatto: the check above can fail."""
    ref = build_reference(order)
    k, exact = 2 * order, 2 / (2 * order + 1)
    if order <= 12:  # beyond, the error of the rule is below rounding
        assert ref.point_weights @ ref.points**k < exact - 1e-9
        assert ref.weights @ ref.nodes**k > exact + 1e-9


@pytest.mark.parametrize("order", ORDERS)
def test_lagrange_is_nodal_and_a_partition_of_unity(order: int) -> None:
    ref = build_reference(order)
    value, slope = evaluate_lagrange(ref.nodes, ref.nodes)
    np.testing.assert_array_equal(value, np.eye(order + 1))
    # sums of p + 1 polynomials of size one, slopes of size p^2
    np.testing.assert_allclose(ref.shape.sum(axis=1), 1.0, atol=4 * (order + 1) * EPS)
    np.testing.assert_allclose(ref.slope.sum(axis=1), 0.0, atol=4 * (order + 1) * order**2 * EPS)
    np.testing.assert_allclose(slope.sum(axis=1), 0.0, atol=4 * (order + 1) * order**2 * EPS)


def test_nodes_are_exactly_antisymmetric() -> None:
    for order in ORDERS:
        np.testing.assert_array_equal(build_reference(order).nodes, -build_reference(order).nodes[::-1])


@pytest.mark.parametrize("order", [0, -1, MAXIMAL_ORDER + 1])
def test_other_orders_are_refused(order: int) -> None:
    with pytest.raises(InputError, match=f"order = {order}: expected 1 to {MAXIMAL_ORDER}"):
        build_reference(order)


@pytest.mark.parametrize("table", ["weights", "point_weights", "nodes", "points", "shape", "slope"])
def test_a_wrong_table_refuses_to_be_built(table: str) -> None:
    ref = build_reference(3)
    wrong = getattr(ref, table).copy()
    wrong.flat[1] += 1e-9
    with pytest.raises(AssertionError):
        replace(ref, **{table: wrong})
