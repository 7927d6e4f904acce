"""States along a march as the tangents take them: of a mechanism all of whose joints are unknowns."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np

from flexinv.dynamics.constraint_rows import PULL
from flexinv.dynamics.generalized_alpha import STATICS
from flexinv.dynamics.linearization import count_entries
from flexinv.dynamics.loads import build_load_table
from flexinv.dynamics.solver import Solver, build_coordinate_map
from flexinv.dynamics.system import Trajectory
from flexinv.elements.beam_element import Elements
from flexinv.errors import ConvergenceError, InputError
from flexinv.kernels.so3 import exp_so3, log_so3
from flexinv.kinematics.mesh import Mesh, build, list_tips
from flexinv.kinematics.nodal_motion import (
    NodalMotion,
    collect_scalar_places,
    compute_relative_motion,
    integrate_configuration,
)
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.planar.detection import NotPlanar, find_plane
from flexinv.sensitivity.border_tangents import BorderScratch
from flexinv.sensitivity.tangent_kernel import integrate_tangents
from flexinv.sensitivity.tangent_records import (
    ForceRecord,
    MarchedFreedoms,
    MarchStates,
    ParameterInputs,
    StepTangents,
    StepTurns,
    TangentHistories,
    TangentScratch,
    TangentTask,
    TipNodes,
    make_marched_freedoms,
)
from flexinv.typing import Array, Indices, Triple

ALIGNED = 1e-12  # of an axis: components below it are rounding
END_CHANGE = (
    1e-4  # [m] or [rad] of the largest pose, or of the parameter's unit: its square is left out, four digits are lost
)


@dataclass(frozen=True)
class FreeSystem:
    """A mechanism all of whose joints are unknowns; its residual is then the effort of every joint.

    unknown : (nv,) the unknown of each velocity coordinate; sections : nodes with six unknowns each, first : (sections,) of these
    """

    solver: Solver
    unknown: Indices
    sections: Indices
    first: Indices

    @property
    def mesh(self) -> Mesh:
        """Return its mesh [m]."""
        return self.solver.mesh

    @property
    def constraints(self) -> int:
        """Return the number of rows of its closures [-]."""
        return int((self.solver.border.ties.kind != PULL).sum())

    @property
    def rows(self) -> int:
        """Return the number of rows of its closures and springs [-]."""
        return len(self.solver.border.ties.kind)

    @property
    def size(self) -> int:
        """Return the number of unknowns [-]."""
        return len(self.solver.topology.scale)

    def make_freedoms(self, marched: Collection[str]) -> MarchedFreedoms:
        """Return the unknowns with a motion and those that are marched, joints named in ``marched`` among them [-]."""
        mechanism = self.mesh.mechanism
        names = [name for name, columns in mechanism.v_slices.items() for _ in range(columns.start, columns.stop)]
        prescribed = np.array(
            [at for name, at in zip(names, self.unknown, strict=True) if name not in marched], dtype=np.int64
        )
        return make_marched_freedoms(self.size, prescribed, np.setdiff1d(np.arange(self.size), prescribed))


def take_plane_freedoms(system: FreeSystem, freedoms: MarchedFreedoms, meshes: Iterable[Mesh]) -> MarchedFreedoms:
    """Return the freedoms without those out of the plane [-] in which a mechanism and those beside it, ``meshes``, move.

    There is none where mirrors at the plane leave all of them unchanged.  Where the plane is none of two axes of the world, or a
    section's axes are not along its own, all freedoms stay.
    """
    plane = find_plane(system.mesh)
    others = [find_plane(mesh) for mesh in meshes]
    if isinstance(plane, NotPlanar):
        return freedoms
    for other in others:
        if isinstance(other, NotPlanar) or abs(other.axes[:, 2] @ plane.axes[:, 2]) < 1.0 - ALIGNED:
            return freedoms
    across = np.zeros(system.size)
    across[system.first[:, None] + np.arange(3)] = np.abs(plane.axes[:, 2])
    across[system.first[:, None] + np.arange(3, 6)] = 1.0 - np.abs(plane.frames[system.sections, 2])
    if (np.minimum(across, 1.0 - across) > ALIGNED).any():
        return freedoms
    free = freedoms.marched[across[freedoms.marched] < 0.5]
    return make_marched_freedoms(system.size, freedoms.prescribed, free)


def build_free_system(mechanism: Mechanism, prescribed: Collection[str]) -> FreeSystem:
    """Return the mechanism with all joints as unknowns [m, rad]; dry friction of those with a motion is left out.

    Its effort has no derivative but where the rate changes its sign.
    """
    mesh = build(_take_off_friction(mechanism, frozenset(prescribed)))
    solver = Solver.build_for(mesh, {joint.name for joint in mechanism.joints if joint.nv})
    unknown = build_coordinate_map(mesh, solver.topology).argmax(axis=1)
    t = solver.topology
    sections = np.flatnonzero(t.independent)
    return FreeSystem(solver, unknown, sections, t.first[sections])


@make_owner_cache(most=8)
def _take_off_friction(mechanism: Mechanism, names: frozenset[str]) -> Mechanism:
    """The mechanism without dry friction in some joints; it keeps its mesh."""
    joints = tuple(replace(j, friction=0.0) if j.name in names else j for j in mechanism.joints)
    return apply_stated_ratio(replace(mechanism, joints=joints))


def build_varied_system(system: FreeSystem, mechanism: Mechanism, prescribed: Collection[str]) -> FreeSystem:
    """Return another mechanism with all joints as unknowns [m, rad].  Raises InputError where it has more, or fewer."""
    varied = build_free_system(mechanism, prescribed)
    if (varied.size, varied.rows) != (system.size, system.rows):
        raise InputError(
            f"differentiate: a parameter changes the number of unknowns or constraints of '{mechanism.name}': {system.size} and "
            f"{system.rows}, beside it {varied.size} and {varied.rows}; expected one that changes numbers alone"
        )
    return varied


def build_march_states(system: FreeSystem, motion: NodalMotion, joints: Triple, time: Array) -> MarchStates:
    """Return the states of a nodal motion at some times (samples,) [s], with joints q, qd, qdd [rad or m, s].

    Closures and springs are without force.
    """
    mesh = system.mesh
    t = system.solver.topology
    q, qd, qdd = joints
    relative = compute_relative_motion(mesh, q, qd, qdd)
    held = t.freedoms > 0
    x = np.zeros((len(time), mesh.size, 3))
    r = np.tile(np.eye(3), (len(time), mesh.size, 1, 1))
    x[:, system.sections] = motion.x[:, system.sections]
    r[:, system.sections] = motion.rotation[:, system.sections]
    x[:, held] = relative.p[:, held]
    r[:, held] = relative.r[:, held]
    u, du, place = np.zeros((3, len(time), system.size))
    place[:, system.unknown] = collect_scalar_places(mesh.mechanism, q)
    u[:, system.unknown] = qd
    du[:, system.unknown] = qdd
    at = system.first[:, None] + np.arange(6)
    s = system.sections
    u[:, at] = np.concatenate([motion.v[:, s], motion.omega[:, s]], axis=2)
    du[:, at] = np.concatenate([motion.a[:, s], motion.alpha[:, s]], axis=2)
    loads = build_load_table(mesh, time)
    coupling = np.ascontiguousarray(system.solver.compute_coupling_terms(q, qd, qdd))
    return MarchStates(x, r, u, du, place, relative, loads, np.zeros((len(time), system.rows)), coupling)


def build_turns(system: FreeSystem, states: MarchStates) -> StepTurns:
    """Return the rotations of the sections over each step of a path [-]; the first sample has none."""
    r = states.r[:, system.sections]
    vector = np.zeros((*r.shape[:2], 3))
    vector[1:] = log_so3(np.einsum("snji,snjk->snik", r[:-1], r[1:]))
    at = np.full(system.size, -1, dtype=np.int64)
    number = np.zeros(system.size, dtype=np.int64)
    for k, first in enumerate(system.first + 3):
        at[first : first + 3] = first
        number[first : first + 3] = k
    return StepTurns(at, number, system.first + 3, vector, np.zeros((len(system.first), 3, 3)))


def sample_forces(
    system: FreeSystem, states: MarchStates, slopes: bool = False, trajectory: bool = False
) -> ForceRecord:
    """Return forces [N], [N m], tips [m] and closures along a path, springs pulling as they must.

    slopes, trajectory : whether to record these, too

    Raises ConvergenceError where an element turns too much.
    """
    tips = list_tip_nodes(system)
    samples = len(states.x)
    record = ForceRecord(
        residual=np.empty((samples, system.size)),
        tip=np.empty((samples, len(tips.node), 3)),
        pulls=np.empty((samples, system.rows)),
        gradient=np.empty((samples, system.rows, system.size)),
        closing=np.empty((3, samples, system.rows)),
        slopes=np.empty((2, samples if slopes else 0, system.rows, system.size)),
        trajectory=Trajectory.make_uninitialized(samples if trajectory else 0, system.mesh),
    )
    task = TangentTask(
        states, states, build_turns(system, states), make_no_inputs(), system.make_freedoms(()), tips, False
    )
    tangents = StepTangents(*np.empty((5, system.size, 0)))
    room = make_histories(system, 0, 0, 0)
    solver = system.solver
    massive = build_massive_solver(solver)
    scratch = make_tangent_scratch(system, 0, 0)
    bad = int(integrate_tangents(solver.system, massive.system, task, STATICS, tangents, scratch, room, record))
    if bad >= 0:
        raise ConvergenceError(
            f"mechanism '{system.mesh.mechanism.name}': an element turns too much in sample {bad} where a parameter is varied; "
            "use more elements"
        )
    return record


def compute_end_slopes(system: FreeSystem, states: MarchStates, tangents: StepTangents, joints: Triple) -> NodalMotion:
    """Return the derivatives of all nodes' motion in the last sample, with an axis of parameters in place of samples [m, rad, s].

    rotation : (parameters, nodes, 3, 3), derivatives of the matrices; joints : q (nq,), qd, qdd (nv,) of then [rad or m, s]
    Differences along the tangents, whose error is of the square of `END_CHANGE`; what a parameter moves at given unknowns is
    left out.
    """
    found = tangents.shown if system.constraints else tangents.acceleration
    moves = np.stack([tangents.pose.T, tangents.rate.T, found.T])
    change = END_CHANGE / np.maximum(np.abs(moves[0]).max(axis=1, initial=0.0), 1.0)
    moves *= change[:, None]
    beside = _move_end(system, states, np.concatenate([moves, -moves], axis=1), joints)
    motion = sample_forces(system, beside, trajectory=True).trajectory.motion
    count = len(change)
    over = 0.5 / change
    parts = (part[:count] - part[count:] for part in motion.parts)
    return NodalMotion(*(over.reshape(count, *(1,) * (part.ndim - 1)) * part for part in parts))


def _move_end(system: FreeSystem, states: MarchStates, moves: Array, joints: Triple) -> MarchStates:
    """States beside the last one, each by one of the ``moves`` (3, moves, unknowns) of pose, rate and acceleration."""
    pose, rate, acceleration = moves
    count = len(pose)
    mechanism = system.mesh.mechanism
    q, qd, qdd = joints
    by_joint = system.unknown
    moved = np.stack([integrate_configuration(mechanism, q, one) for one in pose[:, by_joint]])
    relative = compute_relative_motion(system.mesh, moved, qd + rate[:, by_joint], qdd + acceleration[:, by_joint])
    s = system.sections
    at = system.first[:, None] + np.arange(6)
    last = MarchStates(
        x=_copy_last(states.x, count),
        r=_copy_last(states.r, count),
        u=_copy_last(states.u, count),
        du=_copy_last(states.du, count),
        place=_copy_last(states.place, count),
        joints=relative,
        table=_copy_last(states.table, count),
        multiplier=_copy_last(states.multiplier, count),
        coupling=_copy_last(states.coupling, count),
    )
    last.x[:, s] += pose[:, at[:, :3]]
    last.r[:, s] = last.r[:, s] @ exp_so3(pose[:, at[:, 3:]])
    last.u[:] += rate
    last.du[:] += acceleration
    last.place[:] += pose
    held = system.solver.topology.freedoms > 0
    last.x[:, held] = relative.p[:, held]
    last.r[:, held] = relative.r[:, held]
    return last


def _copy_last(history: Array, count: int) -> Array:
    """So many copies of the last sample of a history."""
    return np.repeat(history[-1:], count, axis=0)


def build_massive_solver(solver: Solver) -> Solver:
    """Return the solver without its elements where none is damped: they then have no part in C and M [kg], [N s/m]."""
    if len(solver.elements.damping):
        return solver
    return replace(solver, elements=Elements._make(part[:0] for part in solver.elements))


def make_tangent_scratch(system: FreeSystem, marched: int, parameters: int) -> TangentScratch:
    """Return the scratch of a march with so many marched unknowns and parameters [any unit]; none where there are none."""
    count = count_entries(system.solver) if parameters else 0
    massive = count_entries(build_massive_solver(system.solver)) if parameters else 0
    rows = system.rows
    tied = (system.size, system.size) if rows else (0, 0)
    by_unknown = (rows, system.size)
    border = BorderScratch(
        gradient=np.zeros(by_unknown),
        bent=np.zeros(tied),
        dragged=np.zeros(tied),
        by_pose=np.zeros(by_unknown),
        by_rate=np.zeros(by_unknown),
        across=np.zeros(by_unknown),
        closing=np.zeros((rows, parameters)),
        multiplier=np.zeros((rows, parameters)),
        left=np.zeros((marched + 2, marched)),
    )
    return TangentScratch(
        at=np.zeros((2, count), dtype=np.int64),
        stiffness=np.zeros(count),
        massive_at=np.zeros((2, massive), dtype=np.int64),
        massive=np.zeros((4, massive)),
        system=np.empty((marched, marched + parameters + rows)),
        forces=np.empty((system.size, parameters)),
        border=border,
    )


def make_histories(
    system: FreeSystem, samples: int, joints: int, parameters: int, rates: bool = False
) -> TangentHistories:
    """Return room for derivatives at so many samples, of the efforts of so many joints, with ``rates`` or without [any unit]."""
    kept = samples if rates else 0
    return TangentHistories(
        effort=np.empty((samples, joints, parameters)),
        tip=np.empty((samples, len(list_tip_nodes(system).node), 3, parameters)),
        pose=np.empty((samples, system.size, parameters)),
        rate=np.empty((kept, system.size, parameters)),
        acceleration=np.empty((kept, system.size, parameters)),
        multiplier=np.empty((kept, system.rows, parameters)),
    )


def make_no_record(system: FreeSystem) -> ForceRecord:
    """Return no room for forces and tips [any unit]."""
    none = np.empty((0, 0, 0))
    trajectory = Trajectory.make_uninitialized(0, system.mesh)
    return ForceRecord(np.empty((0, 0)), none, np.empty((0, 0)), none, none, np.empty((0, 0, 0, 0)), trajectory)


def make_no_inputs() -> ParameterInputs:
    """Return the inputs of no parameter [any unit]."""
    pushed, opened = np.empty((2, 2, 0, 0, 0))
    return ParameterInputs(np.empty((3, 0, 0, 0)), pushed, np.empty((0, 0, 3, 0)), opened, np.zeros(0, dtype=np.int64))


def list_tip_nodes(system: FreeSystem) -> TipNodes:
    """Return the tips of all links [m], in the order of the joints that carry them."""
    tips = list_tips(system.mesh)
    nodes = np.array([node for _, node, _ in tips], dtype=np.int64)
    return TipNodes(nodes, np.array([place for _, _, place in tips], dtype=float).reshape(-1, 3))
