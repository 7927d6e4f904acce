"""Tables [optima.NAME]: what they state, the motions of models/ that were found from them, and words of refusal."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner

import flexinv
from flexinv.cli.commands import app
from flexinv.errors import InputError
from flexinv.files.case_schema import read_cases
from flexinv.optimal_motion.motion_limits import StrainLimit
from flexinv.optimal_motion.optimum_file import read_optima, write_rows

CHECKED = 2e-3  # of a limit, by which a search may let its finer march pass it
OTHER_MESH = 0.01  # of a torque: what the mesh of the replay adds, and its finer step
OTHER_MODES = 0.5  # of a hundredth of the vibration: frequencies differ by the mesh
FOUND = [
    (folder, name)
    for folder in ("flex_one_link", "flex_two_link", "spatial_arm", "four_bar_flexible", "quanser_2dsfl")
    for name in ("shortest",)
]


def _load(root, folder):
    path = root / "models" / folder
    mechanism = flexinv.load_mechanism(path)
    return mechanism, flexinv.load_cases(path, mechanism), read_optima(path, mechanism)


@pytest.mark.parametrize(("folder", "name"), FOUND)
def test_motions_of_models_keep_what_their_table_states(root, folder, name):
    """A sampled case of its name is the motion that was found: shorter, with the same torques and a hundredth of the ringing."""
    mechanism, cases, optima = _load(root, folder)
    task = optima[name]
    assert task.aim == "duration"
    found = cases[name].motion
    given = task.case.motion
    moved = max(track.delay + track.move for track in given.tracks)
    assert found.duration < 0.85 * moved
    sides = []
    for motion, case, last in ((given, task.case, moved), (found, cases[name], found.duration)):
        count = round(last / case.step)
        step = last / count
        end = last + 2 * step
        meshed = case.meshed(mechanism)
        sides.append(flexinv.solve(meshed, motion, step=step, end=end, initial="static", start=case.start))
    before, after = sides
    driven = mechanism.actuated
    assert np.allclose(after.q[-1, driven], before.q[-1, driven], atol=1e-9)  # between the same ends
    used = np.abs(after.torque).max(axis=0) / np.abs(before.torque).max(axis=0)
    assert used.max() <= 1.0 + CHECKED + OTHER_MESH
    left, was = (max(one.find_residual_vibration().reach.values()) for one in (after, before))
    way = max(np.linalg.norm(tip[-1] - tip[0]) for tip in before.tip.values())
    assert left <= (1.0 + OTHER_MODES) * max(0.01 * was, 1e-4 * way)


def test_there_is_no_other_table_in_models(root):
    tables = {
        (path.parent.name, name)
        for path in sorted((root / "models").glob("*/cases.toml"))
        for name in read_cases(path)[1].optima
    }
    assert tables == set(FOUND)


def _copy_model(root, tmp_path, table):
    folder = tmp_path / "flex_one_link"
    shutil.copytree(root / "models" / "flex_one_link", folder)
    cases = folder / "cases.toml"
    cases.write_text(cases.read_text() + table)
    return folder


def test_a_table_states_aim_limits_and_search(root, tmp_path):
    folder = _copy_model(
        root,
        tmp_path,
        """
[optima.careful]
title = "quick, and easy on the drive"
case = "quintic"
aim = { duration = 1, "rms torque" = 0.2 }
knots = 6
step_s = 2e-3
limits.torque = { hub = 2.0 }
limits.moment = { hub = 1.5 }
limits.strain = { link = { largest = 1e-3, y_m = 5e-4, z_m = 0.0 } }
limits.path_m = { link = 0.02 }
limits.residual_m = 1e-4
""",
    )
    task = read_optima(folder, flexinv.load_mechanism(folder))["careful"]
    assert (task.case.name, task.knots, task.step) == ("quintic", 6, 2e-3)
    assert task.aim == {"duration": 1, "rms torque": 0.2}
    assert task.limits.torque == {"hub": 2.0}
    assert task.limits.moment == {"hub": 1.5}
    assert task.limits.strain == {"link": StrainLimit(1e-3, 5e-4, 0.0)}
    assert task.limits.path == {"link": 0.02}
    assert task.limits.residual == 1e-4


def test_the_table_that_is_shown_is_read(root, tmp_path):
    text = (root / "models" / "README.md").read_text()
    (table,) = re.findall(r"```TOML\n(\[optima\..*?)```", text, re.S)
    folder = tmp_path / "flex_two_link"
    shutil.copytree(root / "models" / "flex_two_link", folder)
    cases = folder / "cases.toml"
    cases.write_text(cases.read_text() + "\n" + table)
    task = read_optima(folder, flexinv.load_mechanism(folder))["quick"]
    assert task.limits.path == {"link2": 0.01}
    assert task.limits.strain == {"link1": StrainLimit(2e-4, 0.0005, 0.005)}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('case = "quintik"', 'case = "quintik".*a case of this file.*case = "quintic"'),
        (
            'case = "quintic"\nlimits.rate = { hubb = 1.0 }',
            "optima.bad.limits.: limits: rate of joint 'hubb'.*write 'hub'",
        ),
        ('case = "quintic"\nlimits.residual_m = -1.0', "residual_m"),
        ('case = "quintic"\nknots = 0', "knots"),
        ('case = "quintic"\naim = "speed"', "optima.bad., key aim: aim: 'speed': expected one of 'duration'"),
        ('case = "quintic"\nspeed = 1', "speed"),
    ],
)
def test_tables_that_cannot_be_are_refused(root, tmp_path, table, words):
    folder = _copy_model(root, tmp_path, f"\n[optima.bad]\n{table}\n")
    with pytest.raises(InputError, match=f"(?s){words}"):
        read_optima(folder, flexinv.load_mechanism(folder))


def test_rows_are_read_as_they_were_written(root, tmp_path):
    mechanism = flexinv.load_mechanism(root / "models" / "flex_two_link")
    time = np.linspace(0.0, 0.3, 7)
    joints = {"joint1": np.sin(time), "joint2": np.cos(3.0 * time)}
    motion = flexinv.Motion.from_samples(time, joints, rest=True)
    path = tmp_path / "rows.csv"
    write_rows(motion, mechanism, path)
    assert path.read_text().splitlines()[0] == "time_s,joint1_rad,joint2_rad"
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert np.array_equal(table, np.column_stack([time, *joints.values()]))


def test_the_command_reads_a_table_and_writes_its_rows(root, tmp_path):
    folder = _copy_model(root, tmp_path, '\n[optima.soft]\ncase = "quintic"\naim = "peak torque"\nknots = 4\n')
    rows = tmp_path / "soft.csv"
    done = CliRunner().invoke(app, ["optimize-motion", str(folder), "--optimum", "soft", "--rows", str(rows)])
    assert done.exit_code == 0, done.output
    assert "flex_one_link, quintic: 0.2 s -> 0.2 s" in done.output
    assert len(rows.read_text().splitlines()) == 7  # names, four rows and both ends
    done = CliRunner().invoke(app, ["optimize-motion", str(folder), "--optimum", "soft", "--knots", "5"])
    assert "its table states the problem; leave out --knots" in str(done.output) + str(done.exception)
    done = CliRunner().invoke(app, ["optimize-motion", str(folder), "--optimum", "hard"])
    assert "--optimum hard" in str(done.output) + str(done.exception)
