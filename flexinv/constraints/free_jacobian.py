"""Jacobian of closures by what a march leaves free: passive joints and, of beams, the sections that carry a closure's ends.

A multiplier of a row is a pair of opposite wrenches on the closure's two nodes (`closures`): a force f through a point, a moment.
With m its moment about the world's origin, and a freedom of a node at x that moves it by s and turns it by t,

    A = sign (f . (s + x x t) + m . t)      sign: +1 on the way from the closure's second end to its section, -1 from the first

A way ends at the first beam section, whose six freedoms are unknowns of the march themselves, or at the world.  Where one of the
two sections of a closure carries no other closure, its rows are independent whatever the position: they have no part in this.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.constraints.closures import (
    Rows,
    build_constraint_rows,
    compute_constraint_jacobian,
    list_velocity_scales,
)
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.model.joint_kinds import SECTION
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Indices, Mask

# Entries of G (rows, nv) up to which the compiled G, which has all of them, is faster than the entries of A alone.
SMALL_JACOBIAN = 2000


@dataclass(frozen=True)
class FreeJacobian:
    """The Jacobian A of closures that are coupled by what a march leaves free, and by nothing to others.

    which : (rows of those that act,) mask of its own; rows : these constraints, over their scales
    node : (columns,) that each freedom moves; slide, turn : (columns, 3) how, in the node's frame, over the freedom's scale [m],
        [-], those of sections in the world's; coordinate : (columns,) of the joint's velocity, -1 for sections
    entry : (2, entries) row and column of what is not zero; sign, gear : (entries,) of the way and of couplings
    """

    which: Mask
    rows: Rows
    node: Indices
    slide: Array
    turn: Array
    coordinate: Indices
    entry: Indices
    sign: Array
    gear: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns [-]."""
        return len(self.rows.closure), len(self.node)

    def replace_rows(self, rows: Rows) -> FreeJacobian:
        """Return the Jacobian of the same closures [m], [-] with other frames; rows : of all that act."""
        return replace(self, rows=_take_rows(rows, self.which))

    def evaluate_entries(self, mesh: Mesh, motion: NodalMotion) -> Array:
        """Return the entries of A (samples, entries) [-] at all samples of a motion.

        Without sections the two ways of each closure meet, and A is a part of G.
        """
        if (self.coordinate < 0).any() or len(self.rows.closure) * mesh.mechanism.nv > SMALL_JACOBIAN:
            return self.compute_entries(motion)
        row, column = self.entry
        coordinate = self.coordinate[column]
        g = compute_constraint_jacobian(mesh, motion, self.rows)
        return np.asarray(g[:, row, coordinate] * (list_velocity_scales(mesh)[coordinate] / self.rows.scale[row]))

    def compute_entries(self, motion: NodalMotion) -> Array:
        """Return the entries of A (samples, entries) [-] by wrenches and freedoms, with and without sections."""
        row, column = self.entry
        turned = np.where((self.coordinate < 0)[:, None, None], np.eye(3), motion.rotation[:, self.node])
        slide = np.einsum("scij,cj->sci", turned, self.slide)
        turn = np.einsum("scij,cj->sci", turned, self.turn)
        twist = np.concatenate([slide + np.cross(motion.x[:, self.node], turn), turn], axis=2)  # (sample, column, 6)
        wrench = self._compute_unit_wrenches(motion)
        return np.asarray(self.sign * np.einsum("sei,sei->se", wrench[:, row], twist[:, column]) + self.gear)

    def assemble(self, entries: Array) -> Array:
        """Return A (samples, rows, columns) [-] from its entries (samples, entries)."""
        out = np.zeros((len(entries), *self.shape))
        out[:, self.entry[0], self.entry[1]] = entries
        return out

    def _compute_unit_wrenches(self, motion: NodalMotion) -> Array:
        """Force and moment about the origin (samples, rows, 6) of unit multipliers on second nodes, over the rows' scales."""
        rows = self.rows
        _, ra = _take_frames(motion, rows.a)
        xb, rb = _take_frames(motion, rows.b)
        u = np.einsum("srij,rj->sri", ra, rows.u)
        w = np.einsum("srij,rj->sri", rb, rows.w)
        point = xb + np.einsum("srij,rj->sri", rb, rows.place_b)
        directed = rows.direction[:, None]
        force = np.where(directed, 0.0, u)
        moment = np.cross(np.where(directed, w, point), u)
        return np.concatenate([force, moment], axis=2) / rows.scale[:, None]


@make_owner_cache()
def build_free_jacobians(mesh: Mesh, passive: frozenset[str], active: Mask) -> tuple[FreeJacobian, ...]:
    """Return the Jacobians of closures that may become singular [-], each of closures that are coupled to each other.

    passive : names of the joints that are free; active : (closures,) of those that act, in the frames that the mechanism states
    """
    acting = build_constraint_rows(mesh).take_active(active)
    may = np.isin(acting.closure, _list_coupled_closures(mesh, acting))
    rows = _take_rows(acting, may)
    if not len(rows.closure):
        return ()
    signs = _compute_ways(mesh, rows)
    node, slide, turn, coordinate, gear = _list_freedoms(mesh, passive, rows, signs)
    pattern = (signs[:, node] != 0.0) | (gear != 0.0)
    # rows of one closure belong together, whatever they have entries for
    tied = np.concatenate([pattern, rows.closure[:, None] == np.unique(rows.closure)], axis=1)
    graph = scipy.sparse.csr_array(tied.astype(np.int64))
    count, group = scipy.sparse.csgraph.connected_components(graph @ graph.T, directed=False)
    out = []
    for part in (group == k for k in range(count)):
        touched = pattern[part].any(axis=0)
        row, column = np.nonzero(pattern[np.ix_(part, touched)])
        which = may.copy()
        which[may] = part
        if len(row):
            sign = signs[np.ix_(part, node[touched])][row, column]
            geared = gear[np.ix_(part, touched)][row, column]
            freedoms = node[touched], slide[touched], turn[touched], coordinate[touched]
            entry = np.stack([row, column])
            out.append(FreeJacobian(which, _take_rows(rows, part), *freedoms, entry, sign, geared))
    return tuple(out)


def _take_rows(rows: Rows, which: Mask) -> Rows:
    return Rows(*(part if name == "place" else part[which] for name, part in rows._asdict().items()))


def _take_frames(motion: NodalMotion, nodes: Indices) -> tuple[Array, Array]:
    """Places (samples, rows, 3) and axes (samples, rows, 3, 3) of the rows' nodes; the world (-1) stands still."""
    still = (nodes < 0)[:, None]
    x = np.where(still, 0.0, motion.x[:, nodes])
    return x, np.where(still[..., None], np.eye(3), motion.rotation[:, nodes])


def _find_section(mesh: Mesh, node: int) -> int:
    """The first beam section on the way from a node to the world, -1 without."""
    while node >= 0 and mesh.kind[node] != SECTION:
        node = int(mesh.parent[node])
    return node


def _list_coupled_closures(mesh: Mesh, rows: Rows) -> list[int]:
    """The closures that are left when those with a section of their own are taken away, one after the other."""
    ends: dict[int, set[int]] = {}
    for closure, a, b in zip(rows.closure.tolist(), rows.a.tolist(), rows.b.tolist(), strict=True):
        first = _find_section(mesh, a)
        second = _find_section(mesh, b)
        ends[closure] = set() if first == second else {first, second} - {-1}
    while True:
        shared = [section for sections in ends.values() for section in sections]
        alone = [closure for closure, sections in ends.items() if any(shared.count(one) == 1 for one in sections)]
        if not alone:
            return list(ends)
        for closure in alone:
            del ends[closure]


def _compute_ways(mesh: Mesh, rows: Rows) -> Array:
    """Signs (rows, nodes) of the nodes on the ways from the rows' ends to their sections, these included; 0 off them [-]."""
    signs = np.zeros((len(rows.closure), mesh.size))
    for ends, sign in ((rows.a, -1.0), (rows.b, 1.0)):
        for row, end in enumerate(ends.tolist()):
            node = end
            while node >= 0:
                signs[row, node] += sign
                node = int(mesh.parent[node]) if mesh.kind[node] != SECTION else -1
    return signs


def _list_freedoms(
    mesh: Mesh, passive: frozenset[str], rows: Rows, signs: Array
) -> tuple[Indices, Array, Array, Indices, Array]:
    """Node, slide, turn, coordinate (-1 of sections), and factors in couplings, of all freedoms that rows have to do with."""
    m = mesh.mechanism
    scales = list_velocity_scales(mesh)
    free = np.zeros(m.nv, dtype=bool)
    for name in passive:
        free[m.v_slices[name]] = True
    node = list[int]()
    motion = list[Array]()
    coordinate = list[int]()
    gear = list[Array]()
    for n in range(mesh.size):
        if mesh.kind[n] == SECTION and signs[:, n].any():
            node += 6 * [n]
            motion += [np.concatenate([mesh.length * way[:3], way[3:]]) for way in np.eye(6)]
            coordinate += 6 * [-1]
            gear += 6 * [np.zeros(len(signs))]
        first = int(mesh.v_index[n])
        for k in range(int(mesh.freedoms[n]) if first >= 0 and free[first] else 0):
            geared = rows.gear[:, first + k] * scales[first + k] / rows.scale
            if signs[:, n].any() or geared.any():
                node.append(n)
                motion.append(scales[first + k] * np.concatenate([mesh.slide[n, k], mesh.turn[n, k]]))
                coordinate.append(first + k)
                gear.append(geared)
    moved = np.reshape(motion, (-1, 6))
    factors = np.reshape(gear, (-1, len(signs))).T
    return np.array(node, dtype=np.int64), moved[:, :3], moved[:, 3:], np.array(coordinate, dtype=np.int64), factors
