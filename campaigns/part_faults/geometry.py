"""Faults of the mesh itself: nodes, cells, how they hang together, and how large they are."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
from part_examples import make_block

from campaigns.part_faults.draft import Draft, make_draft
from campaigns.part_faults.table import fault
from flexinv.typing import Array

TIP = "[links.arm.interfaces.tip]"


@fault("inverted")
def invert_cell(draw: random.Random) -> Draft:
    """One tetrahedron has two corners exchanged."""
    draft = make_draft(draw, "tetra", (8, 2, 2))
    k = draw.randrange(len(draft.cells))
    draft.cells[k, [0, 1]] = draft.cells[k, [1, 0]]
    return draft


@fault("inverted")
def mirror_mesh(draw: random.Random) -> Draft:
    """The part of the other hand: y is mirrored, and the cells keep their order."""
    draft = make_draft(draw)
    draft.points[:, 1] *= -1.0
    return draft


@fault("flat")
def flatten_cell(draw: random.Random) -> Draft:
    """A node lies in the plane of the three others: a cell without volume."""
    draft = make_draft(draw, "tetra", (4, 2, 2))
    cell = draft.cells[draw.randrange(len(draft.cells))]
    draft.points[cell[3]] = draft.points[cell[:3]].mean(axis=0)
    return draft


@fault("name a node twice")
def repeat_node_in_cell(draw: random.Random) -> Draft:
    """A cell names one node twice."""
    draft = make_draft(draw, "hexahedron")
    draft.cells[1, 3] = draft.cells[1, 2]
    return draft


@fault("hang apart")
def keep_pieces_apart(draw: random.Random) -> Draft:
    """Two halves that nobody merged: every node of the seam is there twice."""
    draft = make_draft(draw, "hexahedron")
    _double_nodes(draft, lambda place: np.abs(place[:, 0] - draft.size[0] / 2) < 1e-6)
    return draft


@fault("coincide")
def crack_seam(draw: random.Random) -> Draft:
    """Half of a seam is not merged: the part is cracked there, and hangs together by the rest."""
    draft = make_draft(draw, "hexahedron", (4, 2, 2))
    _double_nodes(draft, lambda place: (np.abs(place[:, 0] - draft.size[0] / 2) < 1e-6) & (place[:, 1] > -1e-6))
    return draft


@fault("no cell uses")
def leave_nodes_loose(draw: random.Random) -> Draft:
    """Nodes of a construction that no cell uses."""
    draft = make_draft(draw)
    _add_points(draft, np.array([[10.0, 200.0, 0.0], [20.0, 200.0, 0.0]]))
    return draft


@fault("no cell uses")
def hold_loose_node(draw: random.Random) -> Draft:
    """The hub's set has a reference node, which no cell uses."""
    draft = make_draft(draw)
    _add_points(draft, np.array([[-20.0, 0.0, 0.0]]))
    draft.sets["HUB"].append(int(draft.numbers[-1]))
    return draft


@fault("hang apart")
def leave_piece_floating(draw: random.Random) -> Draft:
    """A bolt beside the arm that touches it nowhere."""
    draft = make_draft(draw)
    points, cells = make_block(draft.kind, (20.0, 5.0, 5.0), (1, 1, 1))
    draft.cells = np.vstack([draft.cells, cells + len(draft.points)])
    _add_points(draft, points + np.array([100.0, 150.0, 0.0]))
    return draft


@fault("hinge")
def hang_by_one_node(draw: random.Random) -> Draft:
    """A block that hangs by one node: it turns there without force."""
    return _hang_block(draw, 1)


@fault("hinge")
def hang_by_an_edge(draw: random.Random) -> Draft:
    """A block that hangs by an edge, as on a hinge."""
    return _hang_block(draw, 2)


@fault("cells twice")
def repeat_cell(draw: random.Random) -> Draft:
    """One cell is there twice: its mass and stiffness count double."""
    draft = make_draft(draw)
    draft.cells = np.vstack([draft.cells, draft.cells[:1]])
    return draft


@fault("cells twice")
def repeat_part(draw: random.Random) -> Draft:
    """The whole part was exported twice, as body and as assembly."""
    draft = make_draft(draw)
    draft.cells = np.vstack([draft.cells, draft.cells])
    return draft


@fault("hang apart")
def lay_part_over_itself(draw: random.Random) -> Draft:
    """The whole part is there twice, each with nodes of its own."""
    draft = make_draft(draw)
    draft.cells = np.vstack([draft.cells, draft.cells + len(draft.points)])
    _add_points(draft, draft.points.copy())
    return draft


@fault("inverted")
def move_middle_node(draw: random.Random) -> Draft:
    """A node in the middle of an edge stands beyond its end."""
    draft = make_draft(draw)
    cell = draft.cells[draw.randrange(len(draft.cells))]
    draft.points[cell[4]] = draft.points[cell[0]] + 1.7 * (draft.points[cell[1]] - draft.points[cell[0]])
    return draft


@fault("inverted")
def exchange_middle_nodes(draw: random.Random) -> Draft:
    """The last two nodes of quadratic tetrahedra are exchanged: the order of another program."""
    draft = make_draft(draw)
    draft.cells[:, [8, 9]] = draft.cells[:, [9, 8]]
    return draft


@fault("inverted")
def exchange_middle_nodes_of_bricks(draw: random.Random) -> Draft:
    """Upright edges before upper ones: the order of 20 nodes that Nastran has."""
    draft = make_draft(draw, "hexahedron20")
    draft.cells = draft.cells[:, [*range(12), *range(16, 20), *range(12, 16)]]
    return draft


@fault("inverted")
def cross_corners(draw: random.Random) -> Draft:
    """Bricks row by row in place of around: bow ties."""
    draft = make_draft(draw, "hexahedron")
    draft.cells = draft.cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    return draft


@fault("inverted")
def begin_bricks_above(draw: random.Random) -> Draft:
    """The upper face of bricks is named before the lower."""
    draft = make_draft(draw, "hexahedron")
    draft.cells = draft.cells[:, [4, 5, 6, 7, 0, 1, 2, 3]]
    return draft


@fault("locks")
def fill_plate_with_linear_cells(draw: random.Random) -> Draft:
    """A thin plate of linear tetrahedra, one across."""
    draft = make_draft(draw, "tetra", (8, 4, 1))
    draft.points[:, 2] *= 3.0 / draft.size[2]
    return draft


@fault("locks")
def fill_plate_with_bricks(draw: random.Random) -> Draft:
    """A thin plate of fully integrated linear bricks, one across."""
    draft = make_draft(draw, "hexahedron", (8, 4, 1))
    draft.points[:, 2] *= 3.0 / draft.size[2]
    return draft


@fault("flat|times as long as thin")
def squeeze_cells(draw: random.Random) -> Draft:
    """A layer of cells of a hundred thousandth of their width, where two surfaces nearly meet."""
    draft = make_draft(draw, "tetra10", (4, 1, 1))
    place = draft.points[:, 0]
    near = (place > 0.24 * draft.size[0]) & (place < 0.49 * draft.size[0])
    draft.points[near, 0] = draft.size[0] / 2 - 2e-5 * (draft.size[0] / 2 - place[near])
    return draft


@fault("0 nodes are caught")
def scale_mesh(draw: random.Random) -> Draft:
    """Metres in the file, and unit_m of millimetres."""
    draft = make_draft(draw)
    draft.points /= 1000.0
    return draft


@fault("a mesh .* m long")
def scale_mesh_with_sets(draw: random.Random) -> Draft:
    """The same, with a tip that is a set, so that nothing tells by place."""
    draft = make_draft(draw)
    _tip_by_set(draft)
    draft.points /= 1000.0
    return draft


@fault("a mesh .* m long")
def forget_unit(draw: random.Random) -> Draft:
    """Millimetres taken for metres, with sets."""
    draft = make_draft(draw)
    _tip_by_set(draft)
    draft.swap("unit_m = 0.001\n", "")
    return draft


@fault("times as long as thin")
def stretch_one_axis(draw: random.Random) -> Draft:
    """z alone was scaled to metres: a foil of a tenth of a millimetre."""
    draft = make_draft(draw)
    draft.points[:, 2] /= 1000.0
    return draft


def _tip_by_set(draft: Draft) -> None:
    draft.sets["TIP"] = draft.numbers[np.abs(draft.points[:, 0] - draft.size[0]) < 1e-6].tolist()
    start = draft.toml.index(TIP)
    end = draft.toml.index("[links.hand]")
    draft.toml = f'{draft.toml[:start]}{TIP}\nset = "TIP"\n\n{draft.toml[end:]}'


def _add_points(draft: Draft, points: Array) -> None:
    draft.points = np.vstack([draft.points, points])
    draft.numbers = np.arange(1, len(draft.points) + 1)


def _double_nodes(draft: Draft, choose: Callable[[Array], Array]) -> None:
    """Give the cells beyond the middle nodes of their own where nodes are chosen by place."""
    chosen = np.flatnonzero(choose(draft.points))
    other = {int(node): len(draft.points) + k for k, node in enumerate(chosen)}
    beyond = draft.points[draft.cells].mean(axis=1)[:, 0] > draft.size[0] / 2
    for k in np.flatnonzero(beyond):
        draft.cells[k] = [other.get(int(node), int(node)) for node in draft.cells[k]]
    _add_points(draft, draft.points[chosen])


def _hang_block(draw: random.Random, shared: int) -> Draft:
    """A second block at a corner or an edge of the top, which shares so many nodes."""
    draft = make_draft(draw, "hexahedron")
    size = np.array(draft.size)
    points, cells = make_block("hexahedron", (size[0] / 4, size[1], size[2]), (1, 1, 1))
    points = points + np.array([size[0] / 4, size[1], size[2]])
    gap = np.linalg.norm(points[:, None] - draft.points[None], axis=2)
    known = {int(k): int(gap[k].argmin()) for k in range(len(points)) if gap[k].min() < 1e-6}
    kept = sorted(known)[:shared]
    fresh = [k for k in range(len(points)) if k not in kept]
    moved = {k: len(draft.points) + n for n, k in enumerate(fresh)} | {k: known[k] for k in kept}
    draft.cells = np.vstack([draft.cells, [[moved[int(node)] for node in cell] for cell in cells]])
    lifted = points[fresh]
    if shared == 1:
        lifted = lifted + np.where(np.isin(fresh, sorted(known)[1:])[:, None], [0.0, 0.0, 3.0], 0.0)
    _add_points(draft, lifted)
    return draft
