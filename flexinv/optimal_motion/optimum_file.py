"""Motions to be chosen: tables [optima.NAME] of cases.toml, a case whose ends stay, an aim and limits.

The rows of a motion that was found are a CSV file, which a sampled case reads: with `rest = true` its spline is that motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.errors import InputError
from flexinv.files.case_schema import read_cases
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.toml_tables import Location, Table, check_table, check_table_names, make_key, make_optional_key
from flexinv.files.values import Count, Name, NotNegative, Number, Positive, Text
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.model.motion import Motion
from flexinv.optimal_motion.motion_limits import LIMITED_BY_JOINT, MotionLimits, StrainLimit
from flexinv.optimal_motion.optimize_motion import USUAL_KNOTS, read_aim
from flexinv.validation import check_kind, find_nearest_word

EXACT_DIGITS = 17  # of a number, so that it is the same when it is read


class StrainTable(Table):
    """Largest strain of a beam's fibres."""

    largest: Positive = make_key("the largest strain along the axis, > 0 [-]", "2e-3")
    y_m: NotNegative = make_key("of fibres as far from the axis along y of the section [m]", "0.01")
    z_m: NotNegative = make_key("of fibres as far from the axis along z of the section [m]", "0.005")


class MotionLimitsTable(Table):
    """Limits that hold at every instant."""

    torque: dict[str, Positive] | None = make_optional_key(
        "joint = largest effort of its drive [N m], [N]; the largest of the case when absent", "{ hub = 2.0 }"
    )
    rate: dict[str, Positive] = make_key("joint = largest rate [rad/s], [m/s]", "{ hub = 10.0 }", {})
    acceleration: dict[str, Positive] = make_key("joint = largest of it [rad/s^2], [m/s^2]", "{ hub = 100.0 }", {})
    jerk: dict[str, Positive] = make_key("joint = largest jerk [rad/s^3], [m/s^3]", "{ hub = 1e4 }", {})
    force: dict[str, Positive] = make_key("joint = largest force that it carries [N]", "{ hub = 50.0 }", {})
    moment: dict[str, Positive] = make_key("joint = largest moment that it carries [N m]", "{ hub = 5.0 }", {})
    strain: dict[str, StrainTable] = make_key(
        "beam = largest strain of its fibres", "{ link = { largest = 2e-3, y_m = 0.01, z_m = 0.005 } }", {}
    )
    path_m: dict[str, Positive] = make_key(
        "link = largest distance of its tip from its path in the case [m]", "{ link = 0.01 }", {}
    )
    residual_m: Positive | None = make_optional_key(
        "largest distance of a tip from its rest place after the end [m]; a hundredth of the case's when absent", "1e-4"
    )


class OptimumTable(Table):
    """A motion to be chosen."""

    title: Text = make_key("one line that says what it is", '"as short as the drives allow"', "")
    case: Name = make_key("the case whose ends, mesh and start it has", '"cycloid"')
    aim: str | dict[str, Number] = make_key(
        'to be small: "duration", "residual", "peak torque", "rms torque", "work", or several with weights',
        '"duration"',
        "duration",
    )
    knots: Count = make_key("rows of every joint that are chosen, >= 1 [-]", "10", USUAL_KNOTS)
    step_s: Positive | None = make_optional_key(
        "the time step of the search [s]; a two hundredth of the case's motion when absent", "1e-3"
    )
    limits: MotionLimitsTable = make_key("a table of limits", "limits.residual_m = 1e-4", MotionLimitsTable())


@dataclass(frozen=True)
class OptimumTask:
    """A motion to be chosen, as `optimize_motion` takes it.

    case : whose motion is to be bettered; step : of the search [s], None for the usual one
    """

    name: str
    title: str
    case: Case
    aim: str | Mapping[str, float]
    knots: int
    step: float | None
    limits: MotionLimits


def read_optima(path: str | Path, mechanism: Mechanism) -> dict[str, OptimumTask]:
    """Load the motions to be chosen of a mechanism by name, none where there are none [m], [s], [rad].

    path : ``models/<name>`` or the TOML file.  The format is described in models/README.md.
    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    """
    check_kind("mechanism", mechanism, Mechanism)
    file, whole = read_cases(path)
    check_table_names(file, optima=whole.optima)
    if not whole.optima:
        return {}
    cases = load_cases(path, mechanism)
    return {
        name: _read_optimum(data, name, cases, mechanism, Location(file, f"optima.{name}"))
        for name, data in whole.optima.items()
    }


def _read_optimum(
    data: Any, name: str, cases: Mapping[str, Case], mechanism: Mechanism, where: Location
) -> OptimumTask:
    table = check_table(OptimumTable, data, where)
    if table.case not in cases:
        near = find_nearest_word(table.case, list(cases)) or next(iter(cases))
        expected = f"a case of this file: {', '.join(cases)}"
        raise where.make_error("case", f'case = "{table.case}"', expected, f'case = "{near}"')
    limits = _read_limits(table.limits)
    try:
        limits.check_names(mechanism)
    except InputError as error:
        raise InputError(f"{where.make_inner_location('limits').describe_key()}: {error}") from None
    try:
        read_aim(table.aim)
    except InputError as error:
        raise InputError(f"{where.describe_key('aim')}: {error}") from None
    return OptimumTask(name, table.title, cases[table.case], table.aim, table.knots, table.step_s, limits)


def _read_limits(table: MotionLimitsTable) -> MotionLimits:
    """The limits of a table."""
    by_joint = {name: getattr(table, name) for name in LIMITED_BY_JOINT}
    strain = {name: StrainLimit(limit.largest, limit.y_m, limit.z_m) for name, limit in table.strain.items()}
    return MotionLimits(**by_joint, strain=strain, path=table.path_m, residual=table.residual_m)


def write_rows(motion: Motion, mechanism: Mechanism, path: Path) -> None:
    """Write the rows of a motion through equal times as the CSV file of a sampled case [s], [rad], [m]."""
    (track,) = motion.tracks
    assert track.sampling is not None
    joints = motion.joints(mechanism)
    units = [KINDS[mechanism.joint_of[name].kind].units[0] for name in joints]
    names = ",".join(["time_s", *(f"{name}_{unit}" for name, unit in zip(joints, units, strict=True))])
    rows = [
        ",".join(f"{number:.{EXACT_DIGITS}g}" for number in (time, *row))
        for time, row in zip(track.sampling.time, np.asarray(track.values), strict=True)
    ]
    path.write_text("\n".join([names, *rows, ""]))
