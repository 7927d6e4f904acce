"""One motion of one robot on its way to efforts: what is asked, part after part, and what is learned on the way."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.solution import Solution, list_effort_units
from flexinv.analysis.solve import solve
from flexinv.analysis.solve_in_parts import solve_in_parts
from flexinv.analysis.task import INITIAL
from flexinv.errors import ModelWarning
from flexinv.files.csv_dialect import Share
from flexinv.files.motion_table import MotionPart, MotionSource, open_motion
from flexinv.files.robot_file import read_robot_file
from flexinv.files.toml_tables import make_input_error
from flexinv.model.joint_kinds import KINDS
from flexinv.model.joints import Joint
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.rigid.prepare import prepare
from flexinv.sampled.limits_passed import PassedLimits
from flexinv.sampled.motion_checks import DigitNoise, SlopeCheck
from flexinv.sampled.sampled_motion import (
    AnyMotion,
    HermiteMotion,
    MotionSamples,
    list_place_slices,
    make_even_times,
    read_whole_motion,
    sample_motion,
)
from flexinv.typing import Array
from flexinv.validation import (
    check_choice,
    check_finite_array,
    check_mapping,
    check_number,
    check_seconds,
    find_nearest_word,
    refuse,
)

if TYPE_CHECKING:
    import pandas as pd

Payload = Mapping[str, Body | Inertia | float]
Friction = bool | Mapping[str, Sequence[float]]
ROWS = 50_000  # samples in memory at once
WORTH_SAYING = 1e-3  # noise of digits, over the root mean square of the effort [-]


@dataclass(frozen=True)
class TorqueRequest:
    """Options of `torques` beside robot and motion, as its caller has written them."""

    payload: Payload | None
    gravity: ArrayLike | None
    friction: Friction
    hold: Mapping[str, Any] | None
    spacing: float | None
    step: float | None
    initial: str


@dataclass(frozen=True)
class EffortRows:
    """Consecutive rows of the answer: number of the first one, times [s] or None, efforts (samples, nv) [N m], [N]."""

    first: int
    time: Array | None
    values: Array


@dataclass
class TorqueRun:
    """One motion of one robot on its way through: what is asked, and what is learned."""

    mechanism: Mechanism
    table: MotionSource
    rows: int
    step: float | None
    initial: str
    progress: Share | None
    check: SlopeCheck
    noise: DigitNoise
    passed: PassedLimits
    samples: int = 0
    peak: Array = field(default_factory=lambda: np.zeros(0))
    square: Array = field(default_factory=lambda: np.zeros(0))

    def compute(self) -> Iterator[EffortRows]:
        """Yield the efforts; their peaks and squares are summed on the way."""
        self.peak = np.zeros(self.mechanism.nv)
        self.square = np.zeros(self.mechanism.nv)
        found = self._compute_rigid() if self._is_given_whole() else self._solve()
        for one in found:
            self.samples += len(one.values)
            self.peak = np.maximum(self.peak, np.abs(one.values).max(axis=0))
            self.square += np.einsum("ij,ij->j", one.values, one.values)
            yield one
        noise = self._describe_noise()
        for words in (*self._describe_free(), *self.check.describe_unchecked(), *self.passed.describe(), *noise):
            warnings.warn(f"{self.table.label}: {words}", ModelWarning, stacklevel=3)

    @property
    def rms(self) -> Array:
        """Root mean square of each effort [N m], [N]."""
        return np.sqrt(self.square / max(self.samples, 1))

    def _is_given_whole(self) -> bool:
        """Return True if the efforts follow from each sample by itself: rigid links, and all joints in the motion."""
        m = self.mechanism
        given = {column.joint for column in self.table.columns.positions} | set(self.table.hold)
        switched = any(closure.active or closure.capture for closure in m.closures)
        return m.is_rigid and not switched and all(joint.name in given for joint in m.moving_joints)

    def _compute_rigid(self) -> Iterator[EffortRows]:
        function = prepare(self.mechanism)
        parts = self.check.check_parts(self.table.read_parts(self.rows, self.progress))
        for one in sample_motion(self.table, parts):
            self.noise.update(one, function.torques)
            tau = function.torques(one.q, one.qd, one.qdd)
            self.passed.update(one.q, one.qd, tau)
            yield EffortRows(one.first, one.time, tau)

    def _solve(self) -> Iterator[EffortRows]:
        """Arms that bend, and loops whose passive joints the motion leaves out: by `solve`, the whole motion in memory."""
        parts = self.check.check_parts(iter([read_whole_motion(self.table, self.rows)]))
        whole = next(parts)
        if whole.time is None or len(whole.time) < 2:
            expected = "a column of times [s], or the spacing of the samples: an arm that bends remembers its motion"
            raise make_input_error(
                self.table.label, "no times", expected, "time_s as the first column, or spacing 0.001 s"
            )
        next(parts, None)
        self.noise.update(MotionSamples(0, whole.time, *3 * (whole.positions,)), None)
        time = make_even_times(whole.time, self.table.time_digit)
        spacing = (time[-1] - time[0]) / (len(time) - 1)
        even = float(np.abs(np.diff(time) - spacing).max()) <= 1e-9 * spacing + 4.0 * float(np.spacing(time[-1]))
        step, every = self._resolve_step(spacing, even)
        motion = self._make_motion(whole, time - time[0])
        start = float(whole.time[0])
        steps = round((time[-1] - time[0]) / step)

        marched = [0]

        def add_steps(done: int) -> None:
            marched[0] += done
            if self.progress is not None:
                self.progress(min(marched[0] / max(steps, 1), 1.0))

        options: dict[str, Any] = {"initial": self.initial, "progress": add_steps, "every": every}
        first = 0
        for k, solution in enumerate(self._list_solutions(motion, step, options)):
            skipped = slice(1 if k else 0, None)
            values = solution.torque_all[skipped]
            self.passed.update(solution.q, solution.qd, solution.torque_all)
            piece = slice(first, first + len(values))
            times = (
                whole.time[piece] if even and len(whole.time[piece]) == len(values) else start + solution.time[skipped]
            )
            yield EffortRows(first, times, values)
            first += len(values)

    def _list_solutions(self, motion: AnyMotion, step: float, options: Mapping[str, Any]) -> Iterator[Solution]:
        """A motion of few samples, and every one of a loop, as a whole."""
        given: Any = motion  # `solve` asks a motion for its members, whatever its kind
        if self.mechanism.closures:
            return iter([solve(self.mechanism, given, step, **options)])
        return solve_in_parts(self.mechanism, given, step, self.rows, **options)

    def _resolve_step(self, spacing: float, even: bool) -> tuple[float, int]:
        """The time step [s], and of how many steps one is a row."""
        if self.step is None:
            if even:
                return spacing, 1
            given = f"samples that are not evenly spaced, {spacing:.4g} s apart on average, and links that bend"
            write = f"a step of the time integration: step = {spacing / 2:.2g}"
            raise make_input_error(
                self.table.label, given, "even samples, or the step [s] at which rows are written", write
            )
        count = round(spacing / self.step)
        fits = even and count >= 1 and abs(count * self.step - spacing) <= 1e-6 * spacing
        return (spacing / count, count) if fits else (self.step, 1)

    def _make_motion(self, whole: MotionPart, time: Array) -> AnyMotion:
        """Given rates and accelerations where joints are numbers of their own; else the spline through positions."""
        m = self.mechanism
        given = {column.joint for column in self.table.columns.positions} | set(self.table.hold)
        joints = [joint for joint in m.moving_joints if joint.name in given]
        if whole.accelerations is not None and all(KINDS[joint.kind].scalar for joint in joints):
            angles = np.zeros((len(time), m.nv))
            for joint, places in list_place_slices(m):
                angles[:, m.v_slices[joint.name]] = whole.positions[:, places]
            assert whole.rates is not None
            return HermiteMotion(time, angles, whole.rates, whole.accelerations, tuple(joint.name for joint in joints))
        columns = {
            joint.name: whole.positions[:, places] for joint, places in list_place_slices(m) if joint.name in given
        }
        return Motion.from_samples(time, columns)

    def _describe_free(self) -> Iterator[str]:
        """Joints of a tree that nobody moves."""
        given = {column.joint for column in self.table.columns.positions} | set(self.table.hold)
        free = [joint.name for joint in self.mechanism.moving_joints if joint.name not in given]
        if free and not self.mechanism.closures:
            yield f"joints without actuator and column move as forces make them: {', '.join(free)}"

    def _describe_noise(self) -> Iterator[str]:
        """Noise that the digits of the file make in the efforts, where that is worth a word."""
        noise = self.noise
        whose = self.table.columns
        digits = "accelerations" if whose.accelerations else "rates" if whose.rates else "positions"
        more = "more digits" if whose.accelerations else "more digits, or accelerations beside them"
        if noise.effort is not None:
            units = list_effort_units(self.mechanism)
            shares = noise.effort / np.maximum(self.rms, 1e-300)
            loud = [k for k in np.argsort(-shares) if shares[k] > WORTH_SAYING and noise.effort[k] > 0.0]
            said = [
                f"{noise.effort[k]:.2g} {units[k]} in {self.mechanism.velocity_names[k]} ({shares[k]:.2g} of its effort's rms)"
                for k in loud[:6]
            ]
            if said:
                words = f"rms {', '.join(said)}, more at the ends"
                yield f"the last digit of {digits} makes noise in the efforts, {words}; write {more}"
        elif (
            noise.acceleration is not None
            and not self.mechanism.is_rigid
            and noise.acceleration.max(initial=0.0) > 1e-3
        ):
            worst = int(np.argmax(noise.acceleration))
            size = f"{noise.acceleration[worst]:.2g} per s^2 in {self.mechanism.velocity_names[worst]}"
            yield f"the last digit of {digits} makes noise in accelerations, {size}, which shakes links that bend; write {more}"


def make_torque_run(
    robot: str | Path | Mechanism, motion: str | Path | pd.DataFrame, request: TorqueRequest, rows: int = ROWS,
    progress: Share | None = None,
) -> TorqueRun:  # fmt: skip
    """Return a run that has read robot and header, and nothing else yet; rows : in memory at once [-].  Raises InputError."""
    mechanism = robot if isinstance(robot, Mechanism) else read_robot_file(robot)
    loads = check_mapping("payload", request.payload, "a table of links and what they carry", 'payload={"tool0": 2.0}')
    for link, load in loads.items():
        mechanism = mechanism.with_body(link, _make_payload(mechanism, link, load))
    if request.gravity is not None:
        mechanism = replace(mechanism, gravity=check_finite_array("gravity", request.gravity, (3,), "m/s^2"))
    mechanism = _apply_friction(mechanism, request.friction)
    standing = check_mapping("hold", request.hold, "a table of joints and where they stand", 'hold={"finger": 0.02}')
    check_choice("initial", request.initial, INITIAL)
    step = None if request.step is None else check_seconds("step", request.step, "a time step above 0 [s]")
    table = open_motion(motion, mechanism, standing, request.spacing)
    judges = SlopeCheck(table), DigitNoise(table), PassedLimits(mechanism)
    return TorqueRun(mechanism, table, rows, step, request.initial, progress, *judges)


def _make_payload(mechanism: Mechanism, link: str, load: object) -> Body:
    """A body [kg] on a link: at the tip of one that is a beam, where nothing else is said."""
    if link not in mechanism.link_of:
        near = find_nearest_word(str(link), mechanism.link_of) or ""
        refuse("payload: link", link, f"one that {mechanism.name} has: {', '.join(mechanism.link_of)}", near)
    if isinstance(load, Body):
        return load
    if not isinstance(load, Inertia):
        mass = check_number(f"payload: link {link!r}", load, "a mass [kg], a flexinv.Inertia or a flexinv.Body")
        load = Inertia(mass)
    return Body("payload", load, None if mechanism.link_of[link].beam is None else 1.0)


def _apply_friction(mechanism: Mechanism, friction: Friction) -> Mechanism:
    """The mechanism with the friction of its joints as asked: stated, none, or other numbers [N m], [N m s/rad]."""
    if isinstance(friction, bool | np.bool_) and friction:
        return mechanism
    if isinstance(friction, bool | np.bool_):
        return replace(mechanism, joints=tuple(_remove_friction(joint) for joint in mechanism.joints))
    stated = check_mapping("friction", friction, "True, False or a table of joints", 'friction={"elbow": (0.5, 0.1)}')
    joints = dict(mechanism.joint_of)
    for name, numbers in stated.items():
        if name not in joints or not joints[name].nv or joints[name].drive is not None:
            without = [joint.name for joint in mechanism.moving_joints if joint.drive is None]
            refuse("friction: joint", name, f"one that moves and has no drive of its own: {', '.join(without[:12])}")
        dry, viscous = check_finite_array(f"friction: joint {name!r}", numbers, (2,), "N m, N m s/rad")
        joints[name] = replace(joints[name], friction=float(dry), damping=float(viscous))
    return replace(mechanism, joints=tuple(joints.values()))


def _remove_friction(joint: Joint) -> Joint:
    drive = joint.drive
    if drive is not None:
        drive = replace(drive, viscous=0.0, coulomb=0.0, static=0.0)
    return replace(joint, friction=0.0, damping=0.0, drive=drive)
