"""linear_model: a mechanism near a steady motion as a state space, x' = A x + B u, y = C x + D u, for control design.

The unknowns y of the march (`steady_modes`) are split into those p whose acceleration is an input and the rest, which moves by

    y = T (p, eta)        T = [[1, 0], [Psi, Phi]]        Psi = -K_ff^-1 K_fp: static response to p;  Phi: modes with p held

so that M eta'' + C eta' + K eta = Phi^T S tau - (M, C, K of p), with M = 1 for the modes: fewer modes, a smaller model.
Source of the split: Craig, Bampton, *Coupling of substructures for dynamic analyses*, AIAA J. 6(7), 1968.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike

from flexinv.dynamics.solver import Solver, build_coordinate_map
from flexinv.errors import InputError
from flexinv.kinematics.nodal_motion import list_sliding_coordinates
from flexinv.linearized.closed_motions import find_allowed_motions
from flexinv.linearized.complex_roots import find_rate_driven_motions, find_roots
from flexinv.linearized.eigenvalues import SOFT, find_undamped_modes, is_symmetric, split_by_inertia
from flexinv.linearized.modal_damping import resolve_damping_ratio
from flexinv.linearized.modes import SAFETY, convert_rates, resolve_setup
from flexinv.linearized.rest_position import compute_nodal_shapes, compute_tip_displacements
from flexinv.linearized.state_space import Basis, LeftOut, StateSpace, build_state_space
from flexinv.linearized.steady_modes import SteadyLinearisation, build_steady_motion
from flexinv.model.by_value import ByValue
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Complex, Indices, Sparse
from flexinv.validation import check_kind, check_names, check_whole_number

# Of the largest entry of C, what rounding leaves of its symmetry where nothing is gyroscopic.
GYROSCOPIC = 1e-9
# Of shapes of unit modal mass, what is left of one that others represent: rounding of complex modes of one frequency.
SAME_SPAN = 1e-7
# Left and right shapes whose masses are worse conditioned than this are no pair (a double root with one shape): rows are of the
# right ones then.
WORST_PAIR = 1e8
AXIS_NAMES = ("x", "y", "z")
CIRCULATORY_NOTE = (
    "shapes are the real and imaginary parts of the {} slowest complex modes under loads that turn along or moments, and rows "
    "those of their left vectors: the poles of these, and what efforts do in them, are those of the mechanism, others are not "
    "(steady_modes has all)"
)
GYROSCOPIC_NOTE = (
    "shapes are the real and imaginary parts of the {} slowest complex modes, gyroscopic terms and damping included: the poles "
    "of these are those of the mechanism, others are not (steady_modes has all)"
)


@dataclass(frozen=True, eq=False)
class Origin(ByValue):
    """The arguments of `linear_model` that made a model; q : (nq,) [rad], [m]; rates : [rad/s]."""

    mechanism: Mechanism
    q: Array
    rates: dict[str, float]
    free: tuple[str, ...]
    accelerated: tuple[str, ...]
    modes: int | None


@dataclass(frozen=True, eq=False)
class LinearModel(ByValue):
    """x' = A x + B u, y = C x + D u: deviations from a steady motion, small ones.

    states, inputs, outputs : names; state_units, input_units, output_units : their units
    bias : (inputs,) what the inputs are in the steady motion itself [N m], [N], [rad/s^2]
    notes : what a reader must know, as which poles are exact where few modes of a gyroscopic mechanism are kept
    origin : what it was made of
    left_out : what A leaves out of motions without inertia that follow the others; None where nothing
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
    origin: Origin | None = None
    left_out: LeftOut | None = None

    @property
    def poles(self) -> Complex:
        """(states,) eigenvalues of A [1/s], by size, of a pair the one with positive imaginary part first."""
        return compute_poles(self.A)[0]

    @property
    def pole_error(self) -> Array:
        """(states,) error bars of the poles [1/s], of mesh, of rounding of A as a whole and of what A leaves out (`LeftOut`).

        Twice the distance to the pole of the same number of a finer mesh, two elements of the next order for one: it is solved
        when this is asked for first.  `steady_modes` knows slow roots better: A has lost what is below 1e-16 of its largest.
        """
        poles, rounding = compute_poles(self.A, self.left_out)
        if self.origin is None or self.origin.mechanism.is_rigid:
            return rounding
        finer = build_refined_model(self).poles[: len(poles)]
        return rounding + SAFETY * np.abs(poles - finer)

    @property
    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D [any unit], as ``scipy.signal.StateSpace(*m.matrices)`` and ``control.ss(*m.matrices)`` take them."""
        return self.A, self.B, self.C, self.D


@make_owner_cache()
def build_refined_model(model: LinearModel) -> LinearModel:
    """Return the same model of a finer mesh [1/s]: two elements of the next order in place of each."""
    of = model.origin
    assert of is not None
    return linear_model(of.mechanism.refined(2, 1), of.q, of.rates, of.free, of.accelerated, of.modes)


def compute_poles(a: Array, left_out: LeftOut | None = None) -> tuple[Complex, Array]:
    """Return eigenvalues of A (states,) [1/s] by size, and how well they are known, but for the mesh.

    A rounding of A leaves  eps |A| |y| |x| / |y^H x|  of each, and what A leaves out moves it by  |s|^2 |y^H L x| / |y^H x|.
    """
    if not len(a):
        return np.zeros(0, dtype=complex), np.zeros(0)
    balanced, (scale, _) = scipy.linalg.matrix_balance(a, permute=False, separate=True)
    root, left, right = scipy.linalg.eig(balanced, left=True, right=True)
    angle = np.maximum(np.abs(np.einsum("km,km->m", left.conj(), right)), np.finfo(float).tiny)  # of unit vectors
    unit = np.finfo(float).eps * len(a) * np.linalg.norm(balanced)
    # of a double root, whose vectors are one, the root of it
    bar = np.minimum(unit / angle, np.sqrt(unit * np.linalg.norm(balanced)))
    if left_out is not None:
        along = np.einsum("km,kl,lm->m", left.conj(), left_out.matrix * scale / scale[:, None], right)
        bar = bar + left_out.move(root, np.abs(along) / angle)
    order = np.lexsort((-root.imag, np.round(np.abs(root), 300)))
    return root[order], bar[order]


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
        something turns, or loads turn along, the complex ones with all terms, each by one or two shapes, so that their poles are
        exact (``notes``)
    Raises InputError as `steady_modes`, and for joints that cannot be accelerated.
    """
    if modes is not None:
        modes = check_whole_number("modes", modes, 0, "0 or more, or None for all")
    rates = convert_rates(rates)
    check_kind("mechanism", mechanism, Mechanism)
    if free is not None:
        free = check_names("free", free, "joints")
    accelerated = check_names("accelerated", accelerated, "joints")
    moving = [j.name for j in mechanism.moving_joints if j.name not in set(accelerated)]
    freed = tuple(moving if free is None else free)
    _check_accelerated(mechanism, accelerated)
    mesh, at, chosen_names = resolve_setup(resolve_damping_ratio(mechanism), q, (*freed, *accelerated), None)
    motion = build_steady_motion(mesh, at, rates, set(chosen_names))
    joints = np.array([mechanism.v_slices[name].start for name in accelerated], dtype=np.int64)
    coordinates = build_coordinate_map(mesh, motion.solver.topology)  # (nv, unknowns)
    basis = _build_basis(motion, coordinates[joints], modes)
    driven = _list_driven(mechanism, coordinates, joints)
    state_space = build_state_space(basis, motion.matrices, coordinates[driven].T)
    c, d, outputs, output_units = _build_outputs(motion.solver, coordinates, basis, state_space)
    states, state_units = _list_states(mechanism, accelerated, basis)
    inputs, input_units = _list_inputs(mechanism, driven, accelerated)
    held = coordinates[driven] @ motion.residual
    return LinearModel(
        A=state_space.a,
        B=state_space.b,
        C=c,
        D=d,
        states=states,
        inputs=inputs,
        outputs=outputs,
        state_units=state_units,
        input_units=input_units,
        output_units=output_units,
        bias=np.concatenate([held, np.zeros(len(accelerated))]),
        notes=_list_notes(motion, basis, modes),
        origin=Origin(mechanism, at, rates, freed, tuple(accelerated), modes),
        left_out=state_space.left_out,
    )


def _check_accelerated(mechanism: Mechanism, accelerated: Collection[str]) -> None:
    """Raise InputError for joints that cannot be accelerated."""
    for name in accelerated:
        if name not in mechanism.joint_of or mechanism.joint_of[name].nv != 1:
            known = ", ".join(j.name for j in mechanism.joints if j.nv == 1)
            raise InputError(f"linear model: accelerated joint {name!r}: expected one of {known}")
    if accelerated and mechanism.closures:
        raise InputError(
            f"linear model: mechanism '{mechanism.name}' has closures, where the acceleration of one joint moves others; "
            "leave accelerated empty: efforts of the drives are the inputs"
        )


def _list_driven(mechanism: Mechanism, coordinates: Array, accelerated: Indices) -> list[int]:
    """Velocity coordinates with a drive that unknowns move, but for those whose acceleration is given."""
    moved = np.flatnonzero(mechanism.actuated & coordinates.any(axis=1)).tolist()
    return [v for v in moved if v not in accelerated]


def _list_coordinate_units(mechanism: Mechanism, accelerated: Collection[str]) -> list[str]:
    """Units of the coordinates of joints whose acceleration is given."""
    return [KINDS[mechanism.joint_of[name].kind].units[0] for name in accelerated]


def _list_states(
    mechanism: Mechanism, accelerated: Collection[str], basis: Basis
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the states (p, eta, d, p', eta') of `build_state_space`."""
    moving = [*accelerated, *(f"mode {k + 1}" for k in range(basis.massive))]
    following = [f"massless {k + 1}" for k in range(basis.moved)]
    rates = [f"{name} rate" for name in moving]
    units = [*_list_coordinate_units(mechanism, accelerated), *(basis.massive * ["kg^0.5 m"])]
    return (*moving, *following, *rates), (*units, *(basis.moved * ["-"]), *(f"{unit}/s" for unit in units))


def _list_inputs(
    mechanism: Mechanism, driven: Sequence[int], accelerated: Collection[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the inputs: efforts of the driven velocity coordinates, then given accelerations."""
    translation = list_sliding_coordinates(mechanism)
    efforts = [f"{mechanism.velocity_names[v]} effort" for v in driven]
    accelerations = [f"{name} acceleration" for name in accelerated]
    effort_units = ["N" if translation[v] else "N m" for v in driven]
    acceleration_units = [f"{unit}/s^2" for unit in _list_coordinate_units(mechanism, accelerated)]
    return (*efforts, *accelerations), (*effort_units, *acceleration_units)


def _list_notes(motion: SteadyLinearisation, basis: Basis, modes: int | None) -> tuple[str, ...]:
    """Name what few modes leave out."""
    if modes is None:
        return ()
    if basis.left is not basis.right:
        return (CIRCULATORY_NOTE.format(modes),)
    n = find_allowed_motions(motion.solver)
    damping = (n.T @ motion.matrices.damping @ n).toarray()
    return (GYROSCOPIC_NOTE.format(modes),) if _is_gyroscopic(damping) else ()


def _is_gyroscopic(damping: Array) -> bool:
    return bool(np.abs(damping - damping.T).max(initial=0.0) > GYROSCOPIC * np.abs(damping).max(initial=0.0))


def _build_basis(motion: SteadyLinearisation, accelerated: Array, modes: int | None) -> Basis:
    """T and W of `build_state_space`: given joints with what follows them at rest, and shapes with these held."""
    m = motion.matrices.mass
    k = motion.matrices.stiffness
    inertial = accelerated.any(axis=0)
    if not inertial.any():
        return _build_shapes(find_allowed_motions(motion.solver), motion, modes)
    rest = scipy.sparse.csc_array(np.diag(motion.solver.topology.scale)[:, ~inertial])
    held = (rest.T @ k @ rest).toarray()
    inertia = (rest.T @ m @ rest).toarray()
    # where other joints are free K_ff is singular: any Psi is exact, this one is near the slow one
    soft = SOFT * np.abs(held).max() / max(np.abs(inertia).max(), np.finfo(float).tiny)
    across = rest.T @ (k + soft * m) @ accelerated.T
    follow = accelerated.T - rest @ scipy.linalg.solve(held + soft * inertia, across)
    inner = _build_shapes(rest, motion, modes)
    right = np.hstack([follow, inner.right])
    left = right if inner.left is inner.right else np.hstack([follow, inner.left])
    return replace(inner, right=right, left=left, prescribed=len(accelerated))


def _build_shapes(allowed: Sparse, motion: SteadyLinearisation, modes: int | None) -> Basis:
    """Shapes of unit modal mass, slowest first, of the symmetric part of K, and all motions without inertia; or few of them.

    Few shapes of a mechanism with gyroscopic terms or circulatory K span its slowest complex modes: (root^2 M + root C + K) x = 0
    holds for what T can represent, x = T z, whatever the rows are.  Rows of circulatory ones are of their left vectors, so that
    what efforts do in these modes is theirs, too.
    """
    mass, damping, stiffness = ((allowed.T @ part @ allowed).toarray() for part in motion.matrices)
    symmetric = is_symmetric(scipy.sparse.csc_array(stiffness))
    if modes is None or (symmetric and not _is_gyroscopic(damping)):
        return _build_undamped_basis(allowed, (mass, damping, stiffness), modes)
    roots = find_roots(mass, damping, stiffness)
    right = _find_real_basis(roots.shapes[:, :modes], mass)
    if not symmetric:
        real_basis = _find_real_basis(roots.left[:, :modes], mass)
        if real_basis.is_pair_of(right, mass, damping):
            return _join_spans(allowed, right, real_basis)
    if not right.is_pair_of(right, mass, damping):  # what has no inertia has no damper among these shapes
        right = replace(right, massless=right.massless[:, :0])
    return _join_spans(allowed, right, right)


@dataclass(frozen=True)
class Span:
    """Real shapes that span complex ones: (freedoms, some) of unit modal mass, and of unit length those without inertia."""

    massive: Array
    massless: Array

    def is_pair_of(self, right: Span, mass: Array, damping: Array) -> bool:
        """Return True if rows of these tell columns of the ``right`` ones apart: M [kg m^2], C [N m s] are regular there."""
        one = self.massive.T @ mass @ right.massive
        other = self.massless.T @ damping @ right.massless
        return all(
            part.shape[0] == part.shape[1] and _compute_condition_number(part) <= WORST_PAIR for part in (one, other)
        )


def _compute_condition_number(matrix: Array) -> float:
    return float(np.linalg.cond(matrix)) if matrix.size else 1.0


def _join_spans(allowed: Sparse, right: Span, left: Span) -> Basis:
    columns = allowed @ np.hstack([right.massive, right.massless])
    rows = columns if left is right else allowed @ np.hstack([left.massive, left.massless])
    return Basis(columns, rows, 0, right.massive.shape[1], right.massless.shape[1])


def _build_undamped_basis(allowed: Sparse, matrices: tuple[Array, Array, Array], modes: int | None) -> Basis:
    """Shapes of M and the symmetric part of K, and all motions without inertia; or the slowest of these shapes."""
    mass, damping, stiffness = matrices
    k = scipy.sparse.csc_array((stiffness + stiffness.T) / 2)
    m = scipy.sparse.csc_array((mass + mass.T) / 2)
    shapes = allowed @ find_undamped_modes(k, m)[1][:, :modes]
    if modes is not None:
        return Basis(shapes, shapes, 0, shapes.shape[1])
    by_rates, following = find_rate_driven_motions(split_by_inertia(m), damping, k)
    moved = np.asarray((allowed @ by_rates).toarray())
    held = np.asarray((allowed @ following).toarray())
    every = np.hstack([shapes, moved, held])
    return Basis(every, every, 0, shapes.shape[1], moved.shape[1], held.shape[1])


def _find_real_basis(shapes: Complex, mass: Array) -> Span:
    """Real shapes that span complex ones (freedoms, some)."""
    both = np.hstack([shapes.real, shapes.imag])
    length = np.linalg.norm(both, axis=0)
    use = length > SAME_SPAN * np.tile(np.linalg.norm(shapes, axis=0), 2)
    unit = both[:, use] / length[use]
    squared, vectors = scipy.linalg.eigh((mass + mass.T) / 2)
    weighed = np.sqrt(np.clip(squared, 0.0, None))[:, None] * (vectors.T @ unit)
    size = np.linalg.norm(weighed, axis=0)
    heavy = size > SAME_SPAN * size.max(initial=0.0)
    columns = unit / np.where(heavy, size, 1.0)
    _, independent, turn = scipy.linalg.svd(weighed / np.where(heavy, size, 1.0))
    last = int((independent > SAME_SPAN).sum())
    massive = columns @ turn[:last].T / independent[:last]
    # what has no inertia, or is rounding of shapes that the others represent
    rest, lengths, _ = scipy.linalg.svd(columns @ turn[last:].T, full_matrices=False)
    return Span(massive, rest[:, lengths > SAME_SPAN * np.linalg.norm(columns, axis=0).max(initial=0.0)])


def _build_outputs(
    solver: Solver, coordinates: Array, basis: Basis, found: StateSpace
) -> tuple[Array, Array, tuple[str, ...], tuple[str, ...]]:
    """C, D, names and units: joints, their rates, tips."""
    mechanism = solver.mesh.mechanism
    moved: Indices = np.flatnonzero(coordinates.any(axis=1))
    joints = coordinates[moved] @ basis.right
    tips = compute_tip_displacements(solver.mesh, compute_nodal_shapes(solver, basis.right), solver.frames.r)
    places = [part.T for part in tips.values()]
    c = np.vstack([joints @ found.place, joints @ found.rate, *(part @ found.place for part in places)])
    d = np.vstack([joints @ found.direct, joints @ found.direct_rate, *(part @ found.direct for part in places)])
    names_of_joints = [mechanism.velocity_names[v] for v in moved]
    names_of_rates = [f"{name} rate" for name in names_of_joints]
    names_of_tips = [f"{link} tip {axis}" for link in tips for axis in AXIS_NAMES]
    translation = list_sliding_coordinates(mechanism)
    units = ["m" if translation[v] else "rad" for v in moved]
    unit_rates = [f"{unit}/s" for unit in units]
    labels = (*names_of_joints, *names_of_rates, *names_of_tips)
    return c, d, labels, (*units, *unit_rates, *(len(names_of_tips) * ["m"]))
