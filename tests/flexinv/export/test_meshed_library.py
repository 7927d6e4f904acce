"""The C library of an arm with a meshed link: the same march as a controller's, and parameters that its point masses feel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_library import Block, assert_needs_nothing, needs_compiler
from marched_library import STEP, controlled, stepped, swing

import flexinv
from flexinv.errors import ModelWarning
from flexinv.export.export_c import export_c
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism

pytestmark = needs_compiler
WAY = 0.05  # [rad]
STEPS = 30
SETTLING = 600  # steps, of which each takes most of what is left of a vibration
SETTLED = 1e-6  # of a torque, and [m]: as in test_loaded_library


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return flexinv.load_mechanism("models/meshed_arm")


def test_steps_have_the_digits_of_a_controller(arm: Mechanism, tmp_path: Path) -> None:
    made = export_c(arm, tmp_path / "library", step=STEP)
    assert_needs_nothing(made)
    rows = swing(arm, arm.neutral, WAY, STEPS)
    block = Block(made)
    assert np.array_equal(stepped(block, rows), controlled(arm, arm.neutral, rows))
    assert "deflection" not in (made.folder / "include" / f"{made.name}.h").read_text()  # which beams alone have


def test_gravity_and_a_payload_come_to_rest_as_in_a_mechanism_that_has_them(arm: Mechanism, tmp_path: Path) -> None:
    """Long steps that damp all vibrations; put on suddenly, the arm settles where a mechanism with that load is at rest."""
    with pytest.warns(
        ModelWarning, match=r"step = 0.05 s is too long for its links that bend, .* 17.3 Hz .*; write step = 0.003"
    ):
        made = export_c(arm, tmp_path / "library", step=0.05, spectral_radius=0.0, payloads=("forearm",))
    load = Inertia(0.5, np.array([0.02, 0.01, 0.03]), np.diag([1e-3, 2e-3, 1.5e-3]))
    gravity = np.array([1.0, -2.0, -9.0])
    heavy = replace(arm.with_body("forearm", Body("load", load)), gravity=gravity)
    still = np.zeros(arm.nv)
    expected = flexinv.Controller.of(heavy, step=STEP).start(arm.neutral, still, still, initial="static")
    block = Block(made)
    assert block.call("set_payload", 0, load.mass, load.com, np.array([1e-3, 2e-3, 1.5e-3, 0.0, 0.0, 0.0])) == "OK"
    assert block.call("set_gravity", gravity) == "OK"
    tau = np.zeros(arm.nv)
    for _ in range(SETTLING):
        assert block.call("step", arm.neutral, still, still, tau) == "OK"
    assert np.abs(tau - expected).max() < SETTLED * np.abs(expected).max()
    assert block.start_at(arm.neutral + 0.3) == "OK"
    elsewhere = flexinv.statics(arm, q=arm.neutral + 0.3)
    assert block.call("last_torque", tau) == "OK"
    np.testing.assert_allclose(tau, elsewhere.torque[0], rtol=0, atol=SETTLED * np.abs(expected).max())
    tip = np.zeros(3)
    assert block.call("tip", len(arm.links) - 1, tip) == "OK"
    np.testing.assert_allclose(tip, elsewhere.tip[arm.links[-1].name][0], rtol=0, atol=SETTLED)
