"""differentiate_modes: closed forms of a cantilever, and differences of natural_modes of arms, loops and rest positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.linearized.modes import compute_frequency_rounding
from flexinv.sensitivity.parameters import resolve_parameters

START = np.radians([20.0, 46.0, 103.0])
# Mechanism, number, the change of the differences, and what natural_modes takes.
CASES = {
    "length of a strip": ("flex_one_link", "links.link.beam.length", 1e-2, {}),
    "stiffness": ("flex_one_link", "links.link.beam.section.stiffness[0,5]", 1e-2, {}),
    "stiffness, damping stated": ("flex_one_link_damped", "links.link.beam.section.stiffness[0,5]", 1e-2, {}),
    "payload at a bent arm": ("spatial_arm", "links.forearm.bodies.tool.inertia.mass", 1e-2, {"q": [0.2, 0.4]}),
    "gravity of a bent arm": ("spatial_arm", "gravity[2]", 1e-2, {"q": [0.2, 0.4]}),
    "a spring that is free": ("quanser_2dsfl", "joints.1.stiffness", 3e-2, {"free": ["clamp1", "clamp2"]}),
    "a loop": ("four_bar_flexible", "links.coupler.beam.length", 1e-2, {"q": START}),
    "place of a closure": ("four_bar_flexible", "closures.C.second.placement.position[0]", 1e-2, {"q": START}),
}


def _compute_differences(mechanism, by, size, settings):
    """Differences of sixth order of the first frequencies [Hz per unit], and their step."""
    (parameter,) = resolve_parameters(by, mechanism, flexinv.Motion.point_to_point({}, {}, duration=1.0))
    step = size * max(abs(parameter.value), 0.1)

    def find(k):
        return flexinv.natural_modes(parameter.make(parameter.value + k * step), count=4, **settings).frequency

    first, second, third = (find(k) - find(-k) for k in (1, 2, 3))
    return (45 * first - 9 * second + third) / (60 * step), step


@pytest.mark.parametrize("case", CASES)
def test_slopes_are_differences_of_natural_modes(root, case):
    name, by, size, settings = CASES[case]
    mechanism = flexinv.load_mechanism(root / "models" / name)
    found = flexinv.differentiate_modes(mechanism, by, count=4, **settings)
    expected, step = _compute_differences(mechanism, by, size, settings)
    # Rounding of frequencies, some ten times of their terms where a rest position is rounded, too, becomes so much of a slope.
    known = 10.0 * compute_frequency_rounding(found.modes) / found.modes.frequency / step
    off = np.abs(found.frequency[:, 0] - expected) / found.modes.frequency
    assert (off < 1e-7 + known).all()
    assert (np.abs(expected / found.modes.frequency) > 100.0 * known).any()  # the differences can tell


def test_a_cantilever_has_its_closed_forms(root):
    """Bending frequencies of a slender strip go with L^-2 and EI^1/2, but for 1e-4 of shear and rotary inertia."""
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    names = ["links.link.beam.length", "links.link.beam.section.stiffness[0,5]"]
    found = flexinv.differentiate_modes(arm, names, count=1)
    length, stiffness = found.values
    frequency = found.modes.frequency[0]
    assert found.frequency[0, 1] == pytest.approx(frequency / (2.0 * stiffness), rel=1e-3)
    assert found.frequency[0, 0] == pytest.approx(-2.0 * frequency / length, rel=1e-3)
    assert list(found.frame().columns) == names
    assert "1 modes by" in repr(found)


def test_modes_at_one_frequency_and_names_of_motions_are_refused(root):
    arm = flexinv.load_mechanism(root / "models" / "flex_one_link")
    section = arm.link_of["link"].beam.section
    square = section.stiffness.copy()
    square[0, 4] = square[0, 5]
    inertia = section.rotary_inertia.copy()
    inertia[0, 1] = inertia[0, 2]
    beam = replace(arm.link_of["link"].beam, section=replace(section, stiffness=square, rotary_inertia=inertia))
    round_arm = replace(arm, links=(replace(arm.link_of["link"], beam=beam),))
    with pytest.raises(InputError, match="modes 1 and 2 of 'flex_one_link' have one frequency"):
        flexinv.differentiate_modes(round_arm, "links.link.beam.length", count=2)
    with pytest.raises(InputError, match=r"by: 'motion\.hub\[1\]': expected a number of the mechanism"):
        flexinv.differentiate_modes(arm, "motion.hub[1]")
