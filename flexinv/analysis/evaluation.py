"""From a trajectory to a Solution: the paper's second step, and everything else that follows from nodal motion."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from flexinv.analysis.solution import LoopForces, Solution
from flexinv.analysis.task import Settings
from flexinv.constraints.loop_starts import build_joint_mask
from flexinv.dynamics.section_strains import split_by_beam
from flexinv.dynamics.system import Trajectory
from flexinv.elements.joint_law import compute_smooth_direction
from flexinv.inverse.balance import Balance
from flexinv.inverse.inverse_dynamics import (
    NodalForces,
    compute_applied_forces,
    compute_internal_efforts,
    compute_joint_wrenches,
    compute_nodal_forces,
)
from flexinv.inverse.nodal_sums import SecondStepArrays, SecondStepInputs, Skeleton, fill_second_step
from flexinv.inverse.part_forces import compare_torques
from flexinv.inverse.spring_lengths import InterpolatedMotion, check_spring_lengths
from flexinv.kernels.memory import make_adjacent_arrays, make_contiguous
from flexinv.kinematics.mesh import Mesh, list_tips
from flexinv.kinematics.nodal_motion import NodalMotion, compute_differenced_motion, compute_rigid_motion
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Triple


@dataclass(frozen=True)
class FirstStep:
    """Result of the paper's first step: the motion of nodes and joints, and what acts on the nodes beside.

    time : (samples,) [s]; joints : q (samples, nq), qd, qdd (samples, nv) [rad or m, s]
    applied : springs, given forces and closures [N], [N m]; brought : (samples,) energy that impacts bring [J]
    smooth : joints whose dry friction was smooth in the march
    loops : forces of closures; geared : (samples, nv) efforts that couplings give in place of drives [N m], [N]
    ends : whether it is a whole march, not a part of one, so that its energy can be checked
    """

    trajectory: Trajectory
    time: Array
    joints: Triple
    applied: NodalForces | None = None
    brought: Array | None = None
    smooth: Collection[str] = ()
    loops: LoopForces | None = None
    geared: Array | None = None
    ends: bool = True

    def apply_differences(self, step: float) -> FirstStep:
        """Return the motion with velocities and accelerations from differences of nodal positions over ``step`` [s]."""
        moved = compute_differenced_motion(self.trajectory.motion, step)
        return replace(self, trajectory=Trajectory(*moved.parts, *self.trajectory[6:]))


def assemble_solution(
    mesh: Mesh, first: FirstStep, settings: Settings, found: SecondStepArrays | None = None
) -> Solution:
    """Return the Solution of both steps [N m], [N], efforts of drives and springs included; found : of the second, where made."""
    found = run_second_step(mesh, first) if found is None else found
    mechanism = mesh.mechanism
    q, qd, qdd = first.joints
    time = first.time
    loops = first.loops
    tau, reaction = add_joint_efforts(mechanism, first, found.tau, found.reaction)
    if loops is not None and loops.left.size == 0:  # rigid loops have it from the allocation, a march only here
        loops = replace(loops, left=tau * ~mechanism.actuated)
    internal, stations = split_by_beam(mesh, first.trajectory.internal)
    elastic, _, dissipated = first.trajectory.energy.T
    balance = Balance(
        *(found.kinetic, found.potential, elastic, found.power, found.work, found.momentum, dissipated),
        meshes=compare_torques(mesh, first.trajectory.motion, time),
    )
    # samples left out may hide work
    whole = not settings.incremental and time[-1] - time[0] < 1.5 * settings.step * len(time)
    if whole:
        balance.check(mesh, time, qd, set(first.smooth), settings.step)
    solution = Solution(
        mechanism=mechanism, mesh=mesh, time=time, q=q, qd=qd, qdd=qdd,
        torque_all=tau, reaction=reaction, nodes=first.trajectory.motion, forces=NodalForces(found.force, found.moment),
        tip=dict(zip((joint.child for joint in mechanism.joints), found.tip, strict=True)),
        deflection={link.name: deflection for link, deflection in zip(mechanism.beams, found.deflection, strict=True)},
        wrench=dict(zip(mesh.joint_node, found.wrench, strict=True)),
        internal=internal, internal_stations=stations, balance=balance, loops=loops,
        iterations=first.trajectory.iterations, settings=settings.describe_settings(), notes=mechanism.notes,
    )  # fmt: skip
    if whole and first.ends:
        solution.check_energy()
    return solution


def add_joint_efforts(mechanism: Mechanism, first: FirstStep, tau: Array, reaction: Array) -> tuple[Array, Array]:
    """Return efforts (samples, nv) [N m], [N] of both sides with joints' rotors, damping, friction, springs, less couplings'."""
    if mechanism.drive_table[:4].any():
        internal_efforts = compute_internal_efforts(
            mechanism, *first.joints, direction=_compute_friction_direction(mechanism, first.joints[1], first.smooth)
        )
        tau = tau + internal_efforts
        reaction = reaction + internal_efforts
    return (tau, reaction) if first.geared is None else (tau - first.geared, reaction - first.geared)


def run_second_step(mesh: Mesh, first: FirstStep) -> SecondStepArrays:
    """Return the paper's second step: nodal forces P = M (a - g) [N], [N m], joint efforts tau = L T P, tips, balances.

    One compiled pass reads every sample once (`nodal_sums.second_step_samples`); `inverse_dynamics` is the same step by step.
    """
    none = np.empty((0, 0, 0))
    shapes = list_array_shapes(mesh, len(first.time))
    trajectory = first.trajectory
    applied = first.applied
    # Series but those of all nodes have memory of their own: who keeps the tips of many solutions keeps nothing else of them.
    second_step_arrays = SecondStepArrays(
        *make_adjacent_arrays(*shapes[:2]), *(np.empty(shape) for shape in shapes[2:])
    )
    pushed = (none, none) if applied is None else (applied.force, applied.moment)
    jumps = np.empty(0) if first.brought is None else first.brought
    series = trajectory.wrench, trajectory.energy, *pushed, jumps, first.joints[1], first.time
    second_step_inputs = SecondStepInputs(*map(make_contiguous, series))
    line = np.empty((mesh.size, 6))
    fill_second_step(build_skeleton(mesh), trajectory.motion.frames, second_step_inputs, line, second_step_arrays)
    return second_step_arrays


def list_array_shapes(mesh: Mesh, samples: int) -> list[tuple[int, ...]]:
    """Return the shapes of the parts of `SecondStepArrays` [-]."""
    k = build_skeleton(mesh)
    nodal = (samples, mesh.size, 3)
    joints = (samples, mesh.mechanism.nv)
    named = [(len(k.joint), samples, 6), (len(k.tip), samples, 3), (len(k.root), samples, 3)]
    return [nodal, nodal, joints, joints, *named, *4 * [(samples,)], (samples, 6)]


@make_owner_cache()
def build_skeleton(mesh: Mesh) -> Skeleton:
    """Return the data of a mesh that the second step reads [m], [kg]."""
    m = mesh.mechanism
    tips = list_tips(mesh)
    straight = np.zeros((len(m.beams), 3))
    for place, link in zip(straight, m.beams, strict=True):
        turn = np.eye(3)
        for node in mesh.section_nodes[link.name][1:]:
            place += turn @ mesh.offset[node]
            turn = turn @ mesh.rotation[node]
    numbers = [list(mesh.joint_node.values()), [node for _, node, _ in tips]]
    numbers += [[int(mesh.section_nodes[link.name][k]) for link in m.beams] for k in (0, -1)]
    joint, tip, root, last = (np.array(nodes, dtype=np.int64) for nodes in numbers)
    points = np.array([point for _, _, point in tips], float).reshape(-1, 3)
    gravity = np.array(m.gravity, dtype=float)
    moved = mesh.freedoms, mesh.v_index, mesh.slide, mesh.turn
    return Skeleton(mesh.parent, mesh.mass, mesh.inertia, gravity, *moved, joint, tip, points, root, last, straight)


def build_rigid_first_step(
    mesh: Mesh, time: Array, joints: Triple, given: InterpolatedMotion | None = None
) -> FirstStep:
    """Return the first step of a rigid mechanism whose joints all have a motion [m, rad, s, N]: exact kinematics.

    given : the motion between the samples, where it can be asked there
    """
    motion = compute_rigid_motion(mesh, *joints)
    check_spring_lengths(mesh, motion, time, given)
    applied = compute_applied_forces(mesh, motion, time)
    return FirstStep(build_rigid_trajectory(mesh, motion, applied), time, joints, applied)


def build_rigid_trajectory(mesh: Mesh, motion: NodalMotion, applied: NodalForces | None = None) -> Trajectory:
    """Return the trajectory of a rigid mechanism [m, rad, s, N]: exact kinematics, nothing to march; wrenches are those of P."""
    wrenches = compute_joint_wrenches(mesh, motion, compute_nodal_forces(mesh, motion, applied))
    wrench = np.dstack([wrenches.force, np.einsum("snji,snj->sni", motion.rotation, wrenches.moment)])
    samples = len(wrench)
    shapes = ((*mesh.elements.weight.shape, 6), (3,), (0,))
    internal, energy, multipliers = (np.zeros((samples, *shape)) for shape in shapes)
    return Trajectory(*motion.parts, wrench, internal, energy, multipliers, np.zeros(samples, dtype=np.int64))


def _compute_friction_direction(mechanism: Mechanism, qd: Array, smooth_of: Collection[str]) -> Array:
    """Direction of dry friction: the sign of the rate, smoothed as in the march where the joint is passive.

    There FRICTION_RATE decides how slowly a joint that should stick creeps, and how short the steps have to be: Newton takes
    changes of the rate of up to some 20 FRICTION_RATE in a step.  A pendulum that friction stops
    (tests/flexinv/dynamics/test_friction.py):

        FRICTION_RATE   creeps, at 3/4 of what holds   beside sharp friction   Newton converges at steps of
        1e-2 rad/s      8e-3 rad/s                     1e-3 rad                10, 4, 1 ms
        1e-3            9e-4                           1e-4                    4, 1 ms
        1e-4            not to be had                                          none of them
    """
    if not any(joint.friction for joint in mechanism.joints):
        return np.zeros_like(qd)
    return np.where(build_joint_mask(mechanism, smooth_of), compute_smooth_direction(qd), np.sign(qd))
