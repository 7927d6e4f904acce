"""All roots of (s^2 M + s C + K) x = 0, gyroscopic terms, damping and circulatory K among them, each with an error bar.

Of the motions without inertia (`split_by_inertia`) some have terms in C among each other, of dampers or gyroscopic
ones: x_d moves by its rate.  The others, x_e, follow: K_ee x_e = -(K_er x_r + K_ed x_d + C_er v), with v = x_r' of what has
inertia.  That is a pencil of first order, from which x_e is eliminated,

    A z = s B z     z = (x_r, x_d, x_e, v)     A = [[0, 0, 0, 1], [-K, -C_r]]     B = [[1, 0, 0, 0], [0, C_d, C_e, M_r]]

whose roots are all finite: none is thrown away.  They are found from both ends, and counted (`first_order`).
Each root is then corrected by its two vectors,

    s <- s - y^H P(s) x / (y^H P'(s) x)     P = s^2 M + s C + K

whose error is of second order, and known to a part of |y|^T (|s|^2 |M| + |s| |C| + |K|) |x| over |y^H P'(s) x|, or to what
vectors that are off leave of it (`root_discs`).  Of roots that
are not slow for what follows, as |s| times its time (C_ee over K_ee) is no rounding, x and y are of P(s) itself, by Newton:

    x <- P(s)^-1 P'(s) x     y <- P(s)^-H P'(s)^H y

Source: Tisseur, Meerbergen, *The quadratic eigenvalue problem*, SIAM Review 43(2), 2001, section 4.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.errors import InputError, ModelWarning
from flexinv.linearized.eigenvalues import (
    NO_STIFFNESS,
    Split,
    build_massless_elimination,
    compute_order,
    drop_rounded_parts,
    solve_held,
    split_by_inertia,
)
from flexinv.linearized.first_order import Corrected, PencilRoots, compute_lu_factors, find_all_roots, find_late
from flexinv.linearized.root_discs import ROUNDED_TERMS
from flexinv.typing import Array, Complex, Mask, RealOrComplex, Sparse

# Of the largest entry of C: what is below is rounding of terms that cancel, and a motion without inertia follows others.
NO_DAMPER = 1e-12
# Of C over K in periods of the fastest motion with inertia: what moves faster follows the others at once.
NO_TIME = 1e-7
# A correction that would bring a root nearer to the next one than this part of their distance is none.
NEAR_NEXT = 0.1
CORRECTIONS = 2
# A slope below this part of the terms says nothing.
SMALLEST_SLOPE = 1e-200
# Newton's method with both vectors triples the digits: from one, in so many steps, a change below this part of the root is left,
# or what rounding of P leaves of it.
MOST_NEWTON_STEPS = 8
NEWTON_CONVERGED = 1e-14
# Of the fastest motion with inertia: a shift whose square is what rounding of K leaves of a motion without stiffness.
SMALLEST_SHIFT = 1e-6


@dataclass(frozen=True)
class Roots:
    """Roots of a motion exp(root t), slowest first, of each pair the one with positive imaginary part.

    root : (modes,) [1/s]; shapes, left : (freedoms, modes) right and left vectors; bar : (modes,) rounding of each root [1/s]
    """

    root: Complex
    shapes: Complex
    left: Complex
    bar: Array


@dataclass(frozen=True)
class Pencil:
    """A - s B of what moves by itself, after the elimination of what follows.

    basis : (freedoms, own) motions with inertia, those that C moves, those that follow; massive, moved : how many
    a, b : (2 massive + moved, all) rows of what moves by itself; follow : z by its other part; held : K_ee
    smallest : shift [1/s]; lag : longest time in which motions follow, C_ee over K_ee [s]
    """

    basis: Array
    massive: int
    moved: int
    a: Array
    b: Array
    follow: Array
    held: Sparse
    smallest: float
    lag: float


def find_roots(mass: Sparse, damping: Sparse, stiffness: Sparse) -> Roots:
    """Return all roots [1/s] of (root^2 M + root C + K) x = 0, slowest first, with vectors and error bars.

    Raises InputError where a freedom has neither inertia nor stiffness.
    """
    parts = [scipy.sparse.csc_array(part) for part in (mass, damping, stiffness)]
    pencil = _build_pencil(*parts)
    if not len(pencil.a):
        none = np.zeros((len(pencil.basis), 0), dtype=complex)
        return Roots(np.zeros(0, dtype=complex), none, none, np.zeros(0))
    m, c, k = parts

    def compute_corrected_roots(values: PencilRoots, shift: float) -> Corrected:
        root, z, w = values
        x = pencil.basis @ (pencil.follow @ z)[: pencil.basis.shape[1]]
        y = pencil.basis @ _compute_left_vectors(pencil, root, w)
        late = find_late(root, pencil.lag)
        root, x, y, unknown = _update_roots_by_newton(parts, root, x, y, late)
        root, x, y, bar, lost = update_roots(parts, root, x, y, shift)
        return root, x, y, bar, lost + unknown

    matrices = pencil.a @ pencil.follow, pencil.b @ pencil.follow
    found = find_all_roots(
        *matrices, pencil.smallest, compute_corrected_roots, lambda s: s * s * m + s * c + k, pencil.lag
    )
    return match_conjugate_roots(*found)


def find_circulatory_modes(stiffness: Sparse, mass: Sparse) -> tuple[RealOrComplex, RealOrComplex, Array]:
    """Return omega^2 (modes,) [1/s^2], by size, shapes (freedoms, modes) with unit modal mass, and error bars of omega^2.

    K is not symmetric: forces that turn along do work on closed paths, and omega^2 may be complex, in pairs.  Values and shapes
    are complex then.  K - omega^2 M is a pencil of first order itself, and its roots are found and corrected as above.
    """
    moves = build_massless_elimination(stiffness, split_by_inertia(mass))
    back = build_massless_elimination(stiffness.T, split_by_inertia(mass))
    k, m = ((back.T @ part @ moves).toarray() for part in (stiffness, mass))
    smallest = SMALLEST_SHIFT**2 * np.abs(k).max(initial=0.0) / np.abs(m).max(initial=np.finfo(float).tiny) or 1.0
    parts = [0.0 * mass, -mass, stiffness]

    def compute_corrected_roots(values: PencilRoots, shift: float) -> Corrected:
        squared, right, left = values
        return update_roots(parts, squared, moves @ right, back @ left, shift)

    squared, right, _, bar, lost = find_all_roots(
        k, m, smallest, compute_corrected_roots, lambda z: stiffness - z * mass
    )
    squared, right = drop_rounded_parts(squared, right, bar)
    bar = bar + lost
    shapes = right / np.sqrt(np.einsum("km,km->m", right.conj(), mass @ right).real)
    order = compute_order(squared)
    squared = squared[order]
    shapes = shapes[:, order]
    return (squared, shapes, bar[order]) if squared.imag.any() else (squared.real, shapes.real, bar[order])


# ------------------------------------------------------------------------------------------------ of first order


def _build_pencil(mass: Sparse, damping: Sparse, stiffness: Sparse) -> Pencil:
    """A and B of the head of this file, and what follows, K_ee x_e = -(K_er x_r + K_ed x_d + C_er v)."""
    split = split_by_inertia(mass)
    moved, held = find_rate_driven_motions(split, damping, stiffness)
    basis = scipy.sparse.csc_array(scipy.sparse.hstack([split.massive, moved, held]))
    m, c, k = ((basis.T @ part @ basis).toarray() for part in (mass, damping, stiffness))
    r = split.massive.shape[1]
    size = basis.shape[1]
    first = r + moved.shape[1]
    a, b = np.zeros((2, size + r, size + r))
    a[:r, size:] = np.eye(r)
    a[r:, :size] = -k
    a[r:, size:] = -c[:, :r]
    b[:r, :r] = np.eye(r)
    b[r:, r:size] = c[:, r:]
    b[r:, size:] = m[:, :r]
    rest = np.concatenate([np.arange(first), np.arange(size, size + r)])
    follow = np.zeros((size + r, len(rest)))
    follow[rest, np.arange(len(rest))] = 1.0
    inner = scipy.sparse.csc_array(held.T @ stiffness @ held)
    lag = 0.0
    if held.shape[1]:
        follow[first:size] = solve_held(inner, a[r + first :][:, rest])
        lag = _find_longest_time(inner, c[first:, first:])
    smallest = SMALLEST_SHIFT * (float(np.sqrt(np.abs(k[:r, :r]).max(initial=0.0))) or 1.0)
    return Pencil(basis.toarray(), r, moved.shape[1], a[: r + first], b[: r + first], follow, inner, smallest, lag)


def _find_longest_time(stiffness: Sparse, damping: Array) -> float:
    """Longest of the times in which motions without inertia follow."""
    return float(np.abs(scipy.linalg.eigvals(solve_held(stiffness, damping))).max())


def find_rate_driven_motions(split: Split, damping: Sparse, stiffness: Sparse) -> tuple[Sparse, Sparse]:
    """Return bases of the motions without inertia that C [N m s] moves by their rates, and of those that follow others [-].

    Times are singular values of |K|^-1/2 C |K|^-1/2: stiffness that ties motions together makes a time long that C over the
    stiffness of each alone makes short.  What is of rounding, or beyond all that has inertia, follows: `update_roots` adds what
    that is off.  A ModelWarning says where rounding hides whether a motion has a root of its own.
    """
    none = split.massless
    if not none.shape[1]:
        return none, none
    c, k = (np.asarray(none.T @ (part @ none.toarray())) for part in (damping, stiffness))
    size = np.sqrt(np.abs(k).max(axis=1))
    if not size.all():
        raise InputError("modes: a freedom has neither inertia nor stiffness; give its link a mass")
    unit = k / size[:, None] / size
    stiff, turn = scipy.linalg.eigh((unit + unit.T) / 2)
    by_stiffness = turn / np.sqrt(np.where(np.abs(stiff) > NO_STIFFNESS, np.abs(stiff), 1.0))
    _, times, vectors = scipy.linalg.svd(by_stiffness.T @ (c / size[:, None] / size) @ by_stiffness)
    turned = by_stiffness @ vectors.T
    held = np.abs(split.massive.T @ (stiffness @ split.massive)).max() if split.massive.shape[1] else 0.0
    least = NO_TIME / np.sqrt(held) if held > 0.0 else 0.0
    across = (abs(none) @ np.abs(turned / size[:, None])).max(axis=0, initial=0.0)
    rounding = NO_DAMPER * np.abs(damping).max() * across**2
    moves = times > np.maximum(least, rounding)
    hidden = (times > least) & ~moves
    if held > 0.0 and hidden.any():
        _warn_of_hidden_roots(times[hidden])
    # any basis of what moves does, and one of unit columns loses no digits
    following = int((~moves).sum())
    every = scipy.linalg.qr(turned[:, ~moves])[0] if following else np.eye(len(turned))
    bases = every[:, following:], every[:, :following]
    by_rates, follows = (scipy.sparse.csc_array(none @ scipy.sparse.csc_array(part / size[:, None])) for part in bases)
    return by_rates, follows


def _warn_of_hidden_roots(times: Array) -> None:
    warnings.warn(
        f"modes: whether {len(times)} motion(s) without inertia have a root of their own, beyond "
        f"{1 / times.max():.3g} 1/s, is not known: their damping is rounding of that of others; they are taken to "
        "follow at once",
        ModelWarning,
        stacklevel=3,
    )


def _compute_left_vectors(pencil: Pencil, root: Complex, w: Complex) -> Complex:
    """Left vectors (own, roots) of P from those of the pencil: y_e of what follows by w^H (A - s B)_e + y_e^H A_ee = 0."""
    r = pencil.massive
    first = pencil.massive + pencil.moved
    size = pencil.basis.shape[1]
    out = np.zeros((size, len(root)), dtype=complex)
    out[:first] = w[r:]
    if size > first:
        across = pencil.a[:, first:size].T @ w - np.conj(root) * (pencil.b[:, first:size].T @ w)
        out[first:] = solve_held(pencil.held.T, across.real) + 1j * solve_held(pencil.held.T, across.imag)
    return out


# ------------------------------------------------------------------------------------------- corrections and bars


def _update_roots_by_newton(
    parts: list[Sparse], root: Complex, x: Complex, y: Complex, late: Mask
) -> tuple[Complex, Complex, Complex, Array]:
    """Return roots [1/s] with vectors of P(s) itself where they are ``late``, and how far they may be off where that fails [1/s].

    It fails where roots lie so close that it would lead to another one: such a root is not known.
    """
    out = root.copy()
    right = x.copy()
    left = y.copy()
    lost = np.zeros(len(root))
    m, c, k = (part.toarray() for part in parts)
    for i in np.flatnonzero(late):
        s = root[i]
        near = NEAR_NEXT * np.abs(np.delete(root, i) - s).min(initial=np.inf)
        lost[i] = np.abs(s)
        for _ in range(MOST_NEWTON_STEPS):
            slope = 2 * s * m + c
            factors = compute_lu_factors(s * s * m + s * c + k)
            right[:, i] = _scale_to_unit(scipy.linalg.lu_solve(factors, slope @ right[:, i]))
            left[:, i] = _scale_to_unit(scipy.linalg.lu_solve(factors, slope.conj().T @ left[:, i], trans=2))
            change = _compute_correction(parts, np.array([s]), right[:, [i]], left[:, [i]])[0]
            s = s - change
            if not np.abs(s - root[i]) < near:
                break
            known = compute_rounding_bars(parts, np.array([s]), right[:, [i]], left[:, [i]], 0.0)[0]
            if np.abs(change) <= max(NEWTON_CONVERGED * np.abs(s), known):
                out[i] = s
                lost[i] = 0.0
                break
        if lost[i]:
            right[:, i] = x[:, i]
            left[:, i] = y[:, i]
    return out, right, left, lost


def _scale_to_unit(vector: Complex) -> Complex:
    return vector / np.linalg.norm(vector)


def update_roots(parts: list[Sparse], root: Complex, x: Complex, y: Complex, shift: float) -> Corrected:
    """Return roots corrected by their vectors x and y of M, C, K, the vectors, bars of rounding, and what else is lost [1/s].

    A correction that leads to another root is none.  What is left of P(s) there is not known, and rounding of roots that lie
    together is the root of what P is known to, at the shift [1/s] about which they were found where they are slower: a motion
    without stiffness has nothing but rounding of that.
    """
    apart = np.abs(root[:, None] - root[None])
    apart[np.diag_indices(len(root))] = np.inf
    near = NEAR_NEXT * apart.min(axis=1, initial=np.inf)
    out = root.copy()
    left = np.zeros(len(root))
    good = np.ones(len(root), dtype=bool)
    for _ in range(CORRECTIONS + 1):
        change = _compute_correction(parts, out, x, y)
        good &= np.abs(out - change - root) < near
        left = np.abs(np.where(good, change, 0.0))
        out = np.where(good, out - change, out)
    lost = np.where(good, 0.0, _compute_root_change(parts, np.abs(_evaluate_residual(parts, out, x, y)), out, x, y))
    return out, x, y, compute_rounding_bars(parts, out, x, y, shift) + left, lost


def compute_rounding_bars(parts: list[Sparse], root: Complex, x: Complex, y: Complex, shift: float) -> Array:
    """Return bars (roots,) [1/s] of rounding of P, with vectors x and y, at the shift [1/s] where roots are slower."""
    s = np.maximum(np.abs(root), shift)
    size = [np.einsum("km,km->m", np.abs(y), abs(part) @ np.abs(x)) for part in parts]
    return _compute_root_change(parts, ROUNDED_TERMS * (s * s * size[0] + s * size[1] + size[2]), root, x, y)


def _compute_root_change(parts: list[Sparse], terms: Array, root: Complex, x: Complex, y: Complex) -> Array:
    """By how much a change of y^H P x by ``terms`` (roots,) moves roots [1/s]: of first order, of roots together of second."""
    slope = np.abs(2 * root * _compute_bilinear_form(y, parts[0], x) + _compute_bilinear_form(y, parts[1], x))
    first = _compute_quotient(terms, slope)
    second = np.sqrt(_compute_quotient(terms, np.abs(_compute_bilinear_form(y, parts[0], x))))
    return np.minimum(first, second)


def _compute_correction(parts: list[Sparse], s: Complex, x: Complex, y: Complex) -> Complex:
    """y^H P(s) x / (y^H P'(s) x) of each root; infinite where the slope is zero."""
    slope = 2 * s * _compute_bilinear_form(y, parts[0], x) + _compute_bilinear_form(y, parts[1], x)
    there = slope != 0.0
    return np.where(there, _evaluate_residual(parts, s, x, y) / np.where(there, slope, 1.0), np.inf)


def _evaluate_residual(parts: list[Sparse], s: Complex, x: Complex, y: Complex) -> Complex:
    """y^H P(s) x of each root."""
    m, c, k = (_compute_bilinear_form(y, part, x) for part in parts)
    return s * s * m + s * c + k


def _compute_quotient(terms: Array, slope: Array) -> Array:
    """A quotient, infinite where it cannot be written."""
    there = slope > SMALLEST_SLOPE * terms
    return np.where(there, terms / np.where(there, slope, 1.0), np.inf)


def _compute_bilinear_form(y: Complex, part: Sparse, x: Complex) -> Complex:
    return np.asarray(np.einsum("km,km->m", y.conj(), part @ x))


def match_conjugate_roots(root: Complex, x: Complex, y: Complex, bar: Array, lost: Array | None = None) -> Roots:
    """Return roots [1/s] without parts that are rounding, of each pair one, slowest first; of a double real root both shapes.

    bar : rounding of each root [1/s]; lost : what else is not known of it, which makes no root zero or real [1/s]
    """
    out = np.where(np.abs(root) <= bar, 0.0, root)
    out = np.where(np.abs(out.real) <= bar, 1j * out.imag, out)
    real = np.abs(out.imag) <= bar
    twin = real & (root.imag < 0.0)
    out = np.where(real, out.real, out)
    right, left = (np.where(real, np.where(twin, part.imag, part.real), part) for part in (x, y))
    use = out.imag >= 0.0
    order = np.flatnonzero(use)[np.argsort(np.abs(out[use]), kind="stable")]
    whole = bar if lost is None else bar + lost
    return Roots(out[order], right[:, order], left[:, order], whole[order])
