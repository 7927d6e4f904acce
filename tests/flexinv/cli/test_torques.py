"""``flexinv torques``: what it writes is what Python gives, and mistakes are answered in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import flexinv
from flexinv.cli.commands import main
from flexinv.files.csv_dialect import make_exact_options


@pytest.fixture
def robot(root: Path) -> Path:
    return root / "models" / "rigid_3r"


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    file = tmp_path / "motion.csv"
    rows = (f"{k / 100:.2f};{np.sin(k / 30):.12f};{10 * np.cos(k / 40):.12f};{k / 100:.12f}" for k in range(120))
    file.write_text("\n".join(["time_s;joint3;joint1 [deg];joint2", *rows]).replace(".", ","))
    return file


def test_the_command_writes_what_the_call_gives(
    robot: Path, motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "torques.csv"
    words = ["--payload", "link3=2.5@0.1,0,0", "--gravity", "0,-9.81,0", "--friction", "joint1=0.5,0.25"]
    main(["torques", str(robot), str(motion), "--out", str(out), *words])
    load = {"link3": flexinv.Inertia(2.5, np.array([0.1, 0.0, 0.0]))}
    expected = flexinv.torques(robot, motion, payload=load, gravity=[0.0, -9.81, 0.0], friction={"joint1": (0.5, 0.25)})
    pd.testing.assert_frame_equal(pd.read_csv(out, index_col=0, **make_exact_options()), expected, check_exact=True)
    said = capsys.readouterr().out
    assert "120 rows, rates and accelerations by a quintic spline" in said
    assert f"wrote {out}" in said
    for label in expected:
        assert label in said
    assert f"{np.abs(expected.iloc[:, 0]).max():.5g}" in said


def test_holding_and_spacing_stand_for_columns(robot: Path, tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    angle = np.sin(np.arange(60) / 20)
    pd.DataFrame({"q_joint1": angle, "q_joint2": angle}).to_csv(file, index=False)
    out = tmp_path / "out.csv"
    words = ["torques", str(robot), str(file), "--out", str(out), "--hold", "joint3=0.5", "--spacing", "0.01"]
    main([*words, "--no-friction"])
    expected = flexinv.torques(robot, file, hold={"joint3": 0.5}, spacing=0.01, friction=False)
    pd.testing.assert_frame_equal(pd.read_csv(out, index_col=0, **make_exact_options()), expected, check_exact=True)
    with pytest.raises(SystemExit):
        main(words)
    main([*words, "--overwrite"])


WRONG = {
    "--payload link3=heavy": "--payload link3=heavy: expected a link and a mass in kg",
    "--payload link3=1@0,0": "--payload link3=1@0,0: expected",
    "--payload hand=1": "payload: link = 'hand': expected one that rigid_3r has: link1, link2, link3",
    "--gravity down": "--gravity down: expected three numbers",
    "--gravity 0,9": "gravity",
    "--no-friction --friction joint1=1,1": "write one of the two",
    "--friction joint1=1": "friction: joint 'joint1'",
    "--hold joint9=1": "hold: joint 'joint9' is none that moves",
    "--spacing 0.1": "beside the column 'time_s'",
    "--rows 10": "1000 or more",
}


@pytest.mark.parametrize("words", WRONG)
def test_a_mistake_is_one_line_and_no_file(
    words: str, robot: Path, motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "torques.csv"
    with pytest.raises(SystemExit) as stop:
        main(["torques", str(robot), str(motion), "--out", str(out), *words.split()])
    told = capsys.readouterr()
    assert stop.value.code == 2
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert WRONG[words] in told.err
    assert sorted(tmp_path.iterdir()) == [motion]


@pytest.mark.parametrize("out", ["torques.txt", "none/torques.csv", "motion.csv"])
def test_a_place_that_cannot_be_written_to_is_refused(
    out: str, robot: Path, motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = motion.read_bytes()
    with pytest.raises(SystemExit):
        main(["torques", str(robot), str(motion), "--out", str(tmp_path / out), "--overwrite"])
    assert str(tmp_path / out) in capsys.readouterr().err
    assert motion.read_bytes() == before
