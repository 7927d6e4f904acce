"""The planar march's arrays, made from those of the spatial solver, whose state it takes over and gives back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.assemble import State
from flexinv.integrate import Scheme
from flexinv.mechanism import Array
from flexinv.mesh import CONTINUOUS, PRISMATIC, REVOLUTE, Mesh
from flexinv.planar_beam import (
    AXIAL,
    BENDING,
    BLOCK,
    CONSTANTS,
    CURVATURE,
    LANES,
    SHEAR,
    STRAIN1,
    STRAIN2,
    WEIGHT,
    PlanarElements,
)
from flexinv.planar_march import Embedding, Histories, PlanarWork, planar_march
from flexinv.planar_solve import PlanarFactors
from flexinv.planar_tree import PlanarFrames, PlanarState, PlanarTree
from flexinv.plane import Plane
from flexinv.rotations import about_axis, log_so3
from flexinv.system import Indices, Topology

QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # J, a quarter turn about the normal


@dataclass(frozen=True)
class PlanarMarch:
    """A mechanism in a plane, ready to march; what the spatial solver has solved is where it starts."""

    mesh: Mesh
    topology: Topology
    plane: Plane
    tree: PlanarTree
    elements: PlanarElements
    space: Embedding
    state: PlanarState
    frames: PlanarFrames
    factors: PlanarFactors
    work: PlanarWork

    @classmethod
    def of(cls, mesh: Mesh, topology: Topology, plane: Plane) -> PlanarMarch:
        """Return the arrays of a mesh that lies in ``plane``, with the unknowns of ``topology``."""
        tree, elements = _tree(mesh, topology, plane), _elements(mesh, plane)
        unknowns, widest = len(tree.scale), max(int(tree.size.max(initial=0)), 1)
        vectors, variations = (mesh.size, 3), (mesh.size, widest, 3)
        shapes = (
            vectors,
            vectors,
            vectors,
            vectors,
            (mesh.size, 4),
            variations,
            variations,
            variations,
            vectors,
            variations,
        )
        state = PlanarState(np.zeros(vectors), *(np.zeros(unknowns) for _ in range(7)))
        count = mesh.elements.nodes.shape[1]
        work = PlanarWork(
            points=np.zeros(len(elements.constants) // int(CONSTANTS) * int(BLOCK)), u=np.zeros((max(count, 1), 3)),
            felt=np.zeros((*mesh.elements.nodes.shape, 3)), residual=np.zeros(unknowns), y=np.zeros(unknowns),
        )  # fmt: skip
        frames = PlanarFrames(*(np.zeros(shape) for shape in shapes))
        space = _embedding(mesh, plane)
        return cls(mesh, topology, plane, tree, elements, space, state, frames, _factors(tree, elements), work)

    def take(self, s: State) -> None:
        """Begin where the spatial solver stands [m, rad, s]."""
        here = self.state
        for n in range(self.mesh.size):
            if self.tree.independent[n]:
                here.start[n, :2] = self.plane.axes.T[:2] @ s.x[n]
                here.start[n, 2] = self._angle(n, s.r[n])
            elif self.tree.column[n] >= 0:
                here.start[n, 0] = self._coordinate(n, s)
        pick = self._planar_of_spatial()
        for name in ("u", "du", "pseudo", "u0", "du0"):
            getattr(here, name)[:] = pick @ getattr(s, name)
        here.d[:] = 0.0
        here.trend[:] = 0.0

    def give(self, s: State) -> None:
        """Put the spatial solver where this march has come to [m, rad, s]."""
        here, axes = self.state, self.plane.axes
        for n in range(self.mesh.size):
            if self.tree.independent[n]:
                s.x[n] = axes @ np.append(here.start[n, :2], self.plane.height)
                s.r[n] = self._rotation(n, here.start[n, 2])
            elif self.tree.column[n] >= 0:
                q, placed = here.start[n, 0], self.mesh.rotation[n]
                turning = self.mesh.kind[n] != PRISMATIC
                s.x[n] = self.mesh.offset[n] if turning else self.mesh.offset[n] + q * placed @ self.mesh.axis[n]
                s.r[n] = placed @ about_axis(self.mesh.axis[n], np.array([q]))[0] if turning else placed
        pick = self._planar_of_spatial()
        for name in ("u", "du", "pseudo", "u0", "du0"):
            getattr(s, name)[:] = pick.T @ getattr(here, name)
        s.d[:] = 0.0

    def march(
        self, scheme: Scheme, q: Array, qd: Array, qdd: Array, row: Indices, out: Histories
    ) -> tuple[int, int, int, float]:
        """March over q (steps, nq), qd, qdd (steps, nv) [m, rad, s]; row : (steps,) of ``out`` to be written, -1 for none.

        Return status, steps done, iterations or element, last relative increment [-].
        """
        given = np.empty((len(q), int((self.tree.given >= 0).sum()), 3))
        for n in np.flatnonzero(self.tree.given >= 0):
            own, at, v = given[:, self.tree.given[n]], self.mesh.q_index[n], self.mesh.v_index[n]
            own[:, 0] = np.arctan2(q[:, at + 1], q[:, at]) if self.mesh.kind[n] == CONTINUOUS else q[:, at]
            own[:, 1], own[:, 2] = qd[:, v], qdd[:, v]
        status, step, count, size = planar_march(
            self.tree,
            self.elements,
            self.space,
            scheme,
            self.state,
            self.frames,
            self.factors,
            self.work,
            given,
            row,
            out,
        )
        return int(status), int(step), int(count), float(size)

    def _angle(self, n: int, rotation: Array) -> float:
        turned = self.plane.axes.T @ rotation @ self.plane.frames[n].T
        return float(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))

    def _rotation(self, n: int, angle: float) -> Array:
        space = self.space
        return np.asarray(np.cos(angle) * space.across[n] + np.sin(angle) * space.along[n] + space.normal[n])

    def _coordinate(self, n: int, s: State) -> float:
        placed, axis = self.mesh.rotation[n], self.mesh.axis[n]
        if self.mesh.kind[n] == PRISMATIC:
            return float(axis @ placed.T @ (s.x[n] - self.mesh.offset[n]))
        return float(axis @ log_so3(placed.T @ s.r[n]))

    def _planar_of_spatial(self) -> Array:
        """(planar unknowns, spatial unknowns): components along the plane's axes, turns about its normal."""
        t, plane = self.topology, self.tree
        pick = np.zeros((len(plane.scale), len(t.scale)))
        for n in range(self.mesh.size):
            here, there = int(plane.offset[plane.block[n]]), int(t.offset[t.block[n]])
            if plane.independent[n]:
                pick[here : here + 2, there : there + 3] = self.plane.axes.T[:2]
                pick[here + 2, there + 3 : there + 6] = self.space.axle[n]
            elif plane.column[n] >= 0:
                pick[here + plane.column[n], there + t.column[n]] = 1.0
        return pick


def _tree(mesh: Mesh, t: Topology, plane: Plane) -> PlanarTree:
    frames, moves = plane.frames, mesh.v_index >= 0
    size = np.where(np.arange(len(t.size)) > 0, t.size - 3, t.size)  # three freedoms of a node instead of six
    passive = t.freedoms > 0
    turning = np.isin(mesh.kind, (REVOLUTE, CONTINUOUS))
    sliding = mesh.kind == PRISMATIC
    before = [plane.axes.T if m < 0 else frames[m] for m in mesh.parent]
    offset_p = np.array([frame @ offset for frame, offset in zip(before, mesh.offset, strict=True)]).reshape(-1, 3)
    axis = np.einsum("nij,nj->ni", frames, mesh.axis)  # (node, xyz), in the plane's axes
    scale = np.ones(int(size.sum()))
    offset = np.concatenate([[0], np.cumsum(size)[:-1]]).astype(np.int64)
    column = np.where(passive, t.column - 3 * (t.block > 0), -1)
    for n in range(mesh.size):
        first = offset[t.block[n]]
        if t.independent[n]:
            scale[first : first + 2] = mesh.length
        elif passive[n] and sliding[n]:
            scale[first + column[n]] = mesh.length
    driven = moves & ~passive
    return PlanarTree(
        parent=mesh.parent, block=t.block, independent=t.independent, size=size, offset=offset, scale=scale,
        given=np.where(driven, np.cumsum(driven) - 1, -1), column=column,
        turn=np.where(turning, np.sign(axis[:, 2]), 0.0), slide=np.where(sliding[:, None], axis[:, :2], 0.0),
        offset_p=np.ascontiguousarray(offset_p[:, :2]), shifted=sliding | offset_p[:, :2].any(axis=1),
        mass=mesh.mass, inertia=np.einsum("ni,nij,nj->n", frames[:, 2], mesh.inertia, frames[:, 2]),
        gravity=plane.axes.T[:2] @ mesh.mechanism.gravity, rotor=t.rotor, damping=t.damping, friction=t.friction,
    )  # fmt: skip


def _elements(mesh: Mesh, plane: Plane) -> PlanarElements:
    e = mesh.elements
    elements, count = e.nodes.shape
    points = max(count - 1, 0)
    bend, heading = np.zeros((elements, count)), np.zeros(elements)
    constants = np.zeros((-(-elements * points // LANES), 7, LANES))
    for k, nodes in enumerate(e.nodes):
        frames = plane.frames[nodes[: e.order[k] + 1]]
        heading[k] = np.arctan2(frames[0, 1, 0], frames[0, 0, 0])
        relative = np.einsum("ji,njk->nik", frames[0], frames)  # (node, 3, 3), R_0^T R_i
        bend[k, : len(frames)] = log_so3(relative) @ frames[0, 2]
        axle, side = frames[0, 2], frames[0].T @ QUARTER @ frames[0][:, 0]
        for g in range(e.order[k]):
            block, lane = divmod(k * points + g, LANES)
            stiffness = e.stiffness[k, g, 0], side**2 @ e.stiffness[k, g, :3], axle**2 @ e.stiffness[k, g, 3:]
            strains = e.gamma0[k, g, 0], side @ e.gamma0[k, g], axle @ e.kappa0[k, g]
            rows = [int(r) // LANES for r in (AXIAL, SHEAR, BENDING, WEIGHT, STRAIN1, STRAIN2, CURVATURE)]
            constants[block, rows, lane] = *stiffness, e.weight[k, g], *strains
    return PlanarElements(e.order, e.nodes, e.shape, e.slope, bend, heading, np.uint64(LANES), constants.reshape(-1))


def _embedding(mesh: Mesh, plane: Plane) -> Embedding:
    axes, frames = plane.axes, plane.frames
    upright = np.diag([0.0, 0.0, 1.0])
    side = np.zeros((len(mesh.elements.order), 3))
    for k, nodes in enumerate(mesh.elements.nodes):
        side[k] = frames[nodes[0]].T @ QUARTER @ frames[nodes[0]][:, 0]
    across, along, normal = (
        np.ascontiguousarray(axes @ part @ frames) for part in (np.eye(3) - upright, QUARTER, upright)
    )
    return Embedding(axes, plane.height, across, along, normal, np.ascontiguousarray(frames[:, 2]), side)


def _factors(t: PlanarTree, e: PlanarElements) -> PlanarFactors:
    elements, count = e.nodes.shape
    widest = max(int(t.size.max(initial=0)), 1)
    row = np.zeros((elements, count, widest), dtype=np.int64)
    numbers = []
    for k in range(elements):
        order, extra, own = int(e.order[k]), 3 * int(e.order[k]), {}
        for i, n in enumerate(e.nodes[k, 1 : order + 1]):
            block = t.block[n]
            for j in range(t.size[block]):
                row[k, i + 1, j] = j * order + i if j < 3 else extra
                extra += j >= 3
                own[int(row[k, i + 1, j])] = int(t.offset[block] + j)
        numbers.append([own[r] for r in range(extra)])
    most = max((len(own) for own in numbers), default=0)
    table = np.array([own + [0] * (most - len(own)) for own in numbers], dtype=np.int64).reshape(elements, most)
    return PlanarFactors(
        rows=np.array([len(own) for own in numbers], dtype=np.int64), row=row, own=table,
        inverse=np.zeros((elements, most, most)), to_root=np.zeros((elements, 3, most)),
        b=np.zeros((elements, widest, most)), x=np.zeros((elements, widest, most)),
        root=np.zeros((widest, widest)), diagonal=np.zeros((len(t.size), widest, widest)),
        line=np.zeros((2, max(most, widest, 1))),
    )  # fmt: skip
