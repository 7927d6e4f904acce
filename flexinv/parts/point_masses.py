"""Point masses that move as a reduced part does: few of them have its whole inertia, exactly.

A part of shapes Phi moves its nodes by x_k = x + R (X_k + Phi_k q).  Its kinetic energy, its momentum and its weight depend on
the mass m of the mesh by the products of the fields f = (1, X, Phi) alone:

    S = f^T m f,        (4 + 3 shapes) squared

Factored, S = C^T C, and turned so that the first field is the same number in every row, C is those fields at as many points of
equal mass as S has ranks: point masses with places X_p and shapes Phi_p.  Mass, first and second moments with their linear and
quadratic dependence on q, and all gyroscopic terms are those of the mesh, to rounding: who knows point masses knows the part.

Displacements of second order H stand in the span of f, H = f (S^-1 f^T m H): their products with f, which make geometric
stiffness, are exact, and what is left out is their product with one another, of fourth order in q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.model.owned_cache import make_owner_cache
from flexinv.parts.craig_bampton import Reduction
from flexinv.typing import Array

# Of fields of unit size: what is below is a sum of the others, to rounding of S.
NO_FIELD = 1e-13


class PointMasses(NamedTuple):
    """Points of equal mass [kg]: place (points, 3) [m] in the link frame, shapes (points, 3, shapes) [-], second derivatives.

    second : (points, 3, soft, soft) [1/m]; nodal : (n, 3, soft, soft) the same of the mesh's nodes [1/m]
    """

    mass: float
    place: Array
    shapes: Array
    second: Array
    nodal: Array


@make_owner_cache()
def build_point_masses(reduced: Reduction) -> PointMasses:
    """Return the point masses of a reduced part [kg], [m], [-]."""
    count = len(reduced.points)
    fields = np.hstack([np.ones((count, 1)), reduced.points, reduced.shapes.reshape(count, -1)])
    size = np.sqrt(np.einsum("nf,nf->f", fields, reduced.mass @ fields))
    size[size < NO_FIELD * size.max()] = 1.0  # a part may have no extent along an axis
    unit = fields / size
    weighed = reduced.mass @ unit
    products = unit.T @ weighed
    root, vectors = scipy.linalg.eigh((products + products.T) / 2.0)
    kept = root > NO_FIELD * root.max()
    basis = vectors[:, kept] / np.sqrt(root[kept])
    rows = np.sqrt(root[kept])[:, None] * vectors[:, kept].T * size  # C, (rank, field)
    turned = _turn_to_equal(rows[:, 0]) @ rows
    share = turned[:, :1]  # the root of each mass
    values = turned / share
    bent = reduced.second.reshape(count, -1)
    by_fields = (basis @ (basis.T @ (weighed.T @ bent))) / size[:, None]  # S^-1 f^T m H
    second, nodal = ((part @ by_fields).reshape(len(part), *reduced.second.shape[1:]) for part in (values, fields))
    shapes = values[:, 4:].reshape(len(values), 3, -1)
    return PointMasses(float(np.mean(share**2)), values[:, 1:4], shapes, second, nodal)


def _turn_to_equal(first: Array) -> Array:
    """The reflection (n, n) that makes all numbers of a vector equal."""
    size = np.linalg.norm(first)
    equal = np.full(len(first), size / np.sqrt(len(first)))
    across = first - equal
    length = across @ across
    if length <= np.finfo(float).eps * size**2:
        return np.eye(len(first))
    return np.asarray(np.eye(len(first)) - 2.0 * np.outer(across, across) / length)
