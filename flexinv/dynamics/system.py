"""Records of the time integration: unknowns, work space, and the system of one mesh, which the kernels of a step are handed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexinv.dynamics.constraint_rows import Ties
from flexinv.dynamics.dofs import Topology
from flexinv.dynamics.loads import Loads, SpringRows
from flexinv.elements.beam import Rates, Scratch
from flexinv.elements.beam_element import Elements
from flexinv.elements.points import PointMotion
from flexinv.kernels.memory import make_adjacent_arrays, make_aligned_zeros
from flexinv.kernels.records import send_by_address
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Frames, Joints, Variation
from flexinv.typing import Array, Indices, Mask


@send_by_address
class State(NamedTuple):
    """Unknowns of a step.

    x, r : (nodes, 3), (nodes, 3, 3) pose at the start of the step: of independent nodes in the world, of passive joints
        in the parent's frame; in a plane none
    d, u, du : (unknowns,) increment since then, velocity, acceleration [m, rad, s]
    pseudo : (unknowns,) the integrator's auxiliary acceleration at the start of the step; trend, bend : (unknowns,) its first
        and second difference over the steps before; order : (1,) of the prediction that would have been best for the last one
    u0, du0 : (unknowns,) velocity and acceleration at the start of the step; saved_acceleration : (unknowns,) set aside
    place : (unknowns,) coordinate of a passive scalar joint at the start of the step, against which its spring pulls [rad], [m],
        and amplitudes of meshed links [m];
        in a plane also the poses of independent nodes, x, y, theta
    """

    x: Array
    r: Array
    d: Array
    u: Array
    du: Array
    pseudo: Array
    trend: Array
    bend: Array
    u0: Array
    du0: Array
    saved_acceleration: Array
    place: Array
    order: Indices

    @classmethod
    def build_for(cls, nodes: int, unknowns: int) -> State:
        """Return unknowns that are zero [m, rad, s], those of a plane with no nodes."""
        series = [make_aligned_zeros(unknowns) for _ in range(10)]
        return cls._make(
            [make_aligned_zeros(nodes, 3), make_aligned_zeros(nodes, 3, 3), *series, np.zeros(1, dtype=np.int64)]
        )


@send_by_address
class Work(NamedTuple):
    """Wrenches, residual and linearisation, allocated once.

    wrench : (nodes, 6); dwrench : (nodes, columns, 6); residual : (sides, unknowns), the first is it, the others belong to
        the closures (`dynamics.constraint_rows`); diagonal : (blocks, columns, columns)
    tangent : (elements, 6 count, 6 count), with damping six columns more (`elements.beam`); internal : (elements, points, 6)
    energy : (3,) elastic energy [J], power of the internal forces and what of it is dissipated [W]
    element, rates : scratch of one element
    system : (rows, rows + columns + sides of a part), scratch of one elimination
    projection : (2, nodes, 6), scratch of `dynamics.index1`
    moved : (rows, amplitudes, 6) slides and turns of meshed links' interfaces by amplitudes (`elements.shapes`) [-], [rad/m]
    points : motion of the point masses of meshed links (`elements.points`)
    solved : (elements, rows, columns + sides of a part) eliminated unknowns by those of the element's first block
    """

    wrench: Array
    dwrench: Array
    residual: Array
    diagonal: Array
    tangent: Array
    internal: Array
    energy: Array
    element: Scratch
    rates: Rates
    system: Array
    solved: Array
    projection: Array
    moved: Array
    points: PointMotion


@send_by_address
class Border(NamedTuple):
    """Bordered system beside the tree: closures and springs between points [m], [N]."""

    ties: Ties
    pulls: SpringRows


@send_by_address
class System(NamedTuple):
    """A mesh under time integration: what stays constant, the present state, and what kernels fill."""

    topology: Topology
    elements: Elements
    border: Border
    state: State
    frames: Frames
    variation: Variation
    loads: Loads
    work: Work


@send_by_address
class Instants(NamedTuple):
    """Prescribed quantities at the instants of a chunk of steps.

    joints : relative motion with a leading axis (samples, nodes, ...) [m, rad, s]; table : (samples, loads, 6) wrenches of the
    loads [N], [N m]; efforts : (samples, unknowns or 0) of drives [N m], [N]; coupling_terms : (samples, rows or 0, 3) terms of
    prescribed joints in couplings [rad], [m] and rates
    """

    joints: Joints
    table: Array
    efforts: Array
    coupling_terms: Array


@send_by_address
class Trajectory(NamedTuple):
    """The flexible trajectory and what holds it together: histories with a leading axis of samples.

    x, r, v, w, a, al : motion of all nodes, as `kinematics.nodal_motion.NodalMotion`
    wrench : (samples, nodes, 6) force [N] (world) and moment [N m] (own frame) on every node of a rigid part from
        inertia, loads and the elastic reactions of the beams that start there
    internal : (samples, elements, points, 6) stress resultants in the section frame [N], [N m]
    energy : (samples, 3) elastic energy [J], power of the internal forces and what of it is dissipated [W]
    multipliers : (samples, rows) of the closures [N], [N m]
    iterations : (samples,) of Newton
    """

    x: Array
    r: Array
    v: Array
    w: Array
    a: Array
    al: Array
    wrench: Array
    internal: Array
    energy: Array
    multipliers: Array
    iterations: Indices

    @property
    def motion(self) -> NodalMotion:
        """Return the motion of all nodes [m, rad, s]."""
        return NodalMotion(*self[:6])

    def take_samples(self, first: int, last: int) -> Trajectory:
        """Return the samples from ``first`` to before ``last``, not copied [m, rad, s, N, J]."""
        return Trajectory._make(part[first:last] for part in self)

    def write_samples(self, rows: Indices, other: Trajectory, mask: Mask) -> None:
        """Write the samples of another trajectory that are ``mask`` into ``rows`` of this one [m, rad, s, N, J]."""
        for history, values in zip(self, other, strict=True):
            history[rows] = values[mask]

    @classmethod
    def make_uninitialized(cls, samples: int, mesh: Mesh, rows: int = 0) -> Trajectory:
        """Return the arrays of `empty`, large histories uncleared: every sample will be written [m, rad, s, N, J]."""
        *motion, wrench, internal = make_adjacent_arrays(*list_history_shapes(mesh, samples))
        if has_padding(mesh):
            internal[:] = 0.0
        series = np.zeros((samples, 3)), np.zeros((samples, rows)), np.zeros(samples, dtype=np.int64)
        return cls._make([*motion, wrench, internal, *series])

    @classmethod
    def make_zero(cls, samples: int, mesh: Mesh, rows: int = 0) -> Trajectory:
        """Return histories to be filled [m, rad, s, N, J]."""
        return cls._make(np.zeros_like(part) for part in cls.make_uninitialized(samples, mesh, rows))


def list_history_shapes(mesh: Mesh, samples: int) -> list[tuple[int, ...]]:
    """Return the shapes of the nodes' motion, of wrenches and of stress resultants in a `Trajectory` [-]."""
    vector = (samples, mesh.size, 3)
    return [vector, (*vector, 3), *4 * [vector], (samples, mesh.size, 6), (samples, *mesh.elements.weight.shape, 6)]


def has_padding(mesh: Mesh) -> bool:
    """Return True if some elements have fewer points than others [-]; time integration never writes the padding."""
    return bool((mesh.elements.order < mesh.elements.weight.shape[1]).any())
