"""The table of real robots: joint torques of every URDF of example-robot-data, flexinv against other engines."""

from __future__ import annotations

from typing import TypedDict

from crosscheck.measures.limits import Verdict
from crosscheck.studies.robot_sweep import LARGEST_ERROR, RobotRow, build_robot_table
from crosscheck.verdicts.study_table import StudyTable

TEXT = f"""Joint torques at random states, flexinv against Pinocchio and against MuJoCo: the largest difference over the
largest torque of that robot. At most {LARGEST_ERROR:g} is within. Damping and dry friction are left out everywhere;
robots that walk or fly have a second row with a free base.

MuJoCo refuses robots whose inertia no body can have; the row then gives its words. Mimic joints are computed as
independent ones, and counted."""

COLUMNS = (
    ("robot", "robot", ""),
    ("base", "base", ""),
    ("nv", "coordinates", ""),
    ("mass", "mass", "kg"),
    ("largest", "largest torque", "N m or N"),
    ("pinocchio", "against Pinocchio", ""),
    ("mujoco", "against MuJoCo", ""),
    ("message", "words", ""),
)


class RobotLine(TypedDict):
    """A line of the table: mass [kg], largest torque [N m], [N], differences over it [-]."""

    robot: str
    base: str
    nv: int
    mass: float
    largest: float
    pinocchio: float | None
    mujoco: float | None
    message: str
    verdict: Verdict


def run_study(models: str) -> StudyTable:
    """Return the table of the report: masses [kg], torques [N m] or [N]."""
    return {"text": TEXT, "columns": COLUMNS, "rows": [make_table_row(row) for row in build_robot_table()]}


def make_table_row(row: RobotRow) -> RobotLine:
    """Return one line of the table."""
    notes = ["the file is a stub: a <robot> without links" if row.empty else row.words, row.mujoco_words, row.cause]
    if row.repaired is not None:
        notes.append(f"repaired: {row.repaired:.1e}")
    if row.mimic:
        notes.append(f"{len(row.mimic)} mimic joints, computed as independent ones")
    return {
        "robot": row.name.removesuffix(".urdf")
        .replace("_description/", "/")
        .replace("/urdf/", "/")
        .replace("/robots/", "/"),
        "base": row.base,
        "nv": row.nv,
        "mass": row.mass,
        "largest": row.largest,
        "pinocchio": row.pinocchio,
        "mujoco": row.mujoco,
        "message": "; ".join(filter(None, notes)),
        "verdict": judge_robot(row),
    }


def judge_robot(row: RobotRow) -> Verdict:
    """Return the verdict on a robot's row.

    A difference from MuJoCo whose cause is known, and that is gone once the cause is repaired, is within; a robot that
    flexinv or Pinocchio cannot read is an error, but for a file that holds none.
    """
    if row.empty:
        return "skipped"
    if row.words or row.pinocchio is None:
        return "error"
    errors = [row.pinocchio]
    if row.mujoco is not None:
        errors.append(row.repaired if row.cause and row.repaired is not None else row.mujoco)
    return "within" if all(e <= LARGEST_ERROR for e in errors) else "deviation"
