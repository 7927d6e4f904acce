"""linear_model: a mechanism near a steady motion as a state space, x' = A x + B u, y = C x + D u, for control design.

The unknowns y of the march (`steady_modes`) are split into those p whose acceleration is an input and the rest, which moves by

    y = T (p, eta)        T = [[1, 0], [Psi, Phi]]        Psi = -K_ff^-1 K_fp: static response to p;  Phi: modes with p held

so that M eta'' + C eta' + K eta = Phi^T S tau - (M, C, K of p), with M = 1 for the modes: fewer modes, a smaller model.
Source of the split: Craig, Bampton, *Coupling of substructures for dynamic analyses*, AIAA J. 6(7), 1968.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike, NDArray

from flexinv.dynamics.solver import Solver, by_unknown
from flexinv.errors import InputError
from flexinv.kinematics.nodal_motion import slides
from flexinv.linearized.closed_motions import allowed_motions
from flexinv.linearized.eigenvalues import SOFT, is_symmetric, undamped
from flexinv.linearized.natural_modes import chosen, nodal_shapes, numbers_of_rates, tip_moves
from flexinv.linearized.steady_modes import Steady, roots, steady_motion
from flexinv.model.by_value import ByValue
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array
from flexinv.validation import names, of_kind, whole

# Of the largest entry of C, what rounding leaves of its symmetry where nothing is gyroscopic.
GYROSCOPIC = 1e-9
# Of shapes of unit modal mass, what is left of one that others represent: rounding of complex modes of one frequency.
SAME_SPAN = 1e-7
AXIS_NAMES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class LinearModel(ByValue):
    """x' = A x + B u, y = C x + D u: deviations from a steady motion, small ones.

    states, inputs, outputs : names; state_units, input_units, output_units : their units
    bias : (inputs,) what the inputs are in the steady motion itself [N m], [N], [rad/s^2]
    notes : what a reader must know, as which poles are exact where few modes of a gyroscopic mechanism are kept
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    bias: Array
    notes: tuple[str, ...] = ()

    @property
    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D [any unit], as ``scipy.signal.StateSpace(*m.matrices)`` and ``control.ss(*m.matrices)`` take them."""
        return self.A, self.B, self.C, self.D


def linear_model(
    mechanism: Mechanism,
    q: ArrayLike | None = None,
    rates: Mapping[str, float] | None = None,
    free: Collection[str] | None = None,
    accelerated: Collection[str] = (),
    modes: int | None = None,
) -> LinearModel:
    """Return the mechanism near rest, or near a motion with constant ``rates``, as a state space [m, rad, s, N].

    Inputs are the efforts of the drives among the free joints and the accelerations of the ``accelerated`` ones; outputs are
    coordinates and rates of all of these joints and the displacement of every link's tip, in world axes as they stand at q
    (turning along where joints have rates).

    q : (nq,) [rad], [m], zero by default; rates : of revolute joints [rad/s]
    free : joints that move, by default all that are not accelerated; joints that are neither are held
    accelerated : joints whose acceleration is given, with one velocity coordinate each; not in a loop
    modes : number of the slowest modes (accelerated joints held) that are kept, all by default: those without damping; where
        something turns the complex ones with all terms, each by one or two shapes, so that their poles are exact (``notes``)
    Raises InputError as `steady_modes`, for few modes under loads that turn along, and for joints that cannot be accelerated.
    """
    if modes is not None:
        modes = whole("modes", modes, 0, "0 or more, or None for all")
    rates = numbers_of_rates(rates)
    of_kind("mechanism", mechanism, Mechanism)
    if free is not None:
        names("free", free, "joints")
    names("accelerated", accelerated, "joints")
    moving = [j.name for j in mechanism.joints if j.nv and j.name not in set(accelerated)]
    freed = (*(moving if free is None else free), *accelerated)
    for name in accelerated:
        if name not in mechanism.joint_of or mechanism.joint_of[name].nv != 1:
            known = ", ".join(j.name for j in mechanism.joints if j.nv == 1)
            raise InputError(f"linear model: accelerated joint {name!r}: expected one of {known}")
    if accelerated and mechanism.closures:
        raise InputError(
            f"linear model: mechanism '{mechanism.name}' has closures, where the acceleration of one joint moves others; "
            "leave accelerated empty: efforts of the drives are the inputs"
        )
    mesh, at, chosen_names = chosen(mechanism, q, freed, None)
    motion = steady_motion(mesh, at, rates, set(chosen_names))
    joints = np.array([mechanism.v_slices[name].start for name in accelerated], dtype=np.int64)
    coordinates = by_unknown(mesh, motion.solver.topology)  # (nv, unknowns)
    basis, given = _basis(motion, coordinates[joints], modes)
    mass, damping, stiffness = (basis.T @ part @ basis for part in motion.matrices)
    driven = [v for v in np.flatnonzero(mechanism.actuated & coordinates.any(axis=1)) if v not in joints]
    efforts = basis.T @ coordinates[driven].T
    a, b = _first_order(mass, damping, stiffness, efforts, given)
    c, labels, units = _outputs(motion.solver, coordinates, basis)
    shaped, turns, velocity = basis.shape[1] - given, ~slides(mechanism), mechanism.velocity_names
    own = [*accelerated, *(f"mode {k + 1}" for k in range(shaped))]
    unit = [KINDS[mechanism.joint_of[name].kind].units[0] for name in accelerated] + shaped * ["kg^0.5 m"]
    return LinearModel(
        a, b, c, np.zeros((len(c), b.shape[1])),
        (*own, *(f"{name} rate" for name in own)),
        (*(f"{velocity[v]} effort" for v in driven), *(f"{name} acceleration" for name in accelerated)),
        labels,
        (*unit, *(f"{u}/s" for u in unit)),
        (*("N m" if turns[v] else "N" for v in driven), *(f"{u}/s^2" for u in unit[:given])),
        units,
        np.concatenate([coordinates[driven] @ motion.residual, np.zeros(given)]),
        _notes(mechanism, motion, modes),
    )  # fmt: skip


def _notes(mechanism: Mechanism, motion: Steady, modes: int | None) -> tuple[str, ...]:
    """Name what few modes leave out; raises InputError where they are not modes of the mechanism at all."""
    if modes is None:
        return ()
    n = allowed_motions(motion.solver)
    damping, stiffness = (n.T @ part @ n for part in motion.matrices[1:])
    if not is_symmetric(scipy.sparse.csc_array(stiffness)):
        raise InputError(
            f"linear model: modes = {modes}: loads of '{mechanism.name}' turn along or are moments, so that its modes are not "
            "those of a symmetric stiffness; leave modes out"
        )
    if not _is_gyroscopic(damping):
        return ()
    return (f"shapes are the real and imaginary parts of the {modes} slowest complex modes, gyroscopic terms and damping "
            "included: the poles of these are those of the mechanism, others are not (steady_modes has all)",)  # fmt: skip


def _is_gyroscopic(damping: Array) -> bool:
    return bool(np.abs(damping - damping.T).max(initial=0.0) > GYROSCOPIC * np.abs(damping).max(initial=0.0))


def _basis(motion: Steady, accelerated: Array, modes: int | None) -> tuple[Array, int]:
    """T (unknowns, given + modes), and how many of its columns are given joints."""
    m, c, k = motion.matrices
    own = accelerated.any(axis=0)
    if not own.any():
        allowed = allowed_motions(motion.solver)
        mass, damping, stiffness = (allowed.T @ part @ allowed for part in (m, c, k))
        return allowed @ _shapes(mass, damping, stiffness, modes), 0
    rest = np.diag(motion.solver.topology.scale)[:, ~own]
    held, inertia = (rest.T @ part @ rest for part in (k, m))
    held, inertia = (held + held.T) / 2, (inertia + inertia.T) / 2
    # where other joints are free K_ff is singular: any Psi is exact, this one is near the slow one
    soft = SOFT * np.abs(held).max() / max(np.abs(inertia).max(), np.finfo(float).tiny)
    across = rest.T @ (k + soft * m) @ accelerated.T
    follow = accelerated.T - rest @ scipy.linalg.solve(held + soft * inertia, across)
    return np.hstack([follow, rest @ _shapes(inertia, rest.T @ c @ rest, held, modes)]), len(accelerated)


def _shapes(mass: Array, damping: Array, stiffness: Array, modes: int | None) -> Array:
    """Shapes (freedoms, modes) of unit modal mass, slowest first, of the symmetric part of K; few of them so that poles stay.

    Few shapes of a gyroscopic mechanism span its slowest complex modes: (root^2 M + root C + K) x = 0 holds for what T can
    represent, x = T z, whatever the rest is.
    """
    if modes is None or not _is_gyroscopic(damping):
        k, m = (scipy.sparse.csc_array((part + part.T) / 2) for part in (stiffness, mass))
        return undamped(k, m)[1][:, :modes]
    complex_shapes = roots(mass, damping, stiffness)[1][:, :modes]
    both = np.hstack([complex_shapes.real, complex_shapes.imag])
    squared, vectors = scipy.linalg.eigh((mass + mass.T) / 2)
    weighed = np.sqrt(np.clip(squared, 0.0, None))[:, None] * (vectors.T @ both)
    size = np.linalg.norm(weighed, axis=0)
    use = size > SAME_SPAN * size.max(initial=0.0)
    _, independent, right = scipy.linalg.svd(weighed[:, use] / size[use], full_matrices=False)
    last = int((independent > SAME_SPAN).sum())
    return np.asarray((both[:, use] / size[use]) @ right[:last].T / independent[:last])


def _first_order(mass: Array, damping: Array, stiffness: Array, efforts: Array, given: int) -> tuple[Array, Array]:
    """A and B of (p, eta, p', eta'): the accelerations of the first ``given`` coordinates are inputs, the rest follows."""
    size, rest = len(mass), slice(given, None)
    a, b = np.zeros((2 * size, 2 * size)), np.zeros((2 * size, efforts.shape[1] + given))
    a[:size, size:], b[size : size + given, efforts.shape[1] :] = np.eye(size), np.eye(given)
    own = np.linalg.solve(mass[rest, rest], np.hstack([-stiffness, -damping, efforts, -mass[:, :given]])[rest])
    a[size + given :], b[size + given :] = own[:, : 2 * size], own[:, 2 * size :]
    return a, b


def _outputs(solver: Solver, coordinates: Array, basis: Array) -> tuple[Array, tuple[str, ...], tuple[str, ...]]:
    """C, names and units: joints, their rates, tips."""
    mechanism = solver.mesh.mechanism
    moved: NDArray[np.int64] = np.flatnonzero(coordinates.any(axis=1))
    joints, translation = coordinates[moved] @ basis, slides(mechanism)
    joined = [mechanism.velocity_names[v] for v in moved]
    units = ["m" if translation[v] else "rad" for v in moved]
    tips = tip_moves(solver.mesh, nodal_shapes(solver, basis), solver.frames.r)
    none = np.zeros_like(joints)
    c = np.block([[joints, none], [none, joints], *([part.T, np.zeros_like(part.T)] for part in tips.values())])
    labels = [*joined, *(f"{name} rate" for name in joined), *(f"{link} tip {x}" for link in tips for x in AXIS_NAMES)]
    return c, tuple(labels), (*units, *(f"{u}/s" for u in units), *(3 * len(tips) * ["m"]))
