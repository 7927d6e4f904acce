"""Links that are meshes in Exudyn: ``ObjectFFRFreducedOrder``, with matrices and a basis that are not flexinv's.

Stiffness and mass are assembled by scikit-fem's own bases from primary data: points, cells, material; edges may be curved.
Shapes are Exudyn's own: ``FEMinterface.ComputeHurtyCraigBamptonModes`` with rigid (RBE2) or averaged (RBE3) interfaces, the first
of which is the root and stays in the floating frame.

Its floating frame is linear in the amplitudes: it has no geometric stiffening (`describe_loss`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from exudyn.FEM import FEMinterface, HCBstaticModeSelection, ObjectFFRFreducedOrderInterface
from exudyn.itemInterface import MarkerSuperElementRigid
from numpy.typing import NDArray

from crosscheck.engines.exudyn.models.frames import Array
from crosscheck.measures.certificate import COMPARED_MODES, INTERFACE_AXES, TIMES_MODES
from flexinv.model.mechanism import Mechanism, Placement
from flexinv.model.part import Cells, MeshedPart, PartInterface

# scikit-fem's mesh and element of each kind, and the corners of a cell as its mesh orders them.
ELEMENTS = {
    "tetra": ("MeshTet", "ElementTetP1", [0, 1, 2, 3]),
    "tetra10": ("MeshTet", "ElementTetP2", [0, 1, 2, 3]),
    "hexahedron": ("MeshHex", "ElementHex1", [6, 2, 5, 7, 1, 3, 4, 0]),
    "hexahedron20": ("MeshHex", "ElementHexS2", [6, 2, 5, 7, 1, 3, 4, 0]),
    "hexahedron27": ("MeshHex", "ElementHex2", [6, 2, 5, 7, 1, 3, 4, 0]),
}
# scikit-fem's mesh whose cells have curved edges.
CURVED = {"tetra10": "MeshTet2", "hexahedron20": "MeshHex2", "hexahedron27": "MeshHex2"}
# Corners of the edges, then of the faces and of the volume, in the middle of which a kind has its other nodes.
_TETRAHEDRON_MIDDLES = "01 12 02 03 13 23"
_BRICK_EDGES = "01 12 23 30 45 56 67 74 04 15 26 37"
_BRICK_MIDDLES = f"{_BRICK_EDGES} 0374 1265 0154 3267 0123 4567 01234567"
MIDDLES = {"tetra10": _TETRAHEDRON_MIDDLES, "hexahedron20": _BRICK_EDGES, "hexahedron27": _BRICK_MIDDLES}
# Orders of the rules for stiffness where edges are curved and they count: 4 and 8 points, as Abaqus and CalculiX integrate.
STIFFNESS_ORDERS = {"tetra10": 2, "hexahedron": 3}
# Order of all other rules, which are exact where edges are straight.
ORDER = 4
# Where edges are straight, a node is where scikit-fem has a degree of freedom, up to this part of the part's extent.
SAME_PLACE = 1e-6


def describe_refusal(mechanism: Mechanism) -> str | None:
    """Return the reason why a part has no floating frame here, or None."""
    for link in mechanism.meshed:
        part = link.part
        assert part is not None
        if part.stiffening and part.cells:
            return (
                f"{link.name} stiffens under loads along it (stiffening = true), which Exudyn's floating frame does not"
            )
        if part.cells and (other := [cells.kind for cells in part.cells if cells.kind not in ELEMENTS]):
            return f"{link.name} has cells of kind {other[0]}, which scikit-fem integrates wrongly"
        if part.lumped:
            return f"{link.name} has lumped masses, and scikit-fem's are consistent"
        if part.frequency > 0.0:
            return f"{link.name} states modes up to a frequency, and Exudyn takes their number"
        if len({one.tie for one in part.interfaces}) > 1:
            return f"{link.name} has rigid and average interfaces, and Exudyn's basis has one kind"
    return None


def build_fem(part: MeshedPart) -> tuple[FEMinterface, NDArray[np.int64]]:
    """Return Exudyn's finite-element model of a part [m], [kg], [N/m] with its basis, and the numbers of the points in it."""
    fem = FEMinterface()
    used, mass, stiffness = _assemble(part)
    fem.nodes = {"Position": part.points[used]}
    fem.massMatrix = scipy.sparse.csr_matrix(mass)
    fem.stiffnessMatrix = scipy.sparse.csr_matrix(stiffness)
    ordered = [part.interface_of[part.root], *part.moved]
    fem.ComputeHurtyCraigBamptonModes(
        boundaryNodesList=[np.searchsorted(used, one.nodes).tolist() for one in ordered],
        nEigenModes=TIMES_MODES * part.modes,
        useSparseSolver=True,
        computationMode=HCBstaticModeSelection.RBE3 if ordered[0].tie == "average" else HCBstaticModeSelection.RBE2,
        RBE3secondMomentOfAreaWeighting=False,
    )
    return fem, used


def compute_weight(part: MeshedPart, place: Placement) -> tuple[float, Array, Array]:
    """Return mass [kg], first moment (3,) [kg m] and inertia (3, 3) [kg m^2] about the origin of a frame that carries a part."""
    used, mass, _ = _assemble(part)
    at = place.position + part.points[used] @ place.rotation.T
    alike = scipy.sparse.csr_array(mass)[::3][:, ::3]
    second = at.T @ (alike @ at)
    return float(alike.sum()), np.asarray(alike.sum(axis=0) @ at), np.trace(second) * np.eye(3) - second


def compute_properties(name: str, part: MeshedPart) -> tuple[dict[str, float], dict[str, float]]:
    """Return `Certificate.part_stiffness` [N/m], [N m/rad] and `part_frequencies` [Hz] of a part, from Exudyn's own basis."""
    fem, used = build_fem(part)
    basis = np.asarray(fem.modeBasis["matrix"])
    mass = basis.T @ (fem.massMatrix @ basis)
    stiffness = basis.T @ (fem.stiffnessMatrix @ basis)
    held = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    points = part.points[used]
    both = np.hstack([_build_rigid_columns(points, np.zeros(3)), basis])
    whole = both.T @ (fem.massMatrix @ both)
    free = scipy.linalg.eigh(both.T @ (fem.stiffnessMatrix @ both), whole, eigvals_only=True)[6:]
    frequencies = {
        f"{name}: {way} {k + 1}": float(np.sqrt(squared) / (2 * np.pi))
        for way, roots in (("held", held), ("free", free))
        for k, squared in enumerate(roots[:COMPARED_MODES])
    }
    at_interfaces: dict[str, float] = {}
    for one in part.moved:
        nodes = np.searchsorted(used, one.nodes)
        rows = (3 * nodes[:, None] + np.arange(3)).ravel()
        moves = np.linalg.lstsq(_build_rigid_columns(points[nodes], one.origin), basis[rows], rcond=None)[0]
        compliance = np.einsum("ij,ji->i", moves, np.linalg.solve(stiffness, moves.T))  # (x to rz), summed over modes
        at_interfaces |= {
            f"{name}: {one.name} {axis}": float(1.0 / c) for axis, c in zip(INTERFACE_AXES, compliance, strict=True)
        }
    return at_interfaces, frequencies


def _build_rigid_columns(points: Array, origin: Array) -> Array:
    """Displacements (3 n, 6) of points by unit slides along x, y, z and small turns about them through an origin."""
    arms = points - origin
    columns = [np.tile(axis, (len(points), 1)) for axis in np.eye(3)] + [np.cross(axis, arms) for axis in np.eye(3)]
    return np.stack([column.ravel() for column in columns], axis=1)


def _assemble(part: MeshedPart) -> tuple[NDArray[np.int64], Any, Any]:
    """Numbers of the used points, mass and stiffness by their coordinates."""
    count = len(part.points)
    if part.mass is not None and part.stiffness is not None:
        whole = [
            scipy.sparse.coo_array((m.value, (m.row, m.column)), shape=(3 * count, 3 * count)).tocsr()
            for m in (part.mass, part.stiffness)
        ]
    else:
        whole = [scipy.sparse.csr_array((3 * count, 3 * count)) for _ in range(2)]
        for cells in part.cells:
            for k, matrix in enumerate(_assemble_cells(part, cells)):
                whole[k] = whole[k] + matrix
    used = np.flatnonzero(np.asarray(abs(whole[0]).sum(axis=1)).ravel()[::3])
    rows = (3 * used[:, None] + np.arange(3)).ravel()
    return used, whole[0][rows][:, rows], whole[1][rows][:, rows]


def _assemble_cells(part: MeshedPart, cells: Cells) -> tuple[Any, Any]:
    """Mass and stiffness of cells of one kind and material, by all points."""
    import skfem

    mesh_name, element_name, corners = ELEMENTS[cells.kind]
    ends, place = np.unique(cells.nodes[:, corners], return_inverse=True)
    mesh = getattr(skfem, mesh_name)(part.points[ends].T, place.reshape(-1, len(corners)).T)
    element = getattr(skfem, element_name)
    basis = skfem.Basis(mesh, element(), intorder=ORDER)
    points, straight = _find_straight_places(part, cells)
    off, nearest = scipy.spatial.KDTree(straight).query(basis.doflocs.T)
    if off.max() > SAME_PLACE * np.ptp(part.points, axis=0).max():
        raise ValueError("scikit-fem has a degree of freedom where the mesh has no node")
    numbers = points[nearest]
    if cells.kind in CURVED:
        mesh = getattr(skfem, CURVED[cells.kind])(part.points[numbers].T, mesh.t, sort_t=False, elem=element)
        basis = skfem.Basis(mesh, element(), intorder=ORDER)
    size = 3 * len(part.points)
    order = STIFFNESS_ORDERS.get(cells.kind, ORDER)
    by_order = skfem.Basis(mesh, element(), intorder=order)
    stiffness = _assemble_stiffness(by_order, cells.material.stiffness, numbers, size)
    one = skfem.BilinearForm(lambda u, v, w: cells.material.density * u * v).assemble(basis)
    mass = sum(_build_block(one, 3 * numbers + i, 3 * numbers + i, size) for i in range(3))
    return mass, stiffness


def _find_straight_places(part: MeshedPart, cells: Cells) -> tuple[NDArray[np.int64], Array]:
    """Numbers of the cells' points, and where each would be if all edges were straight (n, 3) [m]."""
    places = part.points.copy()
    first = len(ELEMENTS[cells.kind][2])
    for k, middle in enumerate(MIDDLES.get(cells.kind, "").split()):
        ends = cells.nodes[:, [int(corner) for corner in middle]]
        places[cells.nodes[:, first + k]] = part.points[ends].mean(axis=1)
    points = np.unique(cells.nodes)
    return points, places[points]


def _assemble_stiffness(basis: Any, law: Array, numbers: NDArray[np.int64], size: int) -> Any:
    """Stiffness of a law (6, 6), block by block: of components i and j the sum of law_(ia, jb) int dv/dx_a du/dx_b."""
    import skfem

    strain = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # where a pair of axes stands among six strains
    pairs = list(np.ndindex(3, 3))
    slopes = {
        (a, b): skfem.BilinearForm(lambda u, v, w, a=a, b=b: v.grad[a] * u.grad[b]).assemble(basis) for a, b in pairs
    }
    whole = scipy.sparse.csr_array((size, size))
    for i, j in pairs:
        block = sum(law[strain[i, a], strain[j, b]] * slopes[a, b] for a, b in pairs)
        whole = whole + _build_block(block, 3 * numbers + i, 3 * numbers + j, size)
    return whole


def _build_block(block: Any, rows: NDArray[np.int64], columns: NDArray[np.int64], size: int) -> Any:
    entries = scipy.sparse.coo_array(block)
    places = rows[entries.row], columns[entries.col]
    return scipy.sparse.coo_array((entries.data, places), shape=(size, size)).tocsr()


def add_part(
    mbs: Any, part: MeshedPart, start: Placement, velocity: Array, spin: Array, gravity: Array
) -> dict[str, Any]:
    """Add a part whose link frame starts at a pose, moving [m/s], [rad/s], world; return a marker for each interface [m]."""
    fem, used = build_fem(part)
    reduced = ObjectFFRFreducedOrderInterface(fem)
    added = reduced.AddObjectFFRFreducedOrder(
        mbs,
        positionRef=list(start.position),
        rotationMatrixRef=start.rotation,
        initialVelocity=list(velocity),
        initialAngularVelocity=list(spin),
        massProportionalDamping=part.drag,
        stiffnessProportionalDamping=part.retardation,
        gravity=list(gravity),
    )
    body = added["oFFRFreducedOrder"]
    return {one.name: _add_interface(mbs, body, part, one, used) for one in part.interfaces}


def _add_interface(mbs: Any, body: Any, part: MeshedPart, one: PartInterface, used: NDArray[np.int64]) -> Any:
    """Add the marker of an interface's frame: it moves as its nodes do on average, about their mean."""
    nodes = np.searchsorted(used, one.nodes)
    return mbs.AddMarker(
        MarkerSuperElementRigid(
            bodyNumber=body,
            meshNodeNumbers=nodes.tolist(),
            weightingFactors=np.full(len(nodes), 1.0 / len(nodes)),
            offset=list(one.origin - part.points[one.nodes].mean(axis=0)),
        )
    )
