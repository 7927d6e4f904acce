"""Planted faults of meshed parts: a sample is refused or found, parts that are right are silent, and the judge sees silence."""

from __future__ import annotations

from dataclasses import replace

import pytest
from click.testing import CliRunner

from campaigns.part_faults.__main__ import main
from campaigns.part_faults.catalogue import list_faults
from campaigns.part_faults.trial import GOOD, try_fault

FAULTS = {one.name: one for one in list_faults()}
CONTROLS = [name for name, one in FAULTS.items() if not one.words]
# Each finding of lint, and each error that another fault does not reach.
OWN_CHECKS = [
    "repeat_node_in_cell", "crack_seam", "leave_nodes_loose", "hang_by_one_node", "hang_by_an_edge", "repeat_cell",
    "fill_plate_with_bricks", "fill_plate_with_linear_cells", "stretch_one_axis", "squeeze_cells", "density_in_g_per_cm3",
    "modulus_in_kpa", "nu_of_one_half", "nu_of_rubber", "joint_in_the_link_frame", "damping_of_a_second",
    "lumped_quadratic", "tolerance_of_the_whole_body", "number_anew_and_hold_other_nodes", "box_around_everything_but_the_hub",
    "decimal_comma", "torn_set", "nastran_other_axes", "nastran_grid_twice", "matrix_stiffness_indefinite",
    "matrix_mass_indefinite", "matrix_seventh_motion", "matrix_mass_rows_permuted", "matrix_unit_of_mass_forgotten",
    "matrix_both_smaller", "modulus_not_a_number", "set_that_is_empty", "choose_nodes_on_a_line",
]  # fmt: skip
OTHERS = [name for name in FAULTS if name not in OWN_CHECKS and name not in CONTROLS][::8]


@pytest.mark.parametrize("name", OWN_CHECKS + OTHERS)
def test_a_fault_is_refused_or_found(name: str) -> None:
    found = try_fault(FAULTS[name], seed=3)
    assert found.word in ("refused", "found"), f"{found.word}: {found.said}"


@pytest.mark.parametrize("name", CONTROLS)
def test_nothing_is_said_of_a_part_that_is_right(name: str) -> None:
    found = try_fault(FAULTS[name], seed=3)
    assert found.word == "right", found.said


def test_the_judge_sees_silence_other_words_and_false_alarms() -> None:
    right = FAULTS[CONTROLS[0]]
    wrong = FAULTS["mirror_mesh"]
    assert try_fault(replace(right, words="inverted"), 0).word == "silent"
    assert try_fault(replace(wrong, words="no such words"), 0).word == "off"
    assert try_fault(replace(wrong, words=""), 0).word == "false alarm"


def test_the_command_shows_one_fault_and_ends_with_one_where_it_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    done = CliRunner().invoke(main, ["--only", "mirror_mesh"])
    assert done.exit_code == 0
    assert "is inverted" in done.output
    missed = replace(FAULTS["mirror_mesh"], words="no such words")
    monkeypatch.setattr("campaigns.part_faults.__main__.list_faults", lambda: [missed])
    done = CliRunner().invoke(main, [])
    assert done.exit_code == 1
    assert "off" not in GOOD
    assert done.output.startswith("off ")


def test_there_are_sixty_faults_and_more() -> None:
    assert len(FAULTS) - len(CONTROLS) >= 60
