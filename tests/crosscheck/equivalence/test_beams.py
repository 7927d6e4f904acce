"""Links that bend: a file with one number of a beam changed is told apart by that number, and torques say what it does."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import crosscheck
from crosscheck.cli import main
from crosscheck.equivalence.beams.rigid_beams import evaluate_section_frame, make_rigid_mechanism
from crosscheck.equivalence.result import Comparison
from flexinv import joint_torques
from flexinv.analysis.evaluation import build_rigid_trajectory
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import Beam, Body, Inertia, Mechanism, Placement, Section

MODELS = Path(__file__).resolve().parents[3] / "models"
ARM = "spatial_arm"  # a rigid link, a beam of a tube, a payload off its axis
EDITS = {
    "bending": ("flex_two_link", "z = 0.046", "z = 0.05", "bending stiffness EI_z", "link link2", 0.004),
    "axial": ("flex_two_link", "EA_N = 1.452e6", "EA_N = 1.452e3", "axial stiffness EA", "link link1", 1.452e6 - 1.452e3),
    "length": ("flex_two_link", "length_m = 0.2", "length_m = 0.21", "length of beam", "link link1", 0.01),
    "mass": ("flex_two_link", "kg_per_m = 0.056", "kg_per_m = 0.06", "mass per length", "link link1", 0.004),
    "modulus": (ARM, "E_Pa = 70e9", "E_Pa = 77e9", "stiffness of section", "link forearm", 0.1),
    "density": (ARM, "2700", "2970", "inertia of section", "link forearm", 0.1),
    "where a payload is": (ARM, "station = 1.0", "station = 0.75", "station of body", "body tool (on link forearm)", 0.25),
    "where a payload's centre is": (ARM, "com_m = [0.02", "com_m = [0.03", "centre of mass", "body tool (on link forearm)", 0.01),
    "damping": ("flex_one_link_damped", "ratio = 0.03", "ratio = 0.06", "modal damping", "all beams", 0.03),
}  # fmt: skip


def edited(name: str, before: str, after: str, folder: Path) -> Path:
    text = (MODELS / name / "mechanism.toml").read_text()
    assert before in text
    (folder / "mechanism.toml").write_text(text.replace(before, after, 1))
    return folder


def named(comparison: Comparison) -> list[tuple[str, str]]:
    return [(d.cause, d.place) for d in [*comparison.differences, *comparison.judged.unseen]]


@pytest.mark.parametrize("kind", EDITS)
def test_one_number_of_a_beam_is_the_only_difference(kind: str, tmp_path: Path) -> None:
    """1e-12: the repaired file is the other one, up to the order of additions."""
    name, before, after, cause, place, size = EDITS[kind]
    comparison = crosscheck.compare(MODELS / name, edited(name, before, after, tmp_path))
    assert named(comparison) == [(cause, place)]
    assert comparison.judged.after < 1e-12
    if size is not None:
        assert comparison.differences[0].size == pytest.approx(size, rel=1e-6)
    assert not comparison.equal


@pytest.mark.parametrize("name", ["four_bar_flexible", "ur5_flexible_forearm", "quanser_2dsfl", "two_arms_flexible"])
def test_a_model_is_itself(name: str) -> None:
    assert crosscheck.compare(MODELS / name, MODELS / name).equal


def test_the_mesh_is_no_part_of_the_machine(tmp_path: Path) -> None:
    comparison = crosscheck.compare(MODELS / ARM, edited(ARM, "elements = 1", "elements = 4", tmp_path))
    assert comparison.equal
    assert any("forearm 1 of order 4 in A, 4 of order 4 in B" in note for note in comparison.notes)


@pytest.mark.slow
def test_a_case_kit_is_its_mechanism(tmp_path: Path) -> None:
    """Stations, sections and curvatures of a kit's case.json are those of mechanism.toml."""
    run = CliRunner().invoke(main, ["kit", ARM, "--case", "reach", "--out", str(tmp_path / "kit")])
    assert run.exit_code == 0, run.output
    case = next((tmp_path / "kit").rglob("case.json"))
    assert crosscheck.compare(MODELS / ARM, case).equal
    case.write_text(
        case.read_text().replace('"elements": 1', '"elements": 2').replace('"length": 0.5', '"length": 0.55')
    )
    assert ("length of beam", "link forearm") in named(crosscheck.compare(MODELS / ARM, case))


def test_a_link_that_bends_in_one_file_only(tmp_path: Path) -> None:
    """The other holds the beam's shape and masses: then that is all that differs."""
    arm = mechanism(ARM)
    comparison = crosscheck.compare(arm, replace(make_rigid_mechanism(arm), name="held"))
    assert named(comparison) == [("link that bends in A only", "link forearm")]


def mechanism(name: str) -> Mechanism:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return crosscheck.equivalence.sources.describe(MODELS / name).mechanism


@pytest.mark.parametrize("name", [ARM, "flex_two_link"])
def test_a_held_mechanism_has_the_torques_of_a_mesh_that_does_not_bend(name: str) -> None:
    """1e-12: quadrature of a straight beam of one section is exact in both; what differs is the order of additions."""
    flexible = mechanism(name).with_mesh(1, 8)
    mesh, rng = build(flexible), np.random.default_rng(3)
    q, qd, qdd = (rng.standard_normal((5, flexible.nv)) for _ in range(3))
    wrench = build_rigid_trajectory(mesh, compute_rigid_motion(mesh, q, qd, qdd)).wrench
    nodes = [(mesh.joint_node[joint.name], joint.axis) for joint in flexible.joints]
    wanted = np.column_stack([wrench[:, node, 3:] @ axis for node, axis in nodes])
    torques = joint_torques(make_rigid_mechanism(flexible), q, qd, qdd)
    assert np.abs(torques - wanted).max() < 1e-12 * np.abs(wanted).max()
    heavier = joint_torques(
        make_rigid_mechanism(flexible.with_body(flexible.beams[0].name, Body("more", Inertia(1e-3), 1.0))), q, qd, qdd
    )
    assert np.abs(heavier - wanted).max() > 1e-6 * np.abs(wanted).max()


def test_the_frame_at_the_end_of_an_arc() -> None:
    """A quarter circle of radius 2 m about z ends at (2, 2, 0), its tangent along y."""
    section = Section(np.array([0.0]), np.ones((1, 6)), np.ones(1), np.ones((1, 3)))
    arc = Beam(np.pi, section, curvature=np.array([0.0, 0.0, 0.5]), placement=Placement(np.array([1.0, 0.0, 0.0])))
    end = evaluate_section_frame(arc, None)
    assert end.position == pytest.approx([3.0, 2.0, 0.0], abs=1e-12)
    assert end.rotation[:, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
