"""Links that are meshes: the beam in the slender limit, the rigid limit, both ways to the torque, loops, and large turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from part_examples import ALUMINIUM, make_bar, make_block, make_part, make_same_beam

import flexinv
from flexinv.analysis.solution import Solution
from flexinv.dynamics.generalized_alpha import DYNAMIC, Scheme
from flexinv.dynamics.initial_state import begin_undeformed
from flexinv.dynamics.solver import Solver
from flexinv.errors import ConvergenceError, InputError, ModelWarning
from flexinv.kinematics.mesh import build
from flexinv.linearized.rest_position import compute_rest_matrices, find_rest_position
from flexinv.model.mechanism import Attachment, Body, Closure, Force, Inertia, Joint, Link, Mechanism, Placement
from flexinv.model.part import Material, MeshedPart

SOFT = Material.build_isotropic(70e9, 0.0, 2700.0)  # without Poisson's effect, as a beam is
ONE = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, duration=0.3)
LOAD = Inertia(0.3, np.array([0.0, 0.01, 0.02]), 1e-4 * np.eye(3))
Y = np.array([0.0, 1.0, 0.0])


def make_arm(link: Link, axis: np.ndarray = Y) -> Mechanism:
    return Mechanism("arm", (link,), (Joint("hub", "revolute", "world", link.name, axis=axis),))


def make_two(first: Link, second: Link, **end: object) -> Mechanism:
    """Two links that turn about different axes, a load off the axis at the end."""
    joints = (
        Joint("hub", "revolute", "world", first.name),
        Joint("elbow", "revolute", first.name, second.name, axis=Y, **end),
    )
    return Mechanism("two", (first, second), joints)


def solve_two(mechanism: Mechanism, **settings: object) -> Solution:
    motion = flexinv.Motion.point_to_point({"hub": 0.0, "elbow": 0.0}, {"hub": 1.0, "elbow": -1.2}, duration=0.3)
    return flexinv.solve(mechanism, motion, step=1e-3, **settings)


def make_bars(**data: object) -> Mechanism:
    first = Link("a", part=make_bar(count=(5, 1, 1), modes=4, **data))
    second = Link(
        "b", (Body("load", LOAD, interface="tip"),), part=make_bar(count=(5, 1, 1), length=0.5, modes=4, **data)
    )
    return make_two(first, second, interface="tip")


def list_ranges(solution: Solution) -> np.ndarray:
    return np.ptp(solution.torque, axis=0)


def test_a_slender_bar_is_a_beam() -> None:
    """Without Poisson's effect frequency, torque and tip are the beam's to 1e-4, of a motion that leaves a bar swinging.

    The mesh is 1.9e-5 stiffer, over 48 rad of swinging; shapes that are not kept and steps of 0.25 ms are the rest of 6e-5.
    """
    mesh = make_arm(Link("bar", part=make_bar("hexahedron27", count=(40, 2, 2), material=SOFT)))
    beam = make_arm(Link("bar", beam=make_same_beam()))
    found, exact = (flexinv.natural_modes(m, count=4).frequency for m in (mesh, beam))
    assert np.abs(found / exact - 1)[:2].max() < 1e-4
    solutions = [flexinv.solve(m, ONE, step=2.5e-4, initial="static") for m in (mesh, beam)]
    apart = np.abs(solutions[0].torque - solutions[1].torque).max()
    assert apart < 1e-4 * list_ranges(solutions[1])
    assert np.abs(solutions[0].tip["bar"] - solutions[1].tip["bar"]).max() < 1e-5  # of 3 mm that it bends


def test_a_thick_bar_is_less_of_a_beam() -> None:
    """With Poisson's effect rigid ends hold the section: frequency and torque are off by a part that falls as h / L does.

    The motion, of eight periods and smooth to the third derivative, leaves little swinging, of which phases would drift apart.
    """
    off = []
    for side, count in ((0.04, (20, 2, 2)), (0.02, (40, 2, 2)), (0.01, (80, 2, 2))):
        mesh = make_arm(Link("bar", part=make_bar("hexahedron27", side=side, count=count, material=ALUMINIUM)))
        beam = make_arm(Link("bar", beam=make_same_beam(side=side, poisson=0.3)))
        frequency = [flexinv.natural_modes(m, count=2).frequency[0] for m in (mesh, beam)]
        duration = 8.0 / frequency[1]
        motion = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 1.0}, duration, law="septic")
        torque = [flexinv.solve(m, motion, step=duration / 600, initial="static").torque for m in (mesh, beam)]
        off.append((frequency[0] / frequency[1] - 1.0, np.abs(torque[0] - torque[1]).max() / np.ptp(torque[1])))
    frequencies, torques = np.array(off).T
    assert frequencies[1] < 3e-3  # at L / h = 40
    assert torques[1] < 3e-3
    for part in (frequencies, torques):
        assert (part[1:] < 0.7 * part[:-1]).all()  # halves, but for what a coarse mesh adds


def test_torques_by_all_nodes_are_those_of_the_march() -> None:
    """P = M (a - g) at every node of the mesh, tau = L T P: to rounding, moving, bent and with second order."""
    for data in ({}, {"stiffening": False}, {"tie": "average"}):
        solution = solve_two(make_bars(**data), initial="static")
        assert solution.balance.meshes.shape == (12, 2)
        assert np.abs(solution.balance.meshes).max() < 1e-12 * list_ranges(solution).max()
        power = np.abs(solution.torque_all * solution.qd).max()
        assert np.abs(solution.power_residual).max() < 1e-8 * power  # what Newton leaves


def test_the_rigid_limit_is_rigid_inverse_dynamics() -> None:
    """As stiff as nothing is, a mesh is a rigid body with mass, centre and inertia of its volume: what it bends goes as 1/E."""
    size = (0.4, 0.1, 0.05)
    mass = 2700.0 * np.prod(size)
    square = np.square(size)
    inertia = Inertia(mass, np.array([0.2, 0.0, 0.0]), mass / 12 * np.diag(square.sum() - square))
    first = Link("a", bodies=(Body("a", inertia),))
    exact = solve_two(make_two(first, Link("b", bodies=(Body("b", inertia),))))
    apart = []
    for young in (7e14, 7e15):
        hard = Material.build_isotropic(young, 0.3, 2700.0)
        part = make_part(*make_block("tetra10", size, (2, 1, 1)), "tetra10", hard, modes=2)
        found = solve_two(make_two(first, Link("b", part=part)), initial="static")
        apart.append(np.abs(found.torque - exact.torque).max() / list_ranges(exact).max())
    assert apart[1] < 1e-6
    assert apart[1] == pytest.approx(0.1 * apart[0], rel=0.02)


def test_the_linearisation_is_the_derivative_of_the_residual() -> None:
    """By differences, at a bent, moving state: also of turns and of displacements of second order."""
    mechanism = make_bars(retardation=1e-4)
    solver = Solver.build_for(build(mechanism), {"hub", "elbow"})
    rng = np.random.default_rng(3)
    nothing = np.zeros(2)
    joints = begin_undeformed(solver, np.array([0.3, -0.8]), nothing, nothing)
    state = solver.state
    size = len(state.d)
    soft = np.concatenate(
        [[1.0, 1.0], np.tile([1, 1, 0.2, 0.2, 0.05, 0.05, *4 * [0.01]], 2)]
    )  # unknowns in the order of the block
    assert len(soft) == size
    state.d[:], state.u[:], state.du[:] = (scale * soft * rng.normal(size=size) for scale in (0.02, 0.5, 20.0))
    start = [part.copy() for part in (state.d, state.u, state.du)]
    cv, ca = 30.0, 900.0
    scheme = Scheme(DYNAMIC, 0.0, cv, ca, 0.0, 0.0, 0.0, 0.0, 0.0)
    solver.evaluate(scheme, joints)
    exact = solver.work.diagonal[0].copy()
    h = 1e-6
    for k in range(size):
        sides = []
        for sign in (1.0, -1.0):
            for part, before, factor in zip((state.d, state.u, state.du), start, (1.0, cv, ca), strict=True):
                part[:] = before
                part[k] += sign * h * factor
            solver.evaluate(scheme, joints)
            sides.append(solver.work.residual[0].copy())
        column = (sides[0] - sides[1]) / (2 * h)
        scale = np.abs(column).max()
        assert np.abs(exact[:size, k] - column).max() < 1e-6 * scale, (
            k
        )  # rounding over h, and the third derivative times h^2


def test_energy_stays_in_a_free_swing() -> None:
    """Undamped, let go: what the steps lose is what they do not resolve of the fast modes that letting go excites."""
    free = flexinv.simulate(
        make_bars(), [0.0, 0.2], np.zeros((2, 2)), 1e-3, spectral_radius=1.0, initial="static", start={"elbow": 0.4}
    )
    assert np.abs(free.balance.work).max() < 1e-3 * np.ptp(free.balance.kinetic)
    power = np.abs(free.balance.kinetic).max() / 0.2
    assert np.abs(free.power_residual).max() < 1e-8 * power  # at every instant, what Newton leaves


def test_a_column_buckles_at_eulers_load() -> None:
    """pi^2 E I / (4 L^2): loads along a link stiffen or soften it; without second order nothing buckles."""
    critical = np.pi**2 * 70e9 * 0.02**4 / 12 / (4 * 0.8**2)
    for stiffening, part, stable in ((True, 0.99, True), (True, 1.01, False), (False, 1.5, True)):
        bar = make_bar(count=(10, 1, 1), material=SOFT, stiffening=stiffening)
        push = Force("push", Attachment("bar", interface="tip"), np.array([[-part * critical, 0, 0, 0, 0, 0]]))
        column = replace(make_arm(Link("bar", part=bar)), gravity=np.zeros(3), forces=(push,))
        if stable:
            assert flexinv.statics(column).stable
        else:
            with pytest.warns(ModelWarning, match="unstable"):
                assert not flexinv.statics(column).stable


@pytest.mark.parametrize("ratio", [0.2, 0.5])
def test_a_turning_blade_stiffens_as_a_beam_does(ratio: float) -> None:
    """Bending out of the plane and in it at rates up to half of the first frequency."""
    rate = ratio * 2 * np.pi * 25.69
    links = (
        Link("bar", part=make_bar("hexahedron27", count=(20, 1, 1), material=SOFT)),
        Link("bar", beam=make_same_beam()),
        Link("bar", part=make_bar("hexahedron27", count=(20, 1, 1), material=SOFT, stiffening=False)),
    )
    still = [replace(make_arm(link, np.array([0, 0, 1.0])), gravity=np.zeros(3)) for link in links]
    found, exact, soft = (flexinv.steady_modes(m, rates={"hub": rate}).frequency[:2] for m in still)
    assert np.abs(found / exact - 1).max() < 1e-3  # 2.4e-4 is the mesh's, at any rate
    assert np.abs(soft / exact - 1).max() > ratio**2 / 10  # and what is left out is seen


def test_deformations_beyond_small_ones_are_refused() -> None:
    """At 0.15 rad the tip of a cantilever is off by 1 % of its way; there an error begins, and names the cure."""
    push = Force("push", Attachment("bar", interface="tip"), np.array([[0, 0, 430.0, 0, 0, 0]]))
    mesh = replace(make_arm(Link("bar", part=make_bar(material=SOFT))), gravity=np.zeros(3), forces=(push,))
    beam = replace(make_arm(Link("bar", beam=make_same_beam())), gravity=np.zeros(3))
    beam = replace(beam, forces=(replace(push, at=Attachment("bar", station=1.0)),))
    tips = [flexinv.statics(m).tip["bar"][0] for m in (mesh, beam)]
    assert np.linalg.norm(tips[0] - tips[1]) < 0.012 * np.linalg.norm(tips[1] - [0.8, 0, 0])
    more = replace(mesh, forces=(replace(push, wrench=1.2 * push.wrench),))
    with pytest.raises(ConvergenceError, match=r"interface 'tip' turns by .* rad .*divide the part into several links"):
        flexinv.statics(more)


def test_links_divided_by_fixed_joints_bend_further() -> None:
    """The cure: two links with their own frames follow a bend that one does not."""
    half = {"length": 0.4, "count": (5, 1, 1), "material": SOFT}
    links = (Link("a", part=make_bar(**half)), Link("b", part=make_bar(**half)))
    joints = (
        Joint("hub", "revolute", "world", "a", axis=Y),
        Joint("weld", "fixed", "a", "b", interface="tip"),
    )
    push = Force("push", Attachment("b", interface="tip"), np.array([[0, 0, 450.0, 0, 0, 0]]))
    two = Mechanism("two", links, joints, np.zeros(3), forces=(push,))
    beam = replace(make_arm(Link("bar", beam=make_same_beam())), gravity=np.zeros(3))
    beam = replace(beam, forces=(replace(push, at=Attachment("bar", station=1.0)),))
    tip, exact = flexinv.statics(two).tip["b"][0], flexinv.statics(beam).tip["bar"][0]
    assert np.linalg.norm(tip - exact) < 0.005 * np.linalg.norm(exact - [0.8, 0, 0])  # one link: 1.1 %


def make_crank(rod: Link, end: Attachment) -> Mechanism:
    """A slider-crank in space coordinates: crank 0.1 m, rod 0.5 m, the slide on the world's x."""
    crank = Inertia(0.5, np.array([0.05, 0, 0]), 1e-3 * np.eye(3))
    slide = Inertia(0.8, np.zeros(3), 1e-3 * np.eye(3))
    z = np.array([0, 0, 1.0])
    links = (Link("crank", (Body("crank", crank),)), rod, Link("slide", (Body("slide", slide),)))
    joints = (
        Joint("drive", "revolute", "world", "crank", axis=z),
        Joint("pin", "revolute", "crank", rod.name, Placement(np.array([0.1, 0, 0])), axis=z, actuated=False),
        Joint("rail", "prismatic", "world", "slide", axis=np.array([1.0, 0, 0]), actuated=False),
    )
    loop = Closure("wrist", "revolute", end, Attachment("slide"), axis=z)
    return Mechanism("crank", links, joints, closures=(loop,))


def test_a_meshed_rod_closes_a_loop() -> None:
    """A slider-crank whose rod is a mesh against one whose rod is a beam: torque, slide, and closures to rounding."""
    part = make_bar("hexahedron27", length=0.5, count=(12, 1, 1), material=SOFT)
    mesh = make_crank(Link("rod", part=part), Attachment("rod", interface="tip"))
    beam = make_crank(Link("rod", beam=make_same_beam(length=0.5)), Attachment("rod", station=1.0))
    motion = flexinv.Motion.point_to_point({"drive": 0.3}, {"drive": 2.0}, duration=0.3)
    start = {"pin": -0.36, "rail": 0.59}
    found, exact = (flexinv.solve(m, motion, step=1e-3, start=start) for m in (mesh, beam))
    apart = np.abs(found.torque - exact.torque).max(axis=0)
    assert (apart < 2e-3 * list_ranges(exact)).all()
    assert np.abs(found.tip["rod"][:, 1]).max() < 1e-9  # the slide's line
    assert np.abs(found.balance.meshes).max() < 1e-12 * list_ranges(exact).max()


def test_a_controller_gives_the_torques_of_solve() -> None:
    arm = make_arm(Link("bar", part=make_bar(count=(5, 1, 1), modes=2)))
    step = 1e-3
    solution = flexinv.solve(arm, ONE, step=step, initial="static")
    controller = flexinv.Controller.of(arm, step=step)
    q, qd, qdd = ONE.evaluate(arm, solution.time[:40])
    controller.start(q[0], qd[0], qdd[0], "static")
    torques = [float(controller.step(q[k], qd[k], qdd[k])[0]) for k in range(1, 40)]
    assert np.abs(np.array(torques) - solution.torque[1:40, 0]).max() < 1e-9 * list_ranges(solution)[0]


def test_error_bars_come_from_more_modes() -> None:
    """A coarse basis is off by about its bar; with none of its vibration modes the bar is large."""
    wide = {}
    exact = solve_two(make_bars().add_modes(3))
    for modes in (0, 4):
        bars = make_bars()
        links = tuple(replace(link, part=replace(link.part, modes=modes)) for link in bars.links if link.part)
        solution = solve_two(replace(bars, links=links), error=True)
        assert solution.torque_error is not None
        wide[modes] = float((solution.torque_error.max(axis=0) / list_ranges(exact)).max())
    assert wide[4] < wide[0]


def test_a_finer_mesh_widens_the_bars_to_what_a_coarse_one_misses() -> None:
    """One brick of eight nodes over the height is 40 % too stiff in bending: without a finer mesh the bars do not know.

    Bars hold the answer of the finer mesh, which more modes alone do not.
    """
    coarse = make_bar("hexahedron", count=(20, 1, 1), modes=4)
    fine = make_bar("hexahedron20", count=(20, 1, 1), modes=4)
    exact, blind, seen = (
        flexinv.solve(make_arm(Link("bar", part=part)), ONE, step=1e-3, initial="static", error=True)
        for part in (fine, coarse, replace(coarse, finer=fine))
    )
    assert blind.torque_error is not None
    assert seen.torque_error is not None
    off = np.abs(seen.torque - exact.torque).max()
    assert off > 0.02 * list_ranges(exact)[0]
    assert blind.torque_error.max() < 0.5 * off
    assert off < seen.torque_error.max() < 3.0 * off


def test_a_finer_mesh_of_another_part_is_refused() -> None:
    coarse = make_bar(count=(4, 1, 1), modes=1)
    with pytest.raises(InputError, match=r"the finer mesh has 56 points, the coarse one 56: expected more"):
        replace(coarse, finer=make_bar(count=(4, 1, 1), modes=1))
    with pytest.raises(InputError, match="is another part: both reach over"):
        replace(coarse, finer=make_bar(count=(8, 1, 1), side=0.03, modes=1))
    with pytest.raises(InputError, match="has other interfaces: expected the same"):
        replace(coarse, finer=make_bar(count=(8, 1, 1), modes=1, tie="average"))


def test_what_meshes_cannot_do_yet_is_refused_in_words() -> None:
    arm = make_arm(Link("bar", part=make_bar(count=(4, 1, 1), modes=1)))
    with pytest.raises(InputError, match="links that are meshes"):
        flexinv.differentiate(arm, ONE, ("gravity[2]",), step=1e-3)
    with pytest.raises(InputError, match="links that bend"):
        flexinv.joint_torques(arm, np.zeros(1), np.zeros(1), np.zeros(1))


def test_interfaces_that_are_not_there_are_refused() -> None:
    part = make_bar(count=(2, 1, 1), modes=1)
    with pytest.raises(InputError, match="interface 'flange' on link 'a', expected one of hub, tip"):
        make_two(Link("a", part=part), Link("b"), interface="flange")
    with pytest.raises(InputError, match="expected no interface: it is no mesh"):
        make_two(Link("a"), Link("b"), interface="tip")
    with pytest.raises(InputError, match="share node 1"):
        replace(part, interfaces=(part.interfaces[0], replace(part.interfaces[1], nodes=part.interfaces[0].nodes)))
    on_edge = part.interfaces[0].nodes[np.argsort(part.points[part.interfaces[0].nodes, 1])][:3]
    with pytest.raises(InputError, match="3 nodes on a line"):
        replace(part, interfaces=(replace(part.interfaces[0], nodes=on_edge), part.interfaces[1]))


def test_mode_shapes_are_counted_once() -> None:
    """Mass and stiffness at rest are those of the reduction, whatever else hangs on the link."""
    arm = make_arm(Link("bar", part=make_bar(count=(4, 1, 1), modes=3)))
    solver = Solver.build_for(build(arm), set())
    joints, held = find_rest_position(solver, np.zeros(1))
    mass, _, stiffness = compute_rest_matrices(held, joints)
    assert isinstance(arm.links[0].part, MeshedPart)
    assert mass.shape == (9, 9)
    unit = np.sqrt(mass.diagonal())
    assert np.abs(mass.toarray() / unit / unit[:, None] - np.eye(9)).max() < 3e-3  # bent a little by gravity
    assert (stiffness.diagonal() > 0).all()
    assert ALUMINIUM.density == 2700.0
