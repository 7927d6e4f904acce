"""Tasks of an end effector: tables [tasks.NAME] of cases.toml, a frame and the path that it shall follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as File
from typing import Annotated, Any, Literal

import numpy as np
import scipy  # its parts are loaded when they are asked for
from pydantic import Field

from flexinv.errors import InputError
from flexinv.files.case_schema import MeshTable, read_cases
from flexinv.files.load_cases import read_places
from flexinv.files.toml_tables import Location, Table, check_table, check_table_names, make_key, make_optional_key
from flexinv.files.values import Fraction, Name, NotNegative, Number, Positive, Text, Vector
from flexinv.model.mechanism import Attachment, Mechanism, Placement
from flexinv.tracking.frame_path import Path
from flexinv.typing import Array
from flexinv.validation import check_kind, find_nearest_word

PATH_SHAPES = ("line", "arc", "points_m")


class LineTable(Table):
    """A straight path."""

    from_m: Vector = make_key("where it begins [m]", "[0.3, 0, 0]")
    to_m: Vector = make_key("where it ends [m]", "[0.2, 0.1, 0]")


class ArcTable(Table):
    """A path on a circle."""

    from_m: Vector = make_key("where it begins [m]", "[0.3, 0, 0]")
    centre_m: Vector = make_key("the centre of the circle [m]", "[0.2, 0, 0]")
    angle_deg: Number = make_key("how far it goes [deg]", "90")
    axis: Vector = make_key("about what it turns [-]", "[0, 0, 1]", default=[0.0, 0.0, 1.0])


class TaskTable(Table):
    """One task."""

    title: Text = make_key("one line that says what it is", '"an arc"', default="")
    source: Text = make_key("where it comes from", '"made here"', default="")
    frame: Name = make_key("the link whose tip follows the path", '"link2"')
    station: Fraction | None = make_optional_key("on a beam the fraction of its length, 0..1 [-]", "1.0")
    at_m: Vector | None = make_optional_key(
        "a point in the link's frame (in a beam's section at station) [m]", "[0.1, 0, 0]"
    )
    step_s: Positive = make_key("between two instants, > 0 [s]", "5e-4")
    before_s: NotNegative | None = make_optional_key(
        "rest of the frame before the path, in which joints move [s]", "0.1"
    )
    after_s: NotNegative | None = make_optional_key("rest of the frame after the path [s]", "0.1")
    duration_s: Positive = make_key("how long the path takes, > 0 [s]", "0.2")
    law: Literal["cycloid", "quintic", "septic", "nonic"] = make_key(
        'of time, without jumps of the acceleration: "cycloid", "quintic", "septic" or "nonic"',
        '"nonic"',
        default="nonic",
    )
    line: LineTable | None = make_optional_key("a straight path", "{ from_m = [0.3, 0, 0], to_m = [0.2, 0.1, 0] }")
    arc: ArcTable | None = make_optional_key(
        "a path on a circle", "{ from_m = [0.3, 0, 0], centre_m = [0.2, 0, 0], angle_deg = 90 }"
    )
    points_m: Annotated[list[Vector], Field(min_length=2)] | None = make_optional_key(
        "points of a smooth curve [m]", "[[0.3, 0, 0], [0.2, 0.1, 0]]"
    )
    turn_rpy_deg: Annotated[list[Vector], Field(min_length=2, max_length=2)] | None = make_optional_key(
        "roll, pitch, yaw of the frame at start and end, free without [deg]", "[[0, 0, 0], [0, 0, 90]]"
    )
    mesh: MeshTable | None = make_optional_key("the mesh of every beam in this task", "{ elements = 1, order = 6 }")
    start: dict[str, Any] = make_key(
        "a table per joint: a guess of where it is when the path begins", "start.elbow = { deg = 60 }", default={}
    )


@dataclass(frozen=True)
class PathTask:
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


def load_tasks(path: str | File, mechanism: Mechanism) -> dict[str, PathTask]:
    """Load the tasks of a mechanism by name, none where there are none [m], [s], [rad].

    path : ``models/<name>`` or the TOML file.  The format is described in models/README.md.
    Raises InputError, which names file, table, key, what was given, what is expected and what to write.
    """
    check_kind("mechanism", mechanism, Mechanism)
    file, table = read_cases(path)
    check_table_names(file, tasks=table.tasks)
    return {
        name: _read_task(data, name, mechanism, Location(file, f"tasks.{name}")) for name, data in table.tasks.items()
    }


def _read_task(data: Any, name: str, mechanism: Mechanism, where: Location) -> PathTask:
    table = check_table(TaskTable, data, where)
    if table.frame not in mechanism.link_of:
        near = find_nearest_word(table.frame, list(mechanism.link_of))
        expected = f"a link of {mechanism.name}: {', '.join(list(mechanism.link_of)[:20])}"
        write = f'frame = "{near or next(iter(mechanism.link_of))}"'
        raise where.make_error("frame", f'frame = "{table.frame}"', expected, write)
    if mechanism.closures:
        expected = "an open mechanism: a path of a frame is not followed by closed loops so far"
        raise where.make_error("", "a task of a mechanism with closures", expected, "a case")
    start = read_places(table.start, mechanism, mechanism.moving_names, where.make_inner_location("start"))
    mesh = (table.mesh.elements, table.mesh.order) if table.mesh is not None else None
    if table.station is not None and mechanism.link_of[table.frame].beam is None:
        raise where.make_error("station", f"station = {table.station:g}", f"no station: {table.frame} is rigid", "at_m")
    frame: str | Attachment = table.frame
    if table.station is not None or table.at_m is not None:
        point = np.zeros(3) if table.at_m is None else np.array(table.at_m, dtype=float)
        frame = Attachment(table.frame, Placement(point), table.station)
    times = table.step_s, table.before_s, table.after_s
    return PathTask(name, table.title, frame, _read_path(table, where), *times, start, mesh)


def _read_path(table: TaskTable, where: Location) -> Path:
    stated = [shape for shape in PATH_SHAPES if getattr(table, shape) is not None]
    shape = stated[0] if len(stated) == 1 else "line"
    write = str((TaskTable.model_fields[shape].examples or [""])[0])
    if len(stated) != 1:
        raise where.make_error("", " and ".join(stated) or "no path", f"one of {', '.join(PATH_SHAPES)}", write)
    time: dict[str, Any] = {"duration": table.duration_s, "law": table.law}
    try:
        if table.line is not None:
            path = Path.line(table.line.from_m, table.line.to_m, **time)
        elif table.arc is not None:
            angle = float(np.radians(table.arc.angle_deg))
            path = Path.arc(table.arc.from_m, table.arc.centre_m, angle, axis=table.arc.axis, **time)
        else:
            path = Path.points(table.points_m or [], **time)
    except InputError as error:
        raise where.make_error(shape, shape, str(error), write) from None
    if table.turn_rpy_deg is None:
        return path
    rotations = scipy.spatial.transform.Rotation.from_euler("xyz", table.turn_rpy_deg, degrees=True)
    return path.turning(*rotations.as_matrix())
