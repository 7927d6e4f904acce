"""Spectra of random mechanisms against an own dense reference, and of a few others against closed forms.

    python campaigns/spectra.py                      # 200 mechanisms with seed 1, and the closed forms; some minutes
    python campaigns/spectra.py --count 20 --seed 7
    python campaigns/spectra.py --only 41            # one of them, with its roots

Of each mechanism (`spectra_machines`) everything that `flexinv` says about its small motions is held against the roots of
`spectra_reference`: `steady_modes`, `natural_modes` where nothing turns, the poles of `linear_model`, few modes of it, and
`stable` of `statics`.  A root is right where it is that of the reference to 1e-8 times its condition number, or to its own error
bar of rounding and as much of the reference.  All roots count: one that is missed or invented is wrong.

    right      all that is said
    refused    no rest position, nothing that moves, no steady motion: the words are printed, and another is drawn (where
               `linear_model` alone refuses, as the rate of an effort would be an input, the other verbs are judged)
    lost       a verb says that it has lost a root, or cannot prove that it has all: the words are printed
    wrong      what differs is printed

The command ends with 1 where one is wrong or lost.  Of those that are judged it says how many have a warning that
a count is not proved, and how many a bar so wide that it leaves no digit of a root that the reference knows.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
import scipy

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    sys.path.insert(0, str(Path(__file__).resolve().parent))

from spectra_closed_forms import closed_forms
from spectra_machines import DrawnMachine, drawn
from spectra_reference import Residual, Spectrum, pencil_of, spectrum_of

import flexinv
from flexinv.dynamics.initial_state import compute_joint_motion
from flexinv.errors import ConvergenceError, FlexinvError, InputError
from flexinv.linearized import linear_model as linear
from flexinv.linearized import steady_modes as steady
from flexinv.linearized.linear_model import linear_model
from flexinv.linearized.modes import resolve_setup
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.steady_modes import steady_modes
from flexinv.typing import Array, Complex

PART = 1e-8  # of the condition number
# A motion without inertia that moves so many times faster than all that has inertia is one that follows: it may be left out.
BEYOND = 1e6
# Poles of few modes are eigenvalues of A as a whole: those below this part of the largest are rounding of it.
OF_LARGEST = 1e-9
FEW = 3  # modes of a small model
# Words of the one refusal of `linear_model` that says nothing about the motions: its inputs would be rates of efforts.
UNWRITTEN = "its rate would be an input"
# Words of the errors that say that roots are lost, or may be, and of the warning that a count is not proved.
LOST = ("are lost, or there twice", "is not proved", "are missed")
UNPROVED = "is not proved"
# What the command counts beside: mechanisms with that warning, and those with a bar that leaves no digit.
UNPROVED_COUNT = "counts not proved"
WIDE = "wide bars"
NO_DIGIT = 0.1
FAILS = ("wrong", "lost")
MOST_DRAWS = 5  # for each mechanism that is asked for


@dataclass(frozen=True)
class Outcome:
    """What became of a mechanism: right, refused, lost or wrong, and what was said.

    worst : its largest difference over what is allowed [-]
    has : what it has, and what is to be known of its roots
    """

    number: int
    word: str
    said: str
    worst: float = 0.0
    has: tuple[str, ...] = ()


def reference_of(one: DrawnMachine, rates: dict[str, float], free: tuple[str, ...], damped: bool = True) -> Spectrum:
    """Return the dense spectrum [1/s] of a mechanism where `flexinv` has found that it stands or turns."""
    mesh, at, names = resolve_setup(one.mechanism, None, free, None)
    motion = steady.build_steady_motion(mesh, at, rates, set(names))
    every = steady.add_coupled_rates(mesh, rates)
    qd = np.zeros(mesh.mechanism.nv)
    for name, rate in every.items():
        qd[mesh.mechanism.v_slices[name]] = rate
    joints = compute_joint_motion(mesh, at, qd, np.zeros_like(qd))
    turning = steady._build_turning(motion.solver, every, 1.0)
    pencil = pencil_of(Residual(motion.solver, joints, turning))
    if not damped:
        pencil = replace(pencil, damping=np.zeros_like(pencil.damping))
    return spectrum_of(pencil)


def judged(one: DrawnMachine, number: int) -> Outcome:
    """Return what becomes of a mechanism: all that is said about its small motions against the reference [1/s]."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            modes = steady_modes(one.mechanism, None, one.rates, one.free)
        except FlexinvError as refused:
            return Outcome(number, name_refusal(refused), str(refused), has=one.features)
        exact = reference_of(one, one.rates, modes.free)
        try:
            said = dict(_spoken(one, modes, exact))
        except FlexinvError as refused:
            return Outcome(number, name_refusal(refused), str(refused), has=one.features)
    has = one.features
    if any(UNPROVED in str(warning.message) for warning in heard):
        has = (*has, UNPROVED_COUNT)
    if are_wide(modes.root, modes.rounding, exact):
        has = (*has, WIDE)
    wrong = [f"{verb}: {words}" for verb, (words, _) in said.items() if words]
    worst = max(ratio for _, ratio in said.values())
    return Outcome(number, "wrong" if wrong else "right", "; ".join(wrong), worst, has)


def name_refusal(refused: FlexinvError) -> str:
    """Return "lost" for an error that says that roots are lost, "refused" for all others."""
    is_lost = isinstance(refused, ConvergenceError) and any(words in str(refused) for words in LOST)
    return "lost" if is_lost else "refused"


def are_wide(root: Complex, bars: Array, exact: Spectrum) -> bool:
    """Return True where a bar [1/s] leaves no digit of a root that the reference knows: such a root is always right.

    A zero of both has no size of its own: its bar is measured against the slowest root that is none.
    """
    known = exact.near(root, PART)
    size = np.abs(root)
    is_zero = (size == 0.0) & (np.abs(root[:, None] - exact.root[None]).min(axis=1, initial=np.inf) <= known)
    if is_zero.any() and not is_zero.all():
        size[is_zero] = size[~is_zero].min()
    return bool((bars > np.maximum(NO_DIGIT * size, known)).any())


def _spoken(one: DrawnMachine, found: steady.SteadyModes, exact: Spectrum) -> Iterator[tuple[str, tuple[str, float]]]:
    """Yield each verb with what is wrong in words, and its largest difference."""
    yield "steady_modes", compared(_with_twins(found.root), np.real(_with_twins(found.root, found.rounding)), exact)
    if not one.rates:
        still = natural_modes(one.mechanism, None, one.free)
        root = np.concatenate([still.root, -still.root])
        lost = np.abs(still.root)
        bars = np.minimum(still.rounding / np.maximum(2 * lost, np.finfo(float).tiny), np.sqrt(still.rounding))
        yield "natural_modes", compared(root, np.tile(bars, 2), reference_of(one, {}, found.free, damped=False))
    try:
        model = linear_model(one.mechanism, None, one.rates, found.free)
    except InputError as refused:
        if UNWRITTEN not in str(refused):
            raise
        yield from _stable(one)
        return
    yield "linear_model", compared(model.poles, linear.compute_poles(model.A, model.left_out)[1], exact)
    few = linear_model(one.mechanism, None, one.rates, found.free, modes=FEW)
    if few.notes:
        slow = found.root[:FEW]
        apart = np.abs(slow[:, None] - few.poles[None]).min(axis=1, initial=np.inf)
        allowed = found.rounding[:FEW] + OF_LARGEST * np.abs(few.poles).max(initial=0.0) + exact.near(slow, PART)
        worst = float((apart / allowed).max(initial=0.0))
        yield "few modes", (f"poles off by {apart.max():.2g} 1/s" if worst > 1.0 else "", worst)
    yield from _stable(one)


def _stable(one: DrawnMachine) -> Iterator[tuple[str, tuple[str, float]]]:
    """Yield whether `statics` has the word for all joints held."""
    if one.rates or one.mechanism.is_rigid or one.mechanism.closures:
        return
    exact = reference_of(one, {}, ())
    sure = exact.bars(PART)
    grows, holds = bool((exact.root.real > sure).any()), bool((exact.root.real < -sure).all())
    word = flexinv.statics(one.mechanism).stable
    if grows and word:
        yield "statics", (f"stable, but a root is {exact.root[exact.root.real.argmax()]:.6g} 1/s", 2.0)
    elif holds and not word:
        yield "statics", ("unstable, but all roots decay", 2.0)
    else:
        yield "statics", ("", 0.0)


def _with_twins(root: Complex, values: Complex | Array | None = None) -> Complex:
    """All roots of a list with one of each pair, or values that belong to them."""
    own = root if values is None else values
    return np.concatenate([own, np.conj(own[root.imag > 0.0])])


def compared(found: Complex, bars: Array, exact: Spectrum) -> tuple[str, float]:
    """Return what is wrong about roots [1/s] in words, and their largest difference over what is allowed [-]."""
    beyond = BEYOND * exact.fastest
    must = np.flatnonzero(np.abs(exact.root) <= beyond)
    if len(found) < len(must) or len(found) > len(exact.root):
        return f"{len(found)} roots, expected {len(must)}", np.inf
    allowed = np.real(bars)[:, None] + exact.bars(PART)[None]
    ratio = np.abs(found[:, None] - exact.root[None]) / np.maximum(allowed, np.finfo(float).tiny)
    capped = np.minimum(ratio, 1e6)
    capped[:, np.abs(exact.root) > beyond] = np.minimum(capped[:, np.abs(exact.root) > beyond], 1e6) + 1e3
    rows, columns = scipy.optimize.linear_sum_assignment(capped)
    inside = np.abs(exact.root[columns]) <= beyond
    if inside.sum() < len(must):
        return f"{len(must) - inside.sum()} of {len(must)} roots are missing", np.inf
    worst = float(ratio[rows, columns].max(initial=0.0))
    if worst <= 1.0:
        return "", worst
    k = int(ratio[rows, columns].argmax())
    ours, theirs = found[rows[k]], exact.root[columns[k]]
    off = allowed[rows[k], columns[k]]
    return f"{ours:.10g} 1/s, expected {theirs:.10g} within {off:.2g}", worst


def run(count: int, seed: int) -> Iterator[Outcome]:
    """Yield outcomes until ``count`` [-] mechanisms are judged."""
    done = 0
    for number in range(MOST_DRAWS * count):
        if done == count:
            return
        outcome = judged(drawn(seed, number), number)
        done += outcome.word != "refused"
        yield outcome


@click.command()
@click.option("--count", default=200, help="Number of mechanisms that are judged.")
@click.option("--seed", default=1, help="Seed of the mechanisms.")
@click.option("--only", type=int, help="One mechanism alone, by its number.")
def main(count: int, seed: int, only: int | None) -> None:
    """Hold spectra of random mechanisms against a dense reference, and closed forms."""
    if only is not None:
        one = drawn(seed, only)
        click.echo(", ".join(one.features))
        outcome = judged(one, only)
        click.echo(f"{outcome.word} {outcome.said} (largest difference {outcome.worst:.2g} of what is allowed)")
        raise SystemExit(int(outcome.word in FAILS))
    tally, has, worst = Counter[str](), Counter[str](), 0.0
    for outcome in run(count, seed):
        tally[outcome.word] += 1
        if outcome.word != "refused":
            has.update(outcome.has)
            worst = max(worst, outcome.worst)
        if outcome.word != "right":
            repeat = f"python campaigns/spectra.py --seed {seed} --only {outcome.number}"
            click.echo(f"{outcome.number} {outcome.word}: {outcome.said} ({', '.join(outcome.has)})  {repeat}")
    click.echo(
        ", ".join(f"{n} {word}" for word, n in tally.most_common())
        + f"; largest difference {worst:.2g} of what is allowed"
    )
    click.echo("with " + ", ".join(f"{word} {n}" for word, n in has.most_common()))
    wrong = sum(tally[word] for word in FAILS)
    for name, off, allowed in closed_forms():
        wrong += off > allowed
        click.echo(f"{'wrong' if off > allowed else 'right'}  {name}: off by {off:.2g}, allowed {allowed:.2g}")
    raise SystemExit(int(wrong > 0))


if __name__ == "__main__":
    main()
