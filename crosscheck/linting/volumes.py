"""Volumes of the shapes of a URDF, as they are and as MuJoCo takes those of meshes.

Of a surface of triangles with corners a, b, c it is  sum a . (b x c) / 6, by Gauss' theorem, and its absolute value, as corners
may run the other way round.  MuJoCo takes  sum |(a - p) . ((b - p) x (c - p))| / 6 ("legacy" of its attribute inertia), where p
is the centre of mass of such cones over the mean of the triangles' centres, weighted by areas: more for what is not star-shaped,
or not closed.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element

import numpy as np

from crosscheck.linting.mesh_files import MeshFile
from flexinv.model.mechanism import Array


def compute_volume(part: Element, meshes: Mapping[str, MeshFile], mujoco: bool = False) -> float | None:
    """Return the volume [m^3] of a <visual> or <collision>; None for a mesh that is not read, and for what is no number.

    mujoco : of meshes what MuJoCo takes
    """
    geometry = part.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        return None
    try:
        if shape.tag == "mesh":
            return _compute_mesh_volume(shape, meshes, mujoco)
        return _compute_solid_volume(shape)
    except ValueError:
        return None


def _compute_solid_volume(shape: Element) -> float | None:
    if shape.tag == "box":
        size = [float(word) for word in shape.get("size", "").split()]
        return float(np.prod(size)) if len(size) == 3 else None
    radius = float(shape.get("radius", ""))
    ball = 4.0 / 3.0 * np.pi * radius**3
    if shape.tag == "sphere":
        return ball
    tube = np.pi * radius**2 * float(shape.get("length", ""))
    return {"cylinder": tube, "capsule": tube + ball}.get(shape.tag)


def _compute_mesh_volume(shape: Element, meshes: Mapping[str, MeshFile], mujoco: bool) -> float | None:
    file = meshes.get(shape.get("filename", ""))
    if file is None or file.points is None or file.faces is None:
        return None
    scale = np.array([float(word) for word in shape.get("scale", "1 1 1").split()])
    if scale.shape != (3,) or not np.isfinite(scale).all():
        return None
    corners = (file.points * scale)[file.faces]
    if mujoco:
        return _compute_legacy_volume(corners)
    return float(abs(_compute_cones(corners - corners.mean(axis=(0, 1))).sum()))


def _compute_legacy_volume(corners: Array) -> float | None:
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not areas.sum() > 0:
        return None
    corners = corners - areas @ corners.mean(axis=1) / areas.sum()
    cones = np.abs(_compute_cones(corners))
    if not cones.sum() > 0:
        return None
    centre = cones @ corners.sum(axis=1) / 4.0 / cones.sum()
    return float(np.abs(_compute_cones(corners - centre)).sum())


def _compute_cones(corners: Array) -> Array:
    """Volumes of the cones from the origin over triangles (n, 3 corners, 3) [m^3]."""
    volumes: Array = np.einsum("ni,ni->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    return volumes
