"""Bodies of a mechanism file: mass, centre of mass and inertia from a table, and whether a body can have them."""

from __future__ import annotations

import numpy as np

from flexinv.files.schema import BodyTable, CylinderTable, PayloadTable, RodTable
from flexinv.files.toml_tables import Location
from flexinv.model.mechanism import Body, Inertia
from flexinv.typing import Array

# Relative to the largest moment: files carry about seven digits, so a thin plate's xx + yy = zz is met to 1e-6.
DIGITS = 1e-6
SHAPES = ("inertia_kgm2", "rod", "box", "cylinder", "sphere")


def impossible(tensor: Array) -> str:
    """Return the reason why no body has this inertia tensor (3, 3) [kg m^2]; ``""`` when one has.

    A body's tensor is symmetric, its principal moments are p >= 0 and p_i + p_j >= p_k.
    """
    largest = float(np.abs(tensor).max())
    if largest == 0.0:
        return ""
    if np.abs(tensor - tensor.T).max() > DIGITS * largest:
        return "it is not symmetric"
    moments = np.linalg.eigvalsh(tensor)
    text = ", ".join(f"{p:.4g}" for p in moments)
    if moments[0] < -DIGITS * largest:
        return f"a principal moment is negative ({text} kg m^2)"
    if moments[0] + moments[1] < moments[2] * (1 - DIGITS):
        return f"one principal moment exceeds the sum of the others ({text} kg m^2)"
    return ""


def shape_inertia(table: BodyTable, mass: float) -> tuple[Array, Array | None]:
    """Return the tensor (3, 3) [kg m^2] about the centre of mass and the shape's own centre (3,) [m], if it has one.

    rod: m L^2/12 across; box: m (b^2 + c^2)/12; cylinder: m r^2/2 along, m (3 r^2 + L^2)/12 across; sphere: 2/5 m r^2.
    """
    long = table.rod or table.cylinder
    if long is not None:
        if isinstance(long, RodTable):
            axial, across = long.axial_inertia_kgm2, mass * long.length_m**2 / 12
        else:
            axial, across = mass * long.radius_m**2 / 2, mass * (3 * long.radius_m**2 + long.length_m**2) / 12
        moments = np.full(3, across)
        moments["xyz".index(long.along)] = axial
        return np.diag(moments), far_end(long) / 2
    if table.box is not None:
        squares = np.square(table.box.size_m)
        return np.diag(mass * (squares.sum() - squares) / 12), None
    if table.sphere is not None:
        return np.eye(3) * (0.4 * mass * table.sphere.radius_m**2), None
    return np.asarray(table.inertia_kgm2, dtype=np.float64), None


def far_end(table: RodTable | CylinderTable) -> Array:
    """Return the end point of a rod or cylinder, (3,) [m]; it begins at the frame's origin."""
    end = np.zeros(3)
    end["xyz".index(table.along)] = table.length_m
    return end


def read_inertia(table: BodyTable, where: Location) -> Inertia:
    """Read one body's inertia [kg, m, kg m^2] from its table; InputError when no body can have it."""
    if table.mass_kg is None:
        info = type(table).model_fields["mass_kg"]
        words = info.description or "", str((info.examples or [""])[0])
        raise where.wrong("mass_kg", "nothing", *words)
    given = [name for name in SHAPES if getattr(table, name) is not None]
    if len(given) != 1:
        advice = "inertia_kgm2 = { xx = 1e-4, yy = 2.9e-3, zz = 2.9e-3 }, or inertia_kgm2 = 0 for a point mass"
        expected = f"exactly one of {', '.join(SHAPES)}"
        raise where.wrong("inertia_kgm2", " and ".join(given) or "nothing", expected, advice)
    tensor, centre = shape_inertia(table, table.mass_kg)
    com = np.array(table.com_m, dtype=np.float64) if table.com_m is not None else centre
    if com is None:
        raise where.wrong("com_m", "nothing", "the centre of mass, three numbers [m]", "com_m = [0, 0, 0]")
    reason = impossible(tensor)
    if reason:
        expected = "the inertia of a body about its centre of mass [kg m^2]: symmetric, moments p1 + p2 >= p3 >= 0"
        advice = "the tensor about the centre of mass, not about the joint; check signs and order of its numbers"
        rows = np.array2string(tensor, separator=", ").replace("\n", "")
        raise where.wrong(given[0], f"{rows}: {reason}", expected, advice)
    return Inertia(table.mass_kg, com, (tensor + tensor.T) / 2)


def read_payloads(tables: list[PayloadTable], beam: bool, own: str, where: Location) -> tuple[Body, ...]:
    """Read the bodies that a link carries; on a beam each names its station [-], on a rigid link none does.

    own : the name of the link's own body, which no payload may have
    """
    bodies: list[Body] = []
    for k, table in enumerate(tables):
        here = where.inner(f"payload[{k}]")
        on, off = "the beam's length that carries it", "the link is rigid"
        check_station(table.station, beam, here, on, off, "com_m alone, in the link frame")
        if table.name in (own, *(body.name for body in bodies)):
            expected = "a name of its own for each body of a link"
            raise here.wrong("name", f'"{table.name}" twice', expected, f'name = "{table.name}_2"')
        bodies.append(Body(table.name, read_inertia(table, here), table.station))
    return tuple(bodies)


def check_station(station: float | None, on_beam: bool, where: Location, beam: str, other: str, write: str) -> None:
    """Check that what a beam carries names its station [-], and nothing else does; ``beam``, ``other`` : in words."""
    if on_beam and station is None:
        raise where.wrong("station", "nothing", f"the fraction 0..1 of {beam} [-]", "station = 1.0   (the tip)")
    if not on_beam and station is not None:
        raise where.wrong("station", f"station = {station}", f"no station: {other}", write)
