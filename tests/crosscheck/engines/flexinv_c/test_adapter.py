"""The exported library as an engine: asked in a process without Python, it answers what flexinv does, and says what it cannot."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_library import needs_compiler

import flexinv
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import sample_times
from crosscheck.engines.flexinv_c import adapter as library
from crosscheck.measures.certificate import Certificate, checks
from crosscheck.measures.record import Record
from flexinv.errors import FlexinvError, InputError
from flexinv.export.link_library import _list_names, find_compiler
from flexinv.export.machine_code import NATIVE
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Attachment, Force, Mechanism

MODELS = Path("models")
ENGINE = ENGINES["flexinv-c"]


def read(model: str, case: str) -> tuple[Mechanism, Case]:
    mechanism = flexinv.load_mechanism(MODELS / model)
    return mechanism, load_cases(MODELS / model, mechanism)[case]


def answer(model: str, name: str, engine: str = "flexinv-c") -> Record:
    mechanism, case = read(model, name)
    one = adapter(ENGINES[engine])
    assert one.unsupported(mechanism, case, engine) is None
    return one.run(mechanism, case, engine, {"error": False})


@needs_compiler
@pytest.mark.parametrize(
    ("model", "case"),
    [("kuka_kr300", "return"), ("four_bar", "rock"), ("spatial_arm", "reach"), ("flex_one_link_damped", "septic")],
)
def test_its_torques_are_those_of_flexinv(model: str, case: str) -> None:
    """A tree with a spring, a loop, marches, one with damping that is a ratio: far inside the engine's own limit."""
    ours, theirs = answer(model, case, "flexinv"), answer(model, case)
    torques = [name for name in ours.series if name.startswith("torque/")]
    assert set(theirs.series) == set(torques)
    scale = max(np.ptp(ours.series[name].values) for name in torques)
    apart = max(np.abs(ours.series[name].values - theirs.series[name].values).max() for name in torques)
    assert apart <= 0.1 * ENGINE.limits[0].maximum * scale
    assert np.array_equal(theirs.time, sample_times(read(model, case)[1]))


@needs_compiler
def test_its_certificate_holds_and_another_mechanism_is_found() -> None:
    """Gravity, mass matrix, losses and springs of a rigid tree; the weight of one with beams."""
    for model, case in (("elastic_drives", "swing"), ("spatial_arm", "reach")):
        mechanism, one = read(model, case)
        reference = adapter(ENGINES["flexinv"]).certify(mechanism, one, "flexinv")  # type: ignore[attr-defined]
        own = adapter(ENGINE).certify(mechanism, one, "flexinv-c")  # type: ignore[attr-defined]
        assert isinstance(own, Certificate)
        lines = checks(model, case, "flexinv-c", own, reference)
        assert lines
        assert all(line.holds for line in lines), [line for line in lines if not line.holds]
        heavier = replace(mechanism, gravity=1.001 * mechanism.gravity)
        other = adapter(ENGINES["flexinv"]).certify(heavier, one, "flexinv")  # type: ignore[attr-defined]
        if mechanism.is_rigid:
            assert not all(line.holds for line in checks(model, case, "flexinv-c", own, other))


@pytest.mark.parametrize(
    ("model", "case", "words"),
    [
        ("two_arms_flexible", "carry", "closures that act for a while"),
        ("flex_one_link", "bang_bang", "accelerations jump at t = "),
    ],
)
def test_what_it_cannot_is_said_in_words(model: str, case: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "find_compiler", lambda target: "cc")
    assert words in str(library.unsupported(*read(model, case), "flexinv-c"))


def test_loops_under_a_force_that_changes_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call is told the force of its time: what `flexinv.prepare` refuses a library can do."""
    monkeypatch.setattr(library, "find_compiler", lambda target: "cc")
    bar, case = read("four_bar", "turn")
    push = Force(
        "push",
        Attachment(bar.links[1].name),
        np.array([[0.0] * 6, [5.0, 0.0, 0.0, 0.0, 0.0, 0.0]]),
        time=np.array([0.0, 9.0]),
    )
    pushed = replace(bar, forces=(push,))
    with pytest.raises(InputError, match="depends on time"):
        flexinv.prepare(pushed)
    assert library.unsupported(pushed, case, "flexinv-c") is None
    plan = library.plan_case(pushed, case)
    given = [one.wrenches for one in plan.questions]
    assert not np.array_equal(given[0], given[-1])


def test_without_a_compiler_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "find_compiler", lambda target: None)
    assert "there is no C compiler here" in str(library.unsupported(*read("ur5", "reach"), "flexinv-c"))


@needs_compiler
def test_a_refused_call_and_a_program_that_breaks_are_errors() -> None:
    """A number that is none is a status in words; a program that ends is told by its exit code."""
    mechanism, case = read("double_pendulum", "swing")
    plan = library.plan_case(mechanism, case)
    program = library.make_program(mechanism, plan.settings)
    wild = replace(plan.questions[1], q=np.full(2, np.nan))
    with pytest.raises(FlexinvError, match=r"call 1 of the exported library, torque: status NOT_FINITE"):
        program.ask([plan.questions[0], wild])
    fails = Path(shutil.which("false") or "/bin/false").read_bytes()
    with pytest.raises(FlexinvError, match=r"the program around the exported library ended with 1"):
        replace(program, data=fails).ask(plan.questions[:1])


def test_its_tools_are_the_compilers_that_an_export_looks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """One list in the engine's row, which imports nothing, and one where libraries are linked."""
    assert ENGINE.tools == (*_list_names(NATIVE), "ziglang")
    assert ENGINE.has_tool == (find_compiler(NATIVE) is not None)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert not ENGINE.has_tool
    assert find_compiler(NATIVE) is None
    assert ENGINES["flexinv"].has_tool
