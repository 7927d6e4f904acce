"""Posterior: draws of the free parameters that follow the curved set which the logs leave, and what the logs alone tell.

Readings are linear in mass properties m, h, I, friction, rotors and offsets, times the gain of their sensor; z is not.  Where the
logs tell a sum or a product of such effects and the priors are wide, the likely z lie on a curved set that a normal law about z^
leaves.  So the cost is kept in the effects y_g(z) of the channels of each gain g, in which it is a square:

    cost(z) = |z|^2 + sum_g |r_g(z)|^2,   r_g = A_g (y_g(z) - y_g(z^)) - b_g,   A_g = R_g T_g^-1,   T_g = dy_g/dz at z^

    y_g = g (m, h, I, values),   R_g^T R_g : information of the channels about z,   sum_g R_g^T b_g = z^

b makes z^ the least cost.  With u standard normal and C the covariance of the fit, z(u) solves

    C^(1/2) (z + sum_g R_g^T r_g(z)) = u,    log w = (|u|^2 - cost) / 2 - log |det C^(1/2) (1 + sum_g R_g^T A_g dy_g/dz)|

and w corrects its density: chains move by ``u' = (1 - s^2)^(1/2) u + s normal`` and accept by w' / w.  Where y is linear, w is
constant and each draw is independent.  Sources: J. Bardsley, A. Solonen, H. Haario, M. Laine, "Randomize-then-optimize", SIAM J.
Scientific Computing 36 (2014); S. Cotter, G. Roberts, A. Stuart, D. White, "MCMC methods for functions", Statistical Science 28
(2013), for the move.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import NDArray

from crosscheck.identification.estimation.fit import Fit
from crosscheck.identification.parameters import KINDS, MASS, Key, ParameterSpace
from crosscheck.identification.pseudo_inertia import (
    NAMES,
    QUANTITIES,
    UNITS,
    MassPropertyMap,
    convert_to_com,
    move_mass_properties,
)
from flexinv.typing import Array

CHAINS = 125
DRAWN = 8  # draws of each chain
APART = 4  # moves between draws
BURNT = 20  # moves before the first one, while their size is set
WELL = 0.35  # part of the moves that is accepted where their size is right
ROUNDS = 15  # of Newton's method, at most: where there is no z(u) the move is not made
FARTHEST = 2.0  # widths of the priors that one step goes at most
HALVINGS = 8  # of a step, at most
SHORTER = 0.25  # by so much of the part that is taken the next step has to be shorter; a quarter is Deuflhard's
REUSED = 6  # steps, at most, with the same slopes: without them draws take a fifth longer, with more as long
CONTRACTION = 0.25  # of a step's length is left of the next at most, where the same slopes serve on
CLOSE = 1e-6  # error of u at which z is found
OWN = 3.0  # information in widths of the prior by which one that is known but for this is narrowed to half: 1 / (1 + 3)^0.5
LEAST = 1e-6  # part of the prior's variance that logs take away: below, what they say is rounding
STEP = 1e-6  # of the derivatives of mass, centre and inertia by the coordinates of a link


def sample_posterior(space: ParameterSpace, fit: Fit, random: np.random.Generator) -> Array:
    """Return draws of z (draws, parameters) [-], standard normal before the logs."""
    cost = _build_cost(space, fit)
    shape = (CHAINS, len(fit.z))
    z = np.tile(fit.z, (CHAINS, 1))
    u = np.zeros(shape)
    weight = cost.compute_weight(z, u)
    size = 1.0
    draws = []
    for move in range(BURNT + APART * DRAWN):
        tried = np.sqrt(1.0 - size**2) * u + size * random.normal(size=shape)
        there, found = cost.solve(tried, z)
        heavier = cost.compute_weight(there, tried)
        accepted = found & (np.log(random.uniform(size=CHAINS)) < heavier - weight)
        z[accepted] = there[accepted]
        u[accepted] = tried[accepted]
        weight[accepted] = heavier[accepted]
        if move < BURNT:
            size = min(1.0, size * float(np.exp(accepted.mean() - WELL)))
        elif (move - BURNT) % APART == APART - 1:
            draws.append(z.copy())
    return np.concatenate(draws)


@dataclass(frozen=True)
class _Part:
    """Channels that a free gain multiplies, or all others: number of the gain, level y(z^), A, R, R^T A [-]."""

    gain: int | None
    level: Array
    data: Array
    root: Array
    mix: Array


@dataclass(frozen=True)
class _Cost:
    """The cost in effects: its parts, their pulls b (parts, parameters), center z^, half C^(1/2), back C^(-1/2) [-].

    gain_errors : of the prior of each part's gain, nothing where it has none [-]
    """

    effects: _Effects
    gain_errors: tuple[float, ...]
    parts: tuple[_Part, ...]
    pulls: Array
    center: Array
    half: Array
    back: Array

    @np.errstate(over="ignore", invalid="ignore")  # a step that goes too far ends at no number, and is halved
    def solve(self, u: Array, start: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return z(u) (chains, parameters) [-] by Newton's method from a start, and where it is found (chains,).

        A step is halved until the next one, with the slopes of this one, would be smaller.  The error in u itself grows at every
        step along the curved sets that the logs leave, and is no measure of a way (P. Deuflhard, "Newton Methods for Nonlinear
        Problems", Springer 2004, 3.2).  The same slopes serve as long as `CONTRACTION` of a step is left at most.
        """
        z = start.copy()
        error = np.full(len(z), np.inf)
        active = np.arange(len(z))
        for _ in range(ROUNDS):
            left = self._map(z[active]) - u[active]
            slopes = _Factors.build_from(self._compute_slopes(z[active]))
            step = -slopes.solve(left @ self.back)
            helped, there, following = self._take_halved_step(z[active], step, u[active], slopes)
            z[active] = self._take_more_steps(there, step, following, u[active], slopes)
            error[active] = np.where(helped, np.sqrt(np.sum((self._map(z[active]) - u[active]) ** 2, axis=1)), np.inf)
            active = active[helped & (error[active] > CLOSE)]
            if not len(active):
                break
        return z, error <= CLOSE

    def _take_halved_step(
        self, z: Array, step: Array, u: Array, slopes: _Factors
    ) -> tuple[NDArray[np.bool_], Array, Array]:
        """Return true where the step after a halved one (chains, parameters) is shorter than it, the z there, and that step.

        Where no halving helps z stays, and the step after it is nan.
        """
        length = np.linalg.norm(step, axis=1)
        taken = step * np.minimum(1.0, FARTHEST / np.maximum(np.abs(step).max(axis=1, keepdims=True), FARTHEST))
        out = z.copy()
        after = np.full_like(z, np.nan)
        open_ = np.arange(len(z))
        for k in range(HALVINGS):
            part = 0.5**k
            tried = z[open_] + part * taken[open_]
            following = -slopes.solve((self._map(tried) - u[open_]) @ self.back, open_)
            helped = np.linalg.norm(following, axis=1) < (1.0 - SHORTER * part) * length[open_]  # nan is no help
            out[open_[helped]] = tried[helped]
            after[open_[helped]] = following[helped]
            open_ = open_[~helped]
            if not len(open_):
                break
        left_out = np.isin(np.arange(len(z)), open_)
        return ~left_out, out, after

    def _take_more_steps(self, z: Array, step: Array, following: Array, u: Array, slopes: _Factors) -> Array:
        """Return z (chains, parameters) after the steps that follow one with the same slopes, as long as they shrink enough."""
        out = z.copy()
        length = np.linalg.norm(step, axis=1)
        open_ = np.arange(len(z))
        for _ in range(REUSED):
            left = np.linalg.norm(following, axis=1)
            shrunk = left < CONTRACTION * length  # nan has not
            open_ = open_[shrunk]
            if not len(open_):
                break
            out[open_] += following[shrunk]
            length = left[shrunk]
            following = -slopes.solve((self._map(out[open_]) - u[open_]) @ self.back, open_)
        return out

    def compute_weight(self, z: Array, u: Array) -> Array:
        """Return log w (chains,) [-], but for a constant."""
        square = np.sum(u**2, axis=1) - np.sum(z**2, axis=1)
        for left in self._list_left(z):
            square = square - np.sum(left**2, axis=1)
        return np.asarray(0.5 * square - np.linalg.slogdet(self._compute_slopes(z))[1])

    def _list_left(self, z: Array) -> list[Array]:
        """r (chains, parameters) of each part."""
        plain = self.effects.evaluate(z)
        return [
            (self.effects.apply_gain(part.gain, self.center, z, plain) - part.level) @ part.data.T - pull
            for part, pull in zip(self.parts, self.pulls, strict=True)
        ]

    def _map(self, z: Array) -> Array:
        """u (chains, parameters) of z."""
        out = z
        for part, left in zip(self.parts, self._list_left(z), strict=True):
            out = out + left @ part.root
        return out @ self.half

    def _compute_slopes(self, z: Array) -> Array:
        """Slopes 1 + sum R^T A dy/dz (chains, parameters, parameters); dy/dz has blocks, a diagonal, a gain."""
        slopes, blocks = self.effects.compute_slopes(z)
        plain = self.effects.evaluate(z)
        out = np.zeros((*z.shape, z.shape[1]))
        for part, error in zip(self.parts, self.gain_errors, strict=True):
            slope = part.mix * slopes[:, None, :]
            for link, rows in enumerate(self.effects.rows):
                slope[:, :, rows] = part.mix[:, rows] @ blocks[:, link]
            if part.gain is not None:
                gained = self.effects.apply_gain(part.gain, self.center, z, plain)
                slope *= plain[:, part.gain, None, None]
                slope[:, :, part.gain] = error * (gained @ part.mix.T)  # y is proportional to its gain
            out += slope
        every = np.arange(z.shape[1])
        out[:, every, every] += 1.0
        return out


@dataclass(frozen=True)
class _Factors:
    """Triangular factors of matrices, one by one: of hundred rows each that takes a third of the time of their inverses."""

    factors: list[tuple[Array, NDArray[np.int32]]]

    @classmethod
    def build_from(cls, matrices: Array) -> _Factors:
        """Return the factors of matrices (samples, n, n), which are overwritten."""
        # A matrix by rows is its transpose by columns, as LAPACK has it.
        return cls([scipy.linalg.lapack.dgetrf(one.T, overwrite_a=True)[:2] for one in matrices])

    def solve(self, right: Array, rows: NDArray[np.int64] | None = None) -> Array:
        """Return A^-1 b (samples, n) of all matrices, or of ``rows``, for b (samples, n); no number where A is singular."""
        chosen = self.factors if rows is None else [self.factors[k] for k in rows]
        solved = [scipy.linalg.lapack.dgetrs(*one, b, trans=True)[0] for one, b in zip(chosen, right, strict=True)]
        return np.array(solved).reshape(right.shape)


def _build_cost(space: ParameterSpace, fit: Fit) -> _Cost:
    values, vectors = np.linalg.eigh(fit.covariance)
    values = np.clip(values, 1e-300, 1.0)
    half = np.asarray((vectors * np.sqrt(values)) @ vectors.T)
    back = np.asarray((vectors / np.sqrt(values)) @ vectors.T)
    whole: Mapping[Key | None, Array] = {None: (vectors * (1.0 / values - 1.0)) @ vectors.T}
    effects = _Effects.build_for(space)
    parts = tuple(_build_part(space, effects, fit.z, *one) for one in (fit.information or whole).items())
    errors = tuple(0.0 if part.gain is None else space.parameters[part.gain].error for part in parts)
    # sum R^T b = z^ where the logs tell anything; elsewhere z^ is 0 but for the end of the search.
    pull = np.linalg.lstsq(np.vstack([part.root for part in parts]).T, fit.z, rcond=1e-9)[0]
    return _Cost(effects, errors, parts, np.asarray(pull).reshape(len(parts), -1), fit.z, half, back)


def _build_part(space: ParameterSpace, effects: _Effects, center: Array, gain: Key | None, information: Array) -> _Part:
    values, vectors = np.linalg.eigh(information)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    at = None if gain is None else [one.key for one in space.parameters].index(gain)
    plain = effects.evaluate(center[None])
    level = effects.apply_gain(at, center, center[None], plain)[0]
    slopes, blocks = effects.compute_slopes(center[None])
    slope = np.diag(slopes[0])
    for rows, block in zip(effects.rows, blocks[0], strict=True):
        slope[np.ix_(rows, rows)] = block
    if at is not None:
        slope *= plain[0, at]
        slope[:, at] = space.parameters[at].error * level
    data = np.linalg.solve(slope.T, root.T).T
    return _Part(at, level, data, root, root.T @ data)


@dataclass(frozen=True)
class _Effects:
    """Effects y in which readings are linear, of coordinates z: mass properties, values of what is positive, and the rest.

    masses : of the links whose mass properties are free; rows : (links, 10) their coordinates; errors : (links, 10) of the priors
    values : numbers of the parameters with a value v = known e^(error z); known [unit of each], spread : known and error of these
    others : numbers of the parameters that are linear in z
    """

    masses: MassPropertyMap
    rows: NDArray[np.int64]
    errors: Array
    values: NDArray[np.int64]
    known: Array
    spread: Array
    others: NDArray[np.int64]

    @classmethod
    def build_for(cls, space: ParameterSpace) -> _Effects:
        """Return the effects of the free parameters."""
        blocks = _list_mass_blocks(space)
        factors = np.array([space.factors[name] for name, _, _ in blocks]).reshape(-1, 4, 4)
        rows = np.array([at for _, at, _ in blocks], dtype=np.int64).reshape(-1, len(NAMES))
        errors = np.array([error for _, _, error in blocks]).reshape(-1, len(NAMES))
        values = [k for k, one in enumerate(space.parameters) if one.positive and not KINDS[one.kind].solved]
        others = sorted({*range(len(space.parameters))} - {*rows.ravel().tolist(), *values})
        known, spread = (np.array([getattr(space.parameters[k], name) for k in values]) for name in ("known", "error"))
        numbers = (np.array(one, dtype=np.int64) for one in (values, others))
        first, last = numbers
        return cls(MassPropertyMap.build_for(factors), rows, errors, first, known, spread, last)

    def evaluate(self, z: Array) -> Array:
        """Return y (samples, parameters) [unit of each] of z (samples, parameters) [-]."""
        effect = z.copy()
        effect[:, self.values] = self.known * np.exp(self.spread * z[:, self.values])
        effect[:, self.rows] = self.masses.move(self.errors * z[:, self.rows])
        return effect

    def compute_slopes(self, z: Array) -> tuple[Array, Array]:
        """Return the slopes of y by z: each by its own (samples, parameters), and of mass properties (samples, links, 10, 10)."""
        single = np.ones_like(z)
        single[:, self.values] = self.spread * self.known * np.exp(self.spread * z[:, self.values])
        blocks = self.masses.compute_slopes(self.errors * z[:, self.rows]) * self.errors[:, None, :]
        return single, blocks

    def apply_gain(self, gain: int | None, center: Array, z: Array, plain: Array) -> Array:
        """Return effects (samples, parameters) times the gain of number ``gain``; of what is no value only what is beyond z^."""
        if gain is None:
            return plain
        out = plain.copy()
        out[:, self.others] = z[:, self.others] - center[self.others]
        out[:, gain] = 1.0
        return np.asarray(out * plain[:, gain, None])


def _list_mass_blocks(space: ParameterSpace) -> list[tuple[str, list[int], Array]]:
    """Of each link whose mass properties are free: name, its ten parameters, and their prior errors (10,) [-]."""
    where = {p.key: k for k, p in enumerate(space.parameters)}
    out = []
    for name in space.factors:
        at = [where[MASS, f"{name}.{n}"] for n in NAMES]
        out.append((name, at, np.array([space.parameters[k].error for k in at])))
    return out


def compute_physical_values(space: ParameterSpace, z: Array) -> Array:
    """Return mass, centre and inertia about it of links, and the other parameters, (..., parameters) [unit of each]."""
    out = np.array(z, dtype=np.float64)
    for k, one in enumerate(space.parameters):
        if one.kind != MASS:
            shift = one.error * out[..., k]
            out[..., k] = one.known * np.exp(shift) if one.positive else one.known + shift
    for name, at, errors in _list_mass_blocks(space):
        out[..., at] = convert_to_com(move_mass_properties(space.factors[name], errors * z[..., at]))
    return out


@dataclass(frozen=True)
class LogInformation:
    """Information of the logs alone about parameters p in physical quantities, near the fit.

    keys, units : kind and place, unit of each; width : (parameters,) of the priors [units]
    matrix : (parameters, parameters) information in widths of the priors [-]; ratio : (parameters,) what is left of each [-]
    pull : (parameters,) by how many widths of its prior the fit stands off what was known [-]
    """

    keys: tuple[Key, ...]
    units: tuple[str, ...]
    width: Array
    matrix: Array
    ratio: Array
    pull: Array

    @property
    def own(self) -> NDArray[np.bool_]:
        """(parameters,) whether the logs would narrow each to half were all the others known [-]."""
        return np.asarray(np.diag(self.matrix) > OWN)

    def compute_conflict(self) -> Array:
        """Return by how many standard errors the logs contradict each prior (parameters,) [-]: pull / (1 - ratio^2)^0.5."""
        taken = 1.0 - self.ratio**2
        return np.where(taken > LEAST, self.pull / np.sqrt(np.maximum(taken, LEAST)), 0.0)


def compute_log_information(space: ParameterSpace, fit: Fit) -> LogInformation:
    """Return the information of the logs ``W = D T^-T (C^-1 - 1) T^-1 D`` [-], ``p = p^ + T (z - z^)``, ``D = diag |T_k|``."""
    keys: list[Key] = [p.key for p in space.parameters]
    units = [p.unit for p in space.parameters]
    slope = np.diag(
        [
            one.error * (one.compute_value(float(x)) if one.positive else 1.0)
            for one, x in zip(space.parameters, fit.z, strict=True)
        ]
    )
    for name, at, errors in _list_mass_blocks(space):
        x = errors * fit.z[at]
        ahead, behind = (
            convert_to_com(move_mass_properties(space.factors[name], x + side * STEP * np.eye(len(NAMES))))
            for side in (1.0, -1.0)
        )
        slope[np.ix_(at, at)] = (ahead - behind).T / (2.0 * STEP) * errors
        for k, quantity, unit in zip(at, QUANTITIES, UNITS, strict=True):
            keys[k] = (quantity, name)
            units[k] = unit
    width = np.linalg.norm(slope, axis=1)
    scaled = slope / width[:, None]
    back = np.linalg.inv(scaled)
    information = back.T @ (np.linalg.inv(fit.covariance) - np.eye(len(fit.z))) @ back
    ratio = np.sqrt(np.einsum("kp,pq,kq->k", scaled, fit.covariance, scaled))
    return LogInformation(tuple(keys), tuple(units), width, information, ratio, scaled @ fit.z)
