"""The card of a mechanism: what it is made of, its joints in a table, and its outline with all joints at zero.

With joints at zero a child's frame is where its joint is placed: R_c = R_p R, x_c = x_p + R_p p, placements along the tree.  No
mesh is built and nothing compiled.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy  # its parts are loaded when they are asked for

from flexinv.display.card import Card, Picture, make_rows
from flexinv.display.drawing import Stroke, draw_svg
from flexinv.display.words import format_count, format_number
from flexinv.model.joints import Joint
from flexinv.model.link_mass import compute_link_mass
from flexinv.model.links import WORLD, Beam, Link, Placement
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

JOINT_COLUMNS = ("joint", "kind", "on", "carries", "drive", "its mass [kg]")
BEAM_POINTS = 13  # along a beam that is curved
PlacedFrame = tuple[Array, Array]  # position (3,) [m] and rotation (3, 3) in the world


def make_mechanism_card(mechanism: Mechanism) -> Card:
    """Return the card of a mechanism: links, joints, masses [kg], gravity [m/s^2], and its outline."""
    title = f"Mechanism '{mechanism.name}'" + (f": {mechanism.title}" if mechanism.title else "")
    facts = (_describe_size(mechanism), _describe_mass(mechanism), *_describe_parts(mechanism))
    rows = make_rows(_list_joint_row(mechanism, joint) for joint in mechanism.moving_joints)
    return Card(title, facts, JOINT_COLUMNS, rows, len(mechanism.moving_joints), lambda: _draw_outline(mechanism))


def describe_links(mechanism: Mechanism) -> str:
    """Return in words how many links there are [-], and which of them are beams and meshes."""
    beams = [link.name for link in mechanism.beams]
    meshes = [link.name for link in mechanism.meshed]
    links = format_count(len(mechanism.links), "link")
    several = [f"{kind}: {', '.join(names)}" for kind, names in (("beams", beams), ("meshes", meshes)) if names]
    return f"{links}, of which {'; '.join(several)}" if several else f"{links}, all rigid"


def _describe_size(mechanism: Mechanism) -> str:
    moving = mechanism.moving_joints
    kinds = describe_links(mechanism)
    drives = format_count(sum(joint.actuated for joint in moving), "drive")
    joints = f"{format_count(len(moving), 'joint')} that move" if len(moving) != 1 else "1 joint that moves"
    return f"{joints}, {drives}; nq = {mechanism.nq}, nv = {mechanism.nv}; {kinds}"


def _describe_mass(mechanism: Mechanism) -> str:
    mass = sum(map(compute_link_mass, mechanism.links))
    gravity = ", ".join(map(format_number, mechanism.gravity))
    beside = f" without {format_count(len(mechanism.meshed), 'meshed link')}" if mechanism.meshed else ""
    return f"mass {format_number(mass)} kg{beside}, gravity ({gravity}) m/s^2"


def _describe_parts(mechanism: Mechanism) -> Iterator[str]:
    """Yield what is tied to it, its damping by a ratio, and its notes."""
    parts = (("closure", mechanism.closures), ("spring", mechanism.springs), ("force", mechanism.forces))
    if any(several for _, several in parts):
        words = [
            f"{format_count(len(several), kind)} ({', '.join(one.name for one in several)})"
            for kind, several in parts
            if several
        ]
        yield "; ".join(words)
    if mechanism.modal_damping is not None:
        yield f"damping of beams: {mechanism.modal_damping}"
    if mechanism.notes:
        more = f" (and {format_count(len(mechanism.notes) - 1, 'more note')})" if len(mechanism.notes) > 1 else ""
        yield f"note{more}: {mechanism.notes[0]}"


def _list_joint_row(mechanism: Mechanism, joint: Joint) -> tuple[str, ...]:
    on = describe_carrier(joint)
    child = mechanism.link_of[joint.child]
    mass = format_number(compute_link_mass(child)) if child.part is None else "of its mesh"
    return joint.name, joint.kind, on, joint.child, "yes" if joint.actuated else "no", mass


def describe_carrier(joint: Joint) -> str:
    """Return the link that carries a joint and where on it [-], in words."""
    where = joint.interface if joint.station is None else f"{joint.station:g}"
    return f"{joint.parent} at {where}" if where else joint.parent


def _draw_outline(mechanism: Mechanism) -> tuple[Picture, ...]:
    strokes = list_outline(mechanism)
    if not strokes:
        return ()
    open_loops = "; loops may stand open there" if mechanism.closures else ""
    beams = ", beams blue" if mechanism.beams else ""
    return (Picture(draw_svg([strokes], mechanism.name), f"all joints at zero{beams}{open_loops}"),)


def list_outline(mechanism: Mechanism) -> list[Stroke]:
    """Return the lines of a mechanism with all joints at zero, (points, 3) [m] in the world, and whether they bend.

    From joint to joint, on to the mass centres and tips of rigid links, and along beams.
    """
    frames: dict[str, PlacedFrame] = {WORLD: (np.zeros(3), np.eye(3))}
    strokes: list[Stroke] = []
    for joint in mechanism.joints:
        parent = mechanism.link_of.get(joint.parent)
        carrier = frames[joint.parent]
        if parent is not None and parent.beam is not None:
            carrier = _find_section(carrier, parent.beam, 1.0 if joint.station is None else joint.station)
        if parent is not None and parent.part is not None and joint.interface:
            carrier = _compute_placed_frame(carrier, Placement(parent.part.interface_of[joint.interface].origin))
        frame = _compute_placed_frame(carrier, joint.placement)
        frames[joint.child] = frame
        strokes += [(np.stack([carrier[0], frame[0]]), False), *_list_link_lines(mechanism.link_of[joint.child], frame)]
    return [stroke for stroke in strokes if np.ptp(stroke[0], axis=0).any()]


def _list_link_lines(link: Link, frame: PlacedFrame) -> list[Stroke]:
    """Lines from a link's frame to its mass centres and its tip, or along its beam."""
    lines: list[Stroke] = []
    if link.part is not None:
        root = link.part.interface_of[link.part.root]
        ends = [frame[0] + frame[1] @ one.origin for one in (root, *link.part.moved)]
        lines += [(np.stack([frame[0], ends[0]]), False), *((np.stack([frame[0], end]), True) for end in ends[1:])]
    elif link.beam is None:
        lines.append((np.stack([frame[0], frame[0] + frame[1] @ link.tip]), False))
    else:
        points = np.linspace(0.0, 1.0, BEAM_POINTS if link.beam.curvature.any() else 2)
        axis = [_find_section(frame, link.beam, float(station))[0] for station in points]
        lines += [(np.stack([frame[0], axis[0]]), False), (np.stack(axis), True)]
    for body in link.bodies:
        at = frame
        if link.beam is not None and body.station is not None:
            at = _find_section(frame, link.beam, body.station)
        if link.part is not None and body.interface:
            at = _compute_placed_frame(frame, Placement(link.part.interface_of[body.interface].origin))
        lines.append((np.stack([at[0], at[0] + at[1] @ body.inertia.com]), False))
    return lines


def _compute_placed_frame(frame: PlacedFrame, placement: Placement) -> PlacedFrame:
    """The frame that is placed in another one."""
    return frame[0] + frame[1] @ placement.position, frame[1] @ placement.rotation


def _find_section(frame: PlacedFrame, beam: Beam, station: float) -> PlacedFrame:
    """The frame of a beam's section at a fraction of its length, stress-free.

    x' = R e_1, R' = R skew(kappa) with constant kappa: the exponential of a matrix (4, 4).
    """
    root = _compute_placed_frame(frame, beam.placement)
    s = station * beam.length
    if not beam.curvature.any():
        return root[0] + s * root[1][:, 0], root[1]
    slope = np.zeros((4, 4))
    slope[:3, :3] = np.cross(np.eye(3), -beam.curvature)
    slope[0, 3] = 1.0
    moved = scipy.linalg.expm(s * slope)
    return root[0] + root[1] @ moved[:3, 3], root[1] @ moved[:3, :3]
