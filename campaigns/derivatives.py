"""Derivatives of random mechanisms against differences of `solve`, with the error bars of these.

    python campaigns/derivatives.py                     # 200 trees and 100 loops, three parameters each
    python campaigns/derivatives.py --count 5 --loops 5 --seed 7
    python campaigns/derivatives.py --only 17 --loops 0

Trees of rigid links and beams, in any position, with dampers, rotors, springs in joints, given forces and passive joints; closed
loops of such links in a plane and in space, with springs between points and, where all links are rigid, redundant drives.
Of each the derivatives of all torques and tips by numbers drawn by lot, of the motion and of the mechanism, are held against
differences of fourth and sixth order with several changes; their bar is what two of them differ by, and rounding.
`find_gradient` is held against sums of these derivatives, to the same tolerance.
The command ends with 1 where a derivative is off by more than its bar and TOLERANCE of the largest entry.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
from scipy.spatial.transform import Rotation

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from spectra_machines import close_chain, draw_beam, draw_rigid_link, draw_springs, drawn

import flexinv
from flexinv.errors import FlexinvError, InputError
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import WORLD, Joint, Link, Mechanism, Placement
from flexinv.sensitivity.parameters import CENTRAL, FORWARD, Parameter, resolve_parameters
from flexinv.typing import Array

SEED = 41
COUNT = 200
LOOPS = 100
PARAMETERS = 3
STEP = 2e-3  # of the march [s]
DURATION = 0.1  # of the moves [s]
BARS = 2.0  # of the differences: the smallest of several is small by chance, too
TOLERANCE = 1e-7  # of the largest entry: Newton's last increment and the rounding of K, C and M
BLUNT = 1e-2  # a bar of differences that say nothing
ROUNDING = 1e-13  # of a torque, that Newton leaves
CHANGES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)  # of a number, or in its own unit where it is zero
MOST_DRAWS = 50
PASSIVE = 0.25  # of the joints that have a spring
FLAT = 0.6  # of the loops are in a plane
BENT = 0.4  # of their links are beams
SPRUNG = 0.4  # of them have springs between points, some without one
REDUNDANT = 0.5  # of the rigid ones have two drives


@dataclass(frozen=True)
class Outcome:
    """One derivative: of which mechanism, by what, how far it is off and the bar of that [of the largest entry], in words."""

    number: int
    by: str
    off: float
    bar: float
    words: str = ""
    kind: str = "tree"

    @property
    def is_wrong(self) -> bool:
        """True where it is off by more than the differences can be, and these say something."""
        if self.words or np.isnan(self.off) or np.isnan(self.bar):
            return True
        return self.bar < BLUNT and self.off > BARS * self.bar + TOLERANCE


def draw_tree(seed: int, number: int) -> Mechanism:
    """Return a tree without springs between points, whose joints have one number for each coordinate [m, kg, rad]."""
    for k in range(MOST_DRAWS):
        machine = drawn(seed, MOST_DRAWS * number + k).mechanism
        if all(KINDS[joint.kind].scalar for joint in machine.joints if joint.nv) and machine.nv:
            break
    dice = np.random.default_rng([SEED, seed, number])
    joints = []
    for joint in machine.joints:
        sprung = joint.nv == 1 and joint.stiffness > 0.0
        joints.append(replace(joint, actuated=not (sprung and dice.random() < PASSIVE)))
    if not any(joint.actuated and joint.nv for joint in joints):
        joints = [replace(joint, actuated=True) for joint in joints]
    return replace(machine, joints=tuple(joints), closures=(), springs=())


def draw_loop(seed: int, number: int) -> Mechanism:
    """Return a chain that is closed where its joints are at zero [m, kg, rad]: in a plane by a pin, in space by a ball.

    The first joint has a drive; where all links are rigid, the second one has one, too, now and then.
    """
    dice = np.random.default_rng([SEED, seed, number, 2])
    flat = bool(dice.random() < FLAT)
    count = 3 if flat else 4
    links: list[Link] = []
    joints: list[Joint] = []
    for k in range(count):
        turn = Rotation.from_euler("z", dice.uniform(0.6, 1.5) * dice.choice([-1.0, 1.0]))
        axis = np.array([0.0, 0.0, 1.0])
        if not flat:
            turn = Rotation.from_rotvec(dice.normal(size=3))
            axis = dice.normal(size=3)
            axis /= np.linalg.norm(axis)
        parent = links[-1] if links else None
        bent = parent is not None and parent.beam is not None
        place = np.zeros(3) if parent is None or bent else parent.tip
        own = {"damping": float(dice.choice([0.0, 0.1])), "rotor_inertia": float(dice.choice([0.0, 0.02]))}
        at = Placement(place, turn.as_matrix())
        carrier = WORLD if parent is None else parent.name
        station = 1.0 if bent else None
        joints.append(Joint(f"joint {k}", "revolute", carrier, f"link {k}", at, station, axis, actuated=k == 0, **own))
        links.append(_draw_link(dice, k, flat))
    mechanism = Mechanism(
        "drawn loop", tuple(links), tuple(joints), dice.uniform(-10.0, 10.0, 3) * [1.0, 1.0, not flat]
    )
    mechanism = replace(mechanism, closures=(close_chain(mechanism, "revolute" if flat else "spherical"),))
    if dice.random() < SPRUNG:
        mechanism = replace(mechanism, springs=tuple(draw_springs(dice, mechanism, False)))
    if mechanism.is_rigid and dice.random() < REDUNDANT:
        driven = replace(joints[1], actuated=True, weight=float(dice.uniform(0.5, 2.0)))
        mechanism = replace(mechanism, joints=(joints[0], driven, *joints[2:]))
    return mechanism


def _draw_link(dice: np.random.Generator, k: int, flat: bool) -> Link:
    """A beam or a rigid link of a loop; in a plane both ends lie in it."""
    if dice.random() < BENT:
        link = draw_beam(dice, k, "all")
        return replace(link, beam=replace(link.beam, curvature=np.zeros(3))) if flat and link.beam is not None else link
    link = draw_rigid_link(dice, k, "all")
    return replace(link, tip=np.array([dice.uniform(0.3, 0.6), 0.0, 0.0])) if flat else link


def draw_motion(dice: np.random.Generator, mechanism: Mechanism) -> flexinv.Motion:
    """Return a smooth move of all joints with a drive [rad], [m], of a loop of the first one."""
    if mechanism.closures:
        return flexinv.Motion.point_to_point(
            {"joint 0": 0.0}, {"joint 0": float(dice.uniform(-0.3, 0.3))}, duration=DURATION, law="nonic"
        )
    start: dict[str, Array] = {}
    end: dict[str, Array] = {}
    for joint in mechanism.joints:
        if joint.nv and joint.actuated:
            start[joint.name] = dice.uniform(-0.3, 0.3, joint.nv)
            end[joint.name] = start[joint.name] + dice.uniform(-0.5, 0.5, joint.nv)
    return flexinv.Motion.point_to_point(start, end, duration=DURATION, law="nonic")


def list_names(mechanism: Mechanism, motion: flexinv.Motion) -> list[str]:
    """Return the names of numbers by which torques can be differentiated."""
    names = ["motion.duration", *(f"gravity[{k}]" for k in range(3))]
    for joint in mechanism.joints:
        if joint.name in motion.joints(mechanism):
            names += [f"motion.{joint.name}[{row},{k}]" for row in (0, 1) for k in range(joint.nv)]
        if joint.nv == 1:
            names += [f"joints.{joint.name}.{field}" for field in ("damping", "rotor_inertia", "stiffness")]
        names.append(f"joints.{joint.name}.placement.position[0]")
    for link in mechanism.links:
        for body in link.bodies:
            where = f"links.{link.name}.bodies.{body.name}.inertia"
            names += [f"{where}.mass", f"{where}.com[1]", f"{where}.tensor[0,1]", f"{where}.tensor[2,2]"]
        if link.beam is not None:
            section = f"links.{link.name}.beam.section"
            names += [f"links.{link.name}.beam.length", f"links.{link.name}.beam.curvature[2]"]
            names += [f"{section}.stiffness[0,{k}]" for k in (3, 4, 5)]
            names += [f"{section}.mass_per_length[0]", f"{section}.rotary_inertia[0,0]"]
            names += [f"{section}.damping[0,4]"] * (link.beam.section.damping is not None)
    for closure in mechanism.closures:
        names += [f"closures.{closure.name}.second.placement.position[{k}]" for k in range(3)]
    for spring in mechanism.springs:
        where = f"springs.{spring.name}"
        names += [f"{where}.{field}" for field in ("stiffness", "rest", "damping", "first.placement.position[1]")]
    return names


def compute_differences(
    mechanism: Mechanism, motion: flexinv.Motion, parameter: Parameter
) -> tuple[Array, float, Array]:
    """Return the derivative of all torques and tips by differences, its bar [-], and the scale of each column.

    scale : the largest entry, or all of it over the number, where that is more: what hardly changes is known no better
    """

    def run(value: float) -> Array:
        changed, moved = parameter.build_setup(mechanism, motion, value)
        found = flexinv.solve(changed, moved, step=STEP, end=motion.duration)
        return np.hstack([found.torque, *found.tip.values()])

    size = abs(parameter.value) or 1.0
    level = run(parameter.value)
    weights = CENTRAL
    try:
        run(parameter.value - 3 * CHANGES[0] * size)
    except InputError:  # what cannot be below zero
        weights = FORWARD
    rows: list[Array] = []
    for part in CHANGES:
        change = part * size
        rows.append(sum(weight * run(parameter.value + k * change) for k, weight in weights.items()) / change)
    torques = sum(joint.nv for joint in mechanism.joints if joint.actuated)
    scale = np.empty(level.shape[1])
    for columns in (slice(torques), slice(torques, None)):
        whole = np.abs(level[:, columns]).max(initial=0.0) / size
        scale[columns] = max(*(np.abs(row[:, columns]).max(initial=0.0) for row in rows), whole, np.finfo(float).tiny)
    bars = []
    for coarse, fine, part in zip(rows, rows[1:], CHANGES[1:], strict=False):
        rounding = ROUNDING * np.abs(level / scale).max() / (part * size)
        bars.append((float(np.abs((coarse - fine) / scale).max() + rounding), fine))
    bar, best = min(bars, key=lambda pair: pair[0])
    return best, bar, scale


def try_mechanism(seed: int, number: int, closed: bool = False) -> Iterator[Outcome]:
    """Yield the outcomes of the numbers that are drawn of one mechanism, a loop where it is ``closed``."""
    dice = np.random.default_rng([SEED, seed, number, 1])
    mechanism = draw_loop(seed, number) if closed else draw_tree(seed, number)
    motion = draw_motion(dice, mechanism)
    names = list_names(mechanism, motion)
    for by in dice.choice(names, min(PARAMETERS, len(names)), replace=False).tolist():
        try:
            yield judge_derivative(number, mechanism, motion, by)
        except FlexinvError as error:  # a march beside the present one fails
            click.echo(f"{number} {by}: no differences: {error}", err=True)


def judge_derivative(number: int, mechanism: Mechanism, motion: flexinv.Motion, by: str) -> Outcome:
    """Return the outcome of one derivative [of the largest entry].  Raises FlexinvError where a march fails."""
    (parameter,) = resolve_parameters(by, mechanism, motion)
    best, bar, scale = compute_differences(mechanism, motion, parameter)
    found = flexinv.differentiate(mechanism, motion, by, step=STEP)
    together = np.hstack([found.torque[:, :, 0], *(tip[:, :, 0] for tip in found.tip.values())])
    off = np.abs((together - best) / scale).max()
    words = "" if np.isfinite(together).all() else "not finite"
    backwards = compare_backwards(number, mechanism, motion, by, found)
    if not backwards <= TOLERANCE:  # no bar of differences is in it
        words = f"backwards off by {backwards:.1e}"
    return Outcome(number, by, float(off), bar, words)


def compare_backwards(
    number: int, mechanism: Mechanism, motion: flexinv.Motion, by: str, found: flexinv.Sensitivities
) -> float:
    """Return by how much `find_gradient` is off the sum of derivatives, each times a weight drawn by lot [of the largest]."""
    dice = np.random.default_rng(number)
    tip = list(found.tip)[-1]
    weights = {
        "torque": dice.standard_normal(found.torque.shape[:2]),
        "tip": {tip: dice.standard_normal(found.tip[tip].shape[:2])},
    }
    parts = [weights["torque"] * found.torque[..., 0], weights["tip"][tip] * found.tip[tip][..., 0]]
    largest = max(float(np.abs(part).max()) for part in parts)
    gradient = flexinv.find_gradient(mechanism, motion, weights, by, step=STEP).gradient[0]
    return abs(gradient - sum(part.sum() for part in parts)) / largest if largest else abs(gradient)


@click.command(help=__doc__)
@click.option("--count", default=COUNT, show_default=True, help="Mechanisms.")
@click.option("--loops", default=LOOPS, show_default=True, help="Closed loops.")
@click.option("--seed", default=SEED, show_default=True, help="Of the lot.")
@click.option("--only", type=int, help="The mechanism of that number alone, of the loops where there are no trees.")
def main(count: int, loops: int, seed: int, only: int | None) -> None:
    """Run the campaign and end with 1 where a derivative is wrong."""
    warnings.simplefilter("ignore")
    outcomes = [*list_outcomes(seed, count, only, False), *list_outcomes(seed, loops, only, True)]
    sys.exit(report_outcomes(outcomes))


def list_outcomes(seed: int, count: int, only: int | None, closed: bool) -> list[Outcome]:
    """Return the outcomes of so many trees or, where they are ``closed``, loops; print those that fail."""
    outcomes: list[Outcome] = []
    for number in range(count) if only is None or not count else [only]:
        try:
            found = list(try_mechanism(seed, number, True) if closed else try_mechanism(seed, number))
            outcomes += [replace(one, kind="loop") if closed else one for one in found]
        except FlexinvError as error:
            click.echo(f"{'loop' if closed else 'tree'} {number}: {error}", err=True)
    return outcomes


def report_outcomes(outcomes: list[Outcome]) -> bool:
    """Print what is wrong and the count of all; return whether something is."""
    wrong = [one for one in outcomes if one.is_wrong]
    for one in wrong:
        click.echo(f"{one.kind} {one.number}, by {one.by}: off by {one.off:.1e}, bar {one.bar:.1e} {one.words}")
    sharp = [one for one in outcomes if one.bar < TOLERANCE]
    worst = max((one.off for one in sharp), default=float("nan"))
    click.echo(
        f"{len(outcomes)} derivatives of {len({(one.kind, one.number) for one in outcomes})} mechanisms: {len(wrong)} wrong; of "
        f"{len(sharp)} with a bar below {TOLERANCE:g} the largest is off by {worst:.1e} of the largest entry"
    )
    return bool(wrong)


if __name__ == "__main__":
    main()
