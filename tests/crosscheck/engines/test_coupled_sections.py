"""Coupled sections in crosscheck: whoever cannot do them says so, and nobody takes the diagonal for the whole."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import crosscheck
from crosscheck.causes.model import make_model
from crosscheck.causes.rows import beams as beam_rows
from crosscheck.causes.rows import sections as section_rows
from crosscheck.causes.subject import Subject
from crosscheck.engines import ENGINES
from crosscheck.engines.exudyn.models.frames import evaluate_section
from crosscheck.engines.flexinv.certificate import compute_beam_stiffness
from crosscheck.engines.mujoco.rod import Rod
from crosscheck.equivalence.beams.rigid_beams import make_rigid_mechanism
from crosscheck.equivalence.beams.sampled import sample_beam
from crosscheck.identification.identified_file import Layer, Tables, _fill_beam_tables
from crosscheck.identification.parameters import apply_values
from crosscheck.identification.table import Row
from crosscheck.kit.lift import lift_kit
from crosscheck.kit.resolved import build_case_file
from flexinv import joint_torques
from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Beam, Mechanism

MODELS = Path(__file__).resolve().parents[3] / "models"
BENDING = ("mujoco-flex", "exudyn-ancf", "exudyn-ge")


def pair(name: str) -> tuple[Mechanism, Case]:
    mechanism = load_mechanism(MODELS / name)
    return mechanism, next(iter(load_cases(MODELS / name, mechanism).values()))


def change_beams(mechanism: Mechanism, y: float, z: float, angle: float) -> Mechanism:
    """The mechanism with all sections as if their axis were elsewhere: other beams, with every kind of coupling."""
    links = []
    for link in mechanism.links:
        if link.beam is not None:
            link = replace(link, beam=replace(link.beam, section=link.beam.section.move_axis(y, z, angle)))
        links.append(link)
    return replace(mechanism, links=tuple(links), urdf=None)


def coupled(name: str = "spatial_arm") -> tuple[Mechanism, Case]:
    mechanism, case = pair(name)
    return change_beams(mechanism, 0.01, 0.004, 0.3), case


def beam_of(mechanism: Mechanism) -> Beam:
    beam = mechanism.beams[0].beam
    assert beam is not None
    return beam


@pytest.mark.parametrize("name", BENDING)
def test_engines_say_that_they_cannot_do_coupled_sections(name: str) -> None:
    """In the words of the case's row; of the models at hand each engine can do one with sections by numbers."""
    engine = import_module(ENGINES[name].module)
    for model in ("spatial_arm", "flex_one_link"):
        assert engine.unsupported(*coupled(model), name) is not None
    assert engine.unsupported(*pair("flex_one_link"), name) is None
    reason = engine.unsupported(*coupled("flex_one_link"), name)
    assert "cannot do coupled sections" in reason
    assert pair("flex_one_link")[0].beams[0].name in reason


def test_what_reads_six_stiffnesses_refuses_matrices() -> None:
    mechanism, _ = coupled()
    beam = beam_of(mechanism)
    readers = (
        lambda: evaluate_section(beam, 0.5),
        lambda: Rod("forearm", beam, 1, 0.0, 8).stiffness,
        lambda: sample_beam(beam, beam.section.stations),
        lambda: apply_values(mechanism, {("torsion stiffness", mechanism.beams[0].name): 2.0}),
    )
    for read in readers:
        with pytest.raises(InputError, match="the section is coupled"):
            read()


def test_one_factor_on_a_beam_is_one_on_its_matrix() -> None:
    mechanism, _ = coupled()
    changed = apply_values(mechanism, {("beam stiffness", mechanism.beams[0].name): 2.0})
    before, after = (beam_of(m).section.stiffness_matrices for m in (mechanism, changed))
    np.testing.assert_array_equal(after, 2.0 * before)


def test_a_kit_has_matrices_and_no_diagonal(tmp_path: Path) -> None:
    mechanism, case = coupled()
    file = build_case_file(mechanism, case)
    data = next(link.beam for link in file.mechanism.links if link.beam is not None).section
    assert data.EA == data.EI_z == data.rho_A == data.rho_I_x == []
    (tmp_path / "case.json").write_text(file.model_dump_json(), encoding="utf-8")
    lifted = lift_kit(tmp_path / "case.json").mechanism
    there = beam_of(lifted).section
    np.testing.assert_array_equal(there.stiffness_matrices, beam_of(mechanism).section.stiffness_matrices)
    np.testing.assert_allclose(there.mass_matrices, beam_of(mechanism).section.mass_matrices, rtol=1e-14, atol=1e-17)
    plain = build_case_file(*pair("spatial_arm")).model_dump_json()
    assert "matrix" not in plain
    for name in ("EA", "rho_A", "rho_I_z"):
        both = file.model_dump_json().replace(f'"{name}":[]', f'"{name}":[1.0]')
        (tmp_path / "case.json").write_text(both, encoding="utf-8")
        with pytest.raises(InputError, match=f"{name} beside matrices"):
            lift_kit(tmp_path / "case.json")


def test_compare_tells_coupled_beams_apart() -> None:
    mechanism, _ = coupled()
    name = f"link {mechanism.beams[0].name}"
    assert crosscheck.compare(mechanism, replace(mechanism, name="twin")).equal
    for other in (pair("spatial_arm")[0], change_beams(pair("spatial_arm")[0], 0.01, 0.004, -0.3)):
        found = crosscheck.compare(mechanism, replace(other, name="other"))
        assert not found.equal
        differences = [(d.cause, d.place) for d in [*found.differences, *found.judged.unseen]]
        assert ("beam with a coupled section", name) in differences


def test_a_held_beam_has_its_mass_off_the_axis() -> None:
    """A section about another axis holds the same masses where its beam goes along that axis."""
    plain, _ = pair("flex_one_link")
    y = 0.03
    moved = change_beams(plain, y, 0.0, 0.0)
    link = moved.beams[0]
    assert link.beam is not None
    root = link.beam.placement
    shifted = replace(root, position=root.position + root.rotation @ [0.0, y, 0.0])
    there = replace(
        moved,
        links=tuple(
            replace(one, beam=replace(link.beam, placement=shifted)) if one is link else one for one in moved.links
        ),
    )
    q = np.zeros((1, plain.nv))
    rates = np.ones((1, plain.nv))
    here, off, on = (joint_torques(make_rigid_mechanism(m), q, rates, rates) for m in (plain, moved, there))
    np.testing.assert_allclose(on, here, rtol=1e-12)
    assert np.abs(off / here - 1.0).max() > 1e-4


def test_the_certificate_states_compliances_of_coupled_beams() -> None:
    """A beam about another axis is as compliant under a moment, whatever axis it is described about."""
    plain, _ = pair("spatial_arm")
    moved = change_beams(plain, 0.01, 0.004, 0.0)
    name = plain.beams[0].name
    one, two = compute_beam_stiffness(plain), compute_beam_stiffness(moved)
    for what in ("GJ", "EI_y", "EI_z"):
        # GJ: a moment along x alone twists about the shear centre; bending alone about the centroid
        assert two[f"{name}: {what}"] == pytest.approx(one[f"{name}: {what}"], rel=1e-9)
    assert two[f"{name}: EA"] < 0.99 * one[f"{name}: EA"]  # a pull off the centroid bends, too


def test_causes_change_coupled_sections_as_a_whole_or_not_at_all() -> None:
    mechanism, case = coupled()
    name = mechanism.beams[0].name
    subject = Subject(mechanism, case)
    model = make_model(subject)
    rows = {row.name: row for row in (*section_rows.ROWS, *beam_rows.ROWS)}
    alone = [
        "section stiffness",
        "shear factor",
        "shear modulus",
        "cross-section area",
        "section width",
        "section size",
    ]
    whole = ["modulus of elasticity", "density", "beam mass", "rotary inertia of the section", "beam damping"]
    for kind in (*alone, "wall thickness"):
        assert rows[kind].targets(model) == []
    for kind in (*whole, "section turned", "lumped mass"):
        assert name in rows[kind].targets(model)
        made = rows[kind].change(subject, name, np.array([0.1]))
        assert made.mechanism != mechanism
        assert beam_of(made.mechanism).section.is_coupled
    assert rows["modulus of elasticity"].targets(model) == [name]
    for kind, target in (("shear modulus", name), ("section stiffness", f"{name}: EI_z"), ("cross-section area", name)):
        with pytest.raises(InputError, match="the section is coupled"):
            rows[kind].change(subject, target, np.array([0.1]))


def test_an_identified_factor_is_written_into_the_matrix() -> None:
    blade = {"shape": "matrices", "stiffness_matrix": [[2.0, 1.0], [1.0, 3.0]], "damping_matrix": [[1.0]]}
    data = {"links": {"arm": {"section": "blade"}}, "sections": {"blade": blade}}
    stiffer = Row("beam stiffness", "arm", "-", 1.5, 1.4, 1.6, 1.0, 0.5, 1.5, True, 0.0, 1.5)
    tables: Tables = {}
    layer = Layer(
        cast(Any, None), "", data["links"], {}, data["sections"]
    )  # of beams the file's tables alone are asked for
    rows = {("beam stiffness", "arm"): stiffer}
    assert list(_fill_beam_tables(layer, rows, tables, damped=False)) == [("beam stiffness", "arm")]
    written = tables['sections."blade of arm"']
    assert written["stiffness_matrix"][0] == [[3.0, 1.5], [1.5, 4.5]]
    later = {("beam damping", "arm"): replace(stiffer, parameter="beam damping", value=1e-3)}
    assert list(_fill_beam_tables(layer, later, tables, damped=False))
    assert written["retardation_s"][0] == 1e-3
    assert "damping_matrix" not in written
