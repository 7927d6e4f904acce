"""Findings in the shapes of links: units, centres of mass outside, moments that nothing within them has, densities.

About its centre of mass no body has more than  m r_max^2,  r_max the distance of the farthest point of its shapes.  Meshes are
looked at where they are read (`mesh_files`); a link is judged if all of its shapes are read, and if they can hold its
mass: a sphere of 1 mm is a mark.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

import numpy as np

from crosscheck.findings.finding import Finding, make_warning
from crosscheck.findings.statements import LinkStatements
from crosscheck.linting.mesh_files import MeshFile
from crosscheck.linting.volumes import compute_volume
from flexinv.files.joints import compute_rpy_rotation
from flexinv.model.mechanism import Array
from flexinv.model.parallel_axis import compute_parallel_axis_term

WIDE = 20.0  # extent of a mesh over that of the machine from which on it looks like mm
OUTSIDE = 0.25  # of the diagonal of a link's shapes: how far beyond their box a centre of mass may be
BEYOND = 1.5  # largest moment over m r_max^2
# [kg/m^3]: nothing is denser than osmium, 22587 +- 9 at 20 degC (Arblaster, Platinum Metals Review 39(4), 1995, 164), rounded up;
# no link is lighter than the air in its place, 1.225 at sea level (International Standard Atmosphere, ISO 2533), rounded down.
DENSEST = 23e3
LIGHTEST = 1.2
MARK = 0.02  # of the machine: shapes that are smaller and cannot hold the mass of their link are marks of a frame
LIGHT = 1e-4  # of the machine's mass: lighter links are sensors and marks, whose numbers nothing feels
ROUND = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)


def check_meshes(
    robot: Element, meshes: Mapping[str, MeshFile], links: Mapping[str, LinkStatements], size: float
) -> Iterator[Finding]:
    """Yield findings of links whose shapes are all there [m, kg m^2]; meshes : by name; size : of the machine [m]."""
    total = sum(link.inertia.mass for link in links.values() if link.written and link.inertia.mass > 0)
    for element in robot.findall("link"):
        link = links.get(element.get("name", ""))
        points = _collect_link_points(element, meshes)
        if link is not None and points is not None and link.inertia.mass >= LIGHT * total:
            volumes = [
                compute_volume(part, meshes) for kind in ("visual", "collision") for part in element.findall(kind)
            ]
            yield from _check_link(link, points, max((one for one in volumes if one), default=0.0), size)


def _collect_link_points(element: Element, meshes: Mapping[str, MeshFile]) -> Array | None:
    """All points of what is drawn of a link and of what collides (n, 3) [m]; of the one of them that is all there.

    Boxes, cylinders and spheres that collide cover what may be hit, not the whole link: alone they do not stand for a drawn mesh.
    """
    drawn, colliding = (_collect_points(element.findall(kind), meshes) for kind in ("visual", "collision"))
    solid = any(part.find("geometry/mesh") is None for part in element.findall("collision"))
    if drawn is None and element.find("visual") is not None and solid:
        return None
    found = [points for points in (drawn, colliding) if points is not None]
    return np.vstack(found) if found else None


def _collect_points(parts: list[Element], meshes: Mapping[str, MeshFile]) -> Array | None:
    found = [_read_points(part, meshes) for part in parts]
    there = [points for points in found if points is not None]
    return np.vstack(there) if there and len(there) == len(parts) else None


def _check_link(link: LinkStatements, points: Array, volume: float, size: float) -> Iterator[Finding]:
    place = f"link {link.name}"
    body = link.inertia
    low = points.min(axis=0)
    high = points.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    if size and diagonal > WIDE * size:
        why = f"the machine extends {size:.3g} m: looks like mm"
        yield make_warning("mesh", place, f"shapes of {diagonal:.3g} m", why, '<mesh scale="0.001 0.001 0.001" .../>')
        return
    if not link.written or not body.mass > 0 or not diagonal:
        return
    box = float(np.prod(high - low))
    yield from _check_density(place, body.mass, box, volume, diagonal >= MARK * size)
    if body.mass > DENSEST * box:
        return  # a mark, or the shapes of something else
    beyond = float(np.linalg.norm(np.maximum(0.0, np.maximum(low - body.com, body.com - high))))
    if beyond > OUTSIDE * diagonal:
        given = f"{' '.join(f'{x:.4g}' for x in body.com)} m"
        why = f"{beyond:.3g} m outside of its shapes, whose diagonal is {diagonal:.3g} m"
        yield make_warning("centre outside", place, given, why, "the centre of mass in the link's frame, m")
        return
    reach = float(np.linalg.norm(points - body.com, axis=1).max())
    largest = float(np.linalg.eigvalsh((body.tensor + body.tensor.T) / 2)[-1])
    if largest > BEYOND * body.mass * reach**2:
        given = f"largest moment {largest:.4g} kg m^2, {body.mass:g} kg"
        why = f"no body within its shapes has more than {body.mass * reach**2:.3g} kg m^2"
        about = body.tensor - compute_parallel_axis_term(body.mass, body.com)
        moved = np.linalg.eigvalsh((about + about.T) / 2)
        hint = "the moments about the centre of mass"
        if moved[0] >= 0 and moved[-1] <= body.mass * reach**2:
            hint = f"the moments about the centre of mass; if these are about the link's frame, {moved[-1]:.4g} kg m^2 at most"
        yield make_warning("moments of shape", place, given, why, hint)


def _check_density(place: str, mass: float, box: float, volume: float, large: bool) -> Iterator[Finding]:
    """Yield a mass [kg] that no material has in a box [m^3] around shapes, or less than air in the largest of them.

    large : the shapes are no marks
    """
    write = "the mass in kg, or the shapes of the link"
    if large and 0 < DENSEST * box < mass:
        given = f"{mass:g} kg in a box of {box:.3g} m^3 around its shapes: {mass / box:.3g} kg/m^3 or more"
        why = (
            f"no material has more than {DENSEST:g} kg/m^3 (osmium has 22587): the mass in g, or shapes of another link"
        )
        yield make_warning("density", place, given, why, write)
    if mass < LIGHTEST * volume:
        given = f"{mass:g} kg, a shape of {volume:.3g} m^3: {mass / volume:.3g} kg/m^3"
        why = f"the air in its place weighs more, {LIGHTEST:g} kg/m^3: a placeholder, or a mass in tonnes"
        yield make_warning("density", place, given, why, write)


def _read_points(part: Element, meshes: Mapping[str, MeshFile]) -> Array | None:
    """Points of a shape in the link's frame (n, 3) [m]; None for one that is not there or not read."""
    geometry = part.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        return None
    try:
        found = _read_mesh_points(shape, meshes) if shape.tag == "mesh" else _compute_solid_points(shape)
        origin = part.find("origin")
        xyz, rpy = (_read_numbers(origin, key, "0 0 0") for key in ("xyz", "rpy"))
    except ValueError:
        return None
    return None if found is None else found @ compute_rpy_rotation(rpy).T + xyz


def _read_numbers(element: Element | None, key: str, default: str) -> Array:
    text = default if element is None else element.get(key, default)
    return np.array([float(word) for word in text.split()])


def _compute_solid_points(shape: Element) -> Array | None:
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    if shape.tag == "box":
        return corners * _read_numbers(shape, "size", "0 0 0") / 2
    radius = float(shape.get("radius", "nan"))
    circle = radius * np.column_stack([np.cos(ROUND), np.sin(ROUND)])
    if shape.tag == "cylinder":
        half = float(shape.get("length", "nan")) / 2
        return np.vstack([np.column_stack([circle, np.full(len(ROUND), end)]) for end in (-half, half)])
    if shape.tag == "sphere":
        return np.vstack([np.roll(np.column_stack([circle, np.zeros(len(ROUND))]), k, axis=1) for k in range(3)])
    return None


def _read_mesh_points(shape: Element, meshes: Mapping[str, MeshFile]) -> Array | None:
    file = meshes.get(shape.get("filename", ""))
    if file is None or file.points is None:
        return None
    scale = _read_numbers(shape, "scale", "1 1 1")
    return file.points * scale if np.isfinite(scale).all() else None
