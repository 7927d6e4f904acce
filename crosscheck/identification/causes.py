"""Causes of what a model leaves unexplained in a measured log: faults of sensors and of what is known, with size and evidence.

A cause is a change of the log (the fault undone) or of the mechanism, with one number phi.  With dr/dphi beside the Jacobian of
the parameters, which move as far as their intervals allow, the best phi and the drop of the cost are

phi = -(d . r) / (d . d),   drop = (d . r)^2 / (d . d),   d, r : dr/dphi and r less what the parameters can make up for

Chance makes drop chi-square with one degree of freedom.  The strongest cause is named, undone, and the rest is looked at again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from crosscheck.identification.fit import Fit, Problem, jacobian, problem
from crosscheck.identification.log import Log
from crosscheck.identification.parameters import Space, space
from crosscheck.identification.readings import Machine, delayed, make_run, measured_of
from crosscheck.measured.filters import low_pass
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]
# Drop of the cost that chance does not give: beyond 12 it is one in two thousand for each cause that is asked for.
EVIDENCE = 12.0
FOLLOWED = 3  # steps on the way to a size
LARGEST = 4  # causes named at most


@dataclass(frozen=True)
class Cause:
    """A fault with one number: its name, where, unit and step of phi, and the log and mechanism with the fault phi undone.

    moves : the model's side changes with it, too, and not only what an effort column says
    """

    name: str
    place: str
    unit: str
    step: float
    undone: Callable[[Log, Mechanism, float], tuple[Log, Mechanism]]
    moves: bool = True


@dataclass(frozen=True)
class Named:
    """A cause with its size and its standard error [unit], and the drop of the cost that speaks for it [-]."""

    name: str
    place: str
    unit: str
    size: float
    error: float
    drop: float

    @property
    def words(self) -> str:
        """The cause as a sentence [-]."""
        return f"{self.name} of {self.place}: {self.size:.4g} +- {self.error:.2g} {self.unit} (cost falls by {self.drop:.0f})"


def _column(log: Log, name: str, change: Callable[[Array], Array]) -> Log:
    return replace(log, columns={**log.columns, name: change(log.columns[name])})


def dictionary(machine: Machine) -> Iterator[Cause]:
    """Yield all causes with one number that are possible here: phi = 0 is no fault [unit of each]."""

    def shifted(column: str) -> Callable[[Log, Mechanism, float], tuple[Log, Mechanism]]:
        return lambda log, m, phi: (_column(log, column, lambda v: delayed(v, log.spacing, -phi)), m)

    def scaled(column: str) -> Callable[[Log, Mechanism, float], tuple[Log, Mechanism]]:
        return lambda log, m, phi: (_column(log, column, lambda v: v / (1.0 + phi)), m)

    def unlagged(column: str) -> Callable[[Log, Mechanism, float], tuple[Log, Mechanism]]:
        return lambda log, m, phi: (_column(log, column, lambda v: _undo_lag(v, log.spacing, phi, machine)), m)

    for channel in machine.channels:
        if channel.is_gauge:
            continue
        yield Cause("delay of the effort", channel.place, "s", 1e-3, shifted(channel.column), False)
        yield Cause("torque constant, relative error", channel.place, "-", 1e-3, scaled(channel.column), False)
        yield Cause("first-order lag of the effort", channel.place, "s", 1e-3, unlagged(channel.column), False)
    for name, table in machine.settings.joints.items():
        yield Cause("delay of the angle", name, "s", 1e-3, shifted(table.angle.column))
    if np.linalg.norm(machine.mechanism.gravity):
        for axis in range(2):
            yield Cause("tilt of gravity", f"the world's {'xy'[axis]} axis", "rad", 1e-3, _tilt(axis))
    for link in machine.mechanism.links:
        if link.beam is None and len(link.bodies) > 1:
            yield Cause(
                "payload beside what is known", f"{link.name}/{link.bodies[-1].name}", "kg", 0.1, _payload(link.name)
            )


def _tilt(axis: int) -> Callable[[Log, Mechanism, float], tuple[Log, Mechanism]]:
    def tilted(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        g = np.asarray(mechanism.gravity)
        turn = np.eye(3)[axis]
        return log, replace(mechanism, gravity=g * np.cos(phi) + np.cross(turn, g) * np.sin(phi))

    return tilted


def _payload(link: str) -> Callable[[Log, Mechanism, float], tuple[Log, Mechanism]]:
    """One more mass at the last body of a link; below 0 less of it."""

    def loaded(log: Log, mechanism: Mechanism, phi: float) -> tuple[Log, Mechanism]:
        more = Body("more", Inertia(phi, mechanism.link_of[link].bodies[-1].inertia.com))
        links = tuple(replace(k, bodies=(*k.bodies, more)) if k.name == link else k for k in mechanism.links)
        return log, replace(mechanism, links=links)

    return loaded


def _undo_lag(values: Array, spacing: float, constant: float, machine: Machine) -> Array:
    """x = y + T y' on the part of the signal that is compared (samples,) [any unit]."""
    smooth = low_pass(values, spacing, 2.0 * machine.settings.bandwidth_Hz)
    return np.asarray(values + constant * np.gradient(smooth, spacing))


def name_causes(machine: Machine, found: Fit, log: Log) -> list[Named]:
    """Return the causes that a log shows beside what was identified, the strongest first [unit of each].

    The parameters may move as far as their intervals allow; ``found`` may come from this log or from another one.
    """
    named: list[Named] = []
    causes = list(dictionary(machine))
    at = np.zeros(len(causes))
    for _ in range(LARGEST):
        best = _strongest(machine, found, log, causes, at, {c.name + c.place for c in named})
        if best is None:
            break
        k, one = best
        at[k] = one.size
        named.append(one)
    return sorted(named, key=lambda n: -n.drop)


def _task(machine: Machine, log: Log, causes: list[Cause], at: Array, level: Problem | None = None) -> Problem:
    """Return the log with faults undone; samples count, and motions are responded to, as in ``level`` where they may be."""
    mechanism, moves = machine.mechanism, level is None
    for cause, phi in zip(causes, at, strict=True):
        if phi:
            log, mechanism = cause.undone(log, mechanism, float(phi))
            moves = moves or cause.moves
    changed = Machine(mechanism, machine.settings, _carried(machine, mechanism))
    if level is None:
        return problem(changed, (make_run(changed, log),))
    run = make_run(changed, log) if moves else replace(level.runs[0], measured=measured_of(changed, log))
    return replace(level, machine=changed, runs=(run,))


def _carried(machine: Machine, mechanism: Mechanism) -> Space:
    """Parameters with mass properties about those of a changed mechanism."""
    return machine.space if mechanism is machine.mechanism else space(mechanism, machine.settings)


def _residual(task: Problem, z: Array) -> list[Array]:
    measured = task.pick([run.measured for run in task.runs if run.measured is not None])
    return [m - p for m, p in zip(measured, task.pick(task.predict(z)), strict=True)]


@dataclass(frozen=True)
class _Round:
    """A log under the causes named so far: residual and directions that the parameters cannot make up for."""

    machine: Machine
    log: Log
    causes: list[Cause]
    task: Problem
    z: Array
    weight: Array
    basis: Array

    def rest(self, at: Array) -> Array:
        """Return the weighed residual (rows,) [-] at sizes ``at`` of all causes, less what the parameters can make up for."""
        told = _residual(_task(self.machine, self.log, self.causes, at, self.task), self.z)
        r = np.concatenate([*(w * e for w, e in zip(self.weight, told, strict=True)), np.zeros(len(self.z))])
        return np.asarray(r - self.basis @ (self.basis.T @ r))


def _round(machine: Machine, found: Fit, log: Log, causes: list[Cause], at: Array) -> _Round:
    task = _task(machine, log, causes, at)
    weight = 1.0 / (found.spread * np.sqrt(found.agree))
    scaled = [w * j for w, j in zip(weight, jacobian(task, found.z), strict=True)]
    stacked = np.vstack([*scaled, np.linalg.cholesky(np.linalg.inv(found.covariance)).T])
    return _Round(machine, log, causes, task, found.z, weight, np.linalg.qr(stacked)[0])


def _strongest(
    machine: Machine, found: Fit, log: Log, causes: list[Cause], at: Array, known: set[str]
) -> tuple[int, Named] | None:
    here = _round(machine, found, log, causes, at)
    level = here.rest(at)
    best: tuple[int, float, float] | None = None
    for k, cause in enumerate(causes):
        if cause.name + cause.place in known:
            continue
        slope = (here.rest(at + cause.step * np.eye(len(at))[k]) - level) / cause.step
        square = float(slope @ slope)
        if square <= 0.0:
            continue
        drop = float(slope @ level) ** 2 / square
        if drop > EVIDENCE and (best is None or drop > best[1]):
            best = k, drop, -float(slope @ level) / square
    return None if best is None else _sized(here, at, best)


def _sized(here: _Round, at: Array, best: tuple[int, float, float]) -> tuple[int, Named]:
    """Follow the size of the strongest cause where it is not linear: Gauss and Newton in one number."""
    k, drop, size = best
    cause, one = here.causes[k], np.eye(len(at))[k]
    for _ in range(FOLLOWED):
        level = here.rest(at + size * one)
        slope = (here.rest(at + (size + cause.step) * one) - level) / cause.step
        square = float(slope @ slope)
        size -= float(slope @ level) / square
    return k, Named(cause.name, cause.place, cause.unit, size, 1.0 / np.sqrt(square), drop)
