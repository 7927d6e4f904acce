"""Connectors of joints and closures, springs and loads in Exudyn.

connector     ``ObjectJointGeneric``: marker 0 on the parent or first frame, marker 1 on the child or second one, x along
              the free axis.  Its multipliers are those of x0 . d, y0 . d, z0 . d (d between the markers' points) and
              of pairs u . w of their axes that depend on how many turns are held (`list_turn_constraints`); so on the child at
              marker 1, u of marker 0 and w of marker 1:   F = -sum u lambda,   M = -sum (w x u) lambda
redundant     Equations that others imply (out of a loop's plane, say) would make its matrix singular: they are left
              out, found by our own Jacobian at one position of the motion.  Reactions are then not unique.
spring        ``ObjectConnectorSpringDamper``
load          ``Force`` and ``Torque`` at a marker of the attachment; bodyFixed means along the marker's axes (measured)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from exudyn.itemInterface import Force as ForceLoad
from exudyn.itemInterface import ObjectConnectorSpringDamper, Torque

from crosscheck.engines.base import sample_times
from crosscheck.engines.exudyn.models import chain as exudyn_chain
from crosscheck.engines.exudyn.models.frames import Array, build_frame_along, compose
from crosscheck.engines.exudyn.models.layout import Frame, Layout, find_attachment_frame, list_attachments
from crosscheck.engines.exudyn.models.parts import Model
from crosscheck.engines.exudyn.script import SPRING
from crosscheck.engines.shared.loop_closure import REDUNDANT, FrameMotion, compute_direction_row, compute_position_row
from crosscheck.engines.shared.wrenches import evaluate_wrench
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Closure, Force, Joint, Mechanism, Placement, Spring

# Axes that a connector holds by the kind of joint or closure: along x, y, z of marker 0, about x, y, z.
HELD = {
    "fixed": (1, 1, 1, 1, 1, 1),
    "revolute": (1, 1, 1, 0, 1, 1),
    "continuous": (1, 1, 1, 0, 1, 1),
    "prismatic": (0, 1, 1, 1, 1, 1),
    "cylindrical": (0, 1, 1, 0, 1, 1),
    "universal": (1, 1, 1, 0, 0, 1),
    "spherical": (1, 1, 1, 0, 0, 0),
    "point-on-line": (0, 1, 1, 0, 0, 0),
    "free": (0, 0, 0, 0, 0, 0),
}
X, Y, Z = range(3)


def list_turn_constraints(held: Sequence[int]) -> list[tuple[int, int, int]]:
    """Return index of the multiplier, column of u in marker 0, column of w in marker 1 of the turns held [-].

    Source: exudyn, ObjectJointGeneric, "Connector constraint equations"; those that it gives by example alone are cyclic.
    """
    about = [k for k in range(3) if held[3 + k]]
    if len(about) == 3:
        return [(X, Z, Y), (Y, Z, X), (Z, X, Y)]
    if len(about) == 2:
        free = ({X, Y, Z} - set(about)).pop()
        return [(k, free, w) for k, w in zip(about, about, strict=True)]
    return [(k, (k + 1) % 3, (k + 2) % 3) for k in about]


def compute_marker_axes(one: Joint | Closure) -> tuple[Array, Array]:
    """Return the axes (3, 3) [-] of marker 0 and marker 1 in the two frames of a joint or closure."""
    if one.kind != "universal":
        axes = build_frame_along(one.axis)
        return axes, axes
    y, x, z = build_frame_along(one.second_axis, one.axis).T
    return build_frame_along(one.axis, one.second_axis), np.stack([x, y, -z], axis=1)


def compute_marker_frame(layout: Layout, at: Attachment, axes: Array) -> Frame:
    """Return the frame of an attachment, turned by ``axes`` (3, 3) [-]."""
    attachment_frame = find_attachment_frame(layout, at)
    return Frame(attachment_frame.group, compose(attachment_frame.placement, Placement(np.zeros(3), axes)))


def compute_connector_wrench(held: Sequence[int], force: Array, torque: Array, first: Array, second: Array) -> Array:
    """Return force [N] and moment [N m] on the second frame in the world, (samples, 6).

    force, torque : (samples, 3) multipliers; first, second : (samples, 3, 3) axes of the markers in the world
    """
    moment = np.zeros_like(torque)
    for k, u, w in list_turn_constraints(held):
        moment -= np.cross(second[:, :, w], first[:, :, u]) * torque[:, k : k + 1]
    return np.hstack([-np.einsum("sij,sj->si", first, force), moment])


# -------------------------------------------------------------------------------------------------------- redundancy


def find_independent_axes(mechanism: Mechanism, case: Case) -> dict[str, list[int]]:
    """Return `find_independent_axes_at` a position of a case."""
    time = sample_times(case)
    return find_independent_axes_at(
        mechanism, case, exudyn_chain.evaluate_closed_motion(mechanism, case, time[: len(time) // 3 + 1])[0][-1]
    )


def find_independent_axes_at(mechanism: Mechanism, case: Case, q: Array) -> dict[str, list[int]]:
    """Return the axes (1 or 0) [-] that every closure holds so that its equations are independent at q (nq,) [rad], [m].

    Closure by closure, of all choices with the rank that the closure adds the best conditioned one.
    """
    pairs = exudyn_chain.Tree(mechanism, case).compute_frame_pairs(q, np.zeros(mechanism.nv))
    kept = np.zeros((0, mechanism.nv))
    chosen = {}
    for closure, pair in zip(mechanism.closures, pairs, strict=True):
        full = HELD[closure.kind]
        missing = _compute_rank(np.vstack([kept, _build_closure_jacobian(closure, full, *pair)])) - len(kept)
        choices = [
            [int(k in axes) for k in range(6)] for axes in combinations([k for k in range(6) if full[k]], missing)
        ]
        stacks = [np.vstack([kept, _build_closure_jacobian(closure, held, *pair)]) for held in choices]
        best = int(np.argmax([np.linalg.svd(stack, compute_uv=False)[-1] for stack in stacks]))
        chosen[closure.name] = choices[best]
        kept = stacks[best]
    return chosen


def _compute_rank(rows: Array) -> int:
    return int(np.linalg.matrix_rank(rows, rtol=REDUNDANT))


def _build_closure_jacobian(closure: Closure, held: Sequence[int], first: FrameMotion, second: FrameMotion) -> Array:
    """Return the Jacobian (rows, nv) of the equations of a closure's connector that holds these axes."""
    zero, one = (m.r @ axes for m, axes in zip((first, second), compute_marker_axes(closure), strict=True))
    made = [compute_position_row(first, second, zero[:, k])[1] for k in range(3) if held[k]]
    made += [compute_direction_row(first, second, zero[:, u], one[:, w])[1] for _, u, w in list_turn_constraints(held)]
    return np.array(made).reshape(-1, first.linear.shape[1])


def describe_leaning_force(mechanism: Mechanism, layout: Layout, normal: Array, in_plane: float) -> str | None:
    """Return the force that is not its own mirror image in the plane, or None.  normal : (3,) [-]"""
    for force in mechanism.forces:
        turn = (
            layout.compute_start_pose(compute_marker_frame(layout, force.at, np.eye(3))).rotation
            if force.follower
            else np.eye(3)
        )
        up = force.wrench[:, :3] @ (turn.T @ normal)
        across = np.cross(force.wrench[:, 3:], turn.T @ normal)
        if max(np.abs(up).max(), np.abs(across).max()) > in_plane * np.abs(force.wrench).max():
            return f"force {force.name} leans out of the plane"
    return None


def list_attachment_points(mechanism: Mechanism, layout: Layout) -> list[Array]:
    """Return the points at which closures, springs and forces attach at the start, (3,) [m] each."""
    return [layout.compute_start_pose(find_attachment_frame(layout, at)).position for at in list_attachments(mechanism)]


# -------------------------------------------------------------------------------------------------- springs, loads

Marker = Callable[[Frame], Any]
Axes = Callable[[Force], Array]


def add_loads(model: Model, mechanism: Mechanism, layout: Layout, marker: Marker, axes: Axes) -> None:
    """Add springs and given forces [N], [N m]; axes : (3, 3) from the axes of a force's table to those of its load."""
    for spring in mechanism.springs:
        ends = [marker(compute_marker_frame(layout, at, np.eye(3))) for at in (spring.first, spring.second)]
        model.spring[spring.name] = model.mbs.AddObject(
            ObjectConnectorSpringDamper(
                markerNumbers=ends,
                referenceLength=spring.rest,
                stiffness=spring.stiffness,
                damping=spring.damping,
                springForceUserFunction=_make_spring_law(spring) if spring.law is not None else 0,
            )
        )
    for force in mechanism.forces:
        frame = compute_marker_frame(layout, force.at, np.eye(3))
        if frame.group == 0:
            continue
        seat = marker(frame)
        for kind, part in ((ForceLoad, slice(0, 3)), (Torque, slice(3, 6))):
            table = _make_load_table(force, part, axes(force))
            vector = table(None, 0.0, None)
            number = model.mbs.AddLoad(
                kind(markerNumber=seat, loadVector=vector, bodyFixed=force.follower, loadVectorUserFunction=table)
            )
            model.loads[number] = table


def _make_spring_law(spring: Spring) -> Any:
    """Return the pull of a spring with a law [N] as Exudyn asks for it."""

    def evaluate_pull(
        mbs: Any, t: float, item: int, longer: float, rate: float, stiffness: float, damping: float, f: float
    ) -> float:
        return float(spring.evaluate_pull(np.asarray(spring.rest + longer))) + damping * rate

    setattr(evaluate_pull, SPRING, spring)  # an export writes its law
    return evaluate_pull


def _make_load_table(force: Force, part: slice, axes: Array) -> Any:
    if len(force.time) == 1:
        always = (axes @ evaluate_wrench(force, 0.0)[part]).tolist()
        return lambda mbs, t, vector: always
    return lambda mbs, t, vector: (axes @ evaluate_wrench(force, t)[part]).tolist()
