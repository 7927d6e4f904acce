"""An own dense reference for spectra: M, C and K by differences of the march's residual, and all roots by QZ.

Nothing of `flexinv.linearized` that makes or solves matrices has a part in it.  The residual r of the equation of motion is
evaluated at states that are moved by z, z' and z'' as an observer in the axes that turn along sees it,

    x = c + R (x_0 - c + z)        v = W x (x - c) + z'        a = W x (W x (x - c)) + 2 W x z' + z''
    R = R_0 exp(t)                 w = exp(-t) w_0 + t'        w' = t'' - t' x w_0

so that K = dr/dz, C = dr/dz' and M = dr/dz'', gyroscopic and centrifugal terms included.  Closures leave N, the null space of
their gradient (by differences, too).  Freedoms without inertia are split off by the eigenvalues of M, those
without terms in C among them by its singular values, and

    (s^2 M + s C + K) x = 0

is solved as a pencil of first order, balanced in time, by QZ with left and right vectors.  Each root is corrected by
- y^H P(s) x / y^H P'(s) x, P = s^2 M + s C + K, until that is rounding.
The condition number of a root is  |y|^T (|s|^2 |M| + |s| |C| + |K|) |x| / |s y^H P'(s) x|:  what a change of each entry by one
part does to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from flexinv.dynamics.generalized_alpha import DYNAMIC, STATICS
from flexinv.dynamics.solver import Solver
from flexinv.kinematics.tree import Joints
from flexinv.linearized.steady_modes import SteadyRotation
from flexinv.typing import Array, Complex, Mask

# Central differences of sixth order: of geometric functions a step of 2e-3 leaves 1e-17 of truncation where elements are a tenth
# of the mechanism, and 1e-13 of rounding.
STEP = 2e-3
WEIGHTS = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
# Of M with a unit diagonal: an eigenvalue below this is that of a motion without inertia (differences leave 1e-13).
NO_INERTIA = 1e-10
# Of the largest entry of C: what differences leave of a motion without inertia that no damper holds.
NO_DAMPER = 1e-11
# Of the gradient of closures: singular values below this part of the largest are of dependent rows.
DEPENDENT = 1e-9
# Of beta of a pencil with unit matrices: a root beyond 1 / this is none.
INFINITE = 1e-13
CORRECTIONS = 3
# Differences of forces, which do not grow with a step, lose as much more.
FORCE = 10.0
# Part of the largest stiffness, force and damping that each entry has of differences, over the part by which entries are changed:
# 1e-13 of it, as 1e-8 is asked for.  What is left of terms that cancel in a free motion is that, and not a part of nothing.
LARGEST = 1e-5


@dataclass(frozen=True)
class Pencil:
    """M, C, K (freedoms, freedoms) in scaled unknowns; basis : (unknowns, freedoms) [m], [rad].

    largest : stiffness, force or moment that the residual has terms of [N m]
    """

    mass: Array
    damping: Array
    stiffness: Array
    basis: Array
    largest: float


@dataclass(frozen=True)
class Spectrum:
    """All finite roots of a pencil [1/s], and how well they are known.

    terms : (roots,) |y|^T (|s|^2 |M| + |s| |C| + |K|) |x|; slope : |y^H P'(s) x|; bend : |y^H M x|, half the second derivative
    fastest : bound of the frequencies of what has inertia [1/s]
    """

    root: Complex
    terms: Array
    slope: Array
    bend: Array
    fastest: float = np.inf

    def near(self, root: Complex, part: float) -> Array:
        """Return the bars [1/s] of the roots that are nearest to others."""
        if not len(self.root):
            return np.zeros(len(root))
        return self.bars(part)[np.abs(root[:, None] - self.root[None]).argmin(axis=1)]

    def bars(self, part: float) -> Array:
        """Return by how much roots (roots,) [1/s] may move where entries change by a ``part`` [-], double roots by its root."""
        change = part * self.terms
        first = change / np.maximum(self.slope, np.finfo(float).tiny)
        second = np.sqrt(change / np.maximum(self.bend, np.finfo(float).tiny))
        return np.minimum(first, second)


class Residual:
    """The residual of a mechanism as a function of small motions about where a solver stands."""

    def __init__(self, solver: Solver, joints: Joints, turning: SteadyRotation | None = None) -> None:
        """Remember the state [m], [rad/s]; ``turning`` : steady rotation of the nodes."""
        self.solver = solver
        self.joints = joints
        state = solver.state
        self.velocity = state.u.copy()
        self.forces = solver.border.ties.multiplier.copy()
        self.closures = int(solver.instant.multipliers.shape[1])
        nothing = np.zeros((solver.mesh.size, 3))
        self.rate = nothing if turning is None else turning.rate
        self.centre = nothing if turning is None else turning.centre

    def at(self, z: Array, z1: Array, z2: Array) -> tuple[Array, Array]:
        """Return the residual (unknowns,) [N], [N m] and the closures' equations (rows,) [m], [-]."""
        t, state, ties = self.solver.topology, self.solver.state, self.solver.border.ties
        kept = state.u.copy(), state.du.copy()
        state.d[:] = z
        state.u[:] = self.velocity + z1
        state.du[:] = z2
        for n in np.flatnonzero(t.independent):
            first = t.offset[t.block[n]]
            place, turn = slice(first, first + 3), slice(first + 3, first + 6)
            w = self.rate[n]
            v = np.cross(w, state.x[n] + z[place] - self.centre[n])
            state.u[place] = v + z1[place]
            state.du[place] = np.cross(w, v) + 2 * np.cross(w, z1[place]) + z2[place]
            own = Rotation.from_rotvec(-z[turn]).apply(state.r[n].T @ w)
            state.u[turn] = own + z1[turn]
            state.du[turn] = z2[turn] - np.cross(z1[turn], own)
        scheme = STATICS._replace(mode=DYNAMIC)
        ties.multiplier[:] = self.forces
        self.solver.evaluate(scheme, self.joints)
        ties.multiplier[self.closures :] += ties.value[self.closures :]
        self.solver.evaluate(scheme, self.joints)
        out = self.solver.work.residual[0].copy()
        gaps = ties.value[: self.closures].copy()
        state.d[:] = 0.0
        state.u[:], state.du[:] = kept
        ties.multiplier[:] = self.forces
        return out, gaps


def pencil_of(residual: Residual) -> Pencil:
    """Return M, C and K of the motions that closures allow, in scaled unknowns [N m]."""
    scale = residual.solver.topology.scale
    size = len(scale)
    nothing = np.zeros(size)
    stiffness = np.zeros((size, size))
    gradient = np.zeros((residual.closures, size))
    for k in range(size):
        unit = np.zeros(size)
        unit[k] = scale[k]
        for count, weight in WEIGHTS.items():
            ahead = residual.at(count * STEP * unit, nothing, nothing)
            behind = residual.at(-count * STEP * unit, nothing, nothing)
            stiffness[:, k] += weight * (ahead[0] - behind[0]) / STEP
            gradient[:, k] += weight * (ahead[1] - behind[1]) / STEP
    heavy = np.abs(_slopes(residual, scale, 1.0, 2)).max(initial=0.0)
    held = np.abs(np.concatenate([residual.at(nothing, nothing, nothing)[0], residual.forces])).max(initial=0.0)
    largest = max(FORCE * held, FORCE * _carried(residual.solver), np.abs(stiffness).max(initial=0.0))
    fast = np.sqrt(largest / heavy) if heavy > 0.0 and largest > 0.0 else 1.0
    damping, mass = _slopes(residual, scale, fast, 1), _slopes(residual, scale, fast**2, 2)
    basis = np.diag(scale) @ _null_space(gradient)
    return Pencil(*(basis.T @ part @ np.diag(1 / scale) @ basis for part in (mass, damping, stiffness)), basis, largest)


def _carried(solver: Solver) -> float:
    """The largest moment of the wrenches on nodes [N m]: what turns holds its own mass, though no unknown may have that force.

    The residual is a sum of these wrenches, projected on the unknowns: along a hinge that all forces pass they cancel.  Each
    term is rounded by 1e-16 of itself, and not of what is left, and a difference over STEP by 1e-13 of it: so much is not known
    of K, however small the forces that constraints leave.  FORCE allows ten such roundings for a term: turn, product and sum.
    Seed 3, 132: a hinge at 25 rad/s carries 564 N.  K of its one freedom is 0, and nine steps about STEP give values 1.4e-11 N m
    apart: 3 times what 1e-13 of the forces that are left, 49 N m, would allow, and a sixtieth of what 8870 N m allow.
    """
    wrench = np.abs(solver.work.wrench)
    return float(max(solver.mesh.length * wrench[:, :3].max(initial=0.0), wrench[:, 3:].max(initial=0.0)))


def _slopes(residual: Residual, scale: Array, step: float, order: int) -> Array:
    """Central differences by rates (order 1) or accelerations (2): r is of second degree in them, so that they are exact."""
    size = len(scale)
    out = np.zeros((size, size))
    for k in range(size):
        moved = [np.zeros(size) for _ in range(3)]
        moved[order][k] = step * scale[k]
        ahead, _ = residual.at(*moved)
        behind, _ = residual.at(*(-part for part in moved))
        out[:, k] = (ahead - behind) / (2 * step)
    return out


def _null_space(gradient: Array) -> Array:
    """Columns (unknowns, freedoms) with G N = 0, by singular values."""
    if not len(gradient) or not gradient.any():
        return np.eye(gradient.shape[1])
    rows = np.abs(gradient).max(axis=1)
    unit = gradient[rows > 0.0] / rows[rows > 0.0, None]
    _, values, right = scipy.linalg.svd(unit)
    rank = int((values > DEPENDENT * values[0]).sum())
    return np.asarray(right[rank:].T)


def spectrum_of(pencil: Pencil) -> Spectrum:
    """Return all finite roots [1/s] of  s^2 M + s C + K."""
    mass, damping, stiffness, unit = _split(pencil)
    size, massive = len(mass), int((np.diag(mass) > 0.0).sum())
    if not size:
        return Spectrum(np.zeros(0, dtype=complex), *(np.zeros(0) for _ in range(3)))
    fast = np.sqrt(np.abs(stiffness).max() / max(np.abs(mass).max(), np.finfo(float).tiny)) or 1.0
    a, b = np.zeros((2, size + massive, size + massive))
    a[:massive, size:] = np.eye(massive)
    b[:massive, :massive] = np.eye(massive)
    a[massive:, :size] = -stiffness / fast**2
    b[massive:, :size] = damping / fast
    b[massive:, size:] = mass[:, :massive]
    (alpha, beta), left, right = scipy.linalg.eig(a, b, left=True, right=True, homogeneous_eigvals=True)
    finite = np.abs(beta) > INFINITE * np.abs(alpha)
    root = fast * alpha[finite] / beta[finite]
    x, y = right[:size, finite], left[massive:, finite]
    result = _corrected((mass, damping, stiffness), LARGEST * pencil.largest * unit, root, x, y)
    held = float(np.sqrt(np.abs(stiffness[:massive, :massive]).max(initial=0.0)))
    return replace(result, fastest=held or np.inf)


def _split(pencil: Pencil) -> tuple[Array, Array, Array, float]:
    """M, C, K with the motions that have inertia first, M the unit matrix there and zero elsewhere; what a unit of K is there."""
    mass = (pencil.mass + pencil.mass.T) / 2
    diagonal = np.diag(mass)
    size = np.sqrt(np.where(diagonal > NO_INERTIA**2 * diagonal.max(initial=0.0), diagonal, np.inf))
    none = np.isinf(size)
    size[none] = 1.0
    unit = mass / size[:, None] / size
    unit[none] = 0.0
    unit[:, none] = 0.0
    values, vectors = scipy.linalg.eigh(unit)
    values, vectors = values[::-1], vectors[:, ::-1]
    heavy = values > NO_INERTIA
    turn = vectors / size[:, None]
    turn[:, heavy] /= np.sqrt(values[heavy])
    # massless motions in units in which their stiffness is of the size of the others'
    stiff = np.sqrt(np.maximum(np.abs(np.einsum("km,kl,lm->m", turn, pencil.stiffness, turn)), np.finfo(float).tiny))
    turn[:, ~heavy] *= (stiff[heavy].max(initial=0.0) or 1.0) / stiff[~heavy]
    damping, stiffness = (turn.T @ part @ turn for part in (pencil.damping, pencil.stiffness))
    largest = float(np.abs(turn).max(initial=0.0)) ** 2
    return np.diag(heavy.astype(float)), _without_noise(damping, ~heavy), stiffness, largest


def _without_noise(damping: Array, light: Mask) -> Array:
    """C without what differences leave among motions without inertia that have no terms in it."""
    if not light.any():
        return damping
    out = damping.copy()
    left, values, right = scipy.linalg.svd(damping[np.ix_(light, light)])
    values[values <= NO_DAMPER * np.abs(damping).max(initial=0.0)] = 0.0
    out[np.ix_(light, light)] = left @ np.diag(values) @ right
    return out


def _corrected(parts: tuple[Array, Array, Array], floor: float, root: Complex, x: Complex, y: Complex) -> Spectrum:
    """The spectrum with each root corrected by its vectors, where that moves it by less than to a tenth of the next one."""
    mass, damping, stiffness = parts
    noise = LARGEST * np.abs(damping).max(initial=0.0)
    apart = np.abs(root[:, None] - root[None])
    apart[np.diag_indices(len(root))] = np.inf
    next_one = apart.min(axis=1, initial=np.inf)
    out = root.copy()
    terms, slope, bend = np.zeros((3, len(root)))
    for k in range(len(root)):
        s, right, left = root[k], x[:, k], y[:, k]
        for _ in range(CORRECTIONS):
            matrix = s * s * mass + s * damping + stiffness
            derivative = 2 * s * mass + damping
            steep = left.conj() @ derivative @ right
            change = left.conj() @ matrix @ right / steep if steep else np.inf
            if not abs(s - change - root[k]) < 0.1 * next_one[k]:
                break
            s = s - change
        out[k] = s
        sizes = abs(s) ** 2 * np.abs(mass) + abs(s) * (np.abs(damping) + noise) + np.abs(stiffness) + floor
        terms[k] = np.abs(left) @ sizes @ np.abs(right)
        slope[k] = abs(left.conj() @ (2 * s * mass + damping) @ right)
        bend[k] = abs(left.conj() @ mass @ right)
    return Spectrum(out, terms, slope, bend)
