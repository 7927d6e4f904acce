"""Tasks of an end effector: tables [tasks.NAME] of cases.toml, a frame and the path that it shall follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as File
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from flexinv.errors import InputError
from flexinv.files.case_schema import MeshTable, read_cases
from flexinv.files.case_start import read_places
from flexinv.files.toml_tables import (
    Fraction,
    Name,
    NotNegative,
    Number,
    Positive,
    Table,
    Text,
    Vector,
    check_names,
    complaint,
    location,
    validate,
)
from flexinv.model.mechanism import Attachment, Mechanism, Placement
from flexinv.tracking.frame_path import Path
from flexinv.typing import Array
from flexinv.validation import nearest, of_kind

SHAPES = ("line", "arc", "points_m")


class LineTable(Table):
    """A straight path."""

    from_m: Vector = Field(description="where it begins [m]", examples=["from_m = [0.3, 0, 0]"])
    to_m: Vector = Field(description="where it ends [m]", examples=["to_m = [0.2, 0.1, 0]"])


class ArcTable(Table):
    """A path on a circle."""

    from_m: Vector = Field(description="where it begins [m]", examples=["from_m = [0.3, 0, 0]"])
    centre_m: Vector = Field(description="the centre of the circle [m]", examples=["centre_m = [0.2, 0, 0]"])
    angle_deg: Number = Field(description="how far it goes [deg]", examples=["angle_deg = 90"])
    axis: Vector = Field(description="about what it turns [-]", examples=["axis = [0, 0, 1]"], default=[0.0, 0.0, 1.0])


class TaskTable(Table):
    """One task."""

    title: Text = Field(description="one line that says what it is", examples=['title = "an arc"'], default="")
    source: Text = Field(description="where it comes from", examples=['source = "made here"'], default="")
    frame: Name = Field(description="the link whose tip follows the path", examples=['frame = "link2"'])
    station: Fraction | None = Field(
        description="on a beam the fraction of its length, 0..1 [-]", examples=["station = 1.0"], default=None
    )
    at_m: Vector | None = Field(
        description="a point in the link's frame (in a beam's section at station) [m]",
        examples=["at_m = [0.1, 0, 0]"],
        default=None,
    )
    step_s: Positive = Field(description="between two instants, > 0 [s]", examples=["step_s = 5e-4"])
    before_s: NotNegative | None = Field(
        description="rest of the frame before the path, in which joints move [s]",
        examples=["before_s = 0.1"],
        default=None,
    )
    after_s: NotNegative | None = Field(
        description="rest of the frame after the path [s]", examples=["after_s = 0.1"], default=None
    )
    duration_s: Positive = Field(description="how long the path takes, > 0 [s]", examples=["duration_s = 0.2"])
    law: Literal["cycloid", "quintic", "septic", "nonic"] = Field(
        description='of time, without jumps of the acceleration: "cycloid", "quintic", "septic" or "nonic"',
        examples=['law = "nonic"'],
        default="nonic",
    )
    line: LineTable | None = Field(
        description="a straight path", examples=["line = { from_m = [0.3, 0, 0], to_m = [0.2, 0.1, 0] }"], default=None
    )
    arc: ArcTable | None = Field(
        description="a path on a circle",
        examples=["arc = { from_m = [0.3, 0, 0], centre_m = [0.2, 0, 0], angle_deg = 90 }"],
        default=None,
    )
    points_m: Annotated[list[Vector], Field(min_length=2)] | None = Field(
        description="points of a smooth curve [m]", examples=["points_m = [[0.3, 0, 0], [0.2, 0.1, 0]]"], default=None
    )
    turn_rpy_deg: Annotated[list[Vector], Field(min_length=2, max_length=2)] | None = Field(
        description="roll, pitch, yaw of the frame at start and end, free without [deg]",
        examples=["turn_rpy_deg = [[0, 0, 0], [0, 0, 90]]"],
        default=None,
    )
    mesh: MeshTable | None = Field(
        description="the mesh of every beam in this task", examples=["mesh = { elements = 1, order = 6 }"], default=None
    )
    start: dict[str, Any] = Field(
        description="a table per joint: a guess of where it is when the path begins",
        examples=["start.elbow = { deg = 60 }"],
        default={},
    )


@dataclass(frozen=True)
class Task:
    """A path for a frame, as `follow` takes them: step, before, after [s], start [rad], [m]; mesh : (elements, order) or None."""

    name: str
    title: str
    frame: str | Attachment
    path: Path
    step: float
    before: float | None
    after: float | None
    start: Mapping[str, Array]
    mesh: tuple[int, int] | None

    def meshed(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism with the mesh [-] of this task, its own where the task says nothing."""
        return mechanism if self.mesh is None else mechanism.with_mesh(*self.mesh)


def load_tasks(path: str | File, mechanism: Mechanism) -> dict[str, Task]:
    """Load the tasks of a mechanism by name, none where there are none [m], [s], [rad].

    path : ``models/<name>`` or the TOML file.  The format is described in models/README.md.
    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    """
    of_kind("mechanism", mechanism, Mechanism)
    file, table = read_cases(path)
    check_names(file, tasks=table.tasks)
    return {name: _task(data, name, mechanism, file) for name, data in table.tasks.items()}


def _task(data: Any, name: str, mechanism: Mechanism, file: File) -> Task:
    where = f"tasks.{name}"
    table = validate(TaskTable, data, file, where)
    if table.frame not in mechanism.link_of:
        near = nearest(table.frame, list(mechanism.link_of))
        expected = f"a link of {mechanism.name}: {', '.join(list(mechanism.link_of)[:20])}"
        write = f'frame = "{near or next(iter(mechanism.link_of))}"'
        raise InputError(complaint(location(file, where, "frame"), f'frame = "{table.frame}"', expected, write))
    if mechanism.closures:
        expected = "an open mechanism: a path of a frame is not followed by closed loops so far"
        raise InputError(complaint(location(file, where), "a task of a mechanism with closures", expected, "a case"))
    moving = [joint.name for joint in mechanism.joints if joint.nv]
    start = read_places(table.start, mechanism, moving, file, f"{where}.start")
    mesh = (table.mesh.elements, table.mesh.order) if table.mesh is not None else None
    own = _path(table, file, where)
    return Task(
        name, table.title, _frame(table, mechanism, file, where), own, table.step_s, table.before_s, table.after_s,
        start, mesh,
    )  # fmt: skip


def _frame(table: TaskTable, mechanism: Mechanism, file: File, where: str) -> str | Attachment:
    if table.station is not None and mechanism.link_of[table.frame].beam is None:
        expected = f"no station: {table.frame} is rigid"
        raise InputError(complaint(location(file, where, "station"), f"station = {table.station:g}", expected, "at_m"))
    if table.station is None and table.at_m is None:
        return table.frame
    point = np.zeros(3) if table.at_m is None else np.array(table.at_m, dtype=float)
    return Attachment(table.frame, Placement(point), table.station)


def _path(table: TaskTable, file: File, where: str) -> Path:
    stated = [shape for shape in SHAPES if getattr(table, shape) is not None]
    if len(stated) != 1:
        given = " and ".join(stated) or "no path"
        write = str((TaskTable.model_fields["line"].examples or [""])[0])
        raise InputError(complaint(location(file, where), given, f"one of {', '.join(SHAPES)}", write))
    time = {"duration": table.duration_s, "law": table.law}
    try:
        path = _shape(table, time)
    except InputError as error:
        write = str((TaskTable.model_fields[stated[0]].examples or [""])[0])
        raise InputError(complaint(location(file, where, stated[0]), stated[0], str(error), write)) from None
    if table.turn_rpy_deg is None:
        return path
    return path.turning(*Rotation.from_euler("xyz", table.turn_rpy_deg, degrees=True).as_matrix())


def _shape(table: TaskTable, time: Mapping[str, Any]) -> Path:
    if table.line is not None:
        return Path.line(table.line.from_m, table.line.to_m, **time)
    if table.arc is not None:
        angle = float(np.radians(table.arc.angle_deg))
        return Path.arc(table.arc.from_m, table.arc.centre_m, angle, axis=table.arc.axis, **time)
    return Path.points(table.points_m or [], **time)
