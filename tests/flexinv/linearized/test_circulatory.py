"""Forces that turn along: flutter and divergence of columns and links, against closed forms; rates that couplings tie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexible_examples import clamped, uniform
from vibrating_beams import bar

import flexinv
from flexinv.errors import InputError, ModelWarning
from flexinv.linearized import linear_model as linear
from flexinv.linearized.linear_model import LinearModel, linear_model
from flexinv.linearized.natural_modes import natural_modes
from flexinv.linearized.steady_modes import steady_modes
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Beam,
    Body,
    Closure,
    Force,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
)

# Rounding of a few unknowns of the same size.
ROUNDING = 1e-12


def ziegler(push: float) -> Mechanism:
    """Two rigid links of 1 m, springs of 1 N m/rad, 2 and 1 kg at their ends, a push along the second one."""
    end = np.array([1.0, 0.0, 0.0])
    links = tuple(Link(f"l{k}", (Body("ball", Inertia(3.0 - k, end)),)) for k in (1, 2))
    joints = (
        Joint("a", "revolute", WORLD, "l1", stiffness=1.0, actuated=False),
        Joint("b", "revolute", "l1", "l2", Placement(end), stiffness=1.0, actuated=False),
    )
    wrench = np.array([[-push, 0.0, 0.0, 0.0, 0.0, 0.0]])
    force = Force("push", Attachment("l2", Placement(end)), wrench, follower=True)
    return Mechanism("ziegler", links, joints, np.zeros(3), forces=(force,))


@pytest.mark.reported("D1")
@pytest.mark.parametrize(("push", "exact"), [(2.0, [0.5, 1.0]), (2.5, [0.5 - 0.5j, 0.5 + 0.5j])])
def test_two_links_under_a_push_that_turns_along(push: float, exact: list[complex]) -> None:
    """M = [[3, 1], [1, 1]], K = [[2 - P, P - 1], [-1, 1]] by hand."""
    modes = natural_modes(ziegler(push), free=["a", "b"])
    np.testing.assert_allclose(modes.squared, exact, rtol=ROUNDING)
    steady = steady_modes(ziegler(push), free=["a", "b"])
    np.testing.assert_allclose(sorted(modes.root, key=abs), sorted(steady.root, key=abs), rtol=1e-9)
    assert modes.stability == (("stable", "stable") if push == 2.0 else ("flutter", "twin of flutter"))
    assert np.isrealobj(modes.frequency)
    assert np.iscomplexobj(modes.displacement) == (push == 2.5)


def column(push: float) -> Mechanism:
    """Beck's column: EI = m = L = 1 in one plane, without rotary inertia there; shear and stretch of 1e6."""
    bar = uniform(1.0, 1e6, 1e6, 10.0, (1000.0, 1.0))
    section = replace(bar.section, mass_per_length=np.ones(1), rotary_inertia=np.array([[1e-3, 0.0, 0.0]]))
    force = Force("push", Attachment("beam", station=1.0), np.array([[-push, 0, 0, 0, 0, 0.0]]), follower=True)
    return replace(clamped(replace(bar, section=section), 4, 4), gravity=np.zeros(3), forces=(force,))


# Roots of Beck's column by its frequency equation (Euler and Bernoulli): P -> omega [rad/s], or root [1/s].
# Shear of 1e6 lowers the frequencies by some 1e-5.
BECK = {5.0: 4.21768j, 10.0: 5.17576j, 40.0: 10.518 + 9.669j}


@pytest.mark.reported("D1")
@pytest.mark.parametrize("push", BECK)
def test_becks_column(push: float) -> None:
    modes = natural_modes(column(push), count=1)
    assert abs(modes.root[0] - BECK[push]) < 1e-4 * abs(BECK[push])
    if push < 20.0:  # 20.05 is its flutter load
        assert flexinv.statics(column(push)).stable
        return
    assert modes.stability == ("flutter",)
    with pytest.warns(ModelWarning, match="complex: flutter"):
        assert flexinv.statics(column(push)).stable is False


def answer(model: LinearModel, s: complex) -> complex:
    """The first output to the first input at s [1/s]."""
    return complex((model.C @ np.linalg.solve(s * np.eye(len(model.A)) - model.A, model.B))[0, 0])


@pytest.mark.parametrize("push", BECK)
@pytest.mark.parametrize("modes", [1, 2, 5])
def test_few_modes_under_a_push_that_turns_along_keep_their_poles_and_what_efforts_do(push: float, modes: int) -> None:
    """Left vectors are no right ones here: with the latter on both sides poles are kept, but not what a torque does in them."""
    one = column(push)
    hinged = replace(one, joints=(replace(one.joints[0], kind="revolute", stiffness=40.0),))
    exact = steady_modes(hinged, free=["root"], count=modes).root
    whole, few = linear_model(hinged), linear_model(hinged, modes=modes)
    away = np.abs(few.poles[None] - exact[:, None]).min(axis=1)
    assert (away < 1e-7 * np.abs(exact)).all()  # of A, whose largest entries are 1e8 times these squared
    swinging = 0
    for root in exact:
        near = root * (1 + 1e-5)
        of_whole, of_few = (answer(one, near) for one in (whole, few))
        if abs(of_whole) > 100 * abs(answer(whole, 1.3 * root)):  # not out of the plane, where the torque does nothing
            swinging += 1
            # what is left of others near a pole, 1e-5 of them, and of its place: 1e-9 (rounding of A) over 1e-5, twice
            assert abs(of_few / of_whole - 1) < 1e-3
    assert swinging
    assert "left vectors" in few.notes[0]


@pytest.mark.reported("D1")
def test_a_moment_in_space_is_not_symmetric_either() -> None:
    """A twisted straight shaft under a dead moment about its axis: `natural_modes` finds what `steady_modes` finds."""
    bar = uniform(1.0, 1e4, 1e4, 1.0, (2.0, 1.0))
    section = replace(bar.section, mass_per_length=np.ones(1), rotary_inertia=np.full((1, 3), 1e-3))
    force = Force("twist", Attachment("beam", station=1.0), np.array([[0, 0, 0, 0.3, 0, 0.0]]))
    shaft = replace(clamped(replace(bar, section=section), 1, 4), gravity=np.zeros(3), forces=(force,))
    result, steady = natural_modes(shaft, count=4), steady_modes(shaft, count=4)
    np.testing.assert_allclose(result.root, steady.root, rtol=1e-7)


def gears(coupled: bool) -> Mechanism:
    """Two shafts with discs; a gear pair ties them 3 to 1, opposite."""
    bar = uniform(1.0, 1e9, 1e9, 1e5, (1e3, 1e3))
    section = replace(bar.section, mass_per_length=np.array([0.01]), rotary_inertia=np.array([[1e-9, 0, 0]]))
    disc = Body("disc", Inertia(1.0, np.zeros(3), np.diag([0.8, 0.5, 0.5])), 1.0)
    links = tuple(Link(name, (disc,), Beam(1.0, section, 1, 4)) for name in ("one", "two"))
    joints = tuple(
        Joint(f"g{k + 1}", "revolute", WORLD, link.name, Placement(np.array([0.0, k, 0.0])), axis=np.array([1.0, 0, 0]),
              actuated=k == 0 or not coupled) for k, link in enumerate(links)
    )  # fmt: skip
    tie = Closure("gear", "coupling", Attachment(WORLD), Attachment(WORLD), factors=(("g1", 3.0), ("g2", 1.0)))
    return Mechanism("gears", links, joints, np.zeros(3), (tie,) if coupled else ())


@pytest.mark.reported("D3")
def test_a_rate_that_follows_from_a_coupling_is_taken() -> None:
    modes = steady_modes(gears(True), rates={"g1": 20.0}, count=4)
    apart = steady_modes(gears(False), rates={"g1": 20.0, "g2": -60.0}, count=4)
    np.testing.assert_allclose(modes.frequency, apart.frequency, rtol=1e-6)  # stiffness of shafts against discs: 1e9
    assert modes.rates == {"g1": 20.0, "g2": pytest.approx(-60.0)}


@pytest.mark.reported("D3")
def test_rates_that_contradict_a_coupling_are_an_error() -> None:
    with pytest.raises(InputError, match=r"contradict coupling 'gear': 3 x 20 .* = 120 rad/s, expected 0"):
        steady_modes(gears(True), rates={"g1": 20.0, "g2": 60.0})


def test_a_spring_in_a_joint_that_turns_winds_up() -> None:
    one = gears(False)
    wound = replace(one, joints=(replace(one.joints[0], stiffness=3.0), one.joints[1]))
    with pytest.raises(InputError, match=r"joint 'g1' .* its spring \(3 N m/rad\) winds up"):
        steady_modes(wound, rates={"g1": 20.0})


@pytest.mark.reported("D11")
@pytest.mark.parametrize("modes", [1, 2, 4, 6])
def test_few_modes_of_something_that_turns_keep_their_poles(modes: int) -> None:
    """13.64 Hz was the fourth of the gears without gyroscopic terms, where 12.18 Hz is right."""
    rates = {"g1": 20.0, "g2": -60.0}
    exact = steady_modes(gears(False), rates=rates, free=["g1", "g2"], count=modes).root
    model = linear_model(gears(False), rates=rates, modes=modes)
    poles = np.linalg.eigvals(model.A)
    away = np.abs(poles[None] - exact[:, None]).min(axis=1)
    # rounding of stiffnesses of 1e9 is 1e-7, and a double root at zero is known to the root of that
    assert (away < 1e-6 * np.abs(exact) + 3e-4).all()
    assert len(model.A) <= 4 * modes
    assert poles.real.max() < 3e-4
    assert f"the {modes} slowest complex modes" in model.notes[0]
    assert not linear_model(gears(False), modes=modes).notes


def test_without_gyroscopic_terms_the_same_check_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    rates = {"g1": 20.0, "g2": -60.0}
    exact = steady_modes(gears(False), rates=rates, free=["g1", "g2"], count=6).root[-1]
    monkeypatch.setattr(linear, "_is_gyroscopic", lambda damping: False)
    poles = np.linalg.eigvals(linear_model(gears(False), rates=rates, modes=6).A)
    assert np.abs(poles - exact).min() > 1e-3 * abs(exact)  # a thousand times what is left with them


def test_a_hub_that_is_accelerated_keeps_the_poles_of_what_it_carries() -> None:
    one = gears(False)
    rates = {"g1": 20.0, "g2": -60.0}
    exact = steady_modes(one, rates=rates, free=["g1"], count=3).root
    model = linear_model(one, rates=rates, free=["g1"], accelerated=["g2"], modes=3)
    assert model.inputs[-1] == "g2 acceleration"
    away = np.abs(np.linalg.eigvals(model.A)[None] - exact[:, None]).min(axis=1)
    assert (away < 1e-6 * np.abs(exact) + 1e-5).all()


@pytest.mark.reported("D2")
def test_no_rotary_inertia_gives_no_poles_beyond_the_others() -> None:
    """A bare beam has 12 motions less, and no pole at 1e22 1/s."""
    bar = uniform(1.0, 1e6, 1e6, 50.0, (50.0, 20.0))
    poles = []
    for rotary in (0.0, 1e-6):
        inertia = np.array([[1e-3, rotary, rotary]])
        section = replace(bar.section, mass_per_length=np.ones(1), rotary_inertia=inertia)
        model = linear_model(replace(clamped(replace(bar, section=section), 1, 4), gravity=np.zeros(3)))
        poles.append(np.sort(np.abs(np.linalg.eigvals(model.A))))
    assert np.isfinite(poles[0]).all()
    np.testing.assert_allclose(poles[0][:4], poles[1][:4], rtol=1e-3)
    assert poles[0].max() < 1e5


def test_bars_of_frequencies_grow_where_two_of_them_meet() -> None:
    """They were those of a symmetric K, by right vectors alone: near flutter left and right ones are all but orthogonal."""
    below, near = (natural_modes(bar(2, push=push, follower=True, thick=False), count=2) for push in (2.0, 20.0))
    assert set(near.stability) == {"stable"}  # flutter is at 20.05
    assert (near.rounding > 10 * below.rounding.max()).all()
