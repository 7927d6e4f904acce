"""torques: the efforts of a robot's joints for a motion in a file or a table, in one call."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexinv.analysis.solution import list_effort_labels
from flexinv.model.mechanism import Mechanism
from flexinv.sampled.torque_run import Friction, Payload, TorqueRequest, make_torque_run

if TYPE_CHECKING:
    import pandas as pd


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
    run = make_torque_run(robot, motion, TorqueRequest(payload, gravity, friction, hold, spacing, step, initial))
    import pandas

    found = list(run.compute())
    values = np.concatenate([one.values for one in found])
    timed = found[0].time is not None
    rows = np.concatenate([one.time for one in found if one.time is not None]) if timed else np.arange(len(values))
    index = pandas.Index(rows, name="time [s]" if timed else "row")
    return pandas.DataFrame(values, columns=list_effort_labels(run.mechanism), index=index)
