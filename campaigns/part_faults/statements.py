"""Faults of what is stated of a part: material, units, placement, how interfaces are chosen, modes."""

from __future__ import annotations

import random

from campaigns.part_faults.draft import MATERIAL, Draft, make_draft
from campaigns.part_faults.table import fault

TIP_PLANE = "plane = { point_m = [LENGTH, 0, 0], normal = [1, 0, 0] }"


def _state(draw: random.Random, old: str, new: str, kind: str = "tetra10") -> Draft:
    draft = make_draft(draw, kind)
    draft.swap(old, new)
    return draft


def _choose_tip(draw: random.Random, text: str) -> Draft:
    """A part whose tip is chosen by a text, with LENGTH in metres."""
    draft = make_draft(draw)
    length = f"{draft.size[0] / 1000:.9g}"
    draft.swap(TIP_PLANE.replace("LENGTH", length), text.replace("LENGTH", length))
    return draft


def _choose_hub(draw: random.Random, *members: int) -> Draft:
    """A part whose hub is a set of few nodes."""
    draft = make_draft(draw)
    draft.sets["HUB"] = list(members)
    return draft


STATED = {
    "density_in_tonnes_per_mm3": ("2700", "2.7e-9", "t/mm3"),
    "density_in_g_per_cm3": ("2700", "2.7", "sound would run"),
    "density_thousandfold": ("2700", "2.7e6", "density|rho"),
    "density_of_zero": ("2700", "0", "above zero|above 0|density"),
    "density_negative": ("2700", "-2700", "density|rho"),
    "modulus_in_mpa": ("70e9", "70e3", "MPa"),
    "modulus_in_gpa": ("70e9", "70", "GPa|E_Pa"),
    "modulus_in_kpa": ("70e9", "70e6", "as heavy as a metal"),
    "modulus_thousandfold": ("70e9", "70e12", "E_Pa"),
    "modulus_negative": ("70e9", "-70e9", "E_Pa"),
    "modulus_not_a_number": ("70e9", "nan", "E_Pa"),
    "nu_of_one_half": ("nu = 0.3", "nu = 0.5", "nu"),
    "nu_of_rubber": ("nu = 0.3", "nu = 0.4999", "locks?"),
    "nu_too_large": ("nu = 0.3", "nu = 0.6", "nu"),
    "nu_in_percent": ("nu = 0.3", "nu = 30", "nu"),
    "nu_negative": ("nu = 0.3", "nu = -1.2", "nu"),
    "no_material": (MATERIAL, "", "material"),
    "material_of_steel_by_name": (MATERIAL, 'material = "steel"', "material"),
    "tip_without_a_set": ('set = "HUB"', 'set = "FLANGE"', "HUB"),
    "unit_of_zero": ("unit_m = 0.001", "unit_m = 0", "unit_m"),
    "unit_negative": ("unit_m = 0.001", "unit_m = -0.001", "unit_m"),
    "unit_turned_over": ("unit_m = 0.001", "unit_m = 1000", "unit_m|share"),
    "placement_in_millimetres": ("modes = 3", "modes = 3\nplacement = { xyz_m = [100, 0, 0] }", "caught|placement|reaches"),
    "placement_mirrored": ("modes = 3", "modes = 3\nplacement = { axes = [[1, 0, 0], [0, -1, 0], [0, 0, 1]] }", "placement"),
    "too_many_modes": ("modes = 3", "modes = 100000", "modes"),
    "modes_negative": ("modes = 3", "modes = -1", "modes"),
    "root_is_no_interface": ('root = "hub"', 'root = "HUB"', 'root = "hub"'),
    "joint_on_no_interface": ('interface = "tip"', 'interface = "flange"', "an interface of the mesh: hub, tip"),
    "joint_in_the_link_frame": ('interface = "tip"\n', "", "no interface of arm"),
    "damping_negative": ("modes = 3", "modes = 3\nretardation_s = -1e-5", "retardation"),
    "damping_of_a_second": ("modes = 3", "modes = 3\nretardation_s = 1", "critical damping"),
    "file_not_there": ("arm.inp", "Arm.inp", "no such file"),
    "file_of_a_surface": ('file = "arm.inp"', 'file = "arm.stl"', "arm.stl"),
    "finer_is_the_same": ("modes = 3", 'modes = 3\nfiner_file = "arm.inp"', "finer"),
    "lumped_quadratic": ("modes = 3", "modes = 3\nlumped = true", "lumped"),
    "orthotropic_impossible": (
        "E_Pa = 70e9, nu = 0.3", "E_Pa = [9e10, 9e9, 9e9], nu = [4, 0.3, 0.4], G_Pa = [5e9, 5e9, 3e9]", "nu"),
    "orthotropic_without_shear": ("E_Pa = 70e9", "E_Pa = [9e10, 9e9, 9e9]", "G_Pa|three|nu"),
}  # fmt: skip
CHOSEN = {
    "plane_in_millimetres": ("plane = { point_m = [400, 0, 0], normal = [1, 0, 0] }", "0 nodes are caught"),
    "plane_along_another_axis": ("plane = { point_m = [LENGTH, 0, 0], normal = [0, 1, 0] }", "share|caught|middle"),
    "cylinder_that_catches_nothing": (
        "cylinder = { point_m = [LENGTH, 0, 0.5], axis = [1, 0, 0], radius_m = 0.01, length_m = 0.1 }", "nodes are caught"),
    "cylinder_of_diameter_for_radius": (
        "cylinder = { point_m = [0, 0, 0], axis = [1, 0, 0], radius_m = 0.5, length_m = 2 }", "0 nodes are caught"),
    "box_the_wrong_way": ("box = { from_m = [1, 1, 1], to_m = [0.3, -1, -1] }", "box|caught"),
    "box_around_everything_but_the_hub": ("box = { from_m = [0.01, -1, -1], to_m = [1, 1, 1] }", "hold all nodes"),
    "tolerance_of_the_whole_body": (
        "plane = { point_m = [LENGTH, 0, 0], normal = [1, 0, 0] }\ntolerance_m = 0.29", "takes the part whole|share"),
    "tolerance_negative": ("plane = { point_m = [LENGTH, 0, 0], normal = [1, 0, 0] }\ntolerance_m = -1e-6", "tolerance"),
    "tie_unknown": ('plane = { point_m = [LENGTH, 0, 0], normal = [1, 0, 0] }\ntie = "RBE2"', "rigid"),
    "tip_is_the_hub": ('set = "HUB"', "share"),
}  # fmt: skip
SETS = {
    "set_of_two_nodes": ((1, 2), "caught|three"),
    "set_of_one_node_thrice": ((1, 1, 1), "caught|three"),
    "set_that_is_empty": ((), "a set of the file"),
}

for name, (old, new, words) in STATED.items():
    fault(words, name)(lambda draw, old=old, new=new: _state(draw, old, new))
for name, (text, words) in CHOSEN.items():
    fault(words, name)(lambda draw, text=text: _choose_tip(draw, text))
for name, (members, words) in SETS.items():
    fault(words, name)(lambda draw, members=members: _choose_hub(draw, *members))


@fault("line")
def choose_nodes_on_a_line(draw: random.Random) -> Draft:
    """The hub is an edge: all of its nodes are on a line."""
    draft = make_draft(draw)
    edge = (draft.points[:, 0] < 1e-9) & (draft.points[:, 1] < -draft.size[1] / 2 + 1e-9)
    draft.sets["HUB"] = draft.numbers[edge].tolist()
    return draft


@fault("hold all nodes")
def choose_all_nodes(draw: random.Random) -> Draft:
    """The hub's set is of all nodes but those of the tip: nothing is left to deform."""
    draft = make_draft(draw)
    draft.sets["HUB"] = draft.numbers[draft.points[:, 0] < draft.size[0] - 1e-6].tolist()
    return draft


@fault("materials|BODY")
def name_material_of_no_set(draw: random.Random) -> Draft:
    """A material of a set that is not there."""
    table = "[links.arm.materials.STEEL]\nE_Pa = 2e11\nnu = 0.3\nrho_kg_per_m3 = 7850\n\n[links.arm.interfaces.hub]"
    return _state(draw, "[links.arm.interfaces.hub]", table)
