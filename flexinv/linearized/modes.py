"""Small motions about a rest position: their frequencies, shapes and error bars.

Small motions y of the unknowns about a rest position, B_n the variation of node n by them (`kinematics.tree`):

    M y'' + K y = 0        M = sum_n B_n^T diag(m_n, J_n) B_n  (+ rotors of free joints)        K = dr/dy of the residual r

Dampers and damped beams add D y'; each mode's ratio is what light damping makes of it.
Kelvin-Voigt damping with one retardation time eta for all strains, D = eta C (`elements.beam`), damps a mode of frequency omega
with the ratio zeta = eta omega / 2: it grows with frequency, so that one target ratio at one mode fixes it for all others.
A rigid motion dissipates nothing; in steps of h on a circle of rate w the scheme's velocities are off by a part (w h)^2, which
leaves strain rates of second order (and power of fourth).
Prescribed joints are clamped.  Closures leave the motions y = N z with G N = 0.  At a rest position K is symmetric but for forces
that turn along and moments; where an outside effort holds a free joint in place, it is taken as constant.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike

from flexinv.constraints.continuation import find_closed_near
from flexinv.constraints.loop_starts import find_closed_at
from flexinv.constraints.open_loops import GIVE_Q, replace_advice
from flexinv.display.card import Card, Shown
from flexinv.dynamics.solver import Solver
from flexinv.errors import InputError, ModelWarning
from flexinv.kinematics.mesh import Mesh, build
from flexinv.linearized.closed_motions import find_allowed_motions
from flexinv.linearized.complex_roots import find_circulatory_modes
from flexinv.linearized.eigenvalues import ONE_AND_ALL, find_undamped_modes, is_symmetric
from flexinv.linearized.rest_position import SLOWEST, compute_nodal_shapes, compute_rest_matrices, find_rest_position
from flexinv.linearized.slowest_modes import find_slowest_circulatory, find_slowest_modes
from flexinv.model.by_value import ByValue
from flexinv.model.mechanism import Mechanism
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Complex, RealOrComplex, Sparse
from flexinv.validation import (
    check_kind,
    check_mapping,
    check_names,
    check_number,
    check_whole_number,
    convert_to_floats,
)

# Freedoms of a mesh up to which all modes are found where no count is written; of a larger one the `SLOWEST` are.
ALL_MODES = 1000
# The distance to a finer mesh is as large as the error where that converges by half; 1.7 of it were missed at most.
SAFETY = 2.0
# Roundings of K beside the absolute sum of the terms of omega^2.
ROUNDED = 1e-16
# Of modes that are fewer than one in so many, the slowest are found by themselves.
FEW = 3


@dataclass(frozen=True, eq=False)
class Shapes(ByValue):
    """Shapes in which the nodes of a mesh move about a configuration q (nq,) [rad], [m].

    free : names of the free joints; displacement : (modes, nodes, 3) [m] world; rotation : (modes, nodes, 3) [rad] own frame
    position : (nodes, 3) [m] world, orientation : (nodes, 3, 3), where the nodes stand there
    """

    mesh: Mesh
    q: Array
    free: tuple[str, ...]
    displacement: RealOrComplex
    rotation: RealOrComplex
    position: Array
    orientation: Array

    @property
    def link(self) -> tuple[str, ...]:
        """(modes,) which link moves most in each mode [-]."""
        most = np.linalg.norm(self.displacement, axis=2).argmax(axis=1)
        return tuple(self.mesh.mechanism.links[int(self.mesh.link[node])].name for node in most)


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Shown, Shapes):
    """Small motions about a rest position, in the order of their frequencies.

    squared : (modes,) omega^2 [1/s^2]; zero for a rigid motion, negative where the rest position is unstable (divergence);
        complex, and shapes with it, where forces that turn along or moments make the mechanism flutter, in pairs
    displacement, rotation : of modal mass 1 kg m^2, the sum of m |displacement|^2 + rotation . J rotation (and of the rotors of
        free joints)
    friction : (modes,) y . D y [1/s], of dampers and damped beams in each mode (no dry friction)
    rounding : (modes,) what rounding of K leaves of omega^2 [1/s^2]
    """

    squared: RealOrComplex
    friction: Array
    rounding: Array

    def _make_card(self) -> Card:
        from flexinv.linearized.modes_card import make_modes_card

        return make_modes_card(self)

    @property
    def root(self) -> Complex:
        """(modes,) roots [1/s] of a motion exp(root t), of each pair the one that swings or grows."""
        root = 1j * np.sqrt(self.squared.astype(complex))
        return np.asarray(np.where(np.isreal(self.squared) & (self.squared.real < 0.0), np.abs(root), root))

    @property
    def stability(self) -> tuple[str, ...]:
        """(modes,) "stable", "rigid motion", "divergence", "flutter" (swings and grows) or its twin [-]."""
        words = []
        for squared, root in zip(self.squared.tolist(), self.root.tolist(), strict=True):
            swings = "flutter" if root.real > 0.0 else "twin of flutter"
            still = "rigid motion" if squared == 0.0 else "divergence" if complex(squared).real < 0.0 else "stable"
            words.append(swings if complex(squared).imag else still)
        return tuple(words)

    @property
    def frequency(self) -> Array:
        """(modes,) natural frequencies [Hz], real; of flutter that with which it swings, nan of divergence (`stability`)."""
        return np.where(np.array(self.stability) == "divergence", np.nan, self.root.imag) / (2 * np.pi)

    @property
    def frequency_error(self) -> Array:
        """(modes,) error bars of the frequencies [Hz], of mesh and rounding; nan of divergence.

        Twice the distance to the frequency of the same number of a finer mesh, two elements of the next order for one: it is
        solved when this is asked for first.  inf where the finer mesh has divergence there.
        """
        bars = compute_frequency_rounding(self)
        if self.mesh.mechanism.is_rigid:
            return bars
        bars = bars + SAFETY * np.abs(self.frequency - compute_refined_modes(self).frequency)
        return np.where(np.isnan(bars) & ~np.isnan(self.frequency), np.inf, bars)

    @property
    def ratio(self) -> Array:
        """(modes,) of critical damping [-]: y . D y / (2 omega); nan without oscillation.

        Exact where D is a multiple of K; else what light damping does, as it then couples modes.
        """
        stable = np.array(self.stability) == "stable"
        omega = np.sqrt(np.where(stable, self.squared.real, np.nan))
        return np.asarray(self.friction / (2 * omega))


@make_owner_cache()
def compute_refined_modes(modes: Modes) -> Modes:
    """Return the same modes of a finer mesh [Hz]: two elements of the next order in place of each."""
    finer = modes.mesh.mechanism.refined(2, 1)
    count = len(modes.squared)
    return compute_modes(*resolve_setup(finer, modes.q, modes.free, count), count)


def compute_frequency_rounding(modes: Modes) -> Array:
    """(modes,) error bars of the frequencies [Hz] of rounding alone: of omega^2 near zero its root."""
    squared = np.abs(modes.squared)
    lost = modes.rounding
    known = squared > lost
    size = np.sqrt(np.where(known, squared, 1.0)) + np.sqrt(np.where(known, squared - lost, 1.0))
    return np.asarray(np.where(known, lost / size, np.sqrt(squared + lost)) / (2 * np.pi))


def compute_modes(mesh: Mesh, q: Array, free: tuple[str, ...], count: int | None) -> Modes:
    """Return the modes [Hz] of a mesh at rest near q (nq,) [rad], [m], as `natural_modes`, for what `resolve_setup` returns.

    Raises ConvergenceError where no rest position is found, or where a mode under loads that turn along is lost.
    """
    solver = Solver.build_for(mesh, set(free))
    mass, damping, stiffness = compute_rest_matrices(solver, find_rest_position(solver, q)[0])
    squared, shapes, bars = find_free_modes(stiffness, mass, find_allowed_motions(solver), count)
    last = len(squared) if count is None else count
    moves = compute_nodal_shapes(solver, shapes[:, :last])
    shown = shapes[:, :last]
    lost = np.einsum("um,um->m", shown.conj(), damping @ shown).real  # (mode,)
    size = np.abs(shown)
    rounding = np.maximum(ROUNDED * np.einsum("um,um->m", size, abs(stiffness) @ size), bars[:last])
    place = solver.frames.x.copy()
    turn = solver.frames.r.copy()
    return Modes(mesh, q, free, moves[..., :3], moves[..., 3:], place, turn, squared[:last], lost, rounding)


def find_free_modes(
    stiffness: Sparse, mass: Sparse, allowed: Sparse, count: int | None
) -> tuple[RealOrComplex, RealOrComplex, Array]:
    """Return omega^2 [1/s^2] and shapes (unknowns, modes) of the motions that closures allow: all, or of many the slowest ones.

    Also bars of omega^2 where K is not symmetric, which depend on left vectors, too; zero where it is.
    """
    k, m = (scipy.sparse.csc_array(allowed.T @ part @ allowed) for part in (stiffness, mass))
    size = k.shape[0]
    if count is None and size > ALL_MODES:
        count = SLOWEST
        warnings.warn(
            f"natural_modes: of {size} modes the {count} slowest are found; write count = a number, or fewer elements",
            ModelWarning,
            stacklevel=4,
        )
    few = count is not None and size > ONE_AND_ALL and FEW * count <= size
    if not is_symmetric(k):
        found = find_slowest_circulatory(k, m, count) if few and count is not None else find_circulatory_modes(k, m)
        squared, shapes, bars = found
        return squared, allowed @ shapes, bars
    squared, shapes = find_slowest_modes(k, m, count) if few and count is not None else find_undamped_modes(k, m)
    return squared, allowed @ shapes, np.zeros(len(squared))


def resolve_setup(
    mechanism: Mechanism, q: ArrayLike | None, free: Collection[str] | None, count: int | None
) -> tuple[Mesh, Array, tuple[str, ...]]:
    """Return the mesh, the configuration (nq,) [rad], [m], loops closed, and the names of the free joints that are asked for.
    Raises InputError for arguments of another kind, for unknown joints, a wrong q and where nothing can move.
    """
    check_kind("mechanism", mechanism, Mechanism)
    if free is not None:
        free = check_names("free", free, "joints")
    if count is not None:
        check_whole_number("count", count, 1, "1 or more, or None for all")
    at = mechanism.neutral if q is None else np.array(convert_to_floats("modes: q", q))
    moving = _resolve_free_joints(mechanism, free)
    mesh = build(mechanism)
    if at.shape != (mechanism.nq,) or not np.isfinite(at).all():
        raise InputError(f"modes: q has shape {at.shape}, expected ({mechanism.nq},) finite numbers [rad], [m]")
    if mechanism.closures:
        with replace_advice(GIVE_Q):
            at = find_closed_near(mesh, at) if q is None else find_closed_at(mesh, at, drives_move=True)
    if not moving and mechanism.is_rigid:
        raise InputError(
            f"modes: nothing of '{mechanism.name}' can move: no link is a beam and no joint is free; "
            f"write free=[...] with names of {', '.join(mechanism.moving_names) or 'joints'}"
        )
    return mesh, at, moving


def _resolve_free_joints(mechanism: Mechanism, free: Collection[str] | None) -> tuple[str, ...]:
    """The free joints among those that move, as they are asked for, else those of loops that have no drive."""
    moves = mechanism.moving_names
    for name in free or ():
        if name not in moves:
            raise InputError(f"modes: free joint {name!r}: '{mechanism.name}' moves by {', '.join(moves)}")
    if free is None:
        return mechanism.undriven_names if mechanism.closures else ()
    return tuple(name for name in moves if name in free)


def convert_rates(rates: Mapping[str, float] | None) -> dict[str, float]:
    """Return rates [rad/s] by joint as floats, none for None."""
    given = check_mapping("rates", rates, "a table of joints and their rates", 'rates={"joint": 10.0}')
    return {
        name: check_number(f"rate of joint {name!r}", rate, "a finite number [rad/s]") for name, rate in given.items()
    }
