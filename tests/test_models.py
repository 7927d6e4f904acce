"""The models: every one loads without a warning, stays inside its limits and gives the answer that is known."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexinv
from crosscheck.engines import ENGINES, adapter, describe_missing_package
from flexinv.files import case_schema, closures, joints, schema, sections
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.files.toml_tables import Table
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

MODELS = Path(__file__).resolve().parent.parent / "models"
NAMES = sorted(path.parent.name for path in MODELS.glob("*/mechanism.toml"))
STATIC = ("princeton_beam", "reissner_cantilever")  # slow on purpose: published numbers are those of statics
README = (MODELS / "README.md").read_text(encoding="utf-8")


def read(name: str, case: str) -> tuple[Mechanism, Array, Array, Array]:
    """The mechanism and its motion on the sample times of a case."""
    mechanism = load_mechanism(MODELS / name)
    chosen = load_cases(MODELS / name, mechanism)[case]
    time = np.arange(0, chosen.end + chosen.sample / 2, chosen.sample)
    return mechanism, *chosen.motion.evaluate(mechanism, time)


@pytest.mark.parametrize("name", NAMES)
def test_model_stays_inside_its_limits(name: str) -> None:
    """Positions and speeds, on every sample; speeds that are a tenth of the limit at least test nothing less."""
    mechanism = load_mechanism(MODELS / name)
    for case in load_cases(MODELS / name, mechanism).values():
        time = np.arange(0, case.end + case.sample / 2, case.sample)
        q, qd, _ = case.motion.evaluate(mechanism, time)
        for joint in (j for j in mechanism.joints if j.kind in ("revolute", "prismatic")):
            position, speed = q[:, mechanism.q_slices[joint.name]], np.abs(qd[:, mechanism.v_slices[joint.name]])
            # 1e-12: a position at its limit is a sum of rounded numbers
            assert position.min() >= joint.limits.lower - 1e-12
            assert position.max() <= joint.limits.upper + 1e-12
            assert speed.max() <= joint.limits.velocity
        assert name in STATIC or np.abs(qd).max() > 0.5  # velocity-dependent torques matter


@pytest.mark.parametrize("name", NAMES)
def test_model_states_its_sources(name: str) -> None:
    mechanism = load_mechanism(MODELS / name)
    assert mechanism.name == name
    assert mechanism.title
    assert mechanism.source
    assert f"[{name}]({name})" in README
    for case in load_cases(MODELS / name, mechanism).values():
        assert case.title
        assert case.source
        assert {limit.quantity for limit in case.limits} == set(case.quantities)


@pytest.mark.parametrize("name", NAMES)
def test_model_has_a_second_engine(name: str) -> None:
    """At least one case is compared with an engine of others, or with a machine, in all that it states."""
    mechanism = load_mechanism(MODELS / name)
    others = [
        e for e in ENGINES.values() if e.requires != "flexinv" and not e.native and describe_missing_package(e) is None
    ]
    result = [
        engine.name
        for case in load_cases(MODELS / name, mechanism).values()
        for engine in others
        if adapter(engine).unsupported(mechanism, case, engine.name) is None
    ]
    assert result


def test_readme_has_no_other_models() -> None:
    assert sorted(re.findall(r"^\| \[(\w+)\]", README, re.M)) == NAMES


PEAKS = {"cycloid": (5.984, 2.790, 0.739), "quintic": (5.821, 2.708, 0.7145)}


@pytest.mark.parametrize("law", PEAKS)
def test_paper_1(law: str) -> None:
    """The peaks that the table states, half a unit of their last digit and the spacing of the samples off."""
    torque = np.abs(flexinv.joint_torques(*read("rigid_3r", law))).max(axis=0)
    assert np.all(np.abs(torque - PEAKS[law]) < [1e-3, 1e-3, 5e-4])
    assert ", ".join(str(peak).ljust(5, "0") for peak in PEAKS[law]) in README


@pytest.mark.parametrize("case", ["swing", "sampled"])
def test_double_pendulum_has_its_closed_form(case: str) -> None:
    """The formulas of the README, term by term."""
    mechanism, q, qd, qdd = read("double_pendulum", case)
    (q1, q2), (v1, v2), (a1, a2) = q.T, qd.T, qdd.T
    m1, m2, l1, l2, g = 1.0, 0.5, 1.0, 0.8, 9.81
    h = m2 * l1 * l2 * np.sin(q2) / 2
    m12 = m2 * (l2**2 / 3 + l1 * l2 * np.cos(q2) / 2)
    weight = m2 * g * l2 / 2 * np.sin(q1 + q2)
    tau1 = (m1 * l1**2 / 3 + m2 * (l1**2 + l2**2 / 3 + l1 * l2 * np.cos(q2))) * a1 + m12 * a2
    tau1 += -h * (2 * v1 * v2 + v2**2) + (m1 / 2 + m2) * g * l1 * np.sin(q1) + weight
    tau2 = m12 * a1 + m2 * l2**2 / 3 * a2 + h * v1**2 + weight
    torque = flexinv.joint_torques(mechanism, q, qd, qdd)
    # rounding: some hundred operations on numbers up to 20
    assert np.abs(torque - np.stack([tau1, tau2], axis=1)).max() < 1e-13 * 20


def published(name: str) -> list[tuple[str, float, float]]:
    """Series, time and value of the published numbers of a mechanism that stand in corpus.toml."""
    notes = tomllib.loads((MODELS / "corpus.toml").read_text(encoding="utf-8"))["published"]
    return [(one["series"], one["at_s"], one["value"]) for one in notes if one["mechanism"] == name]


@pytest.mark.parametrize(
    ("name", "length", "near"), [("princeton_beam", 0.508, 4e-4), ("reissner_cantilever", 5.0, 2e-4)]
)
def test_slow_beams_are_where_was_published(name: str, length: float, near: float) -> None:
    """Within parts of the length: ANSYS's twisted beams are 3e-4 away; the printed -2.159 is 1.4e-4 from Reissner's rod."""
    mechanism = load_mechanism(MODELS / name)
    (case,) = load_cases(MODELS / name, mechanism).values()
    s = flexinv.solve(mechanism, case.motion, case.step, end=case.end, initial=case.initial, start=case.start)
    numbers = published(name)
    assert len(numbers) in (2, 16)
    for series, at, value in numbers:
        quantity, link, axis = series.split("/")
        result = {"tip": s.tip, "deflection": s.deflection}[quantity][link][
            np.abs(s.time - at).argmin(), "xyz".index(axis)
        ]
        assert abs(result - value) < near * length, (series, at)
    # nearly at rest the drive holds the moment of the load about its axis: inertia is 1.5e-5 of it while the load grows
    # along straight lines, whose corners shake the beam
    (force,), (tip,) = mechanism.forces, s.tip.values()
    load = np.stack([np.interp(s.time, force.time, force.wrench[:, k]) for k in range(3)], axis=1)
    moment = np.cross(tip, load) @ mechanism.joints[0].axis
    assert np.abs(s.torque[:, 0] + moment).max() < 3e-5 * np.abs(moment).max()


def test_rigid_twin_has_the_inertia_of_the_beam() -> None:
    """m L^2/3 + rho I L; the twin's box and the section's rounded rho I differ by 1e-7 of it."""
    mechanism, q, qd, qdd = read("rigid_one_link", "cycloid")
    beam = load_mechanism(MODELS / "flex_one_link").links[0].beam
    assert beam is not None
    inertia = beam.section.mass_per_length[0] * beam.length**3 / 3 + beam.section.rotary_inertia[0, 2] * beam.length
    assert inertia == pytest.approx(1.1947e-3, abs=5e-8)
    assert np.allclose(flexinv.joint_torques(mechanism, q, qd, qdd), inertia * qdd, rtol=1e-7, atol=0)


def test_strips_are_one_material_in_two_shapes() -> None:
    """What the source of flex_two_link says: EA = 12 EI/t^2, rho I = rho A t^2/12, the same area."""
    upper, lower = (link.beam for link in load_mechanism(MODELS / "flex_two_link").links)
    assert upper is not None
    assert lower is not None
    for beam, thickness in ((upper, 1.95e-3), (lower, 1.95e-3 / np.sqrt(10))):
        (ea, _, ga, gj, ei_y, ei_z), rho_a = beam.section.stiffness[0], beam.section.mass_per_length[0]
        width = rho_a / 2700 / thickness
        assert ea == pytest.approx(12 * ei_z / thickness**2, rel=1e-3)  # rounded to four digits in the design
        assert ga == pytest.approx(5 / 6 * ea / 2.6, rel=1e-3)
        assert gj == pytest.approx(ea / 2.6 * thickness**2 / 3 * (1 - 0.63 * thickness / width), rel=2e-3)
        assert ei_y == pytest.approx(ea * width**2 / 12, rel=2e-3)
        rotary = rho_a * np.array([width**2 + thickness**2, width**2, thickness**2]) / 12
        assert np.allclose(beam.section.rotary_inertia[0], rotary, rtol=3e-3, atol=0)  # three digits are typed


def blocks() -> list[str]:
    return re.findall(r"^```toml\n(.*?)^```$", README, re.M | re.S)


def test_examples_of_the_readme_load(tmp_path: Path) -> None:
    native, loop, urdf, cases = blocks()
    for name, text in (("crane", native), ("door", loop), ("arm", urdf)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mechanism.toml").write_text(text, encoding="utf-8")
    crane, arm = load_mechanism(tmp_path / "crane"), load_mechanism(tmp_path / "arm")
    assert [joint.name for joint in crane.joints] == ["slew", "luff", "fix"]
    door = load_mechanism(tmp_path / "door")
    things = [thing.name for thing in (*door.closures, *door.springs, *door.forces)]
    assert things == ["lug", "gear", "return", "strut", "stop", "wind"]
    assert [link.name for link in arm.beams] == ["forearm_link"]
    (tmp_path / "crane" / "cases.toml").write_text(cases, encoding="utf-8")
    assert load_cases(tmp_path / "crane", crane)["lift"].end == 3.0


def tables() -> list[type[Table]]:
    modules: list[Any] = [schema, sections, joints, closures, case_schema]
    result = [thing for module in modules for thing in vars(module).values()]
    result += [table for kinds in (case_schema.MOVES, case_schema.STARTS) for table, _, _ in kinds.values()]
    return [thing for thing in result if isinstance(thing, type) and issubclass(thing, Table)]


def test_readme_names_every_key() -> None:
    """A key that a reader cannot find does not exist; from_, to_, at_ are named once for all kinds of joint."""
    words = set(re.findall(r"\w+", README))
    missing = []
    for table in tables():
        for key in table.model_fields:
            parts = key.split("_", 1)
            named = key in words or (parts[0] in ("from", "to", "at") and f"_{parts[-1]}" in words)
            missing += [] if named else [f"{table.__name__}.{key}"]
    assert missing == []


def test_examples_of_keys_are_valid() -> None:
    """What a complaint tells to write is TOML and names the key it is about."""
    for table in tables():
        for key, info in table.model_fields.items():
            assert info.description
            assert info.examples
            example = str(info.examples[0])
            assert example.startswith(("[", key)), f"{table.__name__}.{key}: {example}"
