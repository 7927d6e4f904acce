"""Many mechanisms from one folder of URDFs: names of their own, nothing overwritten, and a run over all of them."""

from __future__ import annotations

import json
import os
import random
from collections.abc import Sequence
from pathlib import Path

import pytest
from arm_texts import ARM
from click.testing import CliRunner, Result

from crosscheck.cli import main
from crosscheck.workflows import zoo
from crosscheck.workflows.scaffold import NAME
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism

OTHER = ARM.replace('value="3.25"', 'value="3.5"')


def make_robots(folder: Path) -> Path:
    """Write four URDFs, two of one name, and one that is none."""
    for name, text in (
        ("acme/arm.urdf", ARM),
        ("other/urdf/arm.urdf", OTHER),
        ("other/urdf/two arms (v2).URDF", ARM),
        ("other/broken.urdf", "<robot name='x'>"),
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    (folder / "acme" / "arm.xacro").write_text("<robot/>")
    return folder


def new(folder: Path, models: Path, *more: str) -> Result:
    return CliRunner().invoke(main, ["new", "--from-urdf", str(folder), "--models", str(models), *more])


def test_every_urdf_below_a_folder_becomes_a_mechanism_with_a_case(tmp_path: Path) -> None:
    robots = make_robots(tmp_path / "robots")
    result = new(robots, tmp_path / "models")
    assert result.exit_code == 1, result.output
    lines = result.output.splitlines()
    assert [line for line in lines if line.startswith("other/broken.urdf: ")], lines
    assert "3 of 4 written, 1 cannot be used" in lines
    names = sorted(folder.name for folder in (tmp_path / "models").iterdir())
    assert names == ["acme_arm", "two_arms_v2", "urdf_arm"]
    for name in names:
        assert [joint.name for joint in load_mechanism(tmp_path / "models" / name).joints if joint.nv]
    masses = {name: load_mechanism(tmp_path / "models" / name).links[1].bodies[0].inertia.mass for name in names}
    assert masses["urdf_arm"] - masses["acme_arm"] == pytest.approx(
        0.25, rel=1e-12
    )  # rounding; 3.5 and 3.25 kg as written


def test_all_that_are_read_is_exit_code_0_and_none_is_2(tmp_path: Path) -> None:
    robots = make_robots(tmp_path / "robots")
    (robots / "other" / "broken.urdf").unlink()
    assert new(robots, tmp_path / "models").exit_code == 0
    (tmp_path / "none").mkdir()
    empty = new(tmp_path / "none", tmp_path / "models")
    assert empty.exit_code == 2
    assert "no file *.urdf is below it" in empty.output
    (tmp_path / "none" / "a.urdf").write_text("")
    assert new(tmp_path / "none", tmp_path / "models").exit_code == 2


def test_what_stands_already_is_not_written_over_without_asking(tmp_path: Path) -> None:
    robots = make_robots(tmp_path / "robots")
    models = tmp_path / "models"
    new(robots, models)
    case = models / "acme_arm" / "cases.toml"
    case.write_text(case.read_text() + "# mine\n")
    again = new(robots, models)  # the same robots: nothing to do
    assert "0 of 4 written, 3 there already, 1 cannot be used" in again.output
    assert case.read_text().endswith("# mine\n")
    (robots / "acme" / "arm.urdf").write_text(OTHER)
    kept = new(robots, models)
    assert kept.exit_code == 1
    assert "acme/arm.urdf: " in kept.output
    assert "1 kept as they were (--replace writes them anew)" in kept.output
    assert case.read_text().endswith("# mine\n")
    assert "1 of 4 written, 2 there already" in new(robots, models, "--replace").output
    assert (models / "acme_arm" / "robot.urdf").read_text() == OTHER
    assert not case.read_text().endswith("# mine\n")
    assert "3 kept as they were" in new(robots, models, "--free-base").output  # they stand on a fixed base


def test_the_question_is_asked_once_before_anything_is_written(tmp_path: Path) -> None:
    robots = make_robots(tmp_path / "robots")
    models = tmp_path / "models"
    for name in ("acme_arm", "two_arms_v2"):
        (models / name).mkdir(parents=True)
    asked: list[Sequence[str]] = []

    def refuse(names: Sequence[str]) -> bool:
        assert not (models / "urdf_arm").exists()
        asked.append(names)
        return False

    found = zoo.write_from_folder(robots, models, ask=refuse)
    assert asked == [["acme_arm", "two_arms_v2"]]
    assert [robot.kind for robot in found] == ["kept", "unread", "written", "kept"]
    assert not any((models / "acme_arm").iterdir())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
def test_a_pipe_that_never_ends_keeps_no_other_back(tmp_path: Path) -> None:
    robots = make_robots(tmp_path / "robots")
    os.mkfifo(robots / "acme" / "endless.urdf")
    result = new(robots, tmp_path / "models")
    assert "acme/endless.urdf: " in result.output
    assert "3 of 5 written, 2 cannot be used" in result.output


def test_a_file_that_cannot_be_read_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "a.urdf").write_text(ARM.replace('value="3.25"', 'value="three"'))
    (robot,) = zoo.write_from_folder(tmp_path / "robots", tmp_path / "models")
    assert robot.kind == "unread"
    assert "robot.urdf" not in robot.words  # the file, no copy of it
    assert not (tmp_path / "models" / "a").exists()


def test_a_robot_that_cannot_move_is_told_so(tmp_path: Path) -> None:
    """A drone on a fixed base: `crosscheck run` would have nothing to do, and say so of every night."""
    body = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "drone.urdf").write_text(f'<robot name="d"><link name="b">{body}</link></robot>')
    (robot,) = zoo.write_from_folder(tmp_path / "robots", tmp_path / "models")
    assert robot.kind == "unread"
    assert "no joint that moves, on a fixed base" in robot.words
    (robot,) = zoo.write_from_folder(tmp_path / "robots", tmp_path / "models", base="free")
    assert robot.kind == "written"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "Missing argument 'NAME'"),
        (("arm", "--from-urdf", "."), "leave out 'arm'"),
        (("arm", "--replace"), "--replace is for --from-urdf FOLDER"),
    ],
)
def test_what_does_not_go_together_is_refused(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["new", *arguments, "--models", str(tmp_path / "models")])
    assert result.exit_code == 2
    assert words in " ".join(result.output.split())


LETTERS = "aA_-. (é\N{CJK UNIFIED IDEOGRAPH-5B57}1"


@pytest.mark.parametrize("seed", range(100))
def test_names_are_valid_and_no_two_are_equal(seed: int) -> None:
    """Few letters, so that names meet; some of them longer than a name may be."""
    drawn = random.Random(seed)
    paths = set()
    for _ in range(drawn.randint(1, 15)):
        parts = ["".join(drawn.choices(LETTERS, k=drawn.choice((1, 2, 70)))) for _ in range(drawn.randint(1, 3))]
        paths.add("/".join(part if part.strip(".") else "a" for part in parts) + ".urdf")
    names = zoo.choose_names(sorted(paths))
    assert list(names) == sorted(paths)
    assert all(NAME.fullmatch(name) for name in names.values())
    assert len({name.lower() for name in names.values()}) == len(paths)


def test_names_say_where_robots_of_one_name_are_from() -> None:
    files = ("a/x/arm.urdf", "b/x/arm.urdf", "leg.urdf", "Leg.urdf", "ÄÖ.urdf")
    assert list(zoo.choose_names(files).values()) == ["a_x_arm", "b_x_arm", "leg", "Leg_2", "robot"]


def test_no_urdf_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file"):
        zoo.list_urdfs(tmp_path)


def test_a_run_over_all_of_them(tmp_path: Path) -> None:
    """Two engines agree on every robot of the folder, without a word of ours in its files."""
    pytest.importorskip("pinocchio", reason="pinocchio is not installed")
    robots = make_robots(tmp_path / "robots")
    new(robots, tmp_path / "models")
    words = [
        "run",
        "--models",
        str(tmp_path / "models"),
        "--engines",
        "flexinv,pinocchio",
        "--out",
        str(tmp_path / "out"),
    ]
    result = CliRunner().invoke(main, [*words, "--jobs", "1"])
    assert result.exit_code == 0, result.output
    rows = json.loads((tmp_path / "out" / "results.json").read_text())["cases"]
    assert len(rows) == 3
