"""Shortest motions of the gallery's arms beside shaped ones, each replayed in Exudyn.

    python campaigns/optimal_motions.py
    python campaigns/optimal_motions.py --only spatial_arm
    python campaigns/optimal_motions.py --random 30    # random trees as well

Of each arm: the given motion, the same shaped for its slowest mode (ZV, ZVD, EI), and the shortest motion with the torques of the
given one and a hundredth of its vibration.  Exudyn then makes the motion that was found with a model of its own: its torques, and
how far its tip goes from the rest place afterwards.  The command ends with 1 where torques differ by more than both bars, or more
of the vibration is left.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections import Counter
from dataclasses import dataclass, replace
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
    """An arm of models/ and the ends of its joints [rad]; duration [s] of the given move."""

    name: str
    ends: dict[str, float]
    duration: float
    knots: int

    def load(self) -> Mechanism:
        """Return the mechanism."""
        return flexinv.load_mechanism(ROOT / "models" / self.name)

    @property
    def move(self) -> Motion:
        """The given motion."""
        return Motion.point_to_point(dict.fromkeys(self.ends, 0.0), self.ends, duration=self.duration)


ARMS = (
    Arm("flex_one_link", {"hub": np.pi}, 0.2, 8),
    Arm("flex_two_link", {"joint1": 0.5, "joint2": 1.0}, 0.2, 10),
    Arm("spatial_arm", {"yaw": 0.6, "pitch": 0.5}, 0.3, 10),
)


def solve_motion(mechanism: Mechanism, motion: Motion, error: bool = False) -> flexinv.Solution:
    """Return the solution of a motion until shortly after its end."""
    step = motion.duration / STEPS
    return flexinv.solve(mechanism, motion, step=step, end=(STEPS + 2) * step, initial="static", error=error)


def find_reach(solution: flexinv.Solution) -> float:
    """Return the largest distance of a tip from its rest place after the end [m]."""
    return max(solution.find_residual_vibration().reach.values())


@dataclass(frozen=True)
class Replay:
    """A motion in Exudyn: torques with error bars (samples, drives) [N m], and how far the tip goes from rest afterwards [m]."""

    torque: Array
    error: Array
    left: float


def replay(mechanism: Mechanism, motion: Motion, case: flexinv.Case) -> Replay:
    """Return what Exudyn gives for a motion, with a mesh and steps of its own and the bars of refined ones."""
    step = motion.duration / STEPS
    later = int(np.ceil(AFTER / step))
    asked = replace(
        case, motion=motion, step=step, sample=step, end=(STEPS + later) * step, quantities=("torque", "tip"),
        initial="static", mesh=None, measured=None,
    )  # fmt: skip
    record = adapter(ENGINES[ENGINE]).run(mechanism, asked, ENGINE, {"error": True, "step": step})
    drives = [record.series[f"torque/{joint.name}"] for joint in mechanism.joints if joint.actuated]
    torque = np.stack([one.values for one in drives], axis=1)
    bars = [np.zeros(len(one.values)) if one.error is None else one.error for one in drives]
    link = mechanism.joints[-1].child
    tip = np.stack([record.series[f"tip/{link}/{axis}"].values for axis in "xyz"], axis=1)
    rest = flexinv.statics(mechanism, [], motion.evaluate(mechanism, [motion.duration])[0][0]).tip[link][0]
    left = float(np.linalg.norm(tip[STEPS:] - rest, axis=1).max())
    return Replay(torque[: STEPS + 1], np.stack(bars, axis=1)[: STEPS + 1], left)


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
    given = solve_motion(mechanism, move)
    rows = {"given": (move, given)}
    for kind in ("ZV", "ZVD", "EI"):
        shaped = flexinv.make_shaped_motion(mechanism, move, kind).motion
        rows[kind] = shaped, solve_motion(mechanism, shaped)
    begin = time.process_time()
    best = flexinv.optimize_motion(mechanism, move, knots=arm.knots)
    seconds = time.process_time() - begin
    rows["shortest"] = best.motion, solve_motion(mechanism, best.motion)
    peak = np.abs(given.torque).max(axis=0)
    reach = find_reach(given)
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
    return judge_replay(
        arm, replay(mechanism, best.motion, case), solve_motion(mechanism, best.motion, error=True), reach
    )


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
