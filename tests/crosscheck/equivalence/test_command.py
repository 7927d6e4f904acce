"""The command: exit codes, page, JUnit, Markdown, the table of readers; a seeded sample of the campaign of planted faults."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from arm_texts import arm
from click.testing import CliRunner
from description_campaign import campaign
from sibling_campaign import PAIRS, folders, outcomes

from crosscheck.cli import main

HEAVIER = ('value="2.375"', 'value="2.625"')


def test_exit_codes_and_files(tmp_path: Path) -> None:
    a, b = str(arm(tmp_path)), str(arm(tmp_path, HEAVIER, name="b.urdf"))
    assert CliRunner().invoke(main, ["compare", a, a]).exit_code == 0
    run = CliRunner().invoke(main, ["compare", a, b, "--out", str(tmp_path / "out")])
    assert run.exit_code == 1
    assert "mass" in run.output
    page = (tmp_path / "out" / "index.html").read_text()
    assert "mass value=&#34;2.625&#34;" in page  # what to write, escaped
    assert json.loads((tmp_path / "out" / "results.json").read_text())["equal"] is False
    assert b"<failure" in (tmp_path / "out" / "junit.xml").read_bytes()
    assert "| rigid bodies: mass | link lower | 2.375 | 2.625 |" in (tmp_path / "out" / "summary.md").read_text()
    assert CliRunner().invoke(main, ["compare", a, str(tmp_path / "none.urdf")]).exit_code == 2
    assert CliRunner().invoke(main, ["compare", a]).exit_code == 2
    assert CliRunner().invoke(main, ["compare", a, b, "--judge", "drive"]).exit_code == 0


def test_names_are_no_markup(tmp_path: Path) -> None:
    odd = '"low&lt;b&gt;er"'
    edits = [('link name="lower"', f"link name={odd}"), ('child link="lower"', f"child link={odd}")]
    edits += [('parent link="lower"', f"parent link={odd}")]
    a, b = str(arm(tmp_path, *edits)), str(arm(tmp_path, *edits, HEAVIER, name="b.urdf"))
    CliRunner().invoke(main, ["compare", a, b, "--out", str(tmp_path / "out")])
    for name in ("index.html", "summary.md"):
        assert "<b>er" not in (tmp_path / "out" / name).read_text()


def test_readers_are_compared_with_ours(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    pytest.importorskip("mujoco")
    run = CliRunner().invoke(main, ["compare", str(arm(tmp_path)), "--readers", "pinocchio,mujoco", "--json"])
    rows = {row["reader"]: row for row in json.loads(run.output)}
    assert run.exit_code == 1
    assert (rows["flexinv"]["result"], rows["pinocchio"]["result"]) == ("equal", "different")
    assert "coupling" in rows["pinocchio"]["words"]  # its parser leaves the mimic joint independent


def test_the_table_of_readers_is_written_in_every_form(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    file, out = str(arm(tmp_path, ('<mimic joint="grip"/>', ""))), tmp_path / "out"
    run = CliRunner().invoke(main, ["compare", file, "--readers", "mujoco", "--out", str(out)])
    assert run.exit_code == 0
    assert "mujoco: the same machine" in run.output
    assert "mujoco" in (out / "index.html").read_text()
    assert [row["result"] for row in json.loads((out / "results.json").read_text())["readers"]] == ["equal", "equal"]
    assert b'tests="2" failures="0" errors="0"' in (out / "junit.xml").read_bytes()
    table = (out / "summary.md").read_text()
    assert "| mujoco | 4 |" in table
    said = CliRunner().invoke(main, ["compare", file, "--readers", "mujoco", "--markdown"]).output
    assert said == table
    refused = CliRunner().invoke(main, ["compare", file, "--readers", "mujoco,gazebo", "--out", str(out)])
    assert refused.exit_code == 2
    assert b'errors="1"' in (out / "junit.xml").read_bytes()


def test_readers_take_one_file_that_engines_read(tmp_path: Path) -> None:
    file = str(arm(tmp_path))
    (tmp_path / "mechanism.toml").write_text('source = "us"')
    for words in (
        [file, file, "--readers", "all"],
        [file, "--readers", ","],
        [str(tmp_path / "mechanism.toml"), "--readers", "all"],
        [file, "--readers", "all", "--judge", "everything"],
        [file, "--readers", "all", "--match", "a=b"],
    ):
        run = CliRunner().invoke(main, ["compare", *words])
        assert run.exit_code == 2
        assert "Error: " in run.output
        assert "Traceback" not in run.output


@pytest.mark.slow
def test_planted_faults_are_named_first(tmp_path: Path) -> None:
    """Eight of the campaign's faults, `python tests/shared/description_campaign.py`: all named, nothing else."""
    pytest.importorskip("pinocchio")
    trials = list(campaign(8, seed=3))
    assert [t.words for t in trials if not t.good] == []
    assert [t.others for t in trials if t.others] == []


def test_siblings_are_equal_or_repaired() -> None:
    """Three pairs of the campaign, `python tests/shared/sibling_campaign.py`; a pair that is not there is said to be absent."""
    pytest.importorskip("pinocchio")  # whose wheels bring the robots
    chosen = [pair for pair in PAIRS if "panda_collision" in pair.b or "joint_limited" in pair.b or "b1-z1" in pair.b]
    result = list(outcomes(chosen, folders([])))
    assert [one.words for one in result if not one.good] == []
    assert {one.words for one in result} == {"equal", "different"}
    lost = next(outcomes([pair for pair in PAIRS if "robosuite" in pair.b], {"data": folders([])["data"]}))
    assert lost.absent
    assert "not on this machine" in lost.words
    assert not lost.good
