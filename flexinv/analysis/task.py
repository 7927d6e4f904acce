"""Task: a mechanism's mesh, the instants, what its joints do there, and settings; the common entrance of the public verbs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from flexinv.constraints.loop_starts import (
    SAGGED,
    TYPED_DIGITS,
    build_joint_mask,
    check_branch,
    check_rates,
    find_picked_start,
)
from flexinv.dynamics.generalized_alpha import EXACT, Scheme, build_generalized_alpha
from flexinv.dynamics.solver import Efforts
from flexinv.errors import InputError
from flexinv.kinematics.mesh import Mesh, build
from flexinv.kinematics.nodal_motion import JointHistory
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion, evaluate_motion, resolve_start_coordinates
from flexinv.typing import Array, Triple
from flexinv.validation import check_callable, check_choice, check_kind, check_number, check_seconds, check_whole_number

# A sampling grid longer than this is a mistake in `step` far more often than a wish.
MOST_SAMPLES = 5_000_000
INITIAL = {"consistent": "starts undeformed", "static": "in equilibrium"}

Progress = Callable[[int], None]
Start = Mapping[str, ArrayLike] | None
Words = dict[str, float | int | str | bool]


@dataclass(frozen=True)
class Settings:
    """Options of a time integration and of the second step.

    step : between samples [s]; spectral_radius : numerical damping [-]; initial : "consistent" or "static"
    incremental : accelerations are differences of nodal positions
    tolerance : of Newton over the mechanism's length [-], None where a verb has its own
    every : of so many steps one is kept [-]; statics : one sample at rest, nothing is integrated
    """

    step: float = 0.0
    spectral_radius: float = 0.8
    initial: str = "consistent"
    incremental: bool = False
    tolerance: float | None = EXACT
    every: int = 1
    statics: bool = False

    @property
    def scheme(self) -> Scheme:
        """Return the scheme of the time integration [s], [-]; raises InputError for numbers that give none."""
        return build_generalized_alpha(
            self.step, self.spectral_radius, EXACT if self.tolerance is None else self.tolerance
        )

    def describe_settings(self) -> Words:
        """Return the settings as a Solution records them [s], [-]."""
        if self.statics:
            return {"statics": True, "incremental": False}
        names = ("step", "spectral_radius", "initial", "incremental", "tolerance")[: 4 if self.tolerance is None else 5]
        return {name: getattr(self, name) for name in names}


def check_settings(step: float, spectral_radius: float, tolerance: float, initial: str = "consistent") -> Settings:
    """Return the settings of a march at steps of ``step`` [s]; raises InputError for values that cannot be."""
    radius = check_number("spectral_radius", spectral_radius, "0 (strong) to 1 (no numerical damping), for example 0.8")
    found = check_number("tolerance", tolerance, "a part of the mechanism's length, for example 1e-9")
    build_generalized_alpha(float(step), radius, found)  # numbers that give no scheme are an error here
    return Settings(float(step), radius, str(initial), tolerance=found)


@dataclass(frozen=True)
class Task:
    """The prescribed motion of a mechanism, and the settings by which its torques are computed.

    steps : (steps + 1,) all instants from the start on [s]
    before, after : time -> q (samples, nq), qd, qdd (samples, nv) [rad or m, s], the left-hand and the right-hand limit where
        accelerations jump; joints named in ``passive`` at their start
    jumps : times at which accelerations jump [s]; stated_rates : passive joints whose rate at the start is kept in loops
    seams : samples between which steps are equal, the integrator begins anew at each; none where all steps are equal
    efforts : of the drives of passive joints, which their torque moves (`dynamics.solver.Efforts`) [N m], [N]
    progress : called with the number of steps done since its last call; part : kept samples of a part [-], None for one part
    knots : times between which the prescribed motion is smooth [s]
    """

    mesh: Mesh
    steps: Array
    before: JointHistory
    after: JointHistory
    passive: Collection[str]
    settings: Settings
    jumps: tuple[float, ...] = ()
    stated_rates: Collection[str] = ()
    efforts: Efforts | None = None
    progress: Progress | None = None
    part: int | None = None
    seams: tuple[int, ...] = ()
    knots: tuple[float, ...] = ()

    @property
    def time(self) -> Array:
        """Return the instants that are kept [s]."""
        return self.steps if self.settings.every == 1 else self.steps[:: self.settings.every]


def check_task(mechanism: Mechanism, motion: Motion, initial: str, every: int, progress: Progress | None) -> int:
    """Return ``every`` [-]; raises InputError for a mechanism, a motion, a start or a progress that is none."""
    check_kind("mechanism", mechanism, Mechanism)
    check_kind("motion", motion, Motion, ("evaluate", "joints", "jumps", "duration"))
    check_choice("initial", initial, INITIAL)
    check_callable("progress", progress, "a function of the number of steps done since its last call")
    return check_whole_number("every", every, 1, "1 to keep all steps, or more to keep one of so many")


def make_prescribed_task(
    mechanism: Mechanism, motion: Motion, steps: Array, settings: Settings, start: Start, start_rate: Start,
    progress: Progress | None = None,
) -> Task:  # fmt: skip
    """Return the task of a motion at the instants ``steps`` [s]: joints that it leaves out are passive and start where stated.

    A motion that is the same seen from both sides is evaluated once; in loops the start is moved onto the branch that it names.
    """
    mesh = build(apply_stated_ratio(mechanism))
    passive = set(mechanism.moving_names) - set(motion.joints(mechanism))
    start_coordinates = resolve_start_coordinates(mechanism, passive, start, start_rate)
    before, after = build_joint_histories(motion, mechanism, start_coordinates, settings, steps)
    if mechanism.closures and start and passive:
        now = (part[0] for part in after(steps[:1]))
        q = find_picked_start(
            mesh, float(steps[0]), build_joint_mask(mechanism, passive), build_joint_mask(mechanism, start), *now
        )
        if q is not None:  # from which the loops close where the start says, or nearest to that
            start = {name: q[mechanism.q_slices[name]] for name in passive}
            start_coordinates = resolve_start_coordinates(mechanism, passive, start, start_rate)
            before, after = build_joint_histories(motion, mechanism, start_coordinates, settings, steps)
    knots = tuple(getattr(motion, "knots", motion.jumps))
    return Task(
        mesh, steps, before, after, passive, settings, motion.jumps, start_rate or (), progress=progress, knots=knots
    )


def check_start(task: Task, motion: Motion, start: Start, start_rate: Start, q: Array, qd: Array) -> None:
    """Raise an error where closures contradict what was told of the first instant, found at q (nq,), qd (nv,) [rad or m, s]."""
    mesh = task.mesh
    m = task.mesh.mechanism
    start_coordinates = resolve_start_coordinates(m, task.passive, start, start_rate)
    told = build_joint_histories(motion, m, start_coordinates, task.settings, task.steps)[1](task.steps[:1])
    check_branch(mesh, set(start or ()), told[0][0], q)
    most = SAGGED if task.settings.initial == "static" and not m.is_rigid else TYPED_DIGITS
    check_rates(mesh, build_joint_mask(m, set(start_rate or ())), told[1][0], qd, float(task.steps[0]), most)


def prepare_motion_samples(task: Task) -> Task:
    """Return the task with the joint motion [rad or m, s] at its instants taken from one evaluation, where that is the same."""
    m = task.mesh.mechanism
    if task.settings.every > 1 or task.jumps or (m.closures and m.is_rigid):
        return task
    time = task.time
    history = task.after
    for part in (table := history(time)):
        part.flags.writeable = False

    def read_samples(at: Array) -> Triple:
        first = int(np.searchsorted(time, at[0]))
        last = first + len(at)  # both are parts of one grid where their ends are
        if last > len(time) or time[first] != at[0] or time[last - 1] != at[-1]:
            return history(at)
        return table[0][first:last], table[1][first:last], table[2][first:last]

    return replace(task, before=read_samples, after=read_samples)


def build_time_grid(motion: Motion, step: float, end: float | None, every: int) -> Array:
    """Return the times of all steps, the start included (steps + 1,) [s]; raises InputError for a step or end that cannot be."""
    step = check_seconds("step", step, "a positive number of seconds, for example step=1e-3")
    last = resolve_last_time(motion, end)
    given = f"step = {step:g} s"
    if step > last:
        raise InputError(f"{given} is longer than the motion ({last:g} s): write a smaller step, say {last / 200:g}")
    count = int(np.floor(last / step * (1 + 1e-9)))  # the last sample is the end when step divides it, up to rounding
    if count >= (most := MOST_SAMPLES * max(every, 1)):
        write = "write a larger step, or every=10 to keep one step of ten"
        raise InputError(f"{given} gives {count} samples in {last:g} s, more than {most}: {write}")
    return np.asarray(step * np.arange(count + 1))


def resolve_last_time(motion: Motion, end: float | None) -> float:
    """Return the last time [s], the motion's duration where ``end`` is None; raises InputError for one that cannot be."""
    return check_seconds(
        "end", motion.duration if end is None else end, "a positive time, or None for the motion's duration"
    )


def build_joint_histories(
    motion: Motion, mechanism: Mechanism, stated: tuple[dict[str, Array], dict[str, Array]], settings: Settings, grid: Array
) -> tuple[JointHistory, JointHistory]:  # fmt: skip
    """Return joint motion [rad or m, s] with the passive joints where ``stated``: left-hand limits at jumps, and right-hand ones.

    stated : start coordinates and rates by joint; grid : the times of which a table may be kept
    """
    uniform = len(grid) > 1 and grid[1] == settings.step and grid[-1] == grid[1] * (len(grid) - 1)

    def evaluate_joint_motion(time: Array, side: str) -> Triple:
        if time is grid and side == "right" and uniform:
            q, qd, qdd = (
                part.copy() for part in evaluate_motion(motion, mechanism, settings.step * np.arange(len(grid)))
            )
        else:
            q, qd, qdd = motion.evaluate(mechanism, time, side)  # type: ignore[arg-type]
        for name, value in stated[0].items():
            q[:, mechanism.q_slices[name]] = value
        for name, value in stated[1].items():
            qd[:, mechanism.v_slices[name]] = value
        return q, qd, qdd

    return (lambda time: evaluate_joint_motion(time, "left")), (lambda time: evaluate_joint_motion(time, "right"))


def make_rest_history(q: Array, qd: Array, qdd: Array) -> JointHistory:
    """Return a joint motion that is at all times the state q (nq,), qd, qdd (nv,) [rad or m, s]."""
    return lambda time: (np.tile(q, (len(time), 1)), np.tile(qd, (len(time), 1)), np.tile(qdd, (len(time), 1)))
