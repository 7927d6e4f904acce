"""The table of real robots: joint torques of every URDF of example-robot-data, flexinv against other engines."""

from __future__ import annotations

from typing import Any

from crosscheck.limits import Verdict
from crosscheck.robots import LARGEST_ERROR, RobotRow, robot_table

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
    ("repaired", "after repair", ""),
    ("mimic", "mimic joints", ""),
    ("message", "words", ""),
)


def study(models: str) -> dict[str, Any]:
    """Return the table of the report: masses [kg], torques [N m] or [N]."""
    return {"text": TEXT, "columns": COLUMNS, "rows": [table_row(row) for row in robot_table()]}


def table_row(row: RobotRow) -> dict[str, Any]:
    """Return one line of the table."""
    return {
        "robot": row.name.removesuffix(".urdf"),
        "base": row.base,
        "nv": row.nv,
        "mass": row.mass,
        "largest": row.largest,
        "pinocchio": row.pinocchio,
        "mujoco": row.mujoco,
        "repaired": row.repaired,
        "mimic": len(row.mimic),
        "message": "; ".join(filter(None, [row.words, row.mujoco_words, row.cause])),
        "verdict": verdict(row),
    }


def verdict(row: RobotRow) -> Verdict:
    """Return what a robot's row is worth.

    A difference from MuJoCo whose cause is known, and that is gone once the cause is repaired, is within.
    """
    if row.pinocchio is None:
        return "skipped"
    errors = [row.pinocchio]
    if row.mujoco is not None:
        errors.append(row.repaired if row.cause and row.repaired is not None else row.mujoco)
    return "within" if all(e <= LARGEST_ERROR for e in errors) else "deviation"
