"""Shortest motions of the gallery's arms beside shaped ones, each replayed in Exudyn.

    python campaigns/optimal_motions.py
    python campaigns/optimal_motions.py --only spatial_arm
    python campaigns/optimal_motions.py --random 30    # random trees as well

Of each machine: the given motion, the same shaped for its slowest mode (ZV, ZVD, EI), and the shortest motion with the torques
of the given one and a hundredth of its vibration; how short it would be if it might swing as it liked; and one that is good for
all payloads within a fifth, with a twentieth of the vibration.  Exudyn then makes the motion that was found with a model of its
own: its torques, and how far its tip goes from the rest place afterwards, or of a loop, whose pins hold the tips, how far its
beam goes on bending beside the given motion.  The command ends with 1 where torques differ by more than both bars, or more of the
vibration is left.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import click
import numpy as np
import pandas as pd

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from derivatives import draw_tree

import flexinv
from crosscheck.engines import ENGINES, adapter
from flexinv.errors import FlexinvError, InputError, ModelWarning
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.typing import Array

ROOT = Path(__file__).resolve().parents[1]
ENGINE = "exudyn-ge"
PAYLOAD = 0.2  # by which a payload may be lighter or heavier
QUIET = 0.01  # of the given motion's vibration
ROBUST = 0.05  # of the given motion's vibration, with any payload
LOUD = 100.0  # of the given motion's vibration: no limit
BOUND_KNOTS = 16
AFTER = 0.1  # [s] after the end, in which Exudyn's tip is looked at
STEPS = 400  # of a motion, and as many samples
# Of the largest torque, beside the bars of both: of a beam's formulation and of how a start is found.
AGREED_TORQUE = 0.01
# Of the given motion's vibration: a hundredth that is left, and as much again for frequencies that differ by the mesh.
AGREED_RESIDUAL = 0.025
# Of a limit, on a grid ten times finer: what the check of the search allows, and as much for a torque between its points.
FINER = 4e-3
MOST_TREES = 200
KINDS_MOVED = ("revolute", "prismatic")
FINER_RESIDUAL = 0.1


@dataclass(frozen=True)
class Arm:
    """A machine of models/ and the ends of its joints [rad]; duration [s] of the given move.

    begin : where the joints begin [rad], at zero by default; start : guess of the other joints of a loop [rad]
    bending : beam whose bending is looked at in place of the tip
    payload : link and body that weigh a fifth more and less; none of a machine without
    """

    name: str
    ends: dict[str, float]
    duration: float
    knots: int
    begin: dict[str, float] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)
    bending: str = ""
    payload: tuple[str, str] = ("", "")

    def load(self) -> Mechanism:
        """Return the mechanism."""
        return flexinv.load_mechanism(ROOT / "models" / self.name)

    @property
    def move(self) -> Motion:
        """The given motion."""
        begin = dict.fromkeys(self.ends, 0.0) | self.begin
        return Motion.point_to_point(begin, self.ends, duration=self.duration)

    def list_loaded(self) -> list[Mechanism]:
        """Return the machine with a fifth less of its payload, as it is, and with a fifth more [kg]."""
        mechanism = self.load()
        link, name = self.payload
        if not link:
            return []
        body = next(one for one in mechanism.link_of[link].bodies if one.name == name)
        return [_replace_body(mechanism, link, body, part) for part in (1.0 - PAYLOAD, 1.0, 1.0 + PAYLOAD)]


def _replace_body(mechanism: Mechanism, link: str, body: flexinv.Body, part: float) -> Mechanism:
    """The mechanism with a body of a link that weighs a part of what it did."""
    inertia = flexinv.Inertia(part * body.inertia.mass, body.inertia.com, part * body.inertia.tensor)
    bodies = tuple(replace(one, inertia=inertia) if one is body else one for one in mechanism.link_of[link].bodies)
    links = tuple(replace(one, bodies=bodies) if one.name == link else one for one in mechanism.links)
    return replace(mechanism, links=links)


ARMS = (
    Arm("flex_one_link", {"hub": np.pi}, 0.2, 8),
    Arm("flex_two_link", {"joint1": 0.5, "joint2": 1.0}, 0.2, 10),
    Arm("spatial_arm", {"yaw": 0.6, "pitch": 0.5}, 0.3, 10),
    Arm(
        "four_bar_flexible", {"A": np.radians(140.0)}, 0.2, 10, begin={"A": np.radians(20.0)},
        start={"B": np.radians(46.0), "D": np.radians(103.0)}, bending="coupler",
    ),
    Arm("quanser_2dsfl", {"shoulder": 0.5, "elbow": 0.8}, 0.8, 10, payload=("link2", "end")),
)  # fmt: skip


def solve_motion(arm: Arm, mechanism: Mechanism, motion: Motion, error: bool = False) -> flexinv.Solution:
    """Return the solution of a motion until shortly after its end."""
    step = motion.duration / STEPS
    end = (STEPS + 2) * step
    return flexinv.solve(mechanism, motion, step=step, end=end, initial="static", error=error, start=arm.start)


def find_reach(solution: flexinv.Solution) -> float:
    """Return the largest distance of a tip from its rest place after the end [m]."""
    return max(solution.find_residual_vibration().reach.values())


@dataclass(frozen=True)
class Replay:
    """A motion in Exudyn: torques with error bars (samples, drives) [N m], and how far the tip goes from rest afterwards [m].

    Of a loop half the range in which the end of a beam goes on moving, seen from the section at its other end [m].
    """

    torque: Array
    error: Array
    left: float


def replay(arm: Arm, mechanism: Mechanism, motion: Motion, case: flexinv.Case) -> Replay:
    """Return what Exudyn gives for a motion, with a mesh and steps of its own and the bars of refined ones."""
    step = motion.duration / STEPS
    later = int(np.ceil(AFTER / step))
    asked = replace(
        case, motion=motion, step=step, sample=step, end=(STEPS + later) * step, quantities=("torque", "tip", "deflection"),
        initial="static", mesh=None, measured=None, start={name: np.array([angle]) for name, angle in arm.start.items()},
    )  # fmt: skip
    record = adapter(ENGINES[ENGINE]).run(mechanism, asked, ENGINE, {"error": True, "step": step})
    drives = [record.series[f"torque/{joint.name}"] for joint in mechanism.joints if joint.actuated]
    torque = np.stack([one.values for one in drives], axis=1)
    bars = [np.zeros(len(one.values)) if one.error is None else one.error for one in drives]
    rows = slice(STEPS + 1)
    if arm.bending:
        bent = np.stack([record.series[f"deflection/{arm.bending}/{axis}"].values for axis in "xyz"], axis=1)[STEPS:]
        return Replay(torque[rows], np.stack(bars, axis=1)[rows], 0.5 * float(np.ptp(bent, axis=0).max()))
    link = mechanism.joints[-1].child
    tip = np.stack([record.series[f"tip/{link}/{axis}"].values for axis in "xyz"], axis=1)
    rest = flexinv.statics(mechanism, [], motion.evaluate(mechanism, [motion.duration])[0][0]).tip[link][0]
    left = float(np.linalg.norm(tip[STEPS:] - rest, axis=1).max())
    return Replay(torque[rows], np.stack(bars, axis=1)[rows], left)


@click.command()
@click.option("--only", type=click.Choice([arm.name for arm in ARMS]), help="One arm alone.")
@click.option("--random", type=click.IntRange(0), default=0, help="So many random trees as well, without Exudyn.")
@click.option("--seed", type=int, default=41, show_default=True, help="Of the random trees.")
def main(only: str | None, random: int, seed: int) -> None:
    """Print the table; end with 1 where Exudyn does not confirm a motion, or a finer grid passes a limit."""
    failed = []
    for arm in ARMS:
        if only is None or arm.name == only:
            failed += try_arm(arm)
    failed += try_random_trees(seed, random)
    for line in failed:
        click.echo(line)
    sys.exit(bool(failed))


def draw_optimized_tree(seed: int, number: int) -> Mechanism:
    """Return a random tree whose moving joints have one coordinate, and rotors on drives alone [m, kg, rad]."""
    for k in range(MOST_TREES):
        tree = draw_tree(seed, number + MOST_TREES * k)
        moving = [joint for joint in tree.joints if joint.nv]
        if all(joint.kind in KINDS_MOVED and (joint.actuated or not joint.rotor_inertia) for joint in moving):
            return tree
    raise InputError(f"no tree of joints {', '.join(KINDS_MOVED)} in {MOST_TREES} draws")


def try_random_trees(seed: int, count: int) -> list[str]:
    """Print how the searches of random trees end; return those that pass a limit on a grid ten times finer, in words."""
    ends = Counter[str]()
    failed = []
    for number in range(count):
        mechanism = draw_optimized_tree(seed, number)
        dice = np.random.default_rng([seed, number])
        driven = [joint.name for joint in mechanism.joints if joint.nv and joint.actuated]
        places = {name: float(dice.uniform(-0.6, 0.6)) for name in driven}
        move = Motion.point_to_point(dict.fromkeys(driven, 0.0), places, float(dice.uniform(0.2, 0.5)))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ModelWarning)
                found = flexinv.optimize_motion(mechanism, move, knots=6)
                words = describe_passed(found)
        except FlexinvError as error:
            ends["refused"] += 1
            click.echo(f"random tree {number}: {error}")
            continue
        ends["gave up" if "gave up" in found.reason else "checked"] += 1
        click.echo(f"random tree {number}: {found}")
        if words and "gave up" not in found.reason:
            failed.append(f"random tree {number}: {words}")
    if count:
        click.echo(f"{count} random trees: {', '.join(f'{number} {end}' for end, number in ends.items())}")
    return failed


def describe_passed(found: flexinv.OptimizedMotion) -> str:
    """Return which limits a motion passes on a grid ten times finer than that of the search, in words; "" for none."""
    (mechanism,) = found.mechanisms
    (checked,) = found.solutions
    step = found.duration / (10 * STEPS)
    fine = flexinv.solve(mechanism, found.motion, step=step, end=found.duration + 2 * step, initial="static")
    passed = []
    for number, name in enumerate(fine.torque_names):
        bar = 0.0 if checked.torque_error is None else float(checked.torque_error[:, number].max())
        limit = (found.limits.torque or {}).get(name, np.inf)
        peak = float(np.abs(fine.torque[:, number]).max())
        if peak > limit * (1.0 + FINER) + bar:
            passed.append(f"torque of {name} is {peak / limit:.3f} of its limit, its bar {bar / limit:.3f}")
    if not mechanism.is_rigid and found.limits.residual:
        left = find_reach(fine) / found.limits.residual
        if left > 1.0 + FINER_RESIDUAL:
            passed.append(f"vibration is {left:.3f} of its limit")
    return "; ".join(passed)


def try_arm(arm: Arm) -> list[str]:
    """Print the rows of an arm; return what Exudyn does not confirm, in words."""
    mechanism = arm.load()
    case = next(iter(flexinv.load_cases(ROOT / "models" / arm.name, mechanism).values()))
    move = arm.move
    given = solve_motion(arm, mechanism, move)
    rows = {"given": (move, given)}
    for kind in ("ZV", "ZVD", "EI"):
        shaped = make_shaped(arm, mechanism, kind)
        rows[kind] = shaped, solve_motion(arm, mechanism, shaped)
    peak = np.abs(given.torque).max(axis=0)
    reach = find_reach(given)
    torque = dict(zip(given.torque_names, peak.tolist(), strict=True))
    limits = flexinv.MotionLimits(torque=torque, residual=QUIET * reach)
    begin = time.process_time()
    best = flexinv.optimize_motion(mechanism, move, limits, knots=arm.knots, start=arm.start)
    seconds = time.process_time() - begin
    rows["shortest"] = best.motion, solve_motion(arm, mechanism, best.motion)
    loose = flexinv.MotionLimits(torque=torque, residual=LOUD * reach)
    swinging = flexinv.optimize_motion(mechanism, move, loose, knots=BOUND_KNOTS, start=arm.start)
    rows["swinging"] = swinging.motion, solve_motion(arm, mechanism, swinging.motion)
    try_payloads(arm, reach, rows)
    table = {
        name: (
            motion.duration,
            (np.abs(found.torque).max(axis=0) / peak).max(),
            find_reach(found) / reach,
        )
        for name, (motion, found) in rows.items()
    }
    columns = ["duration [s]", "torque, of given", "vibration, of given"]
    click.echo(f"{arm.name}: {best.reason}; {seconds:.1f} s of processor time")
    click.echo(pd.DataFrame.from_dict(table, orient="index", columns=columns).to_string(float_format="{:.4g}".format))
    seen = replay(arm, mechanism, best.motion, case)
    if arm.bending:
        reach = replay(arm, mechanism, move, case).left
    return judge_replay(arm, seen, solve_motion(arm, mechanism, best.motion, error=True), reach)


def make_shaped(arm: Arm, mechanism: Mechanism, kind: str) -> Motion:
    """Return the given motion, shaped for the slowest mode at its end."""
    if not mechanism.closures:
        return flexinv.make_shaped_motion(mechanism, arm.move, kind).motion
    last = solve_motion(arm, mechanism, arm.move).find_residual_vibration().modes
    return arm.move.shaped(flexinv.make_shaper(kind, float(last.frequency[0]), float(last.ratio[0])))


def try_payloads(arm: Arm, reach: float, rows: dict[str, tuple[Motion, flexinv.Solution]]) -> None:
    """Add the shortest motion that is good for all payloads, each of which is a row; reach : of the given motion [m]."""
    loaded = arm.list_loaded()
    if not loaded:
        return
    given = [solve_motion(arm, one, arm.move) for one in loaded]
    peaks = np.max([np.abs(one.torque).max(axis=0) for one in given], axis=0)
    largest = dict(zip(given[0].torque_names, peaks.tolist(), strict=True))
    limits = flexinv.MotionLimits(torque=largest, residual=ROBUST * reach)
    found = flexinv.optimize_motion(loaded, arm.move, limits, knots=arm.knots, start=arm.start)
    click.echo(f"for all payloads: {found.reason}")
    for one, word in zip(loaded, ("lighter", "as it is", "heavier"), strict=True):
        rows[f"robust, {word}"] = found.motion, solve_motion(arm, one, found.motion)


def judge_replay(arm: Arm, seen: Replay, solution: flexinv.Solution, reach: float) -> list[str]:
    """Print how far Exudyn is off, and return what it does not confirm, in words; reach : of the given motion [m]."""
    size = np.abs(solution.torque).max(axis=0)
    part = slice(0, STEPS + 1)
    off = (np.abs(seen.torque - solution.torque[part]) / size).max()
    bars = ((seen.error + solution.torque_error[part]) / size).max()
    click.echo(
        f"{ENGINE}: torques differ by {off:.2%} of the largest, both bars are {bars:.2%}; its tip goes {seen.left:.3g} m from "
        f"rest afterwards, {seen.left / reach:.2%} of the given motion's\n"
    )
    failed = []
    if off > bars + AGREED_TORQUE:
        failed.append(f"{arm.name}: torques of {ENGINE} differ by {off:.2%}")
    if seen.left > AGREED_RESIDUAL * reach:
        failed.append(f"{arm.name}: {seen.left / reach:.2%} of the vibration is left in {ENGINE}")
    return failed


if __name__ == "__main__":
    main()
