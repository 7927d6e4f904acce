"""Coupled motors: an effort that follows the rates of two joints, as the motors of many wrists do.

The motor of joint j turns by q_j + c q_k: its friction and rotor follow both rates, and the motor of joint k carries c times
less of the effort of joint j, as the power is the same (`efforts`).  First it is asked whether the rate of joint k in effort j,
and the effort of joint j in effort k, tell parts of the logs that were left out better (`evidence`).  Where they do, readings
with c of a grid are tried, and the machine is identified anew with c free from the best of them.  A coupling is named if that
leaves less of the blocks left out, and c is told to a part of itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from crosscheck.identification.drives.evidence import EVIDENCE, TermEvidence, Terms, compute_columns, judge_term
from crosscheck.identification.estimation.fit import Fit, build_problem, fit
from crosscheck.identification.machine import Channel, Machine, has_friction
from crosscheck.identification.parameters import COUPLING, build_space
from crosscheck.identification.readings import Run, compute_raw_signals
from crosscheck.identification.settings import FreeTable
from flexinv.typing import Array

TRIED = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0)  # sizes of c on both sides of 0
TOLD = 0.2  # of itself: the standard error of a coupling that is named
WIDE = 1.0  # prior of c [-]: motors turn some tenths to once with the other joint
NORMAL = 1.6448536269514722  # half width of a 90 % interval, in standard deviations


@dataclass(frozen=True)
class MotorCoupling:
    """A motor that follows a second joint: by how much, with a 90 % interval [-], and gain of the logs left out [-]."""

    joint: str
    other: str
    factor: float
    low: float
    high: float
    gain: float

    @property
    def words(self) -> str:
        """The same in a sentence [-]."""
        return (
            f"the motor of {self.joint} follows {self.other}, too: it turns with {self.joint} {self.factor:+.4g} {self.other} "
            f"(90 %: {self.low:.4g} to {self.high:.4g}; log likelihood of parts left out {self.gain:+.1f}); write "
            f"follows = {{ {self.other} = {self.factor:.4g} }} into [joints.{self.joint}] of identify.toml, "
            f'and a table [[free]] with parameter = "{COUPLING}" and error = {max(self.high - self.low, 1e-6):.2g}'
        )


def find_couplings(terms: Terms) -> list[MotorCoupling]:
    """Return the motors that follow a second joint [-], the most evident first; those that identify.toml states are known."""
    machine = terms.machine
    drives = {channel.place: channel for channel in machine.channels if has_friction(machine, channel)}
    found = []
    for joint, other in permutations(machine.settings.joints, 2):
        stated = other in machine.settings.joints[joint].follows or joint in machine.settings.joints[other].follows
        if joint in drives and not stated and _is_suspect(terms, drives[joint], other, drives.get(other)):
            best = _find_best_factor(terms, joint, other)
            one = _fit_coupling(terms, joint, other, best) if best is not None else None
            found += [one] if one is not None else []
    return sorted(found, key=lambda one: -one.gain)[: len(drives) // 2]


def _is_suspect(terms: Terms, channel: Channel, other: str, beside: Channel | None) -> bool:
    """Return True where rate and acceleration of another joint, and the effort that its motor is spared, are told by the logs."""

    def compute_signals(run: Run) -> Array:
        machine = terms.machine
        k = run.motion.names.index(other)
        j = run.motion.names.index(channel.place)
        shown_in = machine.channels.index(channel)
        out = np.zeros((len(run.time), len(machine.channels), 3))
        out[:, shown_in, 0] = run.motion.qd[:, k] / channel.ratio
        out[:, shown_in, 1] = np.tanh(run.motion.qd[:, k] / machine.settings.still_rad_per_s) / channel.ratio
        if beside is not None:
            values = machine.space.compute_values(terms.z[: len(machine.space.parameters)], run.load)
            out[:, machine.channels.index(beside), 2] = run.response(values)[0][:, j] / beside.ratio
        return out

    return judge_term(terms, compute_columns(terms, compute_signals)).is_told


def _add_coupling(machine: Machine, joint: str, other: str, factor: float, free: bool = False) -> Machine:
    """The machine whose motor of a joint follows another one, too [-]."""
    columns = machine.settings.joints[joint]
    joints = {
        **machine.settings.joints,
        joint: columns.model_copy(update={"follows": {**columns.follows, other: factor}}),
    }
    settings = machine.settings.model_copy(update={"joints": joints})
    if not free:
        return replace(machine, settings=settings)
    coupling = FreeTable(parameter=COUPLING, place=[f"{joint}/{other}"], error=WIDE)
    wider = settings.model_copy(update={"free": [*settings.free, coupling]})
    return Machine(machine.mechanism, wider, build_space(machine.mechanism, wider, machine.space.loads))


def _find_best_factor(terms: Terms, joint: str, other: str) -> float | None:
    """The factor of the grid that speaks loudest for itself, None where none does."""
    best: tuple[float, float] | None = None
    for factor in (side * size for size in TRIED for side in (1.0, -1.0)):
        evidence = _judge_factor(terms, joint, other, factor)
        if evidence.is_told and evidence.sizes[0] > 0.0 and (best is None or evidence.gain > best[0]):
            best = evidence.gain, factor
    return None if best is None else best[1]


def _judge_factor(terms: Terms, joint: str, other: str, factor: float) -> TermEvidence:
    changed = _add_coupling(terms.machine, joint, other, factor)

    def compute_signals(run: Run) -> Array:
        values = terms.machine.space.compute_values(terms.z[: len(terms.machine.space.parameters)], run.load)
        pair = [compute_raw_signals(one, run.motion, run.response, values) for one in (changed, terms.machine)]
        return np.asarray((pair[0] - pair[1])[:, :, None])

    return judge_term(terms, compute_columns(terms, compute_signals))


def _fit_coupling(terms: Terms, joint: str, other: str, factor: float) -> MotorCoupling | None:
    """The coupling with its interval, by a fit of all parameters; None where it leaves no less, or is not told."""
    machine = _add_coupling(terms.machine, joint, other, factor, free=True)
    before = _fit_anew(terms, terms.machine)
    after = _fit_anew(terms, machine)
    k = [one.key for one in machine.space.parameters].index((COUPLING, f"{joint}/{other}"))
    value = machine.space.parameters[k].compute_value(float(after.z[k]))
    half = NORMAL * machine.space.parameters[k].error * float(np.sqrt(after.covariance[k, k]))
    counted = [len(r) for r in terms.residuals]
    gain = 0.5 * float(sum(np.array(counted) / after.agree * np.log((before.block / after.block) ** 2)))
    if gain < EVIDENCE or half > NORMAL * TOLD * abs(value):
        return None
    return MotorCoupling(joint, other, value, value - half, value + half, gain)


def _fit_anew(terms: Terms, machine: Machine) -> Fit:
    """The parameters of a machine by all logs, as if they were of one day."""
    task = terms.task
    return fit(build_problem(machine, task.runs, task.chosen), _find_start(terms, machine))


def _find_start(terms: Terms, machine: Machine) -> Array:
    """The z [-] of the parameters that were found, 0 of those that are new."""
    known = dict(zip([one.key for one in terms.machine.space.parameters], terms.z, strict=False))
    return np.array([known.get(one.key, 0.0) for one in machine.space.parameters])


def list_coupling_words(found: list[MotorCoupling]) -> Iterator[str]:
    """Yield the couplings in words [-]."""
    yield from (one.words for one in found)
