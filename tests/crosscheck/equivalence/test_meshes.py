"""Links that are meshes before `compare`, and in case kits: the same part in other axes is the same, another part is named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from part_examples import make_bar

import flexinv
from crosscheck.doors.command import ProgramAdapter
from crosscheck.doors.record import RecordedAdapter
from crosscheck.equivalence.compare import compare
from crosscheck.kit.lift import lift_kit
from crosscheck.kit.parts import collect_arrays
from crosscheck.kit.write import write
from crosscheck.run.child import ask_for_refusal
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism, Placement
from flexinv.model.part import Material, MeshedPart, SparseMatrix
from flexinv.typing import Array

PLASTIC = Material.build_isotropic(3e9, 0.35, 1200.0)
LOAD = Inertia(0.4, np.array([0.05, 0.0, 0.02]), 1e-3 * np.eye(3))
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


STRAIGHT = np.eye(3)


def make_arm(part: MeshedPart, turn: Array = STRAIGHT) -> Mechanism:
    """A meshed link on a hub with a hinge and a load at its tip; turn : of the link's frame against the hub's own."""
    links = (Link("bar", part=part), Link("hand", (Body("load", LOAD),)))
    joints = (
        Joint("hub", "revolute", "world", "bar", placement=Placement(np.zeros(3), turn)),
        Joint(
            "wrist", "revolute", "bar", "hand",
            placement=Placement(np.zeros(3), turn.T), axis=np.array([0.0, 1.0, 0.0]), interface="tip",
        ),
    )  # fmt: skip
    return Mechanism("arm", links, joints)


def make_beam_like(**data: object) -> MeshedPart:
    return make_bar("hexahedron20", 0.4, 0.03, (4, 1, 1), PLASTIC, **{"modes": 4, "stiffening": False} | data)  # type: ignore[arg-type]


def turn_part(part: MeshedPart) -> MeshedPart:
    """The same part in axes that are turned by a quarter about z: coordinates of all points change, and nothing else."""
    interfaces = tuple(replace(one, origin=one.origin @ TURN) for one in part.interfaces)
    return replace(part, points=part.points @ TURN, interfaces=interfaces)


def make_case() -> Case:
    motion = flexinv.Motion.point_to_point({"hub": 0.0, "wrist": 0.0}, {"hub": 0.6, "wrist": 0.8}, duration=0.2)
    return Case("turn", "A turn", motion, 1e-3, 0.2, 5e-3, ("torque",), (), initial="static")


def test_a_part_in_other_axes_and_with_more_modes_is_the_same() -> None:
    part = make_beam_like()
    other = replace(turn_part(part), modes=6)
    found = compare(make_arm(part), make_arm(other, TURN))
    assert found.equal, found.differences


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda p: with_material(p, 1.01 * 3e9, 1200.0), "free frequency of mesh"),
        (lambda p: with_material(p, 3e9, 1.01 * 1200.0), "mass"),
        (lambda p: make_beam_like(tie="average"), "stiffness of mesh at tip"),
        (lambda p: replace(p, retardation=1e-5), "retardation of mesh"),
        (lambda p: replace(p, stiffening=True), "geometric stiffening of mesh"),
    ],
)
def test_another_part_is_named(change: Callable[[MeshedPart], MeshedPart], named: str) -> None:
    part = make_beam_like()
    found = compare(make_arm(part), make_arm(change(part)))
    assert not found.equal
    assert any(named in one.cause for one in found.differences), [one.cause for one in found.differences]


def with_material(part: MeshedPart, young: float, density: float) -> MeshedPart:
    material = Material.build_isotropic(young, 0.35, density)
    return replace(part, cells=tuple(replace(cells, material=material) for cells in part.cells))


def test_a_mesh_beside_a_rigid_link_is_named() -> None:
    arm = make_arm(make_beam_like())
    stiff = replace(
        arm,
        links=(Link("bar", (Body("b", Inertia(0.4)),)), arm.links[1]),
        joints=(arm.joints[0], replace(arm.joints[1], interface="", placement=Placement(np.array([0.4, 0, 0])))),
    )
    causes = [one.cause for one in compare(arm, stiff).differences]
    assert "link that bends in A only" in causes


def test_a_kit_holds_the_mesh_and_gives_the_torque_again(tmp_path: Path) -> None:
    """Cells come back bit by bit, matrices to rounding; an archive of another case is refused."""
    part = make_beam_like(retardation=2e-5)
    case = make_case()
    arm = make_arm(part)
    write(arm, case, tmp_path / "kit")
    assert (tmp_path / "kit" / "case.json").read_bytes() == _written_again(arm, case, tmp_path).read_bytes()
    lifted = lift_kit(tmp_path / "kit" / "case.json").mechanism
    before, after = (flexinv.solve(one, case.motion, step=2e-3, initial="static") for one in (arm, lifted))
    np.testing.assert_array_equal(before.torque, after.torque)
    archive = tmp_path / "kit" / "parts" / "part_1.npz"
    with np.load(archive) as arrays:
        held = dict(arrays)
    np.savez(archive, **held | {"points": 1.001 * held["points"]})  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"not the arrays of this case\.json"):
        lift_kit(tmp_path / "kit" / "case.json")
    archive.unlink()
    with pytest.raises(InputError, match="expected the archive that crosscheck kit writes"):
        lift_kit(tmp_path / "kit" / "case.json")


def _written_again(arm: Mechanism, case: Case, folder: Path) -> Path:
    write(arm, case, folder / "again")
    assert (folder / "again" / "parts" / "part_1.npz").read_bytes() == (
        folder / "kit" / "parts" / "part_1.npz"
    ).read_bytes()
    return folder / "again" / "case.json"


def test_matrices_come_back_as_matrices_and_an_archive_stays_in_its_folder(tmp_path: Path) -> None:
    part = make_beam_like()
    arrays = collect_arrays(part)
    size = 3 * len(part.points)
    mass, stiffness = (
        SparseMatrix(size, *(arrays[f"{name}_{entry}"] for entry in ("row", "column", "value")))
        for name in ("mass", "stiffness")
    )
    ready = replace(part, cells=(), mass=mass, stiffness=stiffness)
    write(make_arm(ready), make_case(), tmp_path / "kit")
    lifted = lift_kit(tmp_path / "kit" / "case.json").mechanism
    assert compare(lifted, make_arm(part)).equal
    told = json.loads((tmp_path / "kit" / "case.json").read_text())
    told["mechanism"]["links"][0]["part"]["arrays"] = "../part_1.npz"
    shutil.copy(tmp_path / "kit" / "parts" / "part_1.npz", tmp_path / "part_1.npz")
    (tmp_path / "kit" / "case.json").write_text(json.dumps(told))
    with pytest.raises(InputError, match="leads out of the folder"):
        lift_kit(tmp_path / "kit" / "case.json")


def test_programs_and_records_are_asked_for_meshed_links(tmp_path: Path) -> None:
    program = ProgramAdapter("mine", "arm", {"command": ["true"], "cases": ["*"]})
    for adapter in (program, RecordedAdapter(tmp_path, there=True)):
        assert "meshes" not in str(ask_for_refusal(adapter, make_arm(make_beam_like()), make_case(), "mine"))
