"""Masses that MuJoCo takes from shapes where a body of an MJCF has no ``<inertial>``, beside those of the shapes that collide.

    MuJoCo 4.0.0       every shape whose group is in ``inertiagrouprange``, seen or touched; 1000 kg/m^3 where nothing is said
    Pinocchio 4.1.0    shapes that collide (``contype`` or ``conaffinity``), whatever their group; a mesh 1 kg

Measured on a body with a box that collides, one that is only seen, both, with a mass of zero on either, groups within and
beyond the range, a mesh; ``discardvisual`` changes nothing in either.  A body that moves and weighs nothing is refused by MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco

from crosscheck.engines.mujoco.compiled.names import OBJECT, resolve_name
from crosscheck.lifting.description import ShapeMasses

REFUSALS = (ValueError, OSError, RuntimeError, mujoco.FatalError)
ALL_GROUPS = (0, 5)
# [kg], [kg m^2]: bodies without mass would be refused; this is none
LEAST = 1e-12
SAME = 1e-6  # of a mass: rounding of sums and of inertias about other points


def find_shape_masses(path: Path, model: Any) -> dict[str, ShapeMasses]:
    """Return by link what its shapes weigh [kg] where that of those that collide is another mass; model : of the file, compiled.

    Nothing is said of files that state the mass of the whole (``settotalmass``), or whose shapes are not there.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    groups = tuple(int(group) for group in spec.compiler.inertiagrouprange)
    names = {body.name for body in _list_weighed_bodies(spec)}
    if not names or spec.compiler.settotalmass > 0.0 or all(_is_weighed_by_all(geom, groups) for geom in spec.geoms):
        return {}
    try:
        touched = _build_colliding(spec)
    except REFUSALS:
        return {}
    moving = [body for body in range(1, model.nbody) if _can_move(model, body) and model.body(body).name in names]
    masses = {body: ShapeMasses(*_compare_masses(model, touched, body), groups) for body in moving}
    named = {resolve_name(model, OBJECT.mjOBJ_BODY, body, "body"): one for body, one in masses.items()}
    return {name: one for name, one in named.items() if one.weighed != one.colliding}


def _compare_masses(model: Any, touched: Any, body: int) -> tuple[float, float]:
    """The masses of a body in two models [kg]; one mass, twice, where they differ by rounding only."""
    stated, other = (float(one.body_mass[body]) for one in (model, touched))
    if abs(stated - other) <= max(SAME * max(stated, other), LEAST):
        return stated, stated
    return stated, other if other > 2 * LEAST else 0.0


def _can_move(model: Any, body: int) -> bool:
    return bool(model.body_weldid[body] > 0 and model.body_mocapid[body] < 0)


def _list_weighed_bodies(spec: Any) -> Iterator[Any]:
    """Yield the bodies whose mass is that of their shapes."""
    always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    never = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    for body in spec.bodies:
        if always or not (never or body.explicitinertial):
            yield body


def _can_collide(geom: Any) -> bool:
    return bool(geom.contype or geom.conaffinity)


def _is_weighed_by_all(geom: Any, groups: tuple[int, ...]) -> bool:
    return _can_collide(geom) and bool(groups[0] <= geom.group <= groups[1])


def _build_colliding(spec: Any) -> Any:
    """The model in which only shapes that collide weigh, whatever their group; changes the specification."""
    spec.compiler.inertiagrouprange = ALL_GROUPS
    spec.compiler.boundmass = max(spec.compiler.boundmass, LEAST)
    spec.compiler.boundinertia = max(spec.compiler.boundinertia, LEAST)
    for geom in spec.geoms:
        if not _can_collide(geom):
            geom.mass = 0.0
            geom.density = 0.0
    return spec.compile()
