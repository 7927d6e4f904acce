"""identify: logs of a mechanism become parameters with intervals, and torques with bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from crosscheck.identification.bands import (
    ChannelJudgement,
    Margins,
    Prediction,
    compute_margins,
    judge,
    judge_predictions,
    predict,
)
from crosscheck.identification.drives.evidence import build_terms
from crosscheck.identification.drives.friction_laws import choose_friction_laws, list_free_tables
from crosscheck.identification.estimation.combinations import list_combinations
from crosscheck.identification.estimation.days import DayFits, DayRule, check_day_rule, find_day, fit_days
from crosscheck.identification.estimation.fit import Fit, Problem, build_problem, fit
from crosscheck.identification.logs.doubts import describe_log_doubts, describe_log_failures
from crosscheck.identification.logs.log import Log, read_log
from crosscheck.identification.machine import Machine
from crosscheck.identification.parameters import build_space
from crosscheck.identification.readings import Run, make_run
from crosscheck.identification.settings import IdentifyTable, read_settings
from crosscheck.identification.table import (
    DayRow,
    Row,
    describe_conflicts,
    describe_free_scales,
    describe_unidentified,
    list_day_rows,
    list_parameter_rows,
)
from flexinv.display.card import Card, Shown
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Joint, Mechanism, Placement
from flexinv.validation import check_path as path_of
from flexinv.validation import refuse


@dataclass(frozen=True, repr=False)
class Identification(Shown):
    """A machine identified from logs.

    fit, days : of the machine, and of each day; margin : what bands of predictions are made of
    parameters : with intervals, in the unit of each; of_days : those that differ from day to day, of each day and of the machine
    seen, judged : how well the logs that identified, and those held out, are explained; shown, held : with their predictions
    words : doubts and what cannot be told
    """

    machine: Machine
    task: Problem
    fit: Fit
    days: DayFits
    margin: Margins
    parameters: list[Row]
    of_days: list[DayRow]
    seen: list[ChannelJudgement]
    judged: list[ChannelJudgement]
    shown: list[tuple[Run, Prediction]]
    held: list[tuple[Run, Prediction]]
    words: list[str]

    def _make_card(self) -> Card:
        from crosscheck.identification.card import make_identification_card

        return make_identification_card(self)

    def predict(self, log: Log) -> Prediction:
        """Return the readings of a log with 90 % bands [units of the channels]; no effort of it is looked at.

        Bands of a log of another day than those that identified hold what friction and offsets differ from day to day.
        """
        return predict(self.machine, self.choose_fit(log), self.margin, make_run(self.machine, log, efforts=False))

    def choose_fit(self, log: Log) -> Fit:
        """Return the parameters [-] as they are known on the day of a log."""
        return self.days.choose_fit(find_day(log, self.days.rule))


def read_machine(
    mechanism: Mechanism | str | Path, settings: IdentifyTable | None = None, loads: Sequence[str] = ()
) -> Machine:
    """Return a mechanism with its identify.toml [units of the parameters].

    mechanism : the folder that holds mechanism.toml and identify.toml, or a mechanism with its ``settings``
    loads : links that carry a payload in one of the logs
    Raises InputError: no such file, a key that is wrong, a mechanism without settings.
    """
    if isinstance(mechanism, Mechanism):
        if settings is None:
            raise InputError(
                f"identify: mechanism '{mechanism.name}' without settings, expected the folder that holds its identify.toml; "
                "write crosscheck.identify('models/NAME', ...) or settings=read_settings(path, mechanism)"
            )
        return _build_machine(mechanism, settings, loads)
    folder = Path(
        path_of("mechanism", mechanism, "a folder that has a mechanism.toml and an identify.toml, or a Mechanism")
    )
    read = load_mechanism(folder)
    table = read_settings(folder.parent if folder.suffix == ".toml" else folder, read) if settings is None else settings
    return _build_machine(read, table, loads)


def _build_machine(mechanism: Mechanism, settings: IdentifyTable, loads: Sequence[str]) -> Machine:
    """The machine of a log: joints that stand during all of it are fixed where they stand."""
    joints = tuple(
        _make_fixed_joint(joint, settings.stands[joint.name].value) if joint.name in settings.stands else joint
        for joint in mechanism.joints
    )
    fixed = replace(mechanism, joints=joints) if settings.stands else mechanism
    return Machine(fixed, settings, build_space(fixed, settings, loads))


def _make_fixed_joint(joint: Joint, value: float) -> Joint:
    """The fixed joint that a joint of one coordinate is at a value of it [rad], [m]."""
    slides = joint.kind == "prismatic"
    way = value if slides else joint.pitch * value / (2.0 * np.pi)
    turn = np.eye(3) if slides else Rotation.from_rotvec(value * joint.axis).as_matrix()
    at = joint.placement
    placement = Placement(at.position + at.rotation @ (way * joint.axis), at.rotation @ turn)
    return Joint(joint.name, "fixed", joint.parent, joint.child, placement, joint.station, actuated=False)


def identify(
    mechanism: Mechanism | str | Path,
    logs: Sequence[Log | str | Path],
    hold_out: Sequence[Log | str | Path] = (),
    settings: IdentifyTable | None = None,
    days: DayRule = "files",
    payloads: Mapping[str, Log | str | Path] | None = None,
) -> Identification:
    """Return parameters with 90 % intervals [unit of each], and how well logs are explained that nothing was fitted to [-].

    mechanism : folder with mechanism.toml and identify.toml, or a mechanism with ``settings``; logs : files or `Log`
    days : "files" if all parts of a file are of one day, and files are of different ones; "logs" if each log is of a day of its
        own, parts of one file, too; "one" if all are of the same day
    payloads : link -> log that identifies, too, with a payload on that link which is told as the difference [kg], [m], [kg m^2]
    Method: maximum a posteriori, `days.fit_days`.  Raises InputError: files, columns, units and numbers that cannot be used.
    """
    for name, value in (("logs", logs), ("hold_out", hold_out)):
        if isinstance(value, str | Path) or not isinstance(value, Sequence):
            refuse(name, value, "a list of files, each a path or a Log", "logs=['run.csv']")
    check_day_rule(days)
    if not logs:
        raise InputError("identify: no log, expected one at least; write logs=['run.csv']")
    loads = payloads or {}
    machine = read_machine(mechanism, settings, tuple(loads))
    given = [read_of(machine, log) for log in (*logs, *loads.values())]
    held = [read_of(machine, log) for log in hold_out]
    doubts = describe_log_doubts(machine, given, held)
    carried = [""] * len(logs) + list(loads)
    runs = [make_run(machine, log, load=load) for log, load in zip(given, carried, strict=True)]
    task, of_days = _fit_with_laws(machine, runs, [find_day(log, days) for log in given], days)
    return _build_identification(task, of_days, given, held, doubts)


def _fit_with_laws(machine: Machine, runs: list[Run], names: list[str], rule: DayRule) -> tuple[Problem, DayFits]:
    """The problem and its fits; with friction = "evidence" also of the terms that the logs speak for."""
    task, days = fit_days(machine, runs, names, rule)
    tables = (
        list_free_tables(choose_friction_laws(build_terms(task, days)))
        if machine.settings.friction == "evidence"
        else []
    )
    if not tables:
        return task, days
    wider = machine.settings.model_copy(update={"free": [*machine.settings.free, *tables]})
    space = build_space(machine.mechanism, wider, machine.space.loads)
    return fit_days(Machine(machine.mechanism, wider, space), runs, names, rule)


def _build_identification(
    task: Problem, days: DayFits, given: list[Log], held: list[Log], doubts: list[str]
) -> Identification:
    """The result of logs that identify, with how well they and those held out are explained."""
    machine = task.machine
    found = days.own[0] if len(days.own) == 1 else days.machine
    margins = compute_margins(task, found)
    table = list_parameter_rows(machine.space, found)
    told = [*describe_conflicts(table), *describe_free_scales(machine.space)]
    told += [*describe_unidentified(table), *(one.words for one in list_combinations(machine.space, found))]

    def list_predictions(runs: Sequence[Run], logs: list[Log]) -> list[tuple[Run, Prediction]]:
        fits = [days.choose_fit(find_day(log, days.rule)) for log in logs]
        return [(run, predict(machine, day_fit, margins, run)) for run, day_fit in zip(runs, fits, strict=True)]

    shown = list_predictions(task.runs, given)
    others = list_predictions([make_run(machine, log) for log in held], held)
    seen = judge_predictions(machine, shown)
    judged = judge_predictions(machine, others)
    failed = describe_log_failures(machine, [*given, *held], [*seen, *judged])
    words = [*failed, *doubts, *told]
    rows = list_day_rows(machine, days, table)
    return Identification(machine, task, found, days, margins, table, rows, seen, judged, shown, others, words)


def read_of(machine: Machine, log: Log | str | Path) -> Log:
    """Return a log [s] with the times that identify.toml names; one that is read already as it is."""
    return log if isinstance(log, Log) else read_log(log, machine.settings.time, machine.settings.time_unit)


def judge_blocks(machine: Machine, log: Log, count: int) -> list[ChannelJudgement]:
    """Judge each of ``count`` equal blocks of the window [-] by a fit to the others, in turn, and pool them."""
    run = make_run(machine, log)
    first, last = machine.settings.window_s or (float(log.time[0]), float(log.time[-1]))
    edges = np.linspace(first, last + 1e-9, count + 1)
    parts: list[Prediction] = []
    told = {
        name: np.full(run.sliding.shape, np.nan) for name in ("value", "low", "high", "parameters", "residual", "day")
    }
    for start, end in pairwise(edges):
        inside = ((run.time >= start) & (run.time < end))[:, None]
        task = build_problem(machine, (run,), (run.counted & ~inside,))
        found = fit(task)
        parts.append(predict(machine, found, compute_margins(task, found), run))
        for name, values in told.items():
            values[inside[:, 0]] = getattr(parts[-1], name)[inside[:, 0]]
    whole = Prediction(run.name, run.time, **told, sliding=run.sliding)
    return judge(machine, run, whole, run.counted & np.isfinite(whole.value))
