"""Error bars of natural frequencies: of mesh and rounding, against exact beams; accuracy that is asked for."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from vibrating_beams import PINNED, ROWS, bar, cantilever, in_plane, pendulum, thin

from flexinv.errors import ConvergenceError, InputError
from flexinv.linearized.natural_modes import natural_modes
from flexinv.model.mechanism import WORLD, Attachment, Closure, Placement

# kappa of the table has six decimals: 4e-7 of the shear, which is 3 % of the stockiest beam's compliance.
DECIMALS = 2e-8
MESHES = [(1, 1), (4, 1), (1, 2), (3, 2), (1, 3), (1, 4), (2, 4), (1, 6)]


@pytest.mark.parametrize(("elements", "order"), MESHES)
@pytest.mark.parametrize("thickness", sorted({row["h_m"] for row in ROWS}))
def test_bars_hold_against_exact_cantilevers(thickness: str, elements: int, order: int) -> None:
    """All that a mesh has in its plane, be it 600 % off: the table has four."""
    rows = [row for row in ROWS if row["h_m"] == thickness]
    exact = np.array([float(row["f_Timoshenko_Hz"]) for row in rows])
    modes = natural_modes(cantilever(rows[0], elements, order))
    plane = in_plane(modes)[: len(exact)]
    # rows that bend in the plane are numbered among all modes: those whose number the finer mesh does not change
    finer = natural_modes(modes.mesh.mechanism.refined(2, 1), count=len(modes.squared))
    same = [k for k, mode in enumerate(plane) if mode in in_plane(finer) and in_plane(finer).index(mode) == k]
    assert same
    off = np.abs(modes.frequency[plane] - exact[: len(plane)])
    assert (off <= modes.frequency_error[plane] + DECIMALS * exact[: len(plane)])[same].all()
    # and a bar is no more than a few times what is off, or it says nothing
    large = off > 1e-6 * exact[: len(plane)]
    assert (modes.frequency_error[plane] < 4 * off)[large & np.isin(range(len(plane)), same)].all()


@pytest.mark.reported("D5")
def test_the_default_mesh_says_that_its_third_bending_is_24_percent_high() -> None:
    result, right = natural_modes(bar(1), count=6), natural_modes(bar(6), count=6)
    off = np.abs(result.frequency - right.frequency)
    assert off[4] > 0.2 * right.frequency[4]
    assert (off <= result.frequency_error).all()
    assert (result.frequency_error[:2] < 1e-3 * result.frequency[:2]).all()
    assert (result.frequency_error[4:] > 0.2 * right.frequency[4:]).all()


def test_a_bar_of_a_beam_that_a_closure_holds() -> None:
    """Its root is that of a clamped and pinned beam; shear of 1e9 lowers it by 1e-8."""
    end = Attachment(WORLD, Placement(np.array([1.0, 0.0, 0.0])))
    held = thin((Closure("end", "revolute", end, Attachment("beam", Placement(), 1.0)),)).with_mesh(1, 4)
    modes = natural_modes(held, count=4)
    mode = in_plane(modes)[0]
    off = abs(modes.frequency[mode] - PINNED**2 / (2 * np.pi))
    assert 1e-6 < off <= modes.frequency_error[mode] < 4 * off


def test_rigid_mechanisms_have_bars_of_rounding() -> None:
    modes = natural_modes(pendulum(2), free=["q0", "q1"])
    assert (modes.frequency_error > 0.0).all()
    assert (modes.frequency_error < 1e-14 * modes.frequency).all()


def test_of_a_fine_mesh_rounding_is_in_the_bar() -> None:
    """Its stiffness is 1e8 times that of the slowest motion: bars of the mesh alone, 1e-12, would be too short."""
    result, right = natural_modes(bar(100), count=4), natural_modes(bar(6), count=4)
    off = np.abs(result.frequency - right.frequency)
    assert off[0] > 1e-10 * right.frequency[0]
    assert (off <= result.frequency_error + right.frequency_error).all()


def test_divergence_and_rigid_motions_have_bars_too() -> None:
    assert np.isnan(natural_modes(bar(2, push=4.0), count=2).frequency_error).all()
    hinged = natural_modes(bar(2, "revolute"), free=["root"], count=3)
    assert hinged.frequency[0] == 0.0
    assert 0.0 < hinged.frequency_error[0] < 1e-3 * hinged.frequency[1]


def test_a_copy_has_the_same_bars() -> None:
    modes = natural_modes(bar(1), count=4)
    np.testing.assert_array_equal(copy.deepcopy(modes).frequency_error, modes.frequency_error)
    assert copy.deepcopy(modes) == modes


@pytest.mark.reported("D5")
@pytest.mark.parametrize("accuracy", [1e-2, 1e-5])
def test_the_accuracy_that_is_asked_for_is_kept(accuracy: float) -> None:
    result, right = natural_modes(bar(1), count=6, accuracy=accuracy), natural_modes(bar(6, push=0.0), count=6)
    assert (result.frequency_error <= accuracy * result.frequency).all()
    np.testing.assert_allclose(result.frequency, right.frequency, rtol=accuracy)
    assert result.mesh.size > natural_modes(bar(1), count=6).mesh.size


def test_an_accuracy_that_rounding_denies_is_an_error() -> None:
    with pytest.raises(ConvergenceError, match=r"accuracy 1e-13 is not reached: mode \d, .* rounding leaves no more"):
        natural_modes(bar(1), count=6, accuracy=1e-13)


def test_accuracy_is_a_number_above_zero_and_needs_a_count() -> None:
    with pytest.raises(InputError, match="accuracy needs a count"):
        natural_modes(bar(1), accuracy=1e-3)
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="accuracy"):
            natural_modes(bar(1), count=2, accuracy=wrong)
