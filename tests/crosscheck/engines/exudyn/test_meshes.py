"""Links that are meshes in Exudyn: matrices of scikit-fem's own, a basis of Exudyn's own, and the torques of both engines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from part_examples import make_bar, make_block, make_part

import flexinv
from crosscheck.engines.exudyn import adapter as exudyn
from crosscheck.engines.exudyn.certificate import certify as certify_exudyn
from crosscheck.engines.exudyn.models.meshes import ELEMENTS, _assemble, build_fem
from crosscheck.engines.flexinv.certificate import certify as certify_flexinv
from crosscheck.engines.pinocchio import adapter as pinocchio
from crosscheck.measures.certificate import checks
from crosscheck.run.child import ask_for_refusal
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Body, Closure, Inertia, Joint, Link, Mechanism, Placement
from flexinv.model.part import Material, MeshedPart
from flexinv.parts.craig_bampton import compute_reduction
from flexinv.parts.part_matrices import build_part_matrices

GLASS_FILLED = Material.build_isotropic(20e9, 0.35, 1600.0)
LOAD = Inertia(0.4, np.array([0.05, 0.0, 0.02]), 1e-3 * np.eye(3))


def make_arm(part: MeshedPart) -> Mechanism:
    """A meshed link that turns about z and carries a hinge and a load at its end."""
    links = (Link("bar", part=part), Link("hand", (Body("load", LOAD),)))
    joints = (
        Joint("hub", "revolute", "world", "bar"),
        Joint("wrist", "revolute", "bar", "hand", axis=np.array([0.0, 1.0, 0.0]), interface="tip"),
    )
    return Mechanism("arm", links, joints)


def make_case() -> Case:
    motion = flexinv.Motion.point_to_point({"hub": 0.0, "wrist": 0.0}, {"hub": 0.6, "wrist": 0.8}, duration=0.2)
    return Case("turn", "A turn", motion, 5e-4, 0.2, 5e-3, ("torque",), (), initial="static")


@pytest.mark.parametrize("waves", [0.0, 0.004])
@pytest.mark.parametrize("kind", ELEMENTS)
def test_scikit_fem_has_the_same_matrices(kind: str, waves: float) -> None:
    """Its own bases and mappings, on a sheared block, its edges straight or curved [m]: rounding of other orders of sums."""
    points, cells = make_block(kind, (0.3, 0.1, 0.05), (2, 1, 1))
    points = points @ np.array([[1, 0.2, 0], [0, 1, 0.1], [0, 0, 1]])
    part = make_part(points, cells, kind, GLASS_FILLED)
    part = replace(part, points=points + waves * np.sin(40 * points[:, [1, 2, 0]]))
    own = build_part_matrices(part)
    used, mass, stiffness = _assemble(part)
    assert np.array_equal(used, own.used)
    assert abs(stiffness - own.stiffness).max() < 1e-12 * abs(own.stiffness).max()
    assert abs(mass - scipy.sparse.kron(own.mass, scipy.sparse.eye_array(3))).max() < 1e-12 * own.mass.max()


@pytest.mark.parametrize("tie", ["rigid", "average"])
def test_exudyns_own_basis_has_the_same_frequencies(tie: str) -> None:
    part = make_bar("tetra10", length=0.3, side=0.05, count=(3, 1, 1), material=GLASS_FILLED, tie=tie, modes=3)
    fem, _ = build_fem(part)
    found = np.sort(np.asarray(fem.eigenValues))[:3]
    squared = (2 * np.pi * compute_reduction(part).fixed) ** 2
    roots = found if found[0] > 0.1 * squared[0] else found**2
    assert roots == pytest.approx(squared, rel=1e-6)


def test_a_mesh_is_certified_by_its_stiffness_and_its_frequencies() -> None:
    """Exudyn's own basis of scikit-fem's own matrices; another tie or a modulus one per cent off is another mesh."""
    bar = make_bar("hexahedron20", 0.4, 0.03, (4, 1, 1), GLASS_FILLED, modes=4, stiffening=False)
    theirs = certify_exudyn(make_arm(bar), make_case(), "exudyn-ge")
    looser = make_bar("hexahedron20", 0.4, 0.03, (4, 1, 1), GLASS_FILLED, modes=4, stiffening=False, tie="average")
    stiffer = Material.build_isotropic(1.01 * 20e9, 0.35, 1600.0)
    harder = replace(bar, cells=tuple(replace(cells, material=stiffer) for cells in bar.cells))
    holds = {}
    for name, part in (("same", bar), ("tie", looser), ("modulus", harder)):
        ours = certify_flexinv(make_arm(part), make_case(), "flexinv")
        lines = checks("arm", "turn", "exudyn-ge", theirs, ours)
        holds[name] = {line.what: line.holds for line in lines if "of meshes" in line.what}
    lines = ("stiffness of meshes at interfaces", "frequencies of meshes")
    assert holds["same"] == dict.fromkeys(lines, True)
    assert holds["tie"] == holds["modulus"] == dict.fromkeys(lines, False)


def test_both_give_one_torque_and_one_certificate() -> None:
    """To 0.1 % of the ranges, of which steps that are half as long change a third."""
    bar = make_bar("hexahedron20", 0.4, 0.03, (4, 1, 1), GLASS_FILLED, modes=4, stiffening=False, retardation=2e-5)
    arm = make_arm(bar)
    case = make_case()
    record = exudyn.run(arm, case, "exudyn-ge", {"error": False, "step": 2.5e-4})
    solution = flexinv.solve(arm, case.motion, step=6.25e-5, initial="static")
    rows = np.searchsorted(solution.time, record.time - 1e-9)
    apart = [
        np.abs(record.series[f"torque/{name}"].values - solution.torque[rows, k]).max() / np.ptp(solution.torque[:, k])
        for k, name in enumerate(solution.torque_names)
    ]
    assert max(apart) < 1e-3
    assert certify_exudyn(arm, case, "exudyn-ge").masses == pytest.approx(certify_flexinv(arm, case, "flexinv").masses)
    both = [certify(arm, case, "exudyn-ge").inertias["hub"] for certify in (certify_exudyn, certify_flexinv)]
    np.testing.assert_allclose(both[0], both[1], rtol=0, atol=1e-10 * np.abs(both[1]).max())
    softer = replace(
        bar, cells=tuple(replace(c, material=Material.build_isotropic(18e9, 0.35, 1600.0)) for c in bar.cells)
    )
    wrong = flexinv.solve(make_arm(softer), case.motion, step=5e-4, initial="static")
    part = np.abs(wrong.torque - solution.torque[::8]).max(axis=0) / np.ptp(solution.torque, axis=0)
    assert part.max() > 5e-3  # a modulus that is a tenth too small is seen


def make_slider_crank(rod: MeshedPart) -> Mechanism:
    """A crank of 0.1 m that drives a slider along x by a meshed rod of 0.3 m, closed at the rod's far interface."""
    crank = Inertia(0.3, np.array([0.05, 0.0, 0.0]), 1e-4 * np.eye(3))
    links = (Link("crank", (Body("crank", crank),)), Link("rod", part=rod), Link("slider", (Body("s", Inertia(0.3)),)))
    at_pin = Placement(np.array([0.1, 0.0, 0.0]))
    joints = (
        Joint("main", "revolute", "world", "crank"),
        Joint("pin", "revolute", "crank", "rod", placement=at_pin, actuated=False),
        Joint("slide", "prismatic", "world", "slider", axis=np.array([1.0, 0.0, 0.0]), actuated=False),
    )
    closure = Closure("wrist", "revolute", Attachment("rod", interface="tip"), Attachment("slider"))
    return Mechanism("crank", links, joints, closures=(closure,))


def test_a_rod_in_a_loop_has_the_torque_and_the_reaction_of_exudyn() -> None:
    """A closure on an interface, in space; to 0.1 % of the ranges, most of it the longer steps here."""
    rod = make_bar("hexahedron20", 0.3, 0.02, (4, 1, 1), GLASS_FILLED, modes=4, stiffening=False, retardation=2e-5)
    mechanism = make_slider_crank(rod)
    motion = flexinv.Motion.point_to_point({"main": 0.0}, {"main": 1.5}, duration=0.2)
    start = {"pin": 0.0, "slide": 0.4}
    case = Case("turn", "", motion, 2e-4, 0.2, 5e-3, ("torque",), (), initial="static", start=start)
    record = exudyn.run(mechanism, case, "exudyn-ge", {"error": False, "step": 5e-4})
    solution = flexinv.solve(mechanism, case.motion, step=2e-4, initial="static", start=start)
    rows = np.searchsorted(solution.time, record.time - 1e-9)
    assert solution.loops is not None
    mine = {"torque/main": solution.torque[:, 0], "reaction/wrist/fx": solution.loops.reaction["wrist"][:, 0]}
    for name, values in mine.items():
        assert np.abs(record.series[name].values - values[rows]).max() < 1e-3 * np.ptp(values), name
    assert np.abs(solution.balance.meshes).max() < 1e-12 * np.ptp(solution.torque)
    assert "exudyn-ge alone" in str(exudyn.unsupported(mechanism, case, "exudyn-ancf"))
    assert "rigid bodies only; flexible here: rod" in str(exudyn.unsupported(mechanism, case, "exudyn-dae"))


def test_what_no_floating_frame_has_is_said() -> None:
    arm, case = make_arm(make_bar("tetra", count=(2, 1, 1), modes=1)), make_case()
    assert "stiffens under loads along it" in str(exudyn.unsupported(arm, case, "exudyn-ge"))
    assert "exudyn-ge alone" in str(exudyn.unsupported(arm, case, "exudyn-ancf"))
    assert "rigid bodies only; flexible here: bar" in str(exudyn.unsupported(arm, case, "exudyn-dae"))
    assert "no links that are meshes yet" in str(ask_for_refusal(pinocchio, arm, case, "pinocchio"))
    wedge = make_arm(make_bar("wedge", count=(2, 1, 1), modes=1, stiffening=False))
    assert "wedge" in str(exudyn.unsupported(wedge, case, "exudyn-ge"))
