"""Naming of causes: signals that are no signals first, gross faults then, and what may be small by its evidence.

With dr/dphi beside the Jacobian of the parameters, which move as far as their intervals allow, the best phi of a small cause is

phi = -(d . r) / (d . d),   drop = sum_c n_c log(|r_c|^2 at 0 / |r_c|^2 at phi)

d, r : dr/dphi and r less what the parameters can make up for

n_c samples of news of channel c, so that chance makes drop chi-square with one degree of freedom, however large the residual is.
The strongest ones are followed to their optimum, the best is named and undone, and the rest is looked at again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from crosscheck.identification.causes.cause import Cause, Named
from crosscheck.identification.causes.dictionary import dictionary
from crosscheck.identification.causes.encoders import two_encoders
from crosscheck.identification.causes.gross import Gross, Score, hypotheses, score
from crosscheck.identification.causes.signals import clipped, clipped_samples, quantised
from crosscheck.identification.causes.wide import WideRows, wide_rows
from crosscheck.identification.fit import Fit, Problem, agreeing, jacobian, problem
from crosscheck.identification.identify import Identified
from crosscheck.identification.log import Log
from crosscheck.identification.parameters import Space
from crosscheck.identification.readings import Machine, Run, make_run, measured_of, wide_of
from flexinv.model.mechanism import Mechanism
from flexinv.rigid.torque_regressor import link_parameters

Array = NDArray[np.float64]
# Drop of the cost that chance does not give: beyond 12 it is one in two thousand for each cause that is asked for.
EVIDENCE = 12.0
# A gross fault takes away most of what is unexplained, and leaves little.
HALF, LITTLE = 0.5, 0.4
FOLLOWED = 4  # steps on the way to a size
ASKED = 2.0  # least drop of the linear estimate, which a large fault makes small: it spoils the weights
NEAREST = 6  # causes that are followed: at phi = 0 some are alike, a delay and a lag above all
ALIKE = 4.0  # of drops that differ by less than this neither is the better one: the first of the dictionary is named
LARGEST = 4  # causes named at most


def name_causes(known: Identified, log: Log, seen: bool = False) -> list[Named]:
    """Return the causes that a log shows beside what was identified [unit of each], the most certain first.

    seen : the parameters come from this very log: a gross fault has spoiled them, and is looked for under what was known before.
        What may be small is looked for beside the parameters as they are: under less, what was wrongly known looks like a fault
    """
    machine, found = known.machine, known.fit
    before = () if seen else known.task.runs
    search = _Search(machine, found, clipped_samples(machine, log), seen, before)
    named = [*clipped(machine, log), *quantised(machine, found, log)]
    for _ in range(LARGEST):
        one = _gross(search, log)
        if one is None:
            break
        fault, told = one
        named.append(told)
        log = fault.undone(log, machine.mechanism, fault.size)[0]
    return [*named, *_small(replace(search, seen=False), log), *two_encoders(machine, found, log)]


@dataclass(frozen=True)
class _Search:
    """A machine with the parameters found; cut : samples that are clipped (samples, channels).

    before : runs that say what efforts look like above the bandwidth
    """

    machine: Machine
    found: Fit
    cut: NDArray[np.bool_]
    seen: bool
    before: tuple[Run, ...] = ()

    @property
    def root(self) -> Array:
        """Square root of the precision with which the parameters are known beside this log (parameters, parameters)."""
        if self.seen:
            return np.eye(len(self.found.z))
        return np.asarray(np.linalg.cholesky(np.linalg.inv(self.found.covariance)).T)

    def task(self, log: Log, mechanism: Mechanism, level: Problem | None = None, moves: bool = True) -> Problem:
        """Return a log of a mechanism; samples count as in ``level``, motions are its own if they move."""
        changed = Machine(mechanism, self.machine.settings, carried(self.machine, mechanism))
        if level is None:
            run = make_run(changed, log)
            return problem(changed, (run,), (run.counted & ~self.cut,))
        if moves:
            run = make_run(changed, log)
        else:
            run = replace(level.runs[0], measured=measured_of(changed, log), wide=wide_of(changed, log))
        return replace(level, machine=changed, runs=(run,))


def carried(machine: Machine, mechanism: Mechanism) -> Space:
    """Return the parameters as before, with the masses [kg] that the changed mechanism has beside those of the first one."""
    if mechanism is machine.mechanism:
        return machine.space
    own = machine.space.factors
    more = {n: link_parameters(mechanism.link_of[n]) - link_parameters(machine.mechanism.link_of[n]) for n in own}
    return replace(machine.space, more=more)


# ----------------------------------------------------------------------------------------------------- gross faults


Linear = tuple[list[Array], list[Array]]  # readings, and their slopes by the parameters


def _gross(search: _Search, log: Log) -> tuple[Gross, Named] | None:
    mechanism = search.machine.mechanism
    level = search.task(log, mechanism)
    told = _linear(search, level)
    base = _scored(search, level, told)
    best: tuple[Gross, Score] | None = None
    for fault in hypotheses(search.machine):
        at = _spoiled(search, fault)
        if not at or base.unexplained[at].max() < LITTLE / 2.0:
            continue
        task = search.task(fault.undone(log, mechanism, fault.size)[0], mechanism, level, fault.moves)
        one = _scored(search, task, _linear(search, task) if fault.moves else told)
        better = one.unexplained[at].max() < min(LITTLE, HALF * base.unexplained[at].max())
        if better and base.value - one.value > EVIDENCE and (best is None or one.value < best[1].value):
            best = fault, one
    if best is None:
        return None
    fault, one = best
    before, after = (score.unexplained[_spoiled(search, fault)].max() for score in (base, one))
    evidence = f"unexplained {before:.1%} as it is, {after:.1%} without it"
    return fault, Named(fault.name, fault.place, fault.unit, fault.size, 0.0, base.value - one.value, evidence)


def _spoiled(search: _Search, fault: Gross) -> list[int]:
    return [k for k, c in enumerate(search.machine.channels) if c.place in fault.places]


def _linear(search: _Search, task: Problem) -> Linear:
    z = np.zeros(len(search.found.z)) if search.seen else search.found.z
    return task.pick(task.predict(z)), jacobian(task, z)


def _scored(search: _Search, task: Problem, told: Linear) -> Score:
    measured = task.pick([run.measured for run in task.runs if run.measured is not None])
    return score(measured, *told, search.found.agree, search.root)


# ---------------------------------------------------------------------------------------------- what may be small


def _small(search: _Search, log: Log) -> Iterator[Named]:
    causes = list(dictionary(search.machine))
    at, known, wide = np.zeros(len(causes)), set[str](), None
    for _ in range(LARGEST):
        here = _Round(search, log, causes, at, wide)
        best, wide = _strongest(here, at, known), here.wide
        if best is None:
            return
        k, one = best
        at[k] = one.size
        known.add(one.name + one.place)
        yield one


class _Round:
    """A log under the causes named so far: residual and directions that the parameters cannot make up for.

    Rows of all channels behind the low-pass come first, those above the bandwidth then, and the parameters at the end.
    """

    def __init__(self, search: _Search, log: Log, causes: list[Cause], at: Array, wide: list[WideRows] | None) -> None:
        self.search, self.log, self.causes = search, log, causes
        self.task = self.task_at(at, None)
        found = search.found
        residual = self._residual(self.task)
        spread = np.array([np.sqrt(np.mean(r**2)) for r in residual])
        self.weight = 1.0 / (spread * np.sqrt(found.agree))
        self.wide = wide_rows(self.task.runs[0], search.before) if wide is None else wide
        sizes = [len(r) for r in residual] + [2 * len(w.weights) for w in self.wide]
        self.ends = np.cumsum(sizes)
        news = [len(r) / a for r, a in zip(residual, found.agree, strict=True)]
        self.news = np.array(news + [w.news for w in self.wide])
        scaled = [w * j for w, j in zip(self.weight, jacobian(self.task, found.z), strict=True)]
        beside = np.zeros((sum(sizes[len(residual) :]), len(found.z)))
        self.basis = np.linalg.qr(np.vstack([*scaled, beside, search.root]))[0]

    def task_at(self, at: Array, level: Problem | None) -> Problem:
        """Return the log and the mechanism at sizes ``at`` of all causes [unit of each]."""
        log, mechanism, moves = self.log, self.search.machine.mechanism, False
        for cause, phi in zip(self.causes, at, strict=True):
            if phi:
                log, mechanism = cause.undone(log, mechanism, float(phi))
                moves = moves or cause.moves
        return self.search.task(log, mechanism, level, moves)

    def _residual(self, task: Problem) -> list[Array]:
        measured = task.pick([run.measured for run in task.runs if run.measured is not None])
        return [m - p for m, p in zip(measured, task.pick(task.predict(self.search.found.z)), strict=True)]

    def rest(self, at: Array) -> Array:
        """Return the weighed residual (rows,) [-] at sizes ``at`` of all causes, less what the parameters can make up for."""
        task = self.task_at(at, self.task)
        told = [w * e for w, e in zip(self.weight, self._residual(task), strict=True)]
        above = [w.rows(task.runs[0]) for w in self.wide]
        r = np.concatenate([*told, *above, np.zeros(len(self.search.found.z))])
        return np.asarray(r - self.basis @ (self.basis.T @ r))

    def above(self, at: Array) -> float:
        """Return the cost above the bandwidth alone [-]: it needs the log only, and no torque of the model."""
        log = self.log
        for cause, phi in zip(self.causes, at, strict=True):
            log = cause.undone(log, self.search.machine.mechanism, float(phi))[0] if phi else log
        run = replace(self.task.runs[0], wide=wide_of(self.search.machine, log))
        return float(sum(np.sum(w.rows(run) ** 2) for w in self.wide))

    def drop(self, before: Array, left: Array) -> float:
        """Return by how much the cost falls [-] from one weighed residual (rows,) to another: each channel by its own scatter.

        Where what is left hangs together for longer than the logs that identified made believe, there is less news.  Above the
        bandwidth the scatter is known, and to leave less than it is no merit.
        """
        parts = list(zip(np.split(before, self.ends), np.split(left, self.ends), strict=True))
        one, other = np.array([[float(a @ a), float(b @ b)] for a, b in parts]).T
        most = [len(b) / agreeing(b) for _, b in parts[: len(self.weight)]] + [w.news for w in self.wide]
        floor = np.concatenate([np.zeros(len(self.weight)), [w.news for w in self.wide], [0.0]])
        one, other = np.maximum(one, floor), np.maximum(other, floor)
        some = (one[:-1] > 0.0) & (other[:-1] > 0.0)
        news = np.minimum(self.news, most)[some]
        return float(np.sum(news * np.log(one[:-1][some] / other[:-1][some])) + one[-1] - other[-1])


def _strongest(here: _Round, at: Array, known: set[str]) -> tuple[int, Named] | None:
    level = here.rest(at)
    first: list[tuple[float, int, float]] = []
    for k, cause in enumerate(here.causes):
        if cause.name + cause.place not in known:
            first += [(drop, k, size) for drop, size in _starts(here, at, k, level) if drop > ASKED]
    chosen: dict[int, float] = {}
    for _, k, size in sorted(first, reverse=True):
        chosen.setdefault(k, size)
    followed = [_sized(here, at, k, size, level) for k, size in list(chosen.items())[:NEAREST]]
    followed = [one for one in followed if one[1].size > here.causes[one[0]].least]
    most = max((one.drop for _, one in followed), default=0.0)
    if most < EVIDENCE:
        return None
    alike = sorted((one for one in followed if one[1].drop > most - ALIKE), key=lambda one: _order(here, *one))
    k, likely = alike[0]
    others = [f"{one.name} of {one.place}, {one.size:.3g} {one.unit}" for _, one in alike[1:]]
    words = likely.evidence + (f"; next to as likely: {'; '.join(others)}" if others else "")
    return k, replace(likely, evidence=words)


def _order(here: _Round, k: int, one: Named) -> tuple[bool, int]:
    """What can be comes before what is against nature, and what stands first in the dictionary before the rest."""
    return here.causes[k].one_sided and one.size < 0.0, k


def _starts(here: _Round, at: Array, k: int, level: Array) -> list[tuple[float, float]]:
    """Sizes of a cause at which the way to the best one may start, each with about how much the cost falls."""
    cause, one = here.causes[k], np.eye(len(at))[k]
    slope = (here.rest(at + cause.step * one) - level) / cause.step
    square, out = float(slope @ slope), []
    if square > 0.0:
        out.append((float(slope @ level) ** 2 / square, -float(slope @ level) / square))
    if here.wide and cause.tries:
        costs = [here.above(at + size * one) for size in cause.tries]
        best = int(np.argmin(costs))
        left = here.rest(at + cause.tries[best] * one)
        out.append((float(level @ level - left @ left), cause.tries[best]))
    return out


def _sized(here: _Round, at: Array, k: int, size: float, before: Array) -> tuple[int, Named]:
    """Follow the size of a cause where it is not linear: Gauss and Newton in one number."""
    cause, one = here.causes[k], np.eye(len(at))[k]
    square = 1.0
    for _ in range(FOLLOWED):
        level = here.rest(at + size * one)
        slope = (here.rest(at + (size + cause.step) * one) - level) / cause.step
        square = float(slope @ slope)
        size -= float(slope @ level) / square
    left = here.rest(at + size * one)
    error = np.sqrt(float(left @ left) / float(here.news.sum()) / square)
    drop = here.drop(before, left)
    words = f"the cost falls by {drop:.0f}, to {left @ left / (before @ before):.0%} of what remained"
    return k, Named(cause.name, cause.place, cause.unit, size, float(error), drop, words)
