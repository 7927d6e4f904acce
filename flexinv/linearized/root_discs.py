"""Discs that hold the roots of A z = s B z, by Gershgorin's theorem in the basis of all vectors: bars that see wrong ones.

With right vectors z_j as columns of Z and left ones w_i as columns of W the pencil is similar to

    T = (W^H B Z)^-1 W^H A Z

which is diagonal where vectors and roots are right.  What is left of T beside the roots, and what rounding of A and B does to
it, is bounded by F (roots, roots).  Rows and columns are weighed by d > 0.  All roots lie in the discs

    |s - s_i| <= sum_j F_ij d_j / d_i

and a set of discs apart from the others holds as many roots as it has discs.  For each root the weights d make its own disc as
small as they can while it stays apart: it is then of second order in what vectors are off,  F_ii + sum_j F_ij F_ji / |s_i - s_j|.
Roots whose discs do not come apart are taken together.  A root that is there twice has W^H B Z singular: no bar is finite.

Where roots are all but defective their vectors are all but one, and no basis.  These are replaced by a basis of what the others
leave, {z : W^H B z = 0} and {w : w^H B Z = 0} with the others' W and Z, in which T is made triangular (Schur).

Where few roots of many are known, Z and W have few columns and T is that of the pencil between them.  What this leaves out is the
residual  R = A Z - B Z T:  with Y = W (W^H B Z)^-H the pencil with A - R Y^H B has the roots of T, and R brings |Y|^T |R| to F.
That none of the others is within reach is for a count to say (`root_counts`).

Source: Gershgorin, 1931; Stewart, Sun, *Matrix perturbation theory*, Academic Press 1990, sections IV.2 and VI.2.
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.typing import Array, Complex, Indices, Mask, RealOrComplex, Sparse

# Roundings over the absolute sum of terms: sums of some tens of terms in M, C and K, of the linearisation before.
ROUNDED_TERMS = 1e-13
# |w^H B z| over the sum of its terms' sizes: below this the vectors of a root are all but those of another.
DEFECTIVE = 1e-5
# Steps after which weights have settled, and by how much they are then made larger, so that what is proved is proved.
WEIGHT_STEPS = 12
SPARE = 1.1
# Part of a distance between discs that is left while weights are looked for.
LEAST_GAP = 1e-3
# Weights of roots that are together and the largest ones of others.
SMALLEST_WEIGHT = 1e-14
LARGEST_WEIGHT = 1e100

Members = Mask


def compute_root_discs(
    a: Array | Sparse, b: Array | Sparse, root: Complex, right: Complex, left: Complex, shift: float
) -> tuple[Complex, Array]:
    """Return centres and radii (roots,) [1/s] of discs that hold the roots of A - s B, one each; infinite where it is not proved.

    root, right, left : roots that were found, all or few of many, with vectors as columns, in the order of the discs
    shift : rounding is that at this size [1/s] where roots are slower
    """
    if not len(root):
        return root, np.zeros(0)
    z = right / np.linalg.norm(right, axis=0)
    w = left / np.linalg.norm(left, axis=0)
    terms = np.einsum("km,km->m", np.abs(w), abs(b) @ np.abs(z))
    slope = np.abs(np.einsum("km,km->m", w.conj(), b @ z))
    together = slope < DEFECTIVE * terms
    with np.errstate(all="ignore"):
        try:
            z, w = _replace_defective(a, b, z, w, together)
            centre, error = _compute_error(a, b, z, w, shift)
        except np.linalg.LinAlgError:
            return root, np.full(len(root), np.inf)
        radius = _find_disc_sets(centre, error)
    order = _match(root, centre, together)
    return centre[order], radius[order]


def _replace_defective(
    a: Array | Sparse, b: Array | Sparse, z: Complex, w: Complex, together: Members
) -> tuple[Complex, Complex]:
    """Vectors with those ``together`` replaced by a basis, in which T is triangular: of what the others leave, or their own."""
    if not together.any():
        return z, w
    count = int((~together).sum())
    if len(z) > z.shape[1]:
        right, left = (scipy.linalg.qr(part[:, together], mode="economic")[0] for part in (z, w))
    else:
        right = scipy.linalg.qr((w[:, ~together].conj().T @ b).conj().T)[0][:, count:]
        left = scipy.linalg.qr(b @ z[:, ~together])[0][:, count:]
    dual = np.linalg.solve(left.conj().T @ b @ right, left.conj().T)
    inner = dual @ a @ right
    if not np.isfinite(inner).all():
        raise np.linalg.LinAlgError
    turn = scipy.linalg.schur(inner, output="complex")[1]
    z = z.astype(complex)
    w = w.astype(complex)
    z[:, together] = right @ turn
    w[:, together] = dual.conj().T @ turn
    return z, w


def _compute_error(a: Array | Sparse, b: Array | Sparse, z: Complex, w: Complex, shift: float) -> tuple[Complex, Array]:
    """The diagonal of T (roots,), and F (roots, roots): what is beside it, what it leaves out, and what rounding does [1/s].

    Raises LinAlgError where the vectors are no basis.
    """
    rows = w.conj().T
    slope = np.einsum("mk,km->m", rows, b @ z)
    rows = rows / np.where(slope == 0.0, 1.0, slope)[:, None]
    basis = rows @ (b @ z)
    few = len(z) > z.shape[1]
    if few and np.linalg.cond(basis) > 1.0 / ROUNDED_TERMS:  # a root that is there twice, and another may be lost
        raise np.linalg.LinAlgError
    inverse = np.asarray(np.linalg.inv(basis))
    shown = inverse @ (rows @ (a @ z))
    centre = np.diag(shown).copy()
    sizes = [np.abs(rows) @ (abs(part) @ np.abs(z)) for part in (a, b)]
    moved = np.abs(shown)
    moved[np.diag_indices(len(centre))] = np.maximum(np.abs(centre), shift)
    error = ROUNDED_TERMS * np.abs(inverse) @ (sizes[0] + sizes[1] @ moved)
    error += np.abs(shown - np.diag(centre))
    if few:
        error += np.abs(inverse @ rows) @ np.abs(a @ z - b @ (z @ shown))
    if not np.isfinite(error).all():
        raise np.linalg.LinAlgError
    return np.asarray(centre), error


def _match(root: Complex, centre: Complex, together: Members) -> Indices:
    """Return the disc of each root by its number [-]: those that are ``together`` have lost their order."""
    order = np.arange(len(root))
    which = np.flatnonzero(together)
    away = np.abs(root[which][:, None] - centre[which][None])
    if np.isfinite(away).all():
        order[which] = which[scipy.optimize.linear_sum_assignment(away)[1]]
    return order


def _find_disc_sets(centre: Complex, error: Array) -> Array:
    """Radii (roots,) [1/s] of discs: sets of roots whose discs do not come apart from others are joined with the nearest."""
    label = np.arange(len(centre))
    out = np.full(len(centre), np.inf)
    distance = np.abs(centre[:, None] - centre[None])
    while np.isinf(out).any():
        names = np.unique(label[np.isinf(out)])
        members = label[:, None] == names
        gap = np.stack([distance[:, inside].min(axis=1) for inside in members.T], axis=1)
        radius, apart = _find_radii(error, members, gap)
        for k in np.flatnonzero(apart):
            inside = np.flatnonzero(members[:, k])
            out[inside] = radius[k] * _count_steps(distance[np.ix_(inside, inside)], radius[k])
        nearest = np.where(members, np.inf, gap)[:, ~apart].argmin(axis=0)
        label = _join(label, members[:, ~apart].argmax(axis=0), nearest)
        out[np.isin(label, label[np.isinf(out)])] = np.inf
    return out


def _join(label: RealOrComplex, some: RealOrComplex, others: RealOrComplex) -> RealOrComplex:
    """Return labels (roots,) of sets after those of ``some`` roots are joined with those of ``others``."""
    size = len(label)
    rows = np.concatenate([np.arange(size), some])
    columns = np.concatenate([np.unique(label, return_index=True)[1][np.unique(label, return_inverse=True)[1]], others])
    links = scipy.sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(size, size))
    return np.asarray(scipy.sparse.csgraph.connected_components(links, directed=False)[1])


def _count_steps(distance: Array, radius: float) -> Array:
    """Radii from the middle of each disc to the farthest root of those that touch: of n discs 2 n - 1."""
    if len(distance) == 1:
        return np.ones(1)
    _, label = scipy.sparse.csgraph.connected_components(scipy.sparse.csr_array(distance <= 2 * radius), directed=False)
    return np.asarray(2.0 * np.bincount(label)[label] - 1.0)


def _find_radii(error: Array, members: Members, gap: Array) -> tuple[Array, Members]:
    """Radii (sets,) [1/s] of the discs of sets of roots by weights d (roots, sets), and whether they come apart from all others.

    members : (roots, sets); gap : (roots, sets) distance of each root to the sets
    """
    group_weights = np.stack([_find_weights(error, inside) for inside in members.T], axis=1)
    weight = group_weights
    for _ in range(WEIGHT_STEPS):
        reach = error @ weight
        room = np.maximum(gap - _find_largest(reach, group_weights), LEAST_GAP * gap)
        weight = np.where(
            members, group_weights, np.minimum(reach / np.where(room > 0.0, room, np.finfo(float).tiny), LARGEST_WEIGHT)
        )
    weight = np.where(members, group_weights, SPARE * weight + np.finfo(float).tiny)
    reach = error @ weight
    radius = _find_largest(reach, group_weights)
    apart = (reach < (gap - radius) * weight) | members
    return radius, np.asarray(apart.all(axis=0))


def _find_weights(error: Array, inside: Members) -> Array:
    """Weights (roots,) [-] of a set that make all its discs as small as they can be: F d = r d, the vector of Perron."""
    out = np.zeros(len(inside))
    out[inside] = 1.0
    if inside.sum() > 1:
        block = error[np.ix_(inside, inside)]
        values, vectors = np.linalg.eig(block)
        perron = np.abs(vectors[:, values.real.argmax()])
        out[inside] = np.maximum(perron / perron.max(), SMALLEST_WEIGHT)
    return out


def _find_largest(reach: Array, weights: Array) -> Array:
    """The largest radius (sets,) [1/s] of those of a set: reach (roots, sets) over its weights."""
    return np.asarray(np.where(weights > 0.0, reach / np.where(weights > 0.0, weights, 1.0), 0.0).max(axis=0))
