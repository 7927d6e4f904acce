"""NodalMotion: the motion of every node, the interface between the two steps; rigid kinematics; steps in configuration space.

Rigid links get it from exact kinematics (`compute_rigid_motion`), flexible ones from the finite-element march (`trajectory`),
measurements could give it too; inverse dynamics never asks which.  Of relative motion ``p``, ``p'``, ``p''`` are taken in the
parent node's frame, rotation rates in the node's own frame; what a node's placement and its joint do together is one relative
motion, so that one rule walks the tree (`kinematics.tree.carry`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from math import perm

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.errors import InputError
from flexinv.kernels.memory import make_adjacent_arrays, make_contiguous
from flexinv.kernels.so3 import from_quaternion, log_so3
from flexinv.kinematics.configuration import build_nodes, fill_relative_motion, fill_world_motion, integrate_array
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.tree import Frames, Joints
from flexinv.model.joint_kinds import CIRCLE, CONTINUOUS, FREE, KINDS, POSE, ROTATION, SPHERICAL
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.typing import Array, Mask


@dataclass(frozen=True)
class NodalMotion:
    """Poses, velocities and accelerations of all nodes at all samples.

    x, v, a : (samples, nodes, 3) [m], [m/s], [m/s^2] in the world frame
    rotation : (samples, nodes, 3, 3), R_W,node
    omega, alpha : (samples, nodes, 3) [rad/s], [rad/s^2] in the node's own frame
    """

    x: Array
    rotation: Array
    v: Array
    omega: Array
    a: Array
    alpha: Array

    @property
    def parts(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """The arrays in their order [m, rad, s]."""
        return self.x, self.rotation, self.v, self.omega, self.a, self.alpha

    @property
    def frames(self) -> Frames:
        """The motion as kernels take it, all samples [m, rad, s]."""
        return Frames(*(make_contiguous(part) for part in self.parts))

    @classmethod
    def make_uninitialized(cls, samples: int, nodes: int) -> NodalMotion:
        """Return arrays to be filled [m, rad, s]; nothing is in them."""
        return cls(*make_adjacent_arrays((samples, nodes, 3), (samples, nodes, 3, 3), *4 * [(samples, nodes, 3)]))

    def take_samples(self, span: slice) -> NodalMotion:
        """Return the samples of ``span``, not copied [m, rad, s]."""
        return NodalMotion(*(part[span] for part in self.parts))

    def compute_point_motion(self, node: int, place: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity, acceleration (samples, 3) [m, s] of a place (3,) in a node's frame, -1: the world.

        x + R p,  v + R (w x p),  a + R (al x p + w x (w x p))
        """
        if node < 0:
            still = np.zeros((len(self.x), 3))
            return still + place, still, still
        r = self.rotation[:, node]
        w = self.omega[:, node]
        spin = np.cross(w, place)
        swing = np.cross(self.alpha[:, node], place) + np.cross(w, spin)
        v, a = (np.einsum("sij,sj->si", r, part) for part in (spin, swing))
        return self.x[:, node] + r @ place, self.v[:, node] + v, self.a[:, node] + a


ORDER = 2  # of the formulas of `compute_differenced_motion`, in the step
FEWEST_SAMPLES = 4  # that the formulas at the ends need


def check_samples(samples: int, step: float) -> None:
    """Raise InputError if there are too few samples of ``step`` [s] for the difference formulas."""
    if samples < FEWEST_SAMPLES:
        needed = f"the incremental mode needs at least {FEWEST_SAMPLES} samples"
        raise InputError(f"{needed}, step = {step:g} s gives {samples}: write a smaller step")


def compute_differenced_motion(motion: NodalMotion, step: float) -> NodalMotion:
    """Return the motion with v, a, omega, alpha from differences of poses over ``step`` [s], the paper's incremental mode.

    Second-order formulas, so the torque error falls with the square of the step:
        inside   x'_n = (x_(n+1) - x_(n-1)) / 2h,      x''_n = (x_(n+1) - 2 x_n + x_(n-1)) / h^2
        ends     x'_0 = (-3 x_0 + 4 x_1 - x_2) / 2h,   x''_0 = (2 x_0 - 5 x_1 + 4 x_2 - x_3) / h^2
    and for rotations the increments phi_n = log(R_n^T R_(n+1)) / h, which are mid-step angular velocities in the body frame:
        w_n = (phi_n + phi_(n-1)) / 2,                 al_n = (phi_n - phi_(n-1)) / h     (linear extrapolation at the ends).
    Raises InputError with fewer than four samples.
    """
    check_samples(len(motion.x), step)
    v = np.gradient(motion.x, step, axis=0, edge_order=2)
    a = _add_end_values(np.diff(motion.x, 2, axis=0) / step**2)
    phi = log_so3(np.einsum("snji,snjk->snik", motion.rotation[:-1], motion.rotation[1:])) / step  # (step, node, xyz)
    first = 1.5 * phi[:1] - 0.5 * phi[1:2]
    last = 1.5 * phi[-1:] - 0.5 * phi[-2:-1]
    omega = np.concatenate([first, 0.5 * (phi[1:] + phi[:-1]), last])
    return NodalMotion(motion.x, motion.rotation, v, omega, a, _add_end_values(np.diff(phi, axis=0) / step))


def _add_end_values(inner: Array) -> Array:
    """Values inside with one more at each end, linear from the two next to it: of differences again of second order."""
    return np.concatenate([2 * inner[:1] - inner[1:2], inner, 2 * inner[-1:] - inner[-2:-1]])


# Joint motion as a function of time: time (samples,) [s] -> q (samples, nq), qd, qdd (samples, nv) [rad or m, s].
JointHistory = Callable[[Array], tuple[Array, Array, Array]]


def compute_relative_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> Joints:
    """Return the motion of every node in its parent's frame [m, rad, s], (samples, nodes, ...), for q (samples, nq), qd, qdd.

    Velocity of a free joint is linear then angular, both in the child's frame: p' = R_j v, p'' = R_j (v' + w x v).
    """
    out = _make_joint_arrays((len(q), mesh.size, 3))
    fill_relative_motion(build_nodes(mesh), make_contiguous(q), make_contiguous(qd), make_contiguous(qdd), out)
    return out


def _make_joint_arrays(vector: tuple[int, ...]) -> Joints:
    return Joints(*make_adjacent_arrays(*3 * [vector], (*vector, 3), *2 * [vector]))


def read_scalar_coordinate(joint: Joint, q: Array, history: bool = True) -> Array:
    """Return the coordinate (samples,) [rad], [m] of a joint that has one, from its own columns of q (samples, nq).

    history : q is a motion, along which the angle of a continuous joint is followed over whole turns; else it is in -pi .. pi
    """
    if not KINDS[joint.kind].circle:
        return q[:, 0]
    return np.unwrap(np.arctan2(q[:, 1], q[:, 0])) if history else np.arctan2(q[:, 1], q[:, 0])


def collect_scalar_places(mechanism: Mechanism, q: Array) -> Array:
    """Return angles or lengths (samples, nv) [rad], [m] of q (samples, nq), nan of joints that have none: rotations in space."""
    places = np.full((len(q), mechanism.nv), np.nan)
    for joint in mechanism.joints:
        coordinates = q[:, mechanism.q_slices[joint.name]]
        at = mechanism.v_slices[joint.name]
        if joint.nv == 1:
            places[:, at] = read_scalar_coordinate(joint, coordinates)[:, None]
        elif KINDS[joint.kind].scalar:
            places[:, at] = coordinates
    return places


def compute_rigid_motion(mesh: Mesh, q: Array, qd: Array, qdd: Array) -> NodalMotion:
    """Return the nodal motion [m, rad, s] of the undeformed mechanism for q (samples, nq), qd, qdd (samples, nv).

    Each node's pose, velocity and acceleration follow from its parent's by the equations at the head of `kinematics.tree`.
    """
    motion = NodalMotion.make_uninitialized(len(q), mesh.size)
    fill_world_motion(
        build_nodes(mesh),
        make_contiguous(q),
        make_contiguous(qd),
        make_contiguous(qdd),
        _make_joint_arrays((mesh.size, 3)),
        Frames(*motion.parts),
    )
    return motion


def integrate_configuration(mechanism: Mechanism, q: Array, dv: Array) -> Array:
    """Return q (nq,) [rad], [m] after the increment ``dv`` (nv,) [rad], [m] of its velocity coordinates (body frame)."""
    out = np.array(q, dtype=float)
    integrate_array(build_nodes(build(mechanism)), out, make_contiguous(dv))
    return out


def compute_difference(mechanism: Mechanism, q0: Array, q1: Array) -> Array:
    """Return the increment (nv,) [rad], [m] of the velocity coordinates from q0 (nq,) to q1: ``moved(m, q0, it)`` is q1."""
    out = np.zeros(mechanism.nv)
    for joint in mechanism.joints:
        columns = mechanism.q_slices[joint.name]
        layout = KINDS[joint.kind].layout
        first = q0[columns]
        last = q1[columns]
        if layout == CIRCLE:
            change = np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last)
        elif layout == ROTATION:
            change = log_so3(from_quaternion(first).T @ from_quaternion(last))
        elif layout == POSE:
            turn = from_quaternion(first[3:])
            change = np.concatenate([turn.T @ (last[:3] - first[:3]), log_so3(turn.T @ from_quaternion(last[3:]))])
        else:
            change = last - first
        out[mechanism.v_slices[joint.name]] = change
    return out


def sample_between_instants(
    mechanism: Mechanism, first: list[Array], last: list[Array], duration: float, parts: int
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield q (nq,), qd, qdd (nv,) [m, rad, s] at the ends of so many ``parts`` of the ``duration`` [s] between two instants.

    first, last : q, qd, qdd at its ends, which a polynomial of fifth degree in the increment of the coordinates meets; where a
        joint turns about an axis that changes, its rates are those of the coordinates up to the square of the increment
    """
    step = compute_difference(mechanism, first[0], last[0])

    def compute_powers(s: float, n: int) -> Array:  # derivatives of the powers of s
        return np.array([0.0 if k < n else perm(k, n) * s ** (k - n) for k in range(6)])

    places = (np.zeros_like(step), first), (step, last)
    ends = [part for place, (_, rate, change) in places for part in (place, duration * rate, duration**2 * change)]
    at_ends = np.array([compute_powers(s, n) for s in (0.0, 1.0) for n in range(3)])
    factors = np.linalg.solve(at_ends, np.stack(ends))  # (power, coordinate)
    for k in range(1, parts):
        value, rate, change = (compute_powers(k / parts, n) @ factors for n in range(3))
        yield integrate_configuration(mechanism, first[0], value), rate / duration, change / duration**2
    yield last[0], last[1], last[2]


def compute_nearest_difference(mechanism: Mechanism, first: Array, last: Array) -> Array:
    """Return the increment (nv,) [rad], [m] as `compute_difference` does, of angles within half a turn."""
    out = compute_difference(mechanism, first, last)
    for joint in mechanism.joints:
        if KINDS[joint.kind].repeats and not KINDS[joint.kind].circle:
            columns = mechanism.v_slices[joint.name]
            out[columns] = (out[columns] + np.pi) % (2 * np.pi) - np.pi
    return out


def list_sliding_coordinates(mechanism: Mechanism) -> Mask:
    """Return a mask (nv,) [-] of the velocity coordinates that are translations, not rotations."""
    return np.array([slide for joint in mechanism.joints for slide in KINDS[joint.kind].translations], dtype=bool)


def fill_passive(mesh: Mesh, motion: NodalMotion, passive: Collection[str], q: Array, qd: Array, qdd: Array) -> None:
    """Write the coordinates of the passive joints into q (samples, nq), qd, qdd (samples, nv) [rad or m, s].

    R_j = R_A^T R_B, w_j = w_B - R_j^T w_A, al_j = al_B - R_j^T al_A - (R_j^T w_A) x w_j, and likewise for p = R_A^T (x_B - x_A).
    """
    for name in set(passive) & mesh.mechanism.joint_of.keys():
        span = mesh.mechanism.v_slices[name]
        for node in np.flatnonzero((mesh.v_index >= span.start) & (mesh.v_index < span.stop)):
            nq = mesh.q_index[node]
            nv = mesh.v_index[node]
            places, rates, accelerations = _resolve_coordinates(mesh, motion, int(node), q[0, nq:])
            q[:, nq : nq + places.shape[1]] = places
            qd[:, nv : nv + rates.shape[1]] = rates
            qdd[:, nv : nv + accelerations.shape[1]] = accelerations


def _resolve_coordinates(mesh: Mesh, motion: NodalMotion, node: int, first: Array) -> tuple[Array, Array, Array]:
    """Coordinates, rates and accelerations of the joint of a node (samples, each); ``first`` : where they are to begin."""
    kind = int(mesh.kind[node])
    axis = mesh.axis[node]
    p, dp, ddp, turn, rate, acceleration = _compute_joint_motion(mesh, motion, node)
    if kind == SPHERICAL:
        return _compute_quaternions(turn, first[:4]), rate, acceleration
    if kind == FREE:
        v = np.einsum("sji,sj->si", turn, dp)  # (sample, xyz), child's frame
        dv = np.einsum("sji,sj->si", turn, ddp) - np.cross(rate, v)
        places = np.hstack([p, _compute_quaternions(turn, first[3:7])])
        return places, np.hstack([v, rate]), np.hstack([dv, acceleration])
    if not mesh.turn[node].any():
        return (p @ axis)[:, None], (dp @ axis)[:, None], (ddp @ axis)[:, None]
    angle = np.unwrap(log_so3(turn) @ axis)
    if kind == CONTINUOUS:
        places = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        places = (angle + 2 * np.pi * np.round((first[0] - angle[0]) / (2 * np.pi)))[:, None]
    return places, (rate @ axis)[:, None], (acceleration @ axis)[:, None]


def _compute_joint_motion(mesh: Mesh, motion: NodalMotion, node: int) -> tuple[Array, ...]:
    """Joint motion of one node in the joint frame: p, p', p'' and R_j, with rates in the node's frame."""
    placed = mesh.rotation[node]
    offset = mesh.offset[node]
    parent = mesh.parent[node]
    x = motion.x[:, node]
    r = motion.rotation[:, node]
    v = motion.v[:, node]
    w = motion.omega[:, node]
    a = motion.a[:, node]
    al = motion.alpha[:, node]
    if parent < 0:
        return (x - offset) @ placed, v @ placed, a @ placed, placed.T @ r, w, al
    rm = motion.rotation[:, parent]
    wm = motion.omega[:, parent]
    alm = motion.alpha[:, parent]

    def convert_to_parent(vector: Array) -> Array:
        return np.asarray(np.einsum("sji,sj->si", rm, vector))  # (sample, xyz), parent's frame

    p = convert_to_parent(x - motion.x[:, parent])
    dp = convert_to_parent(v - motion.v[:, parent]) - np.cross(wm, p)
    ddp = (
        convert_to_parent(a - motion.a[:, parent])
        - np.cross(alm, p)
        - np.cross(wm, np.cross(wm, p))
        - 2 * np.cross(wm, dp)
    )
    whole = np.einsum("sji,sjk->sik", rm, r)  # R_A,B with the placement
    carried = np.einsum("sji,sj->si", whole, wm)
    rate = w - carried
    acceleration = al - np.einsum("sji,sj->si", whole, alm) - np.cross(carried, rate)
    return (p - offset) @ placed, dp @ placed, ddp @ placed, placed.T @ whole, rate, acceleration


def _compute_quaternions(turn: Array, first: Array) -> Array:
    """Unit quaternions x, y, z, w (samples, 4), without sign jumps from the ``first`` on along the samples."""
    out = scipy.spatial.transform.Rotation.from_matrix(turn).as_quat()
    same = np.where(np.sum(out * np.concatenate([first[None], out[:-1]]), axis=1) < 0, -1.0, 1.0)
    return np.asarray(out * np.cumprod(same)[:, None])
