"""The package for ROS 2: its plugin loaded by pluginlib where that is installed, its feed-forward driven cycle by cycle."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_library import needs_compiler
from marched_library import STEP, Rows, controlled, swing

import flexinv
from flexinv.errors import InputError
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

STUB = Path(__file__).resolve().parents[2] / "shared" / "ros_stub"
DEBIAN = [
    Path("/usr/include") / name for name in ("pluginlib", "class_loader", "ament_index_cpp", "rcutils", "rcpputils")
]
needs_pluginlib = pytest.mark.skipif(
    shutil.which("cmake") is None or not all(folder.is_dir() for folder in (*DEBIAN, Path("/usr/include/eigen3"))),
    reason="pluginlib is not installed (on Debian: apt install pluginlib-dev libclass-loader-dev libeigen3-dev cmake)",
)
# Places of packages that a build finds: of the interface and of rclcpp the headers of the stub.
CONFIG = "set({name}_FOUND TRUE)\nset({name}_INCLUDE_DIRS {stub} /usr/include/eigen3)\n"
ROUNDING = 1e-14  # of a payload that is added as a body of its own: sums in another order
GRAVITY = np.array([1.0, -2.0, -9.0])
LOAD = Inertia(0.5, np.array([0.02, -0.01, 0.05]))
ORDER = [2, 0, 1]


@pytest.fixture(scope="module")
def rigid() -> Mechanism:
    """An arm with friction in its joints."""
    arm = flexinv.load_mechanism("models/rigid_3r")
    joints = tuple(replace(joint, damping=0.3 + k, friction=0.2) for k, joint in enumerate(arm.joints))
    return replace(arm, joints=joints)


@pytest.fixture(scope="module")
def installed(rigid: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package of the arm, built and installed by CMake and ament, with the program that loads it."""
    folder = tmp_path_factory.mktemp("ros")
    made = flexinv.export_ros(rigid, folder / "package")
    prefix = folder / "install"
    for name in ("inverse_dynamics_solver", "rclcpp"):
        place = folder / "found" / name
        place.mkdir(parents=True)
        (place / f"{name}Config.cmake").write_text(CONFIG.format(name=name, stub=STUB))
    index = prefix / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "inverse_dynamics_solver").touch()
    found = [f"-D{name}_DIR={folder / 'found' / name}" for name in ("inverse_dynamics_solver", "rclcpp")]
    options = [
        f"-DCMAKE_INSTALL_PREFIX={prefix}",
        "-DCMAKE_BUILD_TYPE=Debug",
        "-DPython3_EXECUTABLE=/usr/bin/python3",
        *found,
    ]
    run("cmake", "-S", str(made.folder), "-B", str(folder / "build"), *options)
    run("cmake", "--build", str(folder / "build"), "--target", "install")
    includes = [f"-I{one}" for one in (STUB, *DEBIAN)]
    libraries = [
        "-lclass_loader",
        "-lament_index_cpp",
        "-lrcutils",
        "-ltinyxml2",
        "-lconsole_bridge",
        "-lrcpputils",
        "-lroslib",
    ]
    run("c++", "-std=c++17", str(STUB / "replay.cpp"), *includes, *libraries, "-o", str(prefix / "replay"))
    return prefix


def run(*words: str, given: str = "", **environment: str) -> str:
    done = subprocess.run(
        words, input=given, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@needs_compiler
@needs_pluginlib
def test_the_plugin_gives_what_flexinv_gives(installed: Path, rigid: Mechanism) -> None:
    """With the gravity, the payload and the order of joints of its parameters; friction is in the torques, and alone."""
    q, qd, qdd = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 3))
    numbers = [repr(float(one)) for part in (q, qd, qdd) for one in part[ORDER]]
    said = run(
        str(installed / "replay"), "flexinv_rigid_3r_ros/Solver", "3", *numbers, AMENT_PREFIX_PATH=str(installed)
    )
    torques, gravity, coriolis, friction, matrix, again = [np.array(line.split(), float) for line in said.splitlines()]
    heavy = replace(rigid.with_body("link3", Body("load", LOAD)), gravity=GRAVITY)
    still = np.zeros(3)
    bare = replace(heavy, joints=tuple(replace(j, damping=0.0, friction=0.0) for j in heavy.joints))
    expected = flexinv.joint_torques(heavy, q, qd, qdd)
    bar = ROUNDING * np.abs(expected).max()
    np.testing.assert_allclose(torques, expected[ORDER], rtol=0, atol=bar)
    weight = flexinv.joint_torques(bare, q, still, still)
    np.testing.assert_allclose(gravity, weight[ORDER], rtol=0, atol=bar)
    assert np.array_equal(again, gravity)
    np.testing.assert_allclose(
        coriolis, (flexinv.joint_torques(bare, q, qd, still) - weight)[ORDER], rtol=0, atol=10 * bar
    )
    lost = flexinv.joint_torques(heavy, q, qd, still) - flexinv.joint_torques(bare, q, qd, still)
    np.testing.assert_allclose(friction, lost[ORDER], rtol=0, atol=10 * bar)
    columns = np.array([flexinv.joint_torques(bare, q, still, unit) - weight for unit in np.eye(3)])
    np.testing.assert_allclose(matrix.reshape(3, 3), columns[np.ix_(ORDER, ORDER)], rtol=0, atol=10 * bar)


@needs_compiler
@needs_pluginlib
def test_the_plugin_refuses_in_words(installed: Path) -> None:
    said = run(str(installed / "replay"), "flexinv_rigid_3r_ros/Solver", "refuse", AMENT_PREFIX_PATH=str(installed))
    assert said.splitlines() == [
        "the solver is not initialized",
        "x.joints: there is no joint nobody",
        "gravity: expected x, y, z in the world [m/s^2]",
        "payload.link: there is no link nobody",
        "joint_positions: 2 numbers, expected 3",
        "getGravityVector: a number that is given is infinite or not a number",
    ]


def drive(mechanism: Mechanism, folder: Path, rows: Rows, start: Array, step: float | None) -> Array:
    """Commands of the controller of a package, in each cycle."""
    made = flexinv.export_ros(mechanism, folder / "package", step=step)
    name = made.name.removesuffix("_ros")
    source = folder / "cycle.cpp"
    source.write_text((STUB / "cycle.cpp.in").read_text().replace("NAME", name))
    stub = folder / "stub" / "pluginlib"
    stub.mkdir(parents=True)
    (stub / "class_list_macros.hpp").write_text("#define PLUGINLIB_EXPORT_CLASS(kind, base)\n")
    library = made.folder / "library"
    includes = [made.folder / "src", made.folder / "include", library / "include", STUB, stub.parent]
    words = ["c++", "-std=c++17", "-Wall", "-Wextra", "-Werror", str(source), *(f"-I{one}" for one in includes)]
    run(*words, str(library / "lib" / "native" / f"lib{name}.a"), "-o", str(folder / "cycle"))
    lines = [" ".join(map(repr, start.tolist()))]
    lines += [" ".join(repr(float(one)) for one in np.stack(row, axis=1).ravel()) for row in rows]
    said = run(str(folder / "cycle"), repr(step or 1e-3), str(len(rows)), given="\n".join(lines))
    return np.array([line.split() for line in said.splitlines()], float).reshape(len(rows), -1, 2)


@needs_compiler
def test_the_controller_commands_torques_of_a_rigid_arm(rigid: Mechanism, tmp_path: Path) -> None:
    rows = swing(rigid, rigid.neutral + 0.2, steps=5)
    commands = drive(rigid, tmp_path, rows, rigid.neutral + 0.2, None)
    assert np.array_equal(commands[:, :, 0], [flexinv.joint_torques(rigid, *row) for row in rows])
    assert np.array_equal(commands[:, :, 1], [q for q, _, _ in rows])


@needs_compiler
def test_the_controller_commands_torques_of_an_arm_that_bends(tmp_path: Path) -> None:
    """From where its joints stand, at the update rate of its step; another period is an error."""
    arm = replace(flexinv.load_mechanism("models/flex_two_link"), gravity=np.array([0.0, -9.81, 0.0]))
    start = np.array([0.4, -0.7])
    rows = swing(arm, start, steps=40)
    commands = drive(arm, tmp_path, rows, start, STEP)
    expected = controlled(arm, start, rows)
    np.testing.assert_allclose(commands[:, :, 0], expected, rtol=0, atol=1e-9 * np.ptp(expected))  # as test_fmu.REST


@needs_compiler
def test_a_package_has_its_licence_and_refuses_what_ros_cannot_say(
    rigid: Mechanism, root: Path, tmp_path: Path
) -> None:
    made = flexinv.export_ros(replace(rigid, name='a*/"<b>'), tmp_path / "package")
    assert (made.folder / "LICENSE").read_text() == (root / "LICENSE").read_text()
    assert {"package.xml", "src/solver.cpp", "library/src/flexinv_a____b.c"} <= set(made.files)
    for name, said in (("talos", "ROS has one position for a joint"), ("four_bar", "take the motion of all joints")):
        with pytest.raises(InputError, match=said):
            flexinv.export_ros(flexinv.load_mechanism(f"models/{name}"), tmp_path / name)
        assert not (tmp_path / name).exists()
    with pytest.raises(InputError, match="has files in it already"):
        flexinv.export_ros(rigid, tmp_path / "package")


def test_files_of_others_stay_as_they_are(rigid: Mechanism, tmp_path: Path) -> None:
    """A folder with a README of its own is refused; told to, the package is written into it, and says what is its own."""
    own = tmp_path / "README.md"
    own.write_text("mine")
    with pytest.raises(InputError, match="has files in it already"):
        flexinv.export_ros(rigid, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["README.md"]
    assert own.read_text() == "mine"
    (tmp_path / "notes.txt").write_text("mine, too")
    made = flexinv.export_ros(rigid, tmp_path, overwrite=True)
    assert "README.md" in made.files
    assert "notes.txt" not in made.files
    assert all((tmp_path / file).is_file() for file in made.files)
