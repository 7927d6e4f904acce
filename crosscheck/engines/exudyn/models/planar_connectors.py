"""Connectors of the plane in Exudyn: joints that closures move, and closures, of every kind that is its own mirror image.

pin           ``ObjectJointRevolute2D``: force on the second body = -Force (axes of the plane)
others        ``ObjectJointGeneric`` with x of both markers along the axis (slides, lines) or along an axis of the
              frame that lies in the plane (fixed): at marker 1, force = -A_0 ForceLocal, moment = +TorqueLocal about z
              (its multiplier is that of x_0 . y_1); both know velocities, so index 2 works
own efforts   damping and springs in joints that closures move: ``ObjectConnectorCoordinateSpringDamper``
"""

from __future__ import annotations

from typing import Any

import numpy as np
from exudyn.itemInterface import ObjectConnectorCoordinateSpringDamper, ObjectJointGeneric, ObjectJointRevolute2D

from crosscheck.engines.exudyn.models.connectors import compute_marker_frame
from crosscheck.engines.exudyn.models.frames import Array, build_frame_along
from crosscheck.engines.exudyn.models.layout import Frame, Layout
from flexinv.model.mechanism import Closure, Joint, Mechanism, Placement

PINS = ("revolute", "continuous", "spherical")
SLIDES = ("prismatic", "cylindrical", "point-on-line")
# Axes that a connector holds in the plane: along x and y of marker 0, about z.
HELD = {
    "fixed": (1, 1, 0, 0, 0, 1),
    "prismatic": (0, 1, 0, 0, 0, 1),
    "cylindrical": (0, 1, 0, 0, 0, 1),  # out of the plane it could only turn about an axis in it
    "point-on-line": (0, 1, 0, 0, 0, 0),
}


def describe_leaning_axis(one: Joint | Closure, axis: Array, normal: Array, in_plane: float) -> str | None:
    """Return the reason why a joint or a closure is not its own mirror image in the plane, or None.

    axis, normal : (3,) [-], of the joint and of the plane, world; in_plane : largest component that is rounding [-]
    """
    what = f"closure {one.name}" if isinstance(one, Closure) else f"joint {one.name}"
    if one.kind in ("spherical", "fixed"):
        return None
    if one.kind in PINS:
        out = np.linalg.norm(np.cross(axis, normal)) > in_plane
        return f"the axis of {what} is not parallel to the others" if out else None
    if one.kind in SLIDES:
        return f"the axis of {what} is not in the plane of the others" if abs(axis @ normal) > in_plane else None
    return f"{what} is {one.kind}"


def compute_marker_frames(layout: Layout, one: Joint | Closure, normal: Array) -> tuple[Frame, Frame]:
    """Return the frames of the two markers, x along the axis or, of what has none in the plane, in the plane."""
    if isinstance(one, Closure):
        axes = _build_marker_axes(
            one, layout.compute_start_pose(compute_marker_frame(layout, one.first, np.eye(3))).rotation.T @ normal
        )
        return compute_marker_frame(layout, one.first, axes), compute_marker_frame(layout, one.second, axes)
    seat = layout.joint[one.name]
    axes = _build_marker_axes(one, layout.compute_start_pose(seat).rotation.T @ normal)
    child = next(k for k, g in enumerate(layout.groups) if g.joint == one.name)
    turned = Placement(seat.placement.position, seat.placement.rotation @ axes)
    return Frame(seat.group, turned), Frame(child, Placement(np.zeros(3), axes))


def _build_marker_axes(one: Joint | Closure, normal: Array) -> Array:
    if one.kind in SLIDES:
        return build_frame_along(one.axis)
    return build_frame_along(np.eye(3)[int(np.argmin(np.abs(normal)))])


def count_equations(mechanism: Mechanism) -> int:
    """Return the number of equations of all closures in the plane [-]."""
    return sum(2 if c.kind in PINS else sum(HELD[c.kind]) for c in mechanism.closures if c.kind != "universal")


def add_connector(mbs: Any, kind: str, markers: list[Any]) -> Any:
    """Add the connector of a kind between two markers and return its number."""
    if kind in PINS:
        return mbs.AddObject(ObjectJointRevolute2D(markerNumbers=markers))
    return mbs.AddObject(ObjectJointGeneric(markerNumbers=markers, constrainedAxes=list(HELD[kind])))


def compute_wrench(kind: str, force: Array, torque: Array | None, first: Array, plane: Array) -> Array:
    """Return force [N] and moment [N m] on the second frame at its origin, in the world, (samples, 6).

    force, torque : (samples, 3) as the sensors give them (a pin has no torque); first : (samples, 3, 3) axes of marker 0
    in the world; plane : (3, 3) [-], its third column is the normal
    """
    if torque is None:
        pull = -force * (1, 1, 0) @ plane.T
        return np.hstack([pull, np.zeros_like(pull)])
    flat = np.stack(
        [first[:, :, 0], np.cross(plane[:, 2], first[:, :, 0])], axis=2
    )  # (sample, xyz, x or y of marker 0)
    return np.hstack([-np.einsum("sij,sj->si", flat, force[:, :2]), torque[:, 2:] * plane[:, 2]])


def add_spring_damper(mbs: Any, joint: Joint, angles: list[Any], sign: float, start: float) -> None:
    """Add damping and spring of a joint that closures turn, where it has any.

    angles : markers of the two rotations, both 0 at the start; sign : of the joint's axis along the normal
    start : angle of the joint at the start [rad]
    """
    if joint.damping or joint.stiffness:
        mbs.AddObject(
            ObjectConnectorCoordinateSpringDamper(
                markerNumbers=angles,
                stiffness=joint.stiffness,
                damping=joint.damping,
                offset=sign * (joint.rest - start),
            )
        )


def describe_unmodelled_effort(mechanism: Mechanism, free: frozenset[str]) -> str | None:
    """Return the effort of a joint that closures move for which there is no connector here, in words, or None."""
    for joint in mechanism.joints:
        if joint.name not in free:
            continue
        if joint.rotor_inertia or joint.friction:
            return f"joint {joint.name}: no connector here for rotor inertia or dry friction of a joint without a drive"
        if (joint.damping or joint.stiffness) and joint.kind not in ("revolute", "continuous"):
            return (
                f"joint {joint.name}: damping and springs of {joint.kind} joints without a drive have no connector here"
            )
    return None
