"""The planar march against the spatial one: the same trajectory, forces and torques, and it is taken only where it may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from flexible_examples import HALF_TURN, STRIP, arm, spatial_tree
from planar_examples import (
    CLOSED_CASES,
    PAPER_CASES,
    SHIFT,
    SOFT_CASES,
    TILT,
    Case,
    branches,
    four_bar,
    hanging,
    named,
    stood,
    two_links,
    with_couplings,
)

import flexinv
from flexinv.analysis import trajectory as kinematics
from flexinv.kernels.so3 import exp_so3
from flexinv.kinematics.mesh import build
from flexinv.model.mechanism import Attachment, Closure, Force, Inertia, Link, Mechanism, Placement, Spring
from flexinv.planar.detection import NotPlanar, Plane, find_plane
from flexinv.planar.solver import PlanarMarch

# Both marches stop where what is left of an increment is rounding: the planar one estimates 1e-16 of the mechanism's length,
# the spatial one squares an increment below 1e-8 (and is mostly far below).  A position is then known to some units in the
# last place, which some hundred steps add up.
POSITION = 1e-12
# Velocities and accelerations are differences of positions over h and h^2: 2e3 and 4e6 times their rounding at h = 1e-3 s.
RATE, ACCELERATION = 1e-10, 1e-9
# Forces of soft beams are 40 N times strains, which are positions (known to 1e-15 m) over 0.05 m, over 0.05 N; of stiff ones
# they are a difference of strains times EA, whose rounding, 1e-16 of a unit strain, is amplified by slopes of the interpolation
# (10) and by dozens of terms.
FORCE, STIFF_FORCE = 2e-11, 1e-14
# At an undeformed start elements in the plane feel nothing at all; in space they feel the rounding of their strains, 1e-16, some
# ten times the interpolation's slopes, times EA = 1.5e6 N over 1e-3 kg of a node: 1e-6 m/s^2 of 600, gone after some steps.
START = 10.0 * ACCELERATION
# Newton in space leaves out how the forces of closures turn, so that the increment below 1e-8 which it stops at is not squared,
# but multiplied by these forces over the stiffness of a step, 1e-3 and less: 1e-11 of the length where trees have 1e-13.
CLOSED = 100.0


def in_parts(name: str) -> float:
    """After a jump that reaches beams the first steps have parts of h/16, whose rates are known to so much less [-]."""
    return 16.0 if "jumps" in name else 1.0


def in_space(monkeypatch: pytest.MonkeyPatch, case: Case, step: float = 1e-3) -> flexinv.Solution:
    with monkeypatch.context() as patch:
        patch.setattr(kinematics, "find_plane", lambda mesh: NotPlanar("asked for"))
        mechanism, motion, options = case()
        return flexinv.solve(mechanism, motion, step, **options)


def in_plane(case: Case, step: float = 1e-3) -> flexinv.Solution:
    mechanism, motion, options = case()
    assert isinstance(find_plane(build(mechanism)), Plane)
    return flexinv.solve(mechanism, motion, step, **options)


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(a - b).max() / np.abs(b).max())


def compare_motion(
    a: flexinv.Solution, b: flexinv.Solution, looser: float = 1.0, acceleration: float = ACCELERATION
) -> None:
    assert difference(a.nodes.x, b.nodes.x) < looser * POSITION
    assert difference(a.nodes.rotation, b.nodes.rotation) < looser * POSITION
    assert difference(a.nodes.v, b.nodes.v) < looser * RATE
    assert difference(a.nodes.omega, b.nodes.omega) < looser * RATE
    assert difference(a.nodes.a, b.nodes.a) < looser * acceleration
    assert difference(a.nodes.alpha, b.nodes.alpha) < looser * acceleration
    assert difference(a.q, b.q) < looser * POSITION
    assert difference(a.balance.elastic, b.balance.elastic) < looser * POSITION


@pytest.mark.parametrize("name", CLOSED_CASES)
def test_soft_loops_move_as_in_space(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Multipliers and accelerations of an instant are found in another way there: in one small system instead of on the tree."""
    a, b = in_plane(CLOSED_CASES[name]), in_space(monkeypatch, CLOSED_CASES[name])
    limit = CLOSED * in_parts(name)
    compare_motion(a, b, limit)
    assert a.loops is not None
    assert b.loops is not None
    assert difference(a.torque_all, b.torque_all) < limit * ACCELERATION
    assert difference(a.reaction, b.reaction) < limit * ACCELERATION
    for closure in a.loops.reaction:
        assert difference(a.loops.reaction[closure], b.loops.reaction[closure]) < limit * ACCELERATION
    power = np.abs(a.torque_all * a.qd).max()
    assert np.abs(a.power_residual).max() < FORCE * power
    assert np.abs(a.unactuated).max() < FORCE * np.abs(a.torque).max()


@pytest.mark.parametrize("name", ["four-bar", "four-bar, static", "tilted rail"])
def test_damped_loops_move_as_in_space(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Angular accelerations, too, as far as moments go: a last section has a sixth of the others' rotary inertia.

    What Newton in space leaves of moments, 3e-10 of the largest, turns that section by 5e-7 of its largest acceleration.
    """

    def case() -> tuple[Mechanism, flexinv.Motion, dict[str, object]]:
        m, motion, options = CLOSED_CASES[name]()
        return replace(m, links=tuple(retarded(link, 1e-4) for link in m.links)), motion, options

    a, b = in_plane(case), in_space(monkeypatch, case)
    compare_closed_motion(a, b)
    dissipated = a.balance.dissipated
    assert difference(dissipated, b.balance.dissipated) < CLOSED * ACCELERATION
    undamped = in_plane(CLOSED_CASES[name])
    assert difference(a.nodes.x, undamped.nodes.x) > 1e-6  # damping is seen


def test_a_coupled_loop_moves_as_in_space(monkeypatch: pytest.MonkeyPatch) -> None:
    """Angular accelerations as far as moments go, as of a damped loop: a last section turns easily here, too."""

    def case() -> tuple[Mechanism, flexinv.Motion, dict[str, object]]:
        m, motion, options = CLOSED_CASES["four-bar"]()
        return with_couplings(m), motion, options

    a, b = in_plane(case), in_space(monkeypatch, case)
    compare_closed_motion(a, b)
    plain = in_plane(CLOSED_CASES["four-bar"])
    assert difference(a.tip["coupler"], plain.tip["coupler"]) > 1e-3  # couplings are seen


def compare_closed_motion(a: flexinv.Solution, b: flexinv.Solution) -> None:
    assert difference(a.nodes.x, b.nodes.x) < CLOSED * POSITION
    assert difference(a.nodes.v, b.nodes.v) < CLOSED * RATE
    assert difference(a.nodes.a, b.nodes.a) < CLOSED * ACCELERATION
    assert difference(a.torque_all, b.torque_all) < CLOSED * ACCELERATION
    moments = (np.einsum("nij,snj->sni", s.mesh.inertia, s.nodes.alpha) for s in (a, b))
    largest = max(np.abs(internal[..., 3:]).max() for internal in b.internal.values())
    assert np.abs(np.subtract(*moments)).max() < CLOSED * FORCE * largest


def retarded(link: Link, time: float) -> Link:
    """The link with Kelvin-Voigt damping of a retardation time [s] in its beam."""
    if link.beam is None:
        return link
    section = link.beam.section
    return replace(link, beam=replace(link.beam, section=replace(section, damping=time * section.stiffness)))


@pytest.mark.parametrize("name", SOFT_CASES)
def test_soft_mechanisms_move_as_in_space(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = in_plane(SOFT_CASES[name]), in_space(monkeypatch, SOFT_CASES[name])
    compare_motion(a, b, in_parts(name))
    force = FORCE * in_parts(name)  # what damps follows the rates
    assert difference(a.torque_all, b.torque_all) < force
    assert difference(a.reaction, b.reaction) < force
    for beam in a.internal:
        assert difference(a.internal[beam], b.internal[beam]) < force
    for joint in a.wrench:
        assert difference(a.wrench[joint], b.wrench[joint]) < force
    power = np.abs(a.torque_all * a.qd).max()
    assert np.abs(a.power_residual).max() < FORCE * power
    assert np.abs(a.momentum_residual).max() < FORCE * np.abs(b.internal[next(iter(b.internal))]).max()


@pytest.mark.parametrize("name", PAPER_CASES)
def test_the_papers_arms_move_as_in_space(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = in_plane(PAPER_CASES[name]), in_space(monkeypatch, PAPER_CASES[name])
    compare_motion(a, b, acceleration=START)
    stiffness = STRIP.stiffness[0, 0]
    assert difference(a.torque_all, b.torque_all) < FORCE
    assert np.abs(a.reaction - b.reaction).max() < STIFF_FORCE * stiffness * 0.4
    for beam in a.internal:
        assert np.abs(a.internal[beam] - b.internal[beam]).max() < STIFF_FORCE * stiffness


def test_dry_friction_of_a_passive_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Smoothed friction bends within 1e-3 rad/s: there the square of the spatial march's last increment is 1e-7, not rounding."""

    def case() -> tuple[Mechanism, flexinv.Motion, dict[str, object]]:
        return branches(friction=1e-4), named(root=0.8, leaf=0.5, twig=0.02), {"start": {"swing": 0.2}}

    a, b = in_plane(case), in_space(monkeypatch, case)
    assert difference(a.nodes.x, b.nodes.x) < 1e-9
    assert difference(a.torque_all, b.torque_all) < 1e-6


@pytest.mark.parametrize("plane", [True, False])
def test_newton_may_stop_early(plane: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it leaves of positions is below the tolerance at every step; some hundred steps add that up, with damping."""
    if not plane:
        monkeypatch.setattr(kinematics, "find_plane", lambda mesh: NotPlanar("asked for"))
    exact = flexinv.solve(arm(), HALF_TURN, 1e-3)
    early = flexinv.solve(arm(), HALF_TURN, 1e-3, tolerance=1e-9)
    assert early.iterations.sum() < exact.iterations.sum()
    assert 0.0 < difference(early.nodes.x, exact.nodes.x) < 100 * 1e-9


@pytest.mark.parametrize("tolerance", [0.0, -1e-9, 1e-3, float("nan")])
def test_a_tolerance_that_cannot_be(tolerance: float) -> None:
    with pytest.raises(flexinv.InputError, match=r"tolerance = .*: expected a part of the mechanism's length above 0"):
        flexinv.solve(arm(), HALF_TURN, 1e-3, tolerance=tolerance)


def test_a_slightly_other_beam_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The comparison can fail: a bending stiffness off by 1e-9."""
    other = replace(STRIP, stiffness=STRIP.stiffness * np.array([1, 1, 1, 1, 1, 1 + 1e-9]))
    a = in_plane(PAPER_CASES["one link, 1 x order 4"])
    b = in_space(monkeypatch, lambda: (arm(section=other), HALF_TURN, {}))
    assert difference(a.nodes.x, b.nodes.x) > 10 * POSITION
    assert difference(a.torque_all, b.torque_all) > 10 * FORCE


def _with_closure(place: np.ndarray) -> Mechanism:
    m = four_bar()
    ends = replace(m.closures[0].second, placement=Placement(place))
    return replace(m, closures=(replace(m.closures[0], second=ends),))


@cache
def _turned(psi: tuple[float, float, float]) -> Placement:
    return Placement(np.zeros(3), exp_so3(np.array(psi)))


def _with_joint(mechanism: Mechanism, index: int, **change: object) -> Mechanism:
    joints = list(mechanism.joints)
    joints[index] = replace(joints[index], **change)  # type: ignore[arg-type]
    return replace(mechanism, joints=tuple(joints))


def _with_body(mechanism: Mechanism, index: int, inertia: Inertia) -> Mechanism:
    links = list(mechanism.links)
    bodies = (replace(links[index].bodies[0], inertia=inertia),)
    links[index] = replace(links[index], bodies=bodies)
    return replace(mechanism, links=tuple(links))


def _with_beam(mechanism: Mechanism, **change: object) -> Mechanism:
    link = mechanism.links[0]
    assert link.beam is not None
    changed = replace(link, beam=replace(link.beam, **change))  # type: ignore[arg-type]
    return replace(mechanism, links=(changed, *mechanism.links[1:]))


def _pulled(mechanism: Mechanism) -> Mechanism:
    end = Attachment("one", Placement())
    return replace(mechanism, springs=(Spring("s", Attachment("world", Placement()), end, 1.0, 0.1),))


def _pushed(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, forces=(Force("f", Attachment("one", Placement()), np.zeros((1, 6))),))


PAIR = two_links(1, 2)


def _with_section(m: Mechanism, row: int, column: int) -> Mechanism:
    """The first beam with a coupling of a millionth of its strengths."""
    link = m.links[0]
    assert link.beam is not None
    section = link.beam.section
    stiffness = section.stiffness_matrices.copy()
    small = 1e-6 * np.sqrt(section.stiffness[:, row] * section.stiffness[:, column])
    stiffness[:, row, column] = stiffness[:, column, row] = small
    made = replace(link, beam=replace(link.beam, section=replace(section, stiffness=stiffness)))
    return replace(m, links=(made, *m.links[1:]))


def _with_mass_centre(m: Mechanism, z: float) -> Mechanism:
    """The last beam with its mass above the plane."""
    link = m.links[-1]
    assert link.beam is not None
    section = replace(link.beam.section, mass_centre=np.tile([0.0, z], (len(link.beam.section.stations), 1)))
    return replace(m, links=(*m.links[:-1], replace(link, beam=replace(link.beam, section=section))))


SPATIAL: dict[str, Callable[[], Mechanism]] = {
    "it has couplings": lambda: replace(
        four_bar(),
        closures=(
            Closure("g", "coupling", Attachment("world"), Attachment("world"), factors=(("A", 1.0), ("D", 2.0))),
        ),
    ),
    "the frames of closure 'C' do not lie in the plane": lambda: _with_closure(np.array([0.2, 0.0, 1e-6])),
    "it has springs": lambda: _pulled(PAIR),
    "it has applied forces": lambda: _pushed(PAIR),
    "it has springs in joints": lambda: _with_joint(PAIR, 1, stiffness=1.0),
    "gravity pulls out of the plane": lambda: replace(PAIR, gravity=np.array([0.0, -9.0, 1e-9])),
    "the axis of link 'elbow' is not normal to the plane": lambda: _with_joint(PAIR, 1, axis=np.array([0.0, 0.6, 0.8])),
    "the joint of link 'elbow' turns in space": lambda: _with_joint(PAIR, 1, kind="spherical"),
    "link 'slider' slides out of the plane": lambda: _with_joint(branches(), 3, axis=np.array([0.0, 0.6, 0.8])),
    "link 'elbow' reaches out of the plane": lambda: _with_joint(PAIR, 1, placement=Placement(np.array([0, 0, 1e-6]))),
    "the inertia of link 'elbow' is not symmetric": lambda: _with_body(
        PAIR, 1, Inertia(1.0, np.zeros(3), np.array([[1.0, 0, 1e-6], [0, 1.0, 0], [1e-6, 0, 1.0]]))
    ),
    "the section or curvature of beam 'link'": lambda: _with_beam(arm(), placement=_turned((0.1, 0.0, 0.0))),
    "curvature of beam 'link' is not symmetric": lambda: _with_beam(arm(), curvature=np.array([1e-6, 0.0, 0.0])),
    "the section of beam 'one' couples strains in the plane with strains out of it": lambda: _with_section(PAIR, 4, 5),
    "couples strains in the plane with": lambda: _with_section(PAIR, 0, 2),
    "link 'two' reaches out of the plane": lambda: _with_mass_centre(PAIR, 1e-6),
    "link 'one' reaches out of the plane": lambda: _with_beam(PAIR, curvature=np.array([0.0, 1e-3, 0.0])),
    "it has neither revolute joints nor beams": lambda: Mechanism("nothing", (), ()),
    "link 'base' reaches out of the plane": spatial_tree,
}


@pytest.mark.parametrize("reason", SPATIAL)
def test_what_stands_out_is_solved_in_space(reason: str) -> None:
    plane = find_plane(build(SPATIAL[reason]()))
    assert isinstance(plane, NotPlanar)
    assert reason in plane.reason


@pytest.mark.parametrize("mechanism", [PAIR, branches(), hanging()])
def test_a_plane_is_found_wherever_it_lies(mechanism: Mechanism) -> None:
    plane = find_plane(build(stood(mechanism, TILT, SHIFT)))
    assert isinstance(plane, Plane)
    normal = exp_so3(TILT)[:, 2]
    np.testing.assert_allclose(plane.axes[:, 2], normal, rtol=0, atol=1e-15)  # an ulp of 1 and its rounding
    assert plane.height == pytest.approx(normal @ SHIFT + 0.0, abs=1e-15)


def test_a_fixed_beam_finds_its_plane_by_gravity() -> None:
    """Without a revolute joint the section's principal planes are tried, one after the other."""
    for gravity in ([0.0, -9.81, 0.0], [0.0, 0.0, -9.81]):
        held = replace(arm(gravity=tuple(gravity)), joints=(replace(arm().joints[0], kind="fixed"),))  # type: ignore[arg-type]
        assert isinstance(find_plane(build(held)), Plane)


def test_what_the_march_works_on_begins_with_lines_of_the_cache() -> None:
    """Where its arrays began 16 bytes off, a step took a tenth longer: vectors of eight numbers lay in two lines each."""
    own = PlanarMarch.build_for(build(arm(3)), ())
    s = own.system
    parts = [*s.state, *s.frames, *s.work, s.elements.constants, s.factors.inverse, s.factors.x]
    assert all(part.ctypes.data % 64 == 0 for part in parts if part.size and part.dtype == float)
    assert not any(part.any() for part in s.state)
