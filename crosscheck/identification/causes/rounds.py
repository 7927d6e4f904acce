"""A log held against what was identified: residuals behind the low-pass and above it, under faults that are undone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from crosscheck.identification.causes.cause import Cause
from crosscheck.identification.causes.wide_rows import WideRows, build_wide_rows
from crosscheck.identification.estimation.days import compute_day_deviations
from crosscheck.identification.estimation.fit import Fit, Problem, build_problem, compute_jacobian
from crosscheck.identification.estimation.noise import count_agreeing_samples
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Channel, Machine
from crosscheck.identification.parameters import Parameter, ParameterSpace
from crosscheck.identification.readings import (
    Run,
    compute_wide_responses,
    make_run,
    read_measured_channels,
)
from flexinv.model.mechanism import Mechanism
from flexinv.rigid.torque_regressor import compute_link_parameters
from flexinv.typing import Array

SPOT = 0.01  # step of a derivative by a place, in widths of what is known of it
FARTHEST = 1.0  # of those widths in one step
# Times the RMS of what blocks left out have left: more is no noise, on another day of the same machine either.
NOISE = 2.5
# What is left of a channel beside causes that were named: above so many times that RMS it counts, and the causes have to explain
# so much of the mean square that is no noise.  Neither was swept: campaigns/log_faults holds them as they are.
SEEN = 1.2
MOST = 0.75
ROUNDS = 4  # of weights on another day: the second is right but for what the first has left


@dataclass(frozen=True)
class CauseSearch:
    """A machine with the parameters found; cut : samples that are clipped (samples, channels).

    before : runs that say what efforts look like above the bandwidth
    """

    machine: Machine
    fit: Fit
    cut: NDArray[np.bool_]
    seen: bool
    before: tuple[Run, ...] = ()

    @property
    def root(self) -> Array:
        """Square root of the precision with which the parameters are known beside this log (parameters, parameters).

        On another day than those that identified, friction and offsets may have moved as far as days scatter.
        """
        if self.seen:
            return np.eye(len(self.fit.z))
        deviations = compute_day_deviations(self.machine, self.fit.z, self.fit.scatter)
        return np.asarray(np.linalg.cholesky(np.linalg.inv(self.fit.covariance + np.diag(deviations**2))).T)

    def build_task(
        self, log: Log, mechanism: Mechanism, level: Problem | None = None, moves: bool = True, once: bool = False
    ) -> Problem:
        """Return a log of a mechanism; samples count as in ``level``, motions are its own if they move.

        once : its readings are asked for at one set of values
        """
        if level is not None and not moves:
            told = replace(
                level.runs[0],
                measured=read_measured_channels(level.machine, log),
                wide=compute_wide_responses(level.machine, log),
            )
            return replace(level, runs=(told,))
        changed = Machine(mechanism, self.machine.settings, update_space(self.machine, mechanism))
        run = make_run(changed, log, once=once)
        if level is None:
            return build_problem(changed, (run,), (run.counted & ~self.cut,))
        return replace(level, machine=changed, runs=(run,))


def update_space(machine: Machine, mechanism: Mechanism) -> ParameterSpace:
    """Return the parameters as before, with what the changed mechanism has beside the first one.

    Masses [kg] are added to those of the parameters; a stiffness that is free is as many times as large as the mechanism's.
    """
    if mechanism is machine.mechanism:
        return machine.space
    names = [name for name in machine.space.factors if name in mechanism.link_of]
    more = {
        n: compute_link_parameters(mechanism.link_of[n]) - compute_link_parameters(machine.mechanism.link_of[n])
        for n in names
    }
    parameters = tuple(_scale_known_stiffness(one, machine.mechanism, mechanism) for one in machine.space.parameters)
    return replace(machine.space, parameters=parameters, more=more)


def _scale_known_stiffness(one: Parameter, before: Mechanism, after: Mechanism) -> Parameter:
    if one.kind != "joint stiffness" or one.place not in after.joint_of:
        return one
    first, now = (mechanism.joint_of[one.place].stiffness for mechanism in (before, after))
    return replace(one, known=one.known * now / first) if first > 0.0 and now != first else one


def replace_cause(causes: Sequence[Cause], k: int, other: Cause) -> list[Cause]:
    """Return the causes with another one in the place of number k [-]."""
    return [*causes[:k], other, *causes[k + 1 :]]


def move_spot(cause: Cause, i: int, way: float) -> Cause:
    """Return a cause that is elsewhere: number i of its place goes on by a way [-]."""
    assert cause.make_at is not None
    spot = list(cause.spot)
    spot[i] += way
    return cause.make_at(tuple(spot))


def _remove_basis(rows: Array, basis: Array) -> Array:
    """Rows (rows,) less their part in a basis (rows, directions)."""
    return np.asarray(rows - basis @ (basis.T @ rows))


class CauseRound:
    """A log under the causes named so far: residual and directions that the parameters cannot make up for.

    Rows of all channels behind the low-pass come first, those above the bandwidth then, and the parameters at the end.
    """

    def __init__(
        self, search: CauseSearch, log: Log, causes: Sequence[Cause], at: Array, wide: list[WideRows] | None
    ) -> None:
        self.search = search
        self.log = log
        self.causes = list(causes)
        self.at = at.copy()
        self.task = self.build_task_at(at, None, self.causes)
        found = search.fit
        self.told = self.task.collect_counted_samples(self.task.predict(found.z))
        residual = self._compute_residual(self.task)
        self.wide = build_wide_rows(self.task.runs[0], search.before) if wide is None else wide
        self._own_costs: dict[int, float] = {}
        sizes = [len(r) for r in residual] + [2 * len(w.weights) for w in self.wide]
        self.ends = np.cumsum(sizes)
        news = [len(r) / a for r, a in zip(residual, found.agree, strict=True)]
        self.news = np.array(news + [w.news for w in self.wide])
        self.weight, self.parameters = self._fit_weights(residual)
        self.named: list[int] = np.flatnonzero(at).tolist()
        self.slopes = self._compute_named_slopes()
        self.basis = np.linalg.qr(np.column_stack([self.parameters, self._list_told_directions()]))[0]

    def add_causes(self, more: Iterable[Cause]) -> CauseRound:
        """Return the same with further causes, of size 0 [-]."""
        out = copy(self)
        out.causes = [*self.causes, *more]
        out.at = np.concatenate([self.at, np.zeros(len(out.causes) - len(self.causes))])
        return out

    def _fit_weights(self, residual: list[Array]) -> tuple[Array, Array]:
        """Weights of the channels (channels,) [1 / unit], and the basis (rows, parameters) of what parameters can make up for.

        A channel weighs by what is left of it; on another day by what is left once friction and offsets have made up for the day.
        """
        found = self.search.fit
        slopes = compute_jacobian(self.task, found.z)
        beside = np.zeros((self.ends[-1] - self.ends[len(residual) - 1], len(found.z)))
        spread = np.array([np.sqrt(np.mean(r**2)) for r in residual])
        weight = 1.0 / (spread * np.sqrt(found.agree))
        basis: Array = np.zeros((0, 0))
        for _ in range(ROUNDS if found.scatter else 1):
            weight = 1.0 / (spread * np.sqrt(found.agree))
            scaled = [w * j for w, j in zip(weight, slopes, strict=True)]
            basis = np.linalg.qr(np.vstack([*scaled, beside, self.search.root]))[0]
            rows = self._compute_rows(self.at, self.causes, weight)
            left = np.split(_remove_basis(rows, basis), self.ends)[: len(residual)]
            rest = np.array([np.sqrt(np.mean(r**2)) for r in left]) / weight
            spread = np.maximum(rest, found.spread)
        return weight, basis

    def _compute_named_slopes(self) -> Array:
        """Slopes (rows, named) of the weighed residual by the sizes of the causes named so far, which stay free [1 / unit]."""
        level = self._compute_rows_beside_parameters(self.at, self.causes)
        columns = []
        for k in self.named:
            ahead = self.at.copy()
            ahead[k] += self.causes[k].step
            columns.append((self._compute_rows_beside_parameters(ahead, self.causes) - level) / self.causes[k].step)
        columns += [self._compute_spot_slope(k, i, level) for k, i in self._list_spots()]
        return np.column_stack(columns) if columns else np.zeros((len(level), 0))

    def _list_spots(self) -> list[tuple[int, int]]:
        """The numbers that say where named causes are: which cause, and which of its numbers."""
        return [(k, i) for k in self.named for i in range(len(self.causes[k].spot))]

    def _compute_spot_slope(self, k: int, i: int, level: Array) -> Array:
        """Slope (rows,) of the weighed residual by number i of the place of cause k [-]."""
        moved = replace_cause(self.causes, k, move_spot(self.causes[k], i, SPOT))
        ahead = self._compute_rows_beside_parameters(self.at, moved)
        return (ahead - level) / SPOT

    def _list_told_directions(self) -> Array:
        """Directions (rows, directions) of the sizes that are named, and of places where the log tells more than is known."""
        count = len(self.named)
        told = np.sum(self.slopes[:, count:] ** 2, axis=0) > 1.0
        return np.hstack([self.slopes[:, :count], self.slopes[:, count:][:, told]])

    def fit_named_sizes(self) -> tuple[list[Cause], Array, Array]:
        """Return the causes, where they are, and their sizes [unit of each] after a step in those named, and their errors.

        All are moved together; what is known of places counts as one standard deviation each.
        """
        level = self._compute_rows_beside_parameters(self.at, self.causes)
        count = len(self.named)
        spots = self._list_spots()
        known = np.concatenate([np.zeros(count), np.ones(len(spots))])
        place = np.concatenate([np.zeros(count), [self.causes[k].spot[i] for k, i in spots]])
        base = np.linalg.pinv(self.slopes.T @ self.slopes + np.diag(known))
        step = base @ (self.slopes.T @ level + known * place)
        left = level - self.slopes @ step
        scatter = np.sqrt(np.diag(base) * max(1.0, float(left @ left) / float(self.news.sum())))
        sizes = self.at.copy()
        errors = np.zeros(len(sizes))
        sizes[self.named] -= step[:count]
        errors[self.named] = scatter[:count]
        causes = self.causes
        for (k, i), way in zip(spots, step[count:], strict=True):
            causes = replace_cause(causes, k, move_spot(causes[k], i, float(np.clip(-way, -FARTHEST, FARTHEST))))
        return causes, sizes, errors

    def compute_named_effects(self) -> dict[int, float]:
        """Return of each named cause the square of what its size does to the weighed rows [-]."""
        squares = np.sum(self.slopes[:, : len(self.named)] ** 2, axis=0) * self.at[self.named] ** 2
        return dict(zip(self.named, squares.tolist(), strict=True))

    def compute_levels(self) -> Array:
        """Return the RMS that is left of each channel over that of blocks left out (channels,) [-]."""
        parts = np.split(self.compute_weighed_residual(self.at), self.ends)
        spread = np.array([np.sqrt(np.mean(part**2)) for part in parts[: len(self.weight)]])
        return np.asarray(spread / self.weight / self.search.fit.block)

    def list_unexplained_channels(self, first: Array, every: bool) -> list[tuple[Channel, float]]:
        """Return channels of which more is left than noise, with how many times it is left [-], worst first.

        first : `compute_levels` of the log as it is; of what was more than noise there, causes have to explain `MOST`
        every : a channel of which less is left is among them, too
        """
        noise = 0.0 if every else NOISE
        levels = self.compute_levels()
        rest = np.maximum(levels**2 - 1.0, 0.0)
        partly = (levels > SEEN) & (levels < first) & (rest > (1.0 - MOST) * (first**2 - 1.0))
        channels = self.search.machine.channels
        return [(channels[c], float(levels[c])) for c in np.argsort(levels)[::-1] if levels[c] > noise or partly[c]]

    def build_task_at(self, at: Array, level: Problem | None, causes: Sequence[Cause]) -> Problem:
        """Return the log and the mechanism at sizes ``at`` of causes [unit of each]; level : the round's own, if known."""
        log = self.log
        mechanism = self.search.machine.mechanism
        moves = False
        for cause, known, phi, before in zip(causes, self.causes, at, self.at, strict=True):
            if phi:
                log, mechanism = cause.undone(log, mechanism, float(phi))
            moves = moves or (cause.moves and (phi != before or cause is not known))
        return self.search.build_task(log, mechanism, level, moves, once=level is not None)

    def _compute_residual(self, task: Problem) -> list[Array]:
        """Measured values less the readings, which are those of the round as long as nothing else moves."""
        measured = task.collect_counted_samples([run.measured for run in task.runs if run.measured is not None])
        same = task.runs[0].response is self.task.runs[0].response
        told = self.told if same else task.collect_counted_samples(task.predict(self.search.fit.z))
        return [m - p for m, p in zip(measured, told, strict=True)]

    def compute_weighed_residual(self, at: Array, causes: Sequence[Cause] | None = None) -> Array:
        """Return the weighed residual (rows,) [-] at sizes ``at`` of all causes, less what others can make up for.

        Others are the parameters, and the causes that are named.

        causes : in the place of the round's own
        """
        return _remove_basis(self._compute_rows(at, causes or self.causes, self.weight), self.basis)

    def _compute_rows_beside_parameters(self, at: Array, causes: Sequence[Cause]) -> Array:
        """The same, less what the parameters alone can make up for."""
        return _remove_basis(self._compute_rows(at, causes, self.weight), self.parameters)

    def _compute_rows(self, at: Array, causes: Sequence[Cause], weight: Array) -> Array:
        """Weighed residual (rows,) [-] at sizes ``at`` of causes."""
        task = self.build_task_at(at, self.task, causes)
        factor = self._compute_channel_factors(at, causes)
        told = [f * w * e for f, w, e in zip(factor, weight, self._compute_residual(task), strict=True)]
        above = [factor[w.channel] * w.compute_rows(task.runs[0]) for w in self.wide]
        return np.concatenate([*told, *above, np.zeros(len(self.search.fit.z))])

    def _compute_channel_factors(self, at: Array, causes: Sequence[Cause]) -> Array:
        """Factors by which the column of each channel is too large (channels,) [-]."""
        columns = [c.column for c in self.search.machine.channels]
        out = np.ones(len(columns))
        for cause, phi in zip(causes, at, strict=True):
            if cause.scales and phi:
                out[columns.index(cause.scales)] *= 1.0 + phi
        return out

    def compute_cost_above(self, at: Array) -> float:
        """Return the cost above the bandwidth alone [-]: it needs the log only, and no torque of the model."""
        log = self.log
        for cause, phi in zip(self.causes, at, strict=True):
            log = cause.undone(log, self.search.machine.mechanism, float(phi))[0] if phi else log
        return float(sum(self._compute_channel_cost(w, log) for w in self.wide))

    def _compute_channel_cost(self, rows: WideRows, log: Log) -> float:
        """The cost of a channel; where its columns are the log's own, it is computed once."""
        machine = self.search.machine
        channel = self.search.machine.channels[rows.channel]
        columns = channel.column, machine.settings.joints[channel.place].angle.column
        unchanged = all(log.columns[c] is self.log.columns[c] for c in columns)
        if unchanged and rows.channel in self._own_costs:
            return self._own_costs[rows.channel]
        run = replace(self.task.runs[0], wide=compute_wide_responses(machine, log, rows.channel))
        cost = float(np.sum(rows.compute_rows(run) ** 2))
        if unchanged:
            self._own_costs[rows.channel] = cost
        return cost

    def drop(self, before: Array, left: Array) -> float:
        """Return by how much the cost falls [-] from one weighed residual (rows,) to another: each channel by its own scatter.

        Where what is left hangs together for longer than the logs that identified made believe, there is less news.  Above the
        bandwidth the scatter is known, and to leave less than it is no merit.
        """
        parts = list(zip(np.split(before, self.ends), np.split(left, self.ends), strict=True))
        one, other = np.array([[float(a @ a), float(b @ b)] for a, b in parts]).T
        most = [len(b) / count_agreeing_samples(b) for _, b in parts[: len(self.weight)]] + [w.news for w in self.wide]
        floor = np.concatenate([np.zeros(len(self.weight)), [w.news for w in self.wide], [0.0]])
        one = np.maximum(one, floor)
        other = np.maximum(other, floor)
        some = (one[:-1] > 0.0) & (other[:-1] > 0.0)
        news = np.minimum(self.news, most)[some]
        return float(np.sum(news * np.log(one[:-1][some] / other[:-1][some])) + one[-1] - other[-1])
