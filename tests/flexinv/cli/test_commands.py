"""The command line: what it prints and writes is the solution, and every mistake is answered in one line."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pandas as pd
import pytest

from flexinv.analysis.solve import solve
from flexinv.cli.commands import COMMANDS, app, main
from flexinv.files.csv_dialect import make_exact_options
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.link_mass import compute_link_mass
from flexinv.model.mechanism import Beam, Body, Inertia, Link, Section

MECHANISM = """
title = "Pendulum"
source = "by hand"
gravity_m_per_s2 = [0, -9.81, 0]

[links.arm]
kind = "rigid"
mass_kg = 2.0
rod = { length_m = 0.6 }

[joints.pivot]
kind = "revolute"
parent = "world"
child = "arm"
axis = [0, 0, 1]
limits = { effort_Nm = 40.0, velocity_rad_per_s = 8.0 }
"""
CASES = """
source = "by hand"

[[limits]]
quantity = "torque"
engines = ["*"]
maximum = 1e-12
reason = "one joint: all engines round off"
[cases.swing]
title = "A quarter turn"
step_s = 1e-2
quantities = ["torque"]
[cases.swing.motion]
law = "cycloid"
duration_s = 1.0
joints.pivot = { from_deg = 0, to_deg = 90 }

[cases.hold]
step_s = 1e-2
quantities = ["torque"]
[cases.hold.motion]
duration_s = 1.0
joints.pivot = { at_deg = 0 }
"""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    folder = tmp_path / "pendulum"
    folder.mkdir()
    (folder / "mechanism.toml").write_text(MECHANISM)
    (folder / "cases.toml").write_text(CASES)
    return folder


def complaint(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run, demand exit code 2, nothing on stdout and one line on stderr; return that line."""
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    out, err = capsys.readouterr()
    assert stop.value.code == 2
    assert out == ""
    assert err.endswith("\n")
    assert err.count("\n") == 1
    return err.strip()


def test_solve_writes_what_solve_returns(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "torque.csv", tmp_path / "torque.png"
    main(["solve", str(model), "--case", "swing", "--out", str(out), "--plot", str(plot)])
    mechanism = load_mechanism(model)
    case = load_cases(model, mechanism)["swing"]
    solution = solve(mechanism, case.motion, case.step)
    table = pd.read_csv(out, **make_exact_options())
    np.testing.assert_array_equal(table["time [s]"], solution.time)
    # pandas writes the shortest text that gives the same number back
    np.testing.assert_array_equal(table["torque pivot [N m]"], solution.torque[:, 0])
    # by hand: at 0 rad the arm lies along x, and its weight takes m g l/2
    assert table["torque pivot [N m]"][0] == pytest.approx(2.0 * 9.81 * 0.3, rel=1e-14)
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "torque.png.csv").read_text() == out.read_text()  # the numbers of the picture, at every step
    printed = capsys.readouterr().out
    assert "pendulum, case swing: A quarter turn" in printed
    assert f"{np.abs(solution.torque).max():.5g}" in printed
    assert f"{np.abs(solution.torque).max() / 40.0:.5g}" in printed


@pytest.mark.parametrize("option", ["--out", "--plot"])
def test_a_file_that_is_there_is_replaced_only_when_that_is_said(
    option: str, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / ("mine.csv" if option == "--out" else "mine.svg")
    file.write_text("keep me")
    words = ["solve", str(model), "--case", "swing", option, str(file)]
    with pytest.raises(SystemExit):
        main(words)
    assert "is there already: write another name, or --overwrite to replace it" in capsys.readouterr().err
    assert file.read_text() == "keep me"
    main([*words, "--overwrite"])
    assert file.read_text() != "keep me"


def read_back(out: Path) -> pd.DataFrame:
    if out.suffix == ".json":
        return pd.DataFrame(json.loads(out.read_text()))
    if out.suffix == ".npz":
        with np.load(out) as columns:
            return pd.DataFrame({name: columns[name] for name in columns.files})
    return pd.read_csv(out, **make_exact_options())


@pytest.mark.parametrize("suffix", [".csv", ".json", ".npz"])
def test_out_has_samples_error_bars_tips_and_deflections(root: Path, tmp_path: Path, suffix: str) -> None:
    """Every 0.01 s of steps of 0.0025 s, as the case asks for; the suffix says how it is written."""
    folder = tmp_path / "arm"
    shutil.copytree(root / "models" / "flex_one_link", folder)
    (folder / "cases.toml").write_text(
        'source = "test"\n[cases.turn]\nstep_s = 0.0025\nsample_s = 0.01\nend_s = 0.1\n[cases.turn.motion]\n'
        'law = "cycloid"\nduration_s = 0.1\njoints.hub = { from_deg = 0, to_deg = 30 }\n'
    )
    out = tmp_path / f"torque{suffix}"
    main(["solve", str(folder), "--error", "--out", str(out)])
    table = read_back(out)
    mechanism = load_mechanism(folder)
    case = load_cases(folder, mechanism)["turn"]
    s = solve(case.meshed(mechanism), case.motion, case.step, error=True, end=case.end)
    assert s.torque_error is not None
    assert s.tip_error is not None
    np.testing.assert_allclose(table["time [s]"], 0.01 * np.arange(11), rtol=0, atol=1e-12)
    for name, values in (
        ("torque hub [N m]", s.torque[:, 0]),
        ("error of torque hub [N m]", s.torque_error[:, 0]),
        ("deflection link y [m]", s.deflection["link"][:, 1]),
        ("tip link x [m]", s.tip["link"][:, 0]),
        ("error of tip link [m]", s.tip_error["link"]),
    ):
        np.testing.assert_array_equal(table[name], values[::4])


def test_out_that_cannot_be_written_is_said_before_the_work(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, words in (
        ("torque.xlsx", "expected a name that ends in .csv, .parquet, .json, .npz"),
        ("torque", "expected a name that ends in"),
    ):
        said = complaint(["solve", str(model), "--case", "swing", "--out", str(tmp_path / name)], capsys)
        assert words in said
        said = complaint(["follow", str(model), "--out", str(tmp_path / name)], capsys)
        assert words in said
    if not any(map(importlib.util.find_spec, ("pyarrow", "fastparquet"))):
        said = complaint(["solve", str(model), "--case", "swing", "--out", str(tmp_path / "a.parquet")], capsys)
        assert ".parquet needs pyarrow: write pip install pyarrow" in said


def test_step_and_error_reach_the_solver(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "torque.csv", tmp_path / "torque.svg"
    main(
        [
            "solve",
            str(model / "mechanism.toml"),
            "--case",
            "swing",
            "--step",
            "0.05",
            "--error",
            "--out",
            str(out),
            "--plot",
            str(plot),
        ]
    )
    np.testing.assert_allclose(pd.read_csv(out)["time [s]"], np.linspace(0.0, 1.0, 21), rtol=0, atol=1e-15)
    assert "error of effort" in capsys.readouterr().out
    assert "PolyCollection" in plot.read_text()  # the error band


def test_info_shows_coordinates_masses_and_cases(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["info", str(model)])
    printed = capsys.readouterr().out
    assert printed.startswith(
        "pendulum: Pendulum\ntotal mass 2 kg, gravity (0, -9.81, 0) m/s^2, nq = 1, nv = 1, 0 of 1"
    )
    for word in ("pivot revolute", "arm rigid", "swing", "hold"):
        assert word in printed


def test_info_shows_beams(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["info", str(root / "models" / "flex_one_link")])
    printed = capsys.readouterr().out
    assert "total mass 0.0224 kg" in printed  # the paper's link
    assert "1 x order 4" in printed
    assert "beams are solved in a plane" in printed


def test_info_says_what_stands_out_of_the_plane(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["info", str(root / "models" / "spatial_arm")])
    assert "beams are solved in space: " in capsys.readouterr().out


def test_mass_of_a_tapered_beam_with_a_payload() -> None:
    section = Section(np.array([0.25, 0.75]), np.ones((2, 6)), np.array([1.0, 3.0]), np.ones((2, 3)))
    link = Link("b", (Body("load", Inertia(0.5), 1.0),), Beam(2.0, section))
    # constant 1 kg/m to a quarter, linear to 3 kg/m at three quarters, constant 3 kg/m: 0.5 + 2 + 1.5
    # of 2 m: 0.5 m * 1 + 1 m * 2 + 0.5 m * 3 = 4 kg
    assert compute_link_mass(link) == pytest.approx(4.5, rel=1e-15)


def test_warnings_are_one_line_on_stderr(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (model / "mechanism.toml").write_text(MECHANISM.replace("axis = [0, 0, 1]", "axis = [0, 0, 2]"))
    main(["info", str(model)])
    err = capsys.readouterr().err
    assert err.startswith("flexinv: warning: ")
    assert err.count("\n") == 1


def test_help_teaches(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in ([], ["--help"]):
        main(arguments)
        assert "flexinv solve models/flex_one_link --case" in capsys.readouterr().out
    main(["solve", "--help"])
    assert "--error" in capsys.readouterr().out


BAD = {
    "no such command": (["sove"], "No such command 'sove'"),
    "no such option": (["solve", "MODEL", "--cse", "x"], "No such option"),
    "no model": (["solve"], "Missing argument 'MODEL'"),
    "no such folder": (["info", "MODEL/nowhere"], "nowhere"),
    "no case chosen": (["solve", "MODEL"], "has 2 cases: write --case with one of swing, hold"),
    "no such case": (["solve", "MODEL", "--case", "swign"], "has no such case; write --case swing"),
    "nothing alike": (["solve", "MODEL", "--case", "xyz"], "has no such case; write one of swing, hold"),
    "step is no number": (["solve", "MODEL", "--case", "swing", "--step", "fast"], "'fast' is not a valid float"),
    "step is negative": (["solve", "MODEL", "--case", "swing", "--step", "-1"], "expected a positive number"),
    "step is too long": (["solve", "MODEL", "--case", "swing", "--step", "2"], "longer than the motion"),
    "no such format": (["solve", "MODEL", "--case", "swing", "--plot", "a.gif"], "expected a name that ends in .png"),
    "no such place": (
        ["solve", "MODEL", "--case", "swing", "--out", "MODEL/no/a.csv"],
        "does not exist; make it first",
    ),
    "out is a folder": (["solve", "MODEL", "--case", "swing", "--out", "MODEL"], "is a directory"),
}


@pytest.mark.parametrize("mistake", BAD)
def test_a_mistake_is_answered_in_one_line(mistake: str, model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, expected = BAD[mistake]
    line = complaint([a.replace("MODEL", str(model)) for a in arguments], capsys)
    assert line.startswith("flexinv: ")
    assert expected.replace("MODEL", str(model) if "argument" not in expected else "MODEL") in line


def test_a_broken_file_is_answered_in_one_line(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (model / "mechanism.toml").write_text(MECHANISM.replace("mass_kg", "mas_kg"))
    line = complaint(["solve", str(model), "--case", "swing"], capsys)
    assert "mas_kg" in line
    assert "mass_kg" in line
    (model / "mechanism.toml").write_bytes(b"\xff\xfe")
    assert "mechanism.toml" in complaint(["info", str(model)], capsys)


def test_modes_of_a_hanging_rod(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = model / "mechanism.toml"
    file.write_text(file.read_text().replace("[0, -9.81, 0]", "[9.81, 0, 0]"))
    main(["modes", str(model), "--case", "swing", "--free", "pivot"])
    printed = capsys.readouterr().out.split()
    omega = np.sqrt(1.5 * 9.81 / 0.6)
    mode, frequency, bar, rate, link = printed[-5:]
    assert [mode, frequency, rate, link] == ["1", f"{omega / (2 * np.pi):.6g}", f"{omega:.6g}", "arm"]
    assert float(bar) < 1e-14  # a rigid rod: the rounding of one number
    assert "nothing of 'pendulum' can move" in complaint(["modes", str(model)], capsys)


def test_the_module_is_the_command_line(root: Path) -> None:
    """Where the console script is not on the path."""
    done = subprocess.run(
        [sys.executable, "-m", "flexinv", "--help"], cwd=root, capture_output=True, text=True, check=True
    )
    assert "solve" in done.stdout


def test_parameters_of_an_arm_that_bends_say_what_to_write(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = complaint(["parameters", str(root / "models" / "flex_one_link")], capsys)
    assert "links that bend (link)" in line
    assert 'kind = "rigid"' in line


def test_a_robot_file_is_no_model_to_solve_and_the_answer_says_what_is(
    tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(root / "tests" / "data" / "arm.urdf", tmp_path)
    shutil.copy(root / "tests" / "data" / "arm.xml", tmp_path)
    said = complaint(["solve", str(tmp_path / "arm.urdf")], capsys)
    assert 'a mechanism.toml that has the line urdf = "arm.urdf", and a cases.toml with the motion' in said
    assert "crosscheck compare reads" in complaint(["solve", str(tmp_path / "arm.xml")], capsys)


def test_a_plot_without_matplotlib_is_refused_before_the_work(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is solved, and nothing else that was asked for is written."""
    monkeypatch.setattr("flexinv.display.figures.importlib.util.find_spec", lambda name: None)
    words = [
        "solve",
        str(model),
        "--case",
        "swing",
        "--plot",
        str(tmp_path / "x.png"),
        "--out",
        str(tmp_path / "x.csv"),
    ]
    assert "--plot needs matplotlib: write pip install 'flexinv[plot]'" in complaint(words, capsys)
    assert not (tmp_path / "x.csv").exists()


def test_the_list_of_commands_imports_none_of_them() -> None:
    """Help is there at once: neither arrays nor a compiler are loaded for it."""
    code = "import sys; from flexinv.cli.commands import main; main(['--help']); print({'numpy', 'numba'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("set()\n")
    assert all(name in done.stdout for name in COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_listed_command_is_there(name: str) -> None:
    command = app.get_command(click.Context(app), name)
    assert command is not None
    assert command.name == name
    assert command.help


@pytest.mark.parametrize(
    ("word", "advice"), [("inf", "write flexinv info"), ("zzz", "write one of export-c, export-fmu")]
)
def test_a_command_that_there_is_not_is_told_the_nearest(
    word: str, advice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([word])
    assert advice in capsys.readouterr().err
