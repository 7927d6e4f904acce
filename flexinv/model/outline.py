"""The outline of a mechanism with all joints at zero, as lines in space: no mesh, nothing compiled.

With joints at zero a child's frame is where its joint is placed: R_c = R_p R, x_c = x_p + R_p p, placements along the tree.
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.display.drawing import Stroke
from flexinv.model.links import WORLD, Beam, Link, Placement
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

BEAM_POINTS = 13  # along a beam that is curved
Frame = tuple[Array, Array]  # position (3,) [m] and rotation (3, 3) in the world


def list_outline(mechanism: Mechanism) -> list[Stroke]:
    """Return the lines of a mechanism with all joints at zero, (points, 3) [m] in the world, and whether they bend.

    From joint to joint, on to the mass centres and tips of rigid links, and along beams.
    """
    frames: dict[str, Frame] = {WORLD: (np.zeros(3), np.eye(3))}
    strokes: list[Stroke] = []
    for joint in mechanism.joints:
        parent = mechanism.link_of.get(joint.parent)
        carrier = frames[joint.parent]
        if parent is not None and parent.beam is not None:
            carrier = _find_section(carrier, parent.beam, 1.0 if joint.station is None else joint.station)
        frame = _place(carrier, joint.placement)
        frames[joint.child] = frame
        strokes += [(np.stack([carrier[0], frame[0]]), False), *_list_link_lines(mechanism.link_of[joint.child], frame)]
    return [stroke for stroke in strokes if np.ptp(stroke[0], axis=0).any()]


def _list_link_lines(link: Link, frame: Frame) -> list[Stroke]:
    """Lines from a link's frame to its mass centres and its tip, or along its beam."""
    lines: list[Stroke] = []
    if link.beam is None:
        lines.append((np.stack([frame[0], frame[0] + frame[1] @ link.tip]), False))
    else:
        points = np.linspace(0.0, 1.0, BEAM_POINTS if link.beam.curvature.any() else 2)
        axis = [_find_section(frame, link.beam, float(station))[0] for station in points]
        lines += [(np.stack([frame[0], axis[0]]), False), (np.stack(axis), True)]
    for body in link.bodies:
        at = frame if link.beam is None or body.station is None else _find_section(frame, link.beam, body.station)
        lines.append((np.stack([at[0], at[0] + at[1] @ body.inertia.com]), False))
    return lines


def _place(frame: Frame, placement: Placement) -> Frame:
    """The frame that is placed in another one."""
    return frame[0] + frame[1] @ placement.position, frame[1] @ placement.rotation


def _find_section(frame: Frame, beam: Beam, station: float) -> Frame:
    """The frame of a beam's section at a fraction of its length, stress-free.

    x' = R e_1, R' = R skew(kappa) with constant kappa: the exponential of a matrix (4, 4).
    """
    root = _place(frame, beam.placement)
    s = station * beam.length
    if not beam.curvature.any():
        return root[0] + s * root[1][:, 0], root[1]
    slope = np.zeros((4, 4))
    slope[:3, :3] = np.cross(np.eye(3), -beam.curvature)
    slope[0, 3] = 1.0
    moved = scipy.linalg.expm(s * slope)
    return root[0] + root[1] @ moved[:3, 3], root[1] @ moved[:3, :3]
