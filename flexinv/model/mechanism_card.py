"""The card of a mechanism: what it is made of, its joints in a table, and its outline with all joints at zero."""

from __future__ import annotations

from collections.abc import Iterator

from flexinv.display.card import Card, Picture, make_rows
from flexinv.display.drawing import draw_svg
from flexinv.display.words import format_count, format_number
from flexinv.model.joints import Joint
from flexinv.model.link_mass import compute_link_mass
from flexinv.model.mechanism import Mechanism
from flexinv.model.outline import list_outline

COLUMNS = ("joint", "kind", "on", "carries", "drive", "its mass [kg]")


def make_mechanism_card(mechanism: Mechanism) -> Card:
    """Return the card of a mechanism: links, joints, masses [kg], gravity [m/s^2], and its outline."""
    moving = [joint for joint in mechanism.joints if joint.nv]
    title = f"Mechanism '{mechanism.name}'" + (f": {mechanism.title}" if mechanism.title else "")
    facts = (_describe_size(mechanism, moving), _describe_mass(mechanism), *_describe_parts(mechanism))
    rows = make_rows(_list_joint_row(mechanism, joint) for joint in moving)
    return Card(title, facts, COLUMNS, rows, len(moving), lambda: _draw_outline(mechanism))


def _describe_size(mechanism: Mechanism, moving: list[Joint]) -> str:
    beams = [link.name for link in mechanism.beams]
    links = format_count(len(mechanism.links), "link")
    kinds = f"{links}, of which beams: {', '.join(beams)}" if beams else f"{links}, all rigid"
    drives = format_count(sum(joint.actuated for joint in moving), "drive")
    joints = f"{format_count(len(moving), 'joint')} that move" if len(moving) != 1 else "1 joint that moves"
    return f"{joints}, {drives}; nq = {mechanism.nq}, nv = {mechanism.nv}; {kinds}"


def _describe_mass(mechanism: Mechanism) -> str:
    mass = sum(map(compute_link_mass, mechanism.links))
    gravity = ", ".join(map(format_number, mechanism.gravity))
    return f"mass {format_number(mass)} kg, gravity ({gravity}) m/s^2"


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
    on = joint.parent if joint.station is None else f"{joint.parent} at {joint.station:g}"
    mass = format_number(compute_link_mass(mechanism.link_of[joint.child]))
    return joint.name, joint.kind, on, joint.child, "yes" if joint.actuated else "no", mass


def _draw_outline(mechanism: Mechanism) -> tuple[Picture, ...]:
    strokes = list_outline(mechanism)
    if not strokes:
        return ()
    open_loops = "; loops may stand open there" if mechanism.closures else ""
    beams = ", beams blue" if mechanism.beams else ""
    return (Picture(draw_svg([strokes], mechanism.name), f"all joints at zero{beams}{open_loops}"),)
