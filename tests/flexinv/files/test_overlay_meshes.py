"""A mesh in place of a link of a URDF: geometry stays, joints hang on interfaces, and errors say what to write."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion
from flexinv.model.mechanism import Mechanism
from flexinv.parts.craig_bampton import compute_reduction
from flexinv.typing import Array

MODEL = "ur5_meshed_forearm"


def find_tip(mechanism: Mechanism, q: Array) -> Array:
    mesh = build(mechanism)
    nothing = np.zeros((1, mechanism.nv))
    motion = compute_rigid_motion(mesh, q[None], nothing, nothing)
    return motion.x[0, mesh.joint_node["wrist_3_joint"]]


def test_geometry_is_that_of_the_urdf(root: Path) -> None:
    """Undeformed, the wrist is where the URDF has it; the link's mass is that of the mesh, and a note says so."""
    rigid, meshed = (load_mechanism(root / "models" / name) for name in ("ur5", MODEL))
    q = np.linspace(-1.0, 1.2, rigid.nq)
    assert (
        np.abs(find_tip(rigid, q) - find_tip(meshed, q)).max() < 1e-9
    )  # the mean of the mesh's nodes, six digits each
    link = meshed.link_of["forearm_link"]
    assert link.bodies == ()
    assert link.part is not None
    mass = compute_reduction(link.part).mass.sum()
    volume = np.pi * 3e-3 * (76e-3 + 54e-3 - 2 * 3e-3) / 2 * 0.39225
    assert 0.7 * volume * 1150 < mass < 0.9 * volume * 1150  # holes take 21 % of it
    assert any("its URDF inertia (2.275 kg) is replaced" in note for note in meshed.notes)


def load_changed(root: Path, folder: Path, before: str, after: str) -> Mechanism:
    shutil.copytree(root / "models" / MODEL, folder, dirs_exist_ok=True)
    text = (folder / "mechanism.toml").read_text()
    assert before in text
    (folder / "mechanism.toml").write_text(text.replace(before, after))
    return load_mechanism(folder)


def test_own_inertia_may_stay_at_the_root(root: Path, tmp_path: Path) -> None:
    arm = load_changed(root, tmp_path, 'own_inertia = "replaced"', 'own_inertia = "at_root"')
    (body,) = arm.link_of["forearm_link"].bodies
    assert body.inertia.mass == 2.275
    assert body.interface == ""


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (
            'wrist_1_joint = "wrist"',
            "",
            "key joints given: interfaces of none expected: an interface for each joint whose parent is forearm_link: "
            'wrist_1_joint write: joints = { wrist_1_joint = "wrist" }',
        ),
        (
            'wrist_1_joint = "wrist"',
            'wrist_1_joint = "rist"',
            'given: wrist_1_joint = "rist" expected: an interface of the mesh: elbow, wrist write: wrist_1_joint = "wrist"',
        ),
        (
            "[overlay.links.forearm_link.mesh]",
            "[overlay.links.forearm_link]\nmass_kg = 1\n\n[overlay.links.forearm_link.mesh]",
            "key mass_kg given: mass_kg beside a mesh expected: no mass of its own",
        ),
        (
            "[overlay.links.forearm_link.mesh]",
            "[overlay.links.forearm_link]\ntip_m = [0, 0, 1]\n\n[overlay.links.forearm_link.mesh]",
            "key tip_m given: tip_m = [0.0, 0.0, 1.0] beside a mesh expected: no tip",
        ),
        (
            "[overlay.links.forearm_link.mesh]",
            '[overlay.links.forearm_link.beam]\nsection = "s"\nto_joint = "wrist_1_joint"\ny_axis = [0, 1, 0]\n'
            'own_inertia = "replaced"\n\n[overlay.links.forearm_link.mesh]',
            "key mesh given: a beam and a mesh expected: one of both",
        ),
        (
            'set = "WRIST"',
            'set = "WRISTS"',
            'expected: a set of the file: ALL_NODES, ELBOW, WRIST, SHELL write: set = "WRIST"',
        ),
    ],
)
def test_what_cannot_be_laid_over_is_said(root: Path, tmp_path: Path, before: str, after: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        load_changed(root, tmp_path, before, after)
    words = " ".join(str(caught.value).split())
    assert "overlay.links.forearm_link" in words
    assert said in words, words
