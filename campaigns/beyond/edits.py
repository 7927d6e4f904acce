"""Mechanisms with one thing changed, as a user would have got it wrong when building the engine's model by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crosscheck.engines.shared.probe_states import collect_joint_bodies
from flexinv.model.mechanism import (
    Beam,
    Body,
    Closure,
    Force,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
    Section,
    Spring,
)
from flexinv.typing import Array


def drop_urdf(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism without the URDF that it came from: whoever edits a model builds it from its numbers."""
    return replace(mechanism, urdf=None)


def replace_link(mechanism: Mechanism, name: str, change: Callable[[Link], Link]) -> Mechanism:
    """Return the mechanism with one link changed."""
    links = tuple(change(link) if link.name == name else link for link in mechanism.links)
    return replace(drop_urdf(mechanism), links=links)


def replace_body(mechanism: Mechanism, link: str, name: str, change: Callable[[Body], Body]) -> Mechanism:
    """Return the mechanism with one body of a link changed."""

    def update_link(one: Link) -> Link:
        return replace(one, bodies=tuple(change(b) if b.name == name else b for b in one.bodies))

    return replace_link(mechanism, link, update_link)


def replace_inertia(mechanism: Mechanism, link: str, name: str, change: Callable[[Inertia], Inertia]) -> Mechanism:
    """Return the mechanism with the inertia of one body changed."""
    return replace_body(mechanism, link, name, lambda b: replace(b, inertia=change(b.inertia)))


def replace_all_inertias(mechanism: Mechanism, change: Callable[[Inertia], Inertia]) -> Mechanism:
    """Return the mechanism with the inertia of every body changed."""
    for link in mechanism.links:
        for body in link.bodies:
            mechanism = replace_inertia(mechanism, link.name, body.name, change)
    return mechanism


def replace_joint(mechanism: Mechanism, name: str, change: Callable[[Joint], Joint]) -> Mechanism:
    """Return the mechanism with one joint changed."""
    joints = tuple(change(joint) if joint.name == name else joint for joint in mechanism.joints)
    return replace(drop_urdf(mechanism), joints=joints)


def replace_all_joints(mechanism: Mechanism, change: Callable[[Joint], Joint]) -> Mechanism:
    """Return the mechanism with every joint changed."""
    return replace(drop_urdf(mechanism), joints=tuple(map(change, mechanism.joints)))


def replace_beam(mechanism: Mechanism, name: str, change: Callable[[Beam], Beam]) -> Mechanism:
    """Return the mechanism with one beam changed."""
    return replace_link(mechanism, name, lambda link: replace(link, beam=change(link.beam)) if link.beam else link)


def replace_section(mechanism: Mechanism, name: str, change: Callable[[Section], Section]) -> Mechanism:
    """Return the mechanism with the section of one beam changed."""
    return replace_beam(mechanism, name, lambda beam: replace(beam, section=change(beam.section)))


def replace_closure(mechanism: Mechanism, name: str, change: Callable[[Closure], Closure]) -> Mechanism:
    """Return the mechanism with one closure changed."""
    changed = tuple(change(c) if c.name == name else c for c in mechanism.closures)
    return replace(drop_urdf(mechanism), closures=changed)


def replace_spring(mechanism: Mechanism, name: str, change: Callable[[Spring], Spring]) -> Mechanism:
    """Return the mechanism with one spring changed."""
    return replace(drop_urdf(mechanism), springs=tuple(change(s) if s.name == name else s for s in mechanism.springs))


def replace_force(mechanism: Mechanism, name: str, change: Callable[[Force], Force]) -> Mechanism:
    """Return the mechanism with one given force changed."""
    return replace(drop_urdf(mechanism), forces=tuple(change(f) if f.name == name else f for f in mechanism.forces))


def list_moving_bodies(mechanism: Mechanism) -> list[tuple[Link, Body]]:
    """Return the bodies with mass that some joint moves, each with its link."""
    links = mechanism.link_of
    return [
        (links[name], body)
        for bodies in collect_joint_bodies(mechanism).values()
        for name, body in bodies
        if body.inertia.mass > 0.0
    ]


def find_parent_joint(mechanism: Mechanism, link: str) -> Joint:
    """Return the joint that carries a link."""
    return next(j for j in mechanism.joints if j.child == link)


def list_child_joints(mechanism: Mechanism, link: str) -> tuple[str, ...]:
    """Return the joints that stand on a link."""
    return tuple(j.name for j in mechanism.joints if j.parent == link)


def list_body_names(mechanism: Mechanism, link: str, body: str = "") -> tuple[str, ...]:
    """Return the names under which a body is known: its own, its link's, that of the joint that carries it.

    A mechanism of a single moving body is that body: then "all" is a name of it, too.
    """
    whole = ("all",) if len(list_moving_bodies(mechanism)) + len(mechanism.beams) == 1 else ()
    return (link, *((body, f"{link}/{body}") if body else ()), find_parent_joint(mechanism, link).name, *whole)


def compute_rotation(axis: Array, angle: float) -> Array:
    """Return the rotation matrix [-] of an angle [rad] about an axis, by Rodrigues' formula."""
    n = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def draw_normal_vector(axis: Array, rng: np.random.Generator) -> Array:
    """Return a unit vector (3,) [-] at right angles to an axis, by lot."""
    while True:
        found = np.cross(axis, rng.normal(size=3))
        if (size := float(np.linalg.norm(found))) > 0.1:  # not too close to the axis to be divided
            return np.asarray(found / size)


def move_placement(placement: Placement, by: Array) -> Placement:
    """Return the placement moved by a vector (3,) [m] in its parent's frame."""
    return replace(placement, position=placement.position + by)


def turn_placement(placement: Placement, axis: Array, angle: float) -> Placement:
    """Return the placement turned by an angle [rad] about an axis of its own frame."""
    return replace(placement, rotation=placement.rotation @ compute_rotation(axis, angle))


def compute_parallel_axis_term(mass: float, com: Array) -> Array:
    """Return m (|c|^2 1 - c c^T) (3, 3) [kg m^2]."""
    return np.asarray(mass * (float(com @ com) * np.eye(3) - np.outer(com, com)))


def is_inertia_tensor(tensor: Array) -> bool:
    """Return True if a body can have this tensor: positive definite, no principal inertia above the sum of the others."""
    low, middle, high = np.linalg.eigvalsh(tensor)
    return bool(low > 0.0 and high <= low + middle)
