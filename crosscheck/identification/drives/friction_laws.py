"""Laws of friction: Coulomb and viscous friction for every drive, and beside them what the logs speak for (`evidence`).

Stribeck        share exp(-(v / v_s)^2) of the dry friction more where a joint begins to slide, v_s of a grid
load            a part of the load that the gear carries: worms, bearings
quadratic       |v| v; below 0 a grease that thins where it is sheared
asymmetric      more friction one way than the other
per kelvin      of viscous and of dry friction, where a temperature is logged

What gains most is believed first, the others are then judged beside it.  A term that is free in identify.toml is judged by what
the logs left out lose without it.

Source: A. Bittencourt, S. Gunnarsson, "Static friction in a robot joint: modeling and identification of load and temperature
effects", J. Dynamic Systems, Measurement and Control 134 (2012).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.identification.drives.evidence import (
    TermEvidence,
    Terms,
    add_columns,
    compute_columns,
    drop_parameter,
    judge_term,
)
from crosscheck.identification.machine import Machine, has_friction, resolve_value
from crosscheck.identification.parameters import KINDS, Key, Values
from crosscheck.identification.readings import Run, compute_raw_signals
from crosscheck.identification.settings import FreeTable
from flexinv.typing import Array

SHARE = "stribeck share"
TURN = "stribeck rate"
SLOWER = 3.0 ** np.arange(1, 6)  # Stribeck rates that are tried, in the rate below which a joint stands
MOST = 3  # terms of a joint
STEP = 1e-3  # of the derivatives by a size: readings are linear in all but those per kelvin, which are small
# Term -> kind of its parameter, in the order in which they are told.
KINDS_OF_TERMS = {
    "Stribeck": SHARE,
    "load": "load friction",
    "quadratic": "quadratic friction",
    "asymmetric": "friction asymmetry",
    "viscous per kelvin": "viscous friction per kelvin",
    "dry per kelvin": "coulomb friction per kelvin",
}
WIDER = 2.0  # times its size and error: how wide the prior of a term is that the logs speak for


@dataclass(frozen=True)
class FrictionTerm:
    """A term of friction of a joint: parameters that make it, its size with unit, whether it is free, and what speaks for it.

    others : values [unit of each] of parameters beside its own, of Stribeck's the rate
    """

    joint: str
    term: str
    kind: str
    others: Values
    unit: str
    size: float
    free: bool
    evidence: TermEvidence
    chosen: bool

    @property
    def words(self) -> str:
        """The evidence in words [-]."""
        what = "left out are told better" if self.evidence.gain > 0.0 else "left out are told no better"
        return f"parts of the logs {what}: log likelihood {self.evidence.gain:+.1f} ± {self.evidence.error:.1f}"


def choose_friction_laws(terms: Terms) -> list[FrictionTerm]:
    """Return all terms of friction that were tried [unit of each], joint by joint, those that the logs speak for as chosen."""
    machine = terms.machine
    joints = [channel.place for channel in machine.channels if has_friction(machine, channel)]
    return [one for joint in joints for one in _choose_law(terms, joint)]


def list_free_tables(found: list[FrictionTerm]) -> list[FreeTable]:
    """Return the tables [[free]] [unit of each] of the chosen terms that are not free yet."""
    out = []
    for one in found:
        if one.chosen and not one.free:
            wide = WIDER * (abs(one.size) + float(one.evidence.errors[0]))
            out.append(FreeTable(parameter=one.kind, place=[one.joint], error=wide))
            for (kind, place), value in one.others.items():
                out.append(FreeTable(parameter=kind, place=[place], value=value, relative=0.5))
    return out


def _choose_law(terms: Terms, joint: str) -> Iterator[FrictionTerm]:
    """The terms of a joint: those that are free, then those chosen, then all others."""
    free = {one.kind for one in terms.machine.space.parameters if one.place == joint}
    yield from (_judge_free_term(terms, joint, name, kind) for name, kind in KINDS_OF_TERMS.items() if kind in free)
    open_ = [
        name for name, kind in KINDS_OF_TERMS.items() if kind not in free and _is_possible(terms.machine, kind, joint)
    ]
    here = terms
    for _ in range(MOST):
        tried = {name: _find_best_term(here, joint, name) for name in open_}
        best = max(tried, key=lambda name: tried[name][0].evidence.gain, default="")
        if not best or not tried[best][0].evidence.is_told:
            break
        one, columns = tried[best]
        yield replace(one, chosen=True)
        here = add_columns(here, columns)
        open_.remove(best)
    yield from (_find_best_term(here, joint, name)[0] for name in open_)


def _is_possible(machine: Machine, kind: str, joint: str) -> bool:
    return KINDS[kind].places != "warm drive" or machine.settings.joints[joint].temperature is not None


def _judge_free_term(terms: Terms, joint: str, name: str, kind: str) -> FrictionTerm:
    """A term that is free, judged by what is lost without it."""
    space = terms.machine.space
    k = [one.key for one in space.parameters].index((kind, joint))
    one = space.parameters[k]
    absent = -one.known / one.error
    columns = [j[:, k : k + 1] / one.error for j in terms.slopes]
    evidence = judge_term(drop_parameter(terms, k, absent), columns)
    value = one.compute_value(float(terms.z[k]))
    beside = replace(evidence, sizes=np.array([value]))
    return FrictionTerm(joint, name, kind, {}, one.unit, value, True, beside, evidence.is_told)


def _find_best_term(terms: Terms, joint: str, name: str) -> tuple[FrictionTerm, list[Array]]:
    """A term that is not free, as it is told best, and its columns."""
    kind = KINDS_OF_TERMS[name]
    slides = terms.machine.mechanism.joint_of[joint].kind == "prismatic"
    best: tuple[FrictionTerm, list[Array]] | None = None
    for others in _list_places_of_bump(terms, joint) if kind == SHARE else [{}]:
        columns = _compute_term_columns(terms, (kind, joint), others)
        evidence = judge_term(terms, columns)
        size = float(evidence.sizes[0])
        one = FrictionTerm(joint, name, kind, others, KINDS[kind].unit[slides], size, False, evidence, False)
        if best is None or evidence.gain > best[0].evidence.gain:
            best = one, columns
    assert best is not None
    return best


def _list_places_of_bump(terms: Terms, joint: str) -> list[Values]:
    """Stribeck rates that are tried, from that below which a joint stands to its largest one."""
    at = terms.task.runs[0].motion.names.index(joint)
    most = max(float(np.abs(run.motion.qd[:, at]).max()) for run in terms.task.runs)
    rates = terms.machine.settings.still_rad_per_s * SLOWER
    return [{(TURN, joint): float(rate)} for rate in rates if rate < most] or [{(TURN, joint): float(rates[0])}]


def _compute_term_columns(terms: Terms, key: Key, others: Values) -> list[Array]:
    """The columns (counted, 1) [-] of a term at values of other parameters [unit of each]."""
    return compute_columns(terms, lambda run: _compute_slope(terms, run, key, others))


def _compute_slope(terms: Terms, run: Run, key: Key, others: Values) -> Array:
    """Derivative of the signals of a run (samples, channels, 1) by the size of a term [units of the channels over its own]."""
    machine = terms.machine
    count = len(machine.space.parameters)
    values: Mapping[Key, float] = machine.space.compute_values(terms.z[:count], run.load) | others
    size = resolve_value(machine, values, *key)
    pair = [
        compute_raw_signals(machine, run.motion, run.response, {**values, key: size + step}) for step in (0.0, STEP)
    ]
    return np.asarray((pair[1] - pair[0])[:, :, None] / STEP)


def join_chosen_terms(terms: Terms, more: list[FrictionTerm]) -> Terms:
    """Return the residuals [-] with further terms as parameters that nothing holds."""
    for one in more:
        terms = add_columns(terms, _compute_term_columns(terms, (one.kind, one.joint), one.others))
    return terms
