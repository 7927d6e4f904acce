"""Findings about ready matrices of meshed links: motions without force, negative energies, masses that are not the mesh's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from crosscheck.findings.finding import Finding, make_error, make_warning
from flexinv.files.parts import DENSITIES
from flexinv.parts.part_matrices import PartMatrices, build_rigid_motions
from flexinv.typing import Array

# Rows up to which all motions are looked at as a dense matrix; of more the slowest by Lanczos.
DENSE_ROWS = 1500
# Of the largest omega^2: what rounding leaves of a motion without force, a millionth of what the slowest of a fine bar has.
FREE_MOTION = 1e-13
# What a motion without force may have, over what the six rigid ones have by the digits of a file.
OF_RIGID = 10.0
# Of the largest mass: an entry between nodes that stiffness does not couple.
NO_ENTRY = 1e-9
SLOWEST = 8


def check_motions(found: PartMatrices, place: str) -> Iterator[Finding]:
    """Yield the findings of matrices that another program has made [kg], [N/m]."""
    yield from _check_density(found, place)
    yield from _check_couplings(found, place)
    if _find_least_mass(found) <= 0.0:
        why = "some motion would have a negative kinetic energy"
        yield make_error("mesh mass", place, "a mass matrix that is not positive", why, "the whole export of the mass")
        return
    squared, rigid, largest = _find_slowest_motions(found)
    limit = max(FREE_MOTION * largest, OF_RIGID * rigid)
    if squared[0] < -limit:
        why = "some motion of the part would give energy: omega^2 is negative"
        given = f"a stiffness that is not positive, omega^2 = {squared[0]:.4g} 1/s^2"
        yield make_error(
            "mesh stiffness", place, given, why, "the stiffness without preload, in one unit with the mass"
        )
    elif (free := int((squared <= limit).sum())) > 6:
        why = "a part has six rigid motions: some of its cells hang on a hinge, or a spring is left out"
        given = f"{free} motions without force"
        yield make_error(
            "mesh stiffness", place, given, why, "the stiffness of a part that hangs together by faces of cells"
        )


def _check_density(found: PartMatrices, place: str) -> Iterator[Finding]:
    """The mass over the box around the mesh, which holds it: a part is heavier by itself."""
    mass = float(found.mass.sum())
    density = mass / float(np.prod(np.ptp(found.points, axis=0)))
    if density > DENSITIES[1]:
        given = f"{mass:.4g} kg in a box of {density:.4g} kg/m^3"
        why = f"nothing is denser than {DENSITIES[1]:g} kg/m^3"
        yield make_warning(
            "mesh mass", place, given, why, "unit_kg = 1000 for matrices in tonnes, 1 for kilograms, and unit_m"
        )


def _check_couplings(found: PartMatrices, place: str) -> Iterator[Finding]:
    """Masses between nodes that have no stiffness between them: the rows of both are in another order."""
    count = len(found.points)
    links = found.stiffness.tocoo()
    joined = scipy.sparse.coo_array(
        (np.ones(len(links.row)), (links.row // 3, links.col // 3)), shape=(count, count)
    ).tocsr()
    mass = found.mass.tocoo()
    heavy = np.abs(mass.data) > NO_ENTRY * np.abs(mass.data).max()
    apart = int((np.asarray(joined[mass.row[heavy], mass.col[heavy]]).ravel() == 0.0).sum())
    if apart:
        given = f"mass between {apart} pairs of nodes without stiffness between them"
        why = "both matrices of a cell couple the same nodes: the order of their rows is another"
        yield make_error("mesh mass", place, given, why, "mass and stiffness in the order of the nodes of the mesh")


def _find_least_mass(found: PartMatrices) -> float:
    """The least eigenvalue of the mass of a component, over the largest diagonal entry [-]."""
    size = float(found.mass.diagonal().max())
    if len(found.points) <= DENSE_ROWS:
        return float(np.linalg.eigvalsh(found.mass.toarray())[0]) / size
    least = scipy.sparse.linalg.eigsh(found.mass, k=1, sigma=0.0, which="LM", return_eigenvectors=False)
    return float(least[0]) / size


def _find_slowest_motions(found: PartMatrices) -> tuple[Array, float, float]:
    """The slowest omega^2 [1/s^2] in order, the largest size of those of rigid motions, and the largest of all about."""
    mass = scipy.sparse.kron(found.mass, scipy.sparse.eye_array(3)).tocsc()
    motions = build_rigid_motions(found.points, found.points.mean(axis=0))
    values = scipy.linalg.eigvalsh(motions.T @ (found.stiffness @ motions), motions.T @ (mass @ motions))
    largest = float((found.stiffness.diagonal() / mass.diagonal()).max())
    if mass.shape[0] <= DENSE_ROWS:
        squared = scipy.linalg.eigvalsh(found.stiffness.toarray(), mass.toarray(), subset_by_index=(0, SLOWEST - 1))
    else:
        squared = np.sort(
            scipy.sparse.linalg.eigsh(
                found.stiffness.tocsc(), k=SLOWEST, M=mass, sigma=-1e-6 * largest, return_eigenvectors=False
            )
        )
    return np.asarray(squared), float(np.abs(values).max()), largest
