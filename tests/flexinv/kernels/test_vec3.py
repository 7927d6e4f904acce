"""Small vectors and matrices as tuples do what NumPy does with arrays."""

from __future__ import annotations

import numpy as np

from flexinv.kernels import vec3 as v
from flexinv.kernels.jit import jit
from flexinv.kernels.vec3 import (
    add,
    add_at,
    add_pair,
    add_scaled,
    add_to,
    apply,
    block,
    cross,
    diagonal,
    dot,
    dot_pair,
    madd,
    mat,
    mat_at,
    mscale,
    msub,
    mul,
    outer,
    pair,
    pair_at,
    put,
    put_at,
    put_block,
    put_mat,
    put_pair,
    rows,
    scale,
    skew,
    sub,
    sum3,
    tapply,
    tapply_pair,
    times,
    tmul,
    transpose,
    vec,
    vec_at,
)

# Entries are below 3 in size: sums of at most three products of three factors, an ulp each.
ROUNDING = 3 * 27 * np.finfo(float).eps


@jit
def every_vector(a, b, c, m, k, out):
    """One row of ``out`` for every function that gives a vector; ``dot`` in the last."""
    x, y, z, square = vec(a), vec(b), vec(c), mat(m)
    put(out[0], add(x, y))
    put(out[1], sub(x, y))
    put(out[2], sum3(x, y, z))
    put(out[3], scale(k, x))
    put(out[4], add_scaled(x, k, y))
    put(out[5], times(x, y))
    put(out[6], cross(x, y))
    put(out[7], apply(square, x))
    put(out[8], tapply(square, x))
    put(out[9], vec_at(c, 1))
    add_to(out[10], x)
    add_to(out[10], y)
    out[11, 0] = dot(x, y)


@jit
def every_pair(a, b, six, m, out):
    """Rows of ``out`` for every function of pairs of vectors; ``dot_pair`` in the last."""
    one = pair(six)
    put_pair(out[0], one[0], one[1])
    other = pair_at(six, 1)
    put_pair(out[1], other[0], other[1])
    turned = tapply_pair(mat(m), (vec(a), vec(b)))
    put_pair(out[2], turned[0], turned[1])
    out[3, 0] = dot_pair((vec(a), vec(b)), one)


@jit
def every_matrix(a, b, m, n, k, flat, out):
    """One (3, 3) block of ``out`` for every function that gives a matrix."""
    x, y, p, q = vec(a), vec(b), mat(m), mat(n)
    put_block(out[0], 0, 0, skew(x))
    put_block(out[1], 0, 0, diagonal(k))
    put_block(out[2], 0, 0, transpose(p))
    put_block(out[3], 0, 0, outer(x, y))
    put_block(out[4], 0, 0, madd(p, q))
    put_block(out[5], 0, 0, msub(p, q))
    put_block(out[6], 0, 0, mscale(k, p))
    put_block(out[7], 0, 0, rows(x, p))
    put_block(out[8], 0, 0, mul(p, q))
    put_block(out[9], 0, 0, tmul(p, q))
    put_block(out[10], 0, 0, block(n, 0, 0))
    put_mat(out[11], mat_at(flat, 1))


@jit
def every_place(a, b, out):
    """One row of ``out`` for every function that writes elsewhere than into a row's first three entries."""
    x, y = vec(a), vec(b)
    put_at(out[0], 2, x)
    put_pair(out[1], x, y)
    add_at(out[2], 1, x)
    add_at(out[2], 1, y)
    add_pair(out[3], x, y)
    add_pair(out[3], y, x)


def test_vectors_equal_numpy() -> None:
    rng = np.random.default_rng(1)
    (a, b), c, m, k = rng.normal(size=(2, 3)), rng.normal(size=4), rng.normal(size=(3, 3)), 1.7
    out = np.zeros((12, 3))
    every_vector(a, b, c, m, k, out)
    expected = [
        a + b, a - b, a + b + c[:3], k * a, a + k * b, a * b, np.cross(a, b), m @ a, m.T @ a, c[1:], a + b, [a @ b, 0, 0],
    ]  # fmt: skip
    np.testing.assert_allclose(out, expected, rtol=0, atol=ROUNDING)


def test_matrices_equal_numpy() -> None:
    rng = np.random.default_rng(2)
    (a, b), (m, n), k = rng.normal(size=(2, 3)), rng.normal(size=(2, 3, 3)), -0.6
    flat, out = rng.normal(size=10), np.zeros((12, 3, 3))
    every_matrix(a, b, m, n, k, flat, out)
    expected = [
        np.cross(a, np.eye(3)).T, k * np.eye(3), m.T, np.outer(a, b), m + n, m - n, k * m, np.diag(a) @ m, m @ n, m.T @ n, n,
        flat[1:].reshape(3, 3),
    ]  # fmt: skip
    np.testing.assert_allclose(out, expected, rtol=0, atol=ROUNDING)


def test_vectors_are_written_where_they_belong() -> None:
    a, b = np.random.default_rng(3).normal(size=(2, 3))
    out = np.zeros((4, 7))
    every_place(a, b, out)
    expected = np.zeros((4, 7))
    expected[0, 2:5] = a
    expected[1, :6] = [*a, *b]
    expected[2, 1:4] = a + b
    expected[3, :6] = [*(a + b), *(a + b)]
    np.testing.assert_allclose(out, expected, rtol=0, atol=ROUNDING)


def test_pairs_equal_numpy() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(2, 3))
    six, m, out = rng.normal(size=7), rng.normal(size=(3, 3)), np.zeros((4, 6))
    every_pair(a, b, six, m, out)
    both = np.concatenate([a, b])
    turned = np.concatenate([m.T @ a, m.T @ b])
    expected = [six[:6], six[1:], turned, [both @ six[:6], 0, 0, 0, 0, 0]]
    np.testing.assert_allclose(out, expected, rtol=0, atol=2 * ROUNDING)  # of twice as many products


def test_every_function_is_here() -> None:
    """A function that is added to the module without a test is found."""
    own = {
        name for name, f in vars(v).items() if getattr(f, "__module__", "") == v.__name__ and not name.startswith("_")
    }
    assert own <= set(globals()), own - set(globals())
