"""The door to MuJoCo: records, refusals, URDF with overlays, its warnings, and faults in its map that the tests see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import kane
import numpy as np
import pytest
import rigid_trees as trees
from scipy.spatial.transform import Rotation

from crosscheck.engines.base import sample_times
from crosscheck.engines.mujoco import adapter as mujoco
from crosscheck.engines.mujoco import joints as mujoco_joints
from crosscheck.engines.mujoco.fuse import list_losses
from crosscheck.measures.record import check
from crosscheck.studies.robot_sweep import sample_states
from flexinv.files.from_urdf import from_urdf
from flexinv.model.mechanism import WORLD, Body, Inertia, Joint, Link, Mechanism
from flexinv.model.motion import Motion

ROUNDING = 1e-13  # a few hundred roundings of the largest effort


def judged(mechanism: Mechanism, state: tuple[Any, ...]) -> Any:
    return np.array([kane.torque(mechanism, *row) for row in zip(*state, strict=True)])


def test_a_record_of_all_quantities(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mechanism = trees.tree()
    q = sample_states(mechanism, 2, np.random.default_rng(2))[0]
    case = trees.case_of(Motion.point_to_point(q[0], q[1], 0.5), 0.5, 0.05)
    assert mujoco.unsupported(mechanism, case, "mujoco") is None
    record = mujoco.run(mechanism, case, "mujoco", {})
    check(record, sample_times(case))
    expected = judged(mechanism, case.motion.evaluate(mechanism, record.time))
    for k, name in enumerate(mechanism.velocity_names):
        np.testing.assert_allclose(
            record.series[f"torque/{name}"].values, expected[:, k], rtol=0, atol=ROUNDING * np.abs(expected).max()
        )
    assert "wrench/flange_joint/fx" in record.series  # every link is a body: fixed joints have a wrench
    assert {f"tip/{link.name}/x" for link in mechanism.links} <= set(record.series)
    assert (record.message, record.settings["raised to mjMINVAL"]) == ("", [])
    assert list(tmp_path.iterdir()) == []


def test_a_refused_model_is_skipped_in_mujocos_words() -> None:
    mechanism, _ = trees.double_pendulum()
    impossible = Body("odd", Inertia.build_unchecked(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0])))
    links = (mechanism.links[0], replace(mechanism.links[1], bodies=(impossible,)))
    case = trees.case_of(Motion.point_to_point([0, 0], [1, 1], 1.0), 1.0, 0.1)
    record = mujoco.run(replace(mechanism, links=links), case, "mujoco", {})
    assert record.status == "skipped"
    assert record.message.startswith("MuJoCo refuses the model: Error: inertia must satisfy A + B >= C")
    assert "link2/odd" in record.message


def test_warnings_become_words_and_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mechanism, _ = trees.double_pendulum()
    before = mujoco.mujoco.get_mju_user_warning()
    with mujoco.collect_warnings() as words:
        data = mujoco.mujoco.MjData(mujoco.build(mechanism).model)
        data.qacc[:] = np.nan
        data.qpos[:] = np.nan
        mujoco.mujoco.mj_step(data.model, data)
    assert any("Nan" in word for word in words)
    assert mujoco.mujoco.get_mju_user_warning() is before
    assert list(tmp_path.iterdir()) == []


def test_free_joints_that_mujoco_has_not() -> None:
    case = trees.case_of(Motion.point_to_point([0, 0], [1, 1], 1.0), 1.0, 0.1)
    inner = trees.tree((("arm", "revolute", WORLD), ("body", "free", "arm")))
    reason = mujoco.unsupported(inner, case, "mujoco")
    assert reason == "a free joint of MuJoCo hangs on the world only; 'body_joint' hangs on 'arm'"
    heavy = trees.chain("free")
    heavy = replace(heavy, joints=(replace(heavy.joints[0], rotor_inertia=1.0), heavy.joints[1]))
    assert "act along world axes" in str(mujoco.unsupported(heavy, case, "mujoco"))


@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("root", ["pelvis", "world"])
@pytest.mark.parametrize("laid", [(), (trees.overlaid,), (trees.overlaid, trees.reweighed)])
def test_a_urdf_by_its_own_parser(
    tmp_path: Path, base: str, root: str, laid: tuple[Callable[[Mechanism], Mechanism], ...]
) -> None:
    mechanism = from_urdf(trees.urdf(tmp_path, root), base=base)
    for lay in laid:
        mechanism = lay(mechanism)
    state = sample_states(mechanism, 5, np.random.default_rng(1))
    result = mujoco.compute_inverse_dynamics(mechanism, mujoco.build(mechanism), *state).torque
    expected = judged(mechanism, state)
    np.testing.assert_allclose(result, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())


def test_a_urdf_that_is_not_the_mechanism_is_refused(tmp_path: Path) -> None:
    mechanism = from_urdf(trees.urdf(tmp_path))
    path = tmp_path / "robot.urdf"
    path.write_text(path.read_text().replace('name="mid"', 'name="other"'))
    with pytest.raises(ValueError, match=r"only MuJoCo: \['other'\]; only the mechanism: \['mid'\]"):
        mujoco.build(mechanism)


# ------------------------------------------------------------------------------------------- what fusing loses


def test_fusing_loses_the_inertia_of_links_without_mass(tmp_path: Path) -> None:
    (loss,) = list_losses(trees.footed(tmp_path, 0.0))
    assert (loss.body, loss.massless, loss.explained) == ("hand", ("tool",), True)
    assert np.trace(loss.missing) == pytest.approx(0.05, rel=1e-9)  # MuJoCo's principal axes are good to 1e-12


def test_fusing_loses_nothing_of_links_with_mass(tmp_path: Path) -> None:
    assert list_losses(trees.footed(tmp_path, 0.5)) == ()


def test_a_loss_that_is_not_that_inertia_is_not_explained(tmp_path: Path) -> None:
    (loss,) = list_losses(trees.footed(tmp_path, 0.0))
    assert not replace(loss, missing=1.001 * loss.missing).explained
    assert not replace(loss, massless=()).explained


# ---------------------------------------------------------------------------------------------- faults in the map


def quaternion_not_rolled(joint: Joint, q: Any) -> Any:
    return q if joint.kind == "spherical" else ORIGINAL_POSITION(joint, q)


def placement_forgotten(joint: Joint, q: Any) -> Any:
    return Rotation.from_quat(q[:, 3:])


def no_bias(mechanism: Mechanism, built_model: Any, q: Any, qd: Any, qdd: Any) -> Any:
    """a_mj = R0 R v' without w x v."""
    state = ORIGINAL_MAP(mechanism, built_model, q, qd, qdd)
    turn = mujoco_joints._compute_world_rotation(mechanism.joints[0], q[:, :7])
    state.a[:, :3] = turn.apply(qdd[:, :3])
    return state


def no_dual(mechanism: Mechanism, built_model: Any, q: Any, force: Any) -> Any:
    return force


ORIGINAL_POSITION, ORIGINAL_MAP = mujoco_joints._convert_position, mujoco_joints.convert_to_engine
MAP_FAULTS: dict[str, tuple[str, Callable[..., Any]]] = {
    "quaternion order": ("_convert_position", quaternion_not_rolled),
    "base placement": ("_compute_world_rotation", placement_forgotten),
    "bias w x v": ("convert_to_engine", no_bias),
    "dual of the base": ("convert_effort_from_engine", no_dual),
}


@pytest.mark.parametrize("fault", MAP_FAULTS)
def test_a_fault_in_the_map_is_seen(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = trees.tree()
    state = sample_states(mechanism, 5, np.random.default_rng(1))
    for module in (mujoco, mujoco_joints):
        monkeypatch.setattr(module, *MAP_FAULTS[fault], raising=False)
    wrong = mujoco.compute_inverse_dynamics(mechanism, mujoco.build(mechanism), *state).torque
    expected = judged(mechanism, state)
    assert np.abs(wrong - expected).max() > 1e-3 * np.abs(expected).max()


def test_default_friction_would_be_soft(monkeypatch: pytest.MonkeyPatch) -> None:
    """With MuJoCo's own solref, friction at a crawl is a fraction of what it is: the stiff setting is needed."""
    mechanism = trees.chain("revolute")
    q, qd, qdd = sample_states(mechanism, 5, np.random.default_rng(1))
    qd = 1e-6 * np.sign(qd)
    expected = judged(mechanism, (q, qd, qdd))
    monkeypatch.setattr(mujoco_joints, "STIFF_FRICTION", (0.02, 1.0))
    soft = mujoco.compute_inverse_dynamics(mechanism, mujoco.build(mechanism), q, qd, qdd).torque
    assert np.abs(soft - expected).max() > 1e-3 * np.abs(expected).max()


def test_what_is_raised_to_the_floor_is_named() -> None:
    point = Link("point", (Body("mass", Inertia(1.0, np.array([0.5, 0.0, 0.0]))),))
    mechanism = Mechanism(
        "m", (point, Link("empty")), (Joint("a", "revolute", WORLD, "point"), Joint("b", "revolute", "point", "empty"))
    )
    assert mujoco.build(mechanism).floored == ("point", "empty")
    solid = replace(
        mechanism, links=(Link("point", (Body("mass", Inertia(1.0, np.zeros(3), np.eye(3))),)), Link("empty"))
    )
    assert mujoco.build(solid).floored == ("empty",)


def test_words_about_itself() -> None:
    assert mujoco.version().count(".") == 2
    assert mujoco.abilities().endswith("see mujoco-flex.")
