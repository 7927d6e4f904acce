"""Single vectors and 3 x 3 matrices in compiled code: a vector is a tuple of three floats, a matrix one of three rows.

Tuples live in registers: no allocation, no loops.  `vec` and `mat` read them from arrays, `put` and `put_block` write.
"""

from __future__ import annotations

from flexinv.kernels.jit import jit_vector

ZERO = (0.0, 0.0, 0.0)
EYE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@jit_vector
def vec(a):
    """Return the first three entries of a one-dimensional array [any unit]."""
    return a[0], a[1], a[2]


@jit_vector
def vec_at(a, first):
    """Return three entries of a one-dimensional array from ``first`` on [any unit]."""
    return a[first], a[first + 1], a[first + 2]


@jit_vector
def pair_at(a, first):
    """Return two vectors, as of a wrench, from six entries of a one-dimensional array from ``first`` on [any unit]."""
    return vec_at(a, first), vec_at(a, first + 3)


@jit_vector
def pair(a):
    """Return two vectors, as of a wrench, from the first six entries of a one-dimensional array [any unit]."""
    return pair_at(a, 0)


@jit_vector
def mat(a):
    """Return a (3, 3) array as rows [any unit]."""
    return (a[0, 0], a[0, 1], a[0, 2]), (a[1, 0], a[1, 1], a[1, 2]), (a[2, 0], a[2, 1], a[2, 2])


@jit_vector
def mat_at(a, first):
    """Return nine entries of a one-dimensional array from ``first`` on as rows [any unit]."""
    return vec_at(a, first), vec_at(a, first + 3), vec_at(a, first + 6)


@jit_vector
def put_at(a, first, v):
    """Write a vector into a one-dimensional array from ``first`` on [any unit]."""
    a[first], a[first + 1], a[first + 2] = v


@jit_vector
def put(a, v):
    """Write a vector into the first three entries of a one-dimensional array [any unit]."""
    put_at(a, 0, v)


@jit_vector
def put_pair(a, v, w):
    """Write two vectors, as of a wrench, into the first six entries of a one-dimensional array [any unit]."""
    put_at(a, 0, v)
    put_at(a, 3, w)


@jit_vector
def add_at(a, first, v):
    """Add a vector to three entries of a one-dimensional array [any unit]."""
    a[first] += v[0]
    a[first + 1] += v[1]
    a[first + 2] += v[2]


@jit_vector
def add_to(a, v):
    """Add a vector to the first three entries of a one-dimensional array [any unit]."""
    add_at(a, 0, v)


@jit_vector
def add_pair(a, v, w):
    """Add two vectors, as of a wrench, to the first six entries of a one-dimensional array [any unit]."""
    add_at(a, 0, v)
    add_at(a, 3, w)


@jit_vector
def put_block(a, row, column, m):
    """Write a matrix into a two-dimensional array at ``row``, ``column`` [any unit]."""
    put_at(a[row], column, m[0])
    put_at(a[row + 1], column, m[1])
    put_at(a[row + 2], column, m[2])


@jit_vector
def put_mat(a, m):
    """Write a matrix into the first three rows and columns of a two-dimensional array [any unit]."""
    put_block(a, 0, 0, m)


@jit_vector
def block(a, row, column):
    """Return the matrix at ``row``, ``column`` of a two-dimensional array [any unit]."""
    return vec_at(a[row], column), vec_at(a[row + 1], column), vec_at(a[row + 2], column)


@jit_vector
def add(a, b):
    """Return a + b [any unit]."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@jit_vector
def sub(a, b):
    """Return a - b [any unit]."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@jit_vector
def sum3(a, b, c):
    """Return a + b + c [any unit]."""
    return a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]


@jit_vector
def scale(k, a):
    """Return k a for a number k [any unit]."""
    return k * a[0], k * a[1], k * a[2]


@jit_vector
def add_scaled(a, k, b):
    """Return a + k b for a number k [any unit]."""
    return a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]


@jit_vector
def times(a, b):
    """Return diag(a) b, the products entry by entry [any unit]."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@jit_vector
def dot(a, b):
    """Return a . b [any unit]."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit_vector
def dot_pair(a, b):
    """Return the product of two pairs of vectors, as the power of a wrench and a motion [any unit]."""
    return dot(a[0], b[0]) + dot(a[1], b[1])


@jit_vector
def cross(a, b):
    """Return a x b [any unit]."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jit_vector
def skew(a):
    """Return the matrix of a x [any unit]."""
    return (0.0, -a[2], a[1]), (a[2], 0.0, -a[0]), (-a[1], a[0], 0.0)


@jit_vector
def diagonal(k):
    """Return k times the unit matrix [any unit]."""
    return (k, 0.0, 0.0), (0.0, k, 0.0), (0.0, 0.0, k)


@jit_vector
def transpose(a):
    """Return a^T [any unit]."""
    return (a[0][0], a[1][0], a[2][0]), (a[0][1], a[1][1], a[2][1]), (a[0][2], a[1][2], a[2][2])


@jit_vector
def outer(a, b):
    """Return a b^T [any unit]."""
    return scale(a[0], b), scale(a[1], b), scale(a[2], b)


@jit_vector
def madd(a, b):
    """Return a + b for matrices [any unit]."""
    return add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2])


@jit_vector
def msub(a, b):
    """Return a - b for matrices [any unit]."""
    return sub(a[0], b[0]), sub(a[1], b[1]), sub(a[2], b[2])


@jit_vector
def mscale(k, a):
    """Return k a for a number k and a matrix [any unit]."""
    return scale(k, a[0]), scale(k, a[1]), scale(k, a[2])


@jit_vector
def rows(c, a):
    """Return diag(c) a: the rows of a matrix times the entries of a vector [any unit]."""
    return scale(c[0], a[0]), scale(c[1], a[1]), scale(c[2], a[2])


@jit_vector
def apply(a, v):
    """Return a v for a matrix and a vector [any unit]."""
    return dot(a[0], v), dot(a[1], v), dot(a[2], v)


@jit_vector
def tapply(a, v):
    """Return a^T v for a matrix and a vector [any unit]."""
    return (
        a[0][0] * v[0] + a[1][0] * v[1] + a[2][0] * v[2],
        a[0][1] * v[0] + a[1][1] * v[1] + a[2][1] * v[2],
        a[0][2] * v[0] + a[1][2] * v[1] + a[2][2] * v[2],
    )


@jit_vector
def tapply_pair(a, v):
    """Return a^T v for a matrix and a pair of vectors: a wrench or a motion along the axes of a frame [any unit]."""
    return tapply(a, v[0]), tapply(a, v[1])


@jit_vector
def mul(a, b):
    """Return a b for matrices [any unit]."""
    return tapply(b, a[0]), tapply(b, a[1]), tapply(b, a[2])


@jit_vector
def tmul(a, b):
    """Return a^T b for matrices [any unit]."""
    return mul(transpose(a), b)
