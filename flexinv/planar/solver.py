"""Arrays of the time integration in a plane: it starts from the spatial solver's state and writes its own back there."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexinv.dynamics.constraint_rows import Ties
from flexinv.dynamics.generalized_alpha import Scheme
from flexinv.dynamics.initial_state import drop_increments
from flexinv.dynamics.system import State, Trajectory
from flexinv.elements.planar_beam import BEND_BLOCK, COEFFICIENTS, CONSTANTS, COUPLINGS, POINT_BLOCK, RATE_BLOCK
from flexinv.kernels.dense import ROWS_AT_ONCE
from flexinv.kernels.memory import copy_aligned, make_aligned_zeros
from flexinv.kernels.so3 import exp_so3
from flexinv.kinematics.mesh import Mesh
from flexinv.model.owned_cache import make_owner_cache
from flexinv.planar.detection import convert_to_plane
from flexinv.planar.model import PlanarModel, build_planar_model
from flexinv.planar.stepper import PlanarSystem, PlanarWork, integrate_planar_motion
from flexinv.planar.tree import PlanarFrames
from flexinv.planar.tree_solver import PlanarFactors
from flexinv.typing import Array, Indices

GivenMotion = tuple[Array, Array, Array]

_NOWHERE = np.zeros((0, 3))


@dataclass(frozen=True)
class PlanarMarch:
    """A mechanism in a plane, ready to march; what the spatial solver has solved is where it starts."""

    mesh: Mesh
    model: PlanarModel
    system: PlanarSystem

    @classmethod
    def build_for(cls, mesh: Mesh, passive: Collection[str]) -> PlanarMarch:
        """Return the arrays of a mesh that lies in a plane, whose joints named in ``passive`` are free."""
        model = build_planar_model(mesh, frozenset(passive))
        system = PlanarSystem(
            tree=model.tree,
            elements=model.elements,
            ties=_copy_arrays(model.ties),
            masses=_copy_arrays(model.masses),
            space=model.space,
            state=State.build_for(0, len(model.tree.scale)),
            frames=_make_frames(model),
            factors=_make_factors(model),
            work=_make_work(model),
        )
        return cls(mesh, model, system)

    @classmethod
    def take_reusable(cls, mesh: Mesh, passive: Collection[str]) -> PlanarMarch:
        """Return a march as `of` does, or reuse one of the same that was released; for callers that begin anew."""
        try:
            return _list_reusable(mesh, frozenset(passive)).pop()
        except IndexError:
            return cls.build_for(mesh, passive)

    def make_reusable(self, passive: Collection[str]) -> None:
        """Leave the arrays to the next march that begins; a march that failed may leave NaN in them, which is cleared."""
        self.system.ties.multiplier[:], self.system.masses.over[:] = 0.0, self.model.masses.over
        _list_reusable(self.mesh, frozenset(passive)).append(self)

    def update_accelerations(
        self, scheme: Scheme, q: Array, qd: Array, qdd: Array, row: Indices, out: Trajectory
    ) -> tuple[int, int, int, float]:
        """Find the accelerations [m/s^2], [rad/s^2] anew where the march stands and they jump; arguments as of `arguments`.

        Return status, instants done, iterations or element, last relative increment [-].
        """
        state = self.system.state
        prescribed = self._collect_prescribed(q, qd, qdd)
        state.u[:], state.du[:] = state.u0, state.du0
        status, instant, count, size = integrate_planar_motion(
            self.system, scheme, _NOWHERE, True, prescribed, row, out
        )
        return int(status), int(instant), int(count), float(size)

    def compute_section_turn(self, element: int) -> float:
        """Return by how much the sections of an element turn against each other [rad] where the last step has begun."""
        e = self.model.elements
        free, at = self._list_independent_nodes()
        if not 0 <= element < len(e.order):
            return 0.0
        angle = self.system.frames.pose[:, 2].copy()
        nodes = e.nodes[element, : e.order[element] + 1]
        angle[free] = self.system.state.place[at[:, 2]]
        angle = angle[nodes] + e.bend[element, : len(nodes)]
        return float(np.abs(np.angle(np.exp(1j * (angle - angle[0])))).max())

    def copy_from_space(self, state: State, ties: Ties) -> None:
        """Copy the state of the spatial solver, and which closures act there [m, rad, s, N]."""
        planar_ties = self.system.ties
        row = self.model.space.row
        planar_ties.acting[:] = ties.acting[row]
        planar_ties.multiplier[:] = ties.multiplier[row]
        if len(row):
            places = (
                (planar_ties.place_a, planar_ties.a, ties.place_a),
                (planar_ties.place_b, planar_ties.b, ties.place_b),
            )
            for seen_here, node, vectors in (
                *places,
                (planar_ties.u, planar_ties.a, ties.u),
                (planar_ties.w, planar_ties.b, ties.w),
            ):
                seen_here[:] = convert_to_plane(self.model.plane, node, vectors[row])[:, :2]
        here = self.system.state
        m = self.model
        free, at = self._list_independent_nodes()
        for name in ("u", "du", "pseudo", "u0", "du0", "place"):
            getattr(here, name)[:] = m.pick @ getattr(state, name)
        turned = np.einsum("ji,njk,nlk->nil", m.plane.axes, state.r[free], m.plane.frames[free])  # axes^T R frames^T
        here.place[at[:, :2]] = state.x[free] @ m.plane.axes[:, :2]
        here.place[at[:, 2]] = np.arctan2(turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1])
        drop_increments(here)

    def copy_to_space(self, state: State, ties: Ties) -> None:
        """Copy the state of this march to the spatial solver [m, rad, s, N]."""
        ties.multiplier[self.model.space.row] = self.system.ties.multiplier
        here = self.system.state
        m = self.model
        free, at = self._list_independent_nodes()
        for name in ("u", "du", "pseudo", "u0", "du0", "place"):
            getattr(state, name)[:] = m.pick.T @ getattr(here, name)
        x, y, angle = here.place[at].T[:, :, None, None]
        space = m.space
        state.x[free] = np.column_stack([x.ravel(), y.ravel(), np.full(len(free), space.height)]) @ space.axes.T
        state.r[free] = np.cos(angle) * space.across[free] + np.sin(angle) * space.along[free] + space.normal[free]
        held = np.flatnonzero(~m.tree.independent & (m.tree.column >= 0))
        q = here.place[m.tree.first[held] + m.tree.column[held], None]
        state.x[held] = self.mesh.offset[held] + q * m.topology.slide[held, 0]
        state.r[held] = self.mesh.rotation[held] @ exp_so3(q * m.topology.turn[held, 0])
        drop_increments(state)

    def _list_independent_nodes(self) -> tuple[Indices, Indices]:
        """Independent nodes, and where x, y and theta of each stand among the unknowns, (nodes, 3)."""
        tree = self.model.tree
        free = np.flatnonzero(tree.independent)
        return free, tree.first[free, None] + np.arange(3)

    def prepare_arguments(
        self, scheme: Scheme, start: GivenMotion | None, steps: GivenMotion, row: Indices, out: Trajectory
    ) -> tuple[Any, ...]:
        """Return the arguments of `integrate_planar_motion` over the ends of ``steps``: q (steps, nq), qd, qdd (steps, nv) "
        "[m, rad, s].

        start : the same at one instant at which the march begins undeformed, all closures acting, with the accelerations that
            belong to it; None where it goes on
        row : of ``out`` to be written at each instant, that of the start included, -1 for none
        """
        given = self._collect_prescribed(*steps)
        joint = _NOWHERE
        if start is not None:
            here = self.model.joints.collect_coordinates(*start)
            nodes = self.model.joints
            given = np.concatenate([here[:, nodes.prescribed], given])
            joint = np.zeros((self.mesh.size, 3))
            joint[nodes.node] = here[0]
        return self.system, scheme, joint, start is not None, given, row, out

    def _collect_prescribed(self, q: Array, qd: Array, qdd: Array) -> Array:
        joints = self.model.joints
        coordinates = joints.collect_coordinates(q, qd, qdd)
        return coordinates if joints.prescribed.all() else np.ascontiguousarray(coordinates[:, joints.prescribed])


@make_owner_cache()
def _list_reusable(mesh: Mesh, passive: frozenset[str]) -> list[PlanarMarch]:
    """Return the list of marches left behind for reuse, which threads may share."""
    return []


def _copy_arrays(part: Any) -> Any:
    """A copy of an array, floats on lines of the cache; of the records in a record, their arrays'."""
    if isinstance(part, tuple):
        return type(part)(*map(_copy_arrays, part))
    return copy_aligned(part) if part.dtype == float else part.copy()


def _make_work(model: PlanarModel) -> PlanarWork:
    """Scratch of a march: one right side of the tree, and one for each row of the closures."""
    elements = model.elements
    unknowns = (1 + len(model.ties.a), len(model.tree.scale))
    blocks = len(elements.constants) // int(CONSTANTS)
    behind = len(elements.coupling) // int(COUPLINGS) * int(BEND_BLOCK)
    return PlanarWork(
        points=make_aligned_zeros(blocks * int(POINT_BLOCK) + behind),
        rates=make_aligned_zeros(len(elements.damping) // int(COEFFICIENTS) * int(RATE_BLOCK)),
        u=make_aligned_zeros(max(elements.nodes.shape[1], 1), 3),
        node_forces=make_aligned_zeros(*elements.nodes.shape, 3),
        residual=make_aligned_zeros(*unknowns),
        y=make_aligned_zeros(*unknowns),
    )


def _find_widest(model: PlanarModel) -> int:
    """Unknowns of the largest block."""
    return max(int(model.tree.size.max(initial=0)), 1)


def _make_frames(model: PlanarModel) -> PlanarFrames:
    """Room for the motion of all nodes and for its variations."""
    nodes = len(model.tree.parent)
    vectors = (nodes, 3)
    variations = (nodes, _find_widest(model), 3)
    return PlanarFrames(
        pose=make_aligned_zeros(*vectors),
        rate=make_aligned_zeros(*vectors),
        acceleration=make_aligned_zeros(*vectors),
        joint=make_aligned_zeros(*vectors),
        arm=make_aligned_zeros(nodes, 4),
        by_pose=make_aligned_zeros(*variations),
        by_rate=make_aligned_zeros(*variations),
        by_acceleration=make_aligned_zeros(*variations),
        wrench=make_aligned_zeros(*vectors),
        dwrench=make_aligned_zeros(*variations),
    )


def _make_factors(model: PlanarModel) -> PlanarFactors:
    """Room for the factors of the linearisation; lines are as long as products take numbers at once."""
    rows, row, unknowns = model.place
    widest = _find_widest(model)
    elements = len(unknowns)
    most = -(-unknowns.shape[1] // ROWS_AT_ONCE) * ROWS_AT_ONCE
    columns = -(-widest // ROWS_AT_ONCE) * ROWS_AT_ONCE
    return PlanarFactors(
        rows=rows,
        row=row,
        unknowns=unknowns,
        inverse=make_aligned_zeros(elements, most, most),
        to_root=make_aligned_zeros(elements, 3, most),
        b=make_aligned_zeros(elements, widest, most),
        x=make_aligned_zeros(elements, widest, most),
        root=make_aligned_zeros(len(model.tree.span) - 1, columns, columns),
        diagonal=make_aligned_zeros(len(model.tree.size), widest, widest),
        line=make_aligned_zeros(2, max(most, columns)),
        scratch=make_aligned_zeros(elements, most),
    )
