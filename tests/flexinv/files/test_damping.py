"""Damping as mechanism files state it: by times, or by the ratio of one mode, which says what the others get."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import flexinv
from flexinv.cli.commands import main
from flexinv.errors import InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.kinematics.mesh import build
from flexinv.linearized.modal_damping import resolve_damping_ratio
from flexinv.model.mechanism import Mechanism, ModalDamping, Section

MODELS = Path(__file__).resolve().parents[3] / "models"
DAMPED = (MODELS / "flex_one_link_damped" / "mechanism.toml").read_text(encoding="utf-8")
BARE = DAMPED[: DAMPED.index("[damping]")]


def loaded(folder: Path, text: str) -> Mechanism:
    (folder / "mechanism.toml").write_text(text, encoding="utf-8")
    return load_mechanism(folder)


def section(mechanism: Mechanism) -> Section:
    beam = mechanism.links[0].beam
    assert beam is not None
    return beam.section


def test_a_ratio_becomes_a_time_and_a_note(tmp_path: Path) -> None:
    """eta = 2 zeta / omega of the linear cantilever: 0.03 at 62.98 rad/s (natural modes, five digits)."""
    stated = loaded(tmp_path, DAMPED)
    assert section(stated).damping is None
    assert stated.modal_damping == ModalDamping(0.03, 1)
    result = resolve_damping_ratio(stated)
    assert resolve_damping_ratio(stated) is result  # computed once
    assert build(result).mechanism is result
    damping = section(result).damping
    assert damping is not None
    np.testing.assert_allclose(damping / section(result).stiffness, 0.06 / 62.9812, rtol=1e-5)
    assert (
        "retardation time 0.00095267 s from ratio 0.03 at mode 1, computed by flexinv; ratios of modes: "
        "1 at 10.02 Hz 0.03, 2" in result.notes[0]
    )


def test_times_of_a_section_and_of_all_beams(tmp_path: Path) -> None:
    one = section(loaded(tmp_path, BARE + "\n[damping]\nretardation_s = 1e-3\n"))
    other = section(loaded(tmp_path, BARE.replace("GJ_Nm2", "retardation_s = 1e-3\nGJ_Nm2")))
    assert one.damping is not None
    assert other.damping is not None
    np.testing.assert_allclose(one.damping, 1e-3 * one.stiffness, rtol=1e-15)
    np.testing.assert_array_equal(one.damping, other.damping)
    parts = "retardation_s = { axial = 1e-3, shear = 2e-3, twist = 3e-3, bending = 4e-3 }\nGJ_Nm2"
    each = section(loaded(tmp_path, BARE.replace("GJ_Nm2", parts)))
    assert each.damping is not None
    np.testing.assert_allclose(each.damping, np.array([[1, 2, 2, 3, 4, 4]]) * 1e-3 * each.stiffness, rtol=1e-15)
    assert section(loaded(tmp_path, BARE)).damping is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BARE + "[damping]\n", "given:    neither"),
        (DAMPED + "retardation_s = 1e-3\n", "given:    both"),
        (DAMPED.replace("GJ_Nm2", "retardation_s = 1e-3\nGJ_Nm2"), "beside retardation_s of a section"),
        (BARE.replace("GJ_Nm2", "retardation_s = -1\nGJ_Nm2"), "should not be negative"),
        (BARE.replace("GJ_Nm2", "retardation_s = { twist = 1 }\nGJ_Nm2"), "should be { axial"),
    ],
)
def test_what_cannot_be_is_answered(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        loaded(tmp_path, text)


def test_a_mode_that_the_mesh_has_not_is_an_error(tmp_path: Path) -> None:
    mechanism = loaded(tmp_path, DAMPED.replace("mode = 1", "mode = 999"))
    with pytest.raises(InputError, match="mode 999, expected 1 to"):
        resolve_damping_ratio(mechanism)
    with pytest.raises(InputError, match="mode 999, expected 1 to"):
        flexinv.natural_modes(mechanism)


def test_a_mesh_of_a_ratio_without_a_time_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"stated as a ratio of a mode.*write .*resolve_damping_ratio"):
        build(loaded(tmp_path, DAMPED))


def test_every_entrance_resolves_a_ratio(tmp_path: Path) -> None:
    mechanism = loaded(tmp_path, DAMPED)
    times = resolve_damping_ratio(mechanism)
    motion = flexinv.Motion.point_to_point({"hub": 0.0}, {"hub": 0.1}, duration=0.05)
    one, other = (flexinv.solve(m, motion, step=5e-4) for m in (mechanism, times))
    np.testing.assert_array_equal(one.torque, other.torque)
    np.testing.assert_array_equal(flexinv.statics(mechanism).torque, flexinv.statics(times).torque)
    np.testing.assert_array_equal(flexinv.natural_modes(mechanism).ratio, flexinv.natural_modes(times).ratio)
    np.testing.assert_array_equal(flexinv.steady_modes(mechanism).root, flexinv.steady_modes(times).root)
    np.testing.assert_array_equal(flexinv.linear_model(mechanism).A, flexinv.linear_model(times).A)
    (batched,) = flexinv.solve_many([mechanism], [motion], step=5e-4).solutions
    np.testing.assert_array_equal(batched.torque, one.torque)


def test_reading_a_file_starts_no_solver() -> None:
    """A process that reads a mechanism with a damping ratio has not even loaded the compiler, nor optimisers and splines."""
    loaded = (
        "[name for name in ('numba', 'scipy.optimize', 'scipy.interpolate', 'scipy.special') if name in sys.modules]"
    )
    text = f"import sys, flexinv; flexinv.load_mechanism({str(MODELS / 'flex_one_link_damped')!r}); print({loaded})"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_ratios_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    main(["modes", str(MODELS / "flex_one_link_damped"), "--count", "1"])
    shown = capsys.readouterr().out
    assert "damping ratio [-]" in shown
    mode, frequency, bar, omega, ratio, link = shown.splitlines()[1].split()
    assert [mode, frequency, omega, ratio, link] == ["1", "10.0238", "62.9812", "0.03", "link"]
    assert 0.0 < float(bar) < 1e-3
