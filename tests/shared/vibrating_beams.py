"""Beams and pendulums whose frequencies are known: steel cantilevers of a table, a bar that is pushed along, rods that hang."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from flexinv.linearized.modes import Modes
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
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
)

# Frequencies of steel cantilevers from the exact Timoshenko frequency determinant (transfer matrix), nine decimals.
TABLE = Path(__file__).resolve().parents[1] / "data" / "cantilever_frequencies_timoshenko.csv"
# Roots of two beams: clamped - clamped and clamped - pinned (cos x cosh x = 1, tan x = tanh x).
CLAMPED, PINNED = 4.730040744862704, 3.926602312047919
G = 9.81
YOUNG, SHEAR, DENSITY, WIDTH = 2e11, 8e10, 7800.0, 0.02
AREA, BENDING = WIDTH**2, WIDTH**4 / 12
EI = YOUNG * BENDING  # buckling load of the metre that is clamped: 2.467 EI


def cantilever(row: dict[str, str], elements: int = 2, order: int = 8) -> Mechanism:
    length, b, h, e, nu, rho, kappa = (float(row[k]) for k in ("L_m", "b_m", "h_m", "E_Pa", "nu", "rho", "kappa"))
    area, thin, wide, g = b * h, b * h**3 / 12, h * b**3 / 12, e / (2 * (1 + nu))
    # bending of the table is that about z; about y and in twist the beam is made much stiffer, so as to come later
    stiffness = np.array([[e * area, kappa * g * area, kappa * g * area, 1e9, 1e9, e * thin]])
    section = Section(np.zeros(1), stiffness, np.array([rho * area]), rho * np.array([[thin + wide, wide, thin]]))
    link = Link("beam", (), Beam(length, section, elements, order))
    return Mechanism("cantilever", (link,), (Joint("root", "fixed", WORLD, "beam"),), gravity=np.zeros(3))


def in_plane(found: Modes) -> list[int]:
    """Modes that bend the beam in its x-y plane."""
    size = np.abs(found.displacement).max(axis=1)  # (mode, xyz)
    turn = np.abs(found.rotation[:, :, 0]).max(axis=1)
    return [k for k, (x, y, z) in enumerate(size) if y > 1e3 * max(x, z) and y > 1e-3 * turn[k]]


with TABLE.open(encoding="utf-8", newline="") as stream:
    ROWS = list(csv.DictReader(stream))


def thin(closure: tuple[Closure, ...] = ()) -> Mechanism:
    """A beam of unit length, mass and bending stiffness, without shear and rotary inertia, clamped at its root."""
    section = Section(np.zeros(1), np.array([[1e6, 1e9, 1e9, 1e3, 1e3, 1.0]]), np.ones(1), np.zeros((1, 3)))
    link = Link("beam", (), Beam(1.0, section, 2, 8))
    return Mechanism("beam", (link,), (Joint("root", "fixed", WORLD, "beam"),), np.zeros(3), closure)


def rod(name: str, length: float, mass: float) -> Link:
    tensor = mass * length**2 / 12 * np.diag([0.0, 1.0, 1.0])
    body = Body(name, Inertia(mass, np.array([length / 2, 0.0, 0.0]), tensor))
    return Link(name, (body,), tip=np.array([length, 0.0, 0.0]))


def pendulum(count: int) -> Mechanism:
    links = tuple(rod(f"rod {k}", 0.5, 1.2) for k in range(count))
    hang = [Joint(f"q{k}", "revolute", WORLD if k == 0 else f"rod {k - 1}", f"rod {k}",
                  Placement(np.array([0.5 if k else 0.0, 0, 0]))) for k in range(count)]  # fmt: skip
    return Mechanism("pendulum", links, tuple(hang), gravity=np.array([G, 0.0, 0.0]))


def bar(elements: int, kind: str = "fixed", push: float = 0.0, follower: bool = False, thick: bool = True) -> Mechanism:
    """A square steel bar of a metre, pushed along by so many EI / m^2."""
    stiffness = np.array([[YOUNG * AREA, SHEAR * AREA / 1.2, SHEAR * AREA / 1.2, 2 * SHEAR * BENDING, EI, EI]])
    rotary = DENSITY * BENDING * np.array([[2.0, 1.0, 1.0]]) * thick
    link = Link("bar", (), Beam(1.0, Section(np.zeros(1), stiffness, np.array([DENSITY * AREA]), rotary), elements, 4))
    wrench = np.array([[-push * EI, 0.0, 0.0, 0.0, 0.0, 0.0]])
    force = Force("push", Attachment("bar", station=1.0), wrench, follower=follower)
    return Mechanism("bar", (link,), (Joint("root", kind, WORLD, "bar"),), np.zeros(3), forces=(force,) if push else ())
