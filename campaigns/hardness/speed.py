"""Times, in one sitting: single samples beside `pinocchio::rnea` in C++, steps beside those of `flexinv.Controller`."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import flexinv
from benchmarks.latency import sample_step_times
from campaigns.hardness.libraries import HERE, MACHINES, Library, Machine, open_library, open_library_of, run_command
from crosscheck.studies.robot_sweep import remove_damping
from flexinv.export.c_files import LAYOUT
from flexinv.typing import Array

# Robot -> its file in the package example-robot-data.
ROBOTS = {
    "UR5, 6 axes": "ur_description/urdf/ur5_robot.urdf",
    "Z1, 7 axes": "z1_description/urdf/z1.urdf",
    "Talos's arm, 7 axes": "talos_data/robots/talos_left_arm.urdf",
    "xArm 7, 7 axes and a gripper": "xarm_description/urdf/xarm7.urdf",
    "Panda, 7 axes and a gripper": "panda_description/urdf/panda.urdf",
    "Kinova, 6 axes (continuous) and fingers": "kinova_description/robots/kinova.urdf",
}
ROUNDS = 31
CALLS = 20_000  # of a round
AGREES = 1e-11  # of the largest effort, before anything is timed
STEPS = 100_000
# Pinocchio's own definitions, as its package for CMake has them.
DEFINED = (
    "BOOST_MPL_LIMIT_LIST_SIZE=30", "BOOST_MPL_LIMIT_VECTOR_SIZE=30", "BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "BOOST_FUSION_INVOKE_MAX_ARITY=12",
)  # fmt: skip


def list_sample_rows(scale: float) -> Iterator[str]:
    """Yield lines about single samples of rigid arms [ns] in the library, and in `pinocchio::rnea` with the same flags."""
    with tempfile.TemporaryDirectory() as place:
        program = compile_timed(Path(place))
        for title, path in ROBOTS.items():
            urdf = find_pinocchio() / "share/example-robot-data/robots" / path
            mechanism = remove_damping(flexinv.from_urdf(urdf))
            with open_library_of(mechanism, Machine(title, "")) as library:
                apart, ours, theirs = time_samples(program, library, urdf, int(scale * CALLS))
            wrong = "" if apart <= AGREES and ours <= theirs else "  WRONG"
            yield f"{title}: {ours:.0f} ns, rnea {theirs:.0f} ns, {theirs / ours:.2f} times as fast; apart {apart:.1e}{wrong}"


def time_samples(program: Path, library: Library, urdf: Path, calls: int) -> tuple[float, ...]:
    """Return how far both are apart, of the largest effort [-], and the times of a sample [ns] in ours and in theirs."""
    robot = library.folder / "robot.txt"
    robot.write_text(write_robot(urdf), encoding="utf-8")
    shared = library.folder / "lib" / "native" / f"lib{library.name}.so"
    said = run_command([program, shared, library.name, robot, library.motion, ROUNDS, calls, LAYOUT])
    return tuple(map(float, said.split()))


def find_pinocchio() -> Path:
    """Return the prefix of Pinocchio's headers and libraries, which come with the wheel `pin` [-]."""
    return Path(importlib.import_module("cmeel").__file__ or "").parents[1] / "cmeel.prefix"


def write_robot(urdf: Path) -> str:
    """Return Pinocchio's model of a robot [-] as `timed.cpp` reads it: numbers, so that none of its libraries is linked.

    They are compiled for an older processor, for which Eigen aligns memory in another way.
    """
    pin = importlib.import_module("pinocchio")
    model = pin.buildModelFromUrdf(str(urdf))
    return "\n".join(_describe_joint(pin, model, k) for k in range(1, model.njoints)) + "\n"


def _describe_joint(pin: Any, model: Any, joint: int) -> str:
    """A line: kind, parent, axis [-], placement [-], [m], and what is fixed to a joint [kg, kg m, kg m^2]."""
    placement = model.jointPlacements[joint]
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    column = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)[:, model.joints[joint].idx_v]
    axis = column[3:] if np.any(column[3:]) else column[:3]
    parts = axis, placement.rotation.ravel(), placement.translation, model.inertias[joint].toDynamicParameters()
    numbers = " ".join(repr(float(one)) for one in np.concatenate(parts))
    return f"{model.joints[joint].shortname()} {model.parents[joint]} {numbers}"


def compile_timed(folder: Path) -> Path:
    """Return the program `timed.cpp` [-], in a folder; a minute of compiling."""
    out = folder / "timed"
    flags = ["-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-w", *(f"-D{one}" for one in DEFINED)]
    folders = [find_pinocchio() / "include", "/usr/include/eigen3"]
    run_command(["c++", *flags, *(f"-I{one}" for one in folders), HERE / "timed.cpp", "-ldl", "-o", out])
    return out


def list_step_rows(scale: float) -> Iterator[str]:
    """Yield lines about 100,000 single calls [us] of libraries and of controllers, in turn, of smooth motions."""
    for machine in MACHINES[:-1]:
        with open_library(replace(machine, jumps=False)) as library:
            ours, theirs = sample_both(library, int(scale * STEPS))
            yield (
                f"{machine.title}: library {describe_times(ours)}; Controller {describe_times(theirs)}; ratio of medians "
                + (f"{np.median(theirs) / np.median(ours):.2f}")
            )


def sample_both(library: Library, steps: int) -> tuple[Array, Array]:
    """Return the times (steps,) [us] of the library's calls and of the controller's, of the same motion."""
    program = library.compile("steps.c")
    out = library.folder / "latencies.bin"
    run_command([program, library.motion, steps, 1, out])
    return 1e6 * np.fromfile(out, dtype=np.float32).astype(float), 1e6 * sample_controller(library, steps)


def sample_controller(library: Library, steps: int) -> Array:
    """Return the time of every step [s] of a controller that is given the library's motion."""
    nq, nv = library.mechanism.nq, library.mechanism.nv
    rows = [tuple(map(np.ascontiguousarray, np.split(row, [nq, nq + nv]))) for row in library.rows]
    controller = flexinv.Controller.of(library.mechanism, step=library.machine.step or 0.0)
    start = library.start
    rest = np.zeros(nv)
    controller.start(start, rest, rest, initial="static")
    return sample_step_times(controller, rows, rows, steps)


def describe_times(taken: Array) -> str:
    """Return median, 99.9 % and largest [us] in words."""
    median, rare = np.percentile(taken, (50, 99.9))
    return f"median {median:.3g} us, 99.9 % {rare:.3g}, largest {taken.max():.3g}"
