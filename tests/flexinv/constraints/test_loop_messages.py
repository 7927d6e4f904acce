"""Loops that cannot move as asked: files and command line answer in one line that says when, why and what to write."""

from __future__ import annotations

import ast
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from loop_examples import at, rod

import flexinv
from flexinv.analysis.overview import describe_mobility
from flexinv.cli.commands import main
from flexinv.errors import OpenLoops
from flexinv.files.load_cases import load_cases
from flexinv.model.mechanism import WORLD, Attachment, Closure, Joint


@pytest.fixture
def model(root: Path, tmp_path: Path) -> Path:
    """The four-bar of the models, to be changed."""
    return Path(shutil.copytree(root / "models" / "four_bar", tmp_path / "four_bar"))


def edit(model: Path, file: str, *edits: tuple[str, str]) -> None:
    text = (model / file).read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text, "the edit is of a text that is not there"
        text = text.replace(old, new)
    (model / file).write_text(text, encoding="utf-8")


def parallelogram(model: Path) -> None:
    """Crank and rocker of 0.2, coupler and base of 0.45: flat at 0 and 180 degrees, where two branches meet."""
    lengths = (("length_m = 0.5", "length_m = 0.45"), ("length_m = 0.4,", "length_m = 0.2,"))
    ends = (("xyz_m = [0.5, 0, 0]", "xyz_m = [0.45, 0, 0]"), ("xyz_m = [0.4, 0, 0]", "xyz_m = [0.2, 0, 0]"))
    edit(model, "mechanism.toml", *lengths, *ends)


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What the command line says on its way out: one line, exit code 2, nothing printed as a result."""
    with pytest.raises(SystemExit) as caught:
        main(list(arguments))
    out, err = capsys.readouterr()
    assert caught.value.code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("flexinv: mechanism 'four_bar', t = ")
    return err


MOVE = "joints.A = { from_deg = 20, to_deg = 380 }"
GUESS = ("start.B = { deg = 46 }\nstart.D = { deg = 103 }", "start.B = { deg = -60 }\nstart.D = { deg = 60 }")


def test_a_dead_point_is_named(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parallelogram(model)
    edit(model, "cases.toml", (MOVE, "joints.A = { from_deg = 60, to_deg = -60 }"), GUESS)
    said = complaint(capsys, "solve", str(model), "--case", "turn")
    assert "t = 0." in said
    assert "singular configuration" in said or "the branch of the closures cannot be followed" in said
    assert "condition number" in said
    assert "drive another joint" in said


def test_a_position_out_of_reach_is_named(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With a longer crank the linkage only rocks: it cannot turn."""
    edit(model, "mechanism.toml", ("length_m = 0.2,", "length_m = 0.4,"), ("[0.2, 0, 0]", "[0.4, 0, 0]"))
    edit(model, "cases.toml", ("start.D = { deg = 103 }", "start.D = { deg = 80 }"))
    said = complaint(capsys, "solve", str(model), "--case", "turn")
    assert "a dead point, or the motion asks for a position that the loops cannot reach" in said


def test_a_motion_of_too_many_joints_is_named(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Crank and coupler held where they are: consistent, and still one coordinate too many."""
    mechanism = flexinv.load_mechanism(model)
    case = load_cases(model, mechanism)["turn"]
    result = flexinv.solve(mechanism, case.motion, step=0.5, start=case.start).q[0]
    both = f"joints.A = {{ at_deg = 20 }}\njoints.D = {{ at_rad = {result[2]:.17g} }}"
    edit(model, "cases.toml", (MOVE, both), ("start.D = { deg = 103 }\n", ""), ("start.D = { deg = -103 }\n", ""))
    said = complaint(capsys, "solve", str(model), "--case", "turn")
    assert "the motion gives 2 of the coordinates, more than the mobility of 1" in said
    assert "give a motion to exactly 1 of A, B, D" in said


def test_a_motion_of_too_few_joints_is_named(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = Path(shutil.copytree(root / "models" / "five_bar", tmp_path / "four_bar"))
    right = "joints.right = { from_deg = 60, to_deg = 20, duration_s = 0.6, delay_s = 0.1 }\n"
    head = "start.right_elbow = { deg = 85 }\n\n[cases.reach.motion]"
    edit(model, "cases.toml", (right, ""), (head, f"start.right = {{ deg = 60 }}\n{head}"))
    said = complaint(capsys, "solve", str(model), "--case", "reach")
    assert "the motion gives 1 of the coordinates, fewer than the mobility of 2" in said
    assert "give a motion to exactly 2 of left, left_elbow, right, right_elbow" in said


def test_a_loop_that_stays_open_is_named(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(model, "mechanism.toml", ("xyz_m = [0.45, 0, 0]", "xyz_m = [1.5, 0, 0]"))
    for command in (["solve", str(model), "--case", "turn"], ["info", str(model)]):
        with pytest.raises(SystemExit):
            main(command)
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "t = 0 s: the loops do not close from this start (closure 'C' is open by" in said
        # links of 0.2, 0.5 and 0.4 m in a row reach 1.1 m of the 1.5
        assert "no guess of 21 closes them, with all joints free: at best closure 'C' is open by 0.4 m" in said
        assert "change lengths or placements of links by that much" in said


def test_a_start_that_another_guess_would_close_is_told_one(model: Path) -> None:
    """All links in a row: from there Newton knows no side to bend to; the guess that is said closes the loops."""
    mechanism, motion = flexinv.load_mechanism(model), flexinv.Motion.point_to_point({"A": 0.0}, {"A": 0.5}, 1.0)
    with pytest.raises(OpenLoops, match="give a guess of these joints from which they close: start = ") as caught:
        flexinv.solve(mechanism, motion, step=0.5)
    flexinv.solve(mechanism, motion, step=0.5, start=ast.literal_eval(caught.value.example))


def test_a_motion_that_begins_where_loops_cannot_close_is_told_where_they_do(model: Path) -> None:
    """A crank of 0.4 m does not come round: at half a turn coupler and rocker are too short, at other places not."""
    edit(model, "mechanism.toml", ("length_m = 0.2,", "length_m = 0.6,"), ("[0.2, 0, 0]", "[0.6, 0, 0]"))
    mechanism = flexinv.load_mechanism(model)
    motion = flexinv.Motion.point_to_point({"A": np.pi}, {"A": 3.0}, 1.0)
    with pytest.raises(
        OpenLoops, match="where the motion puts A none of 21 guesses closes them; they close for"
    ) as caught:
        flexinv.solve(mechanism, motion, step=0.5, start={"B": 0.8, "D": 1.8})
    place = re.search(r"\{'A': (\S+)\}", str(caught.value))
    assert place is not None
    there = float(place[1])
    crank = 0.6 * np.exp(1j * there)
    assert abs(crank - 0.45) < 0.5 + 0.4


@pytest.mark.parametrize("more", [[], ["--rate", "A=3"]])
def test_modes_of_a_loop_that_is_open_at_zero_name_the_cases(
    root: Path, capsys: pytest.CaptureFixture[str], more: list[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["modes", str(root / "models" / "four_bar_flexible"), *more])
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "write --case with one of turn, fast, shortest (they close near {'A'" in said
    assert "start =" not in said


def test_the_package_names_its_own_argument(root: Path) -> None:
    mechanism = flexinv.load_mechanism(root / "models" / "four_bar_flexible")
    for call in (flexinv.natural_modes, flexinv.statics):
        with pytest.raises(OpenLoops, match="give q, a configuration near one in which they close"):
            call(mechanism)


def test_a_loop_that_closes_only_by_bending_says_so(root: Path, tmp_path: Path) -> None:
    """The coupler is 0.4 m too short: no guess helps where links begin unbent."""
    model = Path(shutil.copytree(root / "models" / "four_bar_flexible", tmp_path / "four_bar"))
    edit(model, "mechanism.toml", ("xyz_m = [0.45, 0, 0]", "xyz_m = [1.5, 0, 0]"))
    mechanism = flexinv.load_mechanism(model)
    motion = flexinv.Motion.point_to_point({"A": 0.0}, {"A": 0.5}, 1.0)
    for call in (lambda: flexinv.solve(mechanism, motion, step=0.1), lambda: flexinv.natural_modes(mechanism)):
        with pytest.raises(
            OpenLoops, match="unless links bend; a march begins with links unbent: at best closure 'C' is"
        ):
            call()


def test_a_start_of_two_branches_is_named(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The coupler as if above and the rocker as if below: one of them turns out to be on the other branch."""
    edit(model, "cases.toml", ("start.D = { deg = 103 }", "start.D = { deg = -100 }"))
    said = complaint(capsys, "solve", str(model), "--case", "turn")
    assert "t = 0 s: the loops close on another branch: joint '" in said
    assert "deg from its start of" in said
    assert "give starts of the passive joints that belong together" in said


@pytest.mark.parametrize(("case", "side"), [("turn", 1), ("crossed", -1)])
def test_each_start_picks_its_branch(root: Path, case: str, side: int) -> None:
    mechanism = flexinv.load_mechanism(root / "models" / "four_bar")
    chosen = load_cases(root / "models" / "four_bar", mechanism)[case]
    s = flexinv.solve(mechanism, chosen.motion, step=0.02, start=chosen.start)
    assert np.all(side * s.tip["rocker"][:, 1] > 0)


def test_drives_that_do_not_suffice_are_named(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(model, "mechanism.toml", ('child = "crank"\n', 'child = "crank"\nactuated = false\n'))
    with pytest.raises(SystemExit):
        main(["solve", str(model), "--case", "turn"])
    said = capsys.readouterr().err
    assert "the actuated joints cannot give this motion" in said
    assert "actuated = true" in said


INFO = {
    "four_bar": "1 freedom = 3 joint coordinates - 2 independent constraints; 5 constraints, 3 redundant; 1 drive",
    "five_bar_redundant": "2 freedoms = 4 joint coordinates - 2 independent constraints; 5 constraints, 3 redundant; "
    "3 drives (redundant by 1)",
    "bricard": "1 freedom = 5 joint coordinates - 4 independent constraints; 5 constraints, 1 redundant; 1 drive",
    "stewart_platform": "6 freedoms = 24 joint coordinates - 18 independent constraints; 18 constraints, 0 redundant; "
    "6 drives",
}


@pytest.mark.parametrize("name", INFO)
def test_info_counts_freedoms(root: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["info", str(root / "models" / name)])
    out = capsys.readouterr().out
    assert f"mobility: {INFO[name]}\n" in out
    assert "closures\n" in out


def test_info_of_a_tree_has_no_mobility(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["info", str(root / "models" / "rigid_3r")])
    assert "mobility" not in capsys.readouterr().out


def parallelograms(loops: int) -> flexinv.Mechanism:
    """Rods of one metre on pivots a metre apart, tied by couplers of a metre; with all joints at zero they lie flat."""
    links, joints, closures = [rod("rod 0", 1.0, 1.0)], [Joint("A0", "revolute", WORLD, "rod 0")], []
    for k in range(loops):
        links += [rod(f"coupler {k}", 1.0, 1.0), rod(f"rod {k + 1}", 1.0, 1.0)]
        joints.append(Joint(f"B{k}", "revolute", f"rod {k}", f"coupler {k}", at(1.0), actuated=False))
        joints.append(Joint(f"A{k + 1}", "revolute", WORLD, f"rod {k + 1}", at(k + 1.0), actuated=False))
        ends = Attachment(f"coupler {k}", at(1.0)), Attachment(f"rod {k + 1}", at(1.0))
        closures.append(Closure(f"C{k}", "revolute", *ends))
    return flexinv.Mechanism("parallelograms", tuple(links), tuple(joints), closures=tuple(closures))


@pytest.mark.parametrize(("loops", "flat"), [(1, 2), (2, 3)])
def test_info_counts_freedoms_where_mechanisms_move(loops: int, flat: int) -> None:
    """Flat they could go to either side, and seem to have a freedom more for every loop."""
    mobility = describe_mobility(parallelograms(loops), None)
    assert mobility.startswith("mobility: 1 freedom = ")
    assert mobility.endswith(f"; singular near its zero: {flat} freedoms there")


@pytest.mark.parametrize("name", INFO)
def test_info_without_a_case_counts_the_same(root: Path, name: str) -> None:
    """Most of them are open with all joints at zero: freedoms are counted where they close."""
    assert describe_mobility(flexinv.load_mechanism(root / "models" / name), None) == f"mobility: {INFO[name]}"


def test_words_on_open_loops_are_sought_when_they_are_read(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever tries machines, of which some do not close, does not wait for words; a copy in another process has them."""
    from flexinv.constraints import open_loops

    searches: list[object] = []
    find = open_loops._find_closed
    monkeypatch.setattr(open_loops, "_find_closed", lambda *given: searches.append(1) or find(*given))
    mechanism, motion = flexinv.load_mechanism(model), flexinv.Motion.point_to_point({"A": 0.0}, {"A": 0.5}, 1.0)
    with pytest.raises(OpenLoops) as caught:
        flexinv.solve(mechanism, motion, step=0.5)
    assert searches == []
    words = str(caught.value)
    assert len(searches) == 1
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.example) == (words, caught.value.example)
    assert len(searches) == 1  # once
