"""Markers, accelerometers and rates of joints: what they should read, and what is wrong with those that read something else."""

from __future__ import annotations

from pathlib import Path

import logged_arm
import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

from crosscheck.identification.estimation.fit import build_problem, fit
from crosscheck.identification.identify import read_machine
from crosscheck.identification.logs.log import Log, read_log
from crosscheck.identification.machine import Machine
from crosscheck.identification.readings import compute_readings, make_run
from crosscheck.identification.settings import read_settings
from flexinv.analysis.solve import solve
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.motion import Motion

POINTS = """[markers.tip]
link = "fore"
xyz_m = [0.3, 0.02, 0.01]
unit = "mm"
columns = { x = "tip_x", z = "tip_z" }
[accelerometers.wrist]
link = "fore"
xyz_m = [0.25, 0, 0]
rpy_deg = [0, 90, 0]
unit = "g"
columns = { x = "acc_x", z = "acc_z" }
"""
FREE = """[[free]]
parameter = "marker zero"
error = 0.02
[[free]]
parameter = "accelerometer gain"
relative = 0.1
"""
G = 9.80665


def truth(q: np.ndarray, time: np.ndarray, zero: float, gain: float) -> dict[str, np.ndarray]:
    """What the sensors of the arm read, from its geometry alone [mm], [g]: both links turn about the world's y axis."""

    def place(x: float, y: float) -> np.ndarray:
        one, both = q[:, 0], q[:, 0] + q[:, 1]
        along = 0.4 * np.cos(one) + x * np.cos(both) + y * np.sin(both)
        return np.column_stack([along, -0.4 * np.sin(one) - x * np.sin(both) + y * np.cos(both)])

    tip, wrist = place(0.3, 0.01), place(0.25, 0.0)
    felt = np.array([0.0, 9.81]) + CubicSpline(time, wrist)(time, 2)
    turned = q.sum(axis=1) + np.pi / 2.0
    axes = {
        "x": np.column_stack([np.cos(turned), -np.sin(turned)]),
        "z": np.column_stack([np.sin(turned), np.cos(turned)]),
    }
    read = {f"acc_{k}": gain * np.sum(axis * felt, axis=1) / G for k, axis in axes.items()}
    return {"tip_x": 1e3 * (tip[:, 0] + zero), "tip_z": 1e3 * tip[:, 1], **read}


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = logged_arm.write_arm(tmp_path_factory.mktemp("points") / "arm")
    table = logged_arm.frame(folder)
    for k in (1, 2):
        table[f"qd{k}"] = np.degrees(np.gradient(table[f"q{k}"], 0.004, edge_order=2))
    more = truth(table[["q1", "q2"]].to_numpy(), table["time_s"].to_numpy(), 0.015, 1.1)
    pd.concat([table, pd.DataFrame(more)], axis=1).to_csv(folder / "log.csv", index=False)
    return folder


def machine(folder: Path, more: str) -> Machine:
    own = folder.parent / "settings.toml"
    joint = '[joints.elbow]\nangle = { column = "q2" }'
    base = logged_arm.IDENTIFY
    tables = [more, FREE] if "markers" in more else [""]
    if "rate" in more:
        base = base.replace(joint, f"{joint}\n{more}")
    own.write_text(base + "".join(tables))
    mechanism = load_mechanism(folder)
    return read_machine(mechanism, read_settings(own, mechanism))


def test_points_of_rigid_links_read_what_their_geometry_says(logged: Path) -> None:
    """The zero of the marker and the gain of the accelerometer are found; what they read otherwise is the geometry's."""
    arm = machine(logged, POINTS)
    run = make_run(arm, read_log(logged / "log.csv"))
    result = fit(build_problem(arm, (run,)))
    values = arm.space.compute_values(result.z)
    assert values["marker zero", "tip.x"] == pytest.approx(0.015, abs=1e-6)  # the low-pass passes constants to rounding
    assert values["marker zero", "tip.z"] == pytest.approx(0.0, abs=1e-6)
    # accelerations come of splines through samples 4 ms apart: relative errors of (w h)^2 / 12 for w up to 2 pi 0.5
    assert values["accelerometer gain", "wrist.x"] == pytest.approx(1.1, rel=1e-4)
    assert values["accelerometer gain", "wrist.z"] == pytest.approx(1.1, rel=1e-4)
    assert run.measured is not None
    at = [c for c, channel in enumerate(arm.channels) if channel.sense != "effort"]
    inner = slice(150, -150)  # a low-pass knows one side only at the ends of a log that begins while the arm moves
    left = (run.measured - compute_readings(arm, run, values))[inner][:, at]
    assert np.abs(left).max() < 2e-4 * np.ptp(run.measured[:, at])


def test_a_marker_on_a_beam_sees_it_bend(tmp_path: Path) -> None:
    """Its reading is the tip of the solution; at half the length it is the place of the section there."""
    (tmp_path / "mechanism.toml").write_text(BEAM)
    (tmp_path / "identify.toml").write_text(BENT)
    bending = read_machine(tmp_path)
    time = np.linspace(0.0, 0.6, 151)
    angle = 0.8 * (time / 0.6) ** 3 * (10 - 15 * (time / 0.6) + 6 * (time / 0.6) ** 2)
    run = make_run(bending, Log("made", time, {"q": angle}), efforts=False)
    readings = compute_readings(bending, run, bending.space.compute_values(np.zeros(1)))
    given = Motion.from_samples(run.motion.time, {"hub": run.motion.q[:, 0]})
    solution = solve(bending.mechanism, given, 0.004)
    raw = run.response(bending.space.compute_values(np.zeros(1)))[2]
    assert (
        np.abs(raw[:, 0] - solution.tip["strip"][:, 0]).max() < 1e-9
    )  # the same march: a section more is no other element
    bent = np.abs(solution.deflection["strip"]).max()
    assert bent > 1e-3
    assert np.abs(raw[:, 1] - 0.5 * raw[:, 0]).max() > 0.1 * bent
    assert readings.shape == (151, 2)


def test_a_rate_that_is_measured_takes_the_place_of_the_slope(logged: Path) -> None:
    arm = machine(logged, 'rate = { column = "qd2", unit = "deg/s" }')
    log = read_log(logged / "log.csv")
    ours, plain = make_run(arm, log).motion, make_run(machine(logged, ""), log).motion
    inner = slice(100, -100)
    assert np.abs(ours.qd - plain.qd)[inner].max() < 1e-3 * np.abs(plain.qd).max()  # (w h)^2 / 6 of central differences
    doubled = Log(log.name, log.time, {**log.columns, "qd2": log.columns["qd2"] + 20.0})
    assert np.allclose((make_run(arm, doubled).motion.qd - ours.qd)[inner, 1], np.radians(20.0), atol=1e-6)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('rate = { column = "qd2" }', r"'qd2' of joint elbow is 57\.3 times the slope of its angle.*unit"),
        (POINTS.replace('link = "fore"', 'link = "for"', 1), r'link = "for"\n.*links upper, fore'),
        (POINTS.replace('link = "fore"', 'link = "world"', 1), "a link that moves"),
        (POINTS.replace("xyz_m = [0.3", "station = 0.5\nxyz_m = [0.3"), "fore is not a beam"),
        (POINTS.replace('{ x = "acc_x", z = "acc_z" }', "{ }"), "one of x, y and z or more"),
        (POINTS.replace("acc_z", "acc_y"), "no column 'acc_y'"),
        (POINTS.replace('unit = "g"', 'unit = "m"'), "m/s"),
    ],
)
def test_what_is_wrong_is_one_error(more: str, words: str, logged: Path) -> None:
    with pytest.raises(InputError, match=words):
        make_run(machine(logged, more), read_log(logged / "log.csv"))


BEAM = """title = "strip on a hub"
source = "test"
gravity_m_per_s2 = [0, 0, -9.81]
[sections.strip]
shape = "rectangle"
size_y_m = 0.03
size_z_m = 0.002
E_Pa = 70e9
nu = 0.3
rho_kg_per_m3 = 2700
[links.strip]
kind = "beam"
length_m = 0.4
section = "strip"
elements = 2
[joints.hub]
kind = "revolute"
parent = "world"
child = "strip"
axis = [0, 1, 0]
"""
BENT = """bandwidth_Hz = 20
[joints.hub]
angle = { column = "q" }
[markers.tip]
link = "strip"
station = 1.0
columns = { x = "tip_x" }
[markers.middle]
link = "strip"
station = 0.5
columns = { x = "middle_x" }
[[free]]
parameter = "marker zero"
place = ["tip.x"]
error = 0.01
"""
