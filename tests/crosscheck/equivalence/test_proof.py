"""A lifted mechanism proves itself: held against its reader's own model each time, joint by joint; what is lost is said."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arm_texts import arm
from click.testing import CliRunner

pytest.importorskip("mujoco")
pytest.importorskip("pinocchio")

import crosscheck
from campaigns import mjcf_attributes as attributes
from crosscheck.cli import main
from crosscheck.equivalence.proof import HELD, LOST, PROVEN, SOURCE, UNPROVEN, prove
from crosscheck.equivalence.proving.provers import add_dynamics
from crosscheck.equivalence.result import Comparison
from crosscheck.equivalence.sources import describe
from crosscheck.lifting.description import Description
from crosscheck.lifting.reader_dynamics import FunctionDynamics
from flexinv.model.mechanism import Inertia, Joint, Mechanism

DATA = Path(__file__).resolve().parents[2] / "data" / "lifting"
# Pairs of small files: what is named, [] for the same machine.  The efforts of all others differ in mj_inverse.
PAIRS = {
    ("flags_none", "flag_gravity"): ["gravity"],
    ("flag_gravity", "gravity_zero"): [],
    ("flags_none", "flag_spring"): ["spring stiffness"],
    ("pendulum", "gravity_moon"): ["gravity"],
    ("ball", "ball_spring"): ["ball-spring that only B has"],
    ("ball", "free_spring"): ["kind of joint", "free-spring that only B has"],
    ("spring_linear", "spring_cubic"): ["spring-law that only B has"],
    ("motor", "motor_rotor"): ["damping", "rotor inertia"],
    ("pendulum", "fluid"): ["fluid that only B has"],
    ("pendulum", "gravcomp"): ["gravcomp that only B has"],
    ("gravcomp", "gravcomp"): [],
    ("coupling_linear", "coupling_square"): ["coupling-law that only B has"],
    ("coupling_square", "coupling_square"): [],
    ("tendon_soft", "tendon_stiff"): ["tendon-damper that only B has", "tendon-spring"],
    ("fingers", "tendon_armature"): ["tendon-armature that only B has"],
    ("fingers", "tendon_equality"): ["coupling that only B has"],
    ("tendon_equality", "joint_equality"): [],
}


def data(name: str) -> Path:
    return DATA / f"{name}.xml"


@pytest.mark.parametrize("pair", PAIRS, ids="-".join)
def test_what_mujoco_does_is_in_the_mechanism_or_named(pair: tuple[str, str]) -> None:
    comparison = crosscheck.compare(*map(data, pair))
    assert [proof.state for _, proof in comparison.proofs] == [PROVEN, PROVEN]
    assert [d.cause for d in comparison.differences] == PAIRS[pair]
    assert comparison.state == ("different" if PAIRS[pair] else "equal")
    assert not comparison.unexplained


# Every third attribute; campaigns/mjcf_attributes.py has all of them, and pairs of two.
SHARE = list(attributes.EDITS)[::3]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Description:
    return describe(attributes.write(tmp_path_factory.mktemp("bench"), "a.xml", attributes.MODEL))


@pytest.mark.parametrize("name", SHARE)
def test_what_mj_inverse_feels_is_another_machine(name: str, bench: Description, tmp_path: Path) -> None:
    text = attributes.edited(attributes.EDITS[name])
    assert attributes.own_gap(attributes.MODEL, text) > HELD
    comparison = crosscheck.compare(bench, attributes.write(tmp_path, "b.xml", text))
    assert comparison.state == "different"
    assert comparison.differences
    assert not comparison.unexplained


@pytest.mark.parametrize("name", attributes.UNFELT)
def test_what_mj_inverse_does_not_feel_is_no_other_machine(name: str, bench: Description, tmp_path: Path) -> None:
    text = attributes.edited(attributes.UNFELT[name])
    assert attributes.own_gap(attributes.MODEL, text) == 0.0
    assert crosscheck.compare(bench, attributes.write(tmp_path, "b.xml", text)).equal


def test_a_motors_rotor_is_one_of_the_joint_by_its_gear_squared(tmp_path: Path) -> None:
    geared = attributes.edited(attributes.with_words(attributes.DRIVE, 'armature="0.05" damping="0.3"'))
    plain = attributes.MODEL.replace('armature="0.02"', 'armature="0.47"').replace('damping="0.3"', 'damping="3"')
    assert attributes.own_gap(geared, plain) <= HELD
    assert crosscheck.compare(
        attributes.write(tmp_path, "a.xml", geared), attributes.write(tmp_path, "b.xml", plain)
    ).equal


# --- a lift that is wrong is found out ------------------------------------------------------------------------------


def of_joint(name: str, **change: Any) -> Callable[[Mechanism], Mechanism]:
    def changed(joint: Joint) -> Joint:
        if joint.name != name:
            return joint
        return replace(joint, **{key: value(getattr(joint, key)) for key, value in change.items()})

    return lambda mechanism: replace(mechanism, joints=tuple(map(changed, mechanism.joints)))


def of_body(change: Callable[[Inertia], Inertia]) -> Callable[[Mechanism], Mechanism]:
    def made(mechanism: Mechanism) -> Mechanism:
        link = mechanism.link_of["rod"]
        body = replace(link.bodies[0], inertia=change(link.bodies[0].inertia))
        other = replace(link, bodies=(body,))
        return replace(mechanism, links=tuple(other if one is link else one for one in mechanism.links))

    return made


def larger(value: float) -> float:
    return value + 1e-6


ASIDE, UP = 1e-6 * np.eye(3)[1:]
# Each number of the mechanism, wrong by a part in a million or by 1e-6, and the joint that feels it first.
WRONG: dict[str, tuple[Callable[[Mechanism], Mechanism], str]] = {
    "mass": (of_body(lambda body: replace(body, mass=larger(body.mass))), "slide"),
    "centre": (of_body(lambda body: replace(body, com=body.com + UP)), "hinge"),
    "tensor": (of_body(lambda body: replace(body, tensor=body.tensor * 1.001)), "hinge"),
    "damping": (of_joint("hinge", damping=larger), "hinge"),
    "rotor": (of_joint("ball", rotor_inertia=larger), "ball"),
    "friction": (of_joint("hinge", friction=larger), "hinge"),
    "stiffness": (of_joint("slide", stiffness=larger), "slide"),
    "rest": (of_joint("slide", rest=larger), "slide"),
    "axis": (of_joint("slide", axis=lambda axis: np.array([axis[0], axis[1], 1e-6])), "slide"),
    "place": (of_joint("hip", placement=lambda at: replace(at, position=at.position + ASIDE)), "float"),
    "gravity": (lambda mechanism: replace(mechanism, gravity=mechanism.gravity + ASIDE), "float"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_number_in_a_lifted_mechanism_is_found(kind: str, bench: Description) -> None:
    change, joint = WRONG[kind]
    assert prove(bench).state == PROVEN
    result = prove(replace(bench, mechanism=change(bench.mechanism)))
    assert result.state == LOST
    assert joint in [one.joint for one in result.lost]


def test_a_reader_that_answers_no_number_reproduces_nothing(bench: Description) -> None:
    silent = FunctionDynamics("a reader", lambda q, qd, qdd, gravity, without: np.full_like(qd, np.nan))
    result = prove(replace(bench, dynamics=silent))
    assert result.state == LOST
    assert {one.joint for one in result.lost} == {joint.name for joint in bench.mechanism.joints if joint.nv}


def test_two_lifts_that_are_wrong_alike_are_not_the_same_machine(bench: Description) -> None:
    """What both have lost is seen by neither's mechanism: the readers' own models tell it."""
    wrong = replace(bench, mechanism=WRONG["damping"][0](bench.mechanism))
    comparison = crosscheck.compare(wrong, wrong)
    assert not comparison.differences
    assert (comparison.state, comparison.code, comparison.equal) == ("not comparable", 2, False)
    assert "joint hinge: the reader's own effort differs by" in comparison.sentence
    with pytest.raises(AssertionError, match=r"Not comparable in a\.xml"):
        crosscheck.assert_same(wrong, wrong)


def test_what_is_not_named_any_more_is_lost() -> None:
    """A feature that the lift forgets is not switched off in the reader's own model."""
    result = describe(data("gravcomp"))
    assert prove(result).state == PROVEN
    assert prove(replace(result, features=())).state == LOST


@pytest.mark.parametrize("kind", ["factor", "offset", "none", "more"])
def test_a_wrong_closure_is_found(kind: str) -> None:
    result = describe(data("joint_equality"))
    closure = result.mechanism.closures[0]
    closures = {
        "factor": (replace(closure, factors=((closure.factors[0][0], 1.0), (closure.factors[1][0], -2.001))),),
        "offset": (replace(closure, offset=1e-6),),
        "none": (),
        "more": (closure, replace(closure, name="d", factors=((closure.factors[0][0], 1.0),))),
    }
    assert prove(result).state == PROVEN
    assert prove(result).reason == ""
    wrong = prove(replace(result, mechanism=replace(result.mechanism, closures=closures[kind])))
    assert wrong.state == LOST
    assert "equations" in wrong.words


def test_a_loop_of_bodies_is_held_against_the_rows_of_the_reader(tmp_path: Path) -> None:
    """A weld whose frame is turned by a hundred thousandth is another one."""
    text = attributes.MODEL.replace("</tendon>", '</tendon><equality><weld body1="hand" body2="leg"/></equality>')
    result = describe(attributes.write(tmp_path, "loop.xml", text))
    assert (prove(result).state, prove(result).reason) == (PROVEN, "")
    closure = result.mechanism.closures[0]
    turn = np.array([[1.0, -1e-5, 0.0], [1e-5, 1.0, 0.0], [0.0, 0.0, 1.0]])
    first = replace(closure.first, placement=replace(closure.first.placement, rotation=turn))
    wrong = replace(result.mechanism, closures=(replace(closure, first=first),))
    assert prove(replace(result, mechanism=wrong)).state == LOST


# --- what nobody can be asked of ------------------------------------------------------------------------------------


def test_a_mechanism_of_ours_is_the_source_itself(root: Path) -> None:
    comparison = crosscheck.compare(root / "models" / "rigid_3r", root / "models" / "rigid_3r")
    assert comparison.equal
    assert {proof.state for _, proof in comparison.proofs} == {SOURCE}


def test_a_urdf_is_held_against_pinocchio(tmp_path: Path) -> None:
    result = prove(add_dynamics(describe(arm(tmp_path, ('<mimic joint="grip"/>', "")))))
    assert result.state == PROVEN
    assert result.reader.startswith("Pinocchio")
    assert "MuJoCo" not in result.reader


def test_a_joint_that_mimics_another_is_held_against_mujoco(tmp_path: Path) -> None:
    """Pinocchio's parser leaves it independent: its model has no equation for it."""
    result = add_dynamics(describe(arm(tmp_path)))
    assert (prove(result).state, prove(result).reason) == (PROVEN, "")
    assert "its closures against MuJoCo" in prove(result).reader
    (closure,) = result.mechanism.closures
    wrong = replace(closure, factors=(closure.factors[0], (closure.factors[1][0], 1.0)))
    lost = prove(replace(result, mechanism=replace(result.mechanism, closures=(wrong,))))
    assert lost.state == LOST


def test_a_urdf_that_pinocchio_refuses_is_held_against_mujoco(tmp_path: Path) -> None:
    """Pinocchio's parser takes a joint of six axes at the root only."""
    edits = ('<joint name="elbow" type="revolute">', '<joint name="elbow" type="floating">')
    result = add_dynamics(describe(arm(tmp_path, edits)))
    assert result.dynamics is None or prove(result).state in (PROVEN, LOST)
    assert (result.dynamics is None) == bool(result.unproven)


def unproven(tmp_path: Path) -> tuple[Description, Path]:
    file = arm(tmp_path)
    return replace(describe(file), unproven="no engine is installed that has a model of its own of URDF"), file


def test_without_a_reader_nothing_is_called_the_same(tmp_path: Path) -> None:
    one, file = unproven(tmp_path)
    comparison = crosscheck.compare(one, file)
    assert not comparison.differences
    assert (comparison.state, comparison.code) == ("not proven", 2)
    assert comparison.sentence.startswith("Not proven to be the same machine")
    assert "no engine is installed that has a model of its own of URDF" in comparison.sentence
    with pytest.raises(AssertionError, match="Not proven"):
        crosscheck.assert_same(one, file)
    allowed = crosscheck.assert_same(one, file, unproven=True)
    assert allowed.code == 0
    assert "not proven: no engine" in allowed.sentence


def test_a_difference_is_one_without_proof_too(tmp_path: Path) -> None:
    one, _ = unproven(tmp_path)
    other = arm(tmp_path, ('value="2.375"', 'value="2.625"'), name="b.urdf")
    assert crosscheck.compare(one, other).code == 1


def test_a_reader_without_dynamics_is_not_proven(tmp_path: Path) -> None:
    result = replace(describe(arm(tmp_path)), reader="some reader")
    assert prove(add_dynamics(result)).state == UNPROVEN


# --- what is left out, and what every output says --------------------------------------------------------------------


def outputs(folder: Path, *words: str) -> tuple[int, dict[str, str]]:
    """Return the exit code, and every output by its name."""
    run = CliRunner().invoke(main, ["compare", *words, "--out", str(folder)])
    result = {name: (folder / name).read_text() for name in ("index.html", "results.json", "junit.xml", "summary.md")}
    result["terminal"] = " ".join(run.output.split())
    return run.exit_code, result


def test_what_is_ignored_is_repeated_in_every_output(tmp_path: Path) -> None:
    files = [str(data(name)) for name in ("pendulum", "gravcomp")]
    assert outputs(tmp_path / "all", *files)[0] == 1
    code, said = outputs(tmp_path / "less", *files, "--ignore", "gravcomp", "--ignore", "gravcmp")
    assert code == 0
    for name, text in said.items():
        assert "left out: gravcomp, of B" in text, name
        assert "left out: gravcmp, which neither has; what they have is gravcomp" in text, name
    comparison = crosscheck.compare(*files, ignore=["gravcomp"])
    assert "left out: gravcomp, of B" in comparison.sentence
    assert comparison.judged.after <= HELD


def test_another_feature_is_not_left_out_with_it(tmp_path: Path) -> None:
    text = data("gravcomp").read_text().replace("<worldbody>", '<option density="1000"/><worldbody>')
    file = attributes.write(tmp_path, "b.xml", text)
    comparison = crosscheck.compare(data("pendulum"), file, ignore=["gravcomp"])
    assert [d.cause for d in comparison.differences] == ["fluid that only B has"]
    assert crosscheck.compare(data("pendulum"), file, ignore=["gravcomp", "fluid"]).equal


@pytest.fixture
def read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files are read in this process, so that what a test changes in it is seen."""
    monkeypatch.setattr(
        "crosscheck.run.reading_limits.ReadingLimits.run_function", lambda guard, function, *words: function(*words)
    )


@pytest.mark.usefixtures("read_here")
def test_not_comparable_is_said_in_every_output(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crosscheck.engines.mujoco.lift.find_features", lambda model: ())
    file = str(data("gravcomp"))
    code, said = outputs(tmp_path / "out", file, file)
    assert code == 2
    for name, text in said.items():
        assert "not reproduced, held against MuJoCo" in text, name
        assert "joint pivot" in text, name
    assert json.loads(said["results.json"])["state"] == "not comparable"
    assert json.loads(said["results.json"])["equal"] is False
    assert "<error" in said["junit.xml"]
    assert CliRunner().invoke(main, ["compare", file, file, "--unproven"]).exit_code == 2


@pytest.mark.usefixtures("read_here")
def test_not_proven_is_said_in_every_output(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crosscheck.equivalence.proving.provers.list_installed_engines", dict)
    monkeypatch.setattr("crosscheck.equivalence.proving.provers.ENGINES", {})
    file = str(arm(tmp_path))
    code, said = outputs(tmp_path / "out", file, file)
    assert code == 2
    for name, text in said.items():
        assert "no engine is installed that has a model of its own of URDF" in text, name
    assert "<error" in said["junit.xml"]
    code, said = outputs(tmp_path / "allowed", file, file, "--unproven")
    assert code == 0
    for name, text in said.items():
        assert "not proven" in text, name
    assert "<error" not in said["junit.xml"]


# --- features ---------------------------------------------------------------------------------------------------------


def test_equal_features_of_bodies_with_other_names_are_no_difference(tmp_path: Path) -> None:
    text = data("gravcomp").read_text().replace('"rod"', '"stick"').replace('"pivot"', '"turn"')
    assert crosscheck.compare(data("gravcomp"), attributes.write(tmp_path, "b.xml", text)).equal


def test_an_equal_feature_is_not_named_beside_another_mass(tmp_path: Path) -> None:
    text = data("gravcomp").read_text().replace('mass="0.9"', 'mass="0.91"')
    comparison = crosscheck.compare(data("gravcomp"), attributes.write(tmp_path, "b.xml", text))
    assert [d.cause for d in comparison.differences] == ["mass"]


def test_a_feature_that_no_torque_can_tell_counts_when_it_is_asked_for(tmp_path: Path) -> None:
    files = []
    for value in ("0.5", "1"):
        text = data("gravcomp").read_text().replace('gravcomp="1"', f'gravcomp="{value}"')
        weightless = text.replace("<worldbody>", '<option gravity="0 0 0"/><worldbody>')
        files.append(attributes.write(tmp_path, f"{value}.xml", weightless))
    comparison = crosscheck.compare(*files)
    assert comparison.equal
    assert [d.cause for d in comparison.judged.unseen] == ["gravcomp"]
    assert crosscheck.compare(*files, strict=True).state == "different"


def test_a_floating_base_that_starts_elsewhere_is_asked_where_it_stands(tmp_path: Path) -> None:
    """Compensated weight of a base that both files draw elsewhere: the readers are asked for the same place in the world."""
    files = []
    for k, place in enumerate(('pos="0 0 1"', 'pos="1 0 0.5" quat="0.9 0.3 0 0"')):
        text = f"""<mujoco><worldbody><body name="base" gravcomp="0.5" {place}><freejoint name="float"/>
          <inertial pos="0.01 0 0.1" mass="2" diaginertia="0.03 0.02 0.04"/></body></worldbody></mujoco>"""
        files.append(attributes.write(tmp_path, f"{k}.xml", text))
    comparison = crosscheck.compare(*files)
    assert {d.cause for d in comparison.differences} <= {"pose at zero"}
    assert not comparison.unexplained


def test_actuators_that_are_switched_off_are_told_by_name(tmp_path: Path) -> None:
    files = []
    for group in ("1", "2"):
        option = f'<option actuatorgroupdisable="{group}" gravity='
        text = attributes.MODEL.replace("<option gravity=", option)
        text = text.replace('<motor name="drive"', '<motor name="drive" group="1"')
        text = text.replace('<motor name="winch"', '<motor name="winch" group="2"')
        files.append(attributes.write(tmp_path, f"{group}.xml", text))
    assert [d.cause for d in crosscheck.compare(*files).differences] == ["actuation"]
    assert crosscheck.compare(files[0], files[0]).equal


def test_readers_of_one_file_say_their_state(tmp_path: Path) -> None:
    run = CliRunner().invoke(main, ["compare", str(data("ball_spring")), "--readers", "mujoco,pinocchio", "--json"])
    rows = {row["reader"]: row for row in json.loads(run.output)}
    assert run.exit_code in (1, 2)
    assert "ball-spring that only" in rows["pinocchio"]["words"] + rows["mujoco"]["words"]


def test_the_words_of_a_comparison_are_in_its_sentence() -> None:
    comparison = crosscheck.compare(data("ball"), data("ball_spring"))
    assert isinstance(comparison, Comparison)
    assert "engines' own features different" in comparison.sentence
    assert comparison.plain["proofs"]["ball.xml"]["state"] == PROVEN
