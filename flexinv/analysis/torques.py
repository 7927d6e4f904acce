"""torques, write_torques: the efforts of a robot's joints for a motion in a file of any length, in one call."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.given_motion import AnyMotion, GivenMotion
from flexinv.analysis.motion_checks import DigitNoise, SlopeCheck
from flexinv.analysis.sampled_motion import (
    MotionSamples,
    list_place_slices,
    make_even_times,
    read_whole_motion,
    sample_motion,
)
from flexinv.analysis.solution import Solution, list_effort_labels, list_effort_units
from flexinv.analysis.solve import solve
from flexinv.analysis.solve_in_parts import solve_in_parts
from flexinv.errors import InputError, ModelWarning
from flexinv.files.csv_dialect import Progress
from flexinv.files.motion_table import MotionPart, MotionTable, open_motion
from flexinv.files.robot_file import read_robot_file
from flexinv.files.toml_tables import make_input_error
from flexinv.model.joint_kinds import KINDS
from flexinv.model.joints import Joint
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.rigid.prepare import prepare
from flexinv.typing import Array
from flexinv.validation import check_finite_array, check_flag, check_mapping, check_number, check_whole_number, refuse

if TYPE_CHECKING:
    import pandas as pd

Payload = Mapping[str, Body | Inertia | float]
Friction = bool | Mapping[str, Sequence[float]]
ROWS = 50_000  # samples in memory at once
LEAST_ROWS = 1_000
WORTH_SAYING = 1e-3  # noise of digits, over the root mean square of the effort [-]
LINES = 2_000  # rows that become text at once


@dataclass(frozen=True)
class TorqueSummary:
    """What `write_torques` has written.

    file : where; labels : of its columns behind the first one; samples : rows [-]; peak, rms : of each column [N m], [N]
    used : of each column the part of the stated limit that its peak takes [-], nan where none is stated
    source : in words where rates and accelerations came from; left_out : columns of the motion that are none of it
    columns : coordinate -> header of its position's column
    """

    file: Path
    labels: tuple[str, ...]
    samples: int
    peak: Array
    rms: Array
    used: Array
    source: str
    left_out: tuple[str, ...]
    columns: Mapping[str, str]


@dataclass(frozen=True)
class _Efforts:
    """Consecutive rows of the answer: number of the first one, times [s] or None, efforts (samples, nv) [N m], [N]."""

    first: int
    time: Array | None
    values: Array


@dataclass
class _Run:
    """One motion of one robot on its way through: what is asked, and what is learned."""

    mechanism: Mechanism
    table: MotionTable
    rows: int
    step: float | None
    initial: str
    progress: Progress | None
    check: SlopeCheck
    noise: DigitNoise
    samples: int = 0
    peak: Array = field(default_factory=lambda: np.zeros(0))
    square: Array = field(default_factory=lambda: np.zeros(0))

    def compute(self) -> Iterator[_Efforts]:
        """Yield the efforts; their peaks and squares are summed on the way."""
        self.peak = np.zeros(self.mechanism.nv)
        self.square = np.zeros(self.mechanism.nv)
        found = self._compute_rigid() if self._is_given_whole() else self._solve()
        for one in found:
            self.samples += len(one.values)
            self.peak = np.maximum(self.peak, np.abs(one.values).max(axis=0))
            self.square += np.einsum("ij,ij->j", one.values, one.values)
            yield one
        for words in (*self.check.describe_unchecked(), *self._describe_noise()):
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
        return m.is_rigid and not switched and all(joint.name in given for joint in m.joints if joint.nv)

    def _compute_rigid(self) -> Iterator[_Efforts]:
        function = prepare(self.mechanism)
        parts = self.check.pass_on(self.table.read_parts(self.rows, self.progress))
        for one in sample_motion(self.table, parts):
            self.noise.watch(one, function.torques)
            yield _Efforts(one.first, one.time, function.torques(one.q, one.qd, one.qdd))

    def _solve(self) -> Iterator[_Efforts]:
        """Arms that bend, and loops whose passive joints the motion leaves out: by `solve`, the whole motion in memory."""
        parts = self.check.pass_on(iter([read_whole_motion(self.table, self.rows)]))
        whole = next(parts)
        if whole.time is None or len(whole.time) < 2:
            expected = "a column of times [s], or the spacing of the samples: an arm that bends remembers its motion"
            raise make_input_error(
                self.table.label, "no times", expected, "time_s as the first column, or spacing 0.001 s"
            )
        next(parts, None)
        self.noise.watch(MotionSamples(0, whole.time, *3 * (whole.positions,)), None)
        time = make_even_times(whole.time, self.table.time_digit)
        spacing = (time[-1] - time[0]) / (len(time) - 1)
        even = float(np.abs(np.diff(time) - spacing).max()) <= 1e-9 * spacing + 4.0 * float(np.spacing(time[-1]))
        step, every = self._resolve_step(spacing, even)
        motion = self._make_motion(whole, time - time[0])
        start = float(whole.time[0])
        steps = round((time[-1] - time[0]) / step)

        def tell(done: int) -> None:
            marched[0] += done
            if self.progress is not None:
                self.progress(min(marched[0] / max(steps, 1), 1.0))

        marched = [0]
        options: dict[str, Any] = {"initial": self.initial, "progress": tell, "every": every}
        first = 0
        for k, solution in enumerate(self._list_solutions(motion, step, options)):
            skipped = slice(1 if k else 0, None)
            values = solution.torque_all[skipped]
            own = slice(first, first + len(values))
            times = whole.time[own] if even and len(whole.time[own]) == len(values) else start + solution.time[skipped]
            yield _Efforts(first, times, values)
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
        step = check_number("step", self.step, "the time step [s]")
        if not 0.0 < step < np.inf:
            raise InputError(f"step = {step:g} s: expected a time step above 0 [s]")
        count = round(spacing / step)
        fits = even and count >= 1 and abs(count * step - spacing) <= 1e-6 * spacing
        return (spacing / count, count) if fits else (step, 1)

    def _make_motion(self, whole: MotionPart, time: Array) -> AnyMotion:
        """Given rates and accelerations where joints are numbers of their own; else the spline through positions."""
        m = self.mechanism
        given = {column.joint for column in self.table.columns.positions} | set(self.table.hold)
        joints = [joint for joint in m.joints if joint.nv and joint.name in given]
        if whole.accelerations is not None and all(KINDS[joint.kind].scalar for joint in joints):
            angles = np.zeros((len(time), m.nv))
            for joint, places in list_place_slices(m):
                angles[:, m.v_slices[joint.name]] = whole.positions[:, places]
            assert whole.rates is not None
            return GivenMotion(time, angles, whole.rates, whole.accelerations, tuple(joint.name for joint in joints))
        columns = {
            joint.name: whole.positions[:, places] for joint, places in list_place_slices(m) if joint.name in given
        }
        return Motion.from_samples(time, columns)

    def _describe_noise(self) -> Iterator[str]:
        """What the digits of the file make of the efforts, where that is worth a word."""
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
                yield f"the last digit of {digits} makes noise in the efforts: {', '.join(said)}; write {more}"
        elif (
            noise.acceleration is not None
            and not self.mechanism.is_rigid
            and noise.acceleration.max(initial=0.0) > 1e-3
        ):
            worst = int(np.argmax(noise.acceleration))
            size = f"{noise.acceleration[worst]:.2g} per s^2 in {self.mechanism.velocity_names[worst]}"
            yield f"the last digit of {digits} makes noise in accelerations, {size}, which shakes links that bend; write {more}"


def torques(
    robot: str | Path | Mechanism, motion: str | Path | pd.DataFrame, *, payload: Payload | None = None,
    gravity: ArrayLike | None = None, friction: Friction = True, hold: Mapping[str, Any] | None = None,
    spacing: float | None = None, step: float | None = None, initial: str = "consistent",
) -> pd.DataFrame:  # fmt: skip
    """Return the effort of every joint for a motion, over time [s], a column per coordinate: ``torque elbow [N m]``.

    robot : URDF, mechanism file or its folder; MJCF, SDF, USD where a reader is installed; or a mechanism
    motion : CSV file or table with a column of positions [rad], [m] for each joint, and of rates, and of accelerations if there
        are any, found by name and unit (`files.motion_columns`); what is missing is the derivative of a quintic spline
    payload : link -> mass [kg] at its origin, Inertia [kg, m, kg m^2] or Body; on a beam without a station at its tip
    gravity : (3,) [m/s^2], the robot's own when None
    friction : True as the robot's file states it, False none, or joint -> (dry [N m], viscous [N m s/rad])
    hold : joint without columns -> where it stands [rad], [m]; spacing : of samples without times [s]
    step, initial : of arms that bend (`solve`): time step [s], the spacing of the samples when None; "consistent" or "static"
    Raises InputError, ConvergenceError.  Warns (ModelWarning) of digits that make noise, and of what could not be compared.
    """
    run = _make_run(robot, motion, payload, gravity, friction, hold, spacing, step, initial, ROWS, None)
    import pandas

    found = list(run.compute())
    values = np.concatenate([one.values for one in found])
    timed = found[0].time is not None
    rows = np.concatenate([one.time for one in found if one.time is not None]) if timed else np.arange(len(values))
    index = pandas.Index(rows, name="time [s]" if timed else "row")
    return pandas.DataFrame(values, columns=list_effort_labels(run.mechanism), index=index)


def write_torques(
    robot: str | Path | Mechanism, motion: str | Path | pd.DataFrame, out: str | Path, *, payload: Payload | None = None,
    gravity: ArrayLike | None = None, friction: Friction = True, hold: Mapping[str, Any] | None = None,
    spacing: float | None = None, step: float | None = None, initial: str = "consistent", rows: int = ROWS,
    overwrite: bool = False, progress: Progress | None = None,
) -> TorqueSummary:  # fmt: skip
    """Write the efforts of `torques` into a CSV file [N m], [N], [s], part by part: of any length in the memory of a part.

    rows : samples in memory at once [-].  A motion of an arm that bends, or of a loop whose passive joints it leaves out, is in
        memory as a whole; the solution of a tree comes in parts
    overwrite : replace a file that is there; progress : called with the part of the work that is done [-]
    All else as for `torques`.  The file is there when all is done, or not at all.  Raises InputError, ConvergenceError.
    """
    target = _check_out(out, motion, check_flag("overwrite", overwrite))
    rows = check_whole_number("rows", rows, LEAST_ROWS, f"the samples in memory at once, {LEAST_ROWS} or more")
    run = _make_run(robot, motion, payload, gravity, friction, hold, spacing, step, initial, rows, progress)
    labels = tuple(list_effort_labels(run.mechanism))
    part = target.with_name(f"{target.name}.part{os.getpid()}")
    try:
        with part.open("w", encoding="utf-8", newline="") as stream:
            stream.write(",".join(["time [s]" if run.table.timed else "row", *labels]) + "\n")
            for one in run.compute():
                _write_rows(stream, one)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)
    c = run.table.columns
    source = "rates and accelerations given" if c.accelerations else "rates given, accelerations by a quintic spline"
    if not c.rates:
        source = "rates and accelerations by a quintic spline"
    named = {column.coordinate: column.name for column in c.positions}
    limits = np.array([joint.limits.effort for joint in run.mechanism.joints for _ in range(joint.nv)])
    used = np.where(np.isfinite(limits) & (limits > 0.0), run.peak / limits, np.nan)
    return TorqueSummary(target, labels, run.samples, run.peak, run.rms, used, source, c.left_out, named)


def _make_run(
    robot: str | Path | Mechanism, motion: str | Path | pd.DataFrame, payload: Payload | None, gravity: ArrayLike | None,
    friction: Friction, hold: Mapping[str, Any] | None, spacing: float | None, step: float | None, initial: str, rows: int,
    progress: Progress | None,
) -> _Run:  # fmt: skip
    mechanism = robot if isinstance(robot, Mechanism) else read_robot_file(robot)
    loads = check_mapping("payload", payload, "a table of links and what they carry", 'payload={"tool0": 2.0}')
    for link, load in loads.items():
        mechanism = mechanism.with_body(link, _make_payload(mechanism, link, load))
    if gravity is not None:
        mechanism = replace(mechanism, gravity=check_finite_array("gravity", gravity, (3,), "m/s^2"))
    mechanism = _apply_friction(mechanism, friction)
    standing = check_mapping("hold", hold, "a table of joints and where they stand", 'hold={"finger": 0.02}')
    table = open_motion(motion, mechanism, standing, spacing)
    return _Run(mechanism, table, rows, step, initial, progress, SlopeCheck(table), DigitNoise(table))


def _make_payload(mechanism: Mechanism, link: str, load: object) -> Body:
    """A body [kg] on a link: at the tip of one that is a beam, where nothing else is said."""
    if isinstance(load, Body):
        return load
    if not isinstance(load, Inertia):
        mass = check_number(f"payload: link {link!r}", load, "a mass [kg], a flexinv.Inertia or a flexinv.Body")
        load = Inertia(mass)
    owner = mechanism.link_of.get(link)
    return Body("payload", load, 1.0 if owner is not None and owner.beam is not None else None)


def _apply_friction(mechanism: Mechanism, friction: Friction) -> Mechanism:
    """The mechanism with the friction of its joints as asked: stated, none, or other numbers [N m], [N m s/rad]."""
    if friction is True:
        return mechanism
    if friction is False:
        return replace(mechanism, joints=tuple(_remove_friction(joint) for joint in mechanism.joints))
    stated = check_mapping("friction", friction, "True, False or a table of joints", 'friction={"elbow": (0.5, 0.1)}')
    joints = dict(mechanism.joint_of)
    for name, numbers in stated.items():
        if name not in joints or not joints[name].nv or joints[name].drive is not None:
            without = [joint.name for joint in mechanism.joints if joint.nv and joint.drive is None]
            refuse("friction: joint", name, f"one that moves and has no drive of its own: {', '.join(without[:12])}")
        dry, viscous = check_finite_array(f"friction: joint {name!r}", numbers, (2,), "N m, N m s/rad")
        joints[name] = replace(joints[name], friction=float(dry), damping=float(viscous))
    return replace(mechanism, joints=tuple(joints.values()))


def _remove_friction(joint: Joint) -> Joint:
    drive = joint.drive
    if drive is not None:
        drive = replace(drive, viscous=0.0, coulomb=0.0, static=0.0)
    return replace(joint, friction=0.0, damping=0.0, drive=drive)


def _check_out(out: str | Path, motion: object, overwrite: bool) -> Path:
    target = Path(out)
    if isinstance(motion, str | Path) and target.resolve() == Path(motion).resolve():
        raise InputError(f"{target}: it is the motion itself; write another name for the efforts")
    if target.suffix.lower() != ".csv":
        raise InputError(f"{target}: expected a name that ends in .csv, which is written part by part")
    if not target.resolve().parent.is_dir():
        raise InputError(f"{target}: the folder {target.resolve().parent} does not exist; make it first")
    if target.exists() and not (overwrite and target.is_file()):
        raise InputError(f"{target} is there already: write another name, or overwrite it if so meant")
    return target


def _write_rows(stream: TextIO, one: _Efforts) -> None:
    """Write rows as the shortest texts that give the same numbers back: many of them by one format."""
    start = np.arange(one.first, one.first + len(one.values)) if one.time is None else one.time
    table = np.column_stack([start, one.values])
    line = ",".join(["%d" if one.time is None else "%r", *["%r"] * one.values.shape[1]]) + "\n"
    for first in range(0, len(table), LINES):
        some = table[first : first + LINES]
        stream.write(line * len(some) % tuple(some.ravel().tolist()))
