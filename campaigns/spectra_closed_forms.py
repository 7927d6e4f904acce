"""Spectra that are known in closed form: cantilevers, Beck's column, Ziegler's pendulum with dampers, a whirling shaft."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy

from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Beam,
    Body,
    Force,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
    Section,
)
from flexinv.typing import Array

# Roundings of a few unknowns of the same size.
ROUNDING = 1e-12
# Stretch and, of slender beams, shear are so much stiffer than bending that they change frequencies by less than this part.
STIFF, SLENDER = 1e9, 1e-6


def closed_forms() -> Iterator[tuple[str, float, float]]:
    """Yield a name, by how much `flexinv` is off, and what is allowed: both parts of the root [-]."""
    yield from _cantilevers()
    yield from _columns()
    yield from _pendulums()
    yield from _shafts()


def _beam(shear: float, rotary: float, push: float = 0.0, twist: float = 1e-3) -> Mechanism:
    """A cantilever of unit length, mass and bending stiffness about z; about y it is much stiffer, so as to come later."""
    stiffness = np.array([[STIFF, shear, STIFF, 1e3, 1e4, 1.0]])
    inertia = np.array([[twist, 0.0, rotary]])
    link = Link("beam", (), Beam(1.0, Section(np.zeros(1), stiffness, np.ones(1), inertia), 3, 8))
    force = Force("push", Attachment("beam", station=1.0), np.array([[-push, 0, 0, 0, 0, 0.0]]), follower=True)
    clamp = Joint("root", "fixed", WORLD, "beam")
    return Mechanism("beam", (link,), (clamp,), np.zeros(3), forces=(force,) if push else ())


def _determinant(system: Callable[[complex], Array]) -> Callable[[complex], complex]:
    """The determinant of a beam of unit length, z' = S z, z = (w, turn, moment, shear): clamped, and free at its end."""

    def of(squared: complex) -> complex:
        return complex(np.linalg.det(scipy.linalg.expm(system(squared))[2:, 2:]))

    return of


def _root(function: Callable[[complex], complex], start: complex) -> complex:
    """The root of a function next to a start, by the secant method."""
    return complex(scipy.optimize.newton(function, start, tol=1e-13 * abs(start), rtol=1e-13, maxiter=200))


def _cantilevers() -> Iterator[tuple[str, float, float]]:
    for name, shear, rotary in (("Euler and Bernoulli", STIFF, 0.0), ("Timoshenko", 300.0, 2e-3)):

        def system(squared: complex, shear: float = shear, rotary: float = rotary) -> Array:
            # w' = turn + V / GA, turn' = M / EI, M' = -V - rho I omega^2 turn, V' = -rho A omega^2 w
            return np.array(
                [[0, 1, 0, 1 / shear], [0, 0, 1, 0], [0, -rotary * squared, 0, -1], [-squared, 0, 0, 0]], dtype=complex
            )

        modes = natural_modes(_beam(shear, rotary), count=3)
        for k in range(3):
            exact = np.sqrt(_root(_determinant(system), complex(modes.squared[k])).real)
            off = abs(2 * np.pi * modes.frequency[k] / exact - 1)
            yield f"cantilever of {name}, mode {k + 1}", off, modes.frequency_error[k] / modes.frequency[k] + SLENDER


def _columns() -> Iterator[tuple[str, float, float]]:
    """Beck's column, w'''' + P w'' - omega^2 w = 0: before and beyond its flutter load of 20.05."""
    for push in (5.0, 15.0, 25.0, 40.0):

        def system(squared: complex, push: float = push) -> Array:
            # V is the force across the undeformed axis: V' = -omega^2 w, M' = -V - P turn; at the end it is -P turn
            inner = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, -push, 0, -1], [-squared, 0, 0, 0]], dtype=complex)
            across = np.eye(4, dtype=complex)
            across[3, 1] = push
            return np.asarray(scipy.linalg.logm(across @ scipy.linalg.expm(inner)))

        modes = natural_modes(_beam(STIFF, 0.0, push), count=2)
        exact = _root(_determinant(system), complex(modes.squared[0]))
        off = abs(modes.squared[0] / exact - 1)
        bar = 4 * np.pi * modes.frequency_error[0] / np.sqrt(abs(exact))
        yield f"Beck's column, P = {push:g}", off, bar + SLENDER


def ziegler(push: float, damping: tuple[float, float]) -> Mechanism:
    """Return two rigid links of 1 m, springs of 1 N m/rad, 2 and 1 kg at their ends, dampers [N m s], a push [N] along one."""
    end = np.array([1.0, 0.0, 0.0])
    links = tuple(Link(f"l{k}", (Body("ball", Inertia(3.0 - k, end)),)) for k in (1, 2))
    joints = (
        Joint("a", "revolute", WORLD, "l1", stiffness=1.0, actuated=False, damping=damping[0]),
        Joint("b", "revolute", "l1", "l2", Placement(end), stiffness=1.0, actuated=False, damping=damping[1]),
    )
    force = Force("push", Attachment("l2", Placement(end)), np.array([[-push, 0, 0, 0, 0, 0.0]]), follower=True)
    return Mechanism("ziegler", links, joints, np.zeros(3), forces=(force,))


def _pendulums() -> Iterator[tuple[str, float, float]]:
    for push, damping in ((2.0, (0.0, 0.0)), (2.5, (0.0, 0.0)), (1.4, (0.01, 0.01)), (1.6, (0.01, 0.01))):
        mass = np.array([[3.0, 1.0], [1.0, 1.0]])
        # joint coordinates a, b: angles a and a + b
        to_angles = np.array([[1.0, 0.0], [1.0, 1.0]])
        stiffness = np.array([[2.0 - push, push - 1.0], [-1.0, 1.0]])
        m, k = (to_angles.T @ part @ to_angles for part in (mass, stiffness))
        first = np.block(
            [[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(m, k), -np.linalg.solve(m, np.diag(damping))]]
        )
        exact = np.linalg.eigvals(first)
        modes = steady_modes(ziegler(push, damping), free=["a", "b"])
        off = max(float(np.abs(exact - root).min() / abs(root)) for root in modes.root)
        # Undamped below 2.09 roots are simple; the distance of pairs makes them some ten times as sensitive.
        yield f"Ziegler's pendulum, P = {push:g}, c = {damping[0]:g}", off, 1e3 * ROUNDING
        stable = bool((exact.real <= 1e-12).all())
        yield (
            f"  its stability ({'stable' if stable else 'flutter'})",
            float(stable != (modes.root.real <= 0.0).all()),
            0.5,
        )


def _shafts() -> Iterator[tuple[str, float, float]]:
    """Jeffcott's rotor in turning axes, dampers turning along:  (s + i W)^2 + 2 d s + omega^2 = 0, unstable beyond omega."""
    ball = Link("ball", (Body("ball", Inertia(0.8)),))
    own = {"stiffness": 20.0, "damping": 0.16}
    joints = (
        Joint("table", "revolute", WORLD, "table"),
        Joint("x", "prismatic", "table", "slide", axis=np.array([1.0, 0.0, 0.0]), **own),
        Joint("y", "prismatic", "slide", "ball", axis=np.array([0.0, 1.0, 0.0]), **own),
    )
    body = Body("table", Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)))
    rotor = Mechanism("rotor", (Link("table", (body,)), Link("slide"), ball), joints, gravity=np.zeros(3))
    for rate in (0.0, 2.0, 4.9, 5.5, 12.0):
        modes = steady_modes(rotor, rates={"table": rate}, free=["x", "y"])
        exact = np.roots([1.0, 2j * rate + 0.2, 25.0 - rate**2])
        both = np.concatenate([exact, exact.conj()])
        off = max(float(np.abs(both - root).min() / abs(root)) for root in modes.root)
        yield f"Jeffcott's rotor at {rate:g} rad/s", off, 1e3 * ROUNDING
        unstable = bool((modes.root.real > 0.0).any())
        yield f"  its stability ({'unstable' if rate > 5.0 else 'stable'})", float(unstable != (rate > 5.0)), 0.5
