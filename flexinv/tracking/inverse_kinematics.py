"""Rigid inverse kinematics: the joint motion with which a frame of the undeformed mechanism follows a path.

Damped least squares from sample to sample,  dq = J^T (J J^T + damping^2)^-1 e,  which is the shortest step of redundant joints;
joints at a limit are held there.  Rates and accelerations follow from the same Jacobian:

    qd = J^+ v + N N^T qd_s,        qdd = J^+ (a - J' qd) + N N^T qdd_s

with N the self-motion of redundant joints and q_s a spline through what the steps found.
Source: Nakamura, Hanafusa, *Inverse kinematic solutions with singularity robustness*, J. Dyn. Sys. Meas. Control 108, 1986.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike, NDArray

from flexinv.errors import InputError
from flexinv.kernels.smooth_pieces import fit_pieces
from flexinv.kernels.so3 import log_so3
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.kinematics.nodal_motion import NodalMotion, compute_rigid_motion
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Attachment, Mechanism
from flexinv.model.motion import resolve_start_coordinates
from flexinv.model.owned_cache import make_owner_cache
from flexinv.tracking.frame_path import Path, Poses
from flexinv.typing import Array, Indices
from flexinv.validation import refuse

SCALAR = tuple(name for name, kind in KINDS.items() if kind.scalar)
KNOTS = 65  # places of the path that are found one after the other; all samples are then found at once
ITERATIONS = 100
# Of the mechanism's length: what Newton leaves of the distance to the path (it converges quadratically: rounding).
REACHED = 1e-10
# Directions in which joints move the frame this much less than in the best one: none below NEGLIGIBLE, trouble below SINGULAR.
NEGLIGIBLE = 1e-9
SINGULAR = 1e-3
# How far beyond a limit a joint may be found [rad], [m]: what Newton leaves of the path, with a margin of ten.
AT_LIMIT = 1e-9
# Of the path's time: intervals are halved down to this.
SHORTEST_PART = 1e-10
DAMPING = 1e-2  # of the largest singular value, while the distance is large


@dataclass(frozen=True)
class Frame:
    """A frame on a node of the mesh: ``point`` (3,) [m] and axes ``turn`` (3, 3) in the node's frame; name : of its link."""

    name: str
    node: int
    point: Array
    turn: Array

    def compute_poses(self, motion: NodalMotion) -> Poses:
        """Return the motion of the frame [m, rad, s]."""
        turned = (part[:, self.node] @ self.turn for part in (motion.rotation, motion.omega, motion.alpha))
        return Poses(*motion.compute_point_motion(self.node, self.point), *turned)


@dataclass(frozen=True)
class PathMotion:
    """The joint motion of the rigid mechanism on a path.

    q : (samples, nq), qd, qdd : (samples, nv) [rad], [m], [1/s]
    within : (samples, rows, r) orthonormal directions [-] in which the drives can move the frame (rotations times a length)
    idle : (samples, drives, drives - r) self-motions of the drives that leave the frame where it is [-]
    """

    q: Array
    qd: Array
    qdd: Array
    within: Array
    idle: Array


def resolve_frame(mesh: Mesh, frame: str | Attachment) -> Frame:
    """Return the frame of an attachment or, by a link's name, at its tip [m].  Raises InputError for what is not there."""
    m = mesh.mechanism
    if not isinstance(frame, str | Attachment):
        known = f"links of '{m.name}': {', '.join(m.link_of)}"
        refuse("frame", frame, f"the name of a link, whose tip follows, or an Attachment; {known}")
    name = str(frame) if isinstance(frame, str) else frame.link
    if name not in m.link_of:
        raise InputError(f"frame on link {name!r}: expected a link of '{m.name}': {', '.join(m.link_of)}")
    if isinstance(frame, str):
        if (node := mesh.tip_node.get(name)) is not None:
            return Frame(name, int(node), np.zeros(3), np.eye(3))
        return Frame(name, find_attachment_node(mesh, Attachment(name)), m.link_of[name].tip, np.eye(3))
    node = find_attachment_node(mesh, frame)
    stations = mesh.section_stations.get(name)
    if stations is not None and frame.station is not None and np.abs(stations - frame.station).min() > NEGLIGIBLE:
        near = ", ".join(f"{s:.4g}" for s in stations)
        raise InputError(f"frame at station {frame.station:g} of '{name}': the mesh has sections at {near}")
    return Frame(name, int(node), frame.placement.position, frame.placement.rotation)


def list_drive_columns(mechanism: Mechanism) -> Indices:
    """Return the velocity coordinates [-] that have a drive.  Raises InputError for drives of joints that turn in space."""
    for joint in mechanism.joints:
        if joint.nv and joint.actuated and joint.kind not in SCALAR:
            raise InputError(
                f"joint {joint.name!r} is {joint.kind} and has a drive: a path is followed by drives of one coordinate each "
                f"({', '.join(SCALAR)}); write actuated = false, or give joints a motion with solve"
            )
    if not mechanism.actuated.any():
        raise InputError(f"mechanism '{mechanism.name}' has no drive that could follow a path")
    return np.flatnonzero(mechanism.actuated)


@dataclass(frozen=True)
class RigidPath:
    """The way of the undeformed mechanism along a path, for several sets of times.

    Angles are (samples, nv), a continuous joint's too; mesh, frame, path : what follows what
    start : guess of joint coordinates at the start of the path, zero unless given [rad], [m]; joints without a drive stay where
        it puts them
    """

    mesh: Mesh
    frame: Frame
    path: Path
    start: Mapping[str, ArrayLike] | None = None

    def solve_joint_motion(self, time: Array) -> PathMotion:
        """Return the joint motion with which the frame follows the path at ``time`` (samples,) [s].
        Raises InputError where the path cannot be reached, leads past a limit or through a singular position.
        """
        path = self.path
        spline = self._knots
        self._check_between()
        inside = np.clip(time, 0.0, path.duration)
        moving = ((time > 0.0) & (time < path.duration))[:, None]
        guess = [spline(inside), *(np.where(moving, spline(inside, nu=n), 0.0) for n in (1, 2))]
        return self._solve_path_motion(guess, path.evaluate(time), time)

    @make_owner_cache()
    def _check_between(self) -> bool:
        """Look at the whole path, whatever instants are asked for: limits of the drives, and singular positions."""
        self._check_limits()
        self._check_singular()
        return True

    def _find_angles(self, time: Array) -> Array:
        """Angles (samples, nv) at times of the path, by Newton from the spline."""
        return self._find_path_angles(self._knots(time), self.path.evaluate(time), time)

    def _check_limits(self) -> None:
        """Raise InputError with joint and instant where a drive passes a limit, at any time of the path."""
        lower, upper = self._bounds
        limited = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
        if not len(limited):
            return
        pieces = fit_pieces(
            lambda times: self._find_angles(times)[:, self._drives[limited]], [0.0, self.path.duration], 1.0
        )
        opposite = replace(pieces, coefficients=-pieces.coefficients)
        for column, drive in enumerate(limited.tolist()):
            for side, level, part in (("upper", upper[drive], pieces), ("lower", -lower[drive], opposite)):
                if not np.isfinite(level) or part.find_largest(column)[0] <= level + AT_LIMIT:
                    continue
                m = self.mesh.mechanism
                instant = part.find_crossing(column, level + AT_LIMIT)
                raise InputError(
                    f"mechanism '{m.name}': at t = {instant:.10g} s of the path joint {m.velocity_names[self._drives[drive]]!r} "
                    f"passes its {side} limit of {level if side == 'upper' else -level:g}; move the path, or give another "
                    "start = {...} of the joints"
                )

    def _check_singular(self) -> None:
        """Raise InputError with the instant where the path leads through a singular position.

        Singular values change by no more than their matrix (Weyl): an interval whose ends have s_k + s_(k+1) more than the change
        between them holds none; others are halved.  The bend of J over a part is an eighth of its second difference.
        """
        begin = np.linspace(0.0, self.path.duration, KNOTS)[:-1]
        end = np.linspace(0.0, self.path.duration, KNOTS)[1:]
        shortest = SHORTEST_PART * self.path.duration
        while len(begin):
            times = np.stack([begin, 0.5 * (begin + end), end])
            jacobians = self._compute_jacobian(self._find_angles(times.reshape(-1)))
            values: Array = np.asarray(np.linalg.svd(jacobians, compute_uv=False), dtype=np.float64)
            rank = int((values > NEGLIGIBLE * values.max()).sum(axis=1).max())
            if rank == 0:
                return  # no drive moves the frame, which is said where it is followed
            self._check_ratio(values, rank, times.reshape(-1))
            j = jacobians.reshape(3, len(begin), *jacobians.shape[1:])
            size = values[:, 0].reshape(3, -1)
            least = values[:, rank - 1].reshape(3, -1)
            change = np.linalg.norm(np.diff(j, axis=0), ord=2, axis=(2, 3)).sum(axis=0)
            bend = np.linalg.norm(j[0] - 2.0 * j[1] + j[2], ord=2, axis=(1, 2)) / 2.0
            left = least[0] + least[2] - 2.0 * SINGULAR * size.max(axis=0) <= change + bend
            left &= end - begin > shortest
            middle = times[1, left]
            begin = np.concatenate([begin[left], middle])
            end = np.concatenate([middle, end[left]])

    def _check_ratio(self, values: Array, rank: int, time: Array) -> None:
        """Raise InputError where joints move the frame hardly in a direction; values : (samples, directions) of the Jacobian."""
        if (ratio := values[:, rank - 1] / values[:, 0]).min() < SINGULAR:
            raise InputError(
                f"mechanism '{self.mesh.mechanism.name}': at t = {time[ratio.argmin()]:.10g} s the path leads the "
                f"frame on '{self.frame.name}' through a singular position (joints move it {ratio.min():.1e} times as far in one "
                "direction as in another); move the path, or give another start = {...} of the joints"
            )

    @cached_property
    def _drives(self) -> Indices:
        return list_drive_columns(self.mesh.mechanism)

    @cached_property
    def _bounds(self) -> Array:
        """Lower and upper limits of the drives, (2, drives)."""
        limits = [j.limits for j in self.mesh.mechanism.joints for _ in range(j.nv)]
        return np.array([(one.lower, one.upper) for one in limits])[self._drives].T

    @cached_property
    def _knots(self) -> scipy.interpolate.BSpline:
        """A spline through the angles at places of the path, found one after the other."""
        m = self.mesh.mechanism
        knots = np.linspace(0.0, self.path.duration, KNOTS)
        places, _ = resolve_start_coordinates(m, m.moving_names, self.start)
        angles = np.empty((KNOTS, m.nv))
        first = np.zeros(m.nv)
        for joint in m.joints:
            columns = m.v_slices[joint.name]
            if joint.kind in SCALAR and (place := places.get(joint.name)) is not None:
                first[columns] = np.arctan2(place[1], place[0]) if KINDS[joint.kind].circle else place
            elif joint.stiffness:
                first[columns] = joint.rest
        for k, at in enumerate(knots):
            angles[k] = first = self._find_angles_near(first, self.path.evaluate(np.array([at])), float(at))
        return scipy.interpolate.make_interp_spline(knots, angles, k=5)

    def _convert_angles(self, angles: Array) -> Array:
        """q (samples, nq) of angles (samples, nv)."""
        m = self.mesh.mechanism
        q = np.tile(self.mesh.mechanism.neutral, (len(angles), 1))
        for joint in m.joints:
            joint_angles = angles[:, m.v_slices[joint.name]]
            if KINDS[joint.kind].circle:
                q[:, m.q_slices[joint.name]] = np.hstack([np.cos(joint_angles), np.sin(joint_angles)])
            elif joint.kind in SCALAR:
                q[:, m.q_slices[joint.name]] = joint_angles
        return q

    def _compute_poses(self, angles: Array, rates: Array) -> Poses:
        q = self._convert_angles(angles)
        return self.frame.compute_poses(compute_rigid_motion(self.mesh, q, rates, np.zeros_like(rates)))

    def _assemble_rows(self, linear: Array, angular: Array | None) -> Array:
        """(samples, 3 or 6): a vector and, where orientation is asked for, a rotation times the mechanism's length."""
        if self.path.turn is None or angular is None:
            return linear
        return np.hstack([linear, self.mesh.length * angular])

    def _compute_deviation(self, angles: Array, target_poses: Poses) -> Array:
        """Return the deviation from the path, (samples, rows) [m]."""
        now = self._compute_poses(angles, np.zeros_like(angles))
        turn = None
        if self.path.turn is not None and now.rotation is not None and target_poses.rotation is not None:
            turn = log_so3(np.einsum("sji,sjk->sik", now.rotation, target_poses.rotation))
        return self._assemble_rows(target_poses.x - now.x, turn)

    def _compute_jacobian(self, angles: Array) -> Array:
        """(samples, rows, drives) [m]."""
        columns = []
        for drive in self._drives:
            moving = self._compute_poses(angles, np.tile(np.eye(angles.shape[1])[drive], (len(angles), 1)))
            columns.append(self._assemble_rows(moving.v, moving.omega))
        return np.stack(columns, axis=2)  # (sample, row, drive)

    def _find_angles_near(self, angles: Array, target_poses: Poses, at: float) -> Array:
        """Angles (nv,) at one place of the path, by damped least squares within the limits."""
        angles = angles.copy()
        length = self.mesh.length
        before = np.inf
        for _ in range(ITERATIONS):
            missing = self._compute_deviation(angles[None], target_poses)[0]
            if (distance := float(np.linalg.norm(missing))) < REACHED * length:
                break
            jacobian = self._compute_jacobian(angles[None])[0]
            # Newton's own step near the path, where the last one halved the distance at least
            factor = 0.0 if distance < 0.5 * before and distance < DAMPING * length else DAMPING
            before = distance
            angles[self._drives] = self._solve_step(angles[self._drives], jacobian, missing, factor)
        else:
            self._refuse_unreachable(angles, distance, at)
        return angles

    def _solve_step(self, now: Array, jacobian: Array, missing: Array, factor: float) -> Array:
        """Drives (drives,) after one step; those that would pass a limit stop there, and the others do without them."""
        free = np.ones(len(now), dtype=bool)
        lower, upper = self._bounds
        while True:
            dq = np.zeros(len(now))
            u, s, vt = np.linalg.svd(jacobian[:, free], full_matrices=False)
            use = s > NEGLIGIBLE * max(float(s.max(initial=0.0)), np.finfo(float).tiny)
            gain = s[use] / (s[use] ** 2 + (factor * s.max(initial=0.0)) ** 2)
            dq[free] = vt[use].T @ (gain * (u[:, use].T @ missing))
            stopped = free & (((now >= upper) & (dq > 0)) | ((now <= lower) & (dq < 0)))
            if not stopped.any():
                return np.clip(now + dq, lower, upper)
            free &= ~stopped

    def _refuse_unreachable(self, angles: Array, distance: float, at: float) -> None:
        m = self.mesh.mechanism
        driven = angles[self._drives]
        lower, upper = self._bounds
        held = (driven <= lower) | (driven >= upper)
        if held.any():
            name = [m.velocity_names[i] for i in self._drives][int(np.argmax(held))]
            raise InputError(
                f"mechanism '{m.name}': at t = {at:.4g} s of the path the frame on '{self.frame.name}' is {distance:.3g} m away "
                f"from it and joint {name!r} at its limit; move the path, or give another start = {{...}} of the joints"
            )
        raise InputError(
            f"mechanism '{m.name}': at t = {at:.4g} s of the path the frame on '{self.frame.name}' comes no nearer than "
            f"{distance:.3g} m; move the path into reach, or give start = {{...}}, joint coordinates near its start "
            "(a stretched arm does not find by itself to which side to bend)"
        )

    def _find_path_angles(self, angles: Array, target_poses: Poses, time: Array) -> Array:
        """Angles (samples, nv) on the path, by Newton at all samples at once."""
        drives = self._drives
        for _ in range(ITERATIONS):
            if np.abs(missing := self._compute_deviation(angles, target_poses)).max() < REACHED * self.mesh.length:
                return angles
            angles[:, drives] += _apply_matrices(
                np.linalg.pinv(self._compute_jacobian(angles), rcond=NEGLIGIBLE), missing
            )
        worst = float(time[int(np.abs(missing).max(axis=1).argmax())])
        knots = np.linspace(0.0, self.path.duration, KNOTS)
        after = int(np.clip(np.searchsorted(knots, worst), 1, KNOTS - 1))
        raise InputError(
            f"mechanism '{self.mesh.mechanism.name}': at t = {worst:.4g} s of the path the frame on '{self.frame.name}' does not "
            f"follow it, although it does at {knots[after - 1]:.4g} and {knots[after]:.4g} s: between them the joints turn over, "
            "through a singular position or near one, or the path leaves their reach; move the path, or give another start = "
            "{...} of the joints"
        )

    def _solve_path_motion(self, guess: list[Array], target_poses: Poses, time: Array) -> PathMotion:
        """Newton at all samples at once from the spline, and the rates that belong to it."""
        angles = self._find_path_angles(guess[0], target_poses, time)
        drives = self._drives
        jacobian = self._compute_jacobian(angles)
        u, s, vt = np.linalg.svd(jacobian)
        rank = int((s > NEGLIGIBLE * s.max()).sum(axis=1).max())
        if rank == 0:
            raise InputError(
                f"mechanism '{self.mesh.mechanism.name}': no drive moves the frame on '{self.frame.name}'; "
                "follow a frame on a link behind a drive"
            )
        self._check_ratio(s, rank, time)
        inverse: Array = np.asarray(np.linalg.pinv(jacobian, rcond=NEGLIGIBLE), dtype=np.float64)
        idle = np.swapaxes(vt[:, rank:], 1, 2)  # (sample, drive, self-motion)
        qd = np.zeros_like(angles)
        qdd = np.zeros_like(angles)
        stay = idle @ np.swapaxes(idle, 1, 2)  # (sample, drive, drive)
        qd[:, drives] = _apply_matrices(
            inverse, self._assemble_rows(target_poses.v, target_poses.omega)
        ) + _apply_matrices(stay, guess[1][:, drives])
        bent = self._compute_poses(angles, qd)
        fall = self._assemble_rows(target_poses.a, target_poses.alpha) - self._assemble_rows(bent.a, bent.alpha)
        qdd[:, drives] = _apply_matrices(inverse, fall) + _apply_matrices(stay, guess[2][:, drives])
        return PathMotion(self._convert_angles(angles), qd, qdd, u[:, :, :rank], idle)


def _apply_matrices(matrices: NDArray[np.floating], vectors: Array) -> Array:
    """Products of matrices (samples, rows, columns) with vectors (samples, columns)."""
    return np.asarray(np.einsum("src,sc->sr", matrices, vectors))
