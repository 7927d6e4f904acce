"""Kinematics of the cut tree for Exudyn's closed loops: the closed start, and allocation to redundant drives.

Exudyn integrates the motion of the joints that the closures move; what it needs is a closed start, and its multipliers
act on the joints that the motion gives, whichever these are.  Beams stand here as they are without stress: at the start
they are.  Poses, Jacobians and bias accelerations by recursion
outward, in the world; J: seat of a joint, C: its child, p, R, w: the joint's own motion.

    x_C = x_J + r,                r = R_J p
    v_C = v_J + w_J x r + R_J p'
    a_C = a_J + al_J x r + w_J x (w_J x r) + 2 w_J x R_J p' + R_J p''
    w_C = w_J + R_C w             al_C = al_J + R_C w' + w_J x R_C w
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from crosscheck.engines.exudyn.models.frames import (
    Array,
    compose,
    compute_joint_pose,
    compute_joint_twist,
    compute_section_pose,
    turn,
)
from crosscheck.engines.exudyn.models.layout import resolve_station
from crosscheck.engines.shared import loop_closure as assembly
from crosscheck.engines.shared.cross import cross, cross_columns
from crosscheck.engines.shared.loop_closure import ClosureRows, ClosureTask, FrameMotion
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import WORLD, Attachment, Joint, Mechanism, Placement
from flexinv.model.owned_cache import make_owner_cache

Given = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Tree:
    """The cut tree as `loop_closure` wants it, in the mechanism's own coordinates."""

    mechanism: Mechanism
    case: Case
    history: Given | None = None

    def evaluate_motion(self, time: Array) -> tuple[Array, Array, Array]:
        """Return q, qd, qdd of the motion at times [s], joints that it leaves out at their guess."""
        q, qd, qdd = self.history(time) if self.history else self.case.motion.evaluate(self.mechanism, time)
        return assembly.apply_guess(self.mechanism, self.case, q), qd, qdd

    def integrate_step(self, q: Array, step: Array) -> Array:
        """Return q after a step (nv,) [rad], [m]."""
        out = q.copy()
        for joint in self.mechanism.joints:
            columns = self.mechanism.q_slices[joint.name]
            out[columns] = _integrate_joint_step(joint, q[columns], step[self.mechanism.v_slices[joint.name]])
        return out

    def compute_frame_pairs(self, q: Array, v: Array) -> list[tuple[FrameMotion, FrameMotion]]:
        """Return the two frames of every closure."""
        links = compute_link_frames(self.mechanism, q, v)
        seen = partial(_compute_attachment_frame, self.mechanism, links)
        return [(seen(c.first), seen(c.second)) for c in self.mechanism.closures]


def _integrate_joint_step(joint: Joint, q: Array, step: Array) -> Array:
    if joint.kind == "continuous":
        c = np.cos(step[0])
        s = np.sin(step[0])
        return np.array([q[0] * c - q[1] * s, q[1] * c + q[0] * s])
    if joint.kind not in ("spherical", "free"):
        return np.asarray(q + step)
    size = float(np.linalg.norm(step[-3:]))
    x, y, z = 0.5 * np.sinc(size / (2 * np.pi)) * step[-3:]
    a, b, c, w = q[-4:]
    d = np.cos(size / 2)
    turned = np.array(
        [w * x + a * d + b * z - c * y, w * y - a * z + b * d + c * x, w * z + a * y - b * x + c * d,
         w * d - a * x - b * y - c * z]
    )  # fmt: skip
    turned /= np.linalg.norm(turned)
    if joint.kind == "spherical":
        return turned
    return np.concatenate([q[:3] + compute_joint_pose(joint, q[None])[1][0] @ step[:3], turned])


def compute_link_frames(mechanism: Mechanism, q: Array, v: Array) -> dict[str, FrameMotion]:
    """Return every link's frame [m], [rad], [s] at q (nq,), v (nv,), the world included."""
    none = np.zeros((3, mechanism.nv))
    still = np.zeros(3)
    links = {WORLD: FrameMotion(still, np.eye(3), none, none, still, still, still, still)}
    for joint in mechanism.joints:
        coordinates = q[mechanism.q_slices[joint.name]]
        rates = mechanism.v_slices[joint.name]
        seat = _compute_seat_frame(mechanism, links, joint.parent, joint.station, joint.interface)
        offset_frame = compute_offset_frame(seat, joint.placement)
        links[joint.child] = _compute_child_frame(offset_frame, joint, coordinates, v[rates], rates)
    return links


def compute_offset_frame(frame: FrameMotion, place: Placement) -> FrameMotion:
    """Return a frame that stands at ``place`` [m] in a moving one."""
    return _move_frame(frame, place.position, place.rotation)


def _move_frame(frame: FrameMotion, position: Array, rotation: Array) -> FrameMotion:
    turned_r = frame.r @ rotation
    if not position.any():
        return FrameMotion(frame.x, turned_r, frame.linear, frame.angular, frame.v, frame.w, frame.a, frame.alpha)
    r = frame.r @ position
    w = frame.w
    turned = cross(frame.w, r)
    linear = frame.linear + cross_columns(frame.angular, r)
    a = frame.a + cross(frame.alpha, r) + cross(w, turned)
    return FrameMotion(frame.x + r, turned_r, linear, frame.angular, frame.v + turned, w, a, frame.alpha)


def _compute_child_frame(frame_motion: FrameMotion, joint: Joint, q: Array, qd: Array, rates: slice) -> FrameMotion:
    p, r = (part[0] for part in compute_joint_pose(joint, q[None]))
    child = _move_frame(frame_motion, p, r)
    if not joint.nv:
        return child
    units = [compute_joint_twist(joint, q, unit) for unit in np.eye(joint.nv)]
    # velocities of a free joint are along the child's axes, the slide of a prismatic one along the seat's: the same there
    linear = child.linear.copy()
    angular = child.angular.copy()
    for column, (slide, spin) in zip(range(rates.start, rates.stop), units, strict=True):
        linear[:, column] = child.r @ slide
        angular[:, column] = child.r @ spin
    if not qd.any() and not frame_motion.w.any():
        return FrameMotion(child.x, child.r, linear, angular, child.v, child.w, child.a, child.alpha)
    slide, spin = (child.r @ part for part in compute_joint_twist(joint, q, qd))
    swing = 2 * cross(frame_motion.w, slide) + cross(spin, slide)
    alpha = child.alpha + cross(frame_motion.w, spin) + child.r @ _compute_bias_acceleration(joint, q, qd)
    return FrameMotion(
        child.x, child.r, linear, angular, child.v + slide, child.w + spin, child.a + swing, alpha
    )  # fmt: skip


def _compute_bias_acceleration(joint: Joint, q: Array, qd: Array) -> Array:
    """Return w' of a joint at zero accelerations, in the child's frame: only a universal joint's axes move there."""
    if joint.kind != "universal":
        return np.zeros(3)
    first = turn(joint.second_axis, q[1]).T @ joint.axis * qd[0]
    return np.asarray(-cross(joint.second_axis * qd[1], first))


def _compute_attachment_frame(mechanism: Mechanism, links: dict[str, FrameMotion], at: Attachment) -> FrameMotion:
    on_beam = at.link != WORLD and mechanism.link_of[at.link].beam is not None
    station = resolve_station(at.station) if on_beam else None
    seat = _compute_seat_frame(mechanism, links, at.link, station, at.interface)
    return compute_offset_frame(seat, at.placement)


def _compute_seat_frame(
    mechanism: Mechanism, links: dict[str, FrameMotion], name: str, station: float | None, interface: str
) -> FrameMotion:
    """Return a link's frame, or that of a section of a beam or of an interface of a mesh as it is without stress."""
    link = None if name == WORLD else mechanism.link_of[name]
    if link is not None and link.part is not None and interface:
        return compute_offset_frame(links[name], Placement(link.part.interface_of[interface].origin))
    beam = None if link is None else link.beam
    if beam is None or station is None:
        return links[name]
    return compute_offset_frame(links[name], compose(beam.placement, compute_section_pose(beam, station * beam.length)))


def evaluate_closed_motion(
    mechanism: Mechanism, case: Case, time: Array, history: Given | None = None
) -> tuple[Array, Array, Array]:
    """Return q (samples, nq), qd, qdd (samples, nv) [rad or m, s] of all joints, on the closures where there are any.

    history : the motion of the joints that it gives at times [s], where it is another than the case's own
    """
    if not mechanism.closures:
        return case.motion.evaluate(mechanism, time)
    return (
        _evaluate_case_motion(case, mechanism, time.tobytes())
        if history is None
        else _solve_tree_motion(mechanism, case, time, history)
    )


@make_owner_cache(most=8)
def _evaluate_case_motion(case: Case, mechanism: Mechanism, time: bytes) -> tuple[Array, Array, Array]:
    """The case's own motion: every run of it is shared out on the same one."""
    tree_motion = _solve_tree_motion(mechanism, case, np.frombuffer(time), None)
    for part in tree_motion:
        part.flags.writeable = False
    return tree_motion


def _solve_tree_motion(
    mechanism: Mechanism, case: Case, time: Array, history: Given | None
) -> tuple[Array, Array, Array]:
    free = assembly.find_unprescribed_joints(mechanism, case)
    unknown = np.array([j.name in free for j in mechanism.joints for _ in range(j.nv)], dtype=bool)
    unknown_q = np.array([j.name in free for j in mechanism.joints for _ in range(j.nq)], dtype=bool)
    return assembly.solve_closed_motion(
        ClosureTask(mechanism, Tree(mechanism, case, history), unknown, unknown_q), time
    )


def split_sampled_efforts(mechanism: Mechanism, case: Case, q: Array, effort: Array) -> Array:
    """Return the drives' efforts (samples, nv) [N m] or [N] of efforts on whichever joints, of least norm."""
    made = np.empty_like(effort)
    for k, (_, rows) in enumerate(list_closure_rows(mechanism, case, q)):
        made[k] = assembly.split_efforts(rows.g, effort[k], mechanism.actuated, mechanism.weights)
    return made


def list_closure_rows(
    mechanism: Mechanism, case: Case, positions: Array
) -> list[tuple[list[tuple[FrameMotion, FrameMotion]], ClosureRows]]:
    """Return frames and equations of the closures [m], [-] at rest at positions (samples, nq) [rad], [m]."""
    return _list_closure_rows(case, mechanism, positions.tobytes())


@make_owner_cache(most=8)
def _list_closure_rows(
    case: Case, mechanism: Mechanism, q: bytes
) -> list[tuple[list[tuple[FrameMotion, FrameMotion]], ClosureRows]]:
    tree = Tree(mechanism, case)
    rest = np.zeros(mechanism.nv)
    pairs = [tree.compute_frame_pairs(position, rest) for position in np.frombuffer(q).reshape(-1, mechanism.nq)]
    return [(one, assembly.assemble_rows(mechanism.closures, one)) for one in pairs]
