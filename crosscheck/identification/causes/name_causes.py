"""Naming of causes: signals that are no signals first, gross faults then, and what may be small by its evidence.

With dr/dphi beside the Jacobian of the parameters, which move as far as their intervals allow, the best phi of a small cause is

phi = -(d . r) / (d . d),   drop = sum_c n_c log(|r_c|^2 at 0 / |r_c|^2 at phi)

d, r : dr/dphi and r less what the parameters can make up for

n_c samples of news of channel c, so that chance makes drop chi-square with one degree of freedom, however large the residual is.
The strongest ones are followed to their optimum, the best is named and undone, and the rest is looked at again.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are asked for

from crosscheck.identification.causes.cause import Cause, NamedCause
from crosscheck.identification.causes.detection_limits import DetectionLimit, find_least_sizes
from crosscheck.identification.causes.dictionary import list_possible_causes
from crosscheck.identification.causes.encoders import compare_encoders
from crosscheck.identification.causes.gear_faults import list_play_causes, list_ripple_causes
from crosscheck.identification.causes.gross_faults import GrossFault, Score, compute_score, list_gross_faults
from crosscheck.identification.causes.rounds import CauseRound, CauseSearch, replace_cause
from crosscheck.identification.causes.shapes import list_shape_causes
from crosscheck.identification.causes.signals import (
    find_clipped_samples,
    list_broken_columns,
    list_clipped_columns,
    list_quantised_columns,
)
from crosscheck.identification.estimation.fit import Problem, compute_jacobian
from crosscheck.identification.identify import Identification
from crosscheck.identification.logs.log import Log
from crosscheck.identification.machine import Channel
from flexinv.errors import ConvergenceError, InputError
from flexinv.typing import Array

# Drop of the cost that chance does not give: 12 is one in two thousand for one cause, and of all that are asked for together
# chance names one in so many logs.
EVIDENCE = 12.0
CHANCE = 1.0 / 200.0
LITTLE = 0.4  # of a signal: a gross fault leaves less unexplained
FOLLOWED = 4  # steps on the way to a size
ASKED = 2.0  # least drop of the linear estimate, which a large fault makes small: without it a log takes a tenth longer
NEAREST = 6  # causes that are followed: at phi = 0 some are alike, a delay and a lag above all
ALIKE = 4.0  # of drops that differ by less than this neither is the better one: the first of the dictionary is named
# RMS of a channel over that of blocks left out, below which no rare cause is asked for what is left of it: noise has as much.
QUIET = 1.0
LARGEST = 4  # causes named at most
# Faults at once, beside friction that is another on another day: rows 169, 316 and 319 of
# campaigns/log_faults named three, among them wrong ones.
TOGETHER = 2
REACH = 3.0  # widths of what is known of a place, beyond which none is looked for
SPOT_STEP = 1e-3  # of its derivatives: of a size in parts of the first one, of a place in those widths
PLACED = 12  # steps on the way to it
MOVED = 2  # more steps then, as the weights by which it was found were those of a log that has the cause
FINE = 1e-3  # relative change of the cost, and of a place in those widths, at which it is found
PART = 0.2  # of the largest drop: a further cause that explains less is what the first one leaves, linear as it is
REMAINDER = 0.01  # of the square of what another cause does: what does less stands for what that one's law leaves
SURE = 3.0  # standard errors that a size has to be from 0
UNKNOWN = "no cause that is known"


@dataclass(frozen=True)
class CauseFindings:
    """Causes of a log, the most certain first, and the least sizes of those not named that it would show.

    untold : what two encoders of a joint cannot tell, in words
    """

    named: list[NamedCause]
    least: list[DetectionLimit]
    untold: list[str]


def find_causes(known: Identification, log: Log, seen: bool = False) -> list[NamedCause]:
    """Return the causes that a log shows beside what was identified [unit of each], the most certain first.

    seen : the parameters come from this very log, `find_remaining_causes`
    """
    return find_remaining_causes(known, log, seen, hidden=False).named


def find_remaining_causes(known: Identification, log: Log, seen: bool = False, hidden: bool = True) -> CauseFindings:
    """Return the causes that a log shows beside what was identified, and what it cannot show [unit of each].

    hidden : the least sizes are looked for, too
    seen : the parameters come from this very log: a gross fault has spoiled them, and is looked for under what was known before.
        What may be small is looked for beside the parameters as they are: under less, what was wrongly known looks like a fault
    """
    machine = known.machine
    found = known.choose_fit(log)
    before = () if seen else known.task.runs
    search = CauseSearch(machine, found, find_clipped_samples(machine, log), seen, before)
    broken = list(list_broken_columns(machine, found, log))
    named = [*broken, *list_clipped_columns(machine, log), *list_quantised_columns(machine, found, log)]
    for _ in range(LARGEST):
        one = _find_gross_fault(search, log)
        if one is None:
            break
        fault, told = one
        named.append(told)
        log = fault.undone(log, machine.mechanism, fault.size)[0]
    small, here, at = _find_small_causes(replace(search, seen=False), log)
    least = find_least_sizes(here, at, compute_evidence_threshold(here.causes)) if hidden else []
    if broken:  # which says why more than noise is left
        small = [one for one in small if one.name != UNKNOWN]
    encoders = compare_encoders(machine, found, log)
    return CauseFindings([*named, *small, *encoders.named], least, encoders.untold)


# ----------------------------------------------------------------------------------------------------- gross faults


Linear = tuple[list[Array], list[Array]]  # readings, and their slopes by the parameters


def _find_gross_fault(search: CauseSearch, log: Log) -> tuple[GrossFault, NamedCause] | None:
    mechanism = search.machine.mechanism
    level = search.build_task(log, mechanism)
    linear_readings = _compute_linear_readings(search, level)
    base = _compute_fault_score(search, level, linear_readings)
    best: tuple[GrossFault, Score] | None = None
    for fault in list_gross_faults(search.machine):
        at = _list_spoiled_channels(search, fault)
        if not at or base.unexplained[at].max() < LITTLE / 2.0:
            continue
        task = search.build_task(fault.undone(log, mechanism, fault.size)[0], mechanism, level, fault.moves)
        try:
            one = _compute_fault_score(
                search, task, _compute_linear_readings(search, task) if fault.moves else linear_readings
            )
        except ConvergenceError:  # nothing can follow this motion: beams would roll up along an angle in another unit
            continue
        better = one.unexplained[at].max() < LITTLE
        if better and base.value - one.value > EVIDENCE and (best is None or one.value < best[1].value):
            best = fault, one
    if best is None:
        return None
    fault, one = best
    before, after = (score.unexplained[_list_spoiled_channels(search, fault)].max() for score in (base, one))
    evidence = f"unexplained {before:.1%} as it is, {after:.1%} without it"
    return fault, NamedCause(fault.name, fault.place, fault.unit, fault.size, 0.0, base.value - one.value, evidence)


def _list_spoiled_channels(search: CauseSearch, fault: GrossFault) -> list[int]:
    return [k for k, c in enumerate(search.machine.channels) if c.place in fault.places]


def _compute_linear_readings(search: CauseSearch, task: Problem) -> Linear:
    z = np.zeros(len(search.fit.z)) if search.seen else search.fit.z
    return task.collect_counted_samples(task.predict(z)), compute_jacobian(task, z)


def _compute_fault_score(search: CauseSearch, task: Problem, linear: Linear) -> Score:
    measured = task.collect_counted_samples([run.measured for run in task.runs if run.measured is not None])
    return compute_score(measured, *linear, search.fit.agree, search.root)


# ---------------------------------------------------------------------------------------------- what may be small


def _find_small_causes(search: CauseSearch, log: Log) -> tuple[list[NamedCause], CauseRound, Array]:
    """Causes by their evidence, and the log under them with their sizes; where they leave more than noise, none is named."""
    values = search.machine.space.compute_values(search.fit.z)
    usual = list(list_possible_causes(search.machine, values))
    alone = CauseRound(search, log, usual, np.zeros(len(usual)), None)
    noisy = np.flatnonzero(alone.compute_levels() > QUIET).tolist()
    play = list_play_causes(search.machine, values, noisy)
    waves = list_ripple_causes(alone, alone.at, noisy)
    here = alone.add_causes([*play, *waves, *list_shape_causes(alone, values, noisy)])
    causes = list(here.causes)
    at = here.at.copy()
    named: dict[int, NamedCause] = {}
    first = here.compute_levels()
    while len(named) < LARGEST:
        best = _find_strongest_cause(here, at, {causes[k].kin or causes[k].name + causes[k].place for k in named})
        if best is None or best[1].drop < PART * max((other.drop for other in named.values()), default=0.0):
            break
        k, one = best
        if causes[k].make_at is not None:
            causes[k], size = _find_spot(here, at, k, one.size)
            one = replace(one, place=causes[k].place, size=size)
        at[k] = one.size
        named[k] = one
        here = CauseRound(search, log, causes, at, here.wide)
        together = 1 if len(named) > 1 else 0
        for _ in range(together if causes[k].make_at is None else MOVED):
            causes, at, _ = here.fit_named_sizes()
            here = CauseRound(search, log, causes, at, here.wide)
    return _list_sure_causes(here, at, named, first), here, at


def _list_sure_causes(here: CauseRound, at: Array, named: dict[int, NamedCause], first: Array) -> list[NamedCause]:
    """The causes with the sizes that they have together; one that says what is unknown where they do not do.

    first : `CauseRound.compute_levels` of the log as it is
    """
    errors = here.fit_named_sizes()[2]
    shown = _drop_remainders(here, named)
    found = _join_waves(
        [
            (here.causes[k], replace(one, place=here.causes[k].place, size=float(at[k]), error=float(errors[k])))
            for k, one in shown.items()
        ]
    )
    possible = all(here.causes[k].least < at[k] < here.causes[k].most for k in named)
    faults = {(here.causes[k].name, here.causes[k].place) for k in named if not here.causes[k].daily}
    few = len(faults) <= TOGETHER
    worst = (
        here.list_unexplained_channels(first, False)
        if possible and few
        else here.list_unexplained_channels(first, True)[:1]
    )
    if worst:
        return [_make_unknown_cause(channel, level, found) for channel, level in worst]
    return [one for one in found if abs(one.size) > SURE * one.error]


def _drop_remainders(here: CauseRound, named: dict[int, NamedCause]) -> dict[int, NamedCause]:
    """The named causes without those that do next to nothing beside another: they are what its law leaves."""
    effects = here.compute_named_effects()
    least = REMAINDER * max((effects[k] for k in named), default=0.0)
    return {k: one for k, one in named.items() if effects[k] >= least}


def _join_waves(found: list[tuple[Cause, NamedCause]]) -> list[NamedCause]:
    """The causes, of sine and cosine of a wave one with the amplitude (a^2 + b^2)^(1/2) [unit] and the larger error."""
    out: dict[tuple[str, ...], NamedCause] = {}
    for cause, one in found:
        key = (one.name, one.place) if cause.wave else (one.name, one.place, cause.kin)
        other = out.get(key)
        if other is not None:
            size = float(np.hypot(one.size, other.size))
            out[key] = replace(other, size=size, error=max(one.error, other.error), drop=one.drop + other.drop)
        else:
            out[key] = replace(one, size=abs(one.size)) if cause.wave else one
    return list(out.values())


def _make_unknown_cause(channel: Channel, level: float, nearest: list[NamedCause]) -> NamedCause:
    """The finding that no cause of the dictionary explains a channel: what comes nearest leaves ``level`` times the noise."""
    near = "; ".join(f"{one.name} of {one.place}, {one.size:.3g} {one.unit}" for one in nearest)
    words = "times the scatter of blocks left out remain" + (
        f"; nearest is {near}, which is not enough" if near else ""
    )
    return NamedCause(UNKNOWN, channel.name, "-", level, 0.0, 0.0, words)


def _find_strongest_cause(here: CauseRound, at: Array, known: set[str]) -> tuple[int, NamedCause] | None:
    level = here.compute_weighed_residual(at)
    first: list[tuple[float, int, float]] = []
    for k in _list_asked_causes(here, known):
        first += [(drop, k, size) for drop, size in _list_start_sizes(here, at, k, level) if drop > ASKED]
    chosen = _list_nearest_causes(here, first)
    tried = [_fit_possible_size(here, at, k, size, level) for k, size in chosen.items()]
    followed = [(k, one) for k, one in filter(None, tried) if _is_possible(here, k, one)]
    if not followed:
        return None
    most = max(_compute_cost_drop(here, *one) for one in followed)
    near = [one for one in followed if _compute_cost_drop(here, *one) >= most - ALIKE]
    alike = sorted(near, key=lambda one: (not _is_wave_of_named(here, one[0]), one[0]))
    k, likely = alike[0]
    others = [f"{one.name} of {one.place}, {one.size:.3g} {one.unit}" for _, one in alike[1:]]
    words = likely.evidence + (f"; next to as likely: {'; '.join(others)}" if others else "")
    return k, replace(likely, evidence=words)


def _list_asked_causes(here: CauseRound, known: set[str]) -> list[int]:
    """The causes that are not known by their texts; no rare one where it is quiet, but the other wave of one that is named."""
    quiet = _list_quiet_places(here)
    new = [k for k, cause in enumerate(here.causes) if (cause.kin or cause.name + cause.place) not in known]
    return [
        k for k in new if not here.causes[k].rare or here.causes[k].place not in quiet or _is_wave_of_named(here, k)
    ]


def _list_quiet_places(here: CauseRound) -> set[str]:
    """The places of causes that no rare one is asked for: a channel of which no more is left than noise, or all of them."""
    levels = here.compute_levels()
    places = {channel.place: level for channel, level in zip(here.search.machine.channels, levels, strict=True)}
    return {one.place for one in here.causes if places.get(one.place, levels.max()) < QUIET}


def _list_nearest_causes(here: CauseRound, first: list[tuple[float, int, float]]) -> dict[int, float]:
    """The causes that are followed and the size [unit] at which each begins: `NEAREST` usual and as many rare ones, of
    those that move the model's side, which are not linear, and of others.

    first : about how much the cost falls, cause, and size
    """
    start: dict[int, float] = {}
    kin: set[str] = set()
    for _, k, size in sorted(first, reverse=True):
        own = here.causes[k].kin
        if k not in start and own and own in kin:
            continue
        kin.add(own)
        start.setdefault(k, size)
    groups: dict[tuple[bool, bool], list[int]] = {}
    for k in start:
        cause = here.causes[k]
        groups.setdefault((cause.rare, cause.rare and cause.moves), []).append(k)
    return {k: start[k] for some in groups.values() for k in some[:NEAREST]}


def _fit_possible_size(
    here: CauseRound, at: Array, k: int, size: float, before: Array
) -> tuple[int, NamedCause] | None:
    """The cause at its best size; None where the way there leads to a log or a motion that cannot be."""
    try:
        return _fit_cause_size(here, at, k, size, before)
    except (InputError, ConvergenceError):
        return None


def _is_possible(here: CauseRound, k: int, one: NamedCause) -> bool:
    """Return true for a size that can be and has evidence."""
    evident = _compute_cost_drop(here, k, one) >= compute_evidence_threshold(here.causes)
    return evident and here.causes[k].least < one.size < here.causes[k].most


def _find_spot(here: CauseRound, at: Array, k: int, size: float) -> tuple[Cause, float]:
    """The cause k where it leaves least together with its size, and that [unit]; size : a first one [unit].

    What is known of the place holds it where the log tells nothing.
    """
    first = here.causes[k]
    assert first.make_at is not None
    make_at = first.make_at
    one = np.eye(len(at))[k]

    def compute_rest(x: Array) -> Array:
        causes = replace_cause(here.causes, k, make_at(tuple(x[1:].tolist())))
        return np.concatenate([here.compute_weighed_residual(at + x[0] * size * one, causes), x[1:]])

    def compute_slopes(x: Array) -> Array:
        level = compute_rest(x)
        return np.column_stack([(compute_rest(x + SPOT_STEP * way) - level) / SPOT_STEP for way in np.eye(len(x))])

    start = np.concatenate([[1.0], first.spot])
    reach = np.concatenate([[np.inf], np.full(len(first.spot), REACH)])
    try:
        found = scipy.optimize.least_squares(
            compute_rest, start, compute_slopes, (-reach, reach), ftol=FINE, xtol=FINE, max_nfev=PLACED
        )
    except (InputError, ConvergenceError):  # on the way to a better place lies a motion that cannot be
        return first, size
    return make_at(tuple(found.x[1:].tolist())), float(found.x[0] * size)


def compute_evidence_threshold(causes: Collection[Cause]) -> float:
    """Return the drop of the cost [-] that is evidence where so many causes are asked for; rare ones have to give more anyway."""
    usual = sum(not cause.rare for cause in causes)
    return max(EVIDENCE, float(scipy.stats.chi2.isf(CHANCE / usual, 1)))


def _compute_cost_drop(here: CauseRound, k: int, one: NamedCause) -> float:
    """The drop of the cost; what is rare or against nature has to explain more by as much as counts as evidence."""
    cause = here.causes[k]
    rare = cause.rare and not _is_wave_of_named(here, k)
    return one.drop - EVIDENCE * (rare or (cause.one_sided and one.size < 0.0))


def _is_wave_of_named(here: CauseRound, k: int) -> bool:
    """Tell whether a cause is the other wave of one that is named, and so no further one."""
    cause = here.causes[k]
    named = {(here.causes[n].name, here.causes[n].place) for n in here.named}
    return cause.wave and (cause.name, cause.place) in named


def _list_start_sizes(here: CauseRound, at: Array, k: int, level: Array) -> list[tuple[float, float]]:
    """Sizes of a cause at which the way to the best one may start, each with about how much the cost falls."""
    cause = here.causes[k]
    one = np.eye(len(at))[k]
    slope = (here.compute_weighed_residual(at + cause.step * one) - level) / cause.step
    square = float(slope @ slope)
    out = []
    if square > 0.0:
        out.append((float(slope @ level) ** 2 / square, -float(slope @ level) / square))
    out += _list_scanned_sizes(here, at, k, level)
    if here.wide and cause.tries:
        costs = [here.compute_cost_above(at + size * one) for size in cause.tries]
        best = int(np.argmin(costs))
        left = here.compute_weighed_residual(at + cause.tries[best] * one)
        out.append((float(level @ level - left @ left), cause.tries[best]))
    return out


def _list_scanned_sizes(here: CauseRound, at: Array, k: int, level: Array) -> list[tuple[float, float]]:
    """The best of the sizes at which a cause is looked at first, with how much the cost falls; none where no size can be."""
    one = np.eye(len(at))[k]
    out = []
    for size in here.causes[k].scanned:
        try:
            left = here.compute_weighed_residual(at + size * one)
        except ConvergenceError:  # nothing moves like that
            continue
        out.append((float(level @ level - left @ left), size))
    return [max(out)] if out else []


def _fit_cause_size(here: CauseRound, at: Array, k: int, size: float, before: Array) -> tuple[int, NamedCause]:
    """Follow the size of a cause where it is not linear: Gauss and Newton in one number."""
    cause = here.causes[k]
    one = np.eye(len(at))[k]
    square = 1.0
    for _ in range(FOLLOWED):
        level = here.compute_weighed_residual(at + size * one)
        slope = (here.compute_weighed_residual(at + (size + cause.step) * one) - level) / cause.step
        square = float(slope @ slope)
        if not square > 0.0:
            raise ConvergenceError(f"{cause.name} of {cause.place} does not show at a size of {size:g} {cause.unit}")
        size -= float(slope @ level) / square
    left = here.compute_weighed_residual(at + size * one)
    error = np.sqrt(float(left @ left) / float(here.news.sum()) / square)
    drop = here.drop(before, left)
    words = f"the cost falls by {drop:.0f}, to {left @ left / (before @ before):.0%} of what remained"
    return k, NamedCause(cause.name, cause.place, cause.unit, size, float(error), drop, words)
