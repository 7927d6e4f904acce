"""Campaign: what happens between samples, on random motions, against closed forms and dense sampling.

    python campaigns/between_samples.py [--count 100] [--seed 1] [--only KIND:NUMBER]

Cases of six kinds cross, touch or just miss what is looked for, at steps that see little of it:

    limit      random splines and laws on three joints; position and speed against a limit; judge: dense samples and SciPy's
               brentq and minimize_scalar on the motion alone
    four-bar   random links, a crank on a random spline; singular where coupler and rocker are in line, |A - A*| = 0 by the law
               of cosines; a parallelogram where the crank has no angle
    march      a four-bar as before that carries a beam, so that its rigid loop is marched
    slider     an offset slider-crank driven by its crank; singular where the rod is across the slide, r sin A + e = +- l
    five-bar   two cranks on random splines; singular where both couplers are in line
    spring     a pendulum's point passes a spring's other end: its length is zero, or small, for an instant

0 missed and 0 false: what passes or touches is named with its instant to 1e-9 s, in a march within a step, and what misses by
more than a millionth, in a march by more than a thousandth, is solved.
The program ends with 1 where one answer is wrong; each failure is printed with how to repeat it alone.  A share is a test.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import click
import numpy as np
import scipy

import flexinv
from flexinv.analysis.find_limits import find_limits
from flexinv.model.joints import Limits
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Beam,
    Body,
    Closure,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
    Section,
    Spring,
)

TIME_BAR = 1e-9
DENSE = 20_000
STEPS = (0.5, 0.2, 0.05, 0.01, 1.0 / 140.0, 1e-3)  # of a motion of one second
Random = np.random.Generator
Event = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Outcome:
    """What was expected of a case and what came, instants in seconds; None: nothing happens, or nothing was said."""

    kind: str
    number: int
    case: str
    expected: float | None
    found: float | None
    said: str = ""
    bar: float = TIME_BAR

    @property
    def is_right(self) -> bool:
        """Whether both agree."""
        if self.expected is None or self.found is None:
            return self.expected == self.found
        return abs(self.expected - self.found) <= self.bar


def rod(name: str, length: float, mass: float) -> Link:
    """Return a uniform rod along x [m], [kg]."""
    tensor = np.diag([1e-6, mass * length**2 / 12, mass * length**2 / 12])
    body = Body(name, Inertia(mass, np.array([length / 2, 0.0, 0.0]), tensor))
    return Link(name, (body,), tip=np.array([length, 0.0, 0.0]))


def place(x: float, y: float = 0.0) -> Placement:
    """Return a placement in the plane [m]."""
    return Placement(np.array([x, y, 0.0]))


def wave(random: Random, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and samples of a random smooth function whose values are between two numbers."""
    time = np.linspace(0.0, 1.0, int(random.integers(12, 60)))
    values = np.zeros_like(time)
    for k in (1, 2):
        values += random.normal() / k * np.sin(random.uniform(1.0, 5.0) * k * time + random.uniform(0.0, 6.0))
    values = (values - values.min()) / (np.ptp(values) or 1.0)
    return time, low + (high - low) * values


def hill(random: Random) -> tuple[np.ndarray, np.ndarray, float]:
    """Return times [s] and samples of a random wave that is highest inside, by a tenth above its start, and when that is."""
    while True:
        time, values = wave(random, 0.0, 1.0)
        spline = scipy.interpolate.make_interp_spline(time, values, k=5)
        turns = scipy.interpolate.PPoly.from_spline(spline.derivative()).roots(extrapolate=False)
        if not len(turns):
            continue
        best = float(turns[int(np.argmax(spline(turns)))])
        peak = float(spline(best))
        if peak > max(spline(0.0), spline(1.0)) + 0.1:
            return time, values - peak, best


def first_event(function: Event, level: float) -> float:
    """Return the first time [s] at which a function that begins below a level is there, by dense samples and brentq."""
    time = np.linspace(0.0, 1.0, DENSE + 1)
    over = function(time) - level

    def at(t: float) -> float:
        return float(function(np.array([t]))[0]) - level

    peaks = np.r_[False, (over[1:-1] >= over[:-2]) & (over[1:-1] >= over[2:]), False]
    # between two dense samples a smooth function rises by no more than a few times what it changes by from one to the next
    peaks &= over > -10.0 * np.abs(np.diff(over)).max()
    for k in np.flatnonzero((over >= 0.0) | peaks).tolist():
        low, high = float(time[max(k - 1, 0)]), float(time[min(k + 1, DENSE)])
        best = float(time[k])
        if over[k] < 0.0:
            best = highest(at, low, high)
        if at(best) > 0.0:
            return float(scipy.optimize.brentq(at, low, best, xtol=1e-15)) if at(low) < 0.0 else low
    raise AssertionError("the level is not reached")


def highest(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function is highest between two times [s], by golden sections to the root of rounding."""
    result = scipy.optimize.minimize_scalar(
        lambda t: -function(t), bounds=(low, high), method="bounded", options={"xatol": 1e-13}
    )
    return float(result.x)


# ------------------------------------------------------------------------------------------------------------- limits


def arm() -> Mechanism:
    """Return three rods in a plane."""
    links = tuple(rod(f"l{k}", 0.3, 1.0) for k in range(3))
    joints = tuple(
        Joint(f"j{k}", "revolute", WORLD if k == 0 else f"l{k - 1}", f"l{k}", place(0.3 if k else 0.0))
        for k in range(3)
    )
    return Mechanism("arm", links, joints, np.array([0.0, -9.81, 0.0]))


def limit_case(random: Random, number: int) -> Outcome:
    """A joint against a limit of its position or speed."""
    if random.random() < 0.3:
        law = str(random.choice(["cycloid", "quintic", "septic", "nonic", "bang-bang", "trapezoid"]))
        ends = random.uniform(-2, 2, (2, 3))
        motion = flexinv.Motion.point_to_point(*ends, 0.8, delay=0.1, hold=0.1, law=law)
    else:
        waves = [wave(random, -1.0, 1.0) for _ in range(3)]
        time = waves[0][0]
        samples = np.stack([np.interp(time, *one) if len(one[0]) != len(time) else one[1] for one in waves], axis=1)
        motion = flexinv.Motion.from_samples(time, samples, degree=int(random.choice([3, 5])))
    plain, joint = arm(), int(random.integers(3))
    is_speed, sign = bool(random.random() < 0.4), float(random.choice([-1.0, 1.0]))

    def value(times: np.ndarray) -> np.ndarray:
        q, qd, _ = motion.evaluate(plain, times)
        return np.abs(qd[:, joint]) if is_speed else sign * q[:, joint]

    dense = np.linspace(0.0, 1.0, DENSE + 1)
    values = value(dense)
    k = int(np.argmax(values))
    best = highest(lambda t: float(value(np.array([t]))[0]), dense[max(k - 1, 0)], dense[min(k + 1, DENSE)])
    peak = max(float(value(np.array([best]))[0]), float(values.max()))
    case = str(random.choice(["crosses", "misses"]))
    margin = 10 ** random.uniform(-9, -1) * max(float(np.ptp(values)), 1e-3)
    level = peak - margin if case == "crosses" else peak + margin
    expected: float | None = None
    if case == "crosses":
        expected = 0.0 if values[0] >= level else first_event(value, level)
    limits = Limits(velocity=level) if is_speed else Limits(upper=level) if sign > 0 else Limits(lower=-level)
    mechanism = replace(
        plain, joints=tuple(replace(j, limits=limits) if j.name == f"j{joint}" else j for j in plain.joints)
    )
    solution = flexinv.solve(mechanism, motion, step=float(random.choice(STEPS)))
    (use,) = find_limits(solution, motion)
    return Outcome("limit", number, case, expected, use.reached, str(use))


# ---------------------------------------------------------------------------------------------------- singular positions


def solved(
    mechanism: Mechanism, motion: flexinv.Motion, step: float, start: dict[str, float]
) -> tuple[float | None, str]:
    """Return the instant [s] that an error names, None where there is a solution."""
    try:
        flexinv.solve(mechanism, motion, step=step, start=start)
    except flexinv.ConvergenceError as error:
        match = re.search(r"t = (\S+) s", str(error))
        return (float(match[1]) if match else -1.0), str(error)
    return None, ""


@dataclass(frozen=True)
class Crank:
    """A crank's motion from below to an angle that it crosses, touches or misses; angle [rad] over time, instant [s] or None."""

    motion: flexinv.Motion
    case: str
    angle: Event
    expected: float | None

    @classmethod
    def of(cls, random: Random, most: float, reach: float, joint: str = "A", least: float = 1e-8) -> Crank:
        """Return a random motion to the angle ``most`` from at most ``reach`` below it [rad], past it by ``least`` or more."""
        case = str(random.choice(["crosses", "touches", "misses"]))
        time, values, best = hill(random)
        over = {"crosses": 1.0, "touches": 0.0, "misses": -1.0}[case] * 10 ** random.uniform(np.log10(least), -1.5)
        samples = most + over + random.uniform(0.5, 1.0) * reach * values
        angle = scipy.interpolate.make_interp_spline(time, samples, k=5)
        expected = {"crosses": None, "touches": best, "misses": None}[case]
        if case == "crosses":
            expected = first_event(angle, most)
        return cls(flexinv.Motion.from_samples(time, {joint: samples}), case, angle, expected)

    @property
    def first(self) -> float:
        """The angle at the start [rad]."""
        return float(self.angle(np.array([0.0]))[0])


def loop_outcome(
    kind: str, number: int, step: float, mechanism: Mechanism, start: dict[str, float], crank: Crank
) -> Outcome:
    """Solve a loop whose crank goes to its singular angle, and say what came."""
    result, said = solved(mechanism, crank.motion, step, start)
    return Outcome(kind, number, crank.case, crank.expected, result, said)


def four_bar(random: Random, least: float = 1e-8) -> tuple[Mechanism, dict[str, float], Crank]:
    """Return a four-bar whose crank goes to where coupler and rocker are in line, or a parallelogram to its flat position."""
    is_parallel = bool(random.random() < 0.3)
    while True:
        crank, coupler, rocker, base = random.uniform(0.15, 0.6, 4)
        if is_parallel:
            coupler, rocker = base, crank
        cosine = (crank**2 + base**2 - (coupler + rocker) ** 2) / (2 * crank * base)
        most = 0.0 if is_parallel else float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        lowest = abs(crank * np.exp(1j * (most - 0.6)) - base)
        if is_parallel or (abs(cosine) < 0.95 and most > 0.7 and lowest > abs(coupler - rocker) + 0.02):
            break
    given = Crank.of(random, most, 0.6, least=least)
    first = given.first
    tip = crank * np.exp(1j * first)
    across = base - tip
    distance = abs(across)
    inner = np.arccos(np.clip((coupler**2 + distance**2 - rocker**2) / (2 * coupler * distance), -1, 1))
    side = 1.0 if most else -np.sign(first)  # the parallelogram, not the crossed one
    toward = np.angle(across) + (inner if most else 0.0) * side
    if most == 0.0:
        toward = 0.0
    joint = tip + coupler * np.exp(1j * toward)
    start = {"B": float(toward - first), "D": float(np.angle(joint - base))}
    links = rod("crank", crank, 0.3), rod("coupler", coupler, 0.5), rod("rocker", rocker, 0.4)
    joints = (
        Joint("A", "revolute", WORLD, "crank"),
        Joint("B", "revolute", "crank", "coupler", place(crank), actuated=False),
        Joint("D", "revolute", WORLD, "rocker", place(base), actuated=False),
    )
    ends = Attachment("coupler", place(coupler)), Attachment("rocker", place(rocker))
    kind = str(random.choice(["revolute", "spherical"]))
    mechanism = Mechanism("four-bar", links, joints, np.array([0.0, -9.81, 0.0]), (Closure("C", kind, *ends),))
    return mechanism, start, given


def four_bar_case(random: Random, number: int) -> Outcome:
    """A rigid four-bar that comes to a singular position, touches it or turns before."""
    mechanism, start, given = four_bar(random)
    return loop_outcome("four-bar", number, float(random.choice(STEPS)), mechanism, start, given)


def march_case(random: Random, number: int) -> Outcome:
    """The same with a beam on its crank, stiff enough for steps of a hundredth of a second.

    What a march has is the motion of its samples: what passes a position by little, or misses it by little, is left out.
    """
    mechanism, start, given = four_bar(random, 1e-3)
    stiff = Section(
        np.array([0.0, 1.0]),
        np.tile([1e4, 4e3, 4e3, 1.0, 1.0, 1.0], (2, 1)),
        np.full(2, 0.05),
        np.tile(np.eye(3)[0] * 1e-6, (2, 1)),
    )
    whip = Link("whip", (), Beam(0.1, stiff, 1, 2))
    carried = Joint("W", "fixed", "crank", "whip", place(0.05))
    mechanism = replace(mechanism, links=(*mechanism.links, whip), joints=(*mechanism.joints, carried))
    step = float(random.choice((1e-2, 1.0 / 140.0, 1e-3)))
    outcome = loop_outcome("march", number, step, mechanism, start, given)
    if "write step =" in outcome.said:  # it does as it is told
        step = step / 4
        outcome = loop_outcome("march", number, step, mechanism, start, given)
    return replace(outcome, bar=step)


def slider_case(random: Random, number: int) -> Outcome:
    """A slider-crank with a rod too short to let the crank turn: it stands across the slide where the crank must turn back."""
    crank = random.uniform(0.2, 0.5)
    offset = random.uniform(-0.05, 0.05)
    length = random.uniform(0.4, 0.9) * (crank - abs(offset))
    most = float(np.arcsin((length + offset) / crank))
    given = Crank.of(random, most, 0.5 * most)
    first = given.first
    height = crank * np.sin(first) - offset
    rod_angle = -np.arcsin(height / length)
    slide = crank * np.cos(first) + length * np.cos(rod_angle)
    links = rod("crank", crank, 0.3), rod("rod", length, 0.4), rod("slide", 0.1, 0.5)
    joints = (
        Joint("A", "revolute", WORLD, "crank"),
        Joint("B", "revolute", "crank", "rod", place(crank), actuated=False),
        Joint("S", "prismatic", WORLD, "slide", place(0.0, offset), axis=np.array([1.0, 0.0, 0.0]), actuated=False),
    )
    ends = Attachment("rod", place(length)), Attachment("slide")
    mechanism = Mechanism("slider", links, joints, np.array([0.0, -9.81, 0.0]), (Closure("C", "revolute", *ends),))
    start = {"B": float(rod_angle - first), "S": float(slide)}
    return loop_outcome("slider", number, float(random.choice(STEPS)), mechanism, start, given)


def distance_of_cranks(lengths: tuple[float, float, float], angles: tuple[Event, Event], t: np.ndarray) -> np.ndarray:
    """Return the distance [m] of the ends of two cranks over time [s]; lengths : of both, and of the base [m]."""
    left, right, base = lengths
    return np.asarray(np.abs(left * np.exp(1j * angles[0](t)) - base - right * np.exp(1j * angles[1](t))))


def slope_of_distance(lengths: tuple[float, float, float], angles: tuple[Event, Event], t: float) -> float:
    """Return half the rate of the square of `distance_of_cranks` [m^2/s] at a time [s]; angles : splines [rad]."""
    left, right, base = lengths
    one, two = left * np.exp(1j * angles[0](t)), right * np.exp(1j * angles[1](t))
    rate = 1j * (one * angles[0].derivative()(t) - two * angles[1].derivative()(t))
    return float((np.conj(one - base - two) * rate).real)


def five_bar_case(random: Random, number: int) -> Outcome:
    """Two cranks; the first goes so far that both couplers come in line, the second moves as well."""
    while True:
        left, right, one, two = random.uniform(0.2, 0.4, 4)
        base = random.uniform(0.3, 0.5)
        time, other = wave(random, 1.0, 1.6)
        other_spline = scipy.interpolate.make_interp_spline(time, other, k=5)
        values = wave(random, 1.2, 2.8)
        first = scipy.interpolate.make_interp_spline(*values, k=5)

        gap = partial(distance_of_cranks, (left, right, base), (first, other_spline))

        dense = gap(np.linspace(0.0, 1.0, 2001))
        case = str(random.choice(["crosses", "touches", "misses"]))
        reach = one + two
        k = int(np.argmax(dense))
        turn, peak = k / 2000, float(dense[k])
        if 0 < k < 2000:  # to the root of rounding by the gap itself, to rounding by its slope
            slope = partial(slope_of_distance, (left, right, base), (first, other_spline))
            turn = float(scipy.optimize.brentq(slope, (k - 1) / 2000, (k + 1) / 2000, xtol=1e-15))
            peak = float(gap(np.array([turn]))[0])
        wanted = peak - {"crosses": 1.0, "touches": 0.0, "misses": -1.0}[case] * 10 ** random.uniform(-4, -1)
        if case == "touches" and not 0.01 < turn < 0.99:
            continue
        scale = wanted / reach
        one, two = one * scale, two * scale
        if dense.min() > abs(one - two) + 0.02 and dense[0] < one + two - 0.02 and wanted > 0.1:
            break
    expected = {"crosses": None, "touches": turn, "misses": None}[case]
    if case == "crosses":
        expected = first_event(gap, one + two)
    angles = float(first(0.0)), float(other_spline(0.0))
    a, b = left * np.exp(1j * angles[0]), base + right * np.exp(1j * angles[1])
    distance = abs(b - a)
    toward = np.angle(b - a) + np.arccos((one**2 + distance**2 - two**2) / (2 * one * distance))
    meeting = a + one * np.exp(1j * toward)
    links = rod("l", left, 0.3), rod("lc", one, 0.3), rod("r", right, 0.3), rod("rc", two, 0.3)
    joints = (
        Joint("L", "revolute", WORLD, "l"), Joint("LE", "revolute", "l", "lc", place(left), actuated=False),
        Joint("R", "revolute", WORLD, "r", place(base)), Joint("RE", "revolute", "r", "rc", place(right), actuated=False),
    )  # fmt: skip
    ends = Attachment("lc", place(one)), Attachment("rc", place(two))
    mechanism = Mechanism("five-bar", links, joints, np.array([0.0, -9.81, 0.0]), (Closure("C", "revolute", *ends),))
    start = {"LE": float(toward - angles[0]), "RE": float(np.angle(meeting - b) - angles[1])}
    motion = flexinv.Motion.merge(
        flexinv.Motion.from_samples(values[0], {"L": values[1]}), flexinv.Motion.from_samples(time, {"R": other})
    )
    result, said = solved(mechanism, motion, float(random.choice(STEPS)), start)
    return Outcome("five-bar", number, case, expected, result, said)


# --------------------------------------------------------------------------------------------------------------- springs


def spring_case(random: Random, number: int) -> Outcome:
    """A spring from a pendulum's tip to a point on its circle, or beside it."""
    length, where = float(random.uniform(0.3, 0.8)), float(random.uniform(-0.3, 0.3))
    case = str(random.choice(["crosses", "touches", "misses"]))
    beside = 10 ** random.uniform(-6, -1) * length if case == "misses" else 0.0
    anchor = (length + beside) * np.array([np.cos(where), np.sin(where), 0.0])
    while True:
        crank = Crank.of(random, where, float(random.uniform(0.5, 2.0)), "j0")
        if (crank.case == "touches") == (case == "touches") and crank.case != "misses":
            break
    expected = None if case == "misses" else crank.expected
    pull = Spring(
        "cord", Attachment(WORLD, Placement(anchor)), Attachment("l0", place(length)), stiffness=50.0, rest=0.1
    )
    mechanism = Mechanism(
        "pendulum",
        (rod("l0", length, 1.0),),
        (Joint("j0", "revolute", WORLD, "l0"),),
        np.array([0.0, -9.81, 0.0]),
        springs=(pull,),
    )
    try:
        flexinv.solve(mechanism, crank.motion, step=float(random.choice(STEPS)))
    except flexinv.InputError as error:
        named = re.search(r"t = (\S+) s", str(error))
        return Outcome("spring", number, case, expected, float(named[1]) if named else -1.0, str(error))
    return Outcome("spring", number, case, expected, None)


KINDS: dict[str, Callable[[Random, int], Outcome]] = {
    "limit": limit_case,
    "four-bar": four_bar_case,
    "slider": slider_case,
    "five-bar": five_bar_case,
    "spring": spring_case,
    "march": march_case,
}


def run_case(kind: str, number: int, seed: int) -> Outcome:
    """Return the outcome of one case, which is the same whatever else is run [s]."""
    return KINDS[kind](np.random.default_rng([seed, list(KINDS).index(kind), number]), number)


def main() -> int:
    """Run all cases; 1 where one answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100, help="cases of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="one case, such as four-bar:17, or one kind")
    options = parser.parse_args()
    kind, _, number = (options.only or "").partition(":")
    wrong = 0
    for name in [kind] if kind else KINDS:
        outcomes = [run_case(name, k, options.seed) for k in ([int(number)] if number else range(options.count))]
        bad = [one for one in outcomes if not one.is_right]
        happening = sum(one.expected is not None for one in outcomes)
        missed = sum(one.expected is not None and one.found is None for one in bad)
        false = sum(one.expected is None for one in bad)
        counts = f"{len(outcomes)} cases, {happening} in which it happens: {missed} missed, {false} false"
        click.echo(f"{name}: {counts}, {len(bad) - missed - false} at another instant")
        for one in bad:
            click.echo(
                f"  --only {name}:{one.number} --seed {options.seed}: {one.case}, expected {one.expected}, found {one.found} "
                + one.said
            )
        wrong += len(bad)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
