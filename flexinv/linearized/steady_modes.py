"""Natural frequencies about a steady motion: complex modes of M y'' + C y' + K y = 0, gyroscopic terms and damping included."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike, NDArray

from flexinv.kinematics.mesh import Mesh
from flexinv.linearized.natural_modes import allowed_motions, check_modes, check_rates, chosen, nodal_shapes
from flexinv.linearized.steady_state import steady_motion
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

Complex = NDArray[np.complex128]
# Roots are found as 1 / (root - shift): the shift over the size of the fastest ones.  Its square is what rounding leaves of a
# freedom without stiffness, as in `natural_modes`.
SHIFT = 1e-6
# 1 / |root - shift| over the largest one, below which a freedom has no inertia (1 / infinity) but rounding.
MASSLESS = 1e-12
# A root smaller than this part of the shift is zero: rounding of K, 1e-16 of it, moves a free motion's double root by 0.01.
ZERO = 0.1
# Real part and imaginary part of a root below this part of its size are rounding of nothing: roots of multiplicity two (free
# motions) are known to the root of 1e-16 only.
NOTHING = 1e-8


@dataclass(frozen=True)
class SteadyModes:
    """Small motions Re(shape exp(root t)) about a steady motion, seen in the axes that turn along, slowest first.

    root : (modes,) [1/s], of a pair the one with positive imaginary part
    displacement : (modes, nodes, 3) [m] world, as the axes stand at q; rotation : (modes, nodes, 3) [rad] own frame; the largest
        displacement (or, without one, rotation) is 1
    position : (nodes, 3) [m] world, orientation : (nodes, 3, 3), the deformed shape; rates : of the joints that turn [rad/s]
    """

    mesh: Mesh
    q: Array
    rates: dict[str, float]
    free: tuple[str, ...]
    root: Complex
    displacement: Complex
    rotation: Complex
    position: Array
    orientation: Array

    @property
    def frequency(self) -> Array:
        """(modes,) damped natural frequencies [Hz], zero of a motion that does not swing."""
        return np.asarray(self.root.imag / (2 * np.pi))

    @property
    def damping_ratio(self) -> Array:
        """(modes,) part of critical damping [-]; negative where the motion is unstable, nan of a motion without stiffness."""
        size = np.abs(self.root)
        return np.asarray(np.divide(0.0 - self.root.real, size, out=np.full(len(size), np.nan), where=size > 0))

    @property
    def link(self) -> tuple[str, ...]:
        """(modes,) which link moves most in each mode [-]."""
        most = np.linalg.norm(self.displacement, axis=2).argmax(axis=1)
        return tuple(self.mesh.mechanism.links[int(self.mesh.link[node])].name for node in most)


def steady_modes(
    mechanism: Mechanism,
    q: ArrayLike | None = None,
    rates: Mapping[str, float] | None = None,
    free: Collection[str] | None = None,
    count: int | None = None,
) -> SteadyModes:
    """Return natural frequencies [Hz], damping and complex shapes about a motion in which joints turn at constant ``rates``.

    M y'' + C y' + K y = 0 in the axes that turn along: gyroscopic terms and all damping in C, stress and centrifugal terms in K.

    q : (nq,) [rad], [m], zero by default; rates : of revolute joints [rad/s], none by default
    free : joints that move about the motion, as in `natural_modes`; count : number of modes, all by default

    Raises InputError where the motion cannot be steady (gravity across the axis, an axis on a beam) and as `natural_modes`,
    ConvergenceError where no deformed shape is found.
    """
    rates = check_rates(rates)
    mesh, at, names = chosen(mechanism, check_modes(mechanism, q, free, count), free)
    motion = steady_motion(mesh, at, rates, set(names))
    n = allowed_motions(motion.solver)
    root, shapes = roots(*(n.T @ part @ n for part in (motion.mass, motion.damping, motion.stiffness)))
    last = len(root) if count is None else count
    moves: Complex = nodal_shapes(motion.solver, n @ shapes[:, :last])
    moves = _unit(moves, mesh.length)
    frames = motion.solver.frames
    return SteadyModes(
        mesh, at, rates, names, root[:last], moves[..., :3], moves[..., 3:], frames.x.copy(), frames.r.copy()
    )  # fmt: skip


def _unit(moves: Complex, length: float) -> Complex:
    """Shapes with a largest displacement of 1, or rotation where the displacements are its rounding."""
    place, turn = (np.abs(part).max(axis=(1, 2), initial=0.0) for part in (moves[..., :3], moves[..., 3:]))
    size = np.where(place > NOTHING * length * turn, place, turn)
    return np.asarray(moves / size[:, None, None])


def roots(mass: Array, damping: Array, stiffness: Array) -> tuple[Complex, Complex]:
    """Return the roots (modes,) [1/s] of (root^2 M + root C + K) x = 0 and shapes (freedoms, modes), slowest first.

    With root = shift + 1/mu and K_s, C_s the matrices about the shift, mu are eigenvalues of [[-K_s^-1 C_s, -K_s^-1 M], [1, 0]]:
    slow roots are the exact ones, and freedoms without inertia (mu = 0) need no care.  Of a pair one root is returned.
    """
    size = len(mass)
    shift = SHIFT * np.sqrt(np.abs(stiffness).max() / max(np.abs(mass).max(), np.finfo(float).tiny)) or 1.0
    factors = scipy.linalg.lu_factor(stiffness + shift * damping + shift**2 * mass)
    below = np.hstack(
        [scipy.linalg.lu_solve(factors, damping + 2 * shift * mass), scipy.linalg.lu_solve(factors, mass)]
    )
    values, vectors = scipy.linalg.eig(np.vstack([-below, np.eye(size, 2 * size)]))
    use = np.abs(values) > MASSLESS * np.abs(values).max(initial=0.0)
    root, shapes = shift + 1 / values[use], vectors[:size, use]
    root = np.where(np.abs(root) < ZERO * shift, 0.0, root)
    root = np.where(np.abs(root.real) < NOTHING * np.abs(root), 1j * root.imag, root)
    root = np.where(np.abs(root.imag) < NOTHING * np.abs(root), root.real, root)
    one = root.imag >= 0
    root, shapes = root[one], shapes[:, one]
    order = np.argsort(np.abs(root), kind="stable")
    return root[order], shapes[:, order]
