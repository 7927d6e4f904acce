"""The public entrances of flexinv and crosscheck, each with a call that is right and what its arguments are.

A call of an entrance is a function of keyword arguments; `Slot` says which dresses (`dresses`) an argument can wear.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import crosscheck
import flexinv
from flexinv.model import mechanism as parts
from flexinv.model.attachments import GasLaw, TableLaw

MODELS = Path(__file__).resolve().parents[1] / "models"
Call = Callable[..., Any]


@dataclass(frozen=True)
class Slot:
    """An argument: its clean value, its kind (of `dresses.KINDS`), and dresses that mean something else here."""

    kind: str
    value: Any
    may: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Entrance:
    """A public entrance: a call, its arguments, and how often it is drawn beside the others (a call of crosscheck takes long)."""

    name: str
    call: Call
    slots: Mapping[str, Slot] = field(default_factory=dict)
    weight: float = 1.0

    @property
    def clean(self) -> dict[str, Any]:
        """Return the arguments of the right call [any unit]."""
        return {name: slot.value for name, slot in self.slots.items()}


@cache
def model(name: str) -> flexinv.Mechanism:
    """Return a mechanism of the gallery [m, kg]."""
    return flexinv.load_mechanism(MODELS / name)


def slot(kind: str, value: Any, *may: str) -> Slot:
    """Return an argument [any unit]; numbers become arrays of floats."""
    if kind == "numbers":
        value = np.array(value, dtype=float)
    return Slot(kind, value, frozenset(may))


def optional(kind: str, value: Any, *may: str) -> Slot:
    """Return an argument [any unit] that may be None, too."""
    return slot(kind, value, *may, "nothing", "none of it")


# ----------------------------------------------------------------------------------------------------- records

VECTOR = [0.1, -0.2, 0.3]
END = parts.Attachment("world")
ARM = parts.Attachment("arm")


def records() -> Iterator[Entrance]:
    """Yield the records that a mechanism is made of."""
    inertia = parts.Inertia(1.0, np.zeros(3), np.diag([0.1, 0.2, 0.25]))
    numbers = slot("numbers", VECTOR)
    yield Entrance("Placement", parts.Placement, {"position": numbers, "rotation": slot("numbers", np.eye(3))})
    yield Entrance("Inertia", parts.Inertia, {
        "mass": slot("number", 1.5), "com": numbers, "tensor": slot("numbers", np.diag([1.0, 2.0, 2.5]), "columns first"),
    })  # fmt: skip
    yield Entrance("Body", parts.Body, {"name": slot("text", "b"), "inertia": slot("thing", inertia)})
    rows = np.array([[1e5, 4e4, 4e4, 10.0, 12.0, 8.0]] * 2)
    yield Entrance("Section", parts.Section, {
        "stations": slot("numbers", [0.0, 1.0]), "stiffness": slot("numbers", rows),
        "mass_per_length": slot("numbers", [1.0, 2.0]), "rotary_inertia": slot("numbers", np.ones((2, 3))),
        "damping": optional("numbers", 1e-3 * rows),
    })  # fmt: skip
    section = parts.Section(np.zeros(1), rows[:1], np.ones(1), np.zeros((1, 3)))
    yield Entrance("Beam", parts.Beam, {
        "length": slot("number", 0.5), "section": slot("thing", section), "elements": slot("whole", 2),
        "order": slot("whole", 3), "curvature": numbers, "placement": slot("thing", parts.Placement()),
    })  # fmt: skip
    body = parts.Body("b", inertia)
    yield Entrance(
        "Link", parts.Link, {"name": slot("text", "arm"), "bodies": slot("thing", (body,), "class"), "tip": numbers}
    )
    yield Entrance(
        "Limits", parts.Limits, {name: slot("number", 2.0) for name in ("effort", "velocity", "lower", "upper")}
    )
    yield Entrance("Drive", parts.Drive, {
        "ratio": slot("number", 5.0), "rotor_inertia": slot("number", 0.25), "stiffness": slot("number", 8.0),
        "stribeck": slot("number", 0.5), "moves": slot("choice", "motor"),
    })  # fmt: skip
    yield Entrance("Joint", parts.Joint, {
        "name": slot("text", "j"), "kind": slot("choice", "revolute"), "parent": slot("text", "world"),
        "child": slot("text", "arm"), "placement": slot("thing", parts.Placement()), "axis": slot("numbers", [0, 0, 1]),
        "damping": slot("number", 0.5), "actuated": slot("flag", True), "weight": slot("number", 2.0),
        "limits": slot("thing", parts.Limits()),
    })  # fmt: skip
    yield Entrance("Closure", parts.Closure, {
        "name": slot("text", "c"), "kind": slot("choice", "revolute"), "first": slot("thing", END),
        "second": slot("thing", ARM), "axis": slot("numbers", [1, 0, 0]), "capture": slot("flag", False),
        "impact": slot("choice", "plastic"), "offset": slot("number", 0.5),
    })  # fmt: skip
    yield Entrance("Spring", parts.Spring, {
        "name": slot("text", "s"), "first": slot("thing", END), "second": slot("thing", ARM), "stiffness": slot("number", 3.0),
        "rest": slot("number", 0.25), "damping": slot("number", 0.5),
    })  # fmt: skip
    yield Entrance("GasLaw", GasLaw, {
        "force": slot("number", 2.0), "travel": slot("number", 0.5), "exponent": slot("number", 1.5),
    })  # fmt: skip
    yield Entrance("TableLaw", TableLaw, {"length": slot("numbers", [1, 2, 4]), "force": slot("numbers", [1, 2, 3])})
    yield Entrance("Force", parts.Force, {
        "name": slot("text", "f"), "at": slot("thing", ARM), "wrench": slot("numbers", np.ones((2, 6))),
        "time": slot("numbers", [0.0, 1.0]), "follower": slot("flag", False),
    })  # fmt: skip
    rigid = model("rigid_3r")
    yield Entrance("Mechanism", parts.Mechanism, {
        "name": slot("text", "m"), "links": slot("thing", rigid.links), "joints": slot("thing", rigid.joints),
        "gravity": numbers,
    })  # fmt: skip


# ------------------------------------------------------------------------------------------------------ motions


def motions() -> Iterator[Entrance]:
    """Yield the motions and paths, evaluated."""
    rigid, arm = model("rigid_3r"), model("flex_one_link")
    times = np.linspace(0.0, 1.0, 8)

    def to_point(start: Any, end: Any, **options: Any) -> Any:
        return flexinv.Motion.point_to_point(start, end, **options).evaluate(rigid, times)

    def sampled(time: Any, q: Any, **options: Any) -> Any:
        return flexinv.Motion.from_samples(time, q, **options).evaluate(rigid, times)

    span = {"duration": slot("number", 0.5), "hold": slot("number", 0.25), "delay": slot("number", 0.125)}
    yield Entrance("Motion.point_to_point", to_point, {
        "start": slot("numbers", VECTOR), "end": slot("numbers", [1.0, 0.5, 2.0]), **span, "law": slot("choice", "quintic"),
    })  # fmt: skip

    def named(start: Any, end: Any, **options: Any) -> Any:
        return flexinv.Motion.point_to_point(start, end, **options).evaluate(arm, times)

    hub = slot("by joint", {"hub": 0.0})
    yield Entrance(
        "Motion.point_to_point by name", named, {"start": hub, "end": slot("by joint", {"hub": 1.0}), **span}
    )
    q = np.random.default_rng(3).uniform(-1, 1, (8, 3))
    yield Entrance("Motion.from_samples", sampled, {
        "time": slot("numbers", 2 * times), "q": slot("numbers", q), "degree": slot("whole", 3), "rest": slot("flag", False),
        "max_gap": optional("number", 2.0),
    })  # fmt: skip
    motion = flexinv.Motion.from_samples(times, q)
    yield Entrance("Motion.evaluate", motion.evaluate, {
        "mechanism": slot("thing", rigid), "time": slot("numbers", times, "one more"), "side": slot("choice", "left"),
    })  # fmt: skip
    yield Entrance("Motion.merge", lambda motion: flexinv.Motion.merge(motion).evaluate(arm, times), {
        "motion": slot("thing", flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, 1.0)),
    })  # fmt: skip
    three = slot("numbers", VECTOR)

    def along(make: Call) -> Call:
        return lambda **given: make(**given).evaluate(times)

    law = slot("choice", "septic")
    yield Entrance("Path.line", along(flexinv.Path.line), {
        "start": three, "end": slot("numbers", [1, 2, 3]), "duration": slot("number", 0.5), "law": law,
    })  # fmt: skip
    yield Entrance("Path.arc", along(flexinv.Path.arc), {
        "start": three, "centre": slot("numbers", [1, 1, 1]), "angle": slot("number", 1.5), "duration": slot("number", 0.5),
        "axis": slot("numbers", [0, 0, 2]), "law": law,
    })  # fmt: skip
    yield Entrance("Path.points", along(flexinv.Path.points), {
        "points": slot("numbers", q, "unsigned", "integers"), "duration": slot("number", 0.5), "law": law,
    })  # fmt: skip
    path = flexinv.Path.line([0, 0, 0], [1, 0, 0], 1.0)
    half = np.diag([-1.0, -1.0, 1.0])
    yield Entrance("Path.turning", lambda **given: path.turning(**given).evaluate(times), {
        "start": slot("numbers", np.eye(3)), "end": slot("numbers", half),
    })  # fmt: skip
    yield Entrance("Path.evaluate", path.evaluate, {"time": slot("numbers", times, "one more")})


# ------------------------------------------------------------------------------------------------- many samples


def torques() -> Iterator[Entrance]:
    """Yield the functions of many samples, with one prepared function that all calls share."""
    arm = model("rigid_3r")
    asked, state = flexinv.prepare(arm), np.random.default_rng(4).uniform(-1, 1, (3, 5, 3))
    many = {name: slot("numbers", part) for name, part in zip(("q", "qd", "qdd"), state, strict=True)}
    one = {name: slot("numbers", part[0]) for name, part in zip(("q", "qd", "qdd"), state, strict=True)}
    thing, passive = slot("thing", arm), slot("flag", True)
    yield Entrance("TorqueFunction.sample", lambda **given: asked.sample(**given, out=np.zeros(3)).copy(), one, 8.0)
    yield Entrance("TorqueFunction.torques", asked.torques, {**many, "order": slot("choice", "samples")}, 3.0)
    yield Entrance("TorqueFunction.nodal", asked.nodal, many)
    yield Entrance("joint_torques", flexinv.joint_torques, {
        "mechanism": thing, **many, "passive": passive, "order": slot("choice", "samples"), "threads": optional("whole", 1),
    }, 2.0)  # fmt: skip
    yield Entrance(
        "prepare", flexinv.prepare, {"mechanism": thing, "passive": passive, "threads": optional("whole", 1)}
    )
    yield Entrance("torque_derivatives", flexinv.torque_derivatives, {"mechanism": thing, **many, "passive": passive})
    yield Entrance(
        "torque_regressor", flexinv.torque_regressor, {"mechanism": thing, **many, "drives": slot("flag", True)}
    )
    yield Entrance("base_parameters", flexinv.base_parameters, {
        "regressor": slot("thing", flexinv.torque_regressor(arm, *state)),
    })  # fmt: skip
    strip = model("flex_one_link")
    turn = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 0.5}, duration=0.1, law="nonic")
    yield Entrance("Parameter", flexinv.Parameter, {"name": slot("text", "load"), "value": slot("number", 0.5), "make": slot(
        "thing", lambda value: strip
    )})  # fmt: skip
    yield Entrance("differentiate", flexinv.differentiate, {
        "mechanism": slot("thing", strip), "motion": slot("thing", turn), "by": slot("text", "motion.hub[1]", "list"),
        "step": slot("number", 2e-3), "spectral_radius": slot("number", 0.8),
    })  # fmt: skip
    yield Entrance("differentiate_modes", flexinv.differentiate_modes, {
        "mechanism": slot("thing", strip), "by": slot("text", "links.link.beam.length", "list"),
        "q": optional("numbers", [0.25]), "count": optional("whole", 3),
    })  # fmt: skip
    yield Entrance("find_gradient", flexinv.find_gradient, {
        "mechanism": slot("thing", strip), "motion": slot("thing", turn), "of": slot("thing", {"residual": 1.0}),
        "by": slot("text", "motion.duration", "list"), "step": slot("number", 2e-3), "end": slot("number", 0.15),
        "spectral_radius": slot("number", 0.8),
    })  # fmt: skip
    yield Entrance("optimize_motion", flexinv.optimize_motion, {
        "mechanism": slot("thing", strip, "list"), "motion": slot("thing", turn), "aim": slot("text", "rms torque"),
        "limits": slot("thing", flexinv.MotionLimits(torque={}, residual=0.1)), "step": optional("number", 2.0**-9),
        "knots": slot("whole", 4),
    })  # fmt: skip
    yield Entrance(
        "MotionLimits", lambda **given: _limit(strip, **given),
        {"rate": optional("by joint", {"hub": 0.5}), "residual": optional("number", 0.25)},
    )  # fmt: skip
    yield Entrance("StrainLimit", flexinv.StrainLimit, {
        "largest": slot("number", 0.25), "y": slot("number", 0.5), "z": slot("number", 0.125),
    })  # fmt: skip
    bent = flexinv.Controller.of(strip, step=1e-3)
    single = {name: slot("numbers", [x]) for name, x in zip(one, (1.8e-5, 6e-3, 1.0), strict=True)}
    yield Entrance("Controller.step", _steps(bent), single, 4.0)
    rigid = flexinv.Controller.of(arm)
    yield Entrance("Controller.step, rigid", lambda **given: rigid.step(**given).copy(), one, 2.0)
    yield Entrance("Controller.start", lambda **given: bent.start(**given).copy(), {
        **single, "initial": slot("choice", "static"),
    })  # fmt: skip
    yield Entrance("Controller.of", lambda **given: flexinv.Controller.of(**given).mechanism, {
        "mechanism": slot("thing", arm), "step": optional("number", 0.25), "spectral_radius": slot("number", 0.5),
    }, 0.3)  # fmt: skip


def _limit(mechanism: flexinv.Mechanism, **given: Any) -> flexinv.MotionLimits:
    """Limits whose joints are those of a mechanism."""
    limits = flexinv.MotionLimits(**given)
    limits.check_names(mechanism)
    return limits


def _steps(controller: Any) -> Call:
    """A start, a step, and the step that is asked for."""

    def call(q: Any, qd: Any, qdd: Any) -> Any:
        rest, push = np.zeros(1), np.ones(1)
        controller.start(rest, rest, push)
        for time in 1e-3 * np.arange(1, 6):  # beyond the parts of a sudden start
            controller.step(0.5 * time**2 * push, time * push, push)
        return controller.step(q, qd, qdd).copy()

    return call


# -------------------------------------------------------------------------------------------------------- verbs


def verbs() -> Iterator[Entrance]:
    """Yield the public verbs of flexible mechanisms."""
    arm, two = model("flex_one_link"), model("flex_two_link")
    turn = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, duration=0.25)
    thing, radius = slot("thing", arm), slot("number", 0.5)
    march = {
        "mechanism": thing, "motion": slot("thing", turn), "step": slot("number", 1 / 64), "end": optional("number", 0.125),
        "spectral_radius": radius, "initial": slot("choice", "static"), "every": slot("whole", 2),
    }  # fmt: skip
    yield Entrance("solve", flexinv.solve, {**march, "error": slot("flag", False)}, 2.0)
    yield Entrance(
        "solve_in_parts", lambda **given: list(flexinv.solve_in_parts(**given)), {**march, "part": slot("whole", 3)}
    )
    yield Entrance("solve_many", lambda **given: flexinv.solve_many(**given).all(), {
        "mechanisms": slot("thing", arm, "list"), "motions": slot("thing", turn, "list"), "step": slot("number", 1 / 64),
        "threads": optional("whole", 1),
    })  # fmt: skip
    yield Entrance("simulate", flexinv.simulate, {
        "mechanism": thing, "time": slot("numbers", [0.0, 0.125, 0.25]), "torque": slot("numbers", [[0.0], [0.05], [0.0]]),
        "step": slot("number", 1 / 512), "spectral_radius": radius, "start": optional("by joint", {"hub": 0.1}),
        "start_rate": optional("by joint", {"hub": 0.25}),
    }, 2.0)  # fmt: skip
    force = slot("numbers", [0.0, 0.1, 0.0])

    def loaded(**given: Any) -> Any:
        mechanism, q = given.pop("mechanism"), given.pop("q")
        return flexinv.statics(mechanism, [flexinv.Load("link", **given)], q)

    yield Entrance("statics", loaded, {
        "mechanism": thing, "q": optional("numbers", [0.5]), "force": force, "moment": slot("numbers", [0.0, 0.0, 0.01]),
        "station": slot("number", 0.5), "follower": slot("flag", False),
    }, 2.0)  # fmt: skip
    place, count = optional("numbers", [0.5]), optional("whole", 2)
    yield Entrance("natural_modes", flexinv.natural_modes, {
        "mechanism": thing, "q": place, "free": optional("names", ["hub"]), "count": count,
    }, 2.0)  # fmt: skip
    rates = optional("by joint", {"hub": 2.0})
    yield Entrance(
        "steady_modes", flexinv.steady_modes, {"mechanism": thing, "q": place, "rates": rates, "count": count}, 2.0
    )
    yield Entrance("linear_model", flexinv.linear_model, {
        "mechanism": thing, "q": place, "rates": rates, "free": optional("names", ["hub"]), "modes": count,
    }, 2.0)  # fmt: skip
    shaping = {"kind": slot("choice", "ZVD"), "vibration": slot("number", 0.25)}
    frequency = slot("numbers", [2.0, 5.0])
    yield Entrance(
        "make_shaper", flexinv.make_shaper, {**shaping, "frequency": frequency, "ratio": slot("numbers", [0.125, 0.25])}
    )
    yield Entrance(
        "InputShaper",
        flexinv.InputShaper,
        {"times": slot("numbers", [0.0, 0.5]), "parts": slot("numbers", [0.25, 0.75])},
    )
    yield Entrance("make_shaped_motion", flexinv.make_shaped_motion, {
        "mechanism": thing, "motion": slot("thing", turn), "modes": slot("whole", 1), **shaping,
    })  # fmt: skip
    up = flexinv.Path.line([0.3, 0.1, 0], [0.3, 0.15, 0], 0.2)
    yield Entrance("follow", flexinv.follow, {
        "mechanism": slot("thing", two), "path": slot("thing", up), "frame": slot("choice", "link2"),
        "step": slot("number", 0.015625), "start": optional("by joint", {"joint1": -0.5, "joint2": 1.0}),
        "error": slot("flag", False),
    }, 0.3)  # fmt: skip
    solution = flexinv.solve(arm, turn, step=1 / 64)
    yield Entrance(
        "find_limits", flexinv.find_limits, {"solution": slot("thing", solution), "motion": slot("thing", turn)}
    )
    yield Entrance("motor_side", flexinv.motor_side, {"solution": slot("thing", solution)})
    yield Entrance("Solution.factors", solution.factors, {"sample": slot("whole", 2, "below zero")})
    yield Entrance("Mechanism.with_mesh", arm.with_mesh, {"elements": slot("whole", 2), "order": slot("whole", 3)})
    yield Entrance("Mechanism.refined", arm.refined, {"elements": slot("whole", 2), "order": slot("whole", 3)})
    bob = parts.Body("bob", parts.Inertia(1.0), 0.5)
    yield Entrance("Mechanism.with_body", arm.with_body, {"link": slot("text", "link"), "body": slot("thing", bob)})


# -------------------------------------------------------------------------------------------------------- files


def files() -> Iterator[Entrance]:
    """Yield what reads files, and what of crosscheck compares, judges and identifies."""
    bar = MODELS / "rigid_3r"
    path = slot("thing", bar)
    yield Entrance("load_mechanism", flexinv.load_mechanism, {"path": path})
    yield Entrance("load_cases", flexinv.load_cases, {"path": path, "mechanism": slot("thing", model("rigid_3r"))})
    urdf = Path(__file__).resolve().parent / "data" / "two_links.urdf"
    yield Entrance("from_urdf", flexinv.from_urdf, {
        "path": slot("thing", urdf), "packages": slot("thing", (), "table"), "base": slot("choice", "free"),
        "gravity": slot("numbers", VECTOR), "lock": slot("names", ["elbow"]),
    })  # fmt: skip
    request = {
        "robot": path, "motion": slot("thing", tabled()), "payload": optional("by joint", {"link3": 2.0}),
        "gravity": optional("numbers", VECTOR), "friction": slot("flag", False), "spacing": slot("number", 0.125),
        "step": optional("number", 0.125), "initial": slot("choice", "static"),
    }  # fmt: skip
    yield Entrance("torques", lambda **given: flexinv.torques(**given).to_numpy(), request, 2.0)
    yield Entrance("export_c", exported, {
        "mechanism": slot("thing", model("flex_one_link")), "targets": slot("names", ["aarch64"]), "step": slot("number", 0.25),
        "start": optional("numbers", [0.5]), "initial": slot("choice", "static"), "spectral_radius": slot("number", 0.5),
        "payloads": slot("names", ["link"]), "overwrite": slot("flag", True),
    }, 0.1)  # fmt: skip
    yield Entrance("export_fmu", described, {
        "mechanism": slot("thing", model("flex_one_link")), "fmi": slot("choice", "2.0"), "kind": slot("choice", "inverse"),
        "step": slot("number", 0.25), "start": optional("numbers", [0.5]), "initial": slot("choice", "static"),
        "spectral_radius": slot("number", 0.5), "payloads": slot("names", ["link"]), "target": slot("choice", "native"),
        "overwrite": slot("flag", True),
    }, 1.0)  # fmt: skip
    yield Entrance("export_ros", packaged, {
        "mechanism": slot("thing", model("flex_one_link")), "targets": slot("names", ["aarch64"]), "step": slot("number", 0.25),
        "start": optional("numbers", [0.5]), "initial": slot("choice", "static"), "spectral_radius": slot("number", 0.5),
        "payloads": slot("names", ["link"]), "overwrite": slot("flag", True),
    }, 0.1)  # fmt: skip
    yield Entrance("write_torques", written, {**request, "rows": slot("whole", 2000)})
    judge = slot("names", ["rigid", "drive"])
    both = {"a": slot("thing", urdf), "b": slot("thing", urdf), "tolerance": slot("number", 1e-5), "judge": judge,
            "strict": slot("flag", False), "match": optional("renaming", {"elbow": "elbow"})}  # fmt: skip
    yield Entrance("crosscheck.compare", lambda **given: crosscheck.compare(**given).equal, both, 0.6)
    yield Entrance("crosscheck.assert_same", lambda **given: crosscheck.assert_same(**given).equal, both, 0.6)
    yield Entrance("crosscheck.lint", lambda **given: quiet(crosscheck.lint, **given), {
        "source": slot("thing", urdf), "strict": slot("flag", True), "meshes": slot("flag", False),
    }, 0.6)  # fmt: skip
    yield Entrance("crosscheck.identify", lambda **given: crosscheck.identify(**given), {
        "mechanism": slot("thing", MODELS / "rigid_3r"), "logs": slot("thing", ("missing.csv",)), "hold_out": slot("thing", ()),
    }, 0.6)  # fmt: skip


def exported(**given: Any) -> Any:
    """Return the sources of an exported library [-], by their paths."""
    with tempfile.TemporaryDirectory() as folder:
        made = flexinv.export_c(**given, out=Path(folder) / "library")
        return {one: (made.folder / one).read_text() for one in made.files if one.endswith((".h", ".c", ".md"))}


def packaged(**given: Any) -> Any:
    """Return the sources of an exported package of ROS 2 [-], by their paths."""
    with tempfile.TemporaryDirectory() as folder:
        made = flexinv.export_ros(**given, out=Path(folder) / "package")
        return {
            one: (made.folder / one).read_text() for one in made.files if one.endswith((".hpp", ".cpp", ".txt", ".md"))
        }


def described(**given: Any) -> Any:
    """Return the description of an exported FMU [-]."""
    with tempfile.TemporaryDirectory() as folder:
        made = flexinv.export_fmu(**given, out=Path(folder) / "arm.fmu")
        with zipfile.ZipFile(made) as archive:
            return archive.read("modelDescription.xml").decode()


def tabled() -> pd.DataFrame:
    """Return a motion of the three joints as a table [rad]."""
    angles = np.sin(np.linspace(0.0, 1.0, 12)[:, None] * [1.0, 2.0, 3.0])
    return pd.DataFrame(angles, columns=list(model("rigid_3r").velocity_names))


def written(**given: Any) -> Any:
    """Return the efforts [N m] that a file holds afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        return pd.read_csv(flexinv.write_torques(**given, out=Path(folder) / "efforts.csv").file).to_numpy()


def quiet(call: Call, **given: Any) -> Any:
    """Return what a call gives [any unit], without what it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        return call(**given)


@cache
def entrances() -> tuple[Entrance, ...]:
    """Return all entrances [any unit], each built once."""
    return (*records(), *motions(), *torques(), *verbs(), *files())
