"""Every robot of example-robot-data: flexinv against Pinocchio, and against MuJoCo where MuJoCo accepts the robot.

Random states (seeded); the error is the largest difference of any joint effort over all states, divided by the largest
effort of that robot.  Damping and dry friction are left out everywhere: this is about inertia, gravity and kinematics.
"""

from __future__ import annotations

import importlib
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from xml.etree.ElementTree import ParseError

import numpy as np
from defusedxml.ElementTree import parse

from flexinv import joint_torques
from flexinv.errors import ModelWarning
from flexinv.files.from_urdf import find_robots_folder, from_urdf
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

State = tuple[Array, Array, Array]
Progress = Callable[[str, int, int], None]

# Rounding of a few hundred operations on a tree of up to 100 bodies stays below 1e-13 of the largest effort; a wrong
# digit in a single inertia shows above 1e-9.
LARGEST_ERROR = 1e-11
# Folders (or files) of robots that walk or fly: they are computed with a free base, too.
WALK_OR_FLY = (
    *(
        "a1",
        "alex",
        "anymal",
        "b1",
        "bolt",
        "borinot",
        "centauro",
        "g1",
        "go1",
        "go2",
        "hector",
        "hextilt",
        "human",
        "hyq",
    ),
    *("icub", "iris", "laikago", "quadruped", "romeo", "simple_humanoid", "solo", "talos_full", "talos_reduced"),
)


@dataclass(frozen=True)
class RobotRow:
    """One robot with one kind of base.

    name : the file below the folder of robots; base : "fixed" or "free"; mass : [kg] of all links that move
    mimic : joints that the URDF couples to others, here independent; largest : largest effort [N m] or [N]
    pinocchio, mujoco : error of flexinv against the engine over ``largest`` [-]; None where there is none
    empty : the file has no link, so that there is nothing to read
    words : why flexinv or Pinocchio does not read the robot; mujoco_words : MuJoCo's, where it refuses
    cause : why MuJoCo differs by more than rounding; "" where it does not, or where the reason is not known
    repaired : the error against MuJoCo after that cause is repaired [-]
    """

    name: str
    base: str
    nq: int = 0
    nv: int = 0
    mass: float = 0.0
    mimic: tuple[str, ...] = ()
    largest: float = 0.0
    pinocchio: float | None = None
    mujoco: float | None = None
    empty: bool = False
    words: str = ""
    mujoco_words: str = ""
    cause: str = ""
    repaired: float | None = None


def list_robot_names() -> list[str]:
    """Return every URDF of example-robot-data, as a path below ``find_robots_folder()``."""
    folder = find_robots_folder()
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.urdf"))


def build_robot_table(
    names: Sequence[str] | None = None, samples: int = 20, seed: int = 1, progress: Progress | None = None
) -> list[RobotRow]:
    """Return the rows of every robot: with a fixed base where it has joints, and a free one where it walks or flies.

    names : of ``list_robot_names()``, all by default; samples : random states of each robot and base
    progress : called with (name, robots done, robots in all)
    """
    folder = find_robots_folder()
    chosen = list_robot_names() if names is None else list(names)
    rows = []
    for done, name in enumerate(chosen):
        if progress is not None:
            progress(name, done, len(chosen))
        found = [make_robot_row(folder / name, name, base, samples, seed) for base in list_bases(name)]
        rows += [row for row in found if row.nv or row.words]
    return rows


def list_bases(name: str) -> tuple[str, ...]:
    """Return the bases that a robot is computed with."""
    folder = name.split("/", 1)[0]
    stem = Path(name).stem
    moves = any(word.startswith(WALK_OR_FLY) for word in (folder, stem))
    return ("fixed", "free") if moves else ("fixed",)


def make_robot_row(path: Path, name: str, base: str = "fixed", samples: int = 20, seed: int = 1) -> RobotRow:
    """Return one robot's row; what a program cannot read is words in it, not an exception."""
    pinocchio = importlib.import_module("crosscheck.engines.pinocchio.adapter")
    with collect_parser_output() as printed:
        try:
            mechanism = _read(path, base)
            built = pinocchio.build(mechanism)
        except (ValueError, RuntimeError) as error:
            words = _describe_error(error, printed()).replace(f"{path.parent}{os.sep}", "")
            return RobotRow(name, base, empty=_is_empty_robot(path), words=words)
    state = sample_states(mechanism, samples, np.random.default_rng(seed))
    tau = joint_torques(mechanism, *state, passive=False)
    theirs = pinocchio.compute_inverse_dynamics(built, *state).torque
    largest = float(np.abs(theirs).max(initial=0.0))
    row = RobotRow(
        name,
        base,
        nq=mechanism.nq,
        nv=mechanism.nv,
        mass=float(sum(inertia.mass for inertia in list(built.model.inertias)[1:])),
        mimic=list_mimic_joints(path),
        largest=largest,
        pinocchio=_compute_error(tau, theirs, largest),
    )
    return _add_mujoco(row, mechanism, state, tau)


def _read(path: Path, base: str) -> Mechanism:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # mimic joints and odd inertias are columns of the table
        return remove_damping(from_urdf(path, base=base))


def remove_damping(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism without damping and dry friction."""
    return replace(mechanism, joints=tuple(replace(j, damping=0.0, friction=0.0) for j in mechanism.joints))


def _compute_error(a: Array, b: Array, largest: float) -> float | None:
    """Largest difference over the largest effort; None where there is no effort at all."""
    return float(np.abs(a - b).max()) / largest if largest else None


def _is_empty_robot(path: Path) -> bool:
    """Return True for a file that is sound XML and has no link in it, whatever a reader says of it."""
    try:
        return parse(path).getroot().find("link") is None
    except ParseError:
        return False


def _describe_error(error: BaseException, printed: str = "") -> str:
    lines = [line.strip() for line in f"{error}\n{printed}".splitlines() if line.strip()]
    return " | ".join(dict.fromkeys(lines))


# ---------------------------------------------------------------------------------------------------------- MuJoCo


def _add_mujoco(row: RobotRow, mechanism: Mechanism, state: State, tau: Array) -> RobotRow:
    """Add what MuJoCo says of the file as it reads it by default, and why, where that is not rounding."""
    try:
        mujoco = importlib.import_module("crosscheck.engines.mujoco.adapter")
    except ImportError as error:
        return replace(row, mujoco_words=str(error))
    try:
        mujoco_error = _compute_mujoco_error(mujoco, mechanism, state, tau, row.largest, fuse=True)
        if mujoco_error is None or mujoco_error <= LARGEST_ERROR:
            return replace(row, mujoco=mujoco_error)
        repaired = _compute_mujoco_error(mujoco, mechanism, state, tau, row.largest, fuse=False)
    except ValueError as error:
        return replace(row, mujoco_words=_describe_error(error))
    cause = _describe_fusing_loss(mechanism) if repaired is not None and repaired <= LARGEST_ERROR else ""
    return replace(row, mujoco=mujoco_error, cause=cause, repaired=repaired)


def _compute_mujoco_error(
    mujoco: ModuleType, mechanism: Mechanism, state: State, tau: Array, largest: float, fuse: bool
) -> float | None:
    with mujoco.collect_warnings():
        built = mujoco.build(mechanism, fuse=fuse)
        return _compute_error(tau, mujoco.compute_inverse_dynamics(mechanism, built, *state).torque, largest)


def _describe_fusing_loss(mechanism: Mechanism) -> str:
    """Say what fusing lost, from the inertias of MuJoCo's two models; "" unless that explains all that is missing."""
    losses = importlib.import_module("crosscheck.engines.mujoco.fuse").list_losses(mechanism)
    if not losses or not all(loss.explained for loss in losses):
        return ""
    parts = [f"{', '.join(loss.massless)} ({np.trace(loss.stated) / 2:.3g} kg m^2) in {loss.body}" for loss in losses]
    return (
        "MuJoCo's fusestatic drops the inertia of fixed links that have inertia but no mass: "
        + "; ".join(parts)
        + "; what its fused bodies lack is that inertia to rounding, and without fusing the difference is gone"
    )


# ---------------------------------------------------------------------------------------------------------- samples


def sample_states(mechanism: Mechanism, samples: int, random: np.random.Generator) -> State:
    """Return q (samples, nq), qd, qdd (samples, nv): angles in +-pi, places in +-1 m, rates in +-1, any rotation."""
    q = random.uniform(-1.0, 1.0, (samples, mechanism.nq))
    for joint in mechanism.joints:
        part = q[:, mechanism.q_slices[joint.name]]
        if joint.kind in ("revolute", "universal"):
            part *= np.pi
        elif joint.kind in ("continuous", "spherical", "free"):
            width = {"continuous": 2, "spherical": 4, "free": 4}[joint.kind]
            turn = random.normal(size=(samples, width))
            part[:, -width:] = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    qd, qdd = (random.uniform(-1.0, 1.0, (samples, mechanism.nv)) for _ in range(2))
    return q, qd, qdd


def list_mimic_joints(path: Path) -> tuple[str, ...]:
    """Return the names of the joints that the URDF couples to others."""
    joints = parse(str(path)).getroot().iter("joint")
    return tuple(joint.get("name", "") for joint in joints if joint.find("mimic") is not None)


@contextmanager
def collect_parser_output() -> Iterator[Callable[[], str]]:
    """Keep what C++ parsers write to stdout and stderr off the console; the value returns what came so far."""
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile("w+b") as sink:
        kept = [(fd, os.dup(fd)) for fd in (1, 2)]

        def read_output() -> str:
            sink.seek(0)
            return sink.read().decode(errors="replace")

        try:
            for fd, _ in kept:
                os.dup2(sink.fileno(), fd)
            yield read_output
        finally:
            for fd, saved in kept:
                os.dup2(saved, fd)
                os.close(saved)
