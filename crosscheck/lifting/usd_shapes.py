"""Shapes of USD as `ComputeMassProperties` asks for them: volume, inertia at density one, centre, place on the body.

Lengths are those of the stage; the scale of a shape in its body is in them.  Source: UsdPhysics.RigidBodyAPI of usd-core 26.11.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexinv.errors import InputError
from flexinv.model.mechanism import Array

EVEN = 1e-6  # relative: scales in single precision that are the same
ALONG = {
    "X": [1, 2, 0],
    "Y": [2, 0, 1],
    "Z": [0, 1, 2],
}  # the axes of a shape along z, as rows of one along the named axis


def compute_shape_mass(shape: Any, body: Any, cache: Any) -> Any:
    """Return the MassInformation of a collider prim of a body [units of the stage].  Raises InputError for other shapes."""
    from pxr import Gf, UsdPhysics

    matrix = np.array(cache.GetLocalToWorldTransform(shape)) @ np.linalg.inv(
        _remove_scale(cache.GetLocalToWorldTransform(body))
    )
    scale = np.linalg.norm(matrix[:3, :3], axis=1)
    volume, com, tensor = _compute_solid(shape, scale)
    turn = Gf.Matrix3d(*(float(x) for x in (matrix[:3, :3] / scale[:, None]).ravel())).ExtractRotation().GetQuat()
    mass_information = UsdPhysics.RigidBodyAPI.MassInformation()
    mass_information.volume = float(volume)
    mass_information.inertia = Gf.Matrix3f(*(float(x) for x in tensor.ravel()))
    mass_information.centerOfMass = Gf.Vec3f(*(float(x) for x in com))
    mass_information.localPos = Gf.Vec3f(*(float(x) for x in matrix[3, :3]))
    mass_information.localRot = Gf.Quatf(turn)
    return mass_information


def _remove_scale(matrix: Any) -> Array:
    """A transformation without its scale."""
    plain = np.array(matrix)
    plain[:3, :3] /= np.linalg.norm(plain[:3, :3], axis=1)[:, None]
    return plain


def _compute_solid(shape: Any, scale: Array) -> tuple[float, Array, Array]:
    """Volume, centre (3,) and tensor (3, 3) about it at density one, along the shape's axes."""
    kind = shape.GetTypeName()
    if kind == "Mesh":
        return _compute_mesh_solid(shape, scale)
    get = lambda key: float(shape.GetAttribute(key).Get())  # noqa: E731
    if kind == "Cube":
        sides = get("size") * scale
        volume = float(np.prod(sides))
        squares = volume * sides**2 / 12
        return volume, np.zeros(3), np.diag(squares.sum() - squares)
    if kind == "Sphere" and np.ptp(scale) <= EVEN * scale[0]:
        radius = get("radius") * scale[0]
        volume = 4 / 3 * np.pi * radius**3
        return volume, np.zeros(3), 0.4 * volume * radius**2 * np.eye(3)
    if kind in ("Cylinder", "Capsule"):
        order = ALONG[shape.GetAttribute("axis").Get()]
        across = scale[order[0]]
        along = scale[order[2]]
        if abs(across - scale[order[1]]) <= EVEN * across and (
            kind == "Cylinder" or abs(along - across) <= EVEN * across
        ):
            return _compute_round_solid(kind, get("radius") * across, get("height") * along, order)
    raise InputError(
        f"{shape.GetPath()}: the mass of its body comes from a {kind or 'shape without a type'}, scaled by {scale.tolist()}; "
        "write physics:mass, physics:diagonalInertia and physics:centerOfMass on the body"
    )


def _compute_round_solid(kind: str, radius: float, height: float, order: list[int]) -> tuple[float, Array, Array]:
    """Cylinder, or cylinder with half balls at its ends, about its centre."""
    tube = np.pi * radius**2 * height
    axial = tube * radius**2 / 2
    across = tube * (radius**2 / 4 + height**2 / 12)
    volume = tube
    if kind == "Capsule":
        balls = 4 / 3 * np.pi * radius**3
        volume += balls
        axial += 0.4 * balls * radius**2
        across += balls * (0.4 * radius**2 + height**2 / 4 + 3 / 8 * radius * height)
    moments = np.empty(3)
    moments[order] = across, across, axial
    return volume, np.zeros(3), np.diag(moments)


def _compute_mesh_solid(shape: Any, scale: Array) -> tuple[float, Array, Array]:
    try:
        import trimesh
    except ImportError:
        raise InputError(
            f"{shape.GetPath()}: the mass of its body comes from a mesh, which trimesh measures: python -m pip install trimesh"
        ) from None
    points = np.array(shape.GetAttribute("points").Get(), dtype=float) * scale
    counts, corners = (np.array(shape.GetAttribute(f"faceVertex{key}").Get()) for key in ("Counts", "Indices"))
    faces = [
        [corners[start], corners[start + k], corners[start + k + 1]]
        for start, count in zip(np.cumsum(counts) - counts, counts, strict=True)
        for k in range(1, count - 1)
    ]
    mesh = trimesh.Trimesh(points, np.array(faces))
    if not mesh.is_watertight:
        mesh = mesh.convex_hull
    return abs(float(mesh.volume)), np.array(mesh.center_mass), np.array(mesh.moment_inertia)
