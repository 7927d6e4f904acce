"""Detection of planar mechanisms, which need three dof per node (`planar.stepper`); for others, the part out of the plane.

A mechanism is planar if mirroring at the plane leaves it unchanged: axes normal to the plane, or slides in it; all nodes in it;
sections, bodies and stress-free shapes symmetric to it; gravity along it.  Its motion out of the plane, tilting of beams
included, then stays zero: the spatial equations have the planar solution (and would leave it only where it buckles
sideways, by rounding errors alone).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexinv.constraints.closures import Rows, build_constraint_rows
from flexinv.elements.beam_element import Elements
from flexinv.kernels.so3 import find_vectors_across
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import SECTION
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Indices, Mask

# Components out of the plane below this part of what they are compared with are rounding of the placements' angles.
PLACEMENT_ROUNDING = 1e-13


@dataclass(frozen=True)
class Plane:
    """A plane and the nodes in it, joints at zero and beams stress-free.

    axes : (3, 3) columns: x and y of the plane and its normal, in the world; height : along the normal [m]
    frames : (nodes, 3, 3) R_plane,node
    """

    axes: Array
    height: float
    frames: Array


@dataclass(frozen=True)
class NotPlanar:
    """Reason why a mechanism is solved in space."""

    reason: str


@make_owner_cache()
def find_plane(mesh: Mesh) -> Plane | NotPlanar:
    """Return the plane [m] in which a mechanism moves whatever its joints do, or why there is none."""
    m = mesh.mechanism
    if m.meshed:
        return NotPlanar("it has links that are meshes")
    couplings = [closure for closure in m.closures if closure.kind == "coupling"]
    for what, items in (("springs", m.springs), ("applied forces", m.forces), ("couplings", couplings)):
        if items:
            return NotPlanar(f"it has {what}")
    if any(joint.stiffness for joint in m.joints):
        return NotPlanar("it has springs in joints")
    rotation = np.empty((mesh.size, 3, 3))  # in the world, joints at zero
    for n, parent in enumerate(mesh.parent):
        rotation[n] = mesh.rotation[n] if parent < 0 else rotation[parent] @ mesh.rotation[n]
    plane: Plane | NotPlanar = NotPlanar("it has neither revolute joints nor beams")
    for normal in _list_normals(mesh, rotation):
        if isinstance(plane := _check(mesh, rotation, normal), Plane):
            break
    return plane


def convert_to_plane(plane: Plane, node: Indices, vectors: Array) -> Array:
    """Return vectors (rows, 3) [any unit] fixed in nodes (rows,), -1 the world, in the plane's axes where those stand at zero."""
    frames = np.where((node >= 0)[:, None, None], plane.frames[node], plane.axes.T)
    return np.asarray(np.einsum("rij,rj->ri", frames, vectors))


def find_planar_rows(plane: Plane, rows: Rows) -> Mask:
    """Return a mask (rows,) of the constraints that act in the plane [-]; every planar motion satisfies the others."""
    inside = ~_find_upright(convert_to_plane(plane, rows.a, rows.u))
    return inside & (~rows.direction | ~_find_upright(convert_to_plane(plane, rows.b, rows.w)))


def _find_upright(vectors: Array) -> Mask:
    return np.hypot(vectors[:, 0], vectors[:, 1]) <= PLACEMENT_ROUNDING


def _describe_spatial_closure(mesh: Mesh, plane: Plane) -> str:
    """Return a message on a closure with frames outside the plane or more than planar ties; empty if none has [-]."""
    rows = build_constraint_rows(mesh)
    u = convert_to_plane(plane, rows.a, rows.u)
    w = convert_to_plane(plane, rows.b, rows.w)
    above = [convert_to_plane(plane, n, p)[:, 2] for n, p in ((rows.a, rows.place_a), (rows.b, rows.place_b))]
    above = [p - np.where(n < 0, plane.height, 0.0) for n, p in zip((rows.a, rows.b), above, strict=True)]
    skew = ~_find_upright(u) & (np.abs(u[:, 2]) > PLACEMENT_ROUNDING)
    skew |= rows.direction & ~_find_upright(w) & (np.abs(w[:, 2]) > PLACEMENT_ROUNDING)
    skew |= rows.direction & _find_upright(u) & _find_upright(w)
    skew |= ~rows.direction & (np.abs(above[0] - above[1]) > PLACEMENT_ROUNDING * mesh.length)
    if skew.any():
        name = mesh.mechanism.closures[int(rows.closure[int(np.argmax(skew))])].name
        return f"the frames of closure '{name}' do not lie in the plane"
    return ""


def _list_normals(mesh: Mesh, rotation: Array) -> list[Array]:
    """Normals that are possible: the first axis of rotation, else y or z of the first beam section."""
    for n in range(mesh.size):
        if mesh.freedoms[n] == 1 and mesh.turn[n].any():
            return [rotation[n] @ mesh.axis[n]]
    sections = np.flatnonzero(mesh.kind == SECTION)
    return [rotation[sections[0]][:, 2], rotation[sections[0]][:, 1]] if len(sections) else []


def _check(mesh: Mesh, rotation: Array, normal: Array) -> Plane | NotPlanar:
    axes = np.stack([*find_vectors_across(normal), normal], axis=1)
    frames = axes.T @ rotation
    heights = np.zeros(mesh.size)
    for n, parent in enumerate(mesh.parent):
        frame, start = (axes.T, 0.0) if parent < 0 else (frames[parent], heights[parent])
        heights[n] = start + (frame @ mesh.offset[n])[2]
    plane = Plane(axes, float(heights[0]) if mesh.size else 0.0, frames)
    gravity = mesh.mechanism.gravity
    reason = _describe_spatial_node(mesh, frames, heights) or _describe_asymmetry(mesh, frames)
    if not reason and abs(gravity @ normal) > PLACEMENT_ROUNDING * np.linalg.norm(gravity):
        reason = "gravity pulls out of the plane"
    reason = reason or _describe_spatial_closure(mesh, plane)
    return NotPlanar(reason) if reason else plane


def _describe_spatial_node(mesh: Mesh, frames: Array, heights: Array) -> str:
    """Return a message on the first node whose joint or place leaves the plane; empty if none does."""
    for n in range(mesh.size):
        link = mesh.mechanism.links[int(mesh.link[n])].name
        slide = frames[n] @ mesh.slide[n, 0]
        turn = frames[n] @ mesh.turn[n, 0]
        if mesh.freedoms[n] > 1:
            return f"the joint of link '{link}' turns in space"
        if np.hypot(turn[0], turn[1]) > PLACEMENT_ROUNDING:
            return f"the axis of link '{link}' is not normal to the plane"
        if abs(slide[2]) > PLACEMENT_ROUNDING:
            return f"link '{link}' slides out of the plane"
        if abs(heights[n] - heights[0]) > PLACEMENT_ROUNDING * mesh.length:
            return f"link '{link}' reaches out of the plane"
    return ""


def _has_couplings_out_of_plane(elements: Elements, element: int, normal: Array) -> bool:
    """True where axial strain, shear or bending in the plane have stress of the other three strains."""
    aside = np.cross(normal, [1.0, 0.0, 0.0])
    none = np.zeros(3)
    within = np.array([[1.0, 0, 0, 0, 0, 0], [*aside, *none], [*none, *normal]])
    outside = np.array([[*normal, *none], [0, 0, 0, 1.0, 0, 0], [*none, *aside]])
    for coupling, direct in ((elements.coupling, elements.stiffness), (elements.damping_coupling, elements.damping)):
        for matrix, diagonal in zip(coupling[element : element + 1], direct[element : element + 1], strict=False):
            size = np.sqrt(np.abs(np.einsum("gi,gj->gij", diagonal, diagonal)))
            across = within @ matrix @ outside.T
            if (np.abs(across) > PLACEMENT_ROUNDING * (np.abs(within) @ size @ np.abs(outside).T)).any():
                return True
    return False


def _describe_asymmetry(mesh: Mesh, frames: Array) -> str:
    """Return a message on the first section or body that is not symmetric to the plane; empty if all are."""
    e = mesh.elements
    for k, nodes in enumerate(e.nodes):
        normal = frames[nodes[0]][2]
        same = [np.abs(frames[n][2] - normal).max() <= PLACEMENT_ROUNDING for n in nodes[: e.order[k] + 1]]
        upright = np.sort(np.abs(normal))[1] <= PLACEMENT_ROUNDING and abs(normal[0]) <= PLACEMENT_ROUNDING
        across = np.abs(e.gamma0[k] @ normal).max() <= PLACEMENT_ROUNDING
        about = e.kappa0[k] - np.outer(e.kappa0[k] @ normal, normal)
        if not (all(same) and upright and across and np.abs(about).max() * mesh.length <= PLACEMENT_ROUNDING):
            return f"the section or curvature of beam '{mesh.mechanism.links[int(e.link[k])].name}' is not symmetric to the plane"
        if _has_couplings_out_of_plane(e, k, normal):
            name = mesh.mechanism.links[int(e.link[k])].name
            return f"the section of beam '{name}' couples strains in the plane with strains out of it"
    for n in range(mesh.size):
        normal = frames[n][2]
        inertia = mesh.inertia[n]
        turned = inertia @ normal
        if np.abs(turned - (normal @ turned) * normal).max() > PLACEMENT_ROUNDING * np.abs(inertia).max():
            return f"the inertia of link '{mesh.mechanism.links[int(mesh.link[n])].name}' is not symmetric to the plane"
    return ""
