"""Records of the time integration: unknowns, work space, and the system of one mesh, which the kernels of a step are handed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexinv.dynamics.constraint_rows import Layout, Ties
from flexinv.dynamics.dofs import Topology
from flexinv.dynamics.loads import Loads
from flexinv.dynamics.spring_rows import Pulls
from flexinv.elements.beam import Rates, Scratch
from flexinv.elements.beam_element import Elements
from flexinv.kernels.records import by_address
from flexinv.kinematics.tree import Frames, Joints, Variation
from flexinv.typing import Array


@by_address
class State(NamedTuple):
    """Unknowns of a step.

    x, r : (nodes, 3), (nodes, 3, 3) pose at the start of the step: of independent nodes in the world, of passive joints
        in the parent's frame; d, u, du : (unknowns,) increment since then, velocity, acceleration [m, rad, s]
    pseudo : (unknowns,) the integrator's auxiliary acceleration at the start of the step; trend, bend : (unknowns,) its first
        and second difference over the steps before; order : (1,) of the prediction that would have been best for the last one
    u0, du0 : (unknowns,) velocity and acceleration at the start of the step; kept : (unknowns,) set aside
    place : (unknowns,) coordinate of a passive scalar joint at the start of the step, against which its spring pulls [rad], [m]
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
    kept: Array
    place: Array
    order: NDArray[np.int64]


@by_address
class Work(NamedTuple):
    """Wrenches, residual and linearisation, allocated once.

    wrench : (nodes, 6); dwrench : (nodes, columns, 6); residual : (sides, unknowns), the first is it, the others belong to
        the closures (`dynamics.constraint_rows`); diagonal : (blocks, columns, columns)
    tangent : (elements, 6 count, 6 count), with damping six columns more (`elements.beam`); internal : (elements, points, 6)
    energy : (3,) elastic energy [J], power of the internal forces and what of it is dissipated [W]
    element, rates : scratch of one element
    system : (rows, rows + columns + sides of a part), scratch of one elimination
    settled : (2, nodes, 6), scratch of `dynamics.index1`
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
    settled: Array


@by_address
class Border(NamedTuple):
    """Bordered system beside the tree: closures and springs between points [m], [N]."""

    ties: Ties
    pulls: Pulls
    layout: Layout


@by_address
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


@by_address
class Instants(NamedTuple):
    """Prescribed quantities at the instants of a chunk of steps.

    joints : relative motion with a leading axis (samples, nodes, ...) [m, rad, s]; table : (samples, loads, 6) wrenches of the
    loads [N], [N m]; efforts : (samples, unknowns or 0) of drives [N m], [N]; given : (samples, rows or 0, 3) terms of
    prescribed joints in couplings [rad], [m] and rates
    """

    joints: Joints
    table: Array
    efforts: Array
    given: Array


@by_address
class Histories(NamedTuple):
    """Histories into which samples are written (`dynamics.solver.Trajectory`), with a leading axis of samples.

    x, r, v, w, a, al, wrench, internal, energy, multipliers, iterations
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
    iterations: NDArray[np.int64]
