"""What is named agrees with all that an engine said: every line of its certificate and every quantity that it gave."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

from crosscheck.causes.diagnosis import describe_cause, describe_diagnosis, find_record_causes
from crosscheck.causes.evidence import _is_left
from crosscheck.causes.fit import Columns
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import offered
from crosscheck.measures.certificate import EXACT, Certificate
from crosscheck.measures.record import Record, save
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Beam, Mechanism

MODELS = Path(__file__).resolve().parents[3] / "models"
# Three runs from 4 elements and 4 steps per sample up: bars of some 1e-4 of the range.
COARSE = {"elements": 16}
Harm = Callable[[Mechanism], Mechanism]
POUND_FOOT = 1.0 / 1.3558179483314004  # 1 ft lb in N m


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's arms in a folder of their own: a fifth of a second's rest less, and steps twice as long."""
    folder: Path = tmp_path_factory.mktemp("models")
    for name in ("flex_one_link", "flex_two_link"):
        copytree(MODELS / name, folder / name)
        cases = folder / name / "cases.toml"
        text = cases.read_text().replace("step_s = 1e-4", "step_s = 2e-4").replace("hold_s = 0.3", "hold_s = 0.1")
        cases.write_text(text)
    return folder


@cache
def load(place: str, models: Path = MODELS) -> tuple[Mechanism, Case]:
    mechanism, case = place.split("/")
    result = load_mechanism(models / mechanism)
    return result, load_cases(models / mechanism, result)[case]


@cache
def reference(place: str, models: Path) -> Record:
    mechanism, case = load(place, models)
    return ran(mechanism, case, "flexinv")


@cache
def columns(place: str, models: Path) -> Columns:
    """The dictionary's columns, which are those of the unharmed mechanism whatever the harm."""
    return Columns()


def ran(mechanism: Mechanism, case: Case, engine: str) -> Record:
    """What an engine gives, with its certificate, as a run keeps it."""
    options = {"step": case.sample / 8, **COARSE} if engine.startswith("exudyn-") else {}
    record = adapter(ENGINES[engine]).run(mechanism, case, engine, options)
    certify = offered(adapter(ENGINES[engine]), "certify")
    assert certify is not None
    said = json.loads(json.dumps(certify(mechanism, case, engine).plain))
    return replace(record, certificate=said)


def told(
    folder: Path,
    place: str,
    engine: str,
    harm: Harm | None = None,
    after: Callable[[Record], Record] | None = None,
    models: Path = MODELS,
) -> dict[str, Any]:
    """What is said of an engine whose model is harmed, or whose record is changed after it ran; it is not run again healed."""
    mechanism, case = load(place, models)
    record = ran(mechanism if harm is None else harm(mechanism), case, engine)
    save(record if after is None else after(record), folder / "ours")
    save(reference(place, models), folder / "theirs")
    stems = (str(folder / "ours"), str(folder / "theirs"))
    naming = find_record_causes(str(models / mechanism.name), case.name, *stems, columns(place, models)).naming
    return {"named": [describe_cause(f) for f in naming.named], "words": describe_diagnosis(naming)}


def names(answer: dict[str, Any]) -> set[str]:
    return {one["cause"] for one in answer["named"]}


def scaled(factor: float) -> Callable[[Record], Record]:
    def change(record: Record) -> Record:
        made = {
            n: replace(s, values=factor * s.values) if s.quantity == "torque" else s for n, s in record.series.items()
        }
        return replace(record, series=made)

    return change


def beams(change: Callable[[Beam], Beam], name: str | None = None) -> Harm:
    def harm(mechanism: Mechanism) -> Mechanism:
        links = (
            replace(x, beam=change(x.beam)) if x.beam is not None and name in (None, x.name) else x
            for x in mechanism.links
        )
        return replace(mechanism, links=tuple(links), urdf=None)

    return harm


def wider(beam: Beam) -> Beam:
    """2 % wider across its bending: area and bending stiffness in the plane grow alike."""
    stiffness, section = beam.section.stiffness.copy(), beam.section
    stiffness[:, [0, 1, 2, 3]] *= 1.02
    thin, wide = (4, 5) if stiffness[0, 4] < stiffness[0, 5] else (5, 4)
    stiffness[:, thin] *= 1.02
    stiffness[:, wide] *= 1.02**3
    rotary = section.rotary_inertia.copy()
    rotary[:, thin - 3] *= 1.02
    rotary[:, wide - 3] *= 1.02**3
    rotary[:, 0] = rotary[:, 1] + rotary[:, 2]
    return replace(
        beam,
        section=replace(
            section, stiffness=stiffness, rotary_inertia=rotary, mass_per_length=section.mass_per_length * 1.02
        ),
    )


def stiffer(beam: Beam) -> Beam:
    """E and G larger by 5 %."""
    return replace(beam, section=replace(beam.section, stiffness=beam.section.stiffness * 1.05))


def shifted(beam: Beam) -> Beam:
    place = beam.placement
    return replace(beam, placement=replace(place, position=place.position + np.array([0.0, 4e-3, 0.0])))


def coms(mechanism: Mechanism) -> Mechanism:
    def link(one: Any) -> Any:
        bodies = tuple(
            replace(b, inertia=b.inertia.replace_unchecked(com=1.02 * b.inertia.com, tensor=b.inertia.tensor))
            for b in one.bodies
        )
        return replace(one, bodies=bodies)

    return replace(mechanism, links=tuple(map(link, mechanism.links)), urdf=None)


def rotors(factor: float) -> Harm:
    def harm(mechanism: Mechanism) -> Mechanism:
        joints = tuple(replace(j, rotor_inertia=factor * j.rotor_inertia) for j in mechanism.joints)
        return replace(mechanism, joints=joints, urdf=None)

    return harm


@pytest.mark.parametrize("factor", [1.02, POUND_FOOT])
@pytest.mark.parametrize("place", ["double_pendulum/swing", "rigid_3r/cycloid"])
def test_a_unit_of_all_torques_is_no_matter_of_masses(tmp_path: Path, place: str, factor: float) -> None:
    assert names(told(tmp_path, place, "pinocchio", after=scaled(factor))) == {"effort scale of all"}


def test_centres_of_mass_two_per_cent_out_are_no_payload(tmp_path: Path) -> None:
    assert names(told(tmp_path, "rigid_3r/cycloid", "pinocchio", coms)) == {"centres of mass scaled"}


def test_rotors_three_times_as_large_are_no_implicit_damping(tmp_path: Path) -> None:
    answer = told(tmp_path, "quanser_2dsfl_rigid/moves", "pinocchio", rotors(3.0))
    assert names(answer) == {"rotor inertia scale"}


@pytest.mark.slow
def test_a_wider_strip_is_no_gear_ratio(tmp_path: Path, short: Path) -> None:
    answer = told(tmp_path, "flex_one_link/cycloid", "exudyn-ge", beams(wider), models=short)
    # The strip is 20 mm along z, which is its height in the words of sections.
    assert not names(answer) - {"section width", "cross-section area", "section height"}


@pytest.mark.slow
def test_a_clamp_beside_the_axis_is_no_stiffness(tmp_path: Path, short: Path) -> None:
    answer = told(tmp_path, "flex_one_link/cycloid", "exudyn-ge", beams(shifted), models=short)
    assert not names(answer) - {"clamp misplaced"}


@pytest.mark.slow
def test_a_stiffer_material_is_a_cause_with_stiffness(tmp_path: Path, short: Path) -> None:
    answer = told(tmp_path, "flex_two_link/cycloid", "exudyn-ge", beams(stiffer, "link1"), models=short)
    assert not names(answer) - {"modulus of elasticity", "section stiffness"}


@pytest.mark.slow
def test_where_the_certificate_contradicts_every_cause_none_is_named(tmp_path: Path) -> None:
    """Torques of a damper too many from an engine whose model says that a body is heavier: two faults, or another one."""
    mechanism, case = load("double_pendulum/swing")

    def heavy(one: Mechanism) -> Mechanism:
        (first, *rest) = one.links
        (body, *others) = first.bodies
        more = replace(body, inertia=body.inertia.replace_unchecked(mass=1.1 * body.inertia.mass))
        return replace(one, links=(replace(first, bodies=(more, *others)), *rest))

    joints = tuple(replace(j, damping=j.damping + 0.1) if j.name == "knee" else j for j in mechanism.joints)
    damped = ran(replace(mechanism, joints=joints), case, "pinocchio")
    said = ran(heavy(mechanism), case, "pinocchio").certificate
    answer = told(tmp_path, "double_pendulum/swing", "pinocchio", after=lambda _: replace(damped, certificate=said))
    assert answer["named"] == []
    assert "total mass" in answer["words"]


def test_a_line_that_an_engine_does_not_state_is_not_left_as_it_is() -> None:
    """Nothing is known of it, so it contradicts nothing; what it states, and a cause does not change, is left."""
    certificate = Certificate(masses={"a": 1.0, "b": 2.0})
    assert not _is_left("masses", Certificate(), certificate, certificate)
    assert not _is_left("masses", Certificate(masses={"c": 1.0}), certificate, certificate)
    theirs = Certificate(masses={"a": 1.1, "b": 2.0})
    assert _is_left("masses", theirs, certificate, certificate)
    assert not _is_left("masses", theirs, certificate, theirs)


@pytest.mark.slow
def test_a_failing_line_that_a_cause_leaves_as_it_is_contradicts_it(tmp_path: Path) -> None:
    """A centre of mass that is out by twice what is allowed fails; a scale of all torques says nothing of it."""

    def change(record: Record) -> Record:
        said = dict(record.certificate)
        com = np.asarray(said["com"], dtype=float)
        said["com"] = (com + 2.0 * EXACT * np.abs(com).max()).tolist()
        return scaled(1.02)(replace(record, certificate=said))

    assert names(told(tmp_path, "rigid_3r/quintic", "pinocchio", after=scaled(1.02))) == {"effort scale of all"}
    answer = told(tmp_path, "rigid_3r/quintic", "pinocchio", after=change)
    assert "effort scale of all" not in names(answer)
    # ruled out, with what contradicts it; rounding decides whether beside a pair of causes or alone
    ways = r"\(centre of mass\)|would explain the efforts, but is contradicted by centre of mass"
    assert re.search(f"effort scale of all ({ways})", answer["words"])
