"""A new mechanism: starters that run, what verify says about them, and limits from error bars."""

from __future__ import annotations

import datetime
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from matplotlib.figure import Figure
from rigid_trees import urdf

from crosscheck.cli import main
from crosscheck.engines import ENGINES
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.plan import discover
from crosscheck.workflows.model_summary import apply_common_limits, picture, portrait
from crosscheck.workflows.proposals import (
    MARK,
    Proposal,
    find_next_round_number,
    format_proposal_toml,
    list_proposals,
    write,
)
from crosscheck.workflows.scaffold import TEMPLATES, write_from_template, write_from_urdf
from flexinv.display.drawing import find_motion_plane
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism_card import describe_links

TODAY = datetime.date(2030, 1, 31)
SEEN = {
    "arm": {
        "what": "3 links, all rigid",
        "freedoms": "3 joint coordinates, 3 drives; an open tree: no constraint, none redundant",
        "mass": "13.5 kg",
        "frequencies": "none: no link bends, and the drives hold every joint",
    },
    "loop": {
        "freedoms": "1 freedom = 3 joint coordinates - 2 independent constraints; 5 constraints, 3 redundant; 1 drive",
        "mass": "1.7 kg",
    },
    "flexible": {"what": "2 links, of which beams: boom", "mass": "3.25 kg"},
}


def test_there_are_the_starters_that_the_command_names() -> None:
    assert set(TEMPLATES) == set(SEEN)


@pytest.mark.parametrize("template", SEEN)
def test_a_starter_is_explained(template: str, tmp_path: Path) -> None:
    write_from_template(tmp_path, "mine", template)
    (task,) = discover(tmp_path).tasks
    seen = portrait(task)
    lines = dict(seen.lines)
    assert {what: lines[what] for what in SEEN[template]} == SEEN[template]
    if template == "flexible":
        first = float(lines["frequencies"].split()[0])
        # a massless cantilever with the jib's 2.3 kg near its tip, E I = 70e9 pi (0.03^4 - 0.026^4) / 64: 2.0 Hz; the jib's
        # length beyond the tip lowers it further
        assert 1.0 < first < 2.0
    file = tmp_path / "picture.svg"
    picture(seen, file)
    assert "</svg>" in file.read_text()


def test_a_plane_mechanism_is_drawn_in_its_plane() -> None:
    x = np.random.default_rng(0).normal(size=(3, 4, 3))
    assert find_motion_plane(x) is None
    x[:, :, 1] = 0.7
    assert find_motion_plane(x) == (0, 2)


def test_a_urdf_becomes_a_folder_that_loads(tmp_path: Path) -> None:
    file = urdf(tmp_path)
    folder = write_from_urdf(tmp_path / "models", "robot", file)
    mechanism = load_mechanism(folder)
    (case,) = load_cases(folder, mechanism).values()
    assert set(case.motion.joints(mechanism)) == {j.name for j in mechanism.joints if j.nv}
    q, _, _ = case.motion.evaluate(mechanism, np.linspace(0, 1, 5))
    for joint in mechanism.joints:
        if joint.kind in ("revolute", "prismatic"):
            own = q[:, mechanism.q_slices[joint.name]]
            assert (own >= joint.limits.lower).all()
            assert (own <= joint.limits.upper).all()
    free = load_mechanism(write_from_urdf(tmp_path / "models", "walker", file, base="free"))
    assert free.joints[0].kind == "free"


def test_what_cannot_be_a_mechanism_leaves_nothing_behind(tmp_path: Path) -> None:
    for name in ("../out", "a/b", "", ".hidden", "<script>", "x" * 80):
        with pytest.raises(InputError, match="expected letters, digits, _ and -"):
            write_from_template(tmp_path, name, "arm")
    write_from_template(tmp_path, "mine", "arm")
    with pytest.raises(InputError, match="exists already"):
        write_from_template(tmp_path, "mine", "loop")
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot><link name='a'>")
    with pytest.raises(InputError):
        write_from_urdf(tmp_path, "robot", broken)
    assert {f.name for f in tmp_path.iterdir()} == {"mine", "broken.urdf"}


ROW = Comparison("m", "c", "exudyn-ge", "flexinv", "torque", "N m", "within", maximum=3e-5, scale=1.0, error_bar=4e-5)


def test_limits_follow_from_error_bars() -> None:
    """Covered by the bars, beyond them but small, far beyond, no bars, bars too wide, native results."""
    native = next(name for name, engine in ENGINES.items() if engine.native)
    rows = [
        ROW,
        replace(ROW, engine="exudyn-ancf", maximum=4.5e-5, error_bar=4.9e-5),
        replace(ROW, engine="mujoco", maximum=3e-16, error_bar=2e-15),
        replace(ROW, quantity="tip", maximum=2e-4),
        replace(ROW, quantity="wrench", maximum=2e-3),
        replace(ROW, quantity="axial", error_bar=None),
        replace(ROW, quantity="deflection", error_bar=0.2),
        replace(ROW, engine=native, maximum=0.7),
        replace(ROW, quantity="reaction", maximum=None, scale=None),
    ]
    proposals = list_proposals(rows, TODAY)
    result = {(p.quantity, p.engines): p.maximum for p in proposals}
    assert result == {
        ("torque", ("exudyn-ge", "exudyn-ancf")): 5e-5,
        ("torque", ("mujoco",)): 1e-12,
        ("tip", ("exudyn-ge",)): 2e-4,
        ("wrench", ("exudyn-ge",)): None,
        ("axial", ("exudyn-ge",)): None,
        ("deflection", ("exudyn-ge",)): None,
    }
    words = {p.quantity: p.reason for p in proposals if p.engines != ("mujoco",)}
    assert words["torque"] == "error bars of both engines together 4.9e-5 of the range; measured difference 4.5e-5"
    assert words["tip"] == "measured difference 2e-4 of the range, beyond the error bars of 4e-5: not explained yet"
    assert [p.expires for p in proposals if p.quantity == "tip"] == [TODAY + datetime.timedelta(days=90)]
    assert "the models differ; find the cause" in words["wrench"]
    assert "state a limit by hand" in words["axial"]
    assert "refine step_s or the mesh" in words["deflection"]


@pytest.mark.parametrize(("value", "limit"), [(1.1e-4, 2e-4), (2e-4, 2e-4), (4e-4, 5e-4), (6e-4, 1e-3), (1e-12, 1e-12)])
def test_limits_are_round_numbers(value: float, limit: float) -> None:
    assert find_next_round_number(value) == limit


def test_written_limits_load_and_stated_ones_stay(tmp_path: Path) -> None:
    folder = write_from_template(tmp_path, "mine", "arm")
    file, mechanism = folder / "cases.toml", load_mechanism(folder)
    proposal = Proposal("torque", "flexinv", ("mujoco", "exudyn"), 5e-5, 'error bars "x"'.replace('"', "'"), TODAY)
    none = Proposal("wrench", "flexinv", ("mujoco",), None, "the models differ")
    write(file, [proposal, none], "crosscheck verify, a test")
    (case,) = load_cases(folder, mechanism).values()
    limits = {limit.quantity: limit for limit in case.limits}
    assert limits["torque"].maximum == 5e-5
    assert limits["torque"].engines == ("mujoco", "exudyn")
    assert limits["torque"].expires == TODAY
    assert limits["tip"].reason.startswith("provisional")
    assert limits["wrench"].reason.startswith("provisional")
    assert "# no limit for wrench of mujoco: the models differ" in file.read_text()
    write(file, [proposal, none], "crosscheck verify, a test")  # again: nothing doubles
    assert file.read_text().count("[[limits]]") == 3
    file.write_text(file.read_text().replace(MARK, ""))
    before = file.read_text()
    with pytest.raises(InputError, match="its limits were stated by hand"):
        write(file, [proposal], "crosscheck verify, a test")
    assert file.read_text() == before
    assert tomllib.loads(format_proposal_toml(proposal, "crosscheck verify, a test"))["limits"][0]["maximum"] == 5e-5


def test_what_somebody_put_below_the_mark_stays(tmp_path: Path) -> None:
    folder = write_from_template(tmp_path, "mine", "arm")
    file = folder / "cases.toml"
    by_hand = '[[limits]]\nquantity = "torque"\nengines = ["exudyn"]\nmaximum = 3e-3\nreason = "by hand"\n'
    case = """# of mine
[cases.second]
title = "another"
step_s = 0.01
[cases.second.motion]
duration_s = 1.0
joints.yaw = { from_deg = 0, to_deg = 1 }
joints.shoulder = { from_deg = 0, to_deg = 1 }
joints.elbow = { from_deg = 0, to_deg = 1 }
"""
    file.write_text(
        file.read_text().replace("those below that it proposed", "everything below") + "\n" + by_hand + case
    )
    for _ in range(2):
        write(file, [Proposal("torque", "flexinv", ("mujoco",), 5e-5, "error bars")], "crosscheck verify, a test")
        assert case in file.read_text()
        cases = load_cases(folder, load_mechanism(folder))
        assert list(cases) == ["move", "second"]
        torque = [limit.maximum for limit in cases["second"].limits if limit.quantity == "torque"]
        assert torque == [5e-5, 3e-3]
        assert file.read_text().count("[[limits]]") == 4  # torque, torque by hand, tip, wrench
    file.write_text(
        file.read_text() + 'notes = """\n[[limits]]\nsource = "crosscheck verify\nquantity = "torque"\n"""\n'
    )
    before = file.read_text()
    with pytest.raises(InputError, match="state them by hand"):
        write(file, [Proposal("torque", "flexinv", ("mujoco",), 6e-5, "error bars")], "crosscheck verify, a test")
    assert file.read_text() == before


def test_limits_are_added_to_a_file_that_has_none(tmp_path: Path) -> None:
    """What follows from models/README.md alone: a case without limits, and verify proposes them."""
    folder = write_from_template(tmp_path, "mine", "arm")
    file, mechanism = folder / "cases.toml", load_mechanism(folder)
    file.write_text(file.read_text().partition(MARK)[0].replace('quantities = ["torque", "tip", "wrench"]\n', ""))
    (case,) = load_cases(folder, mechanism).values()
    assert (case.limits, case.quantities) == ((), ("torque",))
    for _ in range(2):  # the second time in place of the first
        write(file, [Proposal("torque", "flexinv", ("mujoco",), 5e-5, "error bars")], "crosscheck verify, a test")
        (case,) = load_cases(folder, mechanism).values()
        assert [limit.maximum for limit in case.limits] == [5e-5]
    assert file.read_text().count(MARK) == 1


def test_stated_limits_are_heard_before_the_engines_run(tmp_path: Path) -> None:
    folder = write_from_template(tmp_path, "mine", "arm")
    file = folder / "cases.toml"
    file.write_text(file.read_text().replace(MARK, ""))
    done = command("verify", "mine", "--write", "--models", str(tmp_path), "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert "its limits were stated by hand" in done.output
    assert not (tmp_path / "out").exists()


def test_views_in_space_have_the_same_limits_and_room_for_numbers() -> None:
    figure = Figure()
    views = [figure.add_subplot(1, 2, k + 1, projection="3d") for k in range(2)]
    for view, depth in zip(views, (0.1, 2.0), strict=True):  # at rest nearly in a plane
        view.set(xlim=(0, 3), ylim=(0, depth), zlim=(0, 1))
    apply_common_limits(views)
    sides = [[np.ptp(getattr(view, f"get_{name}lim")()) for name in "xyz"] for view in views]
    assert sides[0] == sides[1]
    assert sides[0] == pytest.approx([3, 2, 1], rel=1e-12)
    views[1].set_ylim(-1e-3, 1e-3)
    views[0].set_ylim(-1e-3, 1e-3)
    apply_common_limits(views)
    assert np.ptp(views[0].get_ylim()) == pytest.approx(0.3 * sides[0][0], rel=1e-12)


def command(*words: str) -> Result:
    return CliRunner().invoke(main, list(words))


def test_verify_of_what_cannot_be_read_says_so(tmp_path: Path) -> None:
    folder = write_from_template(tmp_path, "mine", "arm")
    file = folder / "mechanism.toml"
    file.write_text(file.read_text().replace("mass_kg = 8.0", "mass_g = 8000"))
    done = command("verify", "mine", "--models", str(tmp_path))
    assert done.exit_code == 2
    assert "mine cannot be read" in done.output
    assert "mass_kg = 8" in done.output


def test_a_meshed_link_is_no_rigid_one(root: Path) -> None:
    assert describe_links(load_mechanism(root / "models" / "four_bar_bracket")) == "3 links, of which meshes: bracket"
