"""identify.toml: which column is what, which parameters are free and what is known of them, bandwidth, samples that count."""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from flexinv.errors import InputError
from flexinv.files.closures import EndTable, read_end
from flexinv.files.toml_tables import Location, Table, check_table, make_key, read_toml
from flexinv.files.values import Format, Fraction, NotNegative, Number, Positive, Text
from flexinv.model.links import WORLD
from flexinv.model.mechanism import Mechanism
from flexinv.validation import find_nearest_word

FILE = "identify.toml"
# unit in a log -> factor to SI
ANGLES = {"rad": 1.0, "deg": 0.017453292519943295, "m": 1.0, "mm": 1e-3}
RATES = {f"{unit}/s": factor for unit, factor in ANGLES.items()}
EFFORTS = {"N m": 1.0, "N": 1.0, "A": 1.0, "mN m": 1e-3}
LENGTHS = {"m": 1.0, "mm": 1e-3}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
STRAINS = {"um/m": 1e-6}
ACCELERATIONS = {"m/s^2": 1.0, "g": 9.80665}
# Parameters of a motor with its gear, which a torque sensor behind the gear does not see.
OF_DRIVES = (
    *("rotor inertia", "viscous friction", "coulomb friction", "transition rate", "stribeck share", "stribeck rate"),
    *("friction asymmetry", "load friction", "quadratic friction", "viscous friction per kelvin"),
    *("coulomb friction per kelvin", "motor coupling"),
)


class AngleTable(Table):
    """A column with the coordinate of a joint."""

    column: Text = make_key("name of the column", 'column = "axis1_angle_rad"')
    unit: Literal["rad", "deg", "m", "mm"] = make_key("its unit", 'unit = "rad"', default="rad")
    over: Number = make_key(
        "what the column is divided by: a gear ratio if it is the motor's [-]", "over = 100", default=1.0
    )


class RateTable(Table):
    """A column with the rate of a joint."""

    column: Text = make_key("name of the column", 'column = "axis1_rate_rad_per_s"')
    unit: Literal["rad/s", "deg/s", "m/s", "mm/s"] = make_key("its unit", 'unit = "rad/s"', default="rad/s")
    over: Number = make_key(
        "what the column is divided by: a gear ratio if it is the motor's [-]", "over = 100", default=1.0
    )


class EffortTable(Table):
    """A column with the torque, force or current of a drive."""

    column: Text = make_key("name of the column", 'column = "axis1_motor_torque_Nm"')
    unit: Literal["N m", "N", "A", "mN m"] = make_key("its unit", 'unit = "N m"', default="N m")
    side: Literal["joint", "motor", "link"] = make_key(
        'where it acts: "motor", whose torque times the gear ratio is that of the joint; "joint", the same in numbers of the '
        'joint; "link", a torque sensor behind the gear, which sees neither rotor nor friction of the motor',
        'side = "motor"',
        default="joint",
    )
    constant_Nm_per_A: Positive | None = make_key(
        "of a current: torque at this side per ampere; the drive's torque constant when absent [N m/A]",
        "constant_Nm_per_A = 8.925",
        default=None,
    )


class TemperatureTable(Table):
    """A column with the temperature of a drive, which friction follows."""

    column: Text = make_key("name of the column", 'column = "motor1_degC"')
    reference_degC: Number = make_key(
        "the temperature of which friction is told [degC]", "reference_degC = 30", default=25.0
    )


class JointTable(Table):
    """Columns of a joint."""

    angle: AngleTable = make_key("the coordinate that moves the model", 'angle = { column = "q1", unit = "deg" }')
    rate: RateTable | None = make_key(
        "its rate, where a sensor measures it: else the angle is differentiated",
        'rate = { column = "qd1", unit = "deg/s" }',
        default=None,
    )
    link_angle: AngleTable | None = make_key(
        "a second encoder behind the gear", 'link_angle = { column = "q1_link" }', default=None
    )
    effort: EffortTable | None = make_key(
        "torque, force or current", 'effort = { column = "i1", unit = "A" }', default=None
    )
    temperature: TemperatureTable | None = make_key(
        "its drive's temperature, where it is logged [degC]", 'temperature = { column = "motor1_degC" }', default=None
    )
    follows: dict[str, Number] = make_key(
        "other joints whose rates its motor follows, too, and by how much: of coupled wrists [-]",
        "follows = { axis4 = 0.5 }",
        default={},
    )

    @property
    def has_link_sensor(self) -> bool:
        """True where the effort is measured behind the gear."""
        return self.effort is not None and self.effort.side == "link"


class GaugeTable(Table):
    """A strain gauge on a beam: what it reads is gain sign M L / (3 EI), or of a strain gain sign M h / EI, + zero + slope q."""

    beam: Text = make_key("the link that is a beam", 'beam = "link1"')
    joint: Text = make_key("of a gauge at the root, the joint whose moment bends it", 'joint = "clamp1"', default="")
    station: Fraction | None = make_key(
        "of a gauge elsewhere: the fraction 0..1 of the beam's length [-]", "station = 0.3", default=None
    )
    column: Text = make_key("name of the column", 'column = "gauge1_deg"')
    unit: Literal["rad", "deg", "um/m"] = make_key(
        "its unit: of a rig that is calibrated as an angle of the tip, or of a strain", 'unit = "um/m"', default="rad"
    )
    height_m: Positive | None = make_key(
        "of a strain: how far the gauge is from the beam's axis, across the axis of bending [m]",
        "height_m = 0.001",
        default=None,
    )
    sign: Literal[1, -1] = make_key("-1 of a gauge that falls where the moment rises [-]", "sign = -1", default=1)
    slope_joint: Text = make_key("the joint with whose angle its zero drifts", 'slope_joint = "shoulder"', default="")
    flexibility_rad_per_Nm: Positive | None = make_key(
        "what the rig makes of a moment; L / (3 EI) of the beam when absent [rad/(N m)]",
        "flexibility_rad_per_Nm = 0.1",
        default=None,
    )
    lag_Hz: Positive | None = make_key(
        "frequency of the rig's own low-pass of second order [Hz]", "lag_Hz = 2", default=None
    )
    lag_damping: Positive = make_key("its damping ratio [-]", "lag_damping = 0.9", default=0.9)


class AxesTable(Table):
    """Columns of a sensor that measures along axes."""

    x: Text | None = make_key("column along x", 'x = "tip_x"', default=None)
    y: Text | None = make_key("column along y", 'y = "tip_y"', default=None)
    z: Text | None = make_key("column along z", 'z = "tip_z"', default=None)

    @property
    def named(self) -> dict[str, str]:
        """Axis -> column, of those that there are."""
        return {axis: column for axis in "xyz" if (column := getattr(self, axis)) is not None}


class MarkerTable(EndTable):
    """A marker on a link, which a camera or tracker sees: its position in the world, along the world's axes."""

    columns: AxesTable = make_key("its columns, one of x, y and z or more", 'columns = { x = "tip_x", z = "tip_z" }')
    unit: Literal["m", "mm"] = make_key("their unit", 'unit = "mm"', default="m")


class AccelerometerTable(EndTable):
    """An accelerometer on a link: its acceleration less gravity, along its own axes."""

    columns: AxesTable = make_key("its columns, one of x, y and z or more", 'columns = { z = "acc_z" }')
    unit: Literal["m/s^2", "g"] = make_key("their unit", 'unit = "g"', default="m/s^2")


class FreeTable(Table):
    """Parameters that are free, at places; what is known of them before the log."""

    parameter: Text = make_key("kind of parameter", 'parameter = "mass properties"')
    place: list[Text] = make_key("links, joints or beams; patterns such as axis*", 'place = ["*"]', default=["*"])
    relative: Positive | None = make_key(
        "relative standard error of the value known before [-]", "relative = 0.3", default=None
    )
    error: Positive | None = make_key("its standard error in the unit of the parameter", "error = 0.05", default=None)
    value: Number | None = make_key(
        "the value known before; that of the mechanism when absent", "value = 0.02", default=None
    )


class StartTable(Table):
    """Coordinate of a joint: of a passive one at the first sample, or of one that stands all the time."""

    deg: Number | None = make_key("its angle [deg]", "deg = -85", default=None)
    rad: Number | None = make_key("its angle [rad]", "rad = -1.48", default=None)
    m: Number | None = make_key("its way [m]", "m = 0.1", default=None)

    @property
    def value(self) -> float:
        """The coordinate [rad], [m]."""
        return self.rad or self.m or (self.deg or 0.0) * ANGLES["deg"]


Window = Annotated[list[Number], Field(min_length=2, max_length=2)]


class LimitTable(Table):
    """Limits for the logs that judge."""

    channel: list[Text] = make_key("sensors; patterns such as torque/axis*", 'channel = ["torque/*"]', default=["*"])
    explained: Number | None = make_key("least part that is explained [-]", "explained = 0.95", default=None)
    coverage: Window | None = make_key(
        "least and largest part of samples inside the 90 % bands [-]", "coverage = [0.8, 0.97]", default=None
    )
    width: Positive | None = make_key("largest mean width of a band over the RMS error [-]", "width = 5", default=None)
    reason: Text = make_key("why so", 'reason = "what the controller needs"', default="")


class NightTable(Table):
    """Logs beside the mechanism that every night identifies and judges."""

    log: list[Text] = make_key("logs that identify, as --log takes them", 'log = ["run_A.csv.gz@0:6.9"]')
    hold_out: list[Text] = make_key("logs that judge", 'hold_out = ["run_B.csv.gz"]', default=[])
    blocks: Annotated[int, Field(ge=2)] | None = make_key(
        "instead of logs that judge: into how many blocks the window of the first log is cut",
        "blocks = 5",
        default=None,
    )
    limits: list[LimitTable] = make_key(
        "what judges have to reach in a night, beside [[limits]]", "[[night.limits]]", default=[]
    )


class IdentifyTable(Table):
    """All of identify.toml."""

    format: Format = make_key("the version of the file's format, 1 when absent", "format = 1", default=1)
    source: Text = make_key("where the log comes from", 'source = "our test bench"', default="")
    time: Text = make_key("name of the column of times", 'time = "time_s"', default="time_s")
    time_unit: Literal["s", "ms", "us", "ns"] = make_key("unit of the times", 'time_unit = "ms"', default="s")
    bandwidth_Hz: Positive = make_key(
        "of the zero-phase low-pass behind which efforts are compared [Hz]", "bandwidth_Hz = 10"
    )
    motion_Hz: Positive | None = make_key(
        "of the zero-phase low-pass of the motion; 2.5 times that of efforts when absent [Hz]",
        "motion_Hz = 25",
        default=None,
    )
    window_s: Window | None = make_key(
        "the seconds that count; all when absent [s]", "window_s = [1.8, 8.2]", default=None
    )
    block_s: Positive = make_key(
        "length of the blocks that leave-one-out takes away [s]", "block_s = 1.28", default=1.0
    )
    still_rad_per_s: Positive = make_key(
        "slower than this a joint stands, and friction holds whatever it does, > 0 [rad/s], [m/s]",
        "still_rad_per_s = 0.01",
        default=0.01,
    )
    between_runs: NotNegative = make_key(
        "relative standard deviation of dry friction from day to day that is expected before several days are known; that of "
        "viscous friction is 4/3 of it, that of offsets 1/3 of it times the dry friction, that of gains of efforts (if free) "
        "2/15 of it; 0: every day is the same [-]",
        "between_runs = 0.15",
        default=0.15,
    )
    friction: Literal["given", "evidence"] = make_key(
        '"evidence": further terms of friction are free, too, where parts of the logs that are left out are told better by them',
        'friction = "evidence"',
        default="given",
    )
    least_radius_m: Positive = make_key(
        "radius of gyration below which no mass is believed [m]", "least_radius_m = 0.05", default=0.05
    )
    mesh: Annotated[list[int], Field(min_length=2, max_length=2)] | None = make_key(
        "elements and order of beams while they are identified [-]", "mesh = [1, 2]", default=None
    )
    every: int | None = make_key(
        "steps of the march per sample; as many as leave the parameters off by a fifth of their standard errors at most, where "
        "absent [-]",
        "every = 2",
        default=None,
    )
    start: dict[str, StartTable] = make_key(
        "coordinates of passive joints of loops at the first sample", "start.left_elbow = { deg = -85 }", default={}
    )
    stands: dict[str, StartTable] = make_key(
        "joints that no column measures, and where they stand during all logs",
        "stands.wrist = { deg = 30 }",
        default={},
    )
    initial: Literal["consistent", "static"] = make_key(
        "how beams and springs begin: without force, or in equilibrium", 'initial = "static"', default="consistent"
    )
    joints: dict[str, JointTable] = make_key("what the log says of a joint", "[joints.axis1]")
    gauges: dict[str, GaugeTable] = make_key("strain gauges", "[gauges.gauge1]", default={})
    markers: dict[str, MarkerTable] = make_key("markers on links", "[markers.tip]", default={})
    accelerometers: dict[str, AccelerometerTable] = make_key(
        "accelerometers on links", "[accelerometers.wrist]", default={}
    )
    free: list[FreeTable] = make_key("free parameters", "[[free]]")
    limits: list[LimitTable] = make_key("what logs that judge have to reach", "[[limits]]", default=[])
    night: NightTable | None = make_key("what `crosscheck nightly` identifies and judges", "[night]", default=None)


def read_settings(path: Path, mechanism: Mechanism) -> IdentifyTable:
    """Read identify.toml of a mechanism [s, Hz].  Raises InputError, which names file, table and key."""
    file = path / FILE if path.suffix != ".toml" else path
    if not file.is_file():
        raise InputError(
            f"{file}: there is no such file; write `crosscheck identify {mechanism.name} --log LOG --propose`, which makes one"
        )
    top = Location(file)
    table = check_table(IdentifyTable, read_toml(file), top)
    _check_joints(table, mechanism, top)
    _check_standing_joints(table, mechanism, top)
    for kind, points in (("markers", table.markers), ("accelerometers", table.accelerometers)):
        for name, point in points.items():
            _check_point(point, mechanism, top.make_inner_location(kind).make_inner_location(name))
    for name, gauge in table.gauges.items():
        place = top.make_inner_location("gauges").make_inner_location(name)
        _check_gauge_place(gauge, mechanism, place)
        _check_gauge_unit(gauge, mechanism, place)
    for free in table.free:
        if free.relative is None and free.error is None:
            given = f"[[free]] {free.parameter} without either"
            expected = "relative [-] or error [unit]: a believable error"
            raise top.make_inner_location("free").make_error("relative", given, expected, "relative = 0.3")
    if table.night is not None and bool(table.night.hold_out) == (table.night.blocks is not None):
        given = "both" if table.night.hold_out else "neither hold_out nor blocks"
        raise top.make_inner_location("night").make_error(
            "hold_out", given, "one of them: what judges", 'hold_out = ["other.csv"]'
        )
    return table


def _check_joints(table: IdentifyTable, mechanism: Mechanism, top: Location) -> None:
    joints = [j.name for j in mechanism.joints if j.nv == 1]
    for name in table.joints:
        if name not in joints:
            expected = "a joint of one coordinate: " + ", ".join(joints)
            raise top.make_inner_location("joints").make_error(
                name, f'"{name}"', expected, f"[joints.{find_nearest_word(name, joints) or joints[0]}]"
            )
        _check_drive(table, name, top.make_inner_location("joints").make_inner_location(name))


def _check_drive(table: IdentifyTable, name: str, where: Location) -> None:
    """Raise InputError where a current is said to be measured behind the gear, or a motor follows what no column measures."""
    columns = table.joints[name]
    if columns.effort is not None and columns.effort.side == "link" and columns.effort.unit == "A":
        expected = "a torque or force behind the gear; a current is the motor's"
        raise where.make_error("effort", 'side = "link" with unit = "A"', expected, 'side = "joint"')
    others = [other for other in table.joints if other != name]
    for other in columns.follows:
        if other not in others:
            near = find_nearest_word(other, others) or "OTHER"
            expected = f"another joint of which a column measures the angle: {', '.join(others)}"
            raise where.make_error("follows", f'"{other}"', expected, f"follows = {{ {near} = 1.0 }}")
    if columns.follows and columns.has_link_sensor:
        given = 'follows with side = "link"'
        raise where.make_error(
            "follows", given, "an effort of a motor: a sensor behind the gear sees one joint", 'side = "joint"'
        )


def _check_standing_joints(table: IdentifyTable, mechanism: Mechanism, top: Location) -> None:
    """Raise InputError where a joint that stands is none of one coordinate, is measured, is coupled, or has another unit."""
    joints = [j.name for j in mechanism.joints if j.nv == 1]
    coupled = {name for closure in mechanism.closures for name, _ in closure.factors}
    where = top.make_inner_location("stands")
    for name, at in table.stands.items():
        near = find_nearest_word(name, joints) or joints[0]
        if name not in joints:
            expected = f"a joint of one coordinate: {', '.join(joints)}"
            raise where.make_error(name, f'"{name}"', expected, f"stands.{near} = {{ deg = 30 }}")
        if name in table.joints or name in coupled:
            given = f"[joints.{name}], which measures it" if name in table.joints else "a coupling that moves it"
            raise where.make_error(name, given, "a joint that stands during all logs", "one of the two")
        _check_standing_unit(at, name, mechanism.joint_of[name].kind == "prismatic", where)


def _check_standing_unit(at: StartTable, name: str, slides: bool, where: Location) -> None:
    """Raise InputError where a coordinate is not in one unit of its joint: m of one that slides, deg or rad of one that turns."""
    stated = {unit for unit, value in (("m", at.m), ("deg", at.deg), ("rad", at.rad)) if value is not None}
    if len(stated) != 1 or (stated == {"m"}) != slides:
        given = " and ".join(sorted(stated)) or "nothing"
        expected = "m of a joint that slides" if slides else "deg or rad of a joint that turns"
        raise where.make_error(name, given, expected, f"stands.{name} = {'{ m = 0.1 }' if slides else '{ deg = 30 }'}")


def _check_gauge_place(gauge: GaugeTable, mechanism: Mechanism, where: Location) -> None:
    """Raise InputError where a gauge has no place or two, or its joint is none of the mechanism."""
    if bool(gauge.joint) == (gauge.station is not None):
        given = "both joint and station" if gauge.joint else "neither joint nor station"
        expected = "joint of a gauge at the root of the beam, or station of one elsewhere"
        raise where.make_error("station", given, expected, "station = 0.3")
    if gauge.joint and gauge.joint not in mechanism.joint_of:
        near = find_nearest_word(gauge.joint, list(mechanism.joint_of)) or mechanism.joints[0].name
        raise where.make_error("joint", f'"{gauge.joint}"', "a joint of the mechanism", f'joint = "{near}"')


def _check_gauge_unit(gauge: GaugeTable, mechanism: Mechanism, where: Location) -> None:
    """Raise InputError where the unit of a gauge lacks what makes a reading of a moment: a height, a beam."""
    strained = gauge.unit in STRAINS
    if strained != (gauge.height_m is not None) or (strained and gauge.flexibility_rad_per_Nm is not None):
        expected = "height_m [m] and no flexibility with a strain, none with an angle"
        raise where.make_error("height_m", f'unit = "{gauge.unit}"', expected, 'unit = "um/m" with height_m = 0.001')
    beams = [link.name for link in mechanism.beams]
    if (strained or gauge.station is not None) and gauge.beam not in beams:
        expected = f"a link that is a beam: {', '.join(beams) or 'the mechanism has none'}"
        raise where.make_error("beam", f'"{gauge.beam}"', expected, f'beam = "{(beams or ["arm"])[0]}"')


def _check_point(point: MarkerTable | AccelerometerTable, mechanism: Mechanism, where: Location) -> None:
    if read_end(point, mechanism.link_of, where).link == WORLD:
        moving = ", ".join(list(mechanism.link_of)[:20])
        raise where.make_error(
            "link", f'link = "{WORLD}"', f"a link that moves: {moving}", f'link = "{mechanism.links[-1].name}"'
        )
    if not point.columns.named:
        raise where.make_error("columns", "no column", "one of x, y and z or more", 'columns = { x = "NAME" }')


def list_matching_names(patterns: list[str], names: list[str]) -> list[str]:
    """Return the names that one of the patterns means, in their order [-]."""
    return [name for name in names if any(fnmatch(name, pattern) for pattern in patterns)]


def move_efforts_behind_gears(table: IdentifyTable) -> IdentifyTable:
    """Return the settings of a machine whose efforts are all measured behind the gears [-]: no rotor, no friction is free."""
    joints = {
        name: columns.model_copy(
            update={"effort": columns.effort and columns.effort.model_copy(update={"side": "link"})}
        )
        for name, columns in table.joints.items()
    }
    free = [one for one in table.free if one.parameter not in OF_DRIVES]
    return table.model_copy(update={"joints": joints, "free": free})
